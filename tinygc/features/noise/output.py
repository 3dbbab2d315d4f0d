"""What ``noise`` shows: the answer, the terms of each axis, the data sheet, what is still open, remarks; and the picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Annotated

import numpy as np

from session.base.records import Size
from session.base.results import Maybe, Number, Text
from session.base.texts import NONE, measured, printable, probability, significant
from session.base.units import DEG_PER_HOUR, MDPS, MG
from session.log.registers import profile_of
from tinygc.features.noise.estimate import known_after_s
from tinygc.noise.figures import SENSORS, TERMS, AllanBand, NoiseFigures, SensorNoise, Term, described_from
from tinygc.noise.measured import SHOWN
from tinygc.reporting.drawing import Axis, Panel, Picture
from tinygc.reporting.facts import Part, Table, screen
from tinygc.reporting.pictures.noise import averaging, deviations, thinned
from tinygc.reporting.terminal import Group, one_line

#: words and SI value of the unit of each term; that of N is two-sided
UNITS = {
    "gyro": {"Q": ("µrad", 1e-6), "G": SHOWN["gyro"]["B"], "R": ("°/h/h", DEG_PER_HOUR / 3600), **SHOWN["gyro"]},
    "accel": {"Q": ("µm/s", 1e-6), "G": SHOWN["accel"]["B"], "R": ("µg/h", 1e-3 * MG / 3600), **SHOWN["accel"]},
}
#: of N, as one-sided density, which data sheets state: sqrt(2) times the two-sided one
ONE_SIDED = {"gyro": ("mdps/√Hz", MDPS / sqrt(2)), "accel": ("µg/√Hz", 1e-3 * MG / sqrt(2))}
#: terms that are always shown; the others where an axis shows them
ALWAYS = ("N", "B", "K")
#: probabilities between these are stated
UNCLEAR = (0.05, 0.95)
#: relative sigma at which a term is known
KNOWN = 0.2
#: of a data sheet's typical figure, which has one or two digits
SHEET_WITHIN = 0.1
#: of a data sheet's figure, from which on a ratio reads better than per cent
TIMES = 2.0


def noise_page(figures: NoiseFigures, remarks: Sequence[str], left_out_s: float, verbose: bool = False) -> Group:
    """The screen; left_out_s: time that is not used; verbose: with every term, its probability, every motion, and all remarks."""
    parts: list[Part] = [one_line(line, "bold red") for line in misfit_lines(figures)]
    parts += [one_line(answer(figures), "bold")]
    if figures.inflations:
        from tinygc.features.noise.inflation import inflation_lines

        parts += inflation_lines(figures.inflations, figures.gyro, verbose)
    parts.append(headline(figures))
    for kind, sensor in figures.sensors().items():
        rows = []
        for name in TERMS:
            if not (verbose or name in ALWAYS or sensor.measured(name)):
                continue
            unit, si = ONE_SIDED[kind] if name == "N" else UNITS[kind][name]
            rows.append([f"{name}  {unit}", *(term_cell(axis.terms[name], si, verbose) for axis in sensor.axes)])
            if name == "N" and verbose:
                unit, si = UNITS[kind]["N"]
                rows.append([f"   {unit}, two-sided", *(term_cell(axis.terms[name], si) for axis in sensor.axes)])
        parts.append(Table("", (f"{SENSORS[kind]}, < 95 %", "x", "y", "z"), rows))
    parts += [*described_from(figures), *sheet_lines(figures)]
    left = [f"{duration_words(left_out_s)} are left out."] if left_out_s else []
    every = [*spectral_lines(figures), *left, *remarks]
    if verbose:
        parts += [*PROBABILITY, *every]
    elif every:
        parts.append(f"{len(every)} remark{'s' * (len(every) != 1)}: --verbose")
    return screen([*parts, *next_lines(figures)])


#: what a share behind a number of the whole screen is
PROBABILITY = ["(6 %): probability that the term is in the data."]


def answer(figures: NoiseFigures) -> str:
    """The white noise of the worst axis, and the data sheet."""
    unit, si = ONE_SIDED["gyro"]
    value, _ = _worst(figures.gyro, "N")
    sheet = next((row for row in against_data_sheet(figures) if (row.sensor, row.term) == ("gyro", "N")), None)
    if value is None:
        return "Noise: no figure of the gyroscope."
    return f"Noise: {significant(value / si)} {unit}{_without(figures.gyro)}{'' if sheet is None else f' ({sheet.comparison})'}."


def duration_words(duration_s: float) -> str:
    """``45 s``, ``12 min``, ``3.1 h``, ``5.2 days``; ``never`` where it is infinite."""
    if duration_s == float("inf"):
        return "never"
    for size, most, unit in ((1, 100, "s"), (60, 100 * 60, "min"), (3600, 48 * 3600, "h")):
        if duration_s < most:
            return f"{duration_s / size:.2g} {unit}" if duration_s < 10 * size else f"{duration_s / size:.0f} {unit}"
    return f"{duration_s / 86400:.2g} days"


def headline(figures: NoiseFigures) -> str:
    """Which recording the figures are of."""
    of = " ".join(filter(None, (figures.sensor, figures.serial))) or "sensor not named"
    logs = f"{len(figures.logs)} log{'s' * (len(figures.logs) != 1)}, " if figures.logs else ""
    return f"{printable(of)}: {logs}{duration_words(figures.duration_s)} at rest, {figures.samples} samples at {figures.rate_hz:.5g} Hz"


# The table of a sensor.


def term_cell(term: Term, si: float, with_probability: bool = True) -> str:
    """``119.3 ± 8.2 (83 %)``, ``< 9.1``, the upper limit of 95 %, or a dash; with the probability where it is not clear."""
    if term.sigma is not None and term.is_determined:
        text = measured(term.value / si, term.sigma / si)
        if term.tau_s is not None:
            text += f", τ {duration_words(term.tau_s)}"
    else:
        text = NONE if term.at_most is None else f"< {significant(term.at_most / si)}"
    unclear = with_probability and UNCLEAR[0] < term.probability < UNCLEAR[1]
    return f"{text} ({100 * term.probability:.0f} %)" if unclear else text


# Kalibr's four numbers.


def _worst(sensor: SensorNoise, name: str) -> tuple[float | None, float | None]:
    """Largest value of a term and largest upper limit (95 %), SI, of the axes whose data the terms describe; None where there is none."""
    which = [axis.is_described for axis in sensor.axes]
    shown = [axis.value(name) for axis in sensor.axes if axis.is_described and axis.terms[name].is_determined]
    limit = float(max(sensor.at_most(name)[which], default=np.inf))
    return max(shown, default=None), limit if np.isfinite(limit) else None


#: keys of Kalibr's imu.yaml
KALIBR = {
    ("gyro", "N"): "gyroscope_noise_density",
    ("gyro", "K"): "gyroscope_random_walk",
    ("accel", "N"): "accelerometer_noise_density",
    ("accel", "K"): "accelerometer_random_walk",
}


def kalibr_figures(figures: NoiseFigures) -> dict[str, float | None]:
    """Kalibr's imu.yaml, SI, two-sided as it takes them: of the worst axis that is described; None where none shows the term."""
    sensors = figures.sensors()
    return {key: _worst(sensors[kind], name)[0] if kind in sensors else None for (kind, name), key in KALIBR.items()}


