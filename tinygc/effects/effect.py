"""The record of an effect: parameters, columns, correction, occurrence, picture.  All other parts read this record."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from session.base.units import DEG
from tinygc.effects.device import MOST_PASSES, NONE, PASSES, DeviceCode
from tinygc.effects.movement import INPUT_REACH, INPUTS, NOWHERE, EffectError, Movement, Reach, shown

# Time of occurrence: for an effect found in the registers or in the stills, the JSON parameter that contains the times.

#: rows of all logs together, seconds of the session, numbers of stills, or the readings that stand at a level
ROWS, SECONDS, IN_STILLS, LEVEL = "rows", "seconds", "stills", "level"


@dataclass(frozen=True)
class Occurrence:
    """The times of an event: key of the JSON parameter, and the unit that it counts in."""

    key: str
    counts: str


# Gauges: combinations of an effect's parameters that the closure does not determine, and the rule that determines them instead.
# They are declared here and applied where there is a recording.


@dataclass(frozen=True, eq=False)
class Convention:
    """A rule that chooses among parameters that no recording can distinguish.

    settle(theta) -> theta (P,) by the rule; slope(theta) -> (P, P), its derivative there, which propagates the covariance;
    delays: entries of theta (for x, y, z) that to first order delay an axis, if any.
    """

    settle: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]
    delays: tuple[int, ...] = ()


@dataclass(frozen=True)
class CommonDelay:
    """Entries of theta that to first order delay x, y and z.

    The closure hardly observes their common part; gravity during the turns does.
    late: +1 where a positive entry is a delay, -1 where it is an advance; never_negative: for a lag, whose common part the closure
    observes through its square alone.  It is moved only where it would be negative or gravity contradicts it, as far as the closure allows.
    """

    delays: tuple[int, int, int]
    late: float = 1.0
    never_negative: bool = False


GaugeConvention = Convention | CommonDelay


# Reference conditions of a law's constants, for testing an effect: elsewhere the effect may be zero.


@dataclass(frozen=True)
class ReferenceConditions:
    """Conditions of the test session: full scale fs_rps, which its turns reach; first_temp_c, where its warm-up begins."""

    fs_rps: float = 500 * DEG
    first_temp_c: float = 25.0


ANYWHERE = ReferenceConditions()


# An effect's numbers: its parameter, the quantity displayed instead of it, and one shape number that is found by a search.


@dataclass(frozen=True)
class Parameter:
    """A fitted parameter: name in the JSON; shape; display unit and its size in SI; plausible: a wide prior sigma, SI."""

    name: str
    shape: tuple[int, ...]
    unit: str
    si: float = 1.0
    plausible: float = 1.0

    @cached_property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape))


@dataclass(frozen=True, eq=False)
class Derived:
    """A quantity that the JSON contains instead of the parameter: name with its unit, and ``of``, from theta (P,) SI to that number.

    Its std follows from theta's covariance to first order.
    """

    name: str
    unit: str
    of: Callable[[np.ndarray], float]

    def values(self, theta: np.ndarray, covariance: np.ndarray) -> tuple[dict, dict]:
        """JSON parameters and their std, of theta (P,) with covariance (P, P)."""
        small = 1e-3 * np.linalg.norm(theta)
        steps = np.eye(len(theta))
        slope = np.array([(self.of(theta + small * e) - self.of(theta - small * e)) / (2 * small) for e in steps])
        return {self.name: self.of(theta)}, {self.name: float(np.sqrt(slope @ covariance @ slope))}


@dataclass(frozen=True, eq=False)
class Parts:
    """A parameter that the JSON splits into several quantities.

    parts: names with their units, the size of each unit in SI, and the quantity's indices in theta; observable: the projection
    (P, P) onto the observable part of theta.
    """

    parts: tuple[tuple[str, float, tuple[int, ...]], ...]
    observable: np.ndarray

    def values(self, theta: np.ndarray, covariance: np.ndarray) -> tuple[dict, dict]:
        """JSON parameters and their std, of theta (P,) with covariance (P, P)."""
        theta, covariance = self.observable @ theta, self.observable @ covariance @ self.observable.T
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0))
        shown, spread = ({name: (x[list(at)] / si).tolist() for name, si, at in self.parts} for x in (theta, sigma))
        return shown, spread

    def theta(self, parameters: dict) -> np.ndarray:
        """Return theta (P,) SI from JSON parameters."""
        found = np.zeros(sum(len(at) for _, _, at in self.parts))
        for name, si, at in self.parts:
            found[list(at)] = np.multiply(parameters[name], si)
        return found


@dataclass(frozen=True, eq=False)
class Scan:
    """A nonlinear shape number, such as the time of a step, that is found by a grid search.

    name in the JSON; display unit and its size in SI; make(value) -> the ``Effect`` with that value, SI;
    grid(movements) -> the values (K,), SI, to try on a recording, increasing; by default the middles of its turns, s of the session;
    smooth: the effect varies smoothly with the value, as with a time constant; the value's uncertainty then widens the parameters'
    stated std.
    """

    name: str
    unit: str
    make: Callable[[float], Any]
    si: float = 1.0
    grid: Callable[[Sequence[Movement]], np.ndarray] | None = None
    smooth: bool = False


# What a file states of the recording in which its law was found: another recording of the unit must agree.

#: p-value below which two recordings' numbers differ: one of a thousand pairs that agree
DIFFERENT_P = 1e-3


@dataclass(frozen=True, eq=False)
class StatedNumbers:
    """theta (P,) SI and covariance (P, P) of one recording, with all else free; shape: of a scanned shape, its value and sigma, SI."""

    theta: np.ndarray
    covariance: np.ndarray
    shape: tuple[float, float] | None = None

    def against(self, theta: np.ndarray, covariance: np.ndarray, value: float | None = None) -> tuple[float, int]:
        """Chi-square, and its degrees of freedom, of another recording's theta (P,) with covariance (P, P) and value of the scanned shape,
        whose sigma is taken to be the stated one."""
        variance, axes = np.linalg.eigh(self.covariance + covariance)
        seen = variance > 1e-9 * variance[-1]  # not what a gauge fixes
        chi_square, freedom = float(np.sum((axes.T @ (theta - self.theta))[seen] ** 2 / variance[seen])), int(seen.sum())
        if self.shape is None or value is None:
            return chi_square, freedom
        return chi_square + (value - self.shape[0]) ** 2 / (2 * self.shape[1] ** 2), freedom + 1


# How an effect is plotted: the name of a pair of panels.

#: pairs of panels: the mismatch in the stills or in the turns, and a second view of it
STILLS, TURNS = "stills", "turns"
CLIPPED_TURN, FALSE_READINGS, LOST_SAMPLES = "clipped turn", "false readings", "lost samples"
CREEPING_STILLS, CLOCKS, GRAVITY_LENGTH = "creeping stills", "clocks", "gravity's length"
#: as ``GRAVITY_LENGTH``, drawn along the effect's ``conditions``
GRAVITY_LAW = "gravity's law"
WORLD, EARTH = "a rate fixed in the world", "the Earth's rate"
#: pairs for laws that turns show, for an effect with one parameter for each axis: a scale error along its conditions, a lag (also of a
#: matrix), a bias along its conditions; and the loss in a log that is sampled too slowly
SCALE_LAW, LAG_LAW, ENERGY_LAW, DATA_RATE = "scale law", "lag law", "energy law", "data rate"
PAIRS = (
    *(STILLS, TURNS, CLIPPED_TURN, FALSE_READINGS, LOST_SAMPLES, CREEPING_STILLS, CLOCKS, GRAVITY_LENGTH, GRAVITY_LAW, WORLD, EARTH),
    *(SCALE_LAW, LAG_LAW, ENERGY_LAW, DATA_RATE),
)
#: conditions that only turns have
OF_TURNS = ("rate", "angular acceleration", "vibration")


# The record of an effect; all that the other parts of the tool know of one effect is in it.
#
# An effect describes what it adds to the true rate of the sensing element, before the linear errors: the calibrated rate E m + B is
# ``rate + add(rate)``.  Parameters are SI inside; ``Parameter`` has their display name and unit.

#: JSON value of an effect that acts on the readings
READINGS = "readings"
KINDS = ("rate", "force", "earth", "register", "motion", "reference")
OBSERVABLE_IN = ("still", "turn", "reference", "timing")
#: effects that a format with a matrix or a slope can store: add = K f, theta (9,) per g row by row; add = k (T - T0), theta (3,)
LINEAR_IN = ("force", "temperature")


@dataclass(frozen=True, eq=False, repr=False)
class Effect:
    """One entry of the catalogue.

    id; equation; parameter; observable_in: some of "still", "turn", "reference", "timing";
    columns(movement) -> (N, 3, P): the rate per SI unit of each parameter, linear, for model selection;
    describe(theta) -> one plain sentence for the operator; discriminating_motion: the movement that separates it from similar effects;
    kind: "rate", or what it changes instead: "force" (the reference), "earth" (the Earth's rate in the forward model), "register" (found
    and repaired before any fit), "motion" (motion that the readings miss: it adds variance to the closure and cannot be corrected),
    "reference" (a further reference of the recording).

    Inputs.  inputs: members of ``INPUTS`` that it reads in addition to the rate; reach: how far around a sample it reads, or
    reach(theta) where that depends on its parameters.

    Exact forms.  exact_correct(measured, movement, theta) -> (N, 3): the rate without the effect; by default ``distort`` is inverted by
    repeated substitution in ``passes`` passes: by default three where it has a reach, else until each sample converges.
    exact_distort(movement, theta) -> (N, 3): the rate with the effect; by default from ``columns``.
    basis(movement) -> (N, K): for a bias of each axis that follows K known curves at any rate: ``columns`` without the zero entries.
    Parameter i * 3 + axis is the coefficient of curve i; a parameter of shape (3, K) has a row for each axis.
    bends(movement) -> (N, 3, P): for kind "force", m/s^2 that one SI unit of each parameter adds to the measured specific force; the
    movement has the measured force and the declared inputs, at each sample or in the middle of each still.

    Numbers.  scan: a shape number found by a search; shape: its value here, by JSON name; derived: the quantity in the JSON instead
    of the parameter; begin: where a refit begins, SI: zero, unless zero is a saddle; known_to: relative uncertainty of the variable that
    it follows, which no residual shows; it widens the stated std; gauge_convention: what the closure does not determine;
    occurs: for a register effect, the parameter that contains the times.

    Use.  conditions: variable and unit that it is plotted and located along; picture: a name of ``PAIRS``;
    of_readings: the same effect acting on the readings, after the linear errors; ``on_readings``: whether this is that form.
    wider: the same cause with more numbers.  Model selection compares these forms with the effect.
    reference_conditions: full scale and temperature of its constants, where it is tested.
    stated: the numbers of the recording in which the law was found, which another must agree with.
    device: its C, or why there is none; linear_in: "force" or "temperature" where a format's matrix or slope can store it.

    Raises EffectError for an invalid declaration.
    """

    id: str
    equation: str
    parameter: Parameter
    observable_in: tuple[str, ...]
    columns: Callable[[Movement], np.ndarray]
    describe: Callable[[np.ndarray], str]
    discriminating_motion: str
    kind: str = "rate"
    inputs: tuple[str, ...] = ()
    reach: Reach | Callable[[np.ndarray], Reach] = NOWHERE
    conditions: tuple[str, str] | None = None
    scan: Scan | None = None
    shape: dict = field(default_factory=dict)
    derived: Derived | Parts | None = None
    begin: float = 0.0
    known_to: float = 0.0
    gauge_convention: GaugeConvention | None = None
    occurs: Occurrence | None = None
    exact_correct: Callable[[np.ndarray, Movement, np.ndarray], np.ndarray] | None = None
    exact_distort: Callable[[Movement, np.ndarray], np.ndarray] | None = None
    passes: int | None = None
    basis: Callable[[Movement], np.ndarray] | None = None
    bends: Callable[[Movement], np.ndarray] | None = None
    picture: str | None = None
    device: DeviceCode = NONE
    linear_in: str | None = None
    stated: StatedNumbers | None = None
    of_readings: Effect | None = None
    wider: Effect | None = None
    reference_conditions: ReferenceConditions = ANYWHERE
    on_readings: bool = False

    def __post_init__(self) -> None:
        known = isinstance(self.id, str) and re.fullmatch(r"[a-z]+\.[a-z][a-z0-9_]*", self.id)
        self._require(known, "id", 'a string such as "gyro.scale_quadratic"')
        self._require(isinstance(self.parameter, Parameter), "parameter", "a Parameter")
        self._require(self.kind in KINDS, "kind", f"one of {', '.join(KINDS)}")
        somewhere = _some_of(self.observable_in, OBSERVABLE_IN) and self.observable_in
        self._require(somewhere, "observable_in", f"a tuple of some of {', '.join(OBSERVABLE_IN)}")
        self._require(_some_of(self.inputs, INPUTS), "inputs", f"a tuple of some of {', '.join(INPUTS)}")
        self._require(isinstance(self.reach, Reach) or callable(self.reach), "reach", "a Reach, or a function of theta that gives one")
        self._require(all(map(callable, (self.columns, self.describe))), "columns or describe", "functions")
        for name in ("equation", "discriminating_motion"):
            self._require(isinstance(getattr(self, name), str), name, "text")
        self._require((self.kind == "force") == (self.bends is not None), "bends", 'a function where kind is "force", else None')
        self._require(self.scan is None or isinstance(self.scan, Scan), "scan", "a Scan")
        fixed = self.gauge_convention is None or isinstance(self.gauge_convention, GaugeConvention)
        self._require(fixed, "gauge_convention", "a Convention or a CommonDelay")
        self._require(isinstance(self.reference_conditions, ReferenceConditions), "reference_conditions", "a ReferenceConditions")
        counted = self.passes is None or (type(self.passes) is int and 1 <= self.passes <= MOST_PASSES)
        self._require(counted, "passes", f"a number from 1 to {MOST_PASSES}, or None")
        self._require(isinstance(self.device, DeviceCode), "device", "a PerAxisC, MatrixC, StageC or NoC")
        self._require(self.picture is None or self.picture in PAIRS, "picture", f"one of {', '.join(PAIRS)}")
        size = {None: self.parameter.size, "force": 9, "temperature": 3}.get(self.linear_in)
        self._require(size == self.parameter.size, "linear_in", f"one of {', '.join(LINEAR_IN)}, of 9 or 3 parameters")

    def __repr__(self) -> str:
        return f"Effect({self.id!r}" + "".join(f", {name}={value!r}" for name, value in self.shape.items()) + ")"

    def _require(self, fine: object, name: str, expected: str) -> None:
        if not fine:
            raise EffectError(f"effect {self.id!r}: {name} is {getattr(self, name, 'something else')!r}, expected {expected}")

    def distort(self, movement: Movement, theta: np.ndarray) -> np.ndarray:
        """Return the rate (N, 3) rad/s with the effect.  Raises EffectError where the effect reads an input that it does not declare."""
        return self._distorted(self.shown(movement), theta)

    def _distorted(self, movement: Movement, theta: np.ndarray) -> np.ndarray:
        if self.exact_distort is not None:
            return self.exact_distort(movement, theta)
        if self.basis is not None:
            return movement.rate + self.basis(movement) @ self.shares(theta)
        columns = self.columns(movement)
        return movement.rate + (columns.reshape(-1, len(theta)) @ theta).reshape(-1, 3)  # one flat product: many times faster

    def correct(self, measured: np.ndarray, movement: Movement, theta: np.ndarray) -> np.ndarray:
        """Return the rate (N, 3) rad/s without the effect; ``movement.rate`` is where the search begins."""
        movement = self.shown(movement)
        if self.exact_correct is not None:
            return self.exact_correct(measured, movement, theta)
        if self.basis is not None:
            return measured - self.basis(movement) @ self.shares(theta)
        from tinygc.effects.inversion import substituted  # late: no effect is undone in most fits

        return substituted(measured, movement, lambda moved: self._distorted(moved, theta) - moved.rate, self._passes)

    def bent(self, movement: Movement) -> np.ndarray:
        """Return ``bends`` (N, 3, P) m/s^2, of a movement with the measured force.  Raises EffectError as ``distort``."""
        assert self.bends is not None  # of kind "force"
        return self.bends(shown(self.id, ("force", *self.inputs), False, movement))

    @property
    def _passes(self) -> int | None:
        """Number of substitutions; None where no row uses its neighbours, so that each may go on until it converges."""
        return self.passes if self.passes is not None or not self.reach else PASSES

    @property
    def has_rows(self) -> bool:
        """Whether the parameters of a basis have a row for each axis."""
        return self.parameter.shape[0] == 3 and len(self.parameter.shape) == 2

    def shares(self, theta: np.ndarray) -> np.ndarray:
        """Return the coefficients (K, 3) of each curve of the basis, for each axis."""
        return theta.reshape(3, -1).T if self.has_rows else theta.reshape(-1, 3)

    def shown(self, movement: Movement) -> Movement:
        """Return the movement with only the fields that the effect may read."""
        return shown(self.id, self.inputs, bool(self.reach), movement)

    def total_reach(self, theta: np.ndarray) -> Reach:
        """Return how far around a sample the corrected rate depends on the log, including the means in its inputs."""
        reach = self.reach if isinstance(self.reach, Reach) else self.reach(theta)
        once = self.exact_correct is not None or self.basis is not None
        return sum((INPUT_REACH.get(name, NOWHERE) for name in self.inputs), reach.times(1 if once else self._passes or 1))

    @property
    def needs_rate_hz(self) -> bool:
        """Whether it depends on the sampling rate."""
        return bool(self.reach) or "time" in self.inputs or any(name in INPUT_REACH for name in self.inputs)

    @property
    def of_one_session(self) -> bool:
        """Whether it follows the time of the session that it was fitted to, and so does not apply to any other."""
        return "time" in self.inputs

    @property
    def partly_observed(self) -> bool:
        """Whether closure does not observe a part of it, other than a delay: as a turn about the vertical, so that no yaw is proved."""
        return isinstance(self.gauge_convention, Convention) and not self.gauge_convention.delays

    def at(self, value: float) -> Effect:
        """Return the effect with its scanned shape at a value, SI."""
        assert self.scan is not None  # callers check it
        made = self.scan.make(float(value))
        if not isinstance(made, Effect) or made.id != self.id or made.parameter.size != self.parameter.size:
            raise EffectError(f"{self.id}: scan.make must give an Effect with the same id and parameter, got {made!r:.80}")
        return replace(made, scan=self.scan, shape={self.scan.name: float(value) / self.scan.si})

    def variants(self, values: np.ndarray) -> list[Effect]:
        """Return one effect for each value (K,), SI, of a scanned shape; the effect itself without one, in all of its forms."""
        if self.scan is not None:
            return [self.at(value) for value in values]
        return [self, *(form for form in (self.of_readings, self.wider) if form is not None)]

    def moved_to_readings(self, equation: str) -> Effect:
        """Return the same effect acting after the linear errors instead of before them."""
        return replace(self, equation=equation, on_readings=True, shape={**self.shape, "of": READINGS})

    @property
    def pair(self) -> str:
        """Return its picture: the one declared, or a default for where it is observable; stills do not show what only turns have."""
        turning = self.conditions is not None and self.conditions[0] in OF_TURNS
        return self.picture or (STILLS if "still" in self.observable_in and not turning else TURNS)


def _some_of(names: object, known: Container[str]) -> bool:
    return isinstance(names, tuple) and all(isinstance(name, str) and name in known for name in names)


# An effect with its parameters, as a model corrects it and a state of the physics contains it.


@dataclass(frozen=True, eq=False)
class AppliedEffect:
    """An effect with its parameters theta (P,), SI."""

    effect: Effect
    theta: np.ndarray

    def __post_init__(self) -> None:
        if self.theta.shape != (self.effect.parameter.size,):
            raise ValueError(f"{self.effect.id}: theta has shape {self.theta.shape}, expected ({self.effect.parameter.size},)")
