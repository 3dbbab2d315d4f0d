"""Panels of noise at rest: the Allan deviation of a sensor with its band, its model and the terms of it."""

from __future__ import annotations

import numpy as np

from tinygc.noise.figures import SENSORS, TERMS, AllanBand, SensorNoise
from tinygc.noise.measured import SHOWN
from tinygc.reporting.drawing import Axis, Panel

#: how far terms are drawn below the lowest deviation
BELOW = 3.0
#: averaging times that are drawn, at most
POINTS = 60


def thinned(band: AllanBand) -> AllanBand:
    """The points nearest to ``POINTS`` averaging times in geometric steps, so that none hides another."""
    wanted = np.geomspace(band.tau_s[0], band.tau_s[-1], POINTS)
    kept = np.unique(np.abs(np.log(wanted[:, None] / band.tau_s)).argmin(axis=1))
    return AllanBand(band.tau_s[kept], band.deviation[kept], band.low[kept], band.high[kept])


def averaging(sensor: SensorNoise, band: AllanBand, y: Axis, title: str, height: float) -> Panel:
    """A panel over averaging time; those that the model does not describe, where the sensor's filter shapes the noise, are shaded."""
    panel = Panel(Axis("averaging time (s)", band.tau_s[0] / 1.2, band.tau_s[-1] * 1.2, log=True), y, title, height=height)
    from_s = max(own.from_s for own in sensor.axes)
    if from_s > band.tau_s[0]:
        panel.area([band.tau_s[0], from_s], -np.inf, np.inf, "quiet", name="filter or vibration" * bool(title))
    return panel


def deviations(kind: str, sensor: SensorNoise, band: AllanBand) -> Panel:
    """Draw the deviations of each axis with their bounds, the model, and each of its terms."""
    unit, si = SHOWN[kind]["B"]
    tau_s = np.geomspace(band.tau_s[0], band.tau_s[-1], 300)
    low, high = np.nanmin(band.deviation) / si / BELOW, np.nanmax([band.deviation, band.high]) / si * 1.2
    title = SENSORS[kind].capitalize() + ", with 68 % bounds" * bool(np.isfinite(band.low).any())
    panel = averaging(sensor, band, Axis(f"Allan deviation ({unit})", low, high, log=True), title, 330)
    for i, name in enumerate("xyz"):
        own = sensor.axes[i]
        known = np.isfinite(band.low[:, i]) & np.isfinite(band.high[:, i])
        panel.area(band.tau_s[known], band.low[known, i] / si, band.high[known, i] / si, name)
        panel.points(band.tau_s, band.deviation[:, i] / si, name, ring=True, radius=2.4, name=name)
        described = tau_s[tau_s >= own.from_s]
        panel.line(described, np.sqrt(own.allan_variance(described)) / si, name, name=name)
    for term in TERMS:
        lines = {
            name: np.sqrt(own.allan_variance(tau_s, term)) / si for name, own in zip("xyz", sensor.axes, strict=True) if own.value(term)
        }
        for name, line in lines.items():
            panel.line(tau_s, line, name, "dash", opacity=0.6, name="terms of the model")
        _label(panel, term, tau_s, lines, low)
    return panel


def _label(panel: Panel, term: str, tau_s: np.ndarray, lines: dict[str, np.ndarray], low: float) -> None:
    """Name a term at the end of its lines that is away from the data; lines that lie together have one name."""
    named: list[tuple[str, float, float]] = []
    for axis, line in sorted(lines.items(), key=lambda item: -item[1][0]):
        inside = np.flatnonzero(line > 1.2 * low)
        if not len(inside):
            continue
        at = inside[int((0.94 if line[-1] < 0.5 * line[0] else 0.06) * (len(inside) - 1))]
        if all(abs(np.log10(tau_s[at] / there)) > 0.15 or abs(np.log10(line[at] / height)) > 0.06 for _, there, height in named):
            named.append((axis, float(tau_s[at]), float(line[at])))
    for axis, there, height in named:
        panel.words(there, height, term, axis if len(named) == len(lines) else "soft", anchor="middle")
