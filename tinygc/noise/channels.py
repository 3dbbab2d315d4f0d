"""Goodness of fit of the twin's channels, scatter within stills, the common delay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.base.units import NS
from session.detect.stills import BLOCK_S
from tinygc.effects import CommonDelay, Convention, Effect
from tinygc.models.linear import MATRIX
from tinygc.noise.refit import KNOWN, Refit, prior_sigmas
from tinygc.noise.turn_gravity import TurnGravity, turn_gravity
from tinygc.noise.twin import Twin, claim_slice
from tinygc.noise.whitening import Whitener

# Goodness of fit of each channel on its own.
#
# The fit whitens all channels jointly with one calibration, so a misfit of the closure spreads over the stills.  To locate a mismatch, each
# channel is whitened by its own covariance and gets its own best calibration.

#: sigma of a channel's own E about the common one: a data sheet's tolerance of sensitivity
OWN_E_SIGMA = 0.01


def own_p_values(twin: Twin, whiten: Whitener, fit: Refit) -> dict[str, float]:
    """P-value of each channel with its own best calibration: a test for the place of a mismatch."""
    alone, taken = own_residuals(twin, whiten, fit)
    parts = [(name, part) for name, part in whiten.parts.items() if part.stop > part.start]  # without stills the closure alone
    return {name: _p(twin, alone[part], taken[name], unknown_rows(twin, name)) for name, part in parts}


def own_residuals(twin: Twin, whiten: Whitener, fit: Refit) -> tuple[np.ndarray, dict[str, float]]:
    """Residuals (n,) of each channel on its own, unit variance, and the parameters that each has used up."""
    prior = prior_sigmas(twin, [claim.effect for claim in fit.state.claims])
    prior[MATRIX] = OWN_E_SIGMA
    alone, columns = whiten.by_channel(fit.r), whiten.by_channel(fit.J * prior)
    taken = {}
    for name, part in whiten.parts.items():
        u, size, _ = np.linalg.svd(columns[part], full_matrices=False)
        kept = size**2 / (1 + size**2)
        alone[part] -= (u * kept) @ (u.T @ alone[part])
        taken[name] = float(kept.sum())
    return alone, taken


def unknown_rows(twin: Twin, name: str) -> int:
    """Number of rows of a channel without data: turn angles that no reference observes."""
    return int(np.sum(~twin.batch.known)) if name == "closure" else 0


def _p(twin: Twin, r: np.ndarray, taken: float, unknown: int) -> float:
    """P-value against the measured noise, itself estimated from a finite number of blocks (Fisher's F)."""
    from scipy.special import chdtrc, fdtrc  # not needed by a fit

    freedom, chi_square = max(len(r) - unknown - taken, 1.0), np.sum(r**2)
    if not twin.stills:
        return float(chdtrc(freedom, chi_square))
    noise_freedom = 3 * sum(still.duration_s for _, still in twin.stills) / 0.1 * 0.66
    return float(fdtrc(freedom, noise_freedom, chi_square / freedom))


# Scatter within each still: the prediction is a constant rate with the measured noise, so no slope and the same scatter everywhere.

#: variance of the mean square of first differences of white noise, times the number of differences, in that mean square squared
DIFFERENCES = 3.0


def within_stills(twin: Twin) -> dict[str, np.ndarray]:
    """Test the slope of the rate and the mean square differences of 0.1 s means against the angle random walk of the log: ``slope`` and
    ``scatter`` (Q, 3), recorded minus predicted in sigmas of the noise, for each still and axis; none without stills."""
    if not twin.stills:
        return {}
    slopes, scatters = [], []
    logs = twin.problem.logs
    for log, still in twin.problem.references:
        samples, walk = logs[log].samples, logs[log].noise.angle_random_walk
        rate = samples.gyro[still.start : still.stop]
        t_s = (samples.t_ns[still.start : still.stop] - samples.t_ns[0]) * NS
        from_middle = t_s - t_s.mean()
        slope = from_middle @ rate / (from_middle @ from_middle)
        slopes.append(slope / (walk * np.sqrt(12 / still.duration_s**3)))
        size = max(round(BLOCK_S / samples.period_s), 1)
        count = len(rate) // size
        difference = np.diff(rate[: count * size].reshape(count, size, 3).mean(axis=1), axis=0)
        expected = 2 * walk**2 / (size * samples.period_s)
        ratio = np.mean(difference**2, axis=0) / expected if count > 1 else np.ones(3)
        scatters.append((ratio - 1) / np.sqrt(DIFFERENCES / max(count - 1, 1)))
    return {"slope": np.array(slopes), "scatter": np.array(scatters)}


# A delay common to all axes is not observed by the closure.  It is fixed by convention and by gravity during the turns.

#: grid of a common lag between the estimates from closure and gravity: the cost is a parabola, and the best of nine is within a sixteenth
#: of the distance
LAGS = 9


def in_gauge(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """Fix the parameters that the closure does not observe, as each effect's ``gauge`` declares.

    Some follow a convention (skews of axes are counted from the earliest).  A common delay (sensitivity to angular acceleration, whose
    diagonal is one plus differences) is the delay between gyro and accelerometer; so is that of a lag, as far as the closure permits.
    """
    if not twin.stills:  # with a further reference turns begin and end in motion, so the closure observes a common delay
        return fit if twin.clock is None else _by_the_clock(twin, whiten, fit, twin.clock)
    for number, claim in enumerate(fit.state.claims):
        gauge = claim.effect.gauge_convention
        if isinstance(gauge, Convention):
            fit = _with_theta(twin, whiten, fit, number, gauge.settle(claim.theta))
        elif isinstance(gauge, CommonDelay):
            fit = (_with_possible_lag if gauge.never_negative else _with_common_delay)(twin, whiten, fit, number, gauge)
    return fit


def _by_the_clock(twin: Twin, whiten: Whitener, fit: Refit, offset: Effect) -> Refit:
    """Assign a common delay to the reference's unknown clock offset, from which the data do not separate it.

    An effect keeps the differences between its axes: from their mean, or from the earliest axis if its delays are never negative.  Nothing
    changes if the clock is not among the claims.
    """
    claims, change = list(fit.state.claims), np.eye(len(fit.covariance))
    clock = next((number for number, claim in enumerate(claims) if claim.effect is offset), None)
    if clock is None:
        return fit
    moved = []
    for number, claim in enumerate(claims):
        gauge = claim.effect.gauge_convention
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
    for rows in moved:  # a fixed parameter has no variance; a small one keeps the matrix invertible
        covariance[np.ix_(rows, rows)] += KNOWN**2
    return replace(fit, state=state, r=r, chi_square=float(r @ r), covariance=covariance)


def _with_theta(twin: Twin, whiten: Whitener, fit: Refit, number: int, theta: np.ndarray) -> Refit:
    claims = list(fit.state.claims)
    claims[number] = replace(claims[number], theta=theta)
    state = replace(fit.state, claims=tuple(claims))
    r = whiten(twin.residuals(state).stacked())
    return replace(fit, state=state, r=r, chi_square=float(r @ r))


def _with_common_delay(twin: Twin, whiten: Whitener, fit: Refit, number: int, gauge: CommonDelay) -> Refit:
    """Set the common delay from gravity: a gyro late by s measures omega - s d omega/dt."""
    gravity = turn_gravity(twin, fit)
    fit = _with_theta(twin, whiten, fit, number, _moved(fit.state.claims[number].theta, gauge, gravity.offset_s))
    return replace(fit, covariance=_common_from_gravity(fit, number, gauge, gravity))


def _moved(theta: np.ndarray, gauge: CommonDelay, by_s: float) -> np.ndarray:
    """theta (P,) with all axes delayed by ``by_s`` seconds."""
    theta = theta.copy()
    theta[list(gauge.delays)] += gauge.late * by_s
    return theta


def _with_possible_lag(twin: Twin, whiten: Whitener, fit: Refit, number: int, gauge: CommonDelay) -> Refit:
    """Constrain a common lag, which is never negative.

    The closure depends only on its square, so it does not determine the sign, and a small misfit permits a large lag.  If the lag is
    negative or contradicts gravity, it moves to the best joint fit of closure and gravity.
    """
    gravity = turn_gravity(twin, fit)
    theta, entries = fit.state.claims[number].theta, list(gauge.delays)
    if not gravity.is_offset and (gauge.late * theta[entries]).min() >= 0:
        return fit
    sigma = gravity.whole_sigma_s
    found = []
    for share in np.linspace(0, 1, LAGS):
        moved = _moved(theta, gauge, share * gravity.offset_s)
        earliest = min((gauge.late * moved[entries]).min(), 0.0)
        there = _with_theta(twin, whiten, fit, number, _moved(moved, gauge, -earliest))
        found.append((there.r @ there.r + ((1 - share) * gravity.offset_s / sigma) ** 2, there))
    _, best = min(found, key=lambda pair: pair[0])
    return replace(best, covariance=_common_from_gravity(fit, number, gauge, gravity))


def _common_from_gravity(fit: Refit, number: int, gauge: CommonDelay, gravity: TurnGravity) -> np.ndarray:
    """The covariance with the mean of these entries taken from gravity."""
    rows = np.add(gauge.delays, claim_slice(fit.state.claims, number).start)
    change = np.eye(len(fit.covariance))
    change[np.ix_(rows, rows)] -= 1 / 3
    covariance = change @ fit.covariance @ change.T
    covariance[np.ix_(rows, rows)] += gravity.whole_sigma_s**2
    return covariance
