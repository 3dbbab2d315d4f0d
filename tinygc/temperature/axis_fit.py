"""One axis' zero over temperature: polynomial, lag, hysteresis, what is left, and how well each is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from session.common.robust import sigma_of_steps
from tinygc.temperature.candidates import Candidate, Examined, best_lag, columns, examine, lag_grid, misfit
from tinygc.temperature.coloured import Coloured, estimate_noise, whiten
from tinygc.temperature.hysteresis import Hysteresis, hysteresis_of
from tinygc.temperature.knots import Knots

#: the probability by chance below which a dependence on temperature, or a lag, is claimed
BY_CHANCE = 0.001
#: orders that are tried
ORDERS = (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True, eq=False)
class AxisFit:
    """zero(T) = sum_n terms[n] (T_e - reference)^n, SI, T_e the element's temperature by ``tau_s``.

    terms (P + 1,) per degC^n; covariance (P + 2, P + 2) of terms and tau_s, whose row is zero without a lag; examined: what was tried;
    held_out: rms of what sweeps that were left out differ from the prediction, the model's remaining uncertainty; left: rms of what the
    fit leaves; p_value that there is no dependence; noise beside it; hysteresis of the polynomial alone, and after the lag (None: the
    temperature went one way only); turn_on: scatter of the logs' zeros, NaN of one log.
    """

    terms: np.ndarray
    tau_s: float
    covariance: np.ndarray
    examined: Examined
    held_out: float
    left: float
    p_value: float
    noise: Coloured
    hysteresis_before: Hysteresis | None
    hysteresis_after: Hysteresis | None
    turn_on: float

    @property
    def order(self) -> int:
        """Of the polynomial."""
        return len(self.terms) - 1

    @property
    def sigma(self) -> np.ndarray:
        """(P + 2,) of terms, then tau_s."""
        return np.sqrt(np.diag(self.covariance))

    def held_out_of(self, order: int, lagged: bool) -> float:
        """Held-out rms of another candidate; NaN where it was not tried."""
        wanted = Candidate(order, lagged)
        if wanted not in self.examined.candidates:
            return float("nan")
        return float(np.sqrt(self.examined.held_out[:, self.examined.candidates.index(wanted)].mean()))


def fit_axis(knots: Knots, blocks: np.ndarray, orders: tuple[int, ...] = ORDERS, with_lag: bool = True) -> AxisFit:
    """Of one axis' block means (B,) rad/s, or m/s^2, at rest."""
    y, V = knots.mean(blocks), knots.covariances()
    unit = float(np.std(y)) or 1.0  # the search for the noise wants numbers near 1
    y = y / unit
    orders = tuple(p for p in orders if p <= _most_order(knots))
    lags = lag_grid(knots) if with_lag and max(orders) else np.zeros(0)
    white = float(sigma_of_steps(blocks / unit)) * np.sqrt(knots.logs[0].block_s)
    every, most, tau = slice(None), max(orders), 0.0
    noise = estimate_noise(y, columns(knots, 0.0, most), V, white)
    if len(lags):
        tau = best_lag(knots, y, noise.factor(), every, lags, most)
        noise = estimate_noise(y, columns(knots, tau, most), V, white)
    examined = examine(knots, y, noise, orders, lags)
    chosen = examined.candidates[examined.chosen]
    L = noise.factor()
    if chosen.lagged:
        tau = best_lag(knots, y, L, every, lags, chosen.order)
        if not _lag_shows(knots, y, L, tau, chosen.order):
            chosen = Candidate(chosen.order, False)
    tau = tau if chosen.lagged else 0.0
    coefficients, covariance = _solve(knots, y, noise, tau, chosen)
    p_value, needed = _none_by_chance(knots, y, V, white, chosen, tau), chosen.order
    if p_value >= BY_CHANCE:
        needed = 0
    # What was held out may like a higher order by luck: those above must differ from zero, too.
    while needed and _by_chance(coefficients, covariance, len(knots.logs), needed - 1, chosen.order) >= BY_CHANCE:
        needed -= 1
    if needed < chosen.order:
        chosen = Candidate(needed, chosen.lagged and needed > 0)
        tau = tau if chosen.lagged else 0.0
    if not needed:
        noise = estimate_noise(y, columns(knots, 0.0, 0), V, white)
    coefficients, covariance = _solve(knots, y, noise, tau, chosen)
    residual = y - columns(knots, tau, chosen.order) @ coefficients[: len(knots.logs) + chosen.order]
    plain = y - columns(knots, 0.0, chosen.order) @ _solve(knots, y, noise, 0.0, Candidate(chosen.order, False))[0]
    terms, of_terms = _in_degrees(knots, coefficients, covariance, chosen)
    zeros = coefficients[: len(knots.logs)]
    scale = np.append(np.full(len(terms), unit), 1.0)
    index = examined.candidates.index(chosen)
    return AxisFit(
        terms=terms * unit,
        tau_s=tau,
        covariance=of_terms * np.outer(scale, scale),
        examined=Examined(examined.candidates, examined.held_out * unit**2, index, examined.by),
        held_out=float(np.sqrt(examined.held_out[:, index].mean())) * unit,
        left=float(np.sqrt(np.mean(residual**2))) * unit,
        p_value=p_value,
        noise=Coloured(noise.sizes * unit, noise.C * unit**2),
        hysteresis_before=hysteresis_of(knots, plain * unit, noise.C * unit**2),
        hysteresis_after=hysteresis_of(knots, residual * unit, noise.C * unit**2),
        turn_on=float(np.std(zeros, ddof=1)) * unit if len(zeros) > 1 else float("nan"),
    )