def _hidden(sensor: SensorNoise, name: str) -> dict[str, float]:
    """Limit of each axis that is described and shows no number of a term, infinite where the log sets none."""
    axes = zip("xyz", sensor.axes, sensor.at_most(name), strict=True)
    return {axis: float(most) for axis, own, most in axes if own.is_described and not own.terms[name].is_determined}


def _without(sensor: SensorNoise) -> str:
    """`` (without x y)``, the axes that the terms do not describe; empty where they describe all."""
    bad = [axis for axis, own in zip("xyz", sensor.axes, strict=True) if not own.is_described]
    return f" (without {' '.join(bad)})" if bad else ""


# What is still open, and when it will be known.


OF = Text(("gyro", "accel"))


@dataclass(frozen=True)
class OpenTerm:
    """A term that is not known to 20 %: of ``gyro`` or ``accel``, axis ``x``, ``y`` or ``z``; known_after_s: rest after which it is, and
    before which it is not where the term does not show: it may be smaller than its limit."""

    sensor: Annotated[str, OF]
    axis: Annotated[str, Text(("x", "y", "z"))]
    term: Annotated[str, Text(("N", "B", "K"))]
    known_after_s: Annotated[float, Maybe(Number(0))]


def open_terms(figures: NoiseFigures) -> list[OpenTerm]:
    """N, B and K of each axis that the terms describe, as far as they are not known to 20 %."""
    return [
        OpenTerm(kind, "xyz"[axis], name, max(known_after_s(figures, kind, axis, name, KNOWN), figures.duration_s))
        for kind, sensor in figures.sensors().items()
        for name in ALWAYS
        for axis in range(3)
        if sensor.axes[axis].is_described and not sensor.axes[axis].terms[name].is_known(KNOWN)
    ]


