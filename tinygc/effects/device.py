"""An effect on a microcontroller: C statements and equivalent single-precision NumPy, or the reason why there is none.

The C of a law is written by its NumPy, run on names (``InC``).  A computer algebra system (SymPy) would reorder sums and products, so
that C and NumPy round differently, and be one more package of every installation.

``in`` is the sample: ``in->force[i]`` m/s^2, ``in->temp_c`` degC.  ``r[3]`` is the rate, rad/s, which the effect is subtracted from.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from tinygc.effects.movement import Conditions

#: passes of rate <- measured - add(rate): each multiplies the error by the effect's own size, some per cent
PASSES = 3
#: a slope of 0.5 then leaves a billionth; a larger slope is not a sensor error
MOST_PASSES = 30
#: passes in C, the same for each sample: after 3, a strong effect leaves more than single-precision rounding
PASSES_IN_C = 5


@dataclass(frozen=True, eq=False)
class Stage:
    """One step of a program: its body changes ``float r[3]`` in place, and may read ``in`` and change ``state``.

    formula: a line of the header's formula; body: C statements; constants: name in C -> values, in double precision until a program
    rounds them; numpy(c, rate, inputs) -> (N, 3) float32: what the body does to N samples, in the same order of operations, c: name ->
    float32; functions: C functions that the body calls; state: C members (names that no other stage has),
    state_bytes: their size, start: statements that set them.
    """

    formula: str
    body: str
    constants: dict[str, np.ndarray]
    numpy: Callable[[dict[str, np.ndarray], np.ndarray, Any], np.ndarray]
    functions: str = ""
    state: str = ""
    state_bytes: int = 0
    start: str = ""


def affine(w: np.ndarray, x: np.ndarray) -> np.ndarray:
    """W x + b, in the order of operations of the C function of this name: w (3, 4) with b last, x (N, 3), all float32."""
    y = np.broadcast_to(w[:, 3], x.shape)
    for j in range(3):
        y = y + w[:, j] * x[:, j : j + 1]
    return y


# C from NumPy: arithmetic on names, in the order in which NumPy rounds.


def _operator(sign: str) -> Callable[[InC, InC | float], InC]:
    return lambda self, other: InC(f"({self.text} {sign} {in_c(other).text})")


@dataclass(frozen=True, eq=False)
class InC:
    """A number in C, as text.  Sums, products and comparisons of numbers are one; nothing else is."""

    text: str

    __add__, __sub__, __mul__ = map(_operator, "+-*")
    __lt__, __gt__ = map(_operator, "<>")

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> InC:
        return InC(f"(-{self.text})")

    def __pow__(self, power: int) -> InC:
        return NotImplemented if power != 2 else self * self

    def __abs__(self) -> InC:
        return where(self < 0.0, -self, self)


def in_c(number: InC | float) -> InC:
    """The number in C."""
    return number if isinstance(number, InC) else InC(f"{float(number)!r}f")


def where(condition: InC, this: InC | float, that: InC | float) -> InC:
    """One of two numbers in C, as ``np.where``."""
    return InC(f"({condition.text} ? {in_c(this).text} : {in_c(that).text})")


@dataclass(frozen=True, eq=False)
class PerAxisC:
    """The correction r_i -= term with one coefficient for each axis.

    name: the coefficients' name in C, capital letters; formula: a line of the header; numpy(c, w, inputs) -> (N, 3) float32: the term, by
    sums, products and magnitudes alone, which also write its C: c: name -> constant, w (N, 3) the rate, ``inputs.force`` (N, 3),
    ``inputs.temp_c`` (N,); passes: 1 where the term does not depend on w; constants(theta, known) -> name -> array (3,) or (1,), ``name``
    itself first, theta by default.
    """

    name: str
    formula: str
    numpy: Callable[[dict[str, np.ndarray], np.ndarray, Any], np.ndarray]
    passes: int = PASSES_IN_C
    constants: Callable[[np.ndarray, Conditions], dict[str, np.ndarray]] | None = None

    def stage(self, theta: np.ndarray, known: Conditions) -> Stage:
        """The correction by parameters theta (P,), SI; as in ``Effect.correct``, it is inverted by passes of r <- r - term(r)."""
        values = {self.name: theta} if self.constants is None else self.constants(theta, known)
        c = {name: np.array([InC(f"{name}[{'i' if np.size(value) > 1 else 0}]")]) for name, value in values.items()}
        inputs = SimpleNamespace(force=np.array([[InC("in->force[i]")]]), temp_c=np.array([InC("in->temp_c")]))
        term = self.numpy(c, np.array([[InC("w")]]), inputs)[0, 0]
        body = (
            "for (int i = 0; i < 3; i++) {\n    float w = r[i];\n"
            f"    for (int pass = 0; pass < {self.passes}; pass++)\n        w = r[i] - {term.text};\n    r[i] = w;\n}}"
        )

        def run(c: dict[str, np.ndarray], rate: np.ndarray, inputs: Any) -> np.ndarray:
            w = rate
            for _ in range(self.passes):
                w = rate - self.numpy(c, w, inputs)
            return w

        return Stage(self.formula, body, values, run)


@dataclass(frozen=True, eq=False)
class MatrixC:
    """The correction r -= K f, f the specific force in m/s^2; matrix(theta, known) -> K (3, 3); name and formula as in ``PerAxisC``."""

    name: str
    formula: str
    matrix: Callable[[np.ndarray, Conditions], np.ndarray]

    def stage(self, theta: np.ndarray, known: Conditions) -> Stage:
        """The correction by parameters theta (P,), SI."""
        body = f"float s[3];\naffine({self.name}, in->force, s);\nfor (int i = 0; i < 3; i++)\n    r[i] -= s[i];"
        values = {self.name: np.column_stack([self.matrix(theta, known), np.zeros(3)])}
        return Stage(self.formula, body, values, lambda c, rate, inputs: rate - affine(c[self.name], inputs.force))


@dataclass(frozen=True, eq=False)
class StageC(Stage):
    """Any other correction in C, with a state if it needs one: the fields of ``Stage``, constants as in ``PerAxisC``."""

    constants: Callable[[np.ndarray, Conditions], dict[str, np.ndarray]]  # type: ignore[assignment]

    def stage(self, theta: np.ndarray, known: Conditions) -> Stage:
        """The correction by parameters theta (P,), SI."""
        return Stage(**vars(self) | {"constants": self.constants(theta, known)})


@dataclass(frozen=True)
class NoC:
    """The reason why an effect has no C code."""

    why: str


DeviceCode = PerAxisC | MatrixC | StageC | NoC
AHEAD = NoC("it needs samples that are yet to come")
BYGONE = NoC("it belongs to the time of that one session")
NONE = NoC("there is no C for it")
OF_FORCE = NoC("it corrects the specific force, and the C corrects the rate")
