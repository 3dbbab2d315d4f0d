"""Points of a rate table: at each rate the mean of the output; of a CSV (rate-steps.md), sensor by sensor, curve by curve.

    sensor, unit, …, rate_dps, mean_v, std_v, readings

One row is one rate.  The columns of rate and output are known by their names, units stand in these, or options name both.  Columns
``sensor``, ``unit``, ``serial`` or ``axis`` separate sensors; any other column that repeats separates the curves of one sensor.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import MB, read_text
from session.base.numeric import running_sum
from session.base.texts import printable, significant
from session.base.units import DEG
from tinygc.features.tables.feature import Columns

#: a table of points that a person measured
MOST_BYTES, MOST_POINTS = 16 * MB, 2000
#: least number of rates
LEAST_RATES = 4
#: rates of one setting lie closer than two settings by this factor; readings beyond one of each that show whether the output follows
#: them, and the probability that it does
APART, LEAST_SCATTERED, FOLLOWED = 5.0, 6, 1e-3
#: of the largest output: a stated sigma below is none
LEAST_SIGMA = 1e-9
#: readings behind stated sigmas count as so many degrees of freedom at most: the setting of the table adds noise that no std shows
STATED_FREEDOM = 20.0
#: least share of the output's span that a residual may count
ROUNDING = 1e-7
#: beyond any rate, output or response
MOST = 1e12
#: digits behind the point with which an output is still taken as rounded
MOST_DECIMALS = 8
#: names of columns, before their units
RATES = ("rate", "table_rate", "input_rate", "commanded_rate", "omega", "speed", "input")
OUTPUTS = ("mean", "output", "average", "value", "voltage", "reading", "out", "signal")
STDS = ("std", "sigma", "stdev", "sd", "noise")
READINGS = ("readings", "n", "count", "samples", "n_readings")
#: what is measured next to the output begins so, and separates no curves
MEASURED = ("temp", "humidity", "pressure", "time", "supply")
SENSORS = ("sensor", "unit", "serial", "axis", "device", "name")
#: units of rate -> °/s
RATE_UNITS = {
    "dps": 1.0,
    "deg/s": 1.0,
    "°/s": 1.0,
    "deg_s": 1.0,
    "deg_per_s": 1.0,
    "rad/s": 1 / DEG,
    "rps": 1 / DEG,
    "rad_s": 1 / DEG,
    **dict.fromkeys(("rpm", "r/min", "rev/min", "u/min", "1/min"), 6.0),
}
#: units of outputs as they are shown
OUTPUT_UNITS = {
    "v": "V",
    "mv": "mV",
    "uv": "µV",
    "lsb": "LSB",
    "counts": "counts",
    "dps": "°/s",
    "deg/s": "°/s",
    "°/s": "°/s",
    "ma": "mA",
    "hz": "Hz",
}


@dataclass(frozen=True, eq=False)
class Points:
    """All points of one sensor, in the order in which they were taken.

    rate_dps (N,): of the table, °/s; output (N,) in ``unit``; sigma (N,): of the output's mean, NaN where it is not known; curve (N,):
    which curve each is of, of ``curves``, their names; direction (N,): +1 where the rate rose to this point, -1 where it fell, 0 for the
    first; order (N,): from -1/2 to 1/2, when each was taken among those of its curve; std (N,): of the readings behind each mean, NaN
    where it is not known.
    """

    sensor: str
    unit: str
    rate_dps: np.ndarray
    output: np.ndarray
    sigma: np.ndarray
    curve: np.ndarray
    curves: tuple[str, ...]
    direction: np.ndarray
    order: np.ndarray
    std: np.ndarray

    def __len__(self) -> int:
        return len(self.rate_dps)

    @cached_property
    def is_known(self) -> bool:
        """Whether the sigma of every mean is known, and not as small as its rounding."""
        return bool(np.isfinite(self.sigma).all() and (self.sigma > LEAST_SIGMA * max(np.abs(self.output).max(), 1e-300)).all())

    @cached_property
    def distinct(self) -> np.ndarray:
        """(N,) rates of which those that a table takes for one are equal: to a thousandth of the largest."""
        step = 1e-3 * max(float(np.abs(self.rate_dps).max()), 1e-300)
        found: np.ndarray = np.round(self.rate_dps / step) * step
        return found

    @property
    def both_ways(self) -> np.ndarray:
        """(M,) rates that were reached from below and from above."""
        return np.intersect1d(self.distinct[self.direction > 0], self.distinct[self.direction < 0])

    @cached_property
    def weight(self) -> np.ndarray:
        """(N,) what residuals are divided by: the stated sigmas, or 1."""
        return self.sigma if self.is_known else np.ones(len(self))

    @property
    def stated(self) -> float:
        """Degrees of freedom of stated sigmas."""
        return STATED_FREEDOM if self.is_known else 0.0

    @cached_property
    def span(self) -> float:
        """Largest less smallest output."""
        return float(np.ptp(self.output)) or 1.0

    @property
    def least(self) -> float:
        """Least residual that counts, as no output is written with more digits."""
        return ROUNDING * self.span

    @cached_property
    def floor(self) -> float:
        """Least sum of squared whitened residuals that counts: that of the outputs' last digit, and of the noise that rounding is."""
        return float(np.sum((max(self.least, self.quantum / np.sqrt(12)) / self.weight) ** 2))

    @property
    def quantum(self) -> float:
        """Step of the last decimal that any output is written with; 0 where they have more than ``MOST_DECIMALS``."""
        for decimals in range(MOST_DECIMALS + 1):
            if (np.abs(np.round(self.output, decimals) - self.output) <= 1e-12 * np.abs(self.output).max()).all():
                return float(10.0**-decimals)
        return 0.0

    def part(self, which: np.ndarray) -> Points:
        """The points (N,) bool that are chosen, with their curves alone."""
        rows = ("rate_dps", "output", "sigma", "direction", "order", "std")
        numbers, curve = np.unique(self.curve[which], return_inverse=True)
        names = tuple(self.curves[n] for n in numbers)
        return replace(self, curve=curve, curves=names, **{name: getattr(self, name)[which] for name in rows})


