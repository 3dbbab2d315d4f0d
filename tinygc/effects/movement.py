"""Input of an effect: the movement of one log, sample by sample, and the parts of it that the effect declares to need."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, NoReturn

import numpy as np

from session.base.errors import CalibrationError
from session.base.units import G
from session.log.samples import Samples

# Errors of an effect, or of the file that should define one.


class EffectError(CalibrationError):
    """An invalid effect: one line with the file or the id, what was expected, and what to do; exit code 2."""


# Input of an effect: the movement in one log, sample by sample.


@dataclass(frozen=True, eq=False)
class Movement:
    """The movement in one log, at each of its N samples.

    t_s (N,) s since the session began; dt_s sampling period; rate (N, 3) rad/s, the best estimate of the true rate, in the sensor's
    axes; force_g (N, 3) specific force in g; temp_c (N,) degC or NaN; vibration_g2 (N,) mean square specific force above the hand's
    band; duration_s of the session; fs_rps full scale; first_temp_c at the session's beginning.
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
        """Angular acceleration (N, 3) rad/s^2, by central differences."""
        return np.gradient(self.rate, self.dt_s, axis=0)

    def with_rate(self, rate: np.ndarray) -> Movement:
        """Return the same log with other rates (N, 3) rad/s."""
        return replace(self, rate=rate)

    def part(self, rows: slice | np.ndarray) -> Movement:
        """Return some rows of the log, a slice or their numbers."""
        arrays = ("t_s", "rate", "force_g", "temp_c", "vibration_g2")
        return replace(self, **{name: getattr(self, name)[rows] for name in arrays})


# From a log's samples to the movement that is the input of effects.

#: averaging time of the temperature, which removes the register's noise
TEMPERATURE_S = 1.0
#: vibration is faster than the first; its energy is averaged over the second
HAND_S, ENERGY_S = 0.05, 0.25


@dataclass(frozen=True)
class Conditions:
    """Reference conditions of effects: duration_s of the session they were fitted to, full scale fs_rps, first_temp_c or NaN."""

    duration_s: float
    fs_rps: float
    first_temp_c: float


def movement_of(samples: Samples, rate: np.ndarray, known: Conditions, began_s: float = 0.0, live: bool = False) -> Movement:
    """Return the movement of one log that began ``began_s`` into the session; samples with the pre-calibrated force, rate (N, 3) rad/s;
    live: use the unfiltered temperature, since its mean needs later samples."""
    dt_s, force_g, mean_s = samples.period_s, samples.accel / G, 0.0 if live else TEMPERATURE_S
    return Movement(
        t_s=began_s + samples.t_s,
        dt_s=dt_s,
        rate=rate,
        force_g=force_g,
        temp_c=np.full(len(samples), np.nan) if samples.temp_c is None else _mean(samples.temp_c, mean_s, dt_s),
        vibration_g2=vibration(force_g, dt_s),
        **vars(known),
    )


def without_vibration(force_g: np.ndarray, dt_s: float) -> np.ndarray:
    """Return the specific force (N, 3) of the hand's motion and gravity."""
    return _mean(force_g, HAND_S, dt_s)


def vibration(force_g: np.ndarray, dt_s: float) -> np.ndarray:
    """Return the mean square (N,) g^2 of the force faster than a hand's motion, averaged over the axes."""
    # The mean is taken twice: a single one inverts the sign between 20 and 40 Hz, which would add half as much energy again there.
    fast = force_g - without_vibration(without_vibration(force_g, dt_s), dt_s)
    return _mean(np.mean(fast**2, axis=1), ENERGY_S, dt_s)


