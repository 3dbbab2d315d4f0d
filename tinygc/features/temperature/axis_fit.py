"""One axis' zero over temperature: rest logs in blocks and sweeps, polynomial, lag, hysteresis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from session.base.numeric import rms_of, sigma_of, sigmas_in
from session.log.rests import RestLog
from tinygc.features.temperature.model import element_temperature
from tinygc.features.temperature.sweeps import Sweep, between_steps
from tinygc.inference.choose import AS_PROBABLE, PRIOR_ODDS, price, probabilities
from tinygc.inference.noise import estimate, wander_covariance
from tinygc.inference.prove import left_out
from tinygc.inference.solve import inverse_lower, solve_lower
from tinygc.inference.solve import solve as determined

# Blocks of a rest log merged into knots, few enough for a full covariance of their noise.
#
# A polynomial of temperature is averaged over the blocks of a knot, not evaluated at the knot's mean temperature, so a knot may be wide.

#: over all logs: from 80 to 320 the sigmas grow by a fifth, and the time by fifteen (benchmarks/temperature.py knots)
MOST_KNOTS = 160
#: lags whose powers are cached, since six axes use the same grid
MOST_KEPT = 100


@dataclass(frozen=True, eq=False)
class Knots:
    """K knots from the B kept blocks of several rest logs.

    logs: kept blocks, their temperature between the steps of the thermometer; of (K,): log of each knot; starts (K,): its first block,
    counted through all logs; t_s, span_s (K,) s: middle in its log, and averaging time; sweep (K,): number of its sweep, or 0 where there
    are none; direction (K,): of the temperature, +1, -1 or 0; temp_c (K,): mean; off_c (K, I): its errors by the steps, one sigma of each,
    one independent of the other; reference_c and half_c: temperatures are normalised as x = (T - reference) / half.
    """

    logs: tuple[RestLog, ...]
    of: np.ndarray
    starts: np.ndarray
    t_s: np.ndarray
    span_s: np.ndarray
    sweep: np.ndarray
    direction: np.ndarray
    temp_c: np.ndarray
    off_c: np.ndarray
    reference_c: float
    half_c: float
    _powers: dict[float, np.ndarray] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.of)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """(K, …) means over the blocks of each knot, of values (B, …)."""
        counts = np.diff(np.append(self.starts, len(values)))
        return np.add.reduceat(values, self.starts, axis=0) / counts.reshape(-1, *[1] * (values.ndim - 1))

    def element_c(self, tau_s: float) -> np.ndarray:
        """(B,) degC of the element at each block, for a lag."""
        return np.concatenate([_lagged(log, tau_s) for log in self.logs])

    def powers(self, tau_s: float, order: int) -> np.ndarray:
        """(K, order): means over each knot of x, x^2, …, where x is the element's normalised temperature."""
        kept = self._powers.get(tau_s)
        if kept is None or kept.shape[1] < order:
            x = (self.element_c(tau_s) - self.reference_c) / self.half_c
            kept = np.column_stack([self.mean(power) for power in _powers_of(x, order)]) if order else np.zeros((len(self), 0))
            if len(self._powers) < MOST_KEPT:
                self._powers[tau_s] = kept
        return kept[:, :order]

    def offsets(self) -> np.ndarray:
        """(K, L): 1 where a knot belongs to a log."""
        return (self.of[:, None] == np.arange(len(self.logs))).astype(float)

    def covariances(self) -> list[np.ndarray]:
        """(K, K) each, of noise of unit size: white of density 1 (a mean over h s has the variance 1/h), flicker of bias instability 1,
        a random walk of 1 per root of a second.  Logs are independent."""
        same = self.of[:, None] == self.of[None]
        flicker = np.where(same, wander_covariance(self.t_s, self.span_s, instability_rps=1.0), 0.0)
        walk = np.where(same, np.minimum(self.t_s[:, None], self.t_s[None]), 0.0)
        return [np.diag(1 / self.span_s), flicker, walk]

    def of_steps(self, y: np.ndarray, tau_s: float, order: int) -> np.ndarray:
        """(K, K) covariance that the thermometer's steps add to knots y (K,): its errors times the polynomial's slope there."""
        A = columns(self, tau_s, order)
        bend = np.linalg.lstsq(A, y, rcond=None)[0][len(self.logs) :] * np.arange(1, order + 1)
        slope = np.column_stack([np.ones(len(self)), self.powers(tau_s, order)])[:, :order] @ bend / self.half_c
        off = slope[:, None] * self.off_c
        return np.asarray(off @ off.T)


