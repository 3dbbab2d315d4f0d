"""Plain arrays as logs and known turns: checked as files are, so that nothing wrong goes further than here.

A message names the argument and the place in it, ``gyro_rps[3, 0]`` or ``closures[1]: t_s[7]``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from session.base.errors import DataError
from session.base.texts import significant
from session.base.units import BEYOND_FULL_SCALE, DEG, LARGEST_DPS, NS, SI, WORDS, G, beyond_any_sensor, parse_unit
from session.log.logfile import COLUMNS, KnownTurn, Log, known_turn
from session.log.samples import Samples
from session.log.stamps import ERA_NS
from session.log.thermometer import Sound

LAST_S = ERA_NS * NS
#: full scales that most sensors have, dps and g
USUAL_DPS, USUAL_G = (125, 250, 500, 1000, 2000, 4000), (2, 4, 8, 16)
#: of a log in memory
LOG_ARRAYS = "(t_s, gyro_rps, accel_mps2) or (t_s, gyro_rps, accel_mps2, temp_c)"


# Units of arrays: as people state them, and where they cannot be right.


def require_kind(name: str, value: Any, kind: type | tuple[type, ...], expected: str) -> None:
    """DataError for an argument of another kind."""
    if not isinstance(value, kind):
        raise DataError(f"{name} is {value!r:.60}, expected {expected}")


def si_of(option: str, kind: str, word: str) -> float:
    """SI per unit of a word; DataError, which names the option, for what is no unit of that kind, and for registers."""
    unit = parse_unit(kind, word) if isinstance(word, str) else None
    if unit is None or unit.si is None:
        words = ", ".join(each for each in WORDS[kind] if each.isascii())
        raise DataError(f"{option} is {word!r}, expected one of {words}, or what one count is, as 0.061{next(iter(WORDS[kind]))}")
    return float(unit.si)


def refuse_degrees(name: str, rates: np.ndarray, full_scale_dps: float | None, do: str) -> None:
    """Raise DataError where rates (N, 3), read as rad/s, are beyond what a full scale, or any usual one, lets a gyroscope read.

    name: of the array; do: the advice.
    """
    limit_rps = (LARGEST_DPS if full_scale_dps is None else BEYOND_FULL_SCALE * full_scale_dps) * DEG
    if not (far := np.abs(rates) > limit_rps).any():
        return
    row, axis = map(int, np.argwhere(far)[0])
    bar = f"{LARGEST_DPS:g} dps, the largest usual full scale" if full_scale_dps is None else f"the full scale of {full_scale_dps:g} dps"
    value = float(rates[row, axis])
    raise DataError(f"{name}[{row}, {axis}] is {value:.6g} rad/s, {value / DEG:.4g} dps, beyond {bar}; {do}")


# Logs and known turns.


def logs_of_arrays(
    argument: str, names: Sequence[str], given: Sequence[Sequence[ArrayLike | None]], full_scale_dps: float | None, si: tuple[float, float]
) -> tuple[Log, ...]:
    """Logs, each of ``LOG_ARRAYS``: t_s (N,) s, increasing; rates and specific force (N, 3) in units of ``si``; temp_c (N,) degC or None.

    argument: that holds them, or nothing where each array is an argument; full_scale_dps: of the gyroscope, None where it is not known.
    Raises DataError, which names the array, where a shape is another, a value is not finite or beyond the sensor, or time does not go
    forward.
    """
    logs = []
    for number, (name, arrays) in enumerate(zip(names, given, strict=True)):
        if not isinstance(arrays, tuple | list) or len(arrays) not in (3, 4):
            raise DataError(f"each of {argument} is {LOG_ARRAYS}; {argument}[{number}] is not")
        samples = samples_of_arrays(f"{argument}[{number}]: " if argument else "", arrays, full_scale_dps, si)
        sound = Sound()
        samples = replace(samples, temp_c=sound(samples.temp_c))
        logs.append(Log(Path(name), samples, notes=tuple(sound.notes), raw=False, in_memory=True))
    return tuple(logs)


def samples_of_arrays(where: str, arrays: Sequence[ArrayLike | None], full_scale_dps: float | None, si: tuple[float, float]) -> Samples:
    """Samples of ``LOG_ARRAYS``; where: before each array's name in a complaint.  Raises what ``logs_of_arrays`` does."""
    t_s, gyro_rps, accel_mps2, temp_c = (*arrays, None)[:4]
    time = array_of(f"{where}t_s", t_s, (None,))
    count = len(time)
    if count < 2:
        raise DataError(f"{where}t_s has {count} samples, expected at least 2")
    gyro = array_of(f"{where}gyro_rps", gyro_rps, (count, 3)) * si[0]
    accel = array_of(f"{where}accel_mps2", accel_mps2, (count, 3)) * si[1]
    temperature = None if temp_c is None else array_of(f"{where}temp_c", temp_c, (count,))
    _refuse_far(f"{where}gyro_rps", gyro, "gyro")
    _refuse_far(f"{where}accel_mps2", accel, "accel")
    if temperature is not None:
        _refuse_far(f"{where}temp_c", temperature, "temp")
    do = 'are the rates in degrees? give rate_unit="dps"' if si[0] == 1 else "is rate_unit another?"
    refuse_degrees(f"{where}gyro_rps", gyro, full_scale_dps, f"{do}; or give the right gyro_fs_dps")
    return Samples(stamps_of(where, time), gyro, accel, temperature)


