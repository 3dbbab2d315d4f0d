"""Rotations, their integration over time, and the Earth that turns below."""
