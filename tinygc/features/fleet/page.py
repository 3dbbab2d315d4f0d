"""What people see of a fleet and of its lot: the pages of the table (counts, closures, distributions, failures), of the lot (numbers, and
units that do not belong) and of the noise of its units at rest, and the terminal's output.  Their size does not grow with the number of
sessions.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError
from session.base.texts import NONE, fixed, printable, probability, significant
from session.base.units import DEG, MG
from tinygc.features.fleet.fleet_row import VALUES
from tinygc.features.fleet.fleet_summary import IN_ORDER, SHARES, Distribution, Summary
from tinygc.features.fleet.fleet_table import EACH, Table
from tinygc.features.fleet.report import LotReport
from tinygc.models.linear import BIAS
from tinygc.noise.figures import FILE, NoiseFigures, read_figures
from tinygc.noise.measured import SHOWN, rms_of_axes
from tinygc.reporting.html.chart import Axis, Chart
from tinygc.reporting.html.markup import WIDE, Section, decimals_for, escape, facts, figure, paragraph, table
from tinygc.reporting.html.page import document
from tinygc.reporting.terminal import Group, RenderableType, Text, one_line, plain_table

if TYPE_CHECKING:
    from tinygc.features.fleet.fleet_run import FleetRun
    from tinygc.features.fleet.fleet_summary import Summary


#: columns of closures, with their titles
CLOSURES = {
    "held_out_deg": "Held-out tilt of the turns",
    "floor_deg": "Noise floor of the turns",
    "run_rmse_deg": "Worst closure run, RMSE",
}
#: px: height of a chart; width of charts side by side
HEIGHT, SMALL = 170, 410


def fleet_html(summary: Summary, more: Sequence[Section] = ()) -> str:
    """Build the page; more: sections on the sessions as a whole (lot statistics), between parameters and failures."""
    parts = []
    for caption, counts in (
        ("First look: the worst that it found", summary.first_look),
        ("Verdicts of explain", summary.verdicts),
        ("Effects that explain names", summary.effects),
    ):
        if counts:
            rows = [(escape(name), _count(count), f"{significant(100 * count / summary.sessions)} %") for name, count in counts.items()]
            parts.append(table(("", "sessions", "share"), rows, caption))
    made = [
        _counts(summary),
        _closures(summary),
        (Section("verdicts", "Why they differ", "".join(parts)) if parts else None),
        _parameters(summary),
        *more,
        _failures(summary),
    ]
    head = (
        '<header><p class="kicker">Fleet of sessions</p>'
        f"<h1>{_count(summary.sessions)} sessions, {_count(summary.units)} serial numbers</h1></header>"
    )
    foot = f"<footer>Least squares alone; every number is in fleet.sqlite. TinyGC {escape(VERSION)}.</footer>"
    return document(f"Fleet: {summary.sessions} sessions", head, [section for section in made if section is not None], foot)


def _counts(summary: Summary) -> Section:
    pairs = [
        ("Folders", _count(summary.folders)),
        ("Different sessions", _count(summary.sessions)),
        ("Done", _count(summary.done)),
        ("Failed", _count(summary.all_failed)),
        ("Pass, of those fitted", f"{_count(summary.passed)} of {_count(summary.fitted)}" if summary.fitted else "–"),
        *([("Not decided", _count(summary.undecided))] if summary.undecided else []),
        ("Computing, in all", f"{significant(summary.cpu_s / 3600)} CPU h"),
    ]
    return Section("counts", "How many", facts(pairs) + (paragraph(f"Pass {summary.rule}.", "soft") if summary.fitted else ""))


def _closures(summary: Summary) -> Section | None:
    found = {name: summary.distributions[name] for name in CLOSURES if name in summary.distributions}
    if not found:
        return None
    html = "".join(_histogram(CLOSURES[name], each, "°", 1.0, summary.limit_deg) for name, each in found.items())
    return Section("closure", "Closure", html + _table({CLOSURES[name]: (each, "°", 1.0) for name, each in found.items()}))


def _parameters(summary: Summary) -> Section | None:
    shown = {name: (summary.distributions[name], *_unit(name)) for name in VALUES if name in summary.distributions}
    if not shown:
        return None
    charts = "".join(_histogram(name, each, unit, size, widest=SMALL) for name, (each, unit, size) in shown.items())
    return Section("parameters", "Parameters", _table(shown) + f'<div class="pair">{charts}</div>')


def _failures(summary: Summary) -> Section | None:
    if not summary.reasons:
        return None
    reasons = [(escape(reason), escape(step), _count(count)) for step, reason, count in summary.reasons]
    rows = [(escape(folder), escape(step), escape(line)) for folder, step, line in summary.failures]
    cut = (
        f"The first {len(rows)} of {_count(summary.all_failed)}; fleet.sqlite and --csv have all." if len(rows) < summary.all_failed else ""
    )
    html = table(("reason", "in", "sessions"), reasons, "By reason: … stands for what differs", "words")
    return Section("failures", "Failures", html + table(("folder", "in", "because"), rows, cut or "Each", "words"))


def _unit(name: str) -> tuple[str, float]:
    """Return a parameter's displayed unit, and its size in SI."""
    if name in VALUES[BIAS]:
        return "dps", DEG
    return ("mg", MG) if name.startswith("accel_bias") else ("", 1.0)


