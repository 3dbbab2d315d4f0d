"""Noise figures that are made by hand, for tests of what reads them."""

import numpy as np

from tinygc.noise.figures import TERMS, AxisNoise, Inflation, NoiseFigures, SensorNoise, Term

SIGMA = 0.05  #: relative, of each term that is chosen


def axis_of(limits=None, tau_s=None, **terms):
    """Terms by name, each with its value and sigma, SI; limits of terms that are not shown; tau_s of G."""
    found = {}
    for name in TERMS:
        if name in terms:
            found[name] = Term(*terms[name], 1.0, None, tau_s if name == "G" else None, None if name != "G" else 0.0)
        else:
            found[name] = Term(0.0, None, 0.0, (limits or {}).get(name))
    return AxisNoise(found)


def axis(limits=(), tau_s=None, **sizes):
    """``axis(N=1e-4, K=2e-6)``; limits: of terms that are not chosen, by name; ``tau_s``: of G."""
    return axis_of(dict(limits), tau_s, **{name: (value, SIGMA * value) for name, value in sizes.items()})


def sensor(*axes):
    """Of one axis three times, or of three."""
    x, y, z = axes * (3 // len(axes))
    return SensorNoise((x, y, z))


#: within the ranges that autopilots document
GYRO = sensor(axis(N=4e-4, K=2e-5), axis(N=5e-4, K=1e-5), axis(N=3e-4, K=1.5e-5))
ACCEL = sensor(axis(N=5e-3, K=2e-4), axis(N=4e-3, K=1e-4), axis(N=3e-3, K=1e-4))
WALKING = Inflation("walking", np.array([2.0, 3.0, 4.0]), np.array([5.0, 6.0, 7.0]), source="two walks")


def figures(gyro=GYRO, accel=ACCEL, **changes):
    """Of ten hours at 208 Hz."""
    known = {"rate_hz": 208.0, "duration_s": 36_000.0, "samples": 7_488_000} | changes
    return NoiseFigures(gyro=gyro, accel=accel, **known)


def figures_of(gyro, accel=None, serial="", logs=("rest0001.csv",)):
    """Figures of a rest of ten hours at 104 Hz."""
    known = {"rate_hz": 104.0, "duration_s": 36_000.0, "samples": 3_744_000, "sensor": "ASM330LHH"}
    return NoiseFigures(gyro=gyro, accel=accel, logs=logs, serial=serial, **known)
