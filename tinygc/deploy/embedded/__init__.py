"""From a model to C that a microcontroller runs, and the same arithmetic in NumPy.

``program.py`` turns a model into stages; ``affine.py``, ``nets.py``, ``effects.py`` and ``convolutions.py`` hold the stages;
``register_input.py`` what a sensor's registers mean; ``vectors.py`` what the self-test compares; ``source.py`` writes the two files. A
stage is single precision and keeps its C beside the NumPy that does the same operations in the same order; the tests compare the two
bit by bit.
"""
