"""What an effect declares of itself: parameters, columns, correction, occurrence, picture.  All other parts read this record."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from session.io.units import DEG
from tinygc.effects.device import NONE, PASSES, DeviceCode
from tinygc.effects.inversion import MOST_PASSES, substituted
from tinygc.effects.movement import INPUT_REACH, INPUTS, NOWHERE, EffectError, Movement, Reach, shown

# When it happened: of an effect that is found in the registers or in the stills, which of its JSON parameters tells the moments.

#: rows of all logs together, seconds of the session, numbers of stills, or the readings that stand at a level
ROWS, SECONDS, IN_STILLS, LEVEL = "rows", "seconds", "stills", "level"


@dataclass(frozen=True)
class Occurrence:
    """key of the parameter, and what it counts."""

    key: str
    counts: str


# What the closure cannot fix of an effect's parameters, and what fixes it instead: declared here, done where there is a recording.


@dataclass(frozen=True, eq=False)
class Convention:
    """Parameters that differ by what no recording shows; a rule chooses among them.

    settle(theta) -> theta (P,) by the rule; slope(theta) -> (P, P), its derivative there, which the covariance follows;
    delays: entries of theta (for x, y, z) that to first order delay an axis, where there are such.
    """

    settle: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]
    delays: tuple[int, ...] = ()


@dataclass(frozen=True)
class CommonDelay:
    """Entries of theta that to first order delay x, y and z: what they share the closure hardly sees; gravity in the turns does.

    late: +1 where a positive entry is late, -1 where it is early; never_negative: of a lag, whose common part the closure sees by its
    square alone: it is moved only where it would be negative or gravity contradicts it, and as far as the closure allows.
    """

    delays: tuple[int, int, int]
    late: float = 1.0
    never_negative: bool = False


Gauge = Convention | CommonDelay


# Where a law's numbers were found, for what proves an effect: elsewhere it may do nothing at all.


@dataclass(frozen=True)
class FoundAt:
    """Of the session: full scale fs_rps, to which its turns go; first_temp_c, from which it warms up."""

    fs_rps: float = 500 * DEG
    first_temp_c: float = 25.0


ANYWHERE = FoundAt()


# An effect's numbers: its parameter, what a person reads instead of it, and one shape number that is searched for.


@dataclass(frozen=True)
class Parameter:
    """name in the JSON; shape; unit for a person and its size in SI; plausible: a generous sigma, SI, that keeps a fit from wandering."""

    name: str
    shape: tuple[int, ...]
    unit: str
    si: float = 1.0
    plausible: float = 1.0

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return int(np.prod(self.shape))


@dataclass(frozen=True, eq=False)
class Derived:
    """What the JSON says instead of the parameter: name with its unit, and ``of``, from theta (P,) SI to that number.

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
    """What the JSON says of a parameter whose numbers are of several kinds: names with their units, the size of each unit in SI, and where
    its numbers stand in theta.  told: the projection (P, P) on what any recording tells of theta."""

    parts: tuple[tuple[str, float, tuple[int, ...]], ...]
    told: np.ndarray

    def values(self, theta: np.ndarray, covariance: np.ndarray) -> tuple[dict, dict]:
        """JSON parameters and their std, of theta (P,) with covariance (P, P)."""
        theta, covariance = self.told @ theta, self.told @ covariance @ self.told.T
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0))
        shown, spread = ({name: (x[list(at)] / si).tolist() for name, si, at in self.parts} for x in (theta, sigma))
        return shown, spread

    def theta(self, parameters: dict) -> np.ndarray:
        """(P,) SI of JSON parameters."""
        found = np.zeros(sum(len(at) for _, _, at in self.parts))
        for name, si, at in self.parts:
            found[list(at)] = np.multiply(parameters[name], si)
        return found


@dataclass(frozen=True, eq=False)
class Scan:
    """A shape number beside the parameter that no linear fit can find, such as the moment of a step: it is searched on a grid.

    name in the JSON; unit for a person and its size in SI; make(value) -> the ``Effect`` with that value, SI;
    grid(movements) -> the values (K,), SI, to try on a recording, increasing; without it the middles of its turns, s of the session;
    smooth: what the effect adds changes smoothly with the value, as with a time constant: the value's own uncertainty then widens the
    parameters' stated std.
    """

    name: str
    unit: str
    make: Callable[[float], Any]
    si: float = 1.0
    grid: Callable[[Sequence[Movement]], np.ndarray] | None = None
    smooth: bool = False


# How an effect is drawn: the name of a pair of panels that there is, or a function that draws its own from plain data.