def settings_of(points: Points) -> tuple[Points, list[str]]:
    """One point for each setting of the table, where the rates within one scatter and the output does not follow them; a remark of it.

    The rate of a reading then is wrong: K (rate - mean of its setting) would add to the scatter of the output, and does not.
    """
    order = np.argsort(points.rate_dps, kind="stable")
    gaps = np.diff(points.rate_dps[order])
    sizes = np.unique(gaps[gaps > 0])
    if len(sizes) < 2 or (ratio := sizes[1:] / sizes[:-1]).max() < APART:
        return points, []
    setting = np.empty(len(points), dtype=int)
    setting[order] = running_sum(gaps > sizes[np.argmax(ratio)])
    begins = np.concatenate([[True], (np.diff(setting) != 0) | (np.diff(points.curve) != 0)])
    visit = np.cumsum(begins) - 1
    count = np.bincount(visit)

    def mean(values: np.ndarray) -> np.ndarray:
        found: np.ndarray = np.bincount(visit, values) / count
        return found

    rate, output, freedom = mean(points.rate_dps), mean(points.output), len(points) - len(count)
    if len(np.unique(setting)) < LEAST_RATES or freedom < LEAST_SCATTERED:
        return points, []
    scale = float(np.polyfit(rate, output, 1)[0])
    off, own = points.rate_dps - rate[visit], points.output - output[visit]
    from scipy.special import fdtrc

    if fdtrc(freedom, freedom, float(np.sum((own - scale * off) ** 2) / np.sum(own**2))) > FOLLOWED:
        return points, []
    moved = (np.bincount(visit, off**2) > 0) | ((count == 1) & (rate != 0))  # what was read once is wrong as much, but at rest
    rate_error = float(np.sqrt(np.sum(off**2) / np.sum((count - 1)[moved])))
    noise = float(np.sqrt(np.sum(own**2) / freedom))
    first = np.flatnonzero(begins)
    sigma = np.sqrt((noise**2 + (scale * rate_error * moved) ** 2) / count)
    settled = points_of(points.sensor, points.unit, rate, output, [points.curves[n] for n in points.curve[first]], sigma)
    scatter = f"{printable(points.sensor)}: within a setting the rates scatter by {significant(rate_error, 2)} °/s"
    return settled, [
        f"{scatter}, which the output does not follow: taken for errors of the rates, {len(points)} readings for {len(count)} settings."
    ]


