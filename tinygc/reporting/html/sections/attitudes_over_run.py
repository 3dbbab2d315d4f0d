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
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.fit_text import TITLES, run_table
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
    return {
        "file": run.file,
        "seconds": run.duration_s,
        "attitude": _attitude(t, tracks[adopted.name], tracks.get("raw")),
        "raw": rms_of(_error(evidence, run, "raw", number)),
        "straying": _straying(t, tracks, adopted.name, run),
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


def _attitude(t: np.ndarray, q: np.ndarray, raw: np.ndarray | None) -> Panel:
    ticks = [(v, f"{v:g}".replace("-", "−")) for v in (-180, -90, 0, 90, 180)]
    panel = Panel(Axis("time (s)"), Axis("angle (°)", -190, 190, ticks=ticks), about="Roll, pitch and yaw over the closure run")
    for track, style in ((raw, "thin"), (q, "line")):
        if track is not None:
            # Roll, pitch, yaw (T, 3) in degrees of R = Rz Ry Rx.
            R = rotation.matrix(track)
            roll = np.arctan2(R[:, 2, 1], R[:, 2, 2])
            pitch = np.arcsin(np.clip(-R[:, 2, 0], -1, 1))
            yaw = np.arctan2(R[:, 1, 0], R[:, 0, 0])
            for kind, name, angle in zip("xyz", ("roll", "pitch", "yaw"), np.stack([roll, pitch, yaw]) / DEG, strict=True):
                # Insert gaps where an angle wraps.
                broken = angle.copy()
                broken[1:][np.abs(np.diff(angle)) > 180] = np.nan
                panel.line(t, broken, kind, style, name=name if style == "line" else "")
    return panel


def _straying(t: np.ndarray, tracks: dict[str, np.ndarray], adopted: str, run: ClosureRun) -> Panel:
    """How far each method's attitude has strayed; without the denoised one, whose delay alone makes it deviate."""
    noise, apart = np.linalg.norm(run.floor_rad) / DEG * np.sqrt(t / t[-1]), {}
    for name, q in tracks.items():
        if name not in (adopted, DENOISED):
            away = rotation.multiply(rotation.conjugate(tracks[adopted]), q)
            apart[name] = 2 * np.arctan2(np.linalg.norm(away[:, 1:], axis=1), np.abs(away[:, 0])) / DEG
    highest = max(noise[-1], *(angle.max() for angle in apart.values()))
    lowest = max(min(noise[-1] * 0.02, *(float(angle[-1]) for angle in apart.values())), highest * 1e-6)
    about = "Departure of each method's attitude from the reported one"
    panel = Panel(Axis("time (s)"), Axis("departure (°)", lo=lowest / 1.5, log=True), about=about)
    panel.line(t[1:], noise[1:], "floor", "dash", name="noise of the integrated rate, 1σ")
    for name, angle in apart.items():
        panel.line(t[1:], angle[1:], name, name=TITLES.get(name, name))
    return panel