def _table(found: dict[str, tuple[Distribution, str, float]]) -> str:
    header = ("", "sessions", *(f"{100 * share:g} %" for share in SHARES))
    rows = []
    for name, (each, unit, size) in found.items():
        label = f"{escape(name)} <small>{unit}</small>" if unit else escape(name)
        rows.append((label, _count(each.count), *(significant(value / size, 4) for value in each.quantiles)))
    return table(header, rows, "Shares of the sessions lie below", minor=(2, 6))


def _histogram(title: str, each: Distribution, unit: str, size: float, limit: float | None = None, widest: int = WIDE) -> str:
    edges, counts = each.edges / size, each.counts
    most = max(int(counts.max()), 1)
    x = np.repeat(edges, 2)[1:-1]
    heights = np.repeat(counts, 2)
    outside = f"; {each.below + each.above} lie beyond" if each.below + each.above else ""

    def draw(width: int) -> str:
        label = f"{title}, {unit}" if unit else title
        about = f"{title}: histogram of {each.count} sessions"
        x_axis = Axis(float(edges[0]), float(edges[-1]), label)
        chart = Chart(min(width, widest), HEIGHT, x_axis, Axis(0, most * 1.05), about)
        chart.area(x, np.zeros(len(x)), heights, "least_squares").line(x, heights, "least_squares", "thin")
        chart.upright(float(each.quantiles[len(SHARES) // 2]) / size, "quiet")
        if limit is not None and edges[0] <= limit <= edges[-1]:
            chart.upright(limit, "limit")
        return chart.svg()

    return figure(draw, f"{_count(each.count)} sessions, the middle dashed{outside}")


def _count(number: int) -> str:
    return f"{number:,}".replace(",", "\u202f")


# The lot.

MOST_OUTLIERS = 50


def lot_sections(report: LotReport) -> list[Section]:
    """Return the sections of a page."""
    rows = rows_of(report)
    drift = probability(report.drift_p_value)
    said = f"The lot {'drifts' if report.drifts else 'does not drift beyond chance'} ({drift}, all numbers together)."
    marked = [number for number, (_, drifts) in enumerate(rows) if drifts]
    html = paragraph(f"{report.units} units, {report.sessions} sessions. {said}")
    html += table(COLUMNS, [row for row, _ in rows], CAPTION, marked=marked)
    html += "".join(paragraph(f"{escape(note[:1].upper() + note[1:])}.", "soft") for note in report.notes)
    return [Section("lot", "The lot", html), Section("lot-outliers", "What does not belong", _outliers(report))]


def _outliers(report: LotReport) -> str:
    if not report.outliers:
        return paragraph("No unit is farther off than chance explains.")
    rows = [
        f'<div class="found">{paragraph(f"{escape(each.says)}. By chance, in such a lot: {probability(each.p_value)}.")}</div>'
        for each in report.outliers[:MOST_OUTLIERS]
    ]
    more = report.outliers_found - len(rows)
    return "".join(rows) + (paragraph(f"And {more} more, in the lot's file.", "soft") if more > 0 else "")


def lot_html(report: LotReport, more: Sequence[Section] = ()) -> str:
    """Return the page as one HTML document; more: sections at its end."""
    name = escape(report.sensor or "sensors")
    head = f'<header><p class="kicker">Lot statistics</p><h1>{name}: {report.units} units</h1></header>'
    foot = f"<footer>Statistics of a lot's calibrations. TinyGC {escape(VERSION)}.</footer>"
    return document(f"Lot: {report.units} units", head, [*lot_sections(report), *more], foot)


# Noise at rest of a fleet's units, where ``fit/noise.json`` lies in their session folders: medians, and the spread between units.
#
# The figures are read from the folders when a page is made: they are of units, and no result of a session.

TERMS = ("N", "B", "K")
#: units below which a spread says nothing
FEWEST = 3


def unit_noises(opened: Table) -> list[NoiseFigures]:
    """Return the last figures of each unit of an open table; what cannot be read is passed over."""
    found: dict[str, NoiseFigures] = {}
    for serial, folder in opened.each(f"SELECT ifnull(serial, ''), folder FROM {EACH} {IN_ORDER}"):
        path = Path(folder) / "fit" / FILE
        if not path.is_file():
            continue
        try:
            found[serial or folder] = read_figures(path)
        except CalibrationError:  # fit of that session says it
            continue
    return list(found.values())


def spread_between(values: np.ndarray, relative: np.ndarray) -> float:
    """Relative spread of a size between units, from values (U,) and their relative sigmas (U,), without the measurement's share.

    The variance of ln of the values is that between units, and the mean square of their own sigmas.
    """
    return float(np.sqrt(max(np.var(np.log(values), ddof=1) - np.mean(relative**2), 0.0)))


def noise_sections(units: Sequence[NoiseFigures]) -> list[Section]:
    """Return the section of a page; none where no unit has figures."""
    if not units:
        return []
    rows = []
    for name in TERMS:
        known = [value for unit in units if (value := rms_of_axes(unit.gyro, name)) is not None]
        values, relative = np.array(known).reshape(-1, 2).T
        unit, si = SHOWN["gyro"][name]
        middle = significant(float(np.median(values)) / si) if known else "–"
        spread = f"{significant(100 * spread_between(values, relative), 2)} %" if len(known) >= FEWEST else "–"
        rows.append((f"{name}, {unit}", str(len(known)), middle, spread))
    words = "Gyroscopes at rest, rms of the axes that show a term. The spread is without the measurement's share."
    return [Section("rest-noise", "Noise at rest", table(("", "units", "median", "spread between units"), rows, words))]


# The terminal.

# A lot: numbers, units that do not belong, notes.

MOST_SAID = 10
#: p-value below which a drift is marked
MARKED_P = 0.01
#: fewest units for a drift per 1000
FEWEST_DRIFT = 30
COLUMNS = ("", "mean ± sigma", "spread", "repeats within", "drift per 1000")
CAPTION = (
    "spread: one sigma between units, measurement noise taken out; repeats within: one sigma from session to session beyond what is stated"
)


def lot_page(report: LotReport) -> Group:
    """Headline, table, outliers, notes."""
    table = plain_table("Sensor errors", *COLUMNS, right=True)
    table.caption, table.caption_justify = CAPTION, "left"
    for row, drifts in rows_of(report):
        table.add_row(*row[:-1], Text(row[-1], "bold red" if drifts else ""))
    lines = [one_line(f"{each.says} (p = {each.p_value:.1g})", "bold red") for each in report.outliers[:MOST_SAID]]
    if report.outliers_found > MOST_SAID:
        lines.append(Text(f"and {report.outliers_found - MOST_SAID} more"))
    return Group(headline(report), table, *lines, *(one_line(f"Note: {note}.", "yellow") for note in report.notes))


def headline(report: LotReport) -> Text:
    """Number of units, drift, outliers."""
    drift = f"{'it drifts' if report.drifts else 'no drift is seen'} (p = {report.drift_p_value:.2g})"
    count = report.outliers_found
    which = f"{count} unit{'s do' if count != 1 else ' does'} not belong" if count else "all belong"
    name = f"{report.sensor}: " if report.sensor else ""
    said = f"{name}{report.units} units, {report.sessions} sessions; {drift}; {which}."
    return one_line(said, "bold yellow" if count or report.drifts else "bold")


def rows_of(report: LotReport) -> list[tuple[list[str], bool]]:
    """Return the cells of each number that any unit tells, by ``COLUMNS``, and whether it drifts."""
    rows = []
    for each in report.quantities:
        digits = decimals_for(each.mean_sigma)
        drift = NONE
        if report.units >= FEWEST_DRIFT and np.isfinite(each.drift_per_1000):
            drift = " ± ".join(fixed(value, decimals_for(each.drift_sigma)) for value in (each.drift_per_1000, each.drift_sigma))
        row = [
            f"{each.name}, {each.unit}",
            f"{fixed(each.mean, digits)} ± {fixed(each.mean_sigma, digits)}",
            fixed(each.spread, digits),
            fixed(each.repeatability, max(digits, decimals_for(each.repeatability))),  # often far below the spread between units
            drift,
        ]
        rows.append((row, report.drifts and each.drift_p_value < MARKED_P))
    return rows


# A fleet's table in a few lines.

MOST_SHOWN = 8  #: rows of each list; the page has more


def fleet_page(summary: Summary, tally: FleetRun | None) -> Group:
    """Return the summary, for rich."""
    lines = [] if tally is None else [f"this run: {tally.done} done, {tally.failed} failed, {tally.reused} known before"]
    lines.append(
        f"the table: {summary.folders} folders, {summary.sessions} different sessions of {summary.units} serial numbers; "
        f"{summary.done} done, {summary.all_failed} failed"
    )
    if summary.fitted:
        undecided = f", {summary.undecided} not decided" if summary.undecided else ""
        lines.append(f"of {summary.fitted} that were fitted, {summary.passed} pass{undecided}, {summary.missed} fail: {summary.rule}")
    for what, counts in (("first look", summary.first_look), ("explain", summary.verdicts), ("named", summary.effects)):
        if counts:
            shown = ", ".join(f"{name} {count}" for name, count in list(counts.items())[:MOST_SHOWN])
            lines.append(f"{what}: {shown}" + (" …" if len(counts) > MOST_SHOWN else ""))
    parts: list[RenderableType] = [Text(printable(line)) for line in lines]
    if summary.reasons:
        table = plain_table("Failures by reason", "sessions", "in", "because")
        table.columns[0].justify = "right"
        for step, reason, count in summary.reasons[:MOST_SHOWN]:
            table.add_row(str(count), step, printable(reason))
        parts.append(table)
    return Group(*parts)