def points_of(
    sensor: str,
    unit: str,
    rate_dps: np.ndarray,
    output: np.ndarray,
    curve: Sequence[str],
    sigma: np.ndarray | None = None,
    std: np.ndarray | None = None,
) -> Points:
    """Points of arrays (N,); curve: the name of each point's curve.  FormatError for fewer than four rates, or a constant output."""
    rate_dps, output = np.asarray(rate_dps, dtype=float), np.asarray(output, dtype=float)
    names = tuple(dict.fromkeys(curve))
    which = np.array([names.index(name) for name in curve])
    if not (np.isfinite(rate_dps).all() and np.isfinite(output).all()):
        raise FormatError(f"{printable(sensor)}: a rate or an output is not finite; leave its row out")
    if len(np.unique(rate_dps)) < LEAST_RATES:
        raise FormatError(f"{printable(sensor)}: {len(np.unique(rate_dps))} rates, expected at least four, in both senses")
    if not np.ptp(output) > LEAST_SIGMA * np.abs(output).max():
        raise FormatError(
            f"{printable(sensor)}: the output is {output[0]:g} {unit} at every rate, expected one that follows it; "
            "name the output's column with --output-column"
        )
    step = np.concatenate([[0.0], np.sign(np.diff(rate_dps))])
    step[1:][np.diff(which) != 0] = 0.0  # a curve begins
    order = np.zeros(len(rate_dps))
    for number in range(len(names)):
        order[which == number] = np.linspace(-0.5, 0.5, int(np.sum(which == number)))
    known, spread = (np.full(len(rate_dps), np.nan) if each is None else np.asarray(each, dtype=float) for each in (sigma, std))
    return Points(sensor, unit, rate_dps, output, known, which, names, step, order, spread)


def read_points(path: Path, columns: Columns | None = None) -> tuple[list[Points], list[str]]:
    """Points of each sensor of a CSV, and remarks.  Raises FormatError, which names the line and what was expected."""
    columns = columns or Columns()
    header, rows = read_table(path)
    rate = _column(path, header, columns.rate_column, RATES, RATE_UNITS, "rate")
    output = _column(path, header, columns.output_column, OUTPUTS, OUTPUT_UNITS, "output", rate)
    std, readings = (column_of(header, names) for names in (STDS, READINGS))
    more = [n for n in range(len(header)) if n not in (rate, output, std, readings)]
    names = [n for n in more if header[n].lower() in SENSORS]
    others = [
        n
        for n in more
        if n not in names and not header[n].lower().startswith(MEASURED) and 1 < len({row[n] for _, row in rows}) <= len(rows) / 2
    ]
    remarks = []
    unit = columns.unit or OUTPUT_UNITS.get(_suffix(header[output]), "")
    if not unit:
        unit = "units"
        remarks.append(f"The column {printable(header[output])!r} states no unit; --output-unit V gives one.")
    stated = None if columns.readings else readings  # the option's number is that of every row
    rate_dps, outputs, spread, count = (
        np.full(len(rows), np.nan) if column is None else numbers_in(path, header, rows, column) for column in (rate, output, std, stated)
    )
    rate_dps *= _rate_factor(path, header[rate])
    count = np.full(len(rows), float(columns.readings)) if columns.readings else count
    if (wrong := (spread < 0) | (count < 1)).any():
        line = rows[int(np.argmax(wrong))][0]
        raise FormatError(f"{path} line {line}: a std below 0, or less than one reading; correct it, or leave the row out")
    sigma = np.where(count >= 2, spread / np.sqrt(count), np.nan)
    owners = np.array([" ".join(row[n] for n in names) or path.stem for _, row in rows])
    curves = np.array([", ".join(f"{header[n]} {row[n]}" for n in others) for _, row in rows])
    if std is not None and readings is None and columns.readings is None:
        remarks.append("How many readings are behind each std is not stated, so the noise comes from repeats and residuals (--readings N).")
    found: list[Points] = []
    refused: list[str] = []
    for sensor in dict.fromkeys(owners.tolist()):
        at = owners == sensor
        try:
            own = points_of(sensor, unit, rate_dps[at], outputs[at], curves[at].tolist(), sigma[at], spread[at])
        except FormatError as error:
            refused.append(str(error))
            continue
        found.append(own)
        if np.isfinite(own.sigma).any() and not own.is_known:
            remarks.append(f"{printable(sensor)}: a std is 0 or has one reading behind it, so no std of it is used.")
    if not found:
        raise FormatError(f"{path}: {refused[0]}")
    if others:
        separated = ", ".join(printable(header[n]) for n in others)
        remarks.append(f"Each {separated} is a curve with an offset of its own; leave out a column that only states conditions.")
    return found, remarks + [f"{each}: left out." for each in refused]


