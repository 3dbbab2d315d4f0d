"""An effect on a microcontroller: C statements and equivalent single-precision NumPy, or the reason why there is none.

``in`` is the sample: ``in->force[i]`` m/s^2, ``in->temp_c`` degC.  ``r[3]`` is the rate, rad/s, which the effect is subtracted from.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tinygc.effects.movement import Conditions

#: passes of rate <- measured - add(rate): each multiplies the error by the effect's own size, some per cent
PASSES = 3
#: passes in C, the same for each sample: after 3, a strong effect leaves more than single-precision rounding
PASSES_IN_C = 5


@dataclass(frozen=True)
class Cost:
    """Number of floating-point operations for one sample."""

    multiply: int = 0
    add: int = 0
    compare: int = 0

    def __add__(self, other: Cost) -> Cost:
        return Cost(self.multiply + other.multiply, self.add + other.add, self.compare + other.compare)


@dataclass(frozen=True, eq=False)
class PerAxisC:
    """The correction r_i -= term with one coefficient for each axis.

    name: the coefficients' name in C, capital letters; formula: a line of the header; term: a C expression of ``NAME[i]``,
    ``in``, other constants, and ``w``, the rate about axis i, where the term depends on it (then it is repeated ``passes`` times);
    numpy(c, w, inputs) -> (N, 3) float32, the same operations in the same order, c: name -> constant, w (N, 3), ``inputs.force`` (N, 3),
    ``inputs.temp_c`` (N,); constants(theta, known) -> name -> array, ``name`` itself first; cost of one term.
    """

    name: str
    formula: str
    term: str
    numpy: Callable[[dict[str, np.ndarray], np.ndarray, Any], np.ndarray]
    cost: Cost
    passes: int = PASSES_IN_C
    constants: Callable[[np.ndarray, Conditions], dict[str, np.ndarray]] | None = None

    def values(self, theta: np.ndarray, known: Conditions) -> dict[str, np.ndarray]:
        """Return the constants in double precision: theta itself where nothing else is declared."""
        return {self.name: theta} if self.constants is None else self.constants(theta, known)


@dataclass(frozen=True, eq=False)
class MatrixC:
    """The correction r -= K f, f the specific force in m/s^2; matrix(theta, known) -> K (3, 3); name and formula as in ``PerAxisC``."""

    name: str
    formula: str
    matrix: Callable[[np.ndarray, Conditions], np.ndarray]


@dataclass(frozen=True, eq=False)
class StageC:
    """Any other correction in C, with a state if it needs one.

    body: statements that change ``r``; constants as in ``PerAxisC``; numpy(c, rate, inputs) -> (N, 3) float32: what the body does to N
    samples, one after the other; state: C members (names that no other effect uses), state_bytes: their size, start: statements that set
    them; functions: static C functions that the body calls; cost: of one sample.
    """

    formula: str
    body: str
    constants: Callable[[np.ndarray, Conditions], dict[str, np.ndarray]]
    numpy: Callable[[dict[str, np.ndarray], np.ndarray, Any], np.ndarray]
    cost: Cost
    functions: str = ""
    state: str = ""
    state_bytes: int = 0
    start: str = ""


@dataclass(frozen=True)
class NoC:
    """The reason why an effect has no C code."""

    why: str


DeviceCode = PerAxisC | MatrixC | StageC | NoC
AHEAD = NoC("it needs samples that are yet to come")
BYGONE = NoC("it belongs to the time of that one session")
NONE = NoC("there is no C for it")
OF_FORCE = NoC("it corrects the specific force, and the C corrects the rate")