def turns_of_arrays(given: Sequence[Sequence[Any]], logs: Sequence[Log]) -> tuple[KnownTurn, ...]:
    """Known turns, each ``(number, axis, angle_deg, sigma_deg)``, or with the number of a log as fifth: the turn then counts within it.

    axis: ``x``, ``-y`` and the like, or three numbers in body axes.  Raises DataError or FormatError, which names the turn.
    """
    turns: dict[tuple[int, str | None], KnownTurn] = {}
    for place, row in enumerate(given):
        where = f"turns[{place}]"
        if not isinstance(row, tuple | list) or len(row) not in (4, 5):
            raise DataError(
                f"{where} is {row!r:.60}, expected (number, axis, angle_deg, sigma_deg) or one with the number of a log as fifth"
            )
        number, axis, *angles = row[:4]
        words = (
            axis if isinstance(axis, str) else ";".join(f"{x!r}".removesuffix(".0") for x in array_of(f"{where} axis", axis, (3,)).tolist())
        )
        cells = dict(zip(COLUMNS, [f"{number}", words, *map(str, angles)], strict=True))
        log = row[4] if len(row) == 5 else None
        if log is not None:
            if not isinstance(log, int) or log not in range(len(logs)):
                raise DataError(f"{where}: log is {log!r:.40}, expected the number of a log, 0 to {len(logs) - 1}")
            cells["log"] = logs[log].path.name
        turn = known_turn(where, cells, [each.path.name for each in logs])
        if (turn.turn, turn.log) in turns:
            raise DataError(f"{where}: {turn.name} is given twice; keep one")
        turns[turn.turn, turn.log] = turn
    return tuple(turns.values())


def usual_ranges(samples: Samples) -> tuple[float, float]:
    """Full scales in dps and g: the smallest of the usual ones that hold what was measured, or what was measured where none does."""
    rate, force = float(np.abs(samples.gyro).max()) / DEG, float(np.abs(samples.accel).max()) / G
    return (
        next((float(fs) for fs in USUAL_DPS if fs > rate), math.ceil(rate)),
        next((float(fs) for fs in USUAL_G if fs > force), math.ceil(force)),
    )


def stamps_of(where: str, time: np.ndarray) -> np.ndarray:
    """(N,) int64 ns of times in s.  DataError where they do not go forward."""
    if not (np.abs(time) < LAST_S).all():
        raise DataError(f"{where}t_s reaches {significant(np.abs(time).max())} s; expected seconds")
    stamps = np.rint(time / NS)
    if not (np.diff(stamps) > 0).all():
        row = int(np.argmin(np.diff(stamps))) + 1
        raise DataError(f"{where}t_s[{row}] = {float(time[row])} s does not go on from the sample before; expected seconds, increasing")
    return stamps.astype(np.int64)


def _refuse_far(name: str, values: np.ndarray, kind: str) -> None:
    if (far := beyond_any_sensor(values, 1.0, kind)).any():
        at = tuple(int(i) for i in np.argwhere(far)[0])
        raise DataError(f"{name}[{', '.join(map(str, at))}] is {values[at]:g} {SI[kind]}, beyond any sensor; is its unit right?")


def array_of(name: str, values: ArrayLike | None, shape: tuple[int | None, ...]) -> np.ndarray:
    """Finite numbers of this shape, None for any length.  Raises DataError, which names the array."""
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"{name} is not made of numbers") from None
    if array.ndim != len(shape) or any(want not in (None, have) for want, have in zip(shape, array.shape, strict=True)):
        wanted = "(" + ", ".join("N" if want is None else str(want) for want in shape) + ("," if len(shape) == 1 else "") + ")"
        raise DataError(f"{name} has shape {array.shape}, expected {wanted}")
    if not np.isfinite(array).all():
        at = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise DataError(f"{name}[{', '.join(map(str, at))}] is {array[at]}, expected a finite number; leave such samples out")
    return array
