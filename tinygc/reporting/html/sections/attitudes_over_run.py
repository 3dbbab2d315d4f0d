"""Closure runs: the attitude over the run (the paper's Figure 11), how far each method strays from it, and what is left at the return."""

from __future__ import annotations

import numpy as np

from session.io.units import DEG
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.runs import ClosureRun
from tinygc.models.linear import bias_only
from tinygc.reporting.fit_text import TITLES
from tinygc.reporting.html.chart import Axis, Chart, log_axis
from tinygc.reporting.html.evidence import Evidence, rmse
from tinygc.reporting.html.markup import Section, aligned_decimals, degrees, escape, figure, fixed, key, paragraph, probability, table

DENOISED = "tinygc_denoised"


def section(evidence: Evidence) -> Section | None:
    """None without a closure run."""
    if not evidence.fit.runs:
        return None
    html = paragraph(
        "A still, a long turn about all axes, and a still in the same attitude again. No fit has seen it. At the return roll, "
        "pitch and yaw must be what "
        "they were: what they are not is the error of the calibration, and of the noise."
    )
    for number, run in enumerate(evidence.fit.runs):
        html += _run(evidence, number, run)
    return Section("runs", "Closure runs", html)


def _run(evidence: Evidence, number: int, run: ClosureRun) -> str:
    adopted = evidence.adopted
    rates = _rates(evidence, run)
    tracks = {name: closure.attitudes(run.batch, rate[None])[0] for name, rate in rates.items()}
    t = np.concatenate([[0.0], np.cumsum(run.batch.dt[0])])
    # The denoised rate is late, and its attitude with it: it has strayed only as far as it is late.
    moved = [name for name in tracks if name not in (adopted.name, DENOISED)]
    html = f"<h3>{escape(run.file)}, {run.duration_s:.0f} s</h3>"
    html += figure(
        lambda width: _attitude(t, tracks[adopted.name], tracks.get("raw"), width),
        f"Attitude over the run by the calibration of this report. Thin: without calibration, "
        f"{degrees(rmse(_error(evidence, run, 'raw', number)))} off at the return.",
        [key("x", "roll", "line"), key("y", "pitch", "line"), key("z", "yaw", "line")],
    )
    html += figure(
        lambda width: _straying(t, tracks, adopted.name, run, width),
        "How far each method’s attitude has strayed from that of this report’s calibration.",
        [*(key(name, escape(TITLES.get(name, name)), "line") for name in moved), key("floor", "noise of the integrated rate, 1σ", "dash")],
    )
    rows, decimals = [], aligned_decimals(float(run.floor_rad.min()) / DEG)
    for name in rates:
        error = _error(evidence, run, name, number) / DEG
        rows.append(
            (escape(TITLES.get(name, name)), *(_signed(value, decimals) for value in error), fixed(np.sqrt(np.mean(error**2)), decimals))
        )
    floor = run.floor_rad / DEG
    rows.append(("<small>noise floor, 1σ</small>", *(f"<small>{fixed(v, decimals)}</small>" for v in (*floor, np.sqrt(np.mean(floor**2))))))
    html += table(("At the return, degrees", "roll", "pitch", "yaw", "RMSE"), rows, marked=[list(rates).index(adopted.name)])
    html += paragraph(
        "Noise, the uncertainty of the parameters, and a bias that has wandered on since the session together allow an error of "
        f"this size with {probability(adopted.run_p[number])}.",
        "soft",
    )
    if run.earth.source == "unknown":
        html += paragraph(
            "Of the Earth’s rotation only the vertical part is taken off: the heading is unknown, or the run does not go on where "
            "the log ended.",
            "soft",
        )
    return html


def _rates(evidence: Evidence, run: ClosureRun) -> dict[str, np.ndarray]:
    """Calibrated rates (N, 3) of the run by each method; the adopted one is among them."""
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


def _error(evidence: Evidence, run: ClosureRun, name: str, number: int) -> np.ndarray:
    """Roll, pitch, yaw error (3,) rad."""
    if name == evidence.adopted.name:
        return evidence.adopted.run_errors[number]
    known = evidence.fit.run_errors[number]
    return known[name] if name in known else run.errors(bias_only())


def _signed(value: float, decimals: int) -> str:
    text = fixed(value, decimals)
    return text if value <= 0 or not text.strip("0.") else f"+{text}"


def _euler_deg(q: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw (T, 3) in degrees of R = Rz Ry Rx."""
    R = rotation.matrix(q)
    roll = np.arctan2(R[:, 2, 1], R[:, 2, 2])
    pitch = np.arcsin(np.clip(-R[:, 2, 0], -1, 1))
    yaw = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    return np.stack([roll, pitch, yaw], axis=1) / DEG


def _without_jumps(angle: np.ndarray) -> np.ndarray:
    """A gap where an angle wraps."""
    broken = angle.copy()
    broken[1:][np.abs(np.diff(angle)) > 180] = np.nan
    return broken


def _attitude(t: np.ndarray, q: np.ndarray, raw: np.ndarray | None, width: int) -> str:
    ticks = [(v, f"{v:g}".replace("-", "−")) for v in (-180, -90, 0, 90, 180)]
    chart = Chart(
        width, 270, Axis(0, t[-1], "time, s"), Axis(-190, 190, "degrees", ticks=ticks), "Roll, pitch and yaw over the closure run"
    )
    for track, style in ((raw, "thin"), (q, "line")):
        if track is not None:
            for kind, angle in zip("xyz", _euler_deg(track).T, strict=True):
                chart.line(t, _without_jumps(angle), kind, style)
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
