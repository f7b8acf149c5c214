"""``python -m motifold``: the same as the ``motifold`` command."""

from .workflows.cli import main

if __name__ == "__main__":
    main()