def next_lines(figures: NoiseFigures) -> list[str]:
    """How long a rest would show the terms that are not known to 20 %, of both sensors, and which none would; empty where all are known."""
    waiting, never, longest_s = dict[str, dict[str, None]](), dict[str, dict[str, None]](), 0.0  # of a sensor: its terms
    for each in open_terms(figures):
        is_never = each.known_after_s == float("inf")
        (never if is_never else waiting).setdefault(SENSORS[each.sensor], {})[each.term] = None
        longest_s = longest_s if is_never else max(longest_s, each.known_after_s)
    found = [f"Hidden below N, however long the rest: {_listed(never)}."] if never else []
    if waiting:
        rest = f"rest {duration_words(longest_s)} or more" if longest_s > 1.05 * figures.duration_s else "rest longer"
        found.append(f"next: {rest} to know {_listed(waiting)}")
    return found


def _listed(terms: Mapping[str, Iterable[str]]) -> str:
    return "; ".join(f"{sensor} {', '.join(names)}" for sensor, names in terms.items())


def misfit_lines(figures: NoiseFigures) -> list[str]:
    """A sentence for each sensor with axes that the terms do not describe: their numbers are then no noise figures."""
    lines = []
    for kind, sensor in figures.sensors().items():
        bad = {axis: own for axis, own in zip("xyz", sensor.axes, strict=True) if not own.is_described}
        if bad:
            worst = max(bad.values(), key=lambda own: own.excess)
            what = f"{significant(worst.excess)} times the terms' variance ({probability(worst.p_value)})"
            lines.append(f"NOT DESCRIBED: {SENSORS[kind]} {' '.join(bad)}, {what}.")
    return lines


def spectral_lines(figures: NoiseFigures) -> list[str]:
    """One sentence for each sensor whose spectrum has lines: frequency and rms of each axis' strongest."""
    sentences = []
    for kind, sensor in figures.sensors().items():
        unit, si = UNITS[kind]["B"]
        strongest = {axis: max(own.lines, key=lambda line: line.rms) for axis, own in zip("xyz", sensor.axes, strict=True) if own.lines}
        found = ", ".join(f"{axis} {significant(line.hz)} Hz ({significant(line.rms / si)} {unit} rms)" for axis, line in strongest.items())
        if found:
            sentences.append(f"Lines of the {SENSORS[kind]}, the strongest: {found}.")
    return sentences


# Against the data sheet, whose densities are one-sided.


@dataclass(frozen=True)
class SheetFigure:
    """A figure of the data sheet, and that of the worst axis that is described.

    sensor: ``gyro`` or ``accel``; term; unit; value: None where no axis shows it; at_most: upper limit (95 %), None where there is none;
    sheet; source; verdict: ``within`` 10 %, ``above``, ``below``, ``open`` where it is not known of some axis that is not limited by the
    sheet, ``not compared`` where the figure was not read in its source.
    """

    sensor: Annotated[str, OF]
    term: Annotated[str, Text(("N", "B"))]
    unit: str
    value: Size | None
    at_most: Size | None
    sheet: Size
    source: str
    verdict: Annotated[str, Text(("within", "above", "below", "open", "not compared"))]

    @property
    def comparison(self) -> str:
        """``data sheet 5: above by 18 %``."""
        ratio = None if self.value is None or self.verdict not in ("above", "below") else self.value / self.sheet
        by = "" if ratio is None else f" by {100 * abs(ratio - 1):.0f} %" if ratio < TIMES else f", {significant(ratio, 2)} times"
        return f"data sheet {self.sheet:g}: {self.verdict}{by}"

    @property
    def words(self) -> str:
        """``gyroscope B 5.9 °/h (data sheet 5: above by 18 %)``."""
        limit = NONE if self.at_most is None else f"< {significant(self.at_most)}"
        value = limit if self.value is None else significant(self.value) + (f", {limit}" if self.verdict == "open" else "")
        return f"{SENSORS[self.sensor]} {self.term} {value} {self.unit} ({self.comparison})"


