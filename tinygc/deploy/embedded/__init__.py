"""From a model to C that a microcontroller runs, and the same arithmetic in NumPy."""
