"""What a page says of a lot: a section each for numbers, measurement system, capability, control charts and what does not belong."""

from __future__ import annotations

import numpy as np

from tinygc.lot.gauge import ACCEPTABLE, MARGINAL
from tinygc.lot.quantities import SEEN
from tinygc.lot.report import LotReport
from tinygc.report.html.markup import Section, escape, paragraph, table
from tinygc.report.html.numbers import NONE, fixed, probability, significant
from tinygc.report.lot.charts import control_figure
from tinygc.report.lot_text import LEAST_PPM, MARKED_P, decimals, drift_words, effect_words, ppm

#: charts on a page: those that ring first
MOST_CHARTS, MOST_OUTLIERS = 6, 50
BY_KEY = {each.key: each for each in SEEN}


def lot_sections(report: LotReport) -> list[Section]:
    """Sections of a page, those that have something to say."""
    made = [_numbers(report), _outliers(report), _effects(report), _charts(report), _gauges(report), _capabilities(report)]
    return [section for section in made if section is not None]


def _numbers(report: LotReport) -> Section:
    rows: list[list[str]] = []
    marked: list[int] = []
    for each in report.quantities:
        if not each.units:
            continue
        digits = decimals(each.mean_sigma)
        fine = max(digits, decimals(each.noise))  # noise is often far below what units differ by
        if report.hierarchy.drifts and each.drift_p < MARKED_P:
            marked.append(len(rows))
        lo, hi = each.spread_interval
        rows.append(
            [
                f"{each.seen.name}, {each.seen.unit}",
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
    words = "Found by pooling what every session says of every effect of the catalogue. How large they are is in the lot's file."
    return Section("lot-effects", "Effects of the lot", "".join(told) + paragraph(words, "soft"))


def _charts(report: LotReport) -> Section | None:
    if not report.charts:
        return None
    ringing = sorted(report.charts, key=lambda key: -_rings(report, key))
    shown = [key for key in ringing if _rings(report, key) > 0][:MOST_CHARTS] or ringing[:1]
    pictures = "".join(control_figure(report.charts[key], BY_KEY[key], report.sessions.serials) for key in shown)
    quiet = len(report.charts) - sum(_rings(report, key) > 0 for key in report.charts)
    words = f"{quiet} of {len(report.charts)} charts do not ring. Each point has the limits of its own measurement noise."
    return Section("lot-charts", "Control charts", paragraph(words) + pictures)


def _rings(report: LotReport, key: str) -> float:
    """How loudly."""
    chart = report.charts[key]
    return float(len(chart.alarms) > 0) + 2.0 * (len(chart.ewma_alarms) > 0) + 0.5 * len(chart.broken)


def _gauges(report: LotReport) -> Section | None:
    told = {key: each for key, each in report.gauges.items() if np.isfinite(each.percent_grr)}
    if not told:
        return None
    rows: list[list[str]] = []
    marked: list[int] = []
    for key, each in told.items():
        digits = decimals(each.grr)
        if each.percent_grr > MARGINAL:
            marked.append(len(rows))
        lo, hi = each.percent_grr_interval
        rows.append(
            [
                f"{BY_KEY[key].name}, {BY_KEY[key].unit}",
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
        f"Appraisers: {escape(report.appraisers or 'none are named, so that AV is not told')}."
    )
    return Section("lot-gauge", "Measurement system", table(header, rows, words, marked=marked, minor=(1, 2, 3, 4)))


def _ppm(value: float) -> str:
    return escape(ppm(value)) if 0 < value < LEAST_PPM else significant(value)


def _capabilities(report: LotReport) -> Section | None:
    if not report.capabilities:
        return None
    rows: list[list[str]] = []
    marked: list[int] = []
    for key, each in report.capabilities.items():
        if each.overall.centred < 1:
            marked.append(len(rows))
        lo, hi = each.overall.centred_interval
        limits = " to ".join(f"{value:g}" if np.isfinite(value) else "none" for value in (each.lower, each.upper))
        rows.append(
            [
                f"{BY_KEY[key].name}, {BY_KEY[key].unit}",
                limits.replace("-", "−"),
                f"{fixed(each.within.index, 2)}, {fixed(each.within.centred, 2)}",
                f"{fixed(each.overall.index, 2)}, {fixed(each.overall.centred, 2)} ({fixed(lo, 2)} to {fixed(hi, 2)})",
                fixed(each.seen.centred, 2),
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