#: figure of a profile -> its sensor, term and unit
OF_SHEETS = {
    "gyro_noise_mdps_rthz": ("gyro", "N", ONE_SIDED["gyro"]),
    "gyro_bias_instability_dph": ("gyro", "B", UNITS["gyro"]["B"]),
    "accel_noise_ug_rthz": ("accel", "N", ONE_SIDED["accel"]),
}


def against_data_sheet(figures: NoiseFigures) -> list[SheetFigure]:
    """The figures of the sensor's data sheet that are known; none of a sensor that is not, or of which the terms describe no axis."""
    profile = profile_of(figures.sensor)
    known = {} if profile is None else profile.figures
    rows = []
    for key, (kind, name, (unit, si)) in OF_SHEETS.items():
        sensor, figure = figures.sensors().get(kind), known.get(key)
        if sensor is None or figure is None or not any(axis.is_described for axis in sensor.axes):
            continue
        value, at_most = (None if size is None else size / si for size in _worst(sensor, name))
        verdict = _verdict(value, max(_hidden(sensor, name).values(), default=0.0) / si, figure.value) if figure.read else "not compared"
        rows.append(SheetFigure(kind, name, unit, value, at_most, figure.value, figure.source, verdict))
    return rows


def _verdict(value: float | None, hidden: float, sheet: float) -> str:
    """hidden: largest limit of the axes that show no number."""
    ratio = 0.0 if value is None else value / sheet
    if ratio > 1 + SHEET_WITHIN:
        return "above"
    if hidden >= sheet:
        return "open"
    return "within" if ratio >= 1 - SHEET_WITHIN else "below"


def sheet_lines(figures: NoiseFigures) -> list[str]:
    """One line for each figure of the data sheet but the answer's; one where no sheet is known."""
    rows = against_data_sheet(figures)
    if rows:
        answered = ("gyro", "N")
        lines = (f"{row.words}{_without(figures.sensors()[row.sensor])}." for row in rows if (row.sensor, row.term) != answered)
        return [f"{line[0].upper()}{line[1:]}" for line in lines]
    if not any(axis.is_described for sensor in figures.sensors().values() for axis in sensor.axes):
        return []
    if not figures.sensor:
        return ["--sensor MODEL compares with the data sheet."]
    return [f"No data sheet of {figures.sensor} is known to compare with."]


# Picture of a noise estimate: the Allan deviation, and what the model leaves.

#: most that the panel of ratios shows
MOST_RATIO = 2.0


def picture_of(figures: NoiseFigures) -> Picture:
    """The picture."""
    sensors, panels = figures.sensors(), list[Panel]()
    for draw in (deviations, _ratios):
        panels += [draw(kind, sensors[kind], thinned(figures.allan[kind])) for kind in SENSORS if kind in sensors and kind in figures.allan]
    return Picture(panels or [Panel()], headline(figures), columns=max(len(panels) // 2, 1))


def _ratios(kind: str, sensor: SensorNoise, band: AllanBand) -> Panel:
    """Draw the deviations over the model's, with the bounds of the data."""
    ticks = [(value, f"{value:g}") for value in (0.5, 0.7, 1, 1.4, 2)]
    y = Axis("data / model", 1 / MOST_RATIO, MOST_RATIO, log=True, ticks=ticks)
    panel = averaging(sensor, band, y, "", 120).across(1.0, "quiet", "hair")
    for i, (name, own) in enumerate(zip("xyz", sensor.axes, strict=True)):
        with np.errstate(divide="ignore", invalid="ignore"):
            low, mid, high = (values[:, i] / np.sqrt(own.allan_variance(band.tau_s)) for values in (band.low, band.deviation, band.high))
        known = np.isfinite(low) & np.isfinite(high)
        panel.area(band.tau_s[known], low[known], high[known], name)
        panel.line(band.tau_s, mid, name, "thin").points(band.tau_s, mid, name, ring=True, radius=2)
    return panel
