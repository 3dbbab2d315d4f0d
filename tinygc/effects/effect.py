"""What an effect offers, and what it is given.

An effect describes what it adds to the true rate that the element feels, before the linear errors: the calibrated rate E m + B is
``rate + add(rate)``.  Parameters are SI inside; ``Parameter`` knows the unit and the name in which a person reads them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

#: passes of rate <- measured - add(rate): each leaves the effect's own size, some per cent, of what was wrong before
PASSES = 3


@dataclass(frozen=True, eq=False)
class Movement:
    """What happened in one log, at each of its N samples.

    t_s (N,) s since the session began; dt_s sampling period; rate (N, 3) rad/s, the true rate as well as it is known; force_g (N, 3)
    specific force in g; temp_c (N,) degC or NaN; vibration_g2 (N,) mean square specific force above the hand's band;
    duration_s of the session; fs_rps full scale; first_temp_c at the session's beginning.
    """

    t_s: np.ndarray
    dt_s: float
    rate: np.ndarray
    force_g: np.ndarray
    temp_c: np.ndarray
    vibration_g2: np.ndarray
    duration_s: float
    fs_rps: float
    first_temp_c: float

    @property
    def acceleration(self) -> np.ndarray:
        """(N, 3) rad/s^2, by central differences."""
        return np.gradient(self.rate, self.dt_s, axis=0)

    def with_rate(self, rate: np.ndarray) -> Movement:
        return replace(self, rate=rate)


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
        return int(np.prod(self.shape))


@dataclass(frozen=True, eq=False)
class Effect:
    """One entry of the catalogue whose parameters add to the rate.

    columns(movement) -> (N, 3, P): what each parameter adds to the rate per SI unit, linear, for naming;
    correct(measured, movement, theta) -> (N, 3): the rate freed of the effect, exact, for refitting; the default undoes
    ``distort`` by repeated substitution;
    distort(movement, theta) -> (N, 3): the rate with the effect, exact, for simulating; the default is linear;
    says(theta) -> one plain sentence for the operator; splits: the movement that tells it from its lookalikes;
    kind: "rate", or what it bends instead: "force" (the reference) or "earth" (the Earth's rate in the forward model);
    needs: "temperature" where a log without it cannot show the effect; regime: variable and unit that it lives along;
    variants(times) -> one effect for each value of a shape parameter that is scanned, its value in ``shape``;
    begin: where a refit begins, SI: zero, unless zero is a saddle;
    known_to: share to which the variable that it follows can be known, which no residual shows: it widens the stated std;
    basis(movement) -> (N, K): where the zero of each axis follows K known curves whatever the rate, parameter i * 3 + axis the share of
    curve i: the same as ``columns``, without the zeros.
    """

    id: str
    equation: str
    parameter: Parameter
    seen_in: tuple[str, ...]
    columns: Callable[[Movement], np.ndarray]
    says: Callable[[np.ndarray], str]
    splits: str
    kind: str = "rate"
    regime: tuple[str, str] | None = None
    shape: dict = field(default_factory=dict)
    variants: Callable[[np.ndarray], list[Effect]] | None = None
    needs: str | None = None
    begin: float = 0.0
    known_to: float = 0.0
    exact_correct: Callable[[np.ndarray, Movement, np.ndarray], np.ndarray] | None = None
    exact_distort: Callable[[Movement, np.ndarray], np.ndarray] | None = None
    basis: Callable[[Movement], np.ndarray] | None = None

    def distort(self, movement: Movement, theta: np.ndarray) -> np.ndarray:
        """The rate (N, 3) rad/s that the element reports for the true one."""
        if self.exact_distort is not None:
            return self.exact_distort(movement, theta)
        if self.basis is not None:
            return movement.rate + self.basis(movement) @ theta.reshape(-1, 3)
        columns = self.columns(movement)
        return movement.rate + (columns.reshape(-1, len(theta)) @ theta).reshape(-1, 3)  # one flat product: many times faster

    def correct(self, measured: np.ndarray, movement: Movement, theta: np.ndarray) -> np.ndarray:
        """The true rate (N, 3) rad/s behind the calibrated one; ``movement.rate`` is where the search begins."""
        if self.exact_correct is not None:
            return self.exact_correct(measured, movement, theta)
        if self.basis is not None:
            return measured - self.basis(movement) @ theta.reshape(-1, 3)
        rate = measured
        for _ in range(PASSES):
            now = movement.with_rate(rate)
            rate = measured - (self.distort(now, theta) - rate)
        return rate


def diagonal(values: np.ndarray) -> np.ndarray:
    """(N, 3, 3) columns of a per-axis parameter from what one unit of it adds to each axis (N, 3) or to all (N,)."""
    columns = np.zeros((len(values), 3, 3))
    columns[:, range(3), range(3)] = values[:, None] if values.ndim == 1 else values
    return columns


def per_axis(basis: Callable[[Movement], np.ndarray]) -> Callable[[Movement], np.ndarray]:
    """``columns`` of a ``basis``."""
    return lambda movement: np.concatenate([diagonal(curve) for curve in basis(movement).T], axis=-1)


def full(inputs: np.ndarray) -> np.ndarray:
    """(N, 3, 9) columns of a 3x3 parameter, row by row, that multiplies inputs (N, 3)."""
    columns = np.zeros((len(inputs), 3, 3, 3))
    for axis in range(3):
        columns[:, axis, axis] = inputs
    return columns.reshape(len(inputs), 3, 9)


def largest(theta: np.ndarray) -> float:
    """The parameter of the greatest size, with its sign."""
    return float(theta.ravel()[np.argmax(np.abs(theta))])


def axis_of(theta: np.ndarray) -> str:
    """The axis (row) whose parameter is greatest."""
    return "xyz"[int(np.argmax(np.abs(theta).reshape(3, -1).max(axis=1)))]