def _powers_of(x: np.ndarray, order: int) -> Iterator[np.ndarray]:
    """x, x^2 and so on."""
    power = np.ones_like(x)
    for _ in range(order):
        power = power * x
        yield power


def _lagged(log: RestLog, tau_s: float) -> np.ndarray:
    """Element temperature of one log's kept blocks; missing blocks are interpolated linearly."""
    if tau_s == 0:
        return log.temp_c
    every = np.arange(log.number[0], log.number[-1] + 1)
    return element_temperature(np.interp(every, log.number, log.temp_c), tau_s, log.block_s)[log.number - log.number[0]]


def make_knots(logs: list[RestLog], sweeps: list[Sweep]) -> Knots:
    """Merge the kept blocks of each log by their sweeps (``sweeps_of``); a log without sweeps counts as one."""
    has_temperature = all(log.has_temperature for log in logs)
    between = [between_steps(log.t_s, log.temp_c, log.grid) for log in logs]
    logs = [replace(log, temp_c=each.temp_c) for log, each in zip(logs, between, strict=True)]
    temp = np.concatenate([log.temp_c for log in logs]) if has_temperature else np.zeros(sum(map(len, logs)))
    total = sum(map(len, logs))
    rows: list[tuple] = []
    before = number = 0
    for index, log in enumerate(logs):
        own = [sweep for sweep in sweeps if sweep.log == index] or [Sweep(index, 0, len(log), 0)]
        for sweep in own:
            count = max(round(MOST_KNOTS * (sweep.stop - sweep.start) / total), 1)
            edges = np.unique(np.linspace(sweep.start, sweep.stop, min(count, sweep.stop - sweep.start) + 1).astype(int))
            for start, stop in pairwise(edges.tolist()):
                middle_s = float(log.t_s[start:stop].mean())
                mean_c = float(temp[before + start : before + stop].mean())
                rows.append((index, before + start, middle_s, (stop - start) * log.block_s, number, sweep.direction, mean_c))
            number += 1
        before += len(log)
    of, starts, t_s, span_s, sweep_number, direction, temp_c = (np.array(column) for column in zip(*rows, strict=True))
    low, high = float(temp.min()), float(temp.max())
    reference_c = float(np.round((low + high) / 2)) if has_temperature else 25.0
    half_c = max((high - low) / 2, 1.0)
    knot, counts = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, total))), np.diff(np.append(starts, total))
    first = np.cumsum([0, *(int(each.interval.max(initial=-1)) + 1 for each in between)])
    interval = np.concatenate([each.interval + begin for each, begin in zip(between, first, strict=False)])
    off_c = np.zeros((len(starts), first[-1]))
    np.add.at(off_c, (knot, interval), np.concatenate([each.sigma_c for each in between]) / counts[knot])
    return Knots(tuple(logs), of, starts, t_s, span_s, sweep_number, direction, temp_c, off_c[:, off_c.any(axis=0)], reference_c, half_c)


# One axis' zero over temperature: polynomial, lag, hysteresis, and their uncertainties.

# The noise apart from the effect of temperature: white, flicker and a random walk, their sizes estimated from the rest log itself.
#
# Sigmas from white noise alone are too small by an order: an hour of rest holds few independent values of a drifting bias.

#: steps of a search
STEPS = 40
#: of the largest reading: width of a zero's prior, wide enough to be uninformative
WIDE = 1e4


