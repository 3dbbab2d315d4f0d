"""Plain arrays as samples: checked as a file would be, so that nothing wrong goes further than here."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from session.common.errors import DataError
from session.common.plausible import SI, beyond_any_sensor
from session.common.units import DEG, NS, G
from session.dialects.stamps import ERA_NS
from session.log.samples import Samples

LAST_S = ERA_NS * NS
#: full scales that most sensors have, dps and g
USUAL_DPS, USUAL_G = (125, 250, 500, 1000, 2000, 4000), (2, 4, 8, 16)


def samples_from_arrays(name: str, t_s: ArrayLike, gyro_rps: ArrayLike, accel_mps2: ArrayLike, temp_c: ArrayLike | None) -> Samples:
    """Samples of N readings: t_s (N,) s, increasing; gyro_rps (N, 3) rad/s; accel_mps2 (N, 3) m/s^2; temp_c (N,) degC or None.

    Raises DataError, which names the array, where a shape is another, a value is not finite or beyond any sensor, or time does not go
    forward.
    """
    time = _array(f"{name}: t_s", t_s, (None,))
    count = len(time)
    if count < 2:
        raise DataError(f"{name}: t_s has {count} samples, expected at least 2")
    gyro, accel = (_array(f"{name}: {what}", values, (count, 3)) for what, values in (("gyro_rps", gyro_rps), ("accel_mps2", accel_mps2)))
    temperature = None if temp_c is None else _array(f"{name}: temp_c", temp_c, (count,))
    _refuse_far(f"{name}: gyro_rps", gyro, "gyro")
    _refuse_far(f"{name}: accel_mps2", accel, "accel")
    if temperature is not None:
        _refuse_far(f"{name}: temp_c", temperature, "temp")
    if not (np.abs(time) < LAST_S).all():
        raise DataError(f"{name}: t_s reaches {np.abs(time).max():.3g} s; expected seconds")
    stamps = np.rint(time / NS)
    if not (np.diff(stamps) > 0).all():
        row = int(np.argmin(np.diff(stamps))) + 1
        raise DataError(f"{name}: t_s[{row}] = {time[row]:.9g} s does not go on from the sample before; expected seconds, increasing")
    return Samples(stamps.astype(np.int64), gyro, accel, temperature)


def usual_ranges(samples: Samples) -> tuple[float, float]:
    """Full scales in dps and g: the smallest of the usual ones that hold what was measured, or what was measured where none does."""
    rate, force = float(np.abs(samples.gyro).max()) / DEG, float(np.abs(samples.accel).max()) / G
    return (
        next((float(fs) for fs in USUAL_DPS if fs > rate), math.ceil(rate)),
        next((float(fs) for fs in USUAL_G if fs > force), math.ceil(force)),
    )


def _refuse_far(name: str, values: np.ndarray, kind: str) -> None:
    if (far := beyond_any_sensor(values, 1.0, kind)).any():
        at = tuple(int(i) for i in np.argwhere(far)[0])
        raise DataError(f"{name}[{', '.join(map(str, at))}] is {values[at]:g} {SI[kind]}, beyond any sensor; is its unit right?")


def _array(name: str, values: ArrayLike, shape: tuple[int | None, ...]) -> np.ndarray:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise DataError(f"{name} is not made of numbers") from None
    if array.ndim != len(shape) or any(want not in (None, have) for want, have in zip(shape, array.shape, strict=True)):
        wanted = "(" + ", ".join("N" if want is None else str(want) for want in shape) + ("," if len(shape) == 1 else "") + ")"
        raise DataError(f"{name} has shape {array.shape}, expected {wanted}")
    if not np.isfinite(array).all():
        at = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise DataError(f"{name}[{', '.join(map(str, at))}] is {array[at]}, expected a finite number; leave such samples out")
    return array
