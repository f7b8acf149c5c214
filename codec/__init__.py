"""One clip, in memory: formats, body parts, segments, and the index file that a clip becomes."""
