"""Closure runs: attitude over the run (the paper's Figure 11), deviation of each method, and the error at the return."""

from __future__ import annotations

import numpy as np

from session.base import rotation
from session.base.numeric import rms_of, running_sum
from session.base.units import DEG
from tinygc.closure import residual
from tinygc.closure.runs import ClosureRun
from tinygc.explanation.reported import ReportData
from tinygc.models.linear import bias_only
from tinygc.reporting.fit_text import TITLES, run_table
from tinygc.reporting.html.chart import Axis, Chart, log_axis
from tinygc.reporting.html.markup import Section, render

DENOISED = "tinygc_denoised"


def section(evidence: ReportData) -> Section | None:
    """Section on closure runs; None without one."""
    if not evidence.fit.runs:
        return None
    runs = [_run(evidence, number, run) for number, run in enumerate(evidence.fit.runs)]
    return Section("runs", "Closure runs", render("runs.html", runs=runs))


def _run(evidence: ReportData, number: int, run: ClosureRun) -> dict:
    adopted = evidence.adopted
    rates = _rates(evidence, run)
    tracks = {name: residual.attitudes(run.batch, rate[None])[0] for name, rate in rates.items()}
    t = running_sum(run.batch.dt[0])
    # The denoised attitude is left out: its output delay alone would make it deviate.
    moved = [name for name in tracks if name not in (adopted.name, DENOISED)]
    return {
        "file": run.file,
        "seconds": run.duration_s,
        "attitude": lambda width: _attitude(t, tracks[adopted.name], tracks.get("raw"), width),
        "raw": rms_of(_error(evidence, run, "raw", number)),
        "straying": lambda width: _straying(t, tracks, adopted.name, run, width),
        "lines": [*((name, TITLES.get(name, name), "line") for name in moved), ("floor", "noise of the integrated rate, 1σ", "dash")],
        "table": run_table(run, {name: _error(evidence, run, name, number) for name in rates}, adopted.name),
        "p": adopted.run_p[number],
    }


def _rates(evidence: ReportData, run: ClosureRun) -> dict[str, np.ndarray]:
    """Calibrated rates (N, 3) of the run by each method, the adopted one included."""
    adopted, measured = evidence.adopted, run.batch.rate[0]
    rates = {"raw": bias_only()(measured)}
    for name, fit in evidence.fit.methods.items():
        if fit.model.rates_only:
            rates[name] = fit.model.undelayed(measured)
    if not adopted.model.rates_only:
        rates[adopted.name] = run.rates(adopted.model)
    else:
        rates[adopted.name] = adopted.model(measured)
    return rates


def _error(evidence: ReportData, run: ClosureRun, name: str, number: int) -> np.ndarray:
    """Roll, pitch, yaw error (3,) rad at the return."""
    if name == evidence.adopted.name:
        return evidence.adopted.run_errors[number]
    known = evidence.fit.run_errors[number]
    return known[name] if name in known else run.errors(bias_only())


def _attitude(t: np.ndarray, q: np.ndarray, raw: np.ndarray | None, width: int) -> str:
    ticks = [(v, f"{v:g}".replace("-", "−")) for v in (-180, -90, 0, 90, 180)]
    chart = Chart(
        width, 270, Axis(0, t[-1], "time, s"), Axis(-190, 190, "degrees", ticks=ticks), "Roll, pitch and yaw over the closure run"
    )
    for track, style in ((raw, "thin"), (q, "line")):
        if track is not None:
            # Roll, pitch, yaw (T, 3) in degrees of R = Rz Ry Rx.
            R = rotation.matrix(track)
            roll = np.arctan2(R[:, 2, 1], R[:, 2, 2])
            pitch = np.arcsin(np.clip(-R[:, 2, 0], -1, 1))
            yaw = np.arctan2(R[:, 1, 0], R[:, 0, 0])
            for kind, angle in zip("xyz", (np.stack([roll, pitch, yaw], axis=1) / DEG).T, strict=True):
                # Insert gaps where an angle wraps.
                broken = angle.copy()
                broken[1:][np.abs(np.diff(angle)) > 180] = np.nan
                chart.line(t, broken, kind, style)
    return chart.svg()


def _straying(t: np.ndarray, tracks: dict[str, np.ndarray], adopted: str, run: ClosureRun, width: int) -> str:
    apart = {}
    for name, q in tracks.items():
        if name not in (adopted, DENOISED):
            away = rotation.multiply(rotation.conjugate(tracks[adopted]), q)
            apart[name] = 2 * np.arctan2(np.linalg.norm(away[:, 1:], axis=1), np.abs(away[:, 0])) / DEG
    noise = np.linalg.norm(run.floor_rad) / DEG * np.sqrt(t / t[-1])
    highest = max([noise[-1], *(angle.max() for angle in apart.values())])
    lowest = min([noise[-1] * 0.02, *(float(angle[-1]) for angle in apart.values())])
    y = log_axis([max(lowest, highest * 1e-6), highest], "degrees", margin=1.5)
    chart = Chart(width, 230, Axis(0, t[-1], "time, s"), y, "Departure of each method's attitude from the reported one")
    chart.line(t[1:], noise[1:], "floor", "dash")
    for name, angle in apart.items():
        chart.line(t[1:], np.where(angle[1:] > y.lo, angle[1:], np.nan), name)
    return chart.svg()
