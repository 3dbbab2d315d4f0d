"""The units' specific force as one: turned by their mountings, moved to one point, averaged.

    f_0 = R_i f_i - (domega/dt x r_i + omega x (omega x r_i))

r_i is the unit's position from the first unit's accelerometer, omega the fused rate, its derivative the central difference.  Where a
unit's position is not known its lever arm is left out, and that is said.
"""

from __future__ import annotations

import numpy as np

from tinygc.array.fused.model import ArrayModel


def fused_force(model: ArrayModel, force: np.ndarray, rate: np.ndarray, change: np.ndarray, used: np.ndarray) -> np.ndarray:
    """(T, 3) m/s^2 in the array's frame, at the first unit's accelerometer where positions are known.

    force (T, N, 3) m/s^2 calibrated, in each unit's body frame, NaN for none; rate (T, 3) rad/s, change (T, 3) rad/s^2 of the array; used
    (T, N): units that are believed.  NaN where none of these has one.
    """
    mountings = np.stack([unit.place.mounting for unit in model.units])
    turned = np.einsum("nij,tnj->tni", mountings, force)
    for i, unit in enumerate(model.units):
        if (at := unit.place.position_m) is not None:
            turned[:, i] -= np.cross(change, at) + np.cross(rate, np.cross(rate, at))
    weights = force_weights(model)
    share = np.where(used & np.isfinite(turned).all(axis=2), weights, 0.0)
    total = share.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.einsum("tn,tni->ti", share, np.nan_to_num(turned)) / np.where(total > 0, total, np.nan)[:, None]


def force_weights(model: ArrayModel) -> np.ndarray:
    """(N,): 1 over the squared noise density where every calibrated accelerometer's is known, else 1; 0 of what is not calibrated."""
    there = np.array([unit.accelerometer is not None for unit in model.units])
    noise = [unit.accel_noise_density for unit in model.units]
    if all(value is not None for value, use in zip(noise, there, strict=True) if use):
        return np.array([1 / value**2 if use and value else 0.0 for value, use in zip(noise, there, strict=True)])
    return there.astype(float)
