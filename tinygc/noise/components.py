"""Variance components beyond white noise, and their estimation by restricted maximum likelihood (Patterson & Thompson 1971)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from session.detect.check_time import LEAST_EXPONENT, STEPS, capped, thinning_exponent, thinning_weights
from session.io.units import DEG, DEG_PER_HOUR, MG, G
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.floor import wander_covariance
from tinygc.closure.least_squares import inverse_lower, solve_lower
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Sparse

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult


# Motion faster than half the data rate: what a sum of readings misses, predicted from the recording alone.
#
# Every k-th reading, taken alone, misses more: the error is the spectrum's share that is folded onto the sum, and of a spectrum that
# falls as a power of frequency it grows as a power p of the step.  What all readings miss is contained in what every k-th misses, so
#
#     |end(every k-th) - end(all)|^2 = (k^2p - 1) E^2,
#
# E the closure error of all readings.  p is common to the recording, E is each turn's own.  A sensor that filters below half its data
# rate has less of it than this law says; a factor, estimated from the closure, carries that.  What noise or false readings add grows with
# p = 0.5 and is no motion.

#: the exponent where nothing is missed
SMOOTH = 2.0


@dataclass(frozen=True, eq=False)
class Undersampling:
    """predicted_rad (S,) rms per angle that each turn misses at the recording's own data rate; exponent; missed_rad (K,) rms over all turns
    and both angles beyond what all readings give, for every k-th of ``STEPS``; rate_hz of the recording."""

    predicted_rad: np.ndarray
    exponent: float
    missed_rad: np.ndarray
    rate_hz: float

    @property
    def rms_rad(self) -> float:
        """Of tilt, over all turns: both angles together."""
        return float(np.sqrt(2 * np.mean(self.predicted_rad**2)))

    def rate_needed_hz(self, missed_rad: float, allowed_rad: float) -> float:
        """The data rate at which the rms of tilt would be down to this, where it is ``missed_rad`` at the recording's own."""
        return float(self.rate_hz * max(missed_rad / allowed_rad, 1e-12) ** (1 / self.exponent))


def undersampling(twin: Twin) -> Undersampling:
    """Of a session's used segments, by the first linear fit.

    To first order an end's error is the sum of the rates' errors, turned into the table (``Twin.sensitivity``).  So the attitudes are
    needed once, and what every k-th reading gives is a plain sum: within 1 % of integrating it (tests/test_undersampling.py).
    """
    rate, at_s = _turned(twin)
    whole = _sum(rate, at_s)
    walk = np.array([np.mean(twin.problem.logs[s.log].noise.angle_random_walk ** 2) for s in twin.segments]) * twin.batch.duration_s
    missed = []
    for step in STEPS:
        kept = [_every(rate.shape[1], step, offset) for offset in range(step)]
        apart = [np.mean((_sum(rate[:, rows], at_s[:, rows]) - whole) ** 2, axis=-1) for rows in kept]
        # White noise is thinned out as well: its variance grows with the step.
        missed.append(np.maximum(np.mean(apart, axis=0) - (step - 1) * walk, 0.0))
    square = np.array(missed)
    grows = thinning_exponent(square)
    exponent = grows or SMOOTH
    predicted = np.mean(square / thinning_weights(exponent)[:, None], axis=0) * (grows >= LEAST_EXPONENT)
    period = float(np.median([log.samples.period_s for log in twin.problem.logs]))
    return Undersampling(capped(np.sqrt(predicted)), exponent, np.sqrt(np.mean(square, axis=1)), 1 / period)


def _turned(twin: Twin) -> tuple[np.ndarray, np.ndarray]:
    """(S, T, 2) rad/s about the table's level axes, and (S, T) s from each segment's beginning; padded with zeros that last no time."""
    batch = twin.batch
    rate = twin.problem.first(batch.rate)
    level = np.einsum("stij,stj->sti", rotation.matrix(closure.attitudes(batch, rate))[..., :2, :], rate - batch.earth)
    at_s = np.concatenate([np.zeros((len(batch), 1)), np.cumsum(batch.dt, axis=1)], axis=1)
    counts = np.array([segment.stop - segment.start for segment in twin.segments])
    return np.where(np.arange(rate.shape[1])[None, :, None] < counts[:, None, None], level, 0.0), at_s