@dataclass(frozen=True, eq=False)
class _Coloured:
    """sizes (3,) of white (unit/sqrt(Hz), two-sided), flicker (unit) and random walk (unit/sqrt(s)); C (K, K): their total covariance;
    value: -2 log of the restricted likelihood."""

    sizes: np.ndarray
    C: np.ndarray
    value: float = np.nan

    @property
    def factor(self) -> np.ndarray:
        """Lower Cholesky factor of the covariance."""
        return np.linalg.cholesky(self.C)


def estimate_noise(y: np.ndarray, J: np.ndarray, V: list[np.ndarray], white: float, steps: np.ndarray | float = 0.0) -> _Coloured:
    """Estimate the noise of knots y (K,) about the columns J (K, p), in units of their priors' sigmas; V: covariances of unit size
    (``Knots.covariances``); white: size of white noise from the differences of blocks; steps (K, K): what the thermometer's add
    (``Knots.of_steps``)."""
    scatter = float(np.std(y - J @ np.linalg.lstsq(J, y, rcond=None)[0])) or white or 1.0
    longest = float(np.sqrt(V[2].max()))
    usual = np.array([white or scatter * np.sqrt(1 / V[0].max()), scatter, scatter / longest])
    base = V[0] * (0.5 * usual[0]) ** 2
    found = estimate(y, J, base + steps, [*V], usual, [None] * 3, [np.arange(len(y))], steps=STEPS)
    sizes = found.s.copy()
    sizes[0] = np.hypot(sizes[0], 0.5 * usual[0])
    return _Coloured(sizes, sum((v * s**2 for v, s in zip(V, sizes, strict=True)), np.zeros_like(base) + steps), found.value)


def white_of(knots: Knots, blocks: np.ndarray) -> float:
    """Size of white noise, unit/sqrt(Hz), from how the steps between blocks (B,) differ: what changes evenly does not count."""
    return float(sigma_of(np.diff(blocks, n=2)) * np.sqrt(knots.logs[0].block_s / 6))


def priced(knots: Knots, y: np.ndarray, tau_s: float, order: int) -> np.ndarray:
    """(K, L + order): ``columns`` in units of their priors' sigmas for knots y (K,) whose scatter is 1, which is a power's."""
    zeros = np.full(len(knots.logs), WIDE * np.abs(y).max(initial=1.0))
    return columns(knots, tau_s, order) * np.append(zeros, np.ones(order))


def about(knots: Knots, y: np.ndarray, V: list[np.ndarray], white: float, order: int, tau_s: float = 0.0) -> _Coloured:
    """The noise of knots y (K,), whose scatter is 1, about a polynomial of this order."""
    return estimate_noise(y, priced(knots, y, tau_s, order), V, white, knots.of_steps(y, tau_s, order))


# Hysteresis: the difference of the zero at one temperature between the rising and the falling branch.

#: bins over the range that both branches cover
BINS = 8


@dataclass(frozen=True, eq=False)
class Hysteresis:
    """Residuals of the rising less the falling branch: at_c (n,) degC, difference and sigma (n,) SI."""

    at_c: np.ndarray
    difference: np.ndarray
    sigma: np.ndarray

    @property
    def largest(self) -> tuple[float, float, float]:
        """The difference of largest magnitude, its sigma, and its temperature."""
        k = int(np.argmax(np.abs(self.difference)))
        return float(self.difference[k]), float(self.sigma[k]), float(self.at_c[k])

    @property
    def rms(self) -> float:
        """Root mean square over the temperatures."""
        return rms_of(self.difference)


def _hysteresis_of(knots: Knots, residual: np.ndarray, C: np.ndarray) -> Hysteresis | None:
    """Compute the hysteresis of residuals (K,) with noise C (K, K); None where the temperature changed in one direction only."""
    up, down = knots.direction > 0, knots.direction < 0
    if not (up.any() and down.any()):
        return None
    low = max(knots.temp_c[up].min(), knots.temp_c[down].min())
    high = min(knots.temp_c[up].max(), knots.temp_c[down].max())
    edges = np.linspace(low, high, BINS + 1)
    rows, at = [], []
    for lower, upper in pairwise(edges):
        here = (knots.temp_c >= lower) & (knots.temp_c < upper)
        if (here & up).any() and (here & down).any():
            rising, falling = ((here & way) * knots.span_s for way in (up, down))
            rows.append(rising / rising.sum() - falling / falling.sum())
            at.append((lower + upper) / 2)
    if not rows:
        return None
    D = np.array(rows)
    return Hysteresis(np.array(at), D @ residual, sigmas_in(D @ C @ D.T))


