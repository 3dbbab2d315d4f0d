"""Conversion of a model to C for a microcontroller, and the same arithmetic in NumPy."""
