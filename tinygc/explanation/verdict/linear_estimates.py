"""What a session says of every effect of the catalogue, named or not, as a lot pools it (docs/lots.md).

An effect that is weak in each of many units is named in none of them; the estimate is there all the same.  It is that of the effect's
columns beside the calibration and the other names, linear around the fit: no selection, so that many of them average to the truth.
"""

from __future__ import annotations

import numpy as np

from tinygc.effects import Effect, catalogue
from tinygc.explanation.naming.candidates import candidates
from tinygc.explanation.naming.linear_estimate import WIDE, component_names, linear_estimate, without_claim
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.verdict.explain import Explanation
from tinygc.lot.unit_result import Weighed

#: of that prior's sigma, above which a number is not told
SEEN = 0.3
CLOCKS = "timing.gyro_accel_offset"


def effects_of(explanation: Explanation) -> dict[str, Weighed]:
    """Effect id -> what this session says of it, SI; NaN for numbers that it does not tell.

    What is mended before any fit (lost samples, glitches) has no columns and is not among them.  Delays are told by what the axes differ
    by.  An effect whose shape is searched for (the moment of a step) is taken in the middle of what is tried: where it takes up most its
    estimate would be a chosen one.  The delay between gyro and accelerometer is what is beyond the filters' own.  chi_square is that of
    all its numbers together.
    """
    twin, fit, whiten = explanation.twin, explanation.naming.fit, explanation.whiten
    claims = {claim.effect.id: number for number, claim in enumerate(fit.state.claims)}
    chances = {each.id: each.probability for each in explanation.considered}
    chances |= {claim.effect.id: claim.probability for claim in explanation.claimed}
    replay, found = Replay(twin, fit), dict[str, Weighed]()
    forms: dict[str, list[Effect]] = {}
    for effect in candidates(twin):
        forms.setdefault(effect.id, []).append(effect)
    for name, shapes in forms.items():
        effect = shapes[0] if shapes[0].scan is None else shapes[len(shapes) // 2]
        beside = fit if name not in claims else without_claim(fit, claims[name])
        columns = whiten(replay.columns(effect).stacked())
        theta, covariance = linear_estimate(beside.r, beside.J, columns, effect.parameter.plausible)
        told = _told(effect)
        theta, covariance = told @ theta, told @ covariance @ told.T
        chi_square = float(theta @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ theta)
        sigma = np.sqrt(np.diag(covariance))
        unseen = sigma > SEEN * WIDE * effect.parameter.plausible
        theta, sigma = np.where(unseen, np.nan, theta), np.where(unseen, np.nan, sigma)
        found[name] = _weighed(effect, theta, sigma, chi_square, name in claims, chances.get(name))
    gravity, clocks = explanation.gravity, catalogue().get(CLOCKS)
    if clocks is not None and np.isfinite(gravity.offset_s) and np.isfinite(gravity.sigma_s) and gravity.sigma_s > 0:
        beyond = np.sign(gravity.offset_s) * max(abs(gravity.offset_s) - gravity.bar_s, 0.0)
        offset, sigma = np.array([beyond]), np.array([gravity.sigma_s])
        named = any(claim.effect.id == CLOCKS for claim in explanation.claimed)
        found[CLOCKS] = _weighed(clocks, offset, sigma, float((offset / sigma)[0] ** 2), named, chances.get(CLOCKS))
    return found


def _told(effect: Effect) -> np.ndarray:
    """(P, P): the projection on what a closure tells of theta: of delays, what the axes differ by, not what they share."""
    told = np.eye(effect.parameter.size)
    if effect.gauge is not None and effect.gauge.delays:
        told[np.ix_(effect.gauge.delays, effect.gauge.delays)] -= 1 / len(effect.gauge.delays)
    return told


def _weighed(effect: Effect, theta: np.ndarray, sigma: np.ndarray, chi_square: float, named: bool, probability: float | None) -> Weighed:
    names = component_names(effect)
    values, sigmas = (dict(zip(names, map(float, each), strict=True)) for each in (theta, sigma))
    return Weighed(values, sigmas, chi_square, named, probability)
