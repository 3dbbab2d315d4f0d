"""Four questions to today's recording, with one probability of a false alarm in total.

    r = -A d + sum_i c_i + noise          c_i: what is expected to differ (``expected_parts``)
    S = cov(r) if the calibration holds

Each question is about some of the 21 parameters, X_q = A Z_q, with all others that a fault may move free (N, columns of them):

    w = L^-1 r,   S = L L'        whitened
    t = U' (1 - Q Q') w           Q: orthonormal basis of L^-1 N;  U: of (1 - Q Q') L^-1 X_q, where a plausible change shows by a sigma
    T = t' t                      chi-square of rank(U) degrees of freedom if the calibration holds

So a changed bias raises no alarm for E, whatever its size.  The zero is tested by the rates at rest alone, where a change of E by 1 % is
part of S.  The fourth question is whether noise explains what no change of the
21 parameters does.  Of variances that are estimated, p is the probability of so large a T over draws of the true ones: v nu / chi^2_nu
of a spread between nu + 1 sessions (of one such variance alone, T / k is Fisher's F), (s + sigma z)^2 of a component of the noise.  The
level of each of m questions is that of Sidak, 1 - (1 - P)^(1/m).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri, fdtrc

from session.base.numeric import sigmas_in
from session.base.units import DEG, MG, G
from tinygc.estimation.spread import (
    ACCELEROMETER,
    COUNT,
    END_S,
    GYROSCOPE,
    USUAL_ACCEL_PER_K,
    USUAL_PER_K,
    ZERO,
    Spread,
    drift_between,
    walk_variance,
)
from tinygc.features.unit.verification.rows import CLOSURE, LENGTH, STILL, Rows
from tinygc.fitting.unit_state import UnitState
from tinygc.inference.choose import factors_by_freedom, factors_by_size, level_of_each, tail
from tinygc.inference.noise import block_of
from tinygc.inference.solve import left_of, orthonormal, root, solve_lower
from tinygc.models.linear import MATRIX, PRIOR_SIGMA
from tinygc.noise.components import TURN, SessionNoise
from tinygc.noise.whitening import OPEN_MPS2, PRECALIBRATION_MPS2

# What a calibration that holds may differ by from today: parts of variance, each with its source and its degrees of freedom.
#
# calibration     covariance of the old fit, of both sensors
# switch-on       2 spread^2 of each number: then and today are one draw each (``unit_state.spread_of``)
# wander          of B within one switch-on, where the unit's noise figures state it
# temperature     (coefficient x difference)^2 of B and of the accelerometer
# references      the Earth's unknown rate, gravity's length, a data rate that was not measured


@dataclass(frozen=True, eq=False)
class ExpectedPart:
    """One source: name; columns (n, k) of the rows for one sigma of each of its k numbers; into (21, k): the same of the parameters;
    freedom: degrees of freedom of its size; source, in words; assumed: whether its size is not this unit's own."""

    written = ("name", "source", "freedom", "assumed")
    name: str
    columns: np.ndarray
    into: np.ndarray
    freedom: float = float("inf")
    source: str = ""
    assumed: bool = False


