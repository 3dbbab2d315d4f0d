"""Terminal output of a lot and of a fleet's table."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from session.io.texts import printable
from tinygc.annexes.lots.lot import SENSOR_ERRORS, PooledEffect
from tinygc.annexes.lots.report import LotQuantity, LotReport
from tinygc.reporting.terminal import Group, RenderableType, Table, Text, one_line

if TYPE_CHECKING:
    from tinygc.annexes.lots.fleet_run import Tally
    from tinygc.annexes.lots.fleet_summary import Summary


# A lot: numbers, repeatability, charts, outliers, capability.

NONE = "–"
MOST_OUTLIERS = 10
#: p-value below which a drift, or a ratio of repeats to stated sigmas, is marked
MARKED_P = 0.01
#: fewest units for a drift per 1000
FEWEST_DRIFT = 30
#: ppm below which a tail follows from the formula only, not from sensors
LEAST_PPM = 0.001
UNIT_OF = {each.key: each for each in SENSOR_ERRORS}


def lot_page(report: LotReport) -> Group:
    """Headline, tables, control charts, outliers, notes."""
    parts: list[RenderableType] = [headline(report), _numbers(report)]
    if any(np.isfinite(each.percent_grr) for each in report.gauges.values()):
        parts.append(_gauges(report))
    if report.capabilities:
        parts.append(_capabilities(report))
    parts += [*_charts(report), *_outliers(report)]
    parts += [one_line(f"Effect of the lot: {effect_words(name, found)}.", "bold yellow") for name, found in report.lot.effects.items()]
    return Group(*parts, *(one_line(f"Note: {note}.", "yellow") for note in report.notes))


def effect_words(name: str, found: PooledEffect) -> str:
    """Describe a pooled effect: its name, share of units, and significance."""
    as_well = f"; could as well be {', '.join(found.equivalent)}" if found.equivalent else ""
    return f"{name}, in {found.share:.0%} of {found.units} units that tell, p = {found.p_value:.2g}{as_well}"


def headline(report: LotReport) -> Text:
    """Number of units, drift, outliers."""
    lot, found = report.lot, report.hierarchy
    drift = f"it drifts (p = {found.drift_p:.2g})" if found.drifts else f"no drift is seen (p = {found.drift_p:.2g})"
    tails = "" if np.isinf(lot.tails) else f"; tails of {lot.tails:.3g} degrees of freedom"
    odd = len(report.outliers)
    open_ = int(np.sum(found.belongs <= 0.5))
    which = f"{odd} unit{'s' * (odd != 1)} or sessions do not belong" if odd else "all belong"
    if not odd and open_:
        which = f"none is odd beyond chance, {open_} may not belong"
    name = f"{lot.sensor}: " if lot.sensor else ""
    return one_line(
        f"{name}{lot.units} units, {lot.sessions} sessions; {drift}; {which}{tails}.", "bold yellow" if odd or found.drifts else "bold"
    )


def _numbers(report: LotReport) -> Table:
    table = Table(title="Sensor errors", title_justify="left", box=None, padding=(0, 1))
    for column in ("", "mean ± sigma", "spread", "noise", "repeats within", "drift per 1000", "repeats / stated"):
        table.add_column(column, justify="right" if column else "left")
    for each in report.quantities:
        if not each.units:
            continue
        digits = decimals(each.mean_sigma)
        fine = max(digits, decimals(each.noise))  # noise is often far below the spread between units
        drift = drift_words(report, each, fixed)
        table.add_row(
            f"{each.error.name}, {each.error.unit}",
            f"{fixed(each.mean, digits)} ± {fixed(each.mean_sigma, digits)}",
            fixed(each.spread, digits),
            fixed(each.noise, fine),
            fixed(each.repeatability, fine),
            Text(drift, "bold red" if report.hierarchy.drifts and each.drift_p_value < MARKED_P else ""),
            Text(fixed(each.stated_ratio, 2), "bold red" if each.stated_p_value < MARKED_P / len(SENSOR_ERRORS) else ""),
        )
    table.caption = (
        "spread: one sigma between units, measurement noise taken out; noise: one sigma of a session, as stated; "
        "repeats within: one sigma from session to session beyond that"
    )
    table.caption_justify = "left"
    return table


def drift_words(report: LotReport, each: LotQuantity, written: Callable[[float, int], str]) -> str:
    """Return the drift per 1000 units with its sigma; a dash for a lot too small for it."""
    if report.lot.units < FEWEST_DRIFT or not np.isfinite(each.drift_per_1000):
        return NONE
    digits = decimals(each.drift_sigma)
    return f"{written(each.drift_per_1000, digits)} ± {written(each.drift_sigma, digits)}"


def _gauges(report: LotReport) -> Table:
    who = report.appraisers or "nobody is named"
    title = f"Measurement system (one sigma; appraisers: {who})"
    table = Table(title=title, title_justify="left", box=None, padding=(0, 1))
    for column in ("", "EV", "AV", "GRR", "PV", "%GRR", "95 %", "% of tolerance", "ndc", ""):
        table.add_column(column, justify="right" if column else "left")
    for key, each in report.gauges.items():
        digits = decimals(each.grr)
        lo, hi = each.percent_grr_interval
        table.add_row(
            f"{UNIT_OF[key].name}, {UNIT_OF[key].unit}",
            *(fixed(value, digits) for value in (each.ev, each.av, each.grr, each.pv)),
            fixed(each.percent_grr, 1),
            f"{fixed(lo, 1)} to {fixed(hi, 1)}",
            fixed(each.percent_tolerance, 1),
            str(int(each.ndc)) if np.isfinite(each.ndc) else NONE,
            each.verdict,
        )
    return table


def _capabilities(report: LotReport) -> Table:
    table = Table(title="Capability, measurement noise taken out", title_justify="left", box=None, padding=(0, 1))
    for column in [
        "",
        "limits",
        "Cp",
        "Cpk",
        "Pp",
        "Ppk",
        "95 %",
        "Ppk as seen",
        "ppm outside",
        "found",
        "accepted wrongly, ppm",
        "guard band",
    ]:
        table.add_column(column, justify="right" if column else "left")
    for key, each in report.capabilities.items():
        lo, hi = each.overall.centred_interval
        table.add_row(
            f"{UNIT_OF[key].name}, {UNIT_OF[key].unit}",
            f"{_limit(each.lower)} to {_limit(each.upper)}",
            fixed(each.within.index, 2),
            fixed(each.within.centred, 2),
            fixed(each.overall.index, 2),
            Text(fixed(each.overall.centred, 2), "bold red" if each.overall.centred < 1 else ""),
            f"{fixed(lo, 2)} to {fixed(hi, 2)}",
            fixed(each.observed.centred, 2),
            ppm(each.ppm_tails),
            f"{each.found_outside} of {each.units}",
            ppm(each.false_accept_ppm),
            fixed(each.guard_band, decimals(each.guard_band)),
        )
    return table


def ppm(value: float) -> str:
    """Format parts per million, down to the smallest countable value."""
    return f"{value:.3g}" if value >= LEAST_PPM or value == 0 else f"< {LEAST_PPM:g}"


def _limit(value: float) -> str:
    return f"{value:g}" if np.isfinite(value) else "none"


def _charts(report: LotReport) -> list[Text]:
    lines = []
    for key, each in report.charts.items():
        said = []
        if len(each.ewma_alarms):
            said.append(f"its moving average leaves its limits from unit {int(each.place[each.ewma_alarms[0]]) + 1} on")
        said += [f"{rule} {each.counts[rule]} times, {each.chance[rule]:.1f} by chance" for rule in each.broken]
        if said:
            lines.append(one_line(f"{UNIT_OF[key].name}: {'; '.join(said)}", "yellow"))
    if report.charts and not lines:
        lines.append(Text("Control charts: no rule is broken more often than by chance."))
    return lines


def _outliers(report: LotReport) -> list[Text]:
    lines = [one_line(f"{each.says} (p = {each.p_value:.1g})", "bold red") for each in report.outliers[:MOST_OUTLIERS]]
    if len(report.outliers) > MOST_OUTLIERS:
        lines.append(Text(f"and {len(report.outliers) - MOST_OUTLIERS} more"))
    return lines


def decimals(sigma: float) -> int:
    """Return the decimals that show two digits of a sigma."""
    return int(np.clip(1 - np.floor(np.log10(sigma)), 0, 6)) if np.isfinite(sigma) and sigma > 0 else 2


def fixed(value: float, digits: int) -> str:
    """Format with this many decimals, or a dash."""
    return f"{value:.{digits}f}" if np.isfinite(value) else NONE


# A fleet's table in a few lines.

MOST_SHOWN = 8  #: rows of each list; the page has more


def fleet_page(summary: Summary, tally: Tally | None) -> Group:
    """Return the summary, for rich."""
    lines = [] if tally is None else [f"this run: {tally.done} done, {tally.failed} failed, {tally.reused} known before"]
    failed = summary.failed + summary.died + summary.unreadable
    lines.append(
        f"the table: {summary.folders} folders, {summary.sessions} different sessions of {summary.units} serial numbers; "
        f"{summary.done} done, {failed} failed"
    )
    if fitted := summary.passed + summary.undecided + summary.missed:
        rule = "by the verdict of fit" if summary.limit_deg is None else f"closes within {summary.limit_deg:g}°"
        undecided = f", {summary.undecided} not decided" if summary.undecided else ""
        lines.append(f"of {fitted} that were fitted, {summary.passed} pass{undecided}, {summary.missed} fail: {rule}")
    for what, counts in (("first look", summary.first_look), ("explain", summary.verdicts), ("named", summary.effects)):
        if counts:
            shown = ", ".join(f"{name} {count}" for name, count in list(counts.items())[:MOST_SHOWN])
            lines.append(f"{what}: {shown}" + (" …" if len(counts) > MOST_SHOWN else ""))
    parts: list[Text | Table] = [Text(printable(line)) for line in lines]
    if summary.reasons:
        parts.append(_reasons(summary))
    return Group(*parts)


def _reasons(summary: Summary) -> Table:
    table = Table(title="Failures by reason", title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("sessions", justify="right")
    table.add_column("in")
    table.add_column("because", overflow="fold")
    for step, reason, count in summary.reasons[:MOST_SHOWN]:
        table.add_row(str(count), step, printable(reason))
    return table
