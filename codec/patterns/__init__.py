"""Clips cut into segments, and segments as points in the space of patterns."""