def expected_parts(
    old: UnitState, rows: Rows, spread: Spread, *, switched_on: bool = True, elapsed_s: float | None = None
) -> list[ExpectedPart]:
    """Parts of what r may be without a fault, other than noise; spread: between sessions; switched_on: whether the sensor was, or may have
    been, switched off since then; elapsed_s: how long ago that was, None where not known."""
    instability = rows.twin.problem.instability if rows.twin is not None else None
    both = 0.0
    if not switched_on and elapsed_s is not None and instability is not None:  # the old session is taken to be as long as today's
        span, none = rows.duration_s, np.zeros(1)
        both = drift_between(none, none + span, span + elapsed_s, span, instability.rps).both
    parts, warmer_k = _of_calibration(old, rows, both), rows.warmer_than(old) or 0.0

    def add(name: str, which: slice, sigma: np.ndarray, source: str, assumed: bool, freedom: float = float("inf")) -> None:
        into = np.zeros((COUNT, len(sigma)))
        into[which] = np.diag(sigma)
        parts.append(ExpectedPart(name, rows.parameters @ into, into, freedom, source, assumed))

    if warmer_k:
        add(
            "temperature",
            ZERO,
            np.full(3, USUAL_PER_K * abs(warmer_k)),
            f"{abs(warmer_k):.1f} K apart, {USUAL_PER_K / DEG:g} dps/K as usual",
            True,
        )
    if not switched_on and old.figures is not None:
        add("wander", ZERO, np.sqrt(walk_variance(END_S if elapsed_s is None else elapsed_s, old.figures)), "drift since then", False)
    for k in np.flatnonzero(spread.scatter > 0) if switched_on else ():
        one, number = spread.at(slice(k, k + 1)), slice(k, k + 1)
        add("switch-on", number, np.sqrt(2) * one.scatter, one.source, one.is_usual, float(one.freedom[0]))
    allowed = max(PRECALIBRATION_MPS2, USUAL_ACCEL_PER_K * abs(warmer_k))
    sigma = np.r_[np.full(6, allowed / G), np.full(3, allowed)]
    add("accelerometer's temperature", ACCELEROMETER, sigma, "0.1 mg/K as usual", True)
    return [*parts, ExpectedPart("references", rows.known, np.zeros((COUNT, rows.known.shape[1])))]


def _of_calibration(old: UnitState, rows: Rows, both: float = 0.0) -> list[ExpectedPart]:
    """The old fit's own uncertainty.  The error of a given accelerometer is in gravity's length alone: E has taken up its other part.

    both: covariance, (rad/s)^2, of the drift in the old session and today: the old fit and today's noise each hold it once, and the
    difference of both does not.
    """
    known = old.joint.copy()
    known[ZERO, ZERO] -= 2 * both * np.eye(3)
    if not old.own_lengths:
        into = root(known)
        return [ExpectedPart("calibration", rows.parameters @ into, into, source="the old fit")]
    gyroscope, accelerometer = np.zeros((COUNT, 12)), np.zeros((COUNT, 9))
    gyroscope[GYROSCOPE] = root(known[GYROSCOPE, GYROSCOPE])
    accelerometer[ACCELEROMETER] = np.diag(sigmas_in(known[ACCELEROMETER, ACCELEROMETER]))
    in_lengths = np.zeros_like(rows.parameters)
    in_lengths[rows.kinds[LENGTH]] = rows.parameters[rows.kinds[LENGTH]]
    return [
        ExpectedPart("calibration", rows.parameters @ gyroscope, gyroscope, source="the old fit"),
        ExpectedPart("accelerometer's calibration", in_lengths @ accelerometer, accelerometer, source="0.1 mg, as given ones usually are"),
    ]


# The questions.

#: probability of any false alarm
FALSE_ALARM = 0.05
#: sizes of a change that a fault makes: 1 % of E, 1 dps, 1 % and 10 mg.  A direction in which such a change shows by less than a sigma is
#: not tested
PLAUSIBLE = np.zeros(COUNT)
PLAUSIBLE[ACCELEROMETER] = np.r_[np.full(6, 0.01), np.full(3, 10 * MG)]
PLAUSIBLE[GYROSCOPE] = np.r_[np.full(9, 0.01), np.full(3, DEG)]
#: draws of the estimated variances: the level of one question in four, 0.0127, is then known to 8 %
DRAWS = 20_000
#: the least probability that draws show
LEAST_P = 1 / (DRAWS + 1)
#: sigmas by which a plausible change of what is free shows at least, to be taken out
SHOWS = 0.1
#: of all variance of a question: what a component adds at most for its size to count as known
LEAST_SHARE = 1e-3
#: names of the questions
E, B, GRAVITY, NOISE = "E", "B", "gravity's length", "noise"


