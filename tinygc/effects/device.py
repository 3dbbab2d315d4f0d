"""An effect on a microcontroller: C statements and the NumPy that does the same in single precision, or why there is none.

``in`` is the sample: ``in->force[i]`` m/s^2, ``in->temp_c`` degC.  ``r[3]`` is the rate, rad/s, from which the effect is taken off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tinygc.effects.movement import Conditions

#: passes of rate <- measured - add(rate): each leaves the effect's own size, some per cent, of what was wrong before
PASSES = 3
#: of C, where each sample takes as many: what 3 leave of a strong effect is more than single precision rounds
PASSES_IN_C = 5


@dataclass(frozen=True)
class Cost:
    """Floating-point operations for one sample."""

    multiply: int = 0
    add: int = 0
    compare: int = 0

    def __add__(self, other: Cost) -> Cost:
        return Cost(self.multiply + other.multiply, self.add + other.add, self.compare + other.compare)


@dataclass(frozen=True, eq=False)
class PerAxisC:
    """r_i -= term, by one coefficient for each axis.

    name: of the coefficients in C, capital letters; says: a line of the header's formula; term: a C expression of ``NAME[i]``,
    ``in``, other constants, and ``w``, the rate about axis i, where the term follows it (then it is repeated ``passes`` times);
    numpy(c, w, inputs) -> (N, 3) float32, the same in the same order, c: name -> constant, w (N, 3), ``inputs.force`` (N, 3),
    ``inputs.temp_c`` (N,); constants(theta, known) -> name -> array, ``name`` itself first; cost of one term.
    """

    name: str
    says: str
    term: str
    numpy: Callable[[dict[str, np.ndarray], np.ndarray, Any], np.ndarray]
    cost: Cost
    passes: int = PASSES_IN_C
    constants: Callable[[np.ndarray, Conditions], dict[str, np.ndarray]] | None = None

    def values(self, theta: np.ndarray, known: Conditions) -> dict[str, np.ndarray]:
        """The constants in double precision: theta itself where nothing else is declared."""
        return {self.name: theta} if self.constants is None else self.constants(theta, known)


@dataclass(frozen=True, eq=False)
class MatrixC:
    """r -= K f, f the specific force in m/s^2; matrix(theta, known) -> K (3, 3); name and says as of ``PerAxisC``."""

    name: str
    says: str
    matrix: Callable[[np.ndarray, Conditions], np.ndarray]


@dataclass(frozen=True, eq=False)
class StageC:
    """Any other C, with a memory if it needs one.

    body: statements that change ``r``; constants as of ``PerAxisC``; numpy(c, rate, inputs) -> (N, 3) float32: what the body does to N
    samples, one after the other; state: C members (names that no other effect uses), state_bytes their size, start: statements that set
    them; functions: static C functions that the body calls; cost of one sample.
    """

    says: str
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
    """There is none, and why."""

    why: str


DeviceCode = PerAxisC | MatrixC | StageC | NoC
AHEAD = NoC("it needs samples that are yet to come")
BYGONE = NoC("it belongs to the time of that one session")
NONE = NoC("there is no C for it")
