"""From rates to rotation steps.

The step's rotation vector is the mean rate times dt plus a coning term, c dt^2 w_k x w_k+1.  Were the rate straight between two
samples, c = 1/12 (Savage 1998, part 1; Bortz's equation for a linear rate).  It is curved, and the trapezoid misses dt^3/12 w'' a step;
summed over a movement from rest to rest, by parts, sum R w'' dt = -sum R (w x w') dt: one more coning term of the same size.  So
c = 1/6, and what remains is of fourth order: 6e-7 deg instead of 8e-4 deg per hand turn at 208 Hz.

The paper's step is the first-order quaternion [1, w dt/2], renormalised: it turns by theta - theta^3/12 and is kept to show that error.
"""

from __future__ import annotations

import numpy as np

from tinygc.attitude import rotation
from tinygc.attitude.rotation import Array

CONING = 1 / 6
INTEGRATORS = ("exact", "first-order")


def steps(rate: Array, dt: Array, integrator: str = "exact") -> Array:
    """Quaternions (..., T-1, 4) that turn the body from each sample to the next; rate (..., T, 3) rad/s, dt (..., T-1) s."""
    if integrator == "exact":
        return rotation.exp(step_vectors(rate, dt))
    if integrator == "first-order":
        half = (rate[..., :-1, :] + rate[..., 1:, :]) * dt[..., None] / 4
        xp = rotation.namespace(half)
        q = xp.concatenate([xp.ones_like(half[..., :1]), half], -1)
        return q / xp.sqrt((q**2).sum(-1))[..., None]
    raise ValueError(f"integrator is {integrator!r}, expected one of {', '.join(INTEGRATORS)}")


def step_vectors(rate: Array, dt: Array) -> Array:
    """Rotation vectors (..., T-1, 3) rad of the exact integrator."""
    before, after = zip(*((part[..., :-1], part[..., 1:]) for part in rotation.split(rate)), strict=True)
    half, coning = dt / 2, dt**2 * CONING
    mean = [(b + a) * half for b, a in zip(before, after, strict=True)]
    (bx, by, bz), (ax, ay, az) = before, after
    bent = by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax
    return rotation.join([m + c * coning for m, c in zip(mean, bent, strict=True)])


def cross(a: Array, b: Array) -> Array:
    """Vector product (..., 3), for arrays and tensors alike."""
    ax, ay, az = rotation.split(a)
    bx, by, bz = rotation.split(b)
    return rotation.join([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def sample_weights(dt: np.ndarray) -> np.ndarray:
    """Trapezoidal weights (..., T) s: how long each sample acts."""
    pad = np.zeros_like(dt[..., :1])
    return (np.concatenate([dt, pad], -1) + np.concatenate([pad, dt], -1)) / 2
