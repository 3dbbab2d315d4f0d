"""Sessions at several temperatures, and rest logs, in one model: E(T) and b(T) by generalised least squares.

Each session gives E and its zero with a covariance; E is in the body frame of that session's accelerometer, and is turned into the first
one's.  Rest logs give how the zero moves, not where it stands: that is the sessions', since a zero changes from one switch-on to the next,
and a rest log's holds the Earth's rotation.  What the sessions' zeros scatter beyond their sigmas is such a change, and is a variance of
its own (Paule & Mandel 1982); what E scatters widens its sigmas (Birge 1932).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from session.common.errors import FitError
from tinygc.models.linear import BIAS, MATRIX
from tinygc.models.thermal import ThermalModel
from tinygc.temperature.rest_fit import RestFit
from tinygc.temperature.sessions import SessionPoint, in_frame_of_first
from tinygc.temperature.thermal_terms import usable_range, zero_covariance, zero_terms

#: highest order of E that is tried: a sensitivity over temperature is nearly straight (data sheets state a slope)
MOST_E = 2
#: the probability by chance below which E, or without rest logs the zero, is said to follow temperature
BY_CHANCE = 0.01
#: degC: sessions that are nearer are at one temperature
APART_C = 2.0


@dataclass(frozen=True, eq=False)
class SessionsFit:
    """points, the sessions in the body frame of the first; model; covariance of E's terms, the zero's and the lags, in the order of
    ``parameter_names``.

    E: chi_square, freedom, p_value of the sessions' E about the model; widened: factor of E's variance; p_constant: that E does not follow
    temperature, by chance; turn_on_rps: what the zero changes from session to session beyond noise, NaN where it cannot be told.
    """

    points: tuple[SessionPoint, ...]
    model: ThermalModel
    covariance: np.ndarray
    chi_square: float
    freedom: int
    p_value: float
    widened: float
    p_constant: float
    turn_on_rps: float


def join(points: Sequence[SessionPoint], rests: RestFit | None, most_order: int = 5) -> SessionsFit:
    """One model of all.  FitError without sessions."""
    if not points:
        raise FitError("no session with turns: E needs one, and E over temperature two or more")
    points = in_frame_of_first(points)
    temps = np.array([point.temp_c for point in points])
    reference = rests.knots.reference_c if rests is not None else float(np.round((temps.min() + temps.max()) / 2))
    levels = 1 + int(np.count_nonzero(np.diff(np.sort(temps)) > APART_C))
    away = temps - reference
    E_values = np.array([point.values[MATRIX] for point in points])
    order, p_constant = _order_of_E(points, away, min(levels - 1, MOST_E))
    E, C_E, chi_square = _solve_E(points, away, order)
    freedom = 9 * (len(points) - order - 1)
    widened = max(chi_square / freedom, 1.0) if freedom else 1.0
    zero, C_zero, turn_on, lag = _zero(points, away, rests, min(levels - 1, most_order))
    n_E, n_zero = 9 * (order + 1), len(zero) * 3
    covariance = np.zeros((n_E + n_zero + 3,) * 2)
    covariance[:n_E, :n_E] = widened * C_E
    covariance[n_E:, n_E:] = C_zero
    # E and the zero of one session are known together: through the constants.
    cross = _cross(points, len(E_values))
    covariance[MATRIX, n_E : n_E + 3] += cross
    covariance[n_E : n_E + 3, MATRIX] += cross.T
    covariance = _possible(covariance)
    low, high = float(min(p.low_c for p in points)), float(max(p.high_c for p in points))
    if rests is not None:
        cold, warm = usable_range(rests)
        low, high = min(low, cold), max(high, warm)
    model = ThermalModel(E.reshape(-1, 3, 3), zero, lag, reference, (low, high))
    p_value = float(chi2.sf(chi_square, freedom)) if freedom else float("nan")
    return SessionsFit(points, model, covariance, chi_square, freedom, p_value, widened, p_constant, turn_on)


def _solve_E(points: Sequence[SessionPoint], away: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Terms (order + 1, 9), their covariance, chi-square."""
    size = 9 * (order + 1)
    information, pull, fixed = np.zeros((size, size)), np.zeros(size), 0.0
    for point, x in zip(points, away, strict=True):
        weight = np.linalg.inv(point.covariance[MATRIX, MATRIX])
        powers = x ** np.arange(order + 1)
        information += np.kron(np.outer(powers, powers), weight)
        pull += np.kron(powers, weight @ point.values[MATRIX])
        fixed += float(point.values[MATRIX] @ weight @ point.values[MATRIX])
    covariance = _inverse(information)
    terms = covariance @ pull
    left = 0.0
    for point, x in zip(points, away, strict=True):
        off = point.values[MATRIX] - (x ** np.arange(order + 1)) @ terms.reshape(-1, 9)
        left += float(off @ np.linalg.solve(point.covariance[MATRIX, MATRIX], off))
    return terms.reshape(-1, 9), covariance, left


def _order_of_E(points: Sequence[SessionPoint], away: np.ndarray, most: int) -> tuple[int, float]:
    """The lowest order beyond which nothing shows, and the probability of E's dependence by chance."""
    if most < 1:
        return 0, 1.0
    chi = [_solve_E(points, away, order)[2] for order in range(most + 1)]
    p_values = [float(chi2.sf(chi[order] - chi[most], 9 * (most - order))) for order in range(most)]
    order = next((order for order in range(most) if p_values[order] >= BY_CHANCE), most)
    return order, p_values[0]


