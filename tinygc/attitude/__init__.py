"""Rotations, their integration over time, and the Earth's rotation."""
