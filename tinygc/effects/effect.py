"""What an effect declares of itself; everything that any other part of the tool knows of one effect is in this record.

An effect describes what it adds to the true rate that the element feels, before the linear errors: the calibrated rate E m + B is
``rate + add(rate)``.  Parameters are SI inside; ``Parameter`` knows the unit and the name in which a person reads them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container
from dataclasses import dataclass, field, replace

import numpy as np

from tinygc.effects.declared import shown
from tinygc.effects.device import NONE, PASSES, DeviceCode
from tinygc.effects.errors import EffectError
from tinygc.effects.found_at import ANYWHERE, FoundAt
from tinygc.effects.gauge import Gauge
from tinygc.effects.movement import Movement
from tinygc.effects.occurrence import Occurrence
from tinygc.effects.parameter import Derived, Parameter, Parts, Scan
from tinygc.effects.picture import OF_TURNS, PAIRS, STILLS, TURNS, OwnPicture
from tinygc.effects.reach import INPUT_REACH, INPUTS, NOWHERE, Reach
from tinygc.effects.undo import MOST_PASSES, substituted

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
