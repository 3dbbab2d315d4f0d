"""Goodness of fit of the twin's channels, scatter within stills, gravity during turns, the common delay."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.io.units import NS
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.uncertainty import signed_ranks_above
from tinygc.effects import CommonDelay, Convention
from tinygc.models.linear import MATRIX
from tinygc.noise.refit import KNOWN, Refit, prior_sigmas
from tinygc.noise.twin import Twin, claim_slice
from tinygc.noise.whitening import Whitener

# Goodness of fit of each channel, jointly and on its own.
#
# The fit whitens all channels jointly with one calibration, so a misfit of the closure spreads over the stills.  To locate a mismatch, each
# channel is whitened by its own covariance and gets its own best calibration.

#: sigma of a channel's own E about the common one: a data sheet's tolerance of sensitivity
OWN_E_SIGMA = 0.01


def channel_p_values(twin: Twin, whiten: Whitener, r: np.ndarray, nuisance: np.ndarray) -> dict[str, float]:
    """P-value of each channel under the common calibration: a test for any mismatch.

    r (n,), nuisance (n, p): jointly whitened, as in a ``Refit``.
    """
    q, _ = np.linalg.qr(nuisance / np.linalg.norm(nuisance, axis=0))
    taken = np.sum(q**2, axis=1)
    return {name: _p(twin, r[part], taken[part].sum(), unknown_rows(twin, name)) for name, part in whiten.parts.items()}


def own_p_values(twin: Twin, whiten: Whitener, fit: Refit) -> dict[str, float]:
    """P-value of each channel with its own best calibration: a test for the place of a mismatch."""
    alone, taken = own_residuals(twin, whiten, fit)
    return {name: _p(twin, alone[part], taken[name], unknown_rows(twin, name)) for name, part in whiten.parts.items()}


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
    from scipy.special import fdtrc  # not needed by a fit

    noise_freedom = 3 * sum(still.duration_s for _, still in twin.stills) / 0.1 * 0.66
    freedom = max(len(r) - unknown - taken, 1.0)
    return float(fdtrc(freedom, noise_freedom, np.sum(r**2) / freedom))


def bonferroni(p: dict[str, float]) -> float:
    """Combine p-values by Bonferroni's correction of the smallest."""
    return min(1.0, len(p) * min(p.values()))


# Scatter within each still: the prediction is a constant rate with the measured noise, so no slope and the same scatter everywhere.

#: s: longer than the response of a gyro's low-pass of 10 Hz or more, short enough for ten blocks in a still; as in ``session.detect``
WITHIN_BLOCK_S = 0.1
#: variance of the mean square of first differences of white noise, times the number of differences, in that mean square squared
DIFFERENCES = 3.0


@dataclass(frozen=True, eq=False)
class WithinStills:
    """Slope and scatter (Q, 3): recorded minus predicted in sigmas of the noise, for each still and axis."""

    slope: np.ndarray
    scatter: np.ndarray

    def rms(self, name: str) -> float:
        """Root mean square of ``slope`` or ``scatter``, in sigmas."""
        return float(np.sqrt(np.mean(getattr(self, name) ** 2)))


def within_stills(twin: Twin) -> WithinStills:
    """Test the slope of the rate and the mean square differences of 0.1 s means against the angle random walk of the log."""
    slopes, scatters = [], []
    logs = twin.problem.logs
    as_recorded = [(log, still) for log in range(len(logs)) for still in logs[log].stills if still.problem is None and twin.stills]
    for log, still in as_recorded:
        samples, walk = logs[log].samples, logs[log].noise.angle_random_walk
        rate = samples.gyro[still.start : still.stop]
        t_s = (samples.t_ns[still.start : still.stop] - samples.t_ns[0]) * NS
        from_middle = t_s - t_s.mean()
        slope = from_middle @ rate / (from_middle @ from_middle)
        slopes.append(slope / (walk * np.sqrt(12 / still.duration_s**3)))
        size = max(round(WITHIN_BLOCK_S / samples.period_s), 1)
        count = len(rate) // size
        difference = np.diff(rate[: count * size].reshape(count, size, 3).mean(axis=1), axis=0)
        expected = 2 * walk**2 / (size * samples.period_s)
        ratio = np.mean(difference**2, axis=0) / expected if count > 1 else np.ones(3)
        scatters.append((ratio - 1) / np.sqrt(DIFFERENCES / max(count - 1, 1)))
    return WithinStills(np.array(slopes), np.array(scatters))


