"""What a session says of every effect of the catalogue, named or not, as a lot pools it (docs/lots.md).

An effect that is weak in each of many units is named in none of them; the estimate is there all the same.  It is that of the effect's
columns beside the calibration and the other names, linear around the fit: no selection, so that many of them average to the truth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tinygc.effects import Effect, catalogue
from tinygc.explanation.naming.candidates import candidates
from tinygc.explanation.twin.layout import claim_slice
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.verdict.explain import Explanation
from tinygc.lot.unit_result import Weighed

#: of an effect's plausible size: the sigma of the prior that only keeps what no channel sees finite.  At ten it pulls a number that is
#: known to a tenth of the plausible by one in ten thousand
WIDE = 10.0
CLOCKS = "timing.gyro_accel_offset"


def component_names(effect: Effect) -> tuple[str, ...]:
    """Of the numbers of an effect's parameter: ``value``; ``x``, ``y``, ``z``; ``xx``, ``xy``, … row by row; else their numbers."""
    shape = effect.parameter.shape
    if not shape:
        return ("value",)
    if shape == (3,):
        return tuple("xyz")
    if shape == (3, 3):
        return tuple(row + column for row in "xyz" for column in "xyz")
    return tuple(str(number) for number in range(effect.parameter.size))


def effects_of(explanation: Explanation) -> dict[str, Weighed]:
    """Effect id -> what this session says of it, SI; numbers that it does not tell have a sigma of ten times what is plausible.

    What is mended before any fit (lost samples, glitches) has no columns and is not among them.  Delays are told by what
    the axes differ by.  An effect that is searched for on a grid stands where it takes up most, so that its estimate is a chosen one.
    chi_square is that of all its numbers together.
    """
    twin, fit, whiten = explanation.twin, explanation.naming.fit, explanation.whiten
    claims = {claim.effect.id: number for number, claim in enumerate(fit.state.claims)}
    chances = {each.id: each.probability for each in explanation.considered}
    chances |= {claim.effect.id: claim.probability for claim in explanation.claimed}
    replay, found = Replay(twin, fit), dict[str, Weighed]()
    for effect in candidates(twin):
        if effect.id in found and effect.scan is None:
            continue  # another form of it: the first is the one that its numbers are named for
        beside = fit if effect.id not in claims else _without(fit, claims[effect.id])
        columns = whiten(replay.columns(effect).stacked())
        theta, covariance = linear_estimate(beside.r, beside.J, columns, effect.parameter.plausible)
        told = _told(effect)
        theta, covariance = told @ theta, told @ covariance @ told.T
        chi_square = float(theta @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ theta)
        if effect.id in found and found[effect.id].chi_square >= chi_square:
            continue
        found[effect.id] = _weighed(effect, theta, np.sqrt(np.diag(covariance)), chi_square, effect.id in claims, chances.get(effect.id))
    gravity, clocks = explanation.gravity, catalogue().get(CLOCKS)
    if clocks is not None and np.isfinite(gravity.offset_s) and np.isfinite(gravity.sigma_s) and gravity.sigma_s > 0:
        offset, sigma = np.array([gravity.offset_s]), np.array([np.hypot(gravity.sigma_s, gravity.bar_s / 3)])
        named = any(claim.effect.id == CLOCKS for claim in explanation.claimed)
        found[CLOCKS] = _weighed(clocks, offset, sigma, float((offset / sigma)[0] ** 2), named, chances.get(CLOCKS))
    return found


def linear_estimate(r: np.ndarray, J: np.ndarray, columns: np.ndarray, plausible: float) -> tuple[np.ndarray, np.ndarray]:
    """theta (P,) and its covariance (P, P) from whitened residuals r (n,), the columns J (n, p) of what is fitted beside it, and its own
    (n, P): r + columns theta is what is left."""
    q, _ = np.linalg.qr(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300))
    own = columns - q @ (q.T @ columns)
    covariance = np.linalg.inv(own.T @ own + np.eye(own.shape[1]) / (WIDE * plausible) ** 2)
    return -covariance @ (own.T @ r), covariance


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


def _without(fit: Refit, number: int) -> Refit:
    """The fit as if a claim had not been made, to first order."""
    part = claim_slice(fit.state.claims, number)
    return replace(fit, r=fit.r - fit.J[:, part] @ fit.state.claims[number].theta, J=np.delete(fit.J, part, axis=1))