#: pairs of panels: where the mismatch lives, and a second look at it
STILLS, TURNS = "stills", "turns"
CLIPPED_TURN, FALSE_READINGS, LOST_SAMPLES = "clipped turn", "false readings", "lost samples"
CREEPING_STILLS, CLOCKS, GRAVITY_LENGTH = "creeping stills", "clocks", "gravity's length"
WORLD, EARTH = "a rate fixed in the world", "the Earth's rate"
#: laws that turns show, of an effect with one parameter for each axis: a scale error along the regime, a lag (of a matrix, too), a zero
#: along the regime; and what a log loses that is sampled too slowly
SCALE_LAW, LAG_LAW, ENERGY_LAW, DATA_RATE = "scale law", "lag law", "energy law", "data rate"
PAIRS = (
    *(STILLS, TURNS, CLIPPED_TURN, FALSE_READINGS, LOST_SAMPLES, CREEPING_STILLS, CLOCKS, GRAVITY_LENGTH, WORLD, EARTH),
    *(SCALE_LAW, LAG_LAW, ENERGY_LAW, DATA_RATE),
)
#: regimes that only turns have
OF_TURNS = ("rate", "angular acceleration", "vibration")


@dataclass(frozen=True, eq=False)
class PictureData:
    """What an effect's own picture is handed, of Q stills and S segments of one explained recording; SI, in the sensor's axes.

    theta (P,); parameters and std as in the JSON; variable, unit: what the effect's regime names, in people's units, its mean in each
    still of_stills (Q,) and its greatest in each segment of_segments (S,); stills_s (Q,) s, the middle of each still;
    before, after (Q, 3) rad/s: rate in each still beyond the prediction, without the effect and with it; says (Q, 3) rad/s: what the
    effect adds in each still; numbers (S,) of the segments; closure_says, closure_recorded (S, d) rad: what it adds to the closure of
    each segment, and what the recording has of it; floor_rad: rms closure that noise alone leaves.
    """

    theta: np.ndarray
    parameters: dict
    std: dict
    variable: str
    unit: str
    of_stills: np.ndarray
    of_segments: np.ndarray
    stills_s: np.ndarray
    before: np.ndarray
    after: np.ndarray
    says: np.ndarray
    numbers: np.ndarray
    closure_says: np.ndarray
    closure_recorded: np.ndarray
    floor_rad: float


#: (data, left axes, right axes) -> None, axes of matplotlib
OwnPicture = Callable[[PictureData, Any, Any], None]


# What an effect declares of itself; everything that any other part of the tool knows of one effect is in this record.
#
# An effect describes what it adds to the true rate that the element feels, before the linear errors: the calibrated rate E m + B is
# ``rate + add(rate)``.  Parameters are SI inside; ``Parameter`` knows the unit and the name in which a person reads them.

#: what the JSON says of an effect that happens to the readings
READINGS = "readings"
KINDS = ("rate", "force", "earth", "register", "motion", "truth")
SEEN_IN = ("still", "turn", "reference", "timing")
#: what a format with a matrix or a slope can carry: add = K f, theta (9,) per g row by row; add = k (T - T0), theta (3,)
LINEAR_IN = ("force", "temperature")


