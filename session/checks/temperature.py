"""A temperature, and whether it is in degC: what a chip survives, what its thermometer can scatter, and the steps of its register."""

from __future__ import annotations

import numpy as np

from session.checks.findings import Finding
from session.detect.stills import Still
from session.log.config import Sensor
from session.log.logfile import Log
from session.sensor.profiles.profile import Profile

WHAT = "temperature"
TEMP_CHANGE_C = 3.0
#: degC that a chip survives, where nobody knows which chip it is
CHIP_C = (-60.0, 150.0)
#: where somebody lives who handles a sensor, degC
HANDLED_C = (0.0, 60.0)
#: a chip that warms itself in a closed case is hardly warmer; in Fahrenheit it is where a cool room is
WARM_C = 55.0
#: degC from sample to sample, rms: thermometers in such packages have 0.05 to 0.5, registers tens
SCATTER_C, LEAST_READINGS = 2.0, 100
#: of a register's step in another unit
STEP_WITHIN = 0.02
#: LSB, rms of the changes: a register of FINE_LSB_PER_C scatters by more, a number that somebody has converted moves in single steps
SINGLE_STEPS, FINE_LSB_PER_C = 2.0, 100.0
#: unit -> degC of a value of it
OTHERS = {
    "degC": lambda value: value,
    "kelvin": lambda value: value - 273.15,
    "Fahrenheit": lambda value: (value - 32) / 1.8,
    "tenths of a degree": lambda value: value / 10,
    "hundredths of a degree": lambda value: value / 100,
    "thousandths of a degree": lambda value: value / 1000,
}
#: those in which a logger writes whole numbers that a register may have as well, and its scatter tells apart
WRITTEN = ("degC", "tenths of a degree", "Fahrenheit", "kelvin")


def check_temperature(log: Log, stills: list[Still], sensor: Sensor) -> list[Finding]:
    """Temperature there, in degC, and how far it moves.

    A zero-rate level moves by some 0.01 dps/degC: 3 degC are 0.03 dps, or 0.15 deg over a turn of 5 s, ten times the noise.
    """
    temp_c, where = log.samples.temp_c, log.path.name
    if temp_c is None:
        return [Finding("note", where, WHAT, "not recorded: a bias that follows temperature cannot be told from drift")]
    low, high = map(float, np.percentile(temp_c, [1, 99]))
    if (other := _scatters(temp_c, sensor.profile) or other_unit(low, high, sensor.profile, _step(temp_c))) is not None:
        level, says, do = other
        return [Finding(level, where, WHAT, says, do)]
    if log.raw and (converted := _converted(temp_c, sensor)) is not None:
        return [Finding("note", where, WHAT, *converted)]
    if np.ptp(temp_c) == 0:
        return [Finding("note", where, WHAT, f"stands at {temp_c[0]:.2f} degC: is the register read?")]
    means = np.array([still.temp_c for still in stills]) if len(stills) > 1 else np.array([low, high])
    moved, says = np.ptp(means), f"{means.min():.1f} to {means.max():.1f} degC"
    if moved > TEMP_CHANGE_C:
        says += f", moved {moved:.1f} (bar {TEMP_CHANGE_C:g}): the bias is likely to follow"
        return [Finding("note", where, WHAT, says, "let it warm up before, or let the fit include temperature")]
    return [Finding("ok", where, WHAT, says)]


def other_unit(low: float, high: float, profile: Profile | None, step: float = 0.0) -> tuple[str, str, str] | None:
    """Level, words and advice where temperatures from low to high, as read in degC, seem to be in another unit; None where they do not.

    step: of the column's values, 0 where it is not known.
    """
    works = CHIP_C if profile is None or profile.works_c is None else profile.works_c
    if low < works[0] or high > works[1]:
        whose = "a chip survives" if works is CHIP_C else "the sensor works from"
        says = f"{low:.1f} to {high:.1f} degC; {whose} {works[0]:g} to {works[1]:g}"
        register = None if profile is None else profile.thermometer
        said = "" if register is None else f"{register.lsb_per_c:.6g} LSB per degC, 0 at {register.at_zero_c:.4g} degC: "
        return "warning", says, f"{said}look at the column and its unit{units_of_people(low, high, profile)}"
    if low < WARM_C or not _handled("Fahrenheit", low, high):
        return None
    says = f"{low:.1f} to {high:.1f} degC, which in Fahrenheit is {_words('Fahrenheit', low, high)}"
    if _fahrenheit_steps(step, profile):
        return "warning", f"{says}; its steps of {step:.4g} are those of this sensor's register in Fahrenheit", "write temp_c in degC"
    return "note", says, "is the column in degC, as its name says?"