# Gravity during the turns: the gyro's prediction of the accelerometer, with a fitted lever arm.
#
#     f(t) = -g R_bt(t) e_down + [alpha x] r + [omega x]^2 r,   read `offset` later by the accelerometer
#
# The difference is linear in lever arm r and offset.  Their sigmas come from the scatter between segments, because the hand shakes the
# table by far more than the sensors' noise.

#: s, length of a row: at 200 dps gravity rotates by 5 degrees within one
BLOCK_S = 0.025
#: samples by which the sensors' filters may delay gyro and accelerometer differently
FILTERS_PERIODS = 0.5
#: sigmas with a false-alarm rate of 1e-5 for a sandwich estimate over some 40 segments (Student's tails)
SIGMAS = 5.0
#: largest p-value of the held-out improvement, as for every claim
BORNE_OUT_P = 0.05


@dataclass(frozen=True, eq=False)
class TurnGravity:
    """Fit of gravity during turns.

    lever_m (3,); offset_s, positive if the gyro is late; sigma_s; rms of the difference before and after, m/s^2; bar_s; number of turns;
    held_out_p: p-value of the offset's improvement of held-out turns (Wilcoxon signed-rank test).
    """

    lever_m: np.ndarray
    offset_s: float
    sigma_s: float
    before_mps2: float
    after_mps2: float
    bar_s: float
    turns: int
    held_out_p: float

    @property
    def is_offset(self) -> bool:
        """Whether the offset between the two clocks is significant."""
        return abs(self.offset_s) > self.bar_s and self.held_out_p < BORNE_OUT_P


@dataclass(frozen=True, eq=False)
class TurnEquations:
    """Normal equations of lever arm and offset per turn: normal (S, 4, 4), right (S, 4), square (S,) sum of squares, count (S,) values."""

    normal: np.ndarray
    right: np.ndarray
    square: np.ndarray
    count: np.ndarray

    def solve(self) -> np.ndarray:
        """Solve for lever arm, m, and offset, s, as (4,)."""
        return np.linalg.solve(self.normal.sum(axis=0), self.right.sum(axis=0))

    def left(self, solution: np.ndarray) -> np.ndarray:
        """(S,) residual sum of squares of each turn under a solution."""
        left = self.square - 2 * self.right @ solution + np.einsum("sij,i,j->s", self.normal, solution, solution)
        return np.maximum(left, 0.0)

    def improvement_p(self) -> float:
        """P-value of the offset's improvement of each turn, with lever arm and offset fitted to all others."""
        normal, right = self.normal.sum(axis=0) - self.normal, self.right.sum(axis=0) - self.right
        arm = np.einsum("sij,sj->si", np.linalg.pinv(normal[:, :3, :3], hermitian=True), right[:, :3])
        both = np.einsum("sij,sj->si", np.linalg.pinv(normal, hermitian=True), right)
        gains = self._left_each(np.pad(arm, ((0, 0), (0, 1)))) - self._left_each(both)
        return signed_ranks_above(gains) if len(gains) > 1 else 1.0

    def _left_each(self, solutions: np.ndarray) -> np.ndarray:
        """(S,) residual sum of squares of each turn under its own solution (S, 4)."""
        squares = np.einsum("sij,si,sj->s", self.normal, solutions, solutions)
        return self.square - 2 * np.einsum("si,si->s", self.right, solutions) + squares

    def square_at(self, offset_s: float) -> np.ndarray:
        """(S,) residual sum of squares with a given offset and the lever arm fitted."""
        arm = self.normal.sum(axis=0)[:3]
        lever = np.linalg.solve(arm[:, :3], self.right.sum(axis=0)[:3] - offset_s * arm[:, 3])
        return self.left(np.append(lever, offset_s))