@dataclass(frozen=True, eq=False, repr=False)
class Effect:
    """One entry of the catalogue.

    id; equation; parameter; seen_in: some of "still", "turn", "reference", "timing";
    columns(movement) -> (N, 3, P): what each parameter adds to the rate per SI unit, linear, for naming;
    says(theta) -> one plain sentence for the operator; splits: the movement that tells it from its lookalikes;
    kind: "rate", or what it bends instead: "force" (the reference), "earth" (the Earth's rate in the forward model), "register" (what
    is found, and mended, before any fit), "motion" (nothing: what the readings miss of the motion itself adds variance to the closure, and
    nothing undoes it), "truth" (a truth file).

    What it looks at.  inputs: some of ``INPUTS`` that it reads beside the rate; reach: how far around a sample it looks, or
    reach(theta) where that depends on its parameters.

    Exact forms.  exact_correct(measured, movement, theta) -> (N, 3): the rate freed of the effect; without it ``distort`` is undone by
    repeated substitution (``undo``), in as many ``passes`` as it declares: by itself three where it has a reach, else until each sample
    stands still.  exact_distort(movement, theta) -> (N, 3): the rate with the effect; without it ``columns`` are all.
    basis(movement) -> (N, K): where the zero of each axis follows K known curves whatever the rate: the same as ``columns``, without the
    zeros.  Parameter i * 3 + axis is the share of curve i; a parameter of shape (3, K) has a row for each axis.
    bends(force_g (N, 3)) -> (N, 3, P): of kind "force", what each parameter adds to the specific force that is measured, linear.

    Its numbers.  scan: a shape number that is searched for; shape: its value here, by JSON name; derived: what the JSON says instead
    of the parameter; begin: where a refit begins, SI: zero, unless zero is a saddle; known_to: share to which the variable that it
    follows can be known, which no residual shows: it widens the stated std; gauge: what the closure cannot fix of it;
    occurs: of a register effect, which parameter tells the moments.

    In use.  regime: variable and unit that it is drawn and located along; picture: a name of ``picture.PAIRS`` or a function;
    of_readings: the same effect where it happens to the readings, after the linear errors: both are weighed; ``on_readings``: that form.
    wider: the same cause with more numbers; both are weighed.  found_at: full scale and temperature to which its constants belong, where
    the proof of an effect tries it.
    device: its C, or why there is none; linear_in: "force" or "temperature" where a format's matrix or slope can carry it.

    Raises EffectError for a declaration that cannot be.
    """

    id: str
    equation: str
    parameter: Parameter
    seen_in: tuple[str, ...]
    columns: Callable[[Movement], np.ndarray]
    says: Callable[[np.ndarray], str]
    splits: str
    kind: str = "rate"
    inputs: tuple[str, ...] = ()
    reach: Reach | Callable[[np.ndarray], Reach] = NOWHERE
    regime: tuple[str, str] | None = None
    scan: Scan | None = None
    shape: dict = field(default_factory=dict)
    derived: Derived | Parts | None = None
    begin: float = 0.0
    known_to: float = 0.0
    gauge: Gauge | None = None
    occurs: Occurrence | None = None
    exact_correct: Callable[[np.ndarray, Movement, np.ndarray], np.ndarray] | None = None
    exact_distort: Callable[[Movement, np.ndarray], np.ndarray] | None = None
    passes: int | None = None
    basis: Callable[[Movement], np.ndarray] | None = None
    bends: Callable[[np.ndarray], np.ndarray] | None = None
    picture: str | OwnPicture | None = None
    device: DeviceCode = NONE
    linear_in: str | None = None
    of_readings: Effect | None = None
    wider: Effect | None = None
    found_at: FoundAt = ANYWHERE
    on_readings: bool = False

    def __post_init__(self) -> None:
        known = isinstance(self.id, str) and re.fullmatch(r"[a-z]+\.[a-z][a-z0-9_]*", self.id)
        self._require(known, "id", 'a string such as "gyro.scale_quadratic"')
        self._require(isinstance(self.parameter, Parameter), "parameter", "a Parameter")
        self._require(self.kind in KINDS, "kind", f"one of {', '.join(KINDS)}")
        self._require(_some_of(self.seen_in, SEEN_IN) and self.seen_in, "seen_in", f"a tuple of some of {', '.join(SEEN_IN)}")
        self._require(_some_of(self.inputs, INPUTS), "inputs", f"a tuple of some of {', '.join(INPUTS)}")
        self._require(isinstance(self.reach, Reach) or callable(self.reach), "reach", "a Reach, or a function of theta that gives one")
        self._require(all(map(callable, (self.columns, self.says))), "columns or says", "functions")
        self._require(all(isinstance(text, str) for text in (self.equation, self.splits)), "equation or splits", "text")
        self._require((self.kind == "force") == (self.bends is not None), "bends", 'a function where kind is "force", else None')
        self._require(self.scan is None or isinstance(self.scan, Scan), "scan", "a Scan")
        self._require(self.gauge is None or isinstance(self.gauge, Gauge), "gauge", "a Convention or a CommonDelay")
        self._require(isinstance(self.found_at, FoundAt), "found_at", "a FoundAt")
        counted = self.passes is None or (type(self.passes) is int and 1 <= self.passes <= MOST_PASSES)
        self._require(counted, "passes", f"a number from 1 to {MOST_PASSES}, or None")
        self._require(isinstance(self.device, DeviceCode), "device", "a PerAxisC, MatrixC, StageC or NoC")
        named = self.picture is None or callable(self.picture) or self.picture in PAIRS
        self._require(named, "picture", f"a function, or one of {', '.join(PAIRS)}")
        size = {None: self.parameter.size, "force": 9, "temperature": 3}.get(self.linear_in)
        self._require(size == self.parameter.size, "linear_in", f"one of {', '.join(LINEAR_IN)}, of 9 or 3 parameters")

    def __repr__(self) -> str:
        return f"Effect({self.id!r}" + "".join(f", {name}={value!r}" for name, value in self.shape.items()) + ")"

    def _require(self, fine: object, name: str, expected: str) -> None:
        if not fine:
            raise EffectError(f"effect {self.id!r}: {name} is {getattr(self, name, 'something else')!r}, expected {expected}")

    def distort(self, movement: Movement, theta: np.ndarray) -> np.ndarray:
        """The rate (N, 3) rad/s that the element reports for the true one.  EffectError where it reads what it does not declare."""
        return self._distorted(self.shown(movement), theta)

    def _distorted(self, movement: Movement, theta: np.ndarray) -> np.ndarray:
        if self.exact_distort is not None:
            return self.exact_distort(movement, theta)
        if self.basis is not None:
            return movement.rate + self.basis(movement) @ self.shares(theta)
        columns = self.columns(movement)
        return movement.rate + (columns.reshape(-1, len(theta)) @ theta).reshape(-1, 3)  # one flat product: many times faster

    def correct(self, measured: np.ndarray, movement: Movement, theta: np.ndarray) -> np.ndarray:
        """The true rate (N, 3) rad/s behind the calibrated one; ``movement.rate`` is where the search begins."""
        movement = self.shown(movement)
        if self.exact_correct is not None:
            return self.exact_correct(measured, movement, theta)
        if self.basis is not None:
            return measured - self.basis(movement) @ self.shares(theta)
        return substituted(measured, movement, lambda moved: self._distorted(moved, theta) - moved.rate, self._passes)

    @property
    def _passes(self) -> int | None:
        """Of substitution; None where no row looks around, so that each may go on until it stands still."""
        return self.passes if self.passes is not None or not self.reach else PASSES

    @property
    def has_rows(self) -> bool:
        """Whether the parameters of a basis are a row for each axis."""
        return self.parameter.shape[0] == 3 and len(self.parameter.shape) == 2

    def shares(self, theta: np.ndarray) -> np.ndarray:
        """(K, 3): of each curve of the basis, in each axis."""
        return theta.reshape(3, -1).T if self.has_rows else theta.reshape(-1, 3)

    def shown(self, movement: Movement) -> Movement:
        """What of a movement the effect may read."""
        return shown(self.id, self.inputs, bool(self.reach), movement)

    def looks(self, theta: np.ndarray) -> Reach:
        """How far around a sample the rate freed of the effect depends on the log, its inputs' own means counted."""
        reach = self.reach if isinstance(self.reach, Reach) else self.reach(theta)
        once = self.exact_correct is not None or self.basis is not None
        return sum((INPUT_REACH.get(name, NOWHERE) for name in self.inputs), reach.times(1 if once else self._passes or 1))

    @property
    def needs_rate_hz(self) -> bool:
        """Whether the sampling rate matters to it."""
        return bool(self.reach) or "time" in self.inputs or any(name in INPUT_REACH for name in self.inputs)

    @property
    def of_one_session(self) -> bool:
        """Whether it follows the time of the session that it was fitted to, and so says nothing of any other."""
        return "time" in self.inputs

    def at(self, value: float) -> Effect:
        """The effect with its scanned shape at a value, SI."""
        assert self.scan is not None  # who has a value for it has seen it
        made = self.scan.make(float(value))
        if not isinstance(made, Effect) or made.id != self.id or made.parameter.size != self.parameter.size:
            raise EffectError(f"{self.id}: scan.make must give an Effect with the same id and parameter, got {made!r:.80}")
        return replace(made, scan=self.scan, shape={self.scan.name: float(value) / self.scan.si})

    def variants(self, values: np.ndarray) -> list[Effect]:
        """One effect for each value (K,), SI, of a scanned shape; the effect itself where it has none, in all of its forms."""
        if self.scan is not None:
            return [self.at(value) for value in values]
        return [self, *(form for form in (self.of_readings, self.wider) if form is not None)]

    def moved_to_readings(self, equation: str) -> Effect:
        """The same effect, after the linear errors instead of before them."""
        return replace(self, equation=equation, on_readings=True, shape={**self.shape, "of": READINGS})

    @property
    def pair(self) -> str | OwnPicture:
        """Its picture: the one declared, or what suits where it is seen; a still knows nothing of what only turns have."""
        turning = self.regime is not None and self.regime[0] in OF_TURNS
        return self.picture or (STILLS if "still" in self.seen_in and not turning else TURNS)


def _some_of(names: object, known: Container[str]) -> bool:
    return isinstance(names, tuple) and all(isinstance(name, str) and name in known for name in names)


# An effect with its parameters, as a model undoes it and a state of the physics holds it.


@dataclass(frozen=True, eq=False)
class AppliedEffect:
    """An effect with its parameters theta (P,), SI."""

    effect: Effect
    theta: np.ndarray

    def __post_init__(self) -> None:
        if self.theta.shape != (self.effect.parameter.size,):
            raise ValueError(f"{self.effect.id}: theta has shape {self.theta.shape}, expected ({self.effect.parameter.size},)")