def _scatters(temp_c: np.ndarray, profile: Profile | None) -> tuple[str, str, str] | None:
    """A register, or noise: no thermometer in a package jumps so from sample to sample."""
    if len(temp_c) < LEAST_READINGS:
        return None
    rms = float(np.sqrt(np.mean(np.square(np.clip(np.diff(temp_c), -1e4, 1e4))) / 2))
    if rms <= SCATTER_C:
        return None
    low, high = map(float, np.percentile(temp_c, [1, 99]))
    says = f"scatters by {rms:.3g} degC rms from sample to sample (bar {SCATTER_C:g}), {low:.0f} to {high:.0f}: no thermometer does"
    return "warning", says, f"is it the raw register? then the column is called temp{units_of_people(low, high, profile)}"


def _converted(temp_c: np.ndarray, sensor: Sensor) -> tuple[str, str] | None:
    """Words and advice where what is read as a fine register moves in single steps, and is a temperature as it stands: degC, read as
    LSB, hide 255 of 256 parts of every change.  None where it scatters as a register does, or the register is coarse itself."""
    register = sensor.register_units.thermometer
    if register is None or abs(register.lsb_per_c) < FINE_LSB_PER_C or len(temp_c) < LEAST_READINGS:
        return None
    values = (temp_c - register.at_zero_c) * register.lsb_per_c
    changes = np.diff(values)[np.abs(np.diff(values)) > 0.5]
    if not len(changes) or np.sqrt(np.mean(np.square(changes))) > SINGLE_STEPS:
        return None
    low, high = map(float, np.percentile(values, [1, 99]))
    read = [f"as {unit} {_words(unit, low, high)}" for unit in WRITTEN if _handled(unit, low, high)]
    if not read:
        return None
    per_c, zero_c = register.lsb_per_c, register.at_zero_c
    says = (
        f"{temp_c.min():.2f} to {temp_c.max():.2f} degC in single steps of the register, {abs(per_c):.4g} per degC: no such thermometer "
        f"is so quiet ({', '.join(read)})"
    )
    return says, f"does temp hold the register, as its name says? T degC stand there as (T - {zero_c:g}) * {per_c:.6g}"


def units_of_people(low: float, high: float, profile: Profile | None) -> str:
    """The units in which the values would be where people are: `` (in kelvin 24.9 to 25.3 degC)``."""
    said = [f"in {unit} {_words(unit, low, high)}" for unit in OTHERS if unit != "degC" and _handled(unit, low, high)]
    if profile is not None and profile.thermometer is not None:
        register = profile.thermometer
        ends = [register.at_zero_c + value / register.lsb_per_c for value in (low, high)]
        if HANDLED_C[0] <= min(ends) and max(ends) <= HANDLED_C[1]:
            said.append(f"as this sensor's register {ends[0]:.1f} to {ends[1]:.1f} degC")
    return f" ({'; '.join(said)})" if said else ""


def _words(unit: str, low: float, high: float) -> str:
    return f"{OTHERS[unit](low):.1f} to {OTHERS[unit](high):.1f} degC"


def _handled(unit: str, low: float, high: float) -> bool:
    return HANDLED_C[0] <= OTHERS[unit](low) and OTHERS[unit](high) <= HANDLED_C[1]


def _fahrenheit_steps(step: float, profile: Profile | None) -> bool:
    if profile is None or profile.thermometer is None:
        return False
    return abs(step * abs(profile.thermometer.lsb_per_c) / 1.8 - 1) < STEP_WITHIN


def _step(values: np.ndarray) -> float:
    """The smallest difference between neighbours, beyond rounding; 0 where nothing moves."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > 1e-9]
    return float(np.quantile(steps, 0.01)) if len(steps) else 0.0
