"""What the closure cannot fix: a delay that all axes share.  Convention and gravity during the turns fix it instead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tinygc.explain.twin.refit import Refit
from tinygc.explain.twin.turn_gravity import TurnGravity, turn_gravity
from tinygc.explain.twin.twin import Twin
from tinygc.explain.twin.whitening import Whitener

_DIAGONAL = [0, 4, 8]
#: values of a common lag that are tried between what the closure and what gravity says: the cost is a parabola, and the best of nine is
#: within a sixteenth of the way
LAGS = 9


def in_gauge(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """The same fit with its common delay put where it belongs.

    Skewed axes are counted from the earliest.  Sensitivity to angular acceleration, whose diagonal is a common delay plus
    differences, takes the delay between gyro and accelerometer for the common part.  So does a lag, as far as the closure lets it.
    """
    for number, claim in enumerate(fit.state.claims):
        if claim.effect.id == "timing.axis_skew":
            fit = _with_theta(twin, whiten, fit, number, claim.theta - claim.theta.min())
        if claim.effect.id == "gyro.angular_acceleration":
            fit = _with_common_delay(twin, whiten, fit, number)
        if claim.effect.id == "gyro.bandwidth":
            fit = _with_possible_lag(twin, whiten, fit, number)
    return fit


def _with_theta(twin: Twin, whiten: Whitener, fit: Refit, number: int, theta: np.ndarray) -> Refit:
    claims = list(fit.state.claims)
    claims[number] = replace(claims[number], theta=theta)
    state = replace(fit.state, claims=tuple(claims))
    rates = twin.rates(state)
    r = whiten(twin.residuals(state, rates).stacked())
    return replace(fit, state=state, rates=rates, r=r, chi_square=float(r @ r))


def _with_common_delay(twin: Twin, whiten: Whitener, fit: Refit, number: int) -> Refit:
    """A gyro that is late by s shows omega - s d omega/dt."""
    gravity = turn_gravity(twin, fit)
    theta = fit.state.claims[number].theta.copy()
    theta[_DIAGONAL] -= gravity.offset_s
    fit = _with_theta(twin, whiten, fit, number, theta)
    return replace(fit, covariance=_common_from_gravity(fit, number, _DIAGONAL, gravity))


def _with_possible_lag(twin: Twin, whiten: Whitener, fit: Refit, number: int) -> Refit:
    """A lag is never negative, and what all axes share of it shows in the closure by its square alone: both signs fit, and little is a
    lot.  Where it is negative, or gravity contradicts it, it goes to where closure and gravity together have least against it."""
    gravity = turn_gravity(twin, fit)
    theta = fit.state.claims[number].theta
    if not gravity.is_offset and theta.min() >= 0:
        return fit
    sigma = np.hypot(gravity.sigma_s, gravity.bar_s / 3)
    found = []
    for share in np.linspace(0, 1, LAGS):
        moved = theta + share * gravity.offset_s
        there = _with_theta(twin, whiten, fit, number, moved - min(moved.min(), 0.0))
        found.append((there.r @ there.r + ((1 - share) * gravity.offset_s / sigma) ** 2, there))
    _, best = min(found, key=lambda pair: pair[0])
    return replace(best, covariance=_common_from_gravity(fit, number, [0, 1, 2], gravity))


def _common_from_gravity(fit: Refit, number: int, entries: list[int], gravity: TurnGravity) -> np.ndarray:
    """The covariance with these entries' mean taken from gravity."""
    at = 15 + sum(len(claim.theta) for claim in fit.state.claims[:number])
    rows = np.add(entries, at)
    change = np.eye(len(fit.covariance))
    change[np.ix_(rows, rows)] -= 1 / 3
    covariance = change @ fit.covariance @ change.T
    # The filters' own relative delay is within the bar; three sigmas of it.
    covariance[np.ix_(rows, rows)] += gravity.sigma_s**2 + (gravity.bar_s / 3) ** 2
    return covariance
