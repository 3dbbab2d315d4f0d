"""The catalogue itself: a file for each effect, which defines ``EFFECT``."""
