"""A file with an Allan curve: averaging times, and the deviations of a gyroscope's axes, an accelerometer's, or both.

Plain text, a row for each averaging time: tau in s, then one column or three of each sensor.  Units stand in brackets in a line before the
rows, in the order of the columns, as allan_variance_ros and others write them, or are given: ``deg/s,m/s2``.

Its terms are fitted as those of a log.  A curve holds less than its log: what is known is each deviation, not how two of them vary
together.  One deviation of each octave is taken, since overlapping estimates an octave apart are nearly independent, with the degrees of
freedom of the least informative noise, a random walk of the rate (NIST SP 1065, table 5).  So the sigmas of N are somewhat too large.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from session.base.errors import DataError, FormatError
from session.base.files import MB, read_text
from session.base.texts import measured
from session.base.units import DEG_PER_HOUR, MG, known, parse_unit
from tinygc.features.noise.choice import FILTER, Search, Stacked
from tinygc.features.noise.estimate import fitted
from tinygc.features.noise.scales import Group
from tinygc.noise.figures import SENSORS, AllanBand, AxisNoise, NoiseFigures, SensorNoise, unit_allan_variance

#: of a file, bytes; and rows, far beyond any curve
MOST_BYTES, MOST_ROWS = 16 * MB, 100_000
#: fewest averaging times that hold a shape
LEAST_ROWS = 6
#: a recording over the longest averaging time of its curve, as tools choose it, where its length is not known
USUAL_LENGTH = 10.0
#: further units of such curves, SI
OF_CURVES = {
    "gyro": {"deg/h": DEG_PER_HOUR, "deg/hr": DEG_PER_HOUR, "°/h": DEG_PER_HOUR, "dph": DEG_PER_HOUR},
    "accel": {"ug": 1e-3 * MG, "µg": 1e-3 * MG, "μg": 1e-3 * MG},
}
#: what a deviation is written as in brackets: (deg/s) or [m/s2]
BRACKETS = re.compile(r"[(\[]([^()\[\]]{1,20})[)\]]")


def read_curve(path: Path, units: str | None = None) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Read a curve: averaging times (K,) s, increasing; by ``gyro`` and ``accel``, deviations (K, A) SI of one axis or three.

    units: of the deviations in the order of the columns, separated by commas, where the file does not state them.

    Raises FormatError, with the line, for what is no curve, and where the units are not known.
    """
    words: list[str] = []
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(path, MOST_BYTES).splitlines(), start=1):
        cells = [cell for cell in re.split(r"[,;\s]+", line.partition("#")[0].strip()) if cell]
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            if rows:
                raise FormatError(f"{path.name} line {number}: {line.strip()[:40]!r} is no row of numbers; correct or remove it") from None
            row = []
        if not row:
            words.append(line)
            continue
        if rows and len(row) != len(rows[0]):
            raise FormatError(f"{path.name} line {number}: {len(row)} columns, and {len(rows[0])} before; correct or remove it")
        if not all(0 < value < 1e12 for value in row) or (rows and row[0] <= rows[-1][0]):
            raise FormatError(
                f"{path.name} line {number}: expected averaging times that increase and deviations above 0; correct or remove it"
            )
        rows.append(row)
        if len(rows) > MOST_ROWS:
            raise FormatError(f"{path.name}: more than {MOST_ROWS} averaging times; that is no Allan curve")
    if len(rows) < LEAST_ROWS:
        raise FormatError(f"{path.name}: {len(rows)} averaging times, expected {LEAST_ROWS} at least: rows of tau and deviations")
    table = np.array(rows)
    # The sensor and the SI value of each unit, in the order of the columns
    texts = [text.strip() for text in units.split(",")] if units else [text.strip() for line in words for text in BRACKETS.findall(line)]
    found: list[tuple[str, float]] = []
    for text in texts:
        sensor = _unit(text)
        if sensor is not None and sensor not in found:
            found.append(sensor)
        elif sensor is None and units:
            raise FormatError(
                f"--curve-units: {text[:30]!r} is no unit of a deviation; expected {known('gyro')}, deg/h; {known('accel')}, ug"
            )
    return table[:, 0], _sensors(path.name, table[:, 1:], found)


def _unit(text: str) -> tuple[str, float] | None:
    for kind, more in OF_CURVES.items():
        unit = parse_unit(kind, text)
        si = more.get(text) if unit is None else unit.si
        if si is not None:
            return kind, si
    return None


def _sensors(name: str, columns: np.ndarray, units: list[tuple[str, float]]) -> dict[str, np.ndarray]:
    count = columns.shape[1]
    kinds = [kind for kind, _ in units]
    sizes = {1: [1], 2: [1, 1], 3: [3], 6: [3, 3]}.get(count)
    if sizes is None:
        raise FormatError(f"{name}: {count + 1} columns, expected tau and 1 or 3 deviations of each sensor, 2, 3, 4 or 7 in all")
    if len(units) != len(sizes) or len(set(kinds)) != len(kinds):
        what = "one unit" if len(sizes) == 1 else "two units, one of each sensor in the order of the columns"
        example = "deg/s" if len(sizes) == 1 else "m/s2,deg/s"
        raise FormatError(f"{name}: its header does not state {what}; give --curve-units, such as --curve-units {example}")
    edges = np.cumsum(sizes)[:-1]
    return {kind: part * si for (kind, si), part in zip(units, np.split(columns, edges, axis=1), strict=True)}


