"""The first look at a rest log: was it still throughout, is it in the units that it says, and how far did the temperature go?"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.checks.findings import Finding
from session.checks.temperature import CHIP_C, other_unit, units_of_people
from session.common.errors import CalibrationError
from session.common.units import DEG, G
from session.detect.knocks import knocked
from session.log.config import Sensor
from session.log.rests import RestLog, read_rest

#: of one g: what an accelerometer that nobody has calibrated may read at rest
GRAVITY_WITHIN = 0.3
#: degrees within a minute: more than an accelerometer's zero can do by temperature (1.5 mg/degC, 5 degC a minute: 0.4)
TILT_DEG, TILT_BLOCKS = 0.5, 30
#: share of blocks that may be left out before the log was not at rest at all
KNOCKED_SHARE = 0.2
#: degC: what a rest log must cover before a dependence on temperature can be told from one on time
LEAST_RANGE_C = 5.0


def check_rests(paths: tuple[Path, ...], sensor: Sensor) -> list[Finding]:
    """Of rest logs as files; one that cannot be read is an error among the findings."""
    findings: list[Finding] = []
    for path in paths:
        try:
            findings += check_rest(read_rest(path, sensor))
        except CalibrationError as error:
            findings.append(Finding("error", path.name, "reading", str(error)))
    return findings


def check_rest(log: RestLog) -> list[Finding]:
    """What to know of one rest log; an ``error`` where nothing can be made of it."""
    where = log.path.name
    findings = [Finding("note", where, "reading", note) for note in log.notes]
    return [*findings, _gravity(log, where), _still(log, where), *_attitude(log, where), _temperature(log, where)]


def _gravity(log: RestLog, where: str) -> Finding:
    length_g = float(np.median(np.linalg.norm(log.accel, axis=1))) / G
    said = f"{length_g:.3f} g at rest (1 within {GRAVITY_WITHIN:g})"
    if abs(length_g - 1) <= GRAVITY_WITHIN:
        return Finding("ok", where, "gravity", said)
    return Finding("error", where, "gravity", said, "is the accelerometer's unit or full scale right, and does the sensor lie still?")


def _still(log: RestLog, where: str) -> Finding:
    out = knocked(log)
    share = float(out.mean())
    if share > KNOCKED_SHARE:
        said = f"{100 * share:.0f} % of the time is more restless than the rest (at most {100 * KNOCKED_SHARE:.0f} %)"
        return Finding("error", where, "stillness", said, "let the sensor lie where nobody walks, and nothing runs")
    if not out.any():
        return Finding("ok", where, "stillness", f"still for all of {log.duration_s:.0f} s")
    times = ", ".join(f"{t:.0f}" for t in log.t_s[np.flatnonzero(np.diff(out.astype(int), prepend=0) > 0)][:6])
    said = f"knocks at {times} s{'' if np.count_nonzero(np.diff(out.astype(int), prepend=0) > 0) <= 6 else ' and later'}"
    return Finding("note", where, "stillness", f"{said}: {np.count_nonzero(out) * log.block_s:.0f} s are left out")


def _attitude(log: RestLog, where: str) -> list[Finding]:
    """A sensor that was put down otherwise reads another share of the Earth's rate, and of gravity."""
    if len(log) < 2 * TILT_BLOCKS:
        return []
    means = np.array([np.median(part, axis=0) for part in np.array_split(log.accel, len(log) // TILT_BLOCKS)])
    means /= np.linalg.norm(means, axis=1)[:, None]
    tilts = np.linalg.norm(np.cross(means[1:], means[:-1]), axis=1) / DEG
    worst = int(np.argmax(tilts))
    if tilts[worst] <= TILT_DEG:
        return []
    at_s = float(log.t_s[min((worst + 1) * TILT_BLOCKS, len(log) - 1)])
    said = f"tilts by {tilts[worst]:.2f}° around {at_s:.0f} s (at most {TILT_DEG:g}° within {2 * TILT_BLOCKS * log.block_s:.0f} s)"
    return [Finding("warning", where, "attitude", said, "fix the sensor to something heavy; split the log where it was moved")]


def _temperature(log: RestLog, where: str) -> Finding:
    if not log.has_temperature:
        do = "log the sensor's temperature beside the rates (temp, or temp_c)"
        return Finding("warning", where, "temperature", "no column of it: noise alone can be told", do)
    low, high = float(log.temp_c.min()), float(log.temp_c.max())
    said = f"{low:.1f} to {high:.1f} °C"
    if low < CHIP_C[0] or high > CHIP_C[1]:
        do = f"is the column's unit right? temp_c is in °C{units_of_people(low, high, None)}"
        return Finding("error", where, "temperature", f"{said}, where no chip lives", do)
    if (other := other_unit(low, high, None)) is not None:
        return Finding(other[0], where, "temperature", *other[1:])
    if high - low < LEAST_RANGE_C:
        do = "let it go through the temperatures of its use, up and down"
        return Finding("warning", where, "temperature", f"{said}: {high - low:.1f} °C of change (at least {LEAST_RANGE_C:g})", do)
    return Finding("ok", where, "temperature", said)
