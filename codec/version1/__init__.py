"""Index files of version 1: patterns and a residual."""
