"""The page of ``calibrate.py lot``: numbers, measurement system, capability, control charts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from session import VERSION
from session.io.files import result_folder
from session.io.results import write_text_whole
from session.io.texts import NONE, fixed, probability, significant
from tinygc.annexes.lots.capability import ControlChart
from tinygc.annexes.lots.gauge import ACCEPTABLE, MARGINAL
from tinygc.annexes.lots.lot import SENSOR_ERRORS, SensorError
from tinygc.annexes.lots.report import LotReport
from tinygc.annexes.lots.text import LEAST_PPM, MARKED_P, decimals, drift_words, effect_words, ppm
from tinygc.reporting.html.chart import Axis, Chart, linear_axis
from tinygc.reporting.html.markup import Section, escape, figure, key, paragraph, table
from tinygc.reporting.html.page import document

# Control charts as SVG: units by production order with their limits, and the moving average below.

#: most single points; beyond, bands of minimum and maximum are drawn
MOST_POINTS = 600
MOST_TITLES = 60
HEIGHT, LOW = 220, 130


def control_figure(chart: ControlChart, error: SensorError, serials: list[str]) -> str:
    """Draw individuals and EWMA of one number; serials (U,) of units, in the order of production."""
    said = [f"{chart.limit:.1f} sigmas are the limit of a single point: one false alarm in a hundred lots, over all charts."]
    for rule in chart.broken:
        said.append(f"{escape(rule.capitalize())}: {chart.counts[rule]} times, by chance {significant(chart.chance[rule], 2)}.")
    keys = [key("after", "unit"), key("bad", "beyond its limit"), key("floor", "mean and limits", "dash"), key("physics", "EWMA", "line")]
    return figure(lambda width: _individuals(chart, error, serials, width), "", keys) + figure(
        lambda width: _ewma(chart, error, width), " ".join(said)
    )


def _axis(chart: ControlChart) -> Axis:
    return Axis(float(chart.place[0]), float(max(chart.place[-1], chart.place[0] + 1)) + 1, "unit, in production order")


def _individuals(chart: ControlChart, error: SensorError, serials: list[str], width: int) -> str:
    limit = chart.limit * chart.sigma
    # outliers are drawn at the frame, so that they do not compress the scale
    usual = chart.y[np.abs(chart.score) <= chart.limit]
    high, low = chart.centre + np.median(limit), chart.centre - np.median(limit)
    y = linear_axis(np.concatenate([usual, [high, low]]), f"{error.name}, {error.unit}")
    drawn = Chart(width, HEIGHT, _axis(chart), y, f"{error.name} by production order")
    place = chart.place + 1.0
    drawn.line(place, chart.centre + limit, "floor", "dash").line(place, chart.centre - limit, "floor", "dash")
    drawn.across(chart.centre, "floor")
    if len(chart.y) <= MOST_POINTS:
        drawn.dots(place, chart.y, "after", radius=2.2)
    else:
        drawn.line(place, chart.y, "after", "thin")
    shown = chart.alarms[np.argsort(-np.abs(chart.score[chart.alarms]))][:MOST_TITLES]
    names = [serials[int(chart.place[n])] or f"unit {int(chart.place[n]) + 1}" for n in shown]
    titles = [f"{name}: {chart.y[n]:.4g} {error.unit}, {chart.score[n]:+.1f} sigmas" for name, n in zip(names, shown, strict=True)]
    return drawn.dots(place[shown], chart.y[shown], "bad", titles, ring=True, radius=5).svg()


def _ewma(chart: ControlChart, error: SensorError, width: int) -> str:
    reach = max(chart.ewma_limit * 1.15, float(np.abs(chart.ewma).max()) * 1.05)
    drawn = Chart(width, LOW, _axis(chart), Axis(-reach, reach, "moving average, sigmas"), f"Moving average of {error.name}")
    drawn.across(chart.ewma_limit, "floor").across(-chart.ewma_limit, "floor")
    return drawn.line(chart.place + 1.0, chart.ewma, "physics").svg()


# Sections of a lot's page: numbers, measurement system, capability, control charts and outliers.

#: most charts on a page; those with alarms come first
MOST_CHARTS, MOST_OUTLIERS = 6, 50
BY_KEY = {each.key: each for each in SENSOR_ERRORS}


def lot_sections(report: LotReport) -> list[Section]:
    """Return the sections of a page that are not empty."""
    made = [_numbers(report), _outliers(report), _effects(report), _charts(report), _gauges(report), _capabilities(report)]
    return [section for section in made if section is not None]


def _numbers(report: LotReport) -> Section:
    rows: list[list[str]] = []
    marked: list[int] = []
    for each in report.quantities:
        if not each.units:
            continue
        digits = decimals(each.mean_sigma)
        fine = max(digits, decimals(each.noise))  # noise is often far below the spread between units
        if report.hierarchy.drifts and each.drift_p_value < MARKED_P:
            marked.append(len(rows))
        lo, hi = each.spread_interval
        rows.append(
            [
                f"{each.error.name}, {each.error.unit}",
                f"{fixed(each.mean, digits)} ± {fixed(each.mean_sigma, digits)}",
                f"{fixed(each.spread, digits)} ({fixed(lo, digits)} to {fixed(hi, digits)})",
                fixed(each.noise, fine),
                fixed(each.repeatability, fine),
                drift_words(report, each, fixed),
            ]
        )
    header = ("", "mean ± sigma", "spread (95 %)", "noise of a session", "repeats within", "drift per 1000 units")
    drift = probability(report.hierarchy.drift_p)
    said = f"The lot {'drifts' if report.hierarchy.drifts else 'does not drift beyond chance'} ({drift}, all numbers together)."
    tails = "" if np.isinf(report.lot.tails) else f" Its units have tails of {significant(report.lot.tails, 2)} degrees of freedom."
    words = (
        "Spread is between units, one sigma, with measurement noise taken out. Noise is what a session states; "
        "“repeats within” is what sessions of one unit differ by beyond that."
    )
    notes = "".join(paragraph(f"{escape(note[:1].upper() + note[1:])}.", "soft") for note in report.notes)
    html = paragraph(f"{report.lot.units} units, {report.lot.sessions} sessions. {said}{tails}") + table(
        header, rows, words, marked=marked, minor=(3,)
    )
    return Section("lot", "The lot", html + notes)


def _outliers(report: LotReport) -> Section | None:
    if not report.outliers:
        return Section("lot-outliers", "What does not belong", paragraph("No unit and no session is farther off than chance explains."))
    told = [
        f'<div class="found">{paragraph(f"{escape(each.says)}. By chance, in such a lot: {probability(each.p_value)}.")}</div>'
        for each in report.outliers[:MOST_OUTLIERS]
    ]
    more = len(report.outliers) - len(told)
    tail = paragraph(f"And {more} more, in the lot's file.", "soft") if more > 0 else ""
    return Section("lot-outliers", "What does not belong", "".join(told) + tail)


def _effects(report: LotReport) -> Section | None:
    if not report.lot.effects:
        return None
    told = [f'<div class="found">{paragraph(f"{escape(effect_words(name, found))}.")}</div>' for name, found in report.lot.effects.items()]
    words = "Found by pooling the estimates of all sessions for each effect of the catalogue. Their sizes are in the lot's file."
    return Section("lot-effects", "Effects of the lot", "".join(told) + paragraph(words, "soft"))


def _charts(report: LotReport) -> Section | None:
    if not report.charts:
        return None
    ringing = sorted(report.charts, key=lambda key: -_rings(report, key))
    shown = [key for key in ringing if _rings(report, key) > 0][:MOST_CHARTS] or ringing[:1]
    pictures = "".join(control_figure(report.charts[key], BY_KEY[key], report.sessions.serials) for key in shown)
    quiet = len(report.charts) - sum(_rings(report, key) > 0 for key in report.charts)
    words = f"{quiet} of {len(report.charts)} charts show no alarm. Each point has the limits of its own measurement noise."
    return Section("lot-charts", "Control charts", paragraph(words) + pictures)


def _rings(report: LotReport, key: str) -> float:
    """Return the severity of a chart's alarms."""
    chart = report.charts[key]
    return float(len(chart.alarms) > 0) + 2.0 * (len(chart.ewma_alarms) > 0) + 0.5 * len(chart.broken)


