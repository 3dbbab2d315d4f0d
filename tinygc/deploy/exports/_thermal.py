"""A zero over temperature as PX4 and ArduPilot hold it: a cubic about a temperature of theirs, and no lag."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial

from session.common.units import DEG
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._linear import LinearPart
from tinygc.models.thermal import ThermalModel

#: highest power that they have
CUBIC = 3
#: dps: a lag whose loss in a change of 1 degC a minute is below this is not worth a word
WORTH_DPS = 1e-4


def cubic_about(terms: np.ndarray, reference_c: float, range_c: tuple[float, float], about_c: float) -> tuple[np.ndarray, float]:
    """(4, 3) terms per degC^n about another temperature, from terms (n, 3) about ``reference_c``; and the largest that is lost.

    Exact up to the third order; beyond it the cubic that is nearest, all temperatures of the range alike.
    """
    out, lost = np.zeros((CUBIC + 1, 3)), 0.0
    at = np.linspace(*range_c, 201)
    for axis in range(3):
        own = Polynomial(terms[:, axis])
        near = own if own.trim().degree() <= CUBIC else Polynomial.fit(at - reference_c, own(at - reference_c), CUBIC).convert()
        lost = max(lost, float(np.abs(near(at - reference_c) - own(at - reference_c)).max()))
        moved = near(Polynomial([about_c - reference_c, 1.0])).coef
        out[: len(moved), axis] = moved
    return out, lost


def part_at_reference(model: ThermalModel) -> LinearPart:
    """The linear model at the reference temperature."""
    linear = model.at(model.reference_c)
    return LinearPart(linear.E, linear.B, np.zeros((3, 3)), np.zeros(3), model.reference_c)


def say_lost(model: ThermalModel, context: Context, name: str, lost_rps: float) -> None:
    """What the format cannot carry, to the operator."""
    full_scale = context.config.sensor.gyro_fs_dps
    E = model.E(np.array(model.range_c))
    lost = np.abs(E - np.eye(3)).sum(axis=2).max()
    if lost > 0:  # of rest logs alone nothing of E is known
        context.say(
            f"{name} carries the zero over temperature only, no scale and no misalignment: up to {100 * lost:.2f} % of the rate, "
            f"{lost * full_scale:.2g} dps at {full_scale:g} dps, stays uncorrected"
        )
    if lost_rps > 0:
        context.say(f"{name} has no power beyond the third: the nearest cubic is off by up to {lost_rps / DEG:.2g} dps")
    slope = np.abs(model.zero_terms[1]) if len(model.zero_terms) > 1 else np.zeros(3)
    behind = float(np.max(np.abs(model.lag_s) * slope)) / 60 / DEG
    if behind > WORTH_DPS:
        lags = ", ".join(f"{lag:.0f}" for lag in model.lag_s)
        context.say(
            f"{name} has no lag ({lags} s): while the temperature changes by 1 °C a minute the zero is off by up to {behind:.2g} dps"
        )


def accel_change(context: Context) -> np.ndarray | None:
    """(n + 1, 3) m/s^2 per degC^n about the reference, what rest logs told of the accelerometer; None where they did not."""
    change = context.table.get("accel_change_mps2")
    terms = np.asarray(change, dtype=float) if change else np.zeros((0, 3))
    return np.vstack([np.zeros(3), terms]) if terms.size and terms.ndim == 2 else None