def read_table(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Header and rows of a CSV, each with the number of its line.  Raises FormatError."""
    text = read_text(path, MOST_BYTES)
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if len(lines) < 2:
        raise FormatError(f"{path}: empty; expected a header with a rate and an output, as rate_dps,mean_v, and a row for each rate")
    mark = ";" if lines[0][1].count(";") > lines[0][1].count(",") else ","
    try:
        cells = [next(csv.reader([line], delimiter=mark)) for _, line in lines]
    except csv.Error as error:
        raise FormatError(f"{path}: no table of text: {error}; expected a CSV with a header such as rate_dps,mean_v") from None
    header = [cell.strip() for cell in cells[0]]
    rows = [(number, row) for (number, _), row in zip(lines[1:], cells[1:], strict=True)]
    for number, row in rows:
        if len(row) != len(header):
            comma = "; a decimal is written with a point" if len(row) == 2 * len(header) else ""
            raise FormatError(f"{path} line {number}: {len(row)} columns, expected the {len(header)} of the header{comma}")
    if len(rows) > MOST_POINTS:
        raise FormatError(f"{path}: {len(rows)} points, expected at most {MOST_POINTS}; is it a log? give one row for each rate")
    return header, rows


def column_of(header: Sequence[str], names: Sequence[str]) -> int | None:
    """The column with the first of these names, by itself or before a unit."""
    plain = [re.sub(r"[\s(\[].*", "", name.lower()) for name in header]
    for wanted in names:
        for number, name in enumerate(plain):
            tail = name.removeprefix(wanted)
            if name == wanted or (tail != name and tail.startswith("_") and (tail[1:] in RATE_UNITS or tail[1:] in OUTPUT_UNITS)):
                return number
    return None


def _column(
    path: Path,
    header: Sequence[str],
    wanted: str,
    names: Sequence[str],
    units: Iterable[str],
    what: str,
    taken: int | None = None,
) -> int:
    """names: of such a column; units: that it may have; what: of its option too; taken: a column that is another one."""
    option = f"--{what}-column"
    if wanted:
        if wanted not in header:
            raise FormatError(f"{path}: no column {printable(wanted)!r} ({option}); it has {', '.join(map(printable, header))[:200]}")
        return header.index(wanted)
    if (found := column_of(header, names)) is not None:
        return found
    # The only other column that is called as a unit is, or the only one that ends in one
    left = [n for n in range(len(header)) if n != taken]
    by_unit = [n for n in left if header[n].lower() in units] or [n for n in left if _suffix(header[n]) in units]
    if len(by_unit) != 1:
        raise FormatError(
            f"{path}: no column of {what}, such as {names[0]}_dps, among {', '.join(map(printable, header))[:200]}; name it with {option}"
        )
    return by_unit[0]


def _suffix(name: str) -> str:
    """The unit that a column's name ends with, in brackets or after its last underscore; small letters."""
    bracket = re.search(r"[(\[]([^()\[\]]*+)[)\]]\s*+$", name)
    return (bracket[1] if bracket else name.rpartition("_")[2] if "_" in name else "").strip().lower()


def _rate_factor(path: Path, name: str) -> float:
    for unit, factor in RATE_UNITS.items():
        if unit in (name.lower(), _suffix(name)) or name.lower().endswith(f"_{unit}"):
            return factor
    raise FormatError(f"{path}: the column {printable(name)!r} states no unit; call it rate_dps, rate_rad_s or rate_rpm")


def numbers_in(path: Path, header: Sequence[str], rows: Sequence[tuple[int, list[str]]], column: int) -> np.ndarray:
    """(N,) numbers of a column; FormatError names the line and the column."""
    found = []
    for line, row in rows:
        try:
            found.append(float(row[column]))
        except ValueError:
            found.append(float("nan"))
        if not abs(found[-1]) <= MOST:
            what, point = f"{printable(header[column])} is {printable(row[column])[:40]!r}", " with a decimal point" * ("," in row[column])
            raise FormatError(f"{path} line {line}: {what}, expected a number{point}; correct it, or leave the row out")
    return np.array(found)