# Model selection: the polynomial's order, and whether there is a lag, by the evidence of each.
#
# The noise is estimated about each candidate again: what one takes for an effect of temperature is a walk to another, and a power pays for
# itself by its prior, as wide as the zeros scatter.  Of 162 lines all are named a line, and of zeros that walk none is named an effect
# (benchmarks/temperature.py).
#
# All knots have equal weight in a polynomial's coefficients.  Weights from the noise would rely on the differences between knots where the
# zero drifts, and lose its level: on a public sweep they predict a third sweep's zero to 0.26 dps, where equal weights reach 0.12.  A lag
# shows in just these differences, and is fitted with the weights.

#: number of lags tried, of either sign; the longest as a share of the shortest sweep
LAGS, LONGEST_SHARE = 20, 0.25
#: with a single sweep: stretches of time, and folds that they form
STRETCHES, STRETCH_FOLDS = 20, 5


@dataclass(frozen=True, eq=False)
class Candidate:
    """Model of one axis: order of its polynomial; lag tau_s of the element's temperature behind the reading, 0 for none; noise about it;
    score: -2 log of evidence times prior."""

    order: int
    tau_s: float
    noise: _Coloured
    score: float

    @property
    def ids(self) -> frozenset[str]:
        """What it states of temperature: nothing, its effect, or also a lag."""
        return frozenset(("effect",) * (self.order > 0) + ("lag",) * (self.tau_s != 0))


def folds_of(knots: Knots) -> tuple[np.ndarray, str]:
    """Return (K,) number of each knot's fold, and the kind of fold."""
    if len(np.unique(knots.sweep)) > 1:
        return knots.sweep, "sweeps"
    return np.arange(len(knots)) * STRETCHES // len(knots) % STRETCH_FOLDS, "stretches"


def _lag_grid(knots: Knots) -> np.ndarray:
    """Return the lags, s, to try, without zero; empty where the temperature changes in one direction only, which shows no lag."""
    if not {-1, 1} <= set(knots.direction.tolist()):
        return np.zeros(0)
    block_s = max(log.block_s for log in knots.logs)
    shortest = min(float(knots.span_s[knots.sweep == sweep].sum()) for sweep in np.unique(knots.sweep))
    longest = LONGEST_SHARE * shortest
    if longest <= 4 * block_s:
        return np.zeros(0)
    lags = np.geomspace(block_s, longest, LAGS)
    return np.concatenate([-lags[::-1], lags])


def columns(knots: Knots, tau_s: float, order: int) -> np.ndarray:
    """(K, L + order): a zero for each log, then the powers of the temperature."""
    return np.column_stack([knots.offsets(), knots.powers(tau_s, order)])


def _best_lag(knots: Knots, y: np.ndarray, L: np.ndarray, lags: np.ndarray, order: int) -> float:
    """Return the lag of least misfit, from a grid, then refined between neighbours; y (K,), L: the noise's factor."""
    white = solve_lower(L, y)

    def left(tau: float) -> float:
        A = solve_lower(L, columns(knots, float(tau), order))
        return float(np.sum((white - A @ np.linalg.lstsq(A, white, rcond=None)[0]) ** 2))

    k = int(np.argmin([left(tau) for tau in lags.tolist()]))
    from scipy.optimize import minimize_scalar

    between = float(lags[max(k - 1, 0)]), float(lags[min(k + 1, len(lags) - 1)])
    return float(minimize_scalar(left, bounds=between, method="bounded", options={"xatol": 1e-3 * abs(float(lags[k]))}).x)