def todays_noise(rows: Rows) -> SessionNoise:
    """Estimate the noise beyond white, with all 21 parameters free, so that no fault counts as noise."""
    free = np.zeros(COUNT)
    free[GYROSCOPE] = PRIOR_SIGMA
    free[ACCELEROMETER] = np.r_[np.full(6, OPEN_MPS2 / G), np.full(3, OPEN_MPS2)]
    J = np.concatenate([rows.parameters * free, rows.known], axis=1)
    found = rows.noise.estimated(rows.white, rows.r, J, with_sigma=True)
    usual = np.array([component.usual for component in found.components])
    return replace(found, sigma=np.where(np.isfinite(found.sigma), found.sigma, np.maximum(found.s, usual)))


@dataclass(frozen=True, eq=False)
class Question:
    """An answer: name; statistic T; rank, its degrees of freedom, 0 where today's recording does not ask it; p_value; level of this
    question (``ask``); left_rps: of the fourth, rms rate that is left, rad/s."""

    name: str
    statistic: float
    rank: int
    p_value: float
    level: float = 0.0
    left_rps: float = 0.0

    @property
    def tested(self) -> bool:
        """Whether the recording tests it."""
        return self.rank > 0

    @property
    def chi_square(self) -> float:
        """What T would be with this p if all variances were known: chi-square of ``rank`` degrees of freedom, as it is printed."""
        return float(chdtri(self.rank, self.p_value)) if self.p_value > 0 else self.statistic

    @property
    def beyond_draws(self) -> bool:
        """Whether no draw reached T: p_value is then a bound."""
        return self.p_value == LEAST_P

    @property
    def holds(self) -> bool:
        """Whether nothing significant speaks against it."""
        return self.p_value >= self.level


def ask(rows: Rows, parts: Sequence[ExpectedPart], noise: SessionNoise, old: UnitState, false_alarm: float = FALSE_ALARM) -> list[Question]:
    """Ask all that today's recording can answer."""
    everything = np.arange(len(rows.r))
    matrix, zero, accelerometer = np.r_[GYROSCOPE][MATRIX], np.r_[ZERO], np.r_[ACCELEROMETER]
    expected = rows.covariance(noise) + sum((part.columns @ part.columns.T for part in parts), np.zeros_like(rows.white))
    found = [_ask(rows, expected, parts, noise, E, matrix, np.r_[zero, accelerometer], everything)]
    if rows.stills:  # the zero is what is read at rest, where a change of E is a hundredth of little
        at_rest = everything[rows.kinds[STILL]]
        columns = rows.parameters[:, matrix] * PLAUSIBLE[matrix]
        found.append(_ask(rows, expected + columns @ columns.T, parts, noise, B, zero, zero[:0], at_rest))
    else:
        found.append(_ask(rows, expected, parts, noise, B, zero, np.r_[matrix, accelerometer], everything))
    if old.accelerometer is not None:
        found.append(_ask(rows, expected, parts, noise, GRAVITY, accelerometer, np.r_[matrix, zero], everything))
    found.append(_left_over(rows, noise, old))
    level = level_of_each(false_alarm, sum(question.tested for question in found))
    return [replace(question, level=level) for question in found]


