"""Replacing what stands between two marker comments of a Markdown file."""

from __future__ import annotations

BEGIN = "<!-- rate-distortion:begin -->"
END = "<!-- rate-distortion:end -->"


def with_block(text: str, block: str) -> str:
    """Return ``text`` with ``block`` between the markers; ValueError unless each is there once."""
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise ValueError(f"needs the lines {BEGIN} and {END}, once each and in this order")
    before, _, rest = text.partition(BEGIN)
    after = rest.partition(END)[2]
    return f"{before}{BEGIN}\n\n{block.strip()}\n\n{END}{after}"