# Its terms.

#: octaves that a curve needs, and those that are kept where the finest are left out
LEAST_OCTAVES, KEPT_OCTAVES = 4, 6
#: degrees of freedom of a deviation that is used
LEAST_FREEDOM = 2.0


class CurveSearch(Search):
    """The same search, with one Allan variance for each group: sizes of groups are indices of averaging times."""

    def __init__(self, tau_s: np.ndarray, variance: np.ndarray, freedom: np.ndarray, is_behind_filter: bool):
        self.tau_s = tau_s
        groups = [
            Group(k, np.arange(2), np.eye(1), np.array([[f * v]]), float(f)) for k, (v, f) in enumerate(zip(variance, freedom, strict=True))
        ]
        super().__init__(groups, 1.0, is_behind_filter=is_behind_filter)

    def unit(self, name: str, correlation_s: float = 1.0, hz: float = 0.0) -> Stacked:
        """Return the Allan variance of a term of size 1 at each averaging time."""
        sign = -1 if name == FILTER else 1
        return [sign * unit_allan_variance("Q" if name == FILTER else name, self.tau_s, correlation_s)[:, None, None]]

    def finest_s(self) -> float:
        """Return the shortest averaging time, s."""
        return float(self.tau_s[0])

    def bounds(self) -> tuple[float, float]:
        """Correlation times that the curve shows by both their sides."""
        return float(2 * self.tau_s[0]), float(self.tau_s[-1] / 2)


def fit_curve(tau_s: np.ndarray, deviation: np.ndarray, duration_s: float) -> list[AxisNoise]:
    """Fit the terms to Allan deviations (K, A) at averaging times tau_s (K,), SI, of a log of a duration.

    Returns a record for each of the A axes.  Raises DataError for a curve of less than four octaves.
    """
    order = np.argsort(tau_s)
    tau_s, deviation = np.asarray(tau_s, dtype=float)[order], np.asarray(deviation, dtype=float)[order]
    octaves = np.arange(np.log2(tau_s[0]), np.log2(tau_s[-1]) + 1e-9)
    at = np.unique([int(np.argmin(np.abs(np.log2(tau_s) - octave))) for octave in octaves])
    points = duration_s / tau_s[at]
    freedom = np.maximum(points - 2, 0) * (1 - 3 / points + 4 / points**2)
    used = at[freedom >= LEAST_FREEDOM]
    freedom = freedom[freedom >= LEAST_FREEDOM]
    if len(used) < LEAST_OCTAVES:
        raise DataError(f"the curve has {len(used)} octaves of averaging times that mean something, expected {LEAST_OCTAVES} or more")
    return [_axis(tau_s[used], column**2, freedom) for column in deviation[used].T]


def _axis(tau_s: np.ndarray, variance: np.ndarray, freedom: np.ndarray) -> AxisNoise:
    """Fit one axis."""
    from_s = [0.0, *tau_s[1 : max(len(tau_s) - KEPT_OCTAVES, 0) + 1].tolist()]
    return fitted(lambda start: CurveSearch(tau_s[start:], variance[start:], freedom[start:], start > 0), from_s)


def estimate_of_curve(path: Path, units: str | None, duration_s: float | None, rate_hz: float | None) -> tuple[NoiseFigures, list[str]]:
    """Estimate the terms of a curve in a file, and list what was assumed; duration_s, rate_hz: of the recording behind it, where known.

    Raises FormatError and DataError, in one line.
    """
    tau_s, deviations = read_curve(path, units)
    if "gyro" not in deviations:
        raise DataError(f"{path.name}: it holds no gyroscope, of which the noise figures are; give its curve as well")
    remarks = []
    if duration_s is None:
        duration_s = USUAL_LENGTH * float(tau_s[-1])
        remarks.append(f"The recording is taken to be {USUAL_LENGTH:g} times its longest averaging time, {duration_s:.0f} s (--duration).")
    elif duration_s < 2 * tau_s[-1]:
        raise DataError(f"{path.name}: it goes to {measured(tau_s[-1])} s, beyond {measured(duration_s)} s of recording; give --duration")
    axes: dict[str, SensorNoise] = {}
    for kind, deviation in deviations.items():
        found = fit_curve(tau_s, deviation, duration_s)
        if len(found) == 1:
            remarks.append(f"The curve of the {SENSORS[kind]} is of one axis, which stands for all three.")
        x, y, z = found if len(found) == 3 else found * 3
        axes[kind] = SensorNoise((x, y, z))
    rate = rate_hz or 1 / float(tau_s[0])
    if rate_hz is None:
        remarks.append(f"The data rate is not known: 1 over the shortest averaging time, {measured(rate)} Hz, stands for it (--odr).")
    nothing = np.full((len(tau_s), 3), np.nan)
    bands = {kind: AllanBand(tau_s, np.broadcast_to(part, nothing.shape), nothing, nothing) for kind, part in deviations.items()}
    figures = NoiseFigures(
        allan=bands,
        gyro=axes["gyro"],
        accel=axes.get("accel"),
        rate_hz=rate,
        duration_s=duration_s,
        samples=round(duration_s * rate),
        logs=(path.name,),
        rate_known=rate_hz is not None,
    )
    return figures, remarks
