"""Noise at rest: overlapping Allan deviation of the stills, and their spectrum; and the unit's figures of a rest log next to them."""

from __future__ import annotations

import numpy as np

from session.base.texts import measured, significant
from session.base.units import DEG, DEG_PER_HOUR, MDPS
from tinygc.closure.floor import AllanCurve, Reading, angle_random_walk
from tinygc.closure.problem import MeasuredNoise, Problem
from tinygc.closure.residual import RateMap
from tinygc.explanation.reported import ReportData
from tinygc.noise.figures import NAMES, NoiseFigures, Term, read_figures
from tinygc.noise.measured import SHOWN
from tinygc.noise.stillness import density
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.pictures.noise import deviations, thinned


def section(evidence: ReportData) -> Section | None:
    """Section on noise; None if the stills are too short for either plot, and no figures were measured at rest."""
    curve, problem = evidence.allan, evidence.problem
    if curve is None:
        return None if problem.at_rest is None else Section("noise", "Noise at rest", _at_rest(problem.at_rest, problem))
    walks = [angle_random_walk(curve, axis) for axis in range(3)]
    white = ", ".join(f"{axis} {significant(n / DEG * 1e3, 2)}" for axis, n in zip("xyz", problem.noise.gyro, strict=True))
    found = density(still_pieces(problem, problem.first), problem.logs[0].samples.period_s)
    html = render(
        "noise.html",
        white=white,
        total_s=sum(still.duration_s for still in problem.stills if still.problem is None and still.bumps == 0),
        longest_s=curve.longest_s,
        allan=_allan(curve, walks),
        held_down=held_down(curve),
        spectrum=found and _spectrum(*found),
    )
    return Section("noise", "Noise at rest", html + ("" if problem.at_rest is None else _at_rest(problem.at_rest, problem)))


def held_down(curve: AllanCurve) -> bool:
    """Whether each axis begins below its white noise, as behind a low-pass filter."""
    walks = [angle_random_walk(curve, axis) for axis in range(3)]
    return all(first * np.sqrt(curve.tau_s[0]) < walk.value - 2 * walk.sigma for first, walk in zip(curve.deviation[0], walks, strict=True))


def _at_rest(measured: MeasuredNoise, problem: Problem) -> str:
    """The unit's figures at rest: table, Allan deviation of the model, and whether this session contradicts them."""
    figures = read_figures(measured.path)
    return render(
        "noise_at_rest.html",
        file=measured.file,
        hours=figures.duration_s / 3600,
        is_prior=measured.instability is not None,
        rows=[
            (meaning(kind, name), name, unit, [_value(axis.terms[name], si) for axis in sensor.axes])
            for kind, sensor in figures.sensors().items()
            for name, (unit, si) in SHOWN[kind].items()
        ],
        lines=[finding.description for finding in measured.findings(problem.session.name)],
        allan=_model(figures, float(problem.began_s[-1])),
    )


def meaning(kind: str, name: str) -> str:
    """Name of a term of the gyroscope or of the accelerometer, whose integral is another."""
    return NAMES[name] if kind == "gyro" else NAMES[name].replace("angle", "velocity").replace("rate", "force")


def _value(term: Term, si: float) -> str:
    """``0.281 ± 0.004`` (k = 2), ``< 4.0`` or a dash, in units of si."""
    if term.sigma is None or not term.is_determined:
        return "–" if term.at_most is None else f"< {significant(term.at_most / si, 2)}"
    return measured(term.value / si, 2 * term.sigma / si)


def _model(figures: NoiseFigures, session_s: float) -> Panel | None:
    """Allan deviation of the gyroscope at rest, with the length of this session; None where the file has none."""
    if (band := figures.allan.get("gyro")) is None:
        return None
    panel = deviations("gyro", figures.gyro, thinned(band))
    first, last = panel.ends()[0]
    return panel.upright(session_s, "after", name="length of this session") if first < session_s < last else panel


def still_pieces(problem: Problem, model: RateMap) -> list[np.ndarray]:
    """Calibrated rates (N, 3) rad/s of each undisturbed still, from the logs with the first log's data rate."""
    period_s = problem.logs[0].samples.period_s
    return [
        rates[still.start : still.stop]
        for log in problem.logs
        if abs(log.samples.period_s / period_s - 1) < 0.01
        for rates in [model(log.samples.gyro)]
        for still in log.stills
        if still.problem is None and still.bumps == 0
    ]


def _allan(curve: AllanCurve, walks: list[Reading]) -> Panel:
    tau, deviation, spread = curve.tau_s, curve.deviation / DEG_PER_HOUR, curve.relative_sigma
    panel = Panel(Axis("averaging time (s)", log=True), Axis("Allan deviation (°/h)", log=True), about="Allan deviation of the three axes")
    mean = float(np.mean([walk.value for walk in walks])) / DEG_PER_HOUR
    panel.line(tau, mean / np.sqrt(tau), "floor", "dash", name="white noise", is_measure=False)
    for i, axis in enumerate("xyz"):
        low, high = deviation[:, i] * (1 - np.minimum(spread, 0.9)), deviation[:, i] * (1 + spread)
        panel.area(tau, low, high, axis, is_measure=False).line(tau, deviation[:, i], axis, name=axis)
    return panel


def _spectrum(frequency: np.ndarray, amplitude: np.ndarray) -> Panel:
    panel = Panel(
        Axis("frequency (Hz)", lo=0.0), Axis("amplitude density (mdps/√Hz)", log=True), about="Spectrum of the three axes at rest"
    )
    for i, axis in enumerate("xyz"):
        panel.line(frequency, amplitude[:, i] / MDPS, axis, name=axis)
    return panel