def _ask(
    rows: Rows,
    expected: np.ndarray,
    parts: Sequence[ExpectedPart],
    noise: SessionNoise,
    name: str,
    which: np.ndarray,
    free: np.ndarray,
    keep: np.ndarray,
) -> Question:
    """Ask about the parameters ``which`` of the 21, with those that are ``free``, in the rows ``keep``; expected (n, n): covariance of
    r."""
    factor = np.linalg.cholesky(expected[np.ix_(keep, keep)])
    X = solve_lower(factor, rows.parameters[np.ix_(keep, which)] * PLAUSIBLE[which])
    N = solve_lower(factor, rows.parameters[np.ix_(keep, free)] * PLAUSIBLE[free])
    w = solve_lower(factor, rows.r[keep])
    q = orthonormal(N, SHOWS, scaled=False)
    u = left_of(q, X, seen=1.0)
    if (k := u.shape[1]) == 0:
        return Question(name, 0.0, 0, 1.0)
    project = u.T - (u.T @ q) @ q.T
    t = project @ w
    estimated, known = [], np.eye(k)
    for number, part in enumerate(parts):
        if np.isfinite(part.freedom):
            own = project @ solve_lower(factor, part.columns[keep])
            known = known - own @ own.T
            estimated.append((own @ own.T, factors_by_freedom(part.freedom, number, DRAWS)))
    for number, (component, s, sigma) in enumerate(zip(noise.components, noise.s, noise.sigma, strict=True)):
        carried = project @ solve_lower(factor, solve_lower(factor, block_of(component.V, keep)).T) @ project.T
        if np.trace(carried) * (s + sigma) ** 2 > LEAST_SHARE:
            known = known - s**2 * carried
            estimated.append((carried, factors_by_size(s, sigma, number, DRAWS)))
    statistic = float(t @ t)
    return Question(name, statistic, k, tail(statistic, known, estimated))


def _left_over(rows: Rows, noise: SessionNoise, old: UnitState) -> Question:
    """Whether noise explains the turns' closure, and the rates at rest, beyond any change of the 21 parameters.

    Rates at rest are tested by the noise that the old fit found in them: today's own would take up a zero that differs from rest to rest.
    Without turns they are tested in any case.
    A fit that left more than noise before may do so again: its own ratio of chi-square to degrees of freedom is then the yardstick.
    """
    part = slice(0, rows.kinds[LENGTH].start) if old.at_rest or not rows.turns else rows.kinds[CLOSURE]
    keep = np.arange(len(rows.r))[part][~rows.blank[part]]
    # Without the independent error of each turn, which would take up any misfit.
    total, of_old = rows.covariance(noise.without(TURN)) + rows.known @ rows.known.T, []
    for component, s in zip(noise.components, noise.s, strict=True):
        if component.name in old.at_rest:
            variance, known = old.at_rest[component.name]
            V = block_of(component.V, np.arange(len(total)))
            total = total + (variance - s**2) * V
            of_old.append((variance * V, known))
    columns, matrix = rows.parameters * PLAUSIBLE, np.r_[GYROSCOPE][MATRIX]
    if not rows.turns:  # rates at rest differ too little to ask for E: any factor on them would explain a jump
        total = total + columns[:, matrix] @ columns[:, matrix].T
        columns[:, matrix] = 0.0
    factor = np.linalg.cholesky(total[np.ix_(keep, keep)])
    q = orthonormal(solve_lower(factor, columns[keep]), 1e-9)
    freedom = len(keep) - q.shape[1]
    if freedom < 1:
        return Question(NOISE, 0.0, 0, 1.0)
    w = solve_lower(factor, rows.r[keep])
    left = w - q @ (q.T @ w)
    chi_square, left_rps = float(np.sum(left**2)), float(np.sqrt(np.sum((factor @ left / rows.spans_s[keep]) ** 2) / freedom))
    # The expected square of each row is a mixture, whose degrees of freedom are those of its parts by their shares (Welch–Satterthwaite).
    whitened = [(solve_lower(factor, solve_lower(factor, own[np.ix_(keep, keep)]).T), known) for own, known in of_old]
    shares = [(float(np.trace(own)) / len(keep), known) for own, known in whitened]
    ratio, other = chi_square / freedom, 1 / (1 / rows.noise_freedom + sum(share**2 / known for share, known in shares))
    if old.goodness is not None and old.goodness[1] > 0 and (before := old.goodness[0] / old.goodness[1]) > 1:
        ratio, other = ratio / before, 1 / (1 / other + 1 / old.goodness[1])
    return Question(NOISE, chi_square, freedom, float(fdtrc(freedom, other, ratio)), left_rps=left_rps)
