"""Noise at rest: overlapping Allan deviation of the stills, and their spectrum."""

from __future__ import annotations

import numpy as np

from session.io.texts import significant
from session.io.units import DEG, DEG_PER_HOUR
from tinygc.closure.floor import AllanCurve, Reading, angle_random_walk
from tinygc.closure.problem import Problem
from tinygc.closure.residual import RateMap
from tinygc.reporting.html.chart import Axis, Chart, log_axis
from tinygc.reporting.html.evidence import ReportData, density
from tinygc.reporting.html.markup import Section, render


def section(evidence: ReportData) -> Section | None:
    """Section on noise; None if the stills are too short for either plot."""
    curve, problem = evidence.allan, evidence.problem
    if curve is None:
        return None
    walks = [angle_random_walk(curve, axis) for axis in range(3)]
    white = ", ".join(f"{axis} {significant(n / DEG * 1e3, 2)}" for axis, n in zip("xyz", problem.noise.gyro, strict=True))
    found = density(still_pieces(problem, problem.first), problem.logs[0].samples.period_s)
    html = render(
        "noise.html",
        white=white,
        total_s=sum(still.duration_s for still in problem.stills if still.problem is None and still.bumps == 0),
        longest_s=curve.longest_s,
        allan=lambda width: _allan(curve, walks, width),
        spectrum=found and (lambda width: _spectrum(*found, width)),
    )
    return Section("noise", "Noise at rest", html)


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


def _allan(curve: AllanCurve, walks: list[Reading], width: int) -> str:
    tau, deviation = curve.tau_s, curve.deviation / DEG_PER_HOUR
    spread = curve.relative_sigma[:, None]
    y = log_axis([*deviation.ravel(), *(deviation * (1 - np.minimum(spread, 0.6)))[-1]], "Allan deviation, °/h", margin=1.15)
    chart = Chart(width, 280, log_axis(tau, "averaging time, s", margin=1.05), y, "Allan deviation of the three axes")
    mean = float(np.mean([walk.value for walk in walks])) / DEG_PER_HOUR
    chart.line(tau, mean / np.sqrt(tau), "floor", "dash")
    for i, axis in enumerate("xyz"):
        chart.area(tau, deviation[:, i] * (1 - np.minimum(spread[:, 0], 0.9)), deviation[:, i] * (1 + spread[:, 0]), axis)
        chart.line(tau, deviation[:, i], axis)
    return chart.svg()


def _spectrum(frequency: np.ndarray, amplitude: np.ndarray, width: int) -> str:
    shown = amplitude / DEG * 1e3
    y = log_axis(shown, "mdps/√Hz", margin=1.2)
    chart = Chart(width, 230, Axis(0, frequency[-1], "frequency, Hz"), y, "Spectrum of the three axes at rest")
    for i, axis in enumerate("xyz"):
        chart.line(frequency, shown[:, i], axis)
    return chart.svg()