def weigh(knots: Knots, y: np.ndarray, V: list[np.ndarray], white: float, orders: tuple[int, ...], lags: np.ndarray) -> list[Candidate]:
    """Weigh the candidates for knots y (K,), whose scatter is 1: of a lag, the best one with the highest order."""
    most, taus = max(orders), [0.0]
    if len(lags):
        taus.append(_best_lag(knots, y, about(knots, y, V, white, most).factor, lags, most))
    weighed = []
    for tau in taus:
        for order in orders:
            if order or not tau:
                noise = about(knots, y, V, white, order, tau)
                prior = -2 * float(np.log(PRIOR_ODDS / max(len(orders) - 1, 1))) * (order > 0) + price(1, 2) * (tau != 0)
                weighed.append(Candidate(order, tau, noise, noise.value + prior))
    return weighed


def held_out(knots: Knots, y: np.ndarray, order: int, tau: float) -> float:
    """Rms over the folds of what a polynomial with its lag, estimated from the others, leaves of each, in the unit of y (K,)."""
    J, folds = columns(knots, tau, order), folds_of(knots)[0]
    if tau:
        J = np.column_stack([J, lag_slope(knots, tau, order, np.linalg.lstsq(J, y, rcond=None)[0])])
    left, parts = y - J @ np.linalg.lstsq(J, y, rcond=None)[0], [np.flatnonzero(folds == fold) for fold in np.unique(folds)]
    J = WIDE * J
    error = left_out(left, J, np.eye(len(y)), left, J, parts)
    for rows in parts:
        # The zero of a log that is left out completely cannot be predicted; its scatter is reported separately.
        if not set(knots.of[rows]) <= set(np.delete(knots.of, rows)):
            error[rows] -= error[rows].mean()
    return rms_of(np.array([rms_of(error[rows]) for rows in parts]))


# One axis' zero over temperature: polynomial, lag, hysteresis, residuals, and their uncertainties.

#: orders that are tried
ORDERS = (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True)
class Line:
    """slope and sigma, SI per degC, of the straight line that a constant may hide, in the noise that the constant leaves; order of the
    best polynomial where its evidence is near the constant's, so that it or a walk is there, and which is not known; 0 where none is."""

    slope: float
    sigma: float
    order: int


@dataclass(frozen=True, eq=False)
class AxisFit:
    """zero(T) = sum_n terms[n] (T_e - reference)^n, SI, T_e the element's temperature by ``tau_s``.

    terms (P + 1,) per degC^n; covariance (P + 2, P + 2) of terms and tau_s, whose row is zero without a lag; folds: ``sweeps`` or
    ``stretches``; held_out: rms error of predicting folds that are left out, the model's remaining uncertainty; held_out_constant: of a
    constant; left: rms of the fit's residuals; p_value: probability that temperature does nothing; noise: apart from it; hysteresis: of the
    polynomial alone, and with the lag (None: the temperature changed in one direction only); turn_on: scatter of the logs' zeros, NaN of
    one log; line: of a constant over a range.
    """

    terms: np.ndarray
    tau_s: float
    covariance: np.ndarray
    folds: str
    held_out: float
    held_out_constant: float
    left: float
    p_value: float
    noise: _Coloured
    hysteresis_before: Hysteresis | None
    hysteresis_after: Hysteresis | None
    turn_on: float
    line: Line | None = None

    @property
    def order(self) -> int:
        """Order of the polynomial."""
        return len(self.terms) - 1

    @property
    def sigma(self) -> np.ndarray:
        """(P + 2,) of terms, then tau_s."""
        return sigmas_in(self.covariance)


