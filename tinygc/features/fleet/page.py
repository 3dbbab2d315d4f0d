"""What people see of a fleet and of its lot, on the screen and on pages: counts, closures, distributions, failures; the lot's numbers, and
units that do not belong; the noise of its units at rest.  Their size does not grow with the number of sessions.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from session.base.errors import CalibrationError
from session.base.texts import printable, probability, significant
from session.base.units import DEG, MG
from tinygc.features.fleet.fleet_row import VALUES
from tinygc.features.fleet.fleet_summary import IN_ORDER, SHARES, Distribution, Summary
from tinygc.features.fleet.fleet_table import EACH
from tinygc.features.fleet.fleet_table import Table as FleetTable
from tinygc.features.fleet.report import LotReport
from tinygc.models.linear import BIAS
from tinygc.noise.figures import FILE, NoiseFigures, read_figures
from tinygc.noise.measured import SHOWN, rms_of_axes
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.facts import Chapter, Part, Table, html, page
from tinygc.reporting.html.markup import WIDE
from tinygc.reporting.terminal import Text, one_line

if TYPE_CHECKING:
    from tinygc.features.fleet.fleet_run import FleetRun


#: columns of closures, with their titles
CLOSURES = {
    "held_out_deg": "Held-out tilt of the turns",
    "floor_deg": "Noise floor of the turns",
    "run_rmse_deg": "Worst closure run, RMSE",
}
#: px: height of a chart; width of charts side by side
HEIGHT, SMALL = 170, 410


def fleet_facts(summary: Summary, tally: FleetRun | None = None) -> list[Part]:
    """Counts, what the steps found, and reasons of failures; tally: of this run."""
    parts: list[Part] = [] if tally is None else [f"this run: {tally.done} done, {tally.failed} failed, {tally.reused} known before"]
    parts.append(
        f"the table: {summary.folders} folders, {summary.sessions} different sessions of {summary.units} serial numbers; "
        f"{summary.done} done, {summary.all_failed} failed, {significant(summary.cpu_s / 3600)} CPU h"
    )
    if summary.fitted:
        undecided = f", {summary.undecided} not decided" if summary.undecided else ""
        parts.append(f"of {summary.fitted} that were fitted, {summary.passed} pass{undecided}, {summary.missed} fail: {summary.rule}")
    for title, counts in (
        ("First look: the worst that it found", summary.first_look),
        ("Verdicts of explain", summary.verdicts),
        ("Effects that explain names", summary.effects),
    ):
        if counts:
            rows = [(name, count, f"{significant(100 * count / summary.sessions)} %") for name, count in counts.items()]
            parts.append(Table(title, ("", "sessions", "share"), rows))
    if summary.reasons:
        failed = [(printable(reason), step, count) for step, reason, count in summary.reasons]
        parts.append(Table("Failures by reason: … stands for what differs", ("because", "in", "sessions"), failed, left=(0, 1)))
    return parts


def fleet_html(summary: Summary, more: Sequence[Chapter] = ()) -> str:
    """Build the page; more: chapters on the sessions as a whole (lot statistics), between parameters and failures."""
    made: list[Chapter] = [("counts", "How many", fleet_facts(summary))]
    if found := {CLOSURES[name]: (summary.distributions[name], "°", 1.0) for name in CLOSURES if name in summary.distributions}:
        drawn = [_histogram(title, *each, summary.limit_deg) for title, each in found.items()]
        made.append(("closure", "Closure", [*drawn, _shares(found)]))
    if shown := {name: (summary.distributions[name], *_unit(name)) for name in VALUES if name in summary.distributions}:
        charts = html(_histogram(name, *each, widest=SMALL) for name, each in shown.items())
        made.append(("parameters", "Parameters", html([_shares(shown)]) + f'<div class="pair">{charts}</div>'))
    made += more
    if summary.failures:
        cut = f"the first {len(summary.failures)} of {summary.all_failed}; fleet.sqlite and --csv have all"
        each = Table("", ("folder", "in", "because"), summary.failures, cut, (0, 1, 2), kind="words")
        made.append(("failures", "Failures", [each]))
    title = f"{summary.sessions} sessions, {summary.units} serial numbers"
    return page("Fleet of sessions", title, made, "Least squares alone; every number is in fleet.sqlite.")


def _unit(name: str) -> tuple[str, float]:
    """Return a parameter's displayed unit, and its size in SI."""
    if name in VALUES[BIAS]:
        return "dps", DEG
    return ("mg", MG) if name.startswith("accel_bias") else ("", 1.0)


def _shares(found: dict[str, tuple[Distribution, str, float]]) -> Table:
    header = ("", "sessions", *(f"{100 * share:g} %" for share in SHARES))
    rows = [
        (f"{name}, {unit}" if unit else name, each.count, *(significant(value / size, 4) for value in each.quantiles))
        for name, (each, unit, size) in found.items()
    ]
    return Table("Shares of the sessions lie below", header, rows, minor=(2, 6))