def _gauges(report: LotReport) -> Section | None:
    told = {key: each for key, each in report.gauges.items() if np.isfinite(each.percent_grr)}
    if not told:
        return None
    rows: list[list[str]] = []
    marked: list[int] = []
    for name, each in told.items():
        digits = decimals(each.grr)
        if each.percent_grr > MARGINAL:
            marked.append(len(rows))
        lo, hi = each.percent_grr_interval
        rows.append(
            [
                f"{BY_KEY[name].name}, {BY_KEY[name].unit}",
                *(fixed(value, digits) for value in (each.ev, each.av, each.grr, each.pv)),
                f"{fixed(each.percent_grr, 1)} ({fixed(lo, 1)} to {fixed(hi, 1)})",
                fixed(each.percent_tolerance, 1),
                str(int(each.ndc)) if np.isfinite(each.ndc) else NONE,
                each.verdict,
            ]
        )
    header = ("", "EV", "AV", "GRR", "PV", "%GRR (95 %)", "% of tolerance", "ndc", "")
    words = (
        f"One sigma each; ndc = 1.41 PV / GRR. Below {ACCEPTABLE:g} % is acceptable, above {MARGINAL:g} % is not (AIAG). "
        f"Appraisers: {escape(report.appraisers or 'none are named, so AV is unknown')}."
    )
    return Section("lot-gauge", "Measurement system", table(header, rows, words, marked=marked, minor=(1, 2, 3, 4)))


