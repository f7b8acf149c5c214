"""Rigs and their body parts: what the clips of a library share."""