def fit_axis(knots: Knots, blocks: np.ndarray, orders: tuple[int, ...] = ORDERS) -> AxisFit:
    """Fit one axis' block means (B,) rad/s, or m/s^2, at rest."""
    y, V = knots.mean(blocks), knots.covariances()
    unit = float(np.std(y)) or 1.0  # scaled to numbers near 1, as the noise estimate requires
    y = y / unit
    orders = tuple(p for p in orders if p <= most_order(knots) and determined(columns(knots, 0.0, p)).rank == len(knots.logs) + p)
    lags = _lag_grid(knots) if max(orders) else np.zeros(0)
    weighed = weigh(knots, y, V, white_of(knots, blocks / unit), orders, lags)
    best = min(weighed, key=lambda each: each.score)
    order, noise = best.order, best.noise
    tau = _best_lag(knots, y, noise.factor, lags, order) if best.tau_s else 0.0
    coefficients, covariance = solve_axis(knots, y, noise, tau, order)
    line = None
    if not order and 1 in orders:
        slope, spread = solve_axis(knots, y, noise, 0.0, 1)
        rival = min((each for each in weighed if each.order), key=lambda each: each.score)
        near = rival.order if rival.score < best.score + 2 * AS_PROBABLE else 0
        per_c = unit / knots.half_c
        line = Line(float(slope[-1]) * per_c, float(np.sqrt(spread[-1, -1])) * per_c, near)
    residual = y - columns(knots, tau, order) @ coefficients[: len(knots.logs) + order]
    plain = y - columns(knots, 0.0, order) @ solve_axis(knots, y, noise, 0.0, order)[0]
    terms, of_terms = _in_degrees(knots, coefficients, covariance, order)
    zeros = coefficients[: len(knots.logs)]
    scale = np.append(np.full(len(terms), unit), 1.0)
    return AxisFit(
        terms=terms * unit,
        tau_s=tau,
        covariance=of_terms * np.outer(scale, scale),
        folds=folds_of(knots)[1],
        held_out=held_out(knots, y, order, tau) * unit,
        held_out_constant=held_out(knots, y, 0, 0.0) * unit,
        left=rms_of(residual) * unit,
        p_value=probabilities(weighed).get("", 0.0),
        noise=_Coloured(noise.sizes * unit, noise.C * unit**2),
        hysteresis_before=_hysteresis_of(knots, plain * unit, noise.C * unit**2),
        hysteresis_after=_hysteresis_of(knots, residual * unit, noise.C * unit**2),
        turn_on=float(np.std(zeros, ddof=1)) * unit if len(zeros) > 1 else float("nan"),
        line=line,
    )


def most_order(knots: Knots) -> int:
    """Return the highest order: 0 without a range of temperatures, and always less than the number of knots."""
    return 0 if np.ptp(knots.temp_c) < 1.0 else max(len(knots) // 4, 0)


def lag_slope(knots: Knots, tau: float, order: int, coefficients: np.ndarray) -> np.ndarray:
    """(K,): what the fit changes by a second of its lag."""
    step = 0.02 * abs(tau)
    found: np.ndarray = (columns(knots, tau + step, order) - columns(knots, tau - step, order)) @ coefficients / (2 * step)
    return found


def solve_axis(knots: Knots, y: np.ndarray, noise: _Coloured, tau: float, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return zeros of the logs and coefficients of x, x^2, …, then tau's change where there is a lag, and their covariance.

    Every estimate is linear in the knots, so its covariance follows from theirs.  Coefficients have equal weights, the lag the weights
    of the noise, and the coefficients depend on the lag.
    """
    A = columns(knots, tau, order)
    G = np.linalg.pinv(A)
    coefficients = G @ y
    if tau:
        slope, L = lag_slope(knots, tau, order, coefficients), noise.factor
        W = solve_lower(L, np.column_stack([A, slope]))
        of_lag = (np.linalg.pinv(W)[-1:] @ inverse_lower(L)).ravel()
        G = np.vstack([G - np.outer(G @ slope, of_lag), of_lag])
    return coefficients, G @ noise.C @ G.T


def _in_degrees(knots: Knots, coefficients: np.ndarray, covariance: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """terms (P + 1,) per degC^n, the first the mean of the logs' zeros, and the covariance (P + 2, P + 2) of them and the lag."""
    logs = len(knots.logs)
    map_ = np.zeros((order + 2, len(covariance)))
    map_[0, :logs] = 1 / logs
    map_[np.arange(1, order + 1), logs + np.arange(order)] = knots.half_c ** -np.arange(1.0, order + 1)
    if len(covariance) > logs + order:  # the last is a lag's
        map_[-1, -1] = 1.0
    return map_[:-1, : len(coefficients)] @ coefficients, map_ @ covariance @ map_.T