def _most_order(knots: Knots) -> int:
    """None without a range of temperatures; fewer than knots in any case."""
    return 0 if np.ptp(knots.temp_c) < 1.0 else max(len(knots) // 4, 0)


def _lag_shows(knots: Knots, y: np.ndarray, L: np.ndarray, tau: float, order: int) -> bool:
    """Whether a lag leaves less than none does by more than chance; two degrees of freedom, for its sign and size were looked for."""
    white = whiten(L, y)
    without, lagged = (misfit(white, whiten(L, columns(knots, value, order))) for value in (0.0, tau))
    return bool(chi2.sf(without - lagged, 2) < BY_CHANCE)


def _solve(knots: Knots, y: np.ndarray, noise: Coloured, tau: float, chosen: Candidate) -> tuple[np.ndarray, np.ndarray]:
    """Zeros of the logs and coefficients of x, x^2, …, then tau's change where there is a lag, and their covariance.

    Every estimate is linear in the knots, so its covariance follows from theirs: coefficients with equal weights, the lag with those of
    the noise; and the coefficients move with the lag.
    """
    A = columns(knots, tau, chosen.order)
    G = np.linalg.pinv(A)
    coefficients = G @ y
    if chosen.lagged:
        step = 0.02 * abs(tau)
        slope = (columns(knots, tau + step, chosen.order) - columns(knots, tau - step, chosen.order)) @ coefficients / (2 * step)
        L = noise.factor()
        W = whiten(L, np.column_stack([A, slope]))
        of_lag = (np.linalg.pinv(W)[-1:] @ whiten(L, np.eye(len(y)))).ravel()
        G = np.vstack([G - np.outer(G @ slope, of_lag), of_lag])
    return coefficients, G @ noise.C @ G.T


def _none_by_chance(knots: Knots, y: np.ndarray, V: list[np.ndarray], white: float, chosen: Candidate, tau: float) -> float:
    """Probability of as good a fit by chance where temperature does nothing: by the ratio of likelihoods, the noise estimated for each.

    With the noise of the polynomial alone a slow wander passes for temperature: what one fit takes for the trend, the other's noise
    explains (benchmarks/temperature.py, nulls).
    """
    if not chosen.order:
        return 1.0
    values = []
    for order, lag in ((0, 0.0), (chosen.order, tau)):
        A = columns(knots, lag, order)
        L = estimate_noise(y, A, V, white).factor()
        values.append(2 * float(np.sum(np.log(np.diag(L)))) + misfit(whiten(L, y), whiten(L, A)))
    return float(chi2.sf(values[0] - values[1], chosen.order + 2 * chosen.lagged))


def _by_chance(coefficients: np.ndarray, covariance: np.ndarray, logs: int, above: int, order: int) -> float:
    """Probability of such coefficients of the powers beyond ``above`` by chance where they are zero (Wald)."""
    if order <= above:
        return 1.0
    part = slice(logs + above, logs + order)
    pull = np.linalg.solve(covariance[part, part], coefficients[part])
    return float(chi2.sf(coefficients[part] @ pull, order - above))


def _in_degrees(knots: Knots, coefficients: np.ndarray, covariance: np.ndarray, chosen: Candidate) -> tuple[np.ndarray, np.ndarray]:
    """terms (P + 1,) per degC^n, the first the mean of the logs' zeros, and the covariance (P + 2, P + 2) of them and the lag."""
    logs, order = len(knots.logs), chosen.order
    map_ = np.zeros((order + 2, len(covariance)))
    map_[0, :logs] = 1 / logs
    map_[np.arange(1, order + 1), logs + np.arange(order)] = knots.half_c ** -np.arange(1.0, order + 1)
    if chosen.lagged:
        map_[-1, -1] = 1.0
    return map_[:-1, : len(coefficients)] @ coefficients, map_ @ covariance @ map_.T
