"""When to calibrate next: how far the unit will be from its last calibration, and until when that meets a requirement with 95 %.

    difference(t) = level + drift t + scatter of that switch-on + shocks since - last calibration

is drawn from the history: for each number s from its pivot (``between_sessions``), level and drift by generalised least squares
from values that are disturbed by their own errors, correlated as the fits state, and by a scatter of s.  A drift is in it with its sigma,
whether it is significant or not.  Shocks come at the rate of those that were found, with their rms size; where none was found none is
predicted.  Nothing is stated beyond the last session by more than the history is long.

A requirement holds where 95 % of the draws meet it.  Their share counts whatever is not known of level, drift and s, so that a smaller one
may only mean that the sessions are few.  It does not hold where the chance is below 95 % for 95 % of the levels, drifts and s that the
history leaves possible, each by draws of scatter and shocks alone.  Between the two it is undecided.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

from session.base.errors import CalibrationError
from session.base.units import DEG, MG
from tinygc.closure.motion import at_rest
from tinygc.estimation.between_sessions import COVERAGE, FEWEST_WITH_DRIFT
from tinygc.estimation.session_times import YEAR_S
from tinygc.features.unit.history.estimate import UnitHistory
from tinygc.features.unit.history.sessions import GYROSCOPE, KEPT, NUMBERS
from tinygc.inference.decide import FAILS, HOLDS, UNDECIDED, Answer
from tinygc.inference.solve import root
from tinygc.models.linear import LinearModel, field_jacobian

#: draws of the prediction: a share of 95 % has a sigma of 0.34 %
DRAWS = 4000
#: moments of the history's length at which the share is computed
MOMENTS = 61
#: levels, drifts and scatters of which each one's chance of meeting a requirement is computed, and draws for each
CHANCES, OF_CHANCE = 200, 1000
#: shocks that one draw may have until its end
MOST_SHOCKS = 12
ACCURACY = re.compile(r"([0-9]{1,9}(?:\.[0-9]{1,9})?) ?(deg|°|mrad|rad) ?/ ?([0-9]{1,9}(?:\.[0-9]{1,9})?) ?(s|min)")
LIMIT = re.compile(r"([a-z][a-z ]{1,60}?) +([0-9]{1,9}(?:\.[0-9]{1,9})?) ?([a-z%°/]{1,10})")
ANGLES = {"deg": DEG, "°": DEG, "mrad": 1e-3, "rad": 1.0}
#: units of a limit, by the unit in which the number is shown
UNITS: dict[str, dict[str, float]] = {
    "ppm": {"ppm": 1e-6, "%": 1e-2},
    "mrad": {"mrad": 1e-3, "deg": DEG, "°": DEG},
    "dps": {"dps": DEG, "mdps": 1e-3 * DEG, "°/s": DEG, "°/h": DEG / 3600},
    "mg": {"mg": MG, "ug": 1e-3 * MG},
}


@dataclass(frozen=True, eq=False)
class Requirement:
    """text: as it was given; limit in SI: of the attitude error at the end of a motion (seconds at rest), or of each of these numbers."""

    text: str
    limit: float
    numbers: tuple[int, ...] = ()
    seconds: float = 0.0


def parse_accuracy(text: str) -> Requirement:
    """``1deg/60s``.  Raises CalibrationError."""
    found = ACCURACY.fullmatch(text.strip()[:80])
    if found is None or not float(found[1]) > 0 or not float(found[3]) > 0:
        raise CalibrationError(f"--accuracy {text[:80]!r}: expected an angle and a time, such as 1deg/60s")
    return Requirement(text.strip(), float(found[1]) * ANGLES[found[2]], (), float(found[3]) * (60 if found[4] == "min" else 1))


def parse_limit(text: str) -> Requirement:
    """``bias 50 mdps``.  Raises CalibrationError."""
    names = list(dict.fromkeys(number.name for number in NUMBERS))
    found = LIMIT.fullmatch(" ".join(text.lower().split())[:90])
    places = tuple(i for i, number in enumerate(NUMBERS) if found is not None and number.name == found[1])
    unit = None if found is None or not places else UNITS[NUMBERS[places[0]].unit].get(found[3])
    if found is None or not places or unit is None or not float(found[2]) > 0:
        raise CalibrationError(
            f"--require {text[:80]!r}: expected a name, a limit and its unit, such as 'bias 50 mdps'; names are {', '.join(names)}"
        )
    return Requirement(" ".join(text.split()), float(found[2]) * unit, places)


@dataclass(frozen=True, eq=False, kw_only=True)
class Outlook(Answer):
    """Whether the last calibration meets a requirement, today (``HOLDS``, ``FAILS`` or ``UNDECIDED``), and until when.

    until: the last day on which it holds with 95 %, None where that is not known or it does not hold at all; beyond: whether it holds to
    the end of the forecast, which is as long as the history; shares (M,) at years (M,) after the last session: probability that it is met.
    """

    requirement: Requirement
    until: datetime | None = None
    beyond: bool = False
    years: np.ndarray
    shares: np.ndarray


@dataclass(frozen=True, eq=False)
class Draws:
    """Differences (M, 21) SI of the unit from its last calibration: at its next switch-on, and their growth a year; shocks.

    level, scatter (M, 21): what ``now`` was drawn from; arrivals (M, A) years after the last session, sizes (M, A, 21).  NaN where the
    last session does not show a number, or two do not.
    """

    level: np.ndarray
    scatter: np.ndarray
    now: np.ndarray
    growth: np.ndarray
    arrivals: np.ndarray
    sizes: np.ndarray

    def shocks(self, years: float) -> np.ndarray:
        """(M, 21) changes by the shocks of so many years after the last session."""
        return np.einsum("ma,maq->mq", (self.arrivals <= years).astype(float), self.sizes)

    def after(self, years: float) -> np.ndarray:
        """(M, 21) differences so many years after the last session."""
        return self.now + years * self.growth + self.shocks(years)

    def if_known(self, years: float) -> Iterator[np.ndarray]:
        """(``OF_CHANCE``, 21) of the same, for each of ``CHANCES`` levels, drifts and scatters that the history leaves possible."""
        normal = np.random.default_rng(0).normal(size=(OF_CHANCE, len(NUMBERS)))
        shocks = self.shocks(years)[:OF_CHANCE]
        for level, scatter, growth in zip(self.level[:CHANCES], self.scatter, self.growth, strict=False):
            yield level + years * growth + scatter * normal + shocks


def _draws_of(history: UnitHistory) -> Draws:
    """Draw differences from the last calibration."""
    rng, count = np.random.default_rng(0), DRAWS
    n, Q = len(history.sessions), len(NUMBERS)
    errors = np.zeros((count, n, Q))
    for j, session in enumerate(history.sessions):
        known = np.isfinite(session.sigmas)
        size = session.sigmas[known]
        factor = np.linalg.cholesky(session.covariance[np.ix_(known, known)] / np.outer(size, size) + 1e-12 * np.eye(len(size)))
        errors[:, j, known] = rng.normal(size=(count, len(size))) @ factor.T * size
    level, spread, growth = np.full((count, Q), np.nan), np.zeros((count, Q)), np.zeros((count, Q))
    for q, each in enumerate(history.numbers):
        if each.course is None or each.sessions[-1] != n - 1:
            continue
        model = each.course.model
        square = model.squares_at(rng.uniform(size=count))
        scatter = np.sqrt(square)
        disturbed = model.values + errors[:, each.sessions, q] + scatter[:, None] * rng.normal(size=(count, len(each.values)))
        to_coefficients, _ = model.weighted(square)
        drawn = np.einsum("kpn,kn->kp", to_coefficients, disturbed)
        level[:, q], spread[:, q], growth[:, q] = drawn[:, 0] - each.values[-1], scatter, drawn @ each.course.drift_column
    shared = history.sessions[-1].shared
    if np.any(shared):
        level[:, :GYROSCOPE] += rng.normal(size=(count, GYROSCOPE)) @ root(shared)
    return Draws(level, spread, level + spread * rng.normal(size=(count, Q)), growth, *_shocks(history, rng, count))


def _shocks(history: UnitHistory, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Arrivals and sizes of shocks at the rate of those found."""
    intervals = {step.interval for step in history.steps}
    if not intervals or history.span_years is None:
        return np.zeros((count, 0)), np.zeros((count, 0, len(NUMBERS)))
    rate = len(intervals) / history.span_years
    arrivals = np.cumsum(rng.exponential(1 / rate, size=(count, MOST_SHOCKS)), axis=1)
    square = np.zeros(len(NUMBERS))
    for step in history.steps:
        square[NUMBERS.index(step.number)] += step.size**2 / len(intervals)
    return arrivals, rng.normal(size=(count, MOST_SHOCKS, len(NUMBERS))) * np.sqrt(square)


