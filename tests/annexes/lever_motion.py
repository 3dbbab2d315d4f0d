"""Forces of two units on a lever, with accelerometers whose filters delay them against the gyroscopes."""

import numpy as np
from scipy.interpolate import CubicSpline

from tinygc.annexes.arrays.fit import ArrayMotion

RATE_HZ = 200.0
TRUTH_M = np.array([0.03, -0.05, 0.02])


def motion(delay_s, turns=8):
    """Smooth turns of 3 s about all axes; unit 1 sits at TRUTH_M; both forces are late by delay_s."""
    rng = np.random.default_rng(0)
    t = np.arange(0, 4 * turns, 1 / RATE_HZ)
    frequency, phase, size = rng.uniform(0.2, 1.5, (3, 4)), rng.uniform(0, 2 * np.pi, (3, 4)), rng.uniform(0.5, 2, (3, 4))
    w = 2 * np.pi * frequency
    gravity = lambda t: 9.8 * np.stack([np.cos(0.7 * t), np.sin(0.7 * t) * np.cos(0.3 * t), np.sin(0.7 * t) * np.sin(0.3 * t)], axis=-1)  # noqa: E731

    def rate(t):
        return (size * np.sin(w * t[:, None, None] + phase)).sum(-1)

    def lever(t):
        omega, alpha = rate(t), (size * w * np.cos(w * t[:, None, None] + phase)).sum(-1)
        return np.cross(alpha, TRUTH_M) + np.cross(omega, np.cross(omega, TRUTH_M))

    forces = [gravity(t - delay_s), gravity(t - delay_s) + lever(t - delay_s)]
    forces = [CubicSpline(t, force) for force in forces]
    spans = [(0, t[(t > 4 * k + 0.5) & (t < 4 * k + 3.5)]) for k in range(turns)]
    return ArrayMotion([[CubicSpline(t, rate(t))]] * 2, [[force] for force in forces], spans)