def _ppm(value: float) -> str:
    return escape(ppm(value)) if 0 < value < LEAST_PPM else significant(value)


def _capabilities(report: LotReport) -> Section | None:
    if not report.capabilities:
        return None
    rows: list[list[str]] = []
    marked: list[int] = []
    for name, each in report.capabilities.items():
        if each.overall.centred < 1:
            marked.append(len(rows))
        lo, hi = each.overall.centred_interval
        limits = " to ".join(f"{value:g}" if np.isfinite(value) else "none" for value in (each.lower, each.upper))
        rows.append(
            [
                f"{BY_KEY[name].name}, {BY_KEY[name].unit}",
                limits.replace("-", "−"),
                f"{fixed(each.within.index, 2)}, {fixed(each.within.centred, 2)}",
                f"{fixed(each.overall.index, 2)}, {fixed(each.overall.centred, 2)} ({fixed(lo, 2)} to {fixed(hi, 2)})",
                fixed(each.observed.centred, 2),
                f"{_ppm(each.ppm_normal)}, {_ppm(each.ppm_tails)}",
                f"{each.found_outside} of {each.units}",
                f"{_ppm(each.false_accept_ppm)}, {_ppm(each.false_reject_ppm)}",
                f"{significant(each.guard_band)}: {_ppm(each.guarded_accept_ppm)}, {_ppm(each.guarded_reject_ppm)}",
            ]
        )
    header = (
        "",
        "limits",
        "Cp, Cpk",
        "Pp, Ppk (95 %)",
        "Ppk as seen",
        "ppm outside: normal, with tails",
        "found",
        "ppm accepted, rejected wrongly",
        "guard band: the same",
    )
    words = "Measurement noise is taken out, but for what is “as seen”. A guard band draws both limits in by 1.645 sigmas of a session."
    return Section("lot-capability", "Capability", table(header, rows, words, marked=marked, minor=(7, 8)))


# The page of ``calibrate.py lot``.


def page(report: LotReport, more: Sequence[Section] = ()) -> str:
    """Return the page as one HTML document; more: sections at its end."""
    name = escape(report.lot.sensor or "sensors")
    head = f'<header><p class="kicker">Lot statistics</p><h1>{name}: {report.lot.units} units</h1></header>'
    foot = f"<footer>Statistics of a lot's calibrations. TinyGC {escape(VERSION)}.</footer>"
    return document(f"Lot: {report.lot.units} units", head, [*lot_sections(report), *more], foot)


def save(report: LotReport, path: Path, more: Sequence[Section] = ()) -> Path:
    """Write the page atomically; return its path."""
    with result_folder(path.parent):
        write_text_whole(path, page(report, more))
    return path
