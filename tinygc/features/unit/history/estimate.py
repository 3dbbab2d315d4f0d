"""One unit over its sessions: level, drift, steps and scatter of each of its numbers, and the spread of its bias between sessions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from session.base.texts import printable, significant
from tinygc.estimation.between_sessions import LOOKED_AT, TRIED, Between, Course, candidates, course, jump
from tinygc.estimation.session_times import times_of
from tinygc.estimation.spread import ACCELEROMETER, Spread
from tinygc.estimation.spread import ZERO as B_OF_21
from tinygc.features.unit.history.sessions import GYROSCOPE, NUMBERS, ZERO, Number, UnitSession
from tinygc.fitting.unit_state import spread_of_values
from tinygc.inference.choose import each_alone
from tinygc.models.linear import BIAS

assert len(NUMBERS) == LOOKED_AT
#: difference of -2 log of two likelihoods between which there is no "positive" evidence (Kass & Raftery 1995)
AS_GOOD = 2.0
#: a year beyond this many times the history's length is no statement on the unit
LONGEST_YEAR = 10.0


@dataclass(frozen=True)
class FoundStep:
    """A change of a number that stays.

    between sessions ``before`` and ``after``, by their names; size and sigma in SI; p_value, corrected for all that was looked at.
    """

    number: Number
    before: str
    after: str
    interval: int
    size: float
    sigma: float
    p_value: float


@dataclass(frozen=True, eq=False)
class NumberHistory:
    """A number over the sessions that show it.

    sessions (n,): their places in the history; values, sigmas (n,) SI; course: what they show together, None of fewer than two.
    """

    number: Number
    sessions: np.ndarray
    values: np.ndarray
    sigmas: np.ndarray
    course: Course | None

    @property
    def scatter(self) -> float | None:
        """From session to session, one sigma, SI."""
        return None if self.course is None else self.course.model.scatter

    @property
    def scatter_interval(self) -> tuple[float, float] | None:
        """Of 95 %, SI; from 0 it is a limit."""
        return None if self.course is None else self.course.model.scatter_interval

    @cached_property
    def drift(self) -> tuple[float, float] | None:
        """Drift and its sigma (68 %), SI a year, or a session where there are no dates."""
        if self.course is None or not self.course.has_drift:
            return None
        slope = self.course.drift_column
        return float(self.course.model.coefficients @ slope), self.course.model.sigma(slope)

    @cached_property
    def drift_limit(self) -> float | None:
        """The drift is smaller than this, either way, with 95 %."""
        if self.course is None or not self.course.has_drift:
            return None
        return float(np.max(np.abs(self.course.model.interval(self.course.drift_column))))

    @cached_property
    def drift_or_step(self) -> int | None:
        """Of a significant drift: the session of this number after which a step would explain the values as well; None where none would.

        As well: -2 log of the likelihood, at the scatter that the drift leaves, is at most ``AS_GOOD`` more.
        """
        if self.course is None or not self.course.drifts:
            return None
        model, drift = self.course.model, int(np.argmax(self.course.drift_column))
        root = (model.own + model.scatter**2)[:, None] ** -0.5
        jumps = [jump(len(self.values), k) for k in range(len(self.values) - 1)]
        straight = root * np.delete(model.design, drift, axis=1)
        pull, information = each_alone(root[:, 0] * model.values, straight, root * np.column_stack([*jumps, model.design[:, drift]]))
        gain = pull**2 / information
        best = int(np.nanargmax(gain[:-1]))
        return best if gain[best] >= gain[-1] - AS_GOOD else None

    @cached_property
    def step_limit(self) -> float | None:
        """A step in any one interval, other than those found, is smaller than this with 95 %; None of too few sessions."""
        if self.course is None or not self.course.has_drift:
            return None
        model = self.course.model
        if model.freedom < 2:
            return None
        size, sigma = candidates(model.values, model.own, model.design)
        reach = np.where(np.isfinite(size), np.abs(size) + 2 * sigma, -1.0)
        limits = []
        for before in np.argsort(-reach)[:TRIED]:
            if reach[before] >= 0:
                design = np.column_stack([model.design, jump(len(self.values), int(before))])
                column = np.eye(design.shape[1])[-1]
                limits.append(np.max(np.abs(Between(model.values, model.own, design).interval(column))))
        return float(max(limits)) if limits else None

    @cached_property
    def warmth(self) -> tuple[float, float, float] | None:
        """Effect of temperature, its sigma, SI per K, and its limit (95 %); None where the sessions' temperatures do not show it."""
        if self.course is None or (model := self.course.warming) is None:
            return None
        column = np.array([0.0, 0.0, 1.0])
        return float(model.coefficients @ column), model.sigma(column), float(np.max(np.abs(model.interval(column))))