def _histogram(title: str, each: Distribution, unit: str, size: float, limit: float | None = None, widest: int = WIDE) -> Panel:
    edges, counts = each.edges / size, each.counts
    x, heights = np.repeat(edges, 2)[1:-1], np.repeat(counts, 2)
    outside = f"; {each.below + each.above} lie beyond" if each.below + each.above else ""
    panel = Panel(Axis(f"{title} ({unit})" if unit else title, float(edges[0]), float(edges[-1])), Axis("sessions", lo=0), height=HEIGHT)
    panel.about, panel.caption = f"{title}: histogram of {each.count} sessions", f"{each.count} sessions, the middle dashed{outside}"
    panel.widest = widest
    panel.area(x, 0, heights, "least_squares").line(x, heights, "least_squares", "thin")
    panel.upright(float(each.quantiles[len(SHARES) // 2]) / size, "quiet")
    return panel.upright(limit, "limit", name="limit") if limit is not None and edges[0] <= limit <= edges[-1] else panel


# The lot.

#: units that are listed one by one, the least probable first
MOST_OUTLIERS = 10
#: p-value below which a drift is marked
MARKED_P = 0.01
#: fewest units for a drift per 1000
FEWEST_DRIFT = 30


def lot_facts(report: LotReport) -> list[Part]:
    """Headline, numbers, units that do not belong, notes."""
    rows = [
        [
            f"{each.name}, {each.unit}",
            (each.mean, each.mean_sigma),
            significant(each.spread, 2),
            significant(each.repeatability, 2),
            (each.drift_per_1000 if report.units >= FEWEST_DRIFT else None, each.drift_sigma),
        ]
        for each in report.quantities
    ]
    styles = {k: "bold red" for k, each in enumerate(report.quantities) if report.drifts and each.drift_p_value < MARKED_P}
    said = "spread: one sigma between units, measurement noise taken out; repeats within: from session to session beyond what is stated"
    header = ("", "mean ± sigma", "spread", "repeats within", "drift per 1000")
    parts: list[Part] = [headline(report), Table("Sensor errors", header, rows, said, styles=styles)]
    parts += [one_line(f"{each.says} ({probability(each.p_value)})", "bold red") for each in report.outliers[:MOST_OUTLIERS]]
    if report.outliers_found > MOST_OUTLIERS:
        parts.append(f"and {report.outliers_found - MOST_OUTLIERS} more, in the lot's file")
    return parts + [one_line(f"Note: {note}.", "yellow") for note in report.notes]


def headline(report: LotReport) -> Text:
    """Number of units, drift, outliers."""
    drift = f"{'it drifts' if report.drifts else 'no drift is seen'} (p = {report.drift_p_value:.2g})"
    count = report.outliers_found
    which = f"{count} unit{'s do' if count != 1 else ' does'} not belong" if count else "all belong"
    name = f"{report.sensor}: " if report.sensor else ""
    said = f"{name}{report.units} units, {report.sessions} sessions; {drift}; {which}."
    return one_line(said, "bold yellow" if count or report.drifts else "bold")


def lot_html(report: LotReport, more: Sequence[Chapter] = ()) -> str:
    """Return the page as one HTML document; more: chapters at its end."""
    heading = f"{report.sensor or 'sensors'}: {report.units} units"
    return page("Lot statistics", heading, [lot_chapter(report), *more], "Statistics of a lot's calibrations.")


def lot_chapter(report: LotReport) -> Chapter:
    """What a page has of a lot."""
    return "lot", "The lot", lot_facts(report)


# Noise at rest of a fleet's units, where ``fit/noise.json`` lies in their session folders: medians, and the spread between units.
#
# The figures are read from the folders when a page is made: they are of units, and no result of a session.

TERMS = ("N", "B", "K")
#: units below which a spread says nothing
FEWEST = 3


def unit_noises(opened: FleetTable) -> list[NoiseFigures]:
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


def noise_chapters(units: Sequence[NoiseFigures]) -> list[Chapter]:
    """Return the chapter of a page; none where no unit has figures."""
    rows = []
    for name in TERMS:
        known = [value for unit in units if (value := rms_of_axes(unit.gyro, name)) is not None]
        values, relative = np.array(known).reshape(-1, 2).T
        unit, si = SHOWN["gyro"][name]
        middle = float(np.median(values)) / si if known else None
        spread = f"{significant(100 * spread_between(values, relative), 2)} %" if len(known) >= FEWEST else None
        rows.append((f"{name}, {unit}", len(known), middle, spread))
    words = "Gyroscopes at rest, rms of the axes that show a term. The spread is without the measurement's share"
    table = Table(words, ("", "units", "median", "spread between units"), rows)
    return [("rest-noise", "Noise at rest", [table])] if units else []