def _zero(
    points: Sequence[SessionPoint], away: np.ndarray, rests: RestFit | None, most: int
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """terms (Q + 1, 3), covariance of them and of the lags, turn-on scatter, lags (3,)."""
    values = np.array([point.values[BIAS] for point in points])
    own = np.array([point.covariance[BIAS, BIAS] for point in points])
    if rests is not None:
        terms, lag = zero_terms(rests.gyro), np.array([fit.tau_s for fit in rests.gyro])
        order = len(terms) - 1
        C = zero_covariance(rests.gyro, order)
        shape = sum((terms[n] * (away**n)[:, None] for n in range(1, order + 1)), np.zeros_like(values))
        design, free = np.ones((len(points), 1)), 1
        # What the shape is not known by, at the sessions' temperatures: axis by axis, all sessions together.
        powers = np.array([away**n for n in range(1, order + 1)]).reshape(order, len(points))
        known = [np.einsum("nk,nm,ml->kl", powers, C[3 + i : 3 * (order + 1) : 3, 3 + i : 3 * (order + 1) : 3], powers) for i in range(3)]
    else:
        order, lag, shape = _order_of_zero(values, own, away, most), np.zeros(3), np.zeros_like(values)
        design, free = away[:, None] ** np.arange(order + 1), order + 1
        C, known = np.zeros((3 * (order + 1) + 3,) * 2), [np.zeros((len(points),) * 2)] * 3
        terms = np.zeros((order + 1, 3))
    turn_on = _turn_on(values - shape, own, known, design) if len(points) > free else float("nan")
    spread = turn_on if np.isfinite(turn_on) else 0.0
    for i in range(3):
        V = np.diag(own[:, i, i] + spread**2) + known[i]
        W = np.linalg.solve(V, design)
        covariance = np.linalg.inv(design.T @ W)
        found = covariance @ W.T @ (values[:, i] - shape[:, i])
        rows = np.arange(free) * 3 + i
        terms[:free, i] = found
        if rests is None:
            C[np.ix_(rows, rows)] = covariance
            continue
        # The constant goes with the slopes that it was found beside.
        G = covariance @ W.T
        higher = np.arange(3 + i, 3 * (order + 1), 3)
        cross = -(G @ powers.T @ C[np.ix_(higher, higher)]).ravel()
        C[i, :], C[:, i] = 0.0, 0.0
        C[i, i] = float(covariance[0, 0])
        C[i, higher], C[higher, i] = cross, cross
    return terms, C, turn_on, lag


def _order_of_zero(values: np.ndarray, own: np.ndarray, away: np.ndarray, most: int) -> int:
    """Without rest logs: the lowest order beyond which nothing shows, sessions' own sigmas alone."""
    most = min(most, 3)

    def left(order: int) -> float:
        total = 0.0
        for i in range(3):
            sigma = np.sqrt(own[:, i, i])
            A = away[:, None] ** np.arange(order + 1) / sigma[:, None]
            z = values[:, i] / sigma
            total += float(np.sum((z - A @ np.linalg.lstsq(A, z, rcond=None)[0]) ** 2))
        return total

    chi = [left(order) for order in range(most + 1)]
    shows = (order for order in range(most) if chi2.sf(chi[order] - chi[most], 3 * (most - order)) >= BY_CHANCE)
    return next(shows, most)


def _turn_on(values: np.ndarray, own: np.ndarray, known: list[np.ndarray], design: np.ndarray) -> float:
    """The scatter that makes chi-square its degrees of freedom, all axes together; 0 where none is needed."""
    freedom = 3 * (len(values) - design.shape[1])

    def chi_square(variance: float) -> float:
        total = 0.0
        for i in range(3):
            V = np.diag(own[:, i, i] + variance) + known[i]
            W = np.linalg.solve(V, design)
            off = values[:, i] - design @ np.linalg.solve(design.T @ W, W.T @ values[:, i])
            total += float(off @ np.linalg.solve(V, off))
        return total

    if chi_square(0.0) <= freedom:
        return 0.0
    low, high = 0.0, float(np.var(values, axis=0).max()) * 10 + 1e-18
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if chi_square(middle) > freedom else (low, middle)
    return float(np.sqrt(high))


def _cross(points: Sequence[SessionPoint], count: int) -> np.ndarray:
    """(9, 3) of E's constants and the zero's: of the sessions' mean."""
    return sum((point.covariance[MATRIX, BIAS] for point in points), np.zeros((9, 3))) / count**2


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Of a positive matrix whose rows have very different units."""
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.pinv(matrix * np.outer(scale, scale), rcond=1e-14, hermitian=True) * np.outer(scale, scale)


def _possible(covariance: np.ndarray) -> np.ndarray:
    """The same with correlations that can be: cross terms were taken of a mean, and may be a little too large."""
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0, sigma, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    if values.min() >= 0:
        return covariance
    mended = (vectors * np.maximum(values, 0)) @ vectors.T
    return mended * np.outer(scale, scale)
