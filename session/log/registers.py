"""What a sensor's registers mean (rad/s, m/s² and °C per count), and which sensor a name means."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from typing import TYPE_CHECKING

from session.base.errors import FormatError
from session.base.texts import letters_of
from session.base.units import MDPS, MG
from session.log.sensors import INVENSENSE, OTHERS, REGISTER_SPAN, ST, Profile, Thermometer

if TYPE_CHECKING:
    import numpy as np

# Which sensor a name means, however it is written: ``mpu9250``, ``MPU-9250``, ``ST asm330lhhtr, unit 2``.

PROFILES: tuple[Profile, ...] = (*ST, *INVENSENSE, *OTHERS)
#: the sensor where none is named (docs/formats.md)
DEFAULT = "ASM330LHH"
#: model of an unnamed sensor with physical units
UNKNOWN = "unknown"
_GENERIC = "generic"


def _pattern(name: str) -> re.Pattern[str]:
    """The name as a word, whatever stands between its letters and digits; TR is tape and reel."""
    written = r"[\s_.-]*".join(re.findall(r"[A-Za-z]+|[0-9]+", name))
    return re.compile(rf"(?<![A-Za-z0-9]){written}(?:TR)?(?![A-Za-z0-9])", re.IGNORECASE)


_NAMES = [(name, profile) for profile in PROFILES if profile.name != _GENERIC for name in (profile.name, *profile.also)]


@lru_cache(maxsize=256)
def profile_of(model: str) -> Profile | None:
    """The known sensor that a text names; None where it names none, or two.  ``generic`` counts only by itself."""
    if model.strip().lower() == _GENERIC:
        return next(profile for profile in PROFILES if profile.name == _GENERIC)
    near = [(_pattern(name), profile) for name, profile in _NAMES if letters_of(name) in letters_of(model)]  # the rest need no pattern
    found = [(match.span(), profile) for pattern, profile in near for match in pattern.finditer(model)]
    # LSM6DS3TR-C begins like LSM6DS3TR: the longer name counts.
    named = {
        profile.name: profile
        for span, profile in found
        if not any(span != other and other[0] <= span[0] and span[1] <= other[1] for other, _ in found)
    }
    return next(iter(named.values())) if len(named) == 1 else None


def nearest_name(model: str) -> str | None:
    """The known name that is most like a text, if any is."""
    names = {letters_of(name): name for profile in PROFILES for name in (profile.name, *profile.also)}
    close = get_close_matches(letters_of(model), names, n=1, cutoff=0.75)
    return names[close[0]] if close else None


# What a sensor's registers mean: rad/s, m/s^2 and degC per count, by its model (``profiles``) or by its data sheet's numbers.


@dataclass(frozen=True)
class RegisterUnits:
    """Of a model at its full scales, dps and g, or as in its data sheet (mdps and mg per LSB, LSB per degC, degC where 0 is read).

    A property raises FormatError on access where its model or full scale is unknown.
    """

    model: str
    fs_dps: float | None
    fs_g: float | None
    gyro_mdps_per_lsb: float | None = None
    accel_mg_per_lsb: float | None = None
    temp_lsb_per_c: float | None = None
    temp_at_zero_c: float | None = None

    @property
    def gyro_rps(self) -> float:
        """rad/s per LSB."""
        if self.gyro_mdps_per_lsb is not None:
            return self.gyro_mdps_per_lsb * MDPS
        assert self.fs_dps is not None  # registers without a full scale were refused
        return gyro_rps_per_lsb(self.fs_dps, self.model)

    @property
    def accel_mps2(self) -> float:
        """m/s^2 per LSB."""
        if self.accel_mg_per_lsb is not None:
            return self.accel_mg_per_lsb * MG
        assert self.fs_g is not None
        return accel_mps2_per_lsb(self.fs_g, self.model)

    @property
    def thermometer(self) -> Thermometer | None:
        """None where the temperature register's meaning is not known."""
        if self.temp_lsb_per_c is not None:
            return Thermometer(self.temp_lsb_per_c, self.temp_at_zero_c or 0.0)
        profile = profile_of(self.model)
        return None if profile is None else profile.thermometer

    def temperature_c(self, lsb: np.ndarray) -> np.ndarray | None:
        """Temperature registers (N,) in degC; None where their meaning is not known."""
        thermometer = self.thermometer
        return None if thermometer is None else thermometer.at_zero_c + lsb / thermometer.lsb_per_c

    def temperature_lsb(self, temp_c: np.ndarray | None, count: int) -> np.ndarray:
        """Temperatures (N,) degC as registers (N,), not rounded; of what has none, ``count`` zeros."""
        import numpy as np

        thermometer = self.thermometer
        return np.zeros(count) if temp_c is None or thermometer is None else (temp_c - thermometer.at_zero_c) * thermometer.lsb_per_c


def gyro_rps_per_lsb(fs_dps: float, model: str = DEFAULT) -> float:
    """Sensitivity of the gyroscope at a full scale given in dps, in rad/s per LSB; FormatError if there is no such range."""
    profile = require_profile(model)
    return _look_up(profile, profile.gyro, fs_dps, "gyro_fs_dps") * MDPS


def accel_mps2_per_lsb(fs_g: float, model: str = DEFAULT) -> float:
    """Sensitivity of the accelerometer at a full scale given in g, in m/s^2 per LSB; FormatError if there is none."""
    profile = require_profile(model)
    return _look_up(profile, profile.accel, fs_g, "accel_fs_g") * MG


def require_profile(model: str) -> Profile:
    """The profile of a model; FormatError where it is not known what its registers mean."""
    profile = profile_of(model)
    if profile is None:
        near = nearest_name(model)
        meant = f" (is {near} meant?)" if near else ""
        raise FormatError(
            f'sensor.model is "{model[:60]}"{meant}: its registers are not known; name one of `calibrate.py sensors`, '
            "or give sensor.gyro_mdps_per_lsb and accel_mg_per_lsb, or log gx_dps, ax_g, …"
        )
    return profile


def _look_up(profile: Profile, table: Mapping[float, float] | None, full_scale: float, name: str) -> float:
    if table is None:
        return 1000 * full_scale / REGISTER_SPAN
    if full_scale not in table:
        ranges = ", ".join(f"{one:g}" for one in table)
        raise FormatError(
            f"{name} = {full_scale:g} is no {profile.name} full scale (it has {ranges}); "
            "correct session.toml, or log physical units (gx_dps, ax_g, …)"
        )
    return table[full_scale]
