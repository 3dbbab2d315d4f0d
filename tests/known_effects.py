"""The effects that docs/formats.md lists, a strong one of each, and a hand's movement to try them on."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline

from session.base.units import DEG, G
from tinygc.effects import Movement

#: a strong one of each, as docs/formats.md would have it; and how much of what it does may be left when it is undone
STRONG = {
    "gyro.g_sensitivity": ([[0.05, -0.03, 0.02], [0.04, 0.06, -0.05], [-0.07, 0.02, 0.03]], 1e-12),
    "gyro.g2_sensitivity": ([0.08, -0.07, 0.13], 1e-12),
    # The derivative of a derivative, three times: what is left is the fourth power of an effect of some per cent.
    "gyro.angular_acceleration": ([[0.0036, 0.002, -0.002], [0.001, 0.002, 0.0008], [0.0007, 0.0006, -0.0007]], 1e-3),
    "gyro.scale_nonlinearity": ([0.026, -0.013, 0.018], 1e-3),
    "gyro.scale_asymmetry": ([-0.002, 0.0016, -0.0033], 1e-6),
    "gyro.thermal_bias": ([0.014, -0.037, 0.019], 1e-12),
    "gyro.thermal_scale": ([0.001, 0.0008, -0.0008], 1e-5),
    "gyro.bias_drift": ([0.28, -0.15, 0.23], 1e-12),
    "gyro.bias_step": ([0.13, -0.08, 0.24], 1e-12),
    "gyro.vibration_rectification": ([-1.1, 1.4, -2.2], 1e-12),
    # Central differences: a quarter per cent of a derivative at 2 Hz and 104 Hz.
    "gyro.bandwidth": ([0.004, 0.012, 0.008], 5e-3),
    "timing.axis_skew": ([0.0, 0.008, 0.004], 1e-4),
}
RATE = sorted(STRONG)
FS = 500 * DEG


def smooth(t_s):
    """Rates (N, 3) rad/s of a hand: at rest, six seconds of movement up to some 200 dps and 2 Hz, at rest again.

    Any t_s.  The window is a B-spline of degree 7, six times differentiable.
    """
    window = BSpline.basis_element(np.linspace(2, 8, 9), extrapolate=False)
    waves = np.stack([np.sin(2 * np.pi * f * t_s + p) for f, p in ((0.5, 0.3), (0.9, 1.1), (2.0, 2.0))], axis=-1)
    return 500 * DEG * np.nan_to_num(window(t_s))[:, None] * waves


def movement(odr_hz=104.0, stop_s=10.0):
    t_s = np.arange(0, stop_s, 1 / odr_hz)
    turn = np.stack([np.sin(0.7 * t_s), np.cos(0.7 * t_s) * np.sin(0.4 * t_s), -np.cos(0.7 * t_s) * np.cos(0.4 * t_s)], axis=-1)
    vibration = 0.2 * np.exp(-((t_s - 5) ** 2))
    return Movement(t_s, 1 / odr_hz, smooth(t_s), turn, 25 + 0.8 * t_s, vibration, stop_s, FS, 25.0)


def measured_force(effect, moved, theta):
    """(N, 3) g that an accelerometer with the effect measures; ``bends`` is of what it measures."""
    measured = moved.force_g
    for _ in range(30):
        measured = moved.force_g + effect.bent(replace(moved, force_g=measured)) @ theta / G
    return measured


def theta_of(effect, value=None):
    return np.ravel(STRONG[effect.id][0] if value is None else value) * effect.parameter.si
