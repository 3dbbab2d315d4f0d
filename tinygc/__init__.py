"""The estimation side: rotations, the closure residual, the methods, the physics, the report.

Conventions are those of ``session``'s docstring.  Nothing heavy is imported here; torch only where the network is.
"""

__version__ = "0.1.0"