def turn_equations(twin: Twin, fit: Refit) -> TurnEquations:
    """Build the normal equations of lever arm and offset from gravity during the turns."""
    state = fit.state
    batch = twin.batch_at(state)
    padded = twin.padded(twin.rates(state))
    turn = rotation.matrix(closure.attitudes(batch, padded))
    normal, right, square, count = [], [], [], []
    for i, segment in enumerate(twin.segments):
        samples = twin.seen.logs[segment.log].samples
        length, dt = segment.stop - segment.start, samples.period_s
        omega = padded[i, :length] - batch.earth[i, :length]
        alpha = np.gradient(omega, dt, axis=0)
        gravity = -state.gravity_mps2 * turn[i, :length, 2, :]
        arm = _cross_matrix(alpha) + _cross_matrix(omega) @ _cross_matrix(omega)
        columns = np.concatenate([arm, np.gradient(gravity, dt, axis=0)[:, :, None]], axis=-1)
        size = max(1, round(BLOCK_S / dt))
        blocks = length // size
        columns = columns[: blocks * size].reshape(blocks, size, 3, 4).mean(axis=1).reshape(-1, 4)
        force = twin.freed(state, twin.movements[segment.log].part(slice(segment.start, segment.stop)))
        value = (force - gravity)[: blocks * size]
        value = value.reshape(blocks, size, 3).mean(axis=1).ravel()
        normal.append(columns.T @ columns)
        right.append(columns.T @ value)
        square.append(float(value @ value))
        count.append(len(value))
    return TurnEquations(np.array(normal), np.array(right), np.array(square), np.array(count))


def turn_gravity(twin: Twin, fit: Refit) -> TurnGravity:
    """Fit lever arm and offset to all turns."""
    equations = turn_equations(twin, fit)
    solution = equations.solve()
    # Sandwich over the segments, in which the hand shakes independently.
    score = equations.right - equations.normal @ solution
    inverse = np.linalg.inv(equations.normal.sum(axis=0))
    covariance = inverse @ (score.T @ score) @ inverse
    sigma = float(np.sqrt(covariance[3, 3]))
    count = equations.count.sum()
    period = float(np.median([movement.dt_s for movement in twin.movements]))
    return TurnGravity(
        lever_m=solution[:3],
        offset_s=float(solution[3]),
        sigma_s=sigma,
        before_mps2=float(np.sqrt(equations.square.sum() / count)),
        after_mps2=float(np.sqrt(equations.left(solution).sum() / count)),
        bar_s=max(FILTERS_PERIODS * period, SIGMAS * sigma),
        turns=len(equations.count),
        held_out_p=equations.improvement_p(),
    )


def _cross_matrix(vectors: np.ndarray) -> np.ndarray:
    """Matrices (N, 3, 3) of the vector product: matrix @ r = vector x r."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)]
    return np.stack(rows, axis=1)


# A delay common to all axes is not observed by the closure.  It is fixed by convention and by gravity during the turns.

#: grid of a common lag between the estimates from closure and gravity: the cost is a parabola, and the best of nine is within a sixteenth
#: of the distance
LAGS = 9


def in_gauge(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """Fix the parameters that the closure does not observe, as each effect's ``gauge`` declares.

    Some follow a convention (skews of axes are counted from the earliest).  A common delay (sensitivity to angular acceleration, whose
    diagonal is one plus differences) is the delay between gyro and accelerometer; so is that of a lag, as far as the closure permits.
    """
    if not twin.stills:  # between moments of truth turns begin and end in motion, so the closure observes a common delay
        return _by_the_clock(twin, whiten, fit) if twin.clock_free else fit
    for number, claim in enumerate(fit.state.claims):
        gauge = claim.effect.gauge_convention
        if isinstance(gauge, Convention):
            fit = _with_theta(twin, whiten, fit, number, gauge.settle(claim.theta))
        elif isinstance(gauge, CommonDelay):
            fit = (_with_possible_lag if gauge.never_negative else _with_common_delay)(twin, whiten, fit, number, gauge)
    return fit


def _by_the_clock(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """Assign a common delay to the truth's unknown clock offset, from which the data do not separate it.

    An effect keeps the differences between its axes: from their mean, or from the earliest axis if its delays are never negative.  Nothing
    changes if the clock is not among the claims.
    """
    claims, change = list(fit.state.claims), np.eye(len(fit.covariance))
    clock = next((number for number, claim in enumerate(claims) if claim.effect.kind == "truth"), None)
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
    """The covariance with the mean of these entries taken from gravity."""
    rows = np.add(gauge.delays, claim_slice(fit.state.claims, number).start)
    change = np.eye(len(fit.covariance))
    change[np.ix_(rows, rows)] -= 1 / 3
    covariance = change @ fit.covariance @ change.T
    # The relative delay of the filters is within the bar, taken as three sigmas.
    covariance[np.ix_(rows, rows)] += gravity.sigma_s**2 + (gravity.bar_s / 3) ** 2
    return covariance
