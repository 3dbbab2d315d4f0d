"""What the closure cannot fix: a delay that all axes share.  Convention and gravity during the turns fix it instead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tinygc.effects import CommonDelay, Convention
from tinygc.explanation.twin.layout import claim_slice
from tinygc.explanation.twin.refit import KNOWN, Refit
from tinygc.explanation.twin.turn_gravity import TurnGravity, turn_gravity
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener

#: values of a common lag that are tried between what the closure and what gravity says: the cost is a parabola, and the best of nine is
#: within a sixteenth of the way
LAGS = 9


def in_gauge(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """The same fit with what the closure cannot fix put where it belongs, as each effect's ``gauge`` declares.

    A convention settles it (skewed axes are counted from the earliest).  A common delay (sensitivity to angular acceleration, whose
    diagonal is one plus differences) is the delay between gyro and accelerometer; that of a lag, as far as the closure lets it.
    """
    if not twin.stills:  # between moments of truth, where turns begin and end in motion, the closure sees a common delay
        return _by_the_clock(twin, whiten, fit) if twin.clock_free else fit
    for number, claim in enumerate(fit.state.claims):
        gauge = claim.effect.gauge
        if isinstance(gauge, Convention):
            fit = _with_theta(twin, whiten, fit, number, gauge.settle(claim.theta))
        elif isinstance(gauge, CommonDelay):
            fit = (_with_possible_lag if gauge.never_negative else _with_common_delay)(twin, whiten, fit, number, gauge)
    return fit


def _by_the_clock(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """A delay that all axes share, and a truth whose clock nobody has given, are one column: the clock has it.

    An effect keeps what its axes differ by: about their mean, or from the earliest of them where a delay is never negative.  Where the
    clock is not among the claims, nothing is moved.
    """
    claims, change = list(fit.state.claims), np.eye(len(fit.covariance))
    clock = next((number for number, claim in enumerate(claims) if claim.effect.kind == "truth"), None)
    if clock is None:
        return fit
    moved = []
    for number, claim in enumerate(claims):
        gauge = claim.effect.gauge
        if gauge is None or not gauge.delays:
            continue
        entries, late = list(gauge.delays), gauge.late if isinstance(gauge, CommonDelay) else 1.0
        earliest = isinstance(gauge, Convention) or gauge.never_negative
        share = np.eye(3)[int(np.argmin(late * claim.theta[entries]))] if earliest else np.full(3, 1 / 3)
        common, theta = float(share @ claim.theta[entries]), claim.theta.copy()
        theta[entries] -= common
        claims[number] = replace(claim, theta=theta)
        rows = np.add(entries, claim_slice(fit.state.claims, number).start)
        change[np.ix_(rows, rows)] -= share
        moved.append(rows)
        claims[clock] = replace(claims[clock], theta=claims[clock].theta + late * common)
        change[claim_slice(fit.state.claims, clock).start, rows] += late * share
    if not moved:
        return fit
    state = replace(fit.state, claims=tuple(claims))
    r = whiten(twin.residuals(state).stacked())
    covariance = change @ fit.covariance @ change.T
    for rows in moved:  # what is settled has no sigma of its own; a little keeps the matrix one that can be inverted
        covariance[np.ix_(rows, rows)] += KNOWN**2
    return replace(fit, state=state, r=r, chi_square=float(r @ r), covariance=covariance)


def _with_theta(twin: Twin, whiten: Whitener, fit: Refit, number: int, theta: np.ndarray) -> Refit:
    claims = list(fit.state.claims)
    claims[number] = replace(claims[number], theta=theta)
    state = replace(fit.state, claims=tuple(claims))
    r = whiten(twin.residuals(state).stacked())
    return replace(fit, state=state, r=r, chi_square=float(r @ r))


def _with_common_delay(twin: Twin, whiten: Whitener, fit: Refit, number: int, gauge: CommonDelay) -> Refit:
    """A gyro that is late by s shows omega - s d omega/dt."""
    gravity = turn_gravity(twin, fit)
    fit = _with_theta(twin, whiten, fit, number, _moved(fit.state.claims[number].theta, gauge, gravity.offset_s))
    return replace(fit, covariance=_common_from_gravity(fit, number, gauge, gravity))


def _moved(theta: np.ndarray, gauge: CommonDelay, by_s: float) -> np.ndarray:
    """theta (P,) with its axes later by so many seconds."""
    theta = theta.copy()
    theta[list(gauge.delays)] += gauge.late * by_s
    return theta


def _with_possible_lag(twin: Twin, whiten: Whitener, fit: Refit, number: int, gauge: CommonDelay) -> Refit:
    """A lag is never negative.  What all axes share of it shows in the closure by its square alone: the closure does not tell its sign, and
    a small misfit leaves room for a large lag.  Where it is negative, or gravity contradicts it, it goes to where closure and gravity
    together have least against it."""
    gravity = turn_gravity(twin, fit)
    theta, entries = fit.state.claims[number].theta, list(gauge.delays)
    if not gravity.is_offset and (gauge.late * theta[entries]).min() >= 0:
        return fit
    sigma = np.hypot(gravity.sigma_s, gravity.bar_s / 3)
    found = []
    for share in np.linspace(0, 1, LAGS):
        moved = _moved(theta, gauge, share * gravity.offset_s)
        earliest = min((gauge.late * moved[entries]).min(), 0.0)
        there = _with_theta(twin, whiten, fit, number, _moved(moved, gauge, -earliest))
        found.append((there.r @ there.r + ((1 - share) * gravity.offset_s / sigma) ** 2, there))
    _, best = min(found, key=lambda pair: pair[0])
    return replace(best, covariance=_common_from_gravity(fit, number, gauge, gravity))


def _common_from_gravity(fit: Refit, number: int, gauge: CommonDelay, gravity: TurnGravity) -> np.ndarray:
    """The covariance with these entries' mean taken from gravity."""
    rows = np.add(gauge.delays, claim_slice(fit.state.claims, number).start)
    change = np.eye(len(fit.covariance))
    change[np.ix_(rows, rows)] -= 1 / 3
    covariance = change @ fit.covariance @ change.T
    # The filters' own relative delay is within the bar; three sigmas of it.
    covariance[np.ix_(rows, rows)] += gravity.sigma_s**2 + (gravity.bar_s / 3) ** 2
    return covariance
