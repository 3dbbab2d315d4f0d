"""What a picture of an explanation shows: the mismatch along the variable that it follows, and what the named effect says of it."""

from __future__ import annotations

import numpy as np

from session.units import DEG
from tinygc.explain.explain import Claimed, Explanation
from tinygc.explain.twin import Twin


def told(e: Explanation) -> Claimed | None:
    """The strongest effect that adds to the rates, which is what can be drawn against a variable."""
    return next((claim for claim in [*e.claimed, *e.findings] if claim.effect.kind == "rate"), None)


def rates_per_still(e: Explanation) -> tuple[np.ndarray, np.ndarray]:
    """Residual rates (Q, 3) dps in the stills, before and after."""
    twin = e.twin
    before = twin.residuals(e.naming.first.state, e.naming.first.rates).still / DEG
    after = twin.residuals(e.naming.fit.state, e.naming.fit.rates).still / DEG
    return before, after


def added_in_stills(twin: Twin, claim: Claimed, rates: list[np.ndarray]) -> np.ndarray:
    """(Q, 3) dps that the effect adds to each still's mean rate."""
    name, parameter = claim.effect.parameter.name, claim.effect.parameter
    theta = np.ravel(claim.parameters[name]) * parameter.si
    by_log = [claim.effect.columns(m.with_rate(rate)) @ theta for m, rate in zip(twin.movements, rates, strict=True)]
    return np.array([by_log[log][still.start : still.stop].mean(axis=0) for log, still in twin.stills]) / DEG


def still_variable(twin: Twin, variable: str) -> np.ndarray:
    """(Q,) temperature °C, attitude (g along z) or time s of each still."""
    pick = {
        "temperature": lambda m, s: m.temp_c[s.start : s.stop].mean(),
        "attitude": lambda m, s: -s.accel_mean[2] / s.gravity_mps2,
    }.get(variable, lambda m, s: m.t_s[s.start])
    return np.array([pick(twin.movements[log], still) for log, still in twin.stills])


def segment_peak(twin: Twin, variable: str) -> np.ndarray:
    """(S,) greatest value of a variable in each segment of the twin."""
    read = {
        "rate": lambda m: np.abs(m.rate).max(axis=1) / DEG,
        "angular acceleration": lambda m: np.abs(m.acceleration).max(axis=1),
        "vibration": lambda m: m.vibration_g2,
        "temperature": lambda m: m.temp_c,
    }.get(variable, lambda m: m.t_s)
    values = [read(movement) for movement in twin.movements]
    return np.array([values[s.log][s.start : s.stop].max() for s in twin.segments])