def _every(count: int, step: int, offset: int) -> np.ndarray:
    """Rows of every ``step``-th reading beginning with ``offset``, and those at both ends, which are at rest."""
    return np.unique(np.concatenate([[0], np.arange(offset, count, step), [count - 1]]))


def _sum(rate: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """(S, 2) rad, by trapezoids."""
    return np.einsum("st,sti->si", np.diff(at_s, axis=1), rate[:, 1:] + rate[:, :-1]) / 2


# Estimate variance components: restricted maximum likelihood (Patterson & Thompson 1971), with what is known beforehand as a prior.
#
#     -2 log L(s) = log|C| + log|J' C^-1 J + D^-1| + r' P r + prior,      C = C_0 + sum s_k^2 V_k,
#
# r the residuals, J the columns of all that is fitted, D their prior.  In a long session C is taken block by block of neighbouring turns:
# what is correlated over more than a block says little of the components and costs the cube of the session.

#: steps of the search; it begins where the last one ended
SCORING_STEPS = 12
#: blocks in which sizes are searched for, spread over a long session; the likelihood is that of all (benchmarks/explain_speed.py)
SEARCHED = 3
#: of a component's usual size, as a variance: below, it is not there
NOTHING = 1e-4


class Prior(NamedTuple):
    """What is known of a size s beforehand: its median, and how far it may be from it, ln; upwards, if that is another."""

    median: float
    spread: float
    spread_above: float | None = None

    def apart(self, s: float) -> tuple[float, float]:
        """ln(s / median) in spreads, and the spread on its side."""
        off = float(np.log(s / self.median))
        spread = self.spread if self.spread_above is None or off < 0 else self.spread_above
        return off / spread, spread


@dataclass(frozen=True, eq=False)
class ComponentEstimate:
    """s (K,) SI of each component, sigma (K,) of it, and value: -2 log of the restricted likelihood with the prior, less a constant."""

    s: np.ndarray
    sigma: np.ndarray
    value: float


def estimate(
    r: np.ndarray,
    J: np.ndarray,
    base: np.ndarray,
    V: list[np.ndarray | Sparse],
    usual: np.ndarray,
    priors: list[Prior | None],
    blocks: list[np.ndarray],
    start: np.ndarray | None = None,
    with_sigma: bool = False,
    steps: int = SCORING_STEPS,
) -> ComponentEstimate:
    """Of residuals r (n,), columns J (n, p) scaled by their priors' sigmas, base covariance (n, n) and V, K of (n, n); usual (K,).

    blocks: row numbers of each block.  start: s (K,) of an earlier search.
    """
    parts = [(r[b], J[b], base[np.ix_(b, b)], [_block(v, b) * u**2 for v, u in zip(V, usual, strict=True)]) for b in blocks]
    begin = np.full(len(V), 0.5) if start is None else np.maximum((start / usual) ** 2, 0.05)

    searched = [parts[i] for i in np.linspace(0, len(parts) - 1, min(len(parts), SEARCHED)).round().astype(int)]

    def cost(x: np.ndarray, of: list = searched, slope: bool = True) -> tuple[float, np.ndarray]:
        value, gradient = _cost(x, of, J.shape[1], slope)
        for k, prior in enumerate(priors):
            if prior is None:
                continue
            least = max(float(x[k]), 1e-12)
            apart, spread = prior.apart(float(np.sqrt(least) * usual[k]))
            value += apart**2
            gradient[k] += apart / spread / least
        return value, gradient

    def cost_of_root(root: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = cost(root**2)
        return value, gradient * 2 * root

    least = np.array([0.0 if prior is None else 1e-6 for prior in priors])
    # A component of twenty times its usual size is twenty steps away, as a variance four hundred; but at zero a root's slope is none, and
    # only the variance's says whether the component is there.
    near = _lowest(cost_of_root, np.sqrt(begin), np.sqrt(least), steps).x ** 2
    found = _lowest(cost, near, least, steps)
    x = np.where(found.x < NOTHING, 0.0, found.x)
    s = np.sqrt(x) * usual
    value = float(found.fun) if len(searched) == len(parts) else cost(found.x, parts, False)[0]
    return ComponentEstimate(s, _sigma(cost, found.x) * usual if with_sigma else np.full(len(s), np.nan), value)


def _block(V: np.ndarray | Sparse, rows: np.ndarray) -> np.ndarray:
    return V.block(rows) if isinstance(V, Sparse) else V[np.ix_(rows, rows)]


def _lowest(cost: Callable, begin: np.ndarray, least: np.ndarray, steps: int) -> OptimizeResult:
    from scipy.optimize import minimize

    bounds = [(float(low), None) for low in least]
    return minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": steps, "ftol": 1e-6})


def _cost(x: np.ndarray, parts: list, p: int, slope: bool) -> tuple[float, np.ndarray]:
    information, pull, value = np.eye(p), np.zeros(p), 0.0
    kept = []
    for r, J, base, V in parts:
        factor = np.linalg.cholesky(base + sum(v * xk for v, xk in zip(V, x, strict=True)))
        white = solve_lower(factor, np.column_stack([J, r]))
        information += white[:, :p].T @ white[:, :p]
        pull += white[:, :p].T @ white[:, p]
        value += 2 * float(np.sum(np.log(np.diag(factor)))) + float(white[:, p] @ white[:, p])
        kept.append((factor, white))
    root = np.linalg.cholesky(information)
    beta = np.linalg.solve(information, pull)
    value += 2 * float(np.sum(np.log(np.diag(root)))) - float(pull @ beta)
    gradient = np.zeros(len(x))
    if not slope:
        return value, gradient
    for (_, _, _, V), (factor, white) in zip(parts, kept, strict=True):
        inverse = inverse_lower(factor)
        taken = solve_lower(root, white[:, :p].T @ inverse)  # (p, n): P = C^-1 less what the columns take up
        P = inverse.T @ inverse - taken.T @ taken
        y = inverse.T @ (white[:, p] - white[:, :p] @ beta)
        for k, v in enumerate(V):
            gradient[k] += float(np.sum(P * v)) - float(y @ v @ y)
    return value, gradient


def _sigma(cost: object, x: np.ndarray) -> np.ndarray:
    """(K,) of the square root of x, from the curvature of all together; of one at zero, the size at which the likelihood has lost a
    sigma."""
    assert callable(cost)
    here, steps = cost(x)[1], np.maximum(0.3 * x, 0.02)
    curvature = np.array([(cost(x + step * unit)[1] - here) / step for step, unit in zip(steps, np.eye(len(x)), strict=True)])
    curvature = (curvature + curvature.T) / 2
    sigma = np.full(len(x), np.inf)
    there = np.flatnonzero((x > NOTHING) & (np.diag(curvature) > 0))
    # Each is less well known beside the others than if they were known.
    variance = 2 * np.diag(np.linalg.pinv(curvature[np.ix_(there, there)], hermitian=True))
    alone = 2 / np.diag(curvature)[there]
    sigma[there] = np.sqrt(np.maximum(variance, alone)) / (2 * np.sqrt(x[there]))
    for k in np.flatnonzero((x <= NOTHING) & (np.diag(curvature) > 0)):
        slope, bend = max(here[k], 0.0), curvature[k, k]
        # slope x + bend x^2 / 2 = 1
        sigma[k] = np.sqrt((np.sqrt(slope**2 + 2 * bend) - slope) / bend)
    return sigma


# What the covariance of all channels may hold beside white noise: variance components, each with a name and a place.
#
# A component is V_k s_k^2: V_k from the recording's geometry, s_k estimated (``restricted_likelihood.py``).
#
# - ``noise.bias_wander``: the bias wanders as flicker noise; it is known beforehand as well as its source is.
# - ``noise.still_rate``: the mean rate of each still errs by itself: rests creep, the bias jumps between them.
# - ``noise.reference``: the accelerometer's error in each attitude: it tilts the reference at the ends of two turns, and shows in gravity's
#   length.
# - ``noise.truth``: in its place between moments of truth: the truth's own error at each, which two neighbours share with opposite signs.
# - ``noise.turn``: what each turn errs by beyond all that; equal for all turns.
# - ``motion.undersampled``: motion faster than half the data rate; each turn's share is predicted (``undersampling.py``), s is a factor.

WANDER, STILL_RATE, REFERENCE, TRUTH, TURN, UNDERSAMPLED = (
    "noise.bias_wander",
    "noise.still_rate",
    "noise.reference",
    "noise.truth",
    "noise.turn",
    "motion.undersampled",
)
#: ln: how far a unit's bias instability may be from the typical one of its model, and from the one that was given for it
TYPICAL_SPREAD, GIVEN_SPREAD = 0.5, 0.1
#: an undersampling below this share of the floor's rms is none: a factor of it cannot be told
LEAST_UNDERSAMPLING = 0.1
#: ln: undersampling is predicted within a factor of 1.5 (benchmarks/real_recordings.py); a filter below half the data rate leaves less
FACTOR_SPREAD, FILTERED_SPREAD = 0.4, 1.0
#: two of these spreads: turns that miss by more than this times what fast motion makes miss for another reason
MOST_FACTOR = float(np.exp(2 * FACTOR_SPREAD))
#: ln: a truth's sigma is stated to an order of magnitude: of the public ones, some are 30 times as good, some as bad as they say
TRUTH_SPREAD = 1.5
#: a bias that wanders beside a truth where nothing says by how much: a MEMS gyroscope's, to an order of magnitude
UNKNOWN_WANDER_RPS, UNKNOWN_SPREAD = 10 * DEG_PER_HOUR, 1.5


@dataclass(frozen=True, eq=False)
class Component:
    """One of them.

    name; V (n, n) rad^2, (rad/s)^2 and (m/s^2)^2 of the stacked channels for s = 1, sparse but for what lasts all session; usual: s as
    large as white noise, SI, where a search begins; prior: median and spread (ln) of s where something is known beforehand; unit and si:
    how a person reads s; says.
    """

    name: str
    V: np.ndarray | Sparse
    usual: float
    unit: str
    si: float
    says: str
    prior: Prior | None = None


def components_of(twin: Twin, sizes: tuple[int, int, int], missed: Undersampling) -> list[Component]:
    """Of a twin whose channels have sizes (S d, 3 Q, Q)."""
    white = replace(twin.problem.floor, tilt_excess=1.0, own=twin.problem.floor.white, wider=None)
    floor = float(np.sqrt(np.mean(white.sigma[twin.batch.known] ** 2)))
    reference = _reference(twin, sizes) if twin.stills else _truth(twin, sizes)
    found = [_wander(twin, sizes), _still_rate(twin, sizes), reference, _turn(twin, sizes, floor)]
    if missed.rms_rad / np.sqrt(2) > LEAST_UNDERSAMPLING * floor:
        found.append(_undersampled(twin, sizes, missed))
    return [c for c in found if np.any(c.V.values if isinstance(c.V, Sparse) else c.V)]


def _wander(twin: Twin, sizes: tuple[int, int, int]) -> Component:
    s, q = len(twin.segments), len(twin.stills)
    starts = twin.problem.began_s
    segment_s = [starts[segment.log] + segment.start_s + segment.duration_s / 2 for segment in twin.segments]
    still_s = [starts[log] + still.start_s + still.duration_s / 2 for log, still in twin.stills]
    spans = [segment.duration_s for segment in twin.segments] + [still.duration_s for _, still in twin.stills]
    wander = wander_covariance(np.array(segment_s + still_s), np.array(spans), instability_rps=1.0)
    # A bias error turns a segment's end by its mean attitude times its duration, and shows in a still as it is.
    sensitivity = twin.sensitivity(twin.start(), twin.rates(twin.start()))
    response = np.concatenate([sensitivity.sum(axis=1).reshape(sizes[0], 3), np.tile(np.eye(3), (q, 1))])
    owner = np.concatenate([np.repeat(np.arange(s), twin.batch.angles), s + np.repeat(np.arange(q), 3)])
    V = np.zeros((sum(sizes), sum(sizes)))
    V[: len(owner), : len(owner)] = (response @ response.T) * wander[np.ix_(owner, owner)]
    known = twin.problem.instability
    white = float(np.median(twin.problem.still_rates.sigma)) if q else 2 * UNKNOWN_WANDER_RPS
    spread = TYPICAL_SPREAD if known.source.startswith("typical") else GIVEN_SPREAD
    prior = Prior(known.rps, spread) if known.rps > 0 and not known.of_unit else None
    if not q and prior is None:  # the rates at rest that an estimate is from are no rows of such a twin
        prior = Prior(known.rps, TYPICAL_SPREAD) if known.rps > 0 else Prior(UNKNOWN_WANDER_RPS, UNKNOWN_SPREAD)
    return Component(WANDER, V, known.rps or white / 2, "°/h", DEG_PER_HOUR, "bias drift", prior)


def _still_rate(twin: Twin, sizes: tuple[int, int, int]) -> Component:
    diagonal = np.zeros(sum(sizes))
    diagonal[sizes[0] : sizes[0] + sizes[1]] = 1.0
    white = float(np.median(twin.problem.still_rates.sigma)) if len(twin.stills) else DEG
    return Component(STILL_RATE, Sparse.of_diagonal(diagonal), white, "dps", DEG, "mean rate of each still")


def _reference(twin: Twin, sizes: tuple[int, int, int]) -> Component:
    d = twin.batch.angles
    V = np.zeros((sum(sizes), sum(sizes)))
    ends = np.zeros((len(twin.segments), len(twin.stills)))
    ends[np.arange(len(ends)), twin.first] += 1
    ends[np.arange(len(ends)), twin.last] -= 1
    shared = ends @ ends.T / G**2
    tilt = np.diag([1.0, 1.0, 0.0])[:d, :d]
    V[: sizes[0], : sizes[0]] = np.kron(shared, tilt)
    length = slice(sizes[0] + sizes[1], sum(sizes))
    V[length, length] = np.eye(sizes[2])
    return Component(REFERENCE, Sparse.of(V), 0.1 * MG, "mg", MG, "accelerometer error with attitude")


def _truth(twin: Twin, sizes: tuple[int, int, int]) -> Component:
    """Of each moment of truth; a segment that begins at the sample where another ends shares its moment."""
    sigma = twin.problem.session.config.protocol.truth_sigma_deg * DEG
    ends: dict[tuple[int, int], np.ndarray] = {}
    for number, s in enumerate(twin.segments):
        for at, sign in ((s.start, -1.0), (s.stop - 1, 1.0)):
            ends.setdefault((s.log, at), np.zeros(len(twin.segments)))[number] += sign
    moments = np.array(list(ends.values()))
    V = np.kron(moments.T @ moments, np.eye(twin.batch.angles))
    return Component(TRUTH, Sparse.of(V), sigma, "deg", DEG, "attitude of each moment of truth", Prior(sigma, TRUTH_SPREAD))


def _turn(twin: Twin, sizes: tuple[int, int, int], floor: float) -> Component:
    diagonal = np.zeros(sum(sizes))
    diagonal[: sizes[0]] = 1.0
    if twin.batch.turns is not None:
        # A known angle has its stop's sigma: what an accelerometer or a hand does to the tilt at the ends is none of its.
        diagonal[2 : sizes[0] : twin.batch.angles] = 0.0
    return Component(TURN, Sparse.of_diagonal(diagonal), floor, "deg", DEG, "each turn")


def _undersampled(twin: Twin, sizes: tuple[int, int, int], missed: Undersampling) -> Component:
    d = twin.batch.angles
    diagonal = np.zeros(sum(sizes))
    diagonal[: sizes[0]] = np.repeat(missed.predicted_rad**2, d)
    prior = Prior(1.0, FILTERED_SPREAD, FACTOR_SPREAD)
    says = "motion faster than half the data rate"
    return Component(UNDERSAMPLED, Sparse.of_diagonal(diagonal), 1.0, "times what is predicted", 1.0, says, prior)
