"""The estimation side: rotations, the closure residual, the methods, the physics, the report.

Conventions are those of ``session``'s docstring.  Nothing heavy is imported here; torch only where the network is.
"""

from session.common.version import VERSION as __version__

__all__ = ["__version__", "load"]


def load(path, rate_hz=None):
    """A model file as ``omega = model(raw, acc, temp)``, rad/s in and out: see ``tinygc.deploy.calibration.Calibration``."""
    from tinygc.deploy.calibration import load

    return load(path, rate_hz)
