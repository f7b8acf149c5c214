"""Arithmetic that comes out the same on every machine, and the compiler of loops."""