def _mean(values: np.ndarray, window_s: float, dt_s: float) -> np.ndarray:
    """Return the moving mean along the samples."""
    size = max(1 if values.ndim == 1 else 3, round(window_s / dt_s))
    padded = np.concatenate([np.repeat(values[:1], size // 2 + 1, axis=0), values, np.repeat(values[-1:], size - 1 - size // 2, axis=0)])
    summed = np.cumsum(padded - values[:1], axis=0)  # gravity would make sums of a day large
    return values[:1] + (summed[size:] - summed[:-size]) / size


# Inputs of an effect in addition to the rate, and how far around a sample it reads them.

#: names that an effect may declare in ``inputs``: the fields of a ``Movement`` that it then may read
INPUTS = {
    "force": ("force_g",),
    "temperature": ("temp_c", "first_temp_c"),
    "vibration": ("vibration_g2",),
    "time": ("t_s", "duration_s", "dt_s"),
}
#: fields that give the spacing of neighbouring samples: an effect with a reach may read them
AROUND = ("t_s", "dt_s")


@dataclass(frozen=True)
class Reach:
    """How far before and after a sample an effect reads, in samples and in seconds, which add up.

    It holds for one evaluation of ``columns``, ``exact_distort`` or ``exact_correct``; repetitions in the default ``correct`` are added.
    """

    before_samples: int = 0
    after_samples: int = 0
    before_s: float = 0.0
    after_s: float = 0.0

    @classmethod
    def around(cls, samples: int = 0, seconds: float = 0.0) -> Reach:
        """Return a symmetric reach."""
        return cls(samples, samples, seconds, seconds)

    def __add__(self, other: Reach) -> Reach:
        return Reach(
            self.before_samples + other.before_samples,
            self.after_samples + other.after_samples,
            self.before_s + other.before_s,
            self.after_s + other.after_s,
        )

    def times(self, count: int) -> Reach:
        """Return the reach of ``count`` evaluations, one after the other."""
        return Reach(count * self.before_samples, count * self.after_samples, count * self.before_s, count * self.after_s)

    def __bool__(self) -> bool:
        return self != NOWHERE

    def rows(self, rate_hz: float) -> tuple[int, int]:
        """Return the number of samples before and after at a sampling rate."""
        return self.before_samples + ceil(self.before_s * rate_hz), self.after_samples + ceil(self.after_s * rate_hz)


NOWHERE = Reach()
#: a derivative by central differences
NEIGHBOURS = Reach.around(samples=1)
#: reach of an input itself: vibration is computed from the force by three centred means, twice half of 0.05 s and half of 0.25 s
INPUT_REACH = {"vibration": Reach.around(samples=5, seconds=0.175)}


# An effect sees only the fields that it declares: reading another raises an error in one line, instead of using NaN.


class Undeclared:
    """Placeholder for an undeclared field of the movement; any use of it raises EffectError."""

    def __init__(self, effect: str, field: str, ways: str):
        self._text = f"{effect}: reads movement.{field}, which it does not declare; add {ways} to its Effect(...)"

    def __array__(self, *args: Any, **settings: Any) -> NoReturn:
        raise EffectError(self._text)

    def __getattr__(self, name: str) -> NoReturn:
        if name.startswith("__"):
            raise AttributeError(name)
        raise EffectError(self._text)


def _refuse(self: Undeclared, *others: object) -> NoReturn:
    raise EffectError(self._text)


_USES = "add radd sub rsub mul rmul truediv rtruediv pow rpow neg abs lt le gt ge eq ne len iter getitem float int bool matmul rmatmul"
for _name in _USES.split():
    setattr(Undeclared, f"__{_name}__", _refuse)


def shown(effect: str, inputs: Iterable[str], looks_around: bool, movement: Movement) -> Movement:
    """Return the movement with placeholders for the fields that the effect with that id did not declare."""
    may_read = {field for name in inputs for field in INPUTS[name]} | set(AROUND if looks_around else ())
    hidden: dict[str, Any] = {}  # placeholders have none of the fields' types
    for name, fields in INPUTS.items():
        for field in fields:
            if field not in may_read:
                ways = "reach=Reach(...)" if field == "dt_s" else f'inputs=("{name}",)'
                hidden[field] = Undeclared(effect, field, ways)
    return replace(movement, **hidden)


# Columns that many effects share, and helpers for describing their parameters.


def diagonal(values: np.ndarray) -> np.ndarray:
    """Return columns (N, 3, 3) of a per-axis parameter from the rate per unit for each axis (N, 3) or for all (N,)."""
    columns = np.zeros((len(values), 3, 3))
    columns[:, range(3), range(3)] = values[:, None] if values.ndim == 1 else values
    return columns


def per_axis(basis: Callable[[Movement], np.ndarray]) -> Callable[[Movement], np.ndarray]:
    """Return the ``columns`` of a ``basis``."""
    return lambda movement: np.concatenate([diagonal(curve) for curve in basis(movement).T], axis=-1)


def rows(values: np.ndarray) -> np.ndarray:
    """Return columns (N, 3, 3 K) of a (3, K) parameter, a row for each axis, from the rate per unit: values (N, 3, K), or
    (N, 1, K) where they are the same for all axes."""
    count, _, each = values.shape
    columns = np.zeros((count, 3, 3, each))
    columns[:, range(3), range(3)] = values
    return columns.reshape(count, 3, 3 * each)


def full(inputs: np.ndarray) -> np.ndarray:
    """Return columns (N, 3, 9) of a 3x3 parameter, row by row, that multiplies inputs (N, 3)."""
    return rows(inputs[:, None, :])


def behind(values: np.ndarray) -> np.ndarray:
    """Return the values (N, 3, …) of the next axis: at x that of y, at y that of z, at z that of x."""
    return values[:, [1, 2, 0]]


def before(values: np.ndarray) -> np.ndarray:
    """Return the values (N, 3, …) of the previous axis: at x that of z, at y that of x, at z that of y."""
    return values[:, [2, 0, 1]]


def cross(inputs: np.ndarray) -> np.ndarray:
    """Return columns (N, 3, 6) of a (3, 2) parameter that multiplies, for each axis, inputs (N, 3) of the next and the previous axis."""
    return rows(np.stack([behind(inputs), before(inputs)], axis=-1))


def nothing(size: int) -> Callable[[Movement], np.ndarray]:
    """Return zero ``columns`` (N, 3, size) for an effect that adds nothing to the rate but changes the reference or the registers."""
    return lambda movement: np.zeros((*movement.rate.shape, size))


def largest(theta: np.ndarray) -> float:
    """Return the parameter of the greatest magnitude, with its sign."""
    return float(theta.ravel()[np.argmax(np.abs(theta))])


def axis_of(theta: np.ndarray) -> str:
    """Return the axis (row) whose parameter is greatest."""
    return "xyz"[int(np.argmax(np.abs(theta).reshape(3, -1).max(axis=1)))]
