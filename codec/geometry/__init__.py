"""Rotations, kinematics, and what error means: floating point on arrays."""