@dataclass(frozen=True, eq=False)
class UnitHistory:
    """The history of one unit.

    sessions in order; at (n,) years since the first, or their order where a date is missing (``dated``); numbers in the order of
    ``NUMBERS``; any_session: spread of B between sessions, as ``fit --history`` has it, None of one session; remarks.
    """

    model: str
    serial: str
    sessions: tuple[UnitSession, ...]
    at: np.ndarray
    dated: bool
    numbers: tuple[NumberHistory, ...]
    any_session: Spread | None
    remarks: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """``ASM330LHH 17``."""
        return f"{self.model} {self.serial}".strip()

    @property
    def accelerometer_any_session(self) -> np.ndarray | None:
        """(9,) SI, in the order of ``NUMBERS``: one sigma of the accelerometer's numbers in any other session, from the last one's; None
        where fewer than two sessions show them."""
        triad = self.numbers[GYROSCOPE:]
        models = [each.course.model for each in triad if each.course is not None]
        if len(models) < len(triad):
            return None
        counted, freedom = ([getattr(each, name) for each in models] for name in ("counted", "freedom"))
        spread = Spread.of(ACCELEROMETER, counted, "sessions of this unit", freedom).at(ACCELEROMETER)
        return spread.any_session(np.array([each.sigmas[-1] for each in triad]) ** 2)

    @property
    def accelerometer_words(self) -> str | None:
        """``scale ± 120 90 200 ppm, bias ± 1.2 0.5 2.8 mg``; None where they are not known."""
        sigma = self.accelerometer_any_session
        if sigma is None:
            return None
        numbers = NUMBERS[GYROSCOPE:]
        shown = {"scale": [0, 1, 2], "bias": [6, 7, 8]}
        parts = [
            f"{word} ± {' '.join(significant(sigma[i] / numbers[i].si, 2) for i in which)} {numbers[which[0]].unit}"
            for word, which in shown.items()
        ]
        return ", ".join(parts)

    @property
    def span_years(self) -> float | None:
        """From the first session to the last; None without dates."""
        return float(self.at[-1]) if self.dated else None

    @property
    def drift_time(self) -> str:
        """What a drift is stated for: ``year``, or ``session`` without dates."""
        return "year" if self.dated else "session"

    @property
    def is_year_stated(self) -> bool:
        """Whether the history is long enough for a drift per year."""
        return self.dated and LONGEST_YEAR * float(self.at[-1]) >= 1.0

    @cached_property
    def steps(self) -> tuple[FoundStep, ...]:
        """All that were found, the most significant first."""
        found = []
        for each in self.numbers:
            if each.course is None:
                continue
            for place, (at, p_value) in enumerate(each.course.steps.items()):
                model, column = each.course.model, each.course.step_column(place)
                before, after = (printable(self.sessions[each.sessions[i]].name) for i in (at, at + 1))
                size = float(model.coefficients @ column)
                found.append(FoundStep(each.number, before, after, int(each.sessions[at]), size, model.sigma(column), p_value))
        return tuple(sorted(found, key=lambda step: step.p_value))


def history_of(sessions: Sequence[UnitSession]) -> UnitHistory:
    """Estimate the history of one unit from its sessions, in any order."""
    order, at = times_of([session.moment for session in sessions])
    ordered = tuple(sessions[i] for i in order)
    dated = all(session.moment is not None for session in ordered) and len({s.moment.when for s in ordered if s.moment}) > 1
    remarks: tuple[str, ...] = ()
    if len(ordered) > 1 and not dated:
        undated = [session.name for session in ordered if session.moment is None]
        why = f"{undated[0]} has no date" if undated else "all sessions have one date"
        remarks = (f"{why}: no drift a year; give notes.date in session.toml, or --dates",)
    values, covariances = (np.array([getattr(session, name) for session in ordered]) for name in ("values", "covariance"))
    warmth = np.array([np.nan if session.temperature_c is None else session.temperature_c for session in ordered])
    numbers = []
    for q, number in enumerate(NUMBERS):
        shown = np.flatnonzero(np.isfinite(values[:, q]))
        own = covariances[shown, q, q]
        warm = warmth[shown] if ZERO.start <= q < ZERO.stop and np.isfinite(warmth[shown]).all() else None
        found = course(values[shown, q], own, at[shown], warm) if len(shown) > 1 and np.ptp(at[shown]) > 0 else None
        numbers.append(NumberHistory(number, shown, values[shown, q], np.sqrt(own), found))
    spread = None
    if len(ordered) > 1:
        biases, own = np.array([session.vector[BIAS] for session in ordered]), np.array([session.stated[BIAS, BIAS] for session in ordered])
        spread = spread_of_values(B_OF_21, biases, own, ordered, "sessions of this unit").at(B_OF_21)
    return UnitHistory(ordered[0].model, ordered[0].serial, ordered, at, dated, tuple(numbers), spread, remarks)
