"""Comparison of methods: residual closure on fitted and on held-out segments."""

from __future__ import annotations

from session.base.numeric import rms_of
from session.base.texts import NONE, degrees, fixed, significant
from session.base.units import DEG
from tinygc.estimation.bias import tilt_rms
from tinygc.estimation.choice import closure_figures
from tinygc.explanation.reported import ReportData
from tinygc.reporting.fit_text import SAME_FLOOR, TITLES
from tinygc.reporting.html.chart import Axis, Chart, log_axis
from tinygc.reporting.html.markup import Section, aligned_decimals, render


def section(evidence: ReportData) -> Section:
    """Section of table and picture."""
    rows, adopted = _rows(evidence), evidence.adopted
    floor, runs = evidence.problem.floor.tilt_rms, bool(evidence.fit.runs)
    # Physics is evaluated on the repaired log, whose floor is wider by the uncertainty of the filled gaps.
    own = adopted.floor_rms
    wider = f", of the mended log with physics {degrees(own)}" if adopted.name == "physics" and abs(own / floor - 1) > SAME_FLOOR else ""
    html = render(
        "methods.html",
        e=evidence,
        titles=TITLES,
        folds=min(evidence.fit.options.folds, len(evidence.problem.used)),
        picture=lambda width: _picture(evidence, rows, width),
        keys=[
            ("after", "held out"),
            ("after", "fitted", "ring"),
            *([("physics", "closure run, RMSE")] if runs else []),
            ("floor", "noise floor", "dash"),
        ],
        header=(
            *("Method", "parameters", "fitted", "held out", "÷ floor", "roll", "pitch", "yaw"),
            *(("closure run",) if runs else ()),
            "seconds",
        ),
        rows=[
            *(_cells(row, own if row[0] == adopted.name else floor, runs) for row in rows),
            *([f"{TITLES[name]}: {why}", *[NONE] * (9 if runs else 8)] for name, why in evidence.fit.not_run.items()),
        ],
        caption="Degrees. Fitted, held out: rms of tilt. Roll, pitch, yaw: held out, about the table's axes. "
        f"Noise floor: {degrees(floor)}{wider}. In bold: the calibration that this report states.",
        marked=[number for number, row in enumerate(rows) if row[0] == adopted.name],
        minor=(1, 5, 6, 7, *((9,) if runs else (8,))),
    )
    return Section("methods", "Methods side by side", html)


def _rows(evidence: ReportData) -> list[tuple]:
    """Rows of name, parameters, fitted angles or None, held-out angles, run errors, seconds or None."""
    fit = evidence.fit
    rows: list[tuple] = [
        (name, one.parameters, one.angles, one.held_out, [errors[name] for errors in fit.run_errors], one.seconds)
        for name, one in fit.methods.items()
    ]
    adopted = evidence.adopted
    if adopted.name not in fit.methods:
        rows.append((adopted.name, len(adopted.vector), None, adopted.angles, adopted.run_errors, None))
    return rows


def _cells(row: tuple, floor: float, runs: bool) -> list[str]:
    name, parameters, fitted, held_out, errors, seconds = row
    figures, decimals = closure_figures(held_out), aligned_decimals(floor / DEG)
    tilt = figures["tilt_rms_deg"]
    cells = [
        TITLES.get(name, name),
        str(parameters),
        NONE if fitted is None else fixed(tilt_rms(fitted) / DEG, decimals),
        fixed(tilt, decimals),
    ]
    cells += [significant(tilt * DEG / floor)]
    cells += [
        NONE if value is None else fixed(value, decimals)
        for value in (figures["roll_rms_deg"], figures["pitch_rms_deg"], figures["yaw_rms_deg"])
    ]
    if runs:
        cells.append(", ".join(fixed(rms_of(error) / DEG, decimals) for error in errors))
    return [*cells, NONE if seconds is None else f"{seconds:.2f}"]


def _picture(evidence: ReportData, rows: list[tuple], width: int) -> str:
    floor = evidence.problem.floor.tilt_rms / DEG
    values = [floor]
    for _, _, fitted, held_out, errors, _ in rows:
        values += [tilt_rms(held_out) / DEG, *(rms_of(error) / DEG for error in errors)]
        values += [] if fitted is None else [tilt_rms(fitted) / DEG]
    x, count = log_axis(values, "closure, degrees", margin=1.3), len(rows)
    narrow = width < 500
    y = Axis(-0.7, count - 0.3, ticks=[] if narrow else [(count - 1 - i, TITLES.get(row[0], row[0])) for i, row in enumerate(rows)])
    chart = Chart(
        width, (46 if narrow else 30) * count + 62, x, y, "Closure by method", left=18 if narrow else 190, right=20 if narrow else 14
    )
    chart.upright(floor, "floor")
    for i, (name, _, fitted, held_out, errors, _) in enumerate(rows):
        level = count - 1 - i - (0.18 if narrow else 0)
        kind, title = name if name in TITLES else "ink", TITLES.get(name, name)
        if narrow:
            _, (b,) = chart.at([x.lo], [level + 0.5])
            chart.text(20, float(b) + 6, title)
        chart.across(level, "quiet", style="grid")
        for error in errors:
            chart.dots([rms_of(error) / DEG], [level], "physics", [f"{title}, closure run: {degrees(rms_of(error))}"], radius=3)
        if fitted is not None:
            chart.dots([tilt_rms(fitted) / DEG], [level], kind, [f"{title}, fitted: {degrees(tilt_rms(fitted))}"], ring=True, radius=5.5)
        chart.dots([tilt_rms(held_out) / DEG], [level], kind, [f"{title}, held out: {degrees(tilt_rms(held_out))}"], radius=5)
    return chart.svg()