def outlooks_of(history: UnitHistory, requirements: Sequence[Requirement], today: datetime | None = None) -> tuple[Outlook, ...]:
    """Until when the last calibration meets each requirement; today: now by default."""
    if not requirements:
        return ()
    draws = None if len(history.sessions) < 2 else _draws_of(history)
    return tuple(_outlook(history, each, draws, today or datetime.now(UTC)) for each in requirements)


def _outlook(history: UnitHistory, requirement: Requirement, draws: Draws | None, today: datetime) -> Outlook:
    last = history.sessions[-1].moment

    def without(kind: str, why: str, shares: Sequence[float] = ()) -> Outlook:
        return Outlook(kind, why, requirement=requirement, years=np.zeros(len(shares)), shares=np.array(shares))

    if draws is None:
        return without(UNDECIDED, "one session shows no scatter; fit another one at least")
    within = meets(history, requirement, draws)
    if within is None:
        return without(UNDECIDED, "the last session does not show these numbers, or no other one does")

    def share(years: float) -> float:
        return float(np.mean(within(draws.after(years))))

    def fails(years: float) -> bool:
        return float(np.quantile([np.mean(within(each)) for each in draws.if_known(years)], COVERAGE)) < COVERAGE

    at_once = share(0.0)
    if at_once < COVERAGE:
        answer = FAILS if fails(0.0) else UNDECIDED
        few = "" if answer == FAILS else "; fit more sessions"
        return without(answer, f"met at the next switch-on with {100 * at_once:.0f} %, not 95 %{few}", [at_once])
    if not history.dated or last is None:
        return without(UNDECIDED, f"met at the next switch-on ({100 * at_once:.0f} %); until when needs dates", [at_once])
    if len(history.sessions) < FEWEST_WITH_DRIFT:
        few = f"met at the next switch-on ({100 * at_once:.0f} %); until when needs {FEWEST_WITH_DRIFT} sessions"
        return without(UNDECIDED, few, [at_once])
    span = float(history.at[-1])
    years = np.linspace(0.0, span, MOMENTS)
    shares = np.array([share(each) for each in years])
    over = np.flatnonzero(shares < COVERAGE)
    until, beyond = span, not len(over)
    if not beyond:
        k = int(over[0])
        until = float(np.interp(COVERAGE, [shares[k], shares[k - 1]], [years[k], years[k - 1]]))
    day, now = last.when + timedelta(seconds=until * YEAR_S), (today - last.when).total_seconds() / YEAR_S
    if now <= until:
        answer, reason = HOLDS, f"until {day.date()}{' or later' * beyond} (95 %)"
    else:
        answer = FAILS if not beyond and fails(min(now, span)) else UNDECIDED
        reason = f"last safe date {day.date()}"
    return Outlook(answer, reason, requirement=requirement, until=day, beyond=beyond, years=years, shares=shares)


def meets(history: UnitHistory, requirement: Requirement, draws: Draws) -> Callable[[np.ndarray], np.ndarray] | None:
    """Function from differences (M, 21) to whether each meets the requirement (M,); None where a number that counts is not known."""
    unknown = np.isnan(draws.level).any(axis=0)
    if requirement.numbers:
        places = list(requirement.numbers)
        return None if unknown[places].any() else lambda difference: np.all(np.abs(difference[:, places]) <= requirement.limit, axis=1)
    slope = attitude_slope(history, requirement.seconds)
    if (unknown[:GYROSCOPE] & (np.abs(slope) > 1e-6).any(axis=0)).any():
        return None
    return lambda difference: np.linalg.norm(np.nan_to_num(difference[:, :GYROSCOPE]) @ slope.T, axis=1) <= requirement.limit


def attitude_slope(history: UnitHistory, seconds: float) -> np.ndarray:
    """(3, 12) rad per unit: error of the attitude after so many seconds at rest by each of the gyroscope's numbers."""
    vector = history.sessions[-1].vector
    model = LinearModel.from_vector(vector)
    return at_rest(model, seconds).slope(model) @ np.linalg.inv(field_jacobian(vector)[KEPT])
