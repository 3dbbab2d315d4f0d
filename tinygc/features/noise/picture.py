"""Picture of a noise estimate: Allan deviation with its band, the model, each of its terms, and what the model leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tinygc.features.noise.text import headline
from tinygc.noise.figures import SENSORS, TERMS, AllanBand, NoiseFigures, SensorNoise
from tinygc.noise.measured import SHOWN
from tinygc.reporting.pictures.canvas import AXES, FLOOR, PALE, canvas

if TYPE_CHECKING:
    from tinygc.reporting.pictures.canvas import Axes, Figure

#: how far terms are drawn below the lowest deviation
BELOW = 3.0
#: averaging times that are drawn, at most
POINTS = 60
#: most that the panel of ratios shows
MOST_RATIO = 2.0


def figure_of(figures: NoiseFigures) -> Figure:
    """Return the picture as a matplotlib figure.  Raises CalibrationError where matplotlib is missing."""
    figure, grid = canvas(2, headline(figures), [], [])
    grid[0, 0].get_gridspec().set_height_ratios((3, 1))
    sensors = figures.sensors()
    for column, kind in enumerate(SENSORS):
        curve, ratio = grid[:, column]
        if kind not in sensors or kind not in figures.allan:
            curve.axis("off")
            ratio.axis("off")
            continue
        band = _thinned(figures.allan[kind])
        _deviations(kind, sensors[kind], band, curve)
        _ratios(sensors[kind], band, ratio)
        ratio.set_xlim(curve.get_xlim())
        curve.tick_params(labelbottom=False)
    return figure


def _thinned(band: AllanBand) -> AllanBand:
    """The points nearest to ``POINTS`` averaging times in geometric steps, so that none hides another."""
    wanted = np.geomspace(band.tau_s[0], band.tau_s[-1], POINTS)
    kept = np.unique(np.abs(np.log(wanted[:, None] / band.tau_s)).argmin(axis=1))
    return AllanBand(band.tau_s[kept], band.deviation[kept], band.low[kept], band.high[kept])


def _deviations(kind: str, sensor: SensorNoise, band: AllanBand, axes: Axes) -> None:
    unit, si = SHOWN[kind]["B"]
    tau_s = np.geomspace(band.tau_s[0], band.tau_s[-1], 300)
    low = np.nanmin(band.deviation) / si / BELOW
    lines: dict[str, dict[str, np.ndarray]] = {}  # by term and axis
    for i, name in enumerate("xyz"):
        own, colour = sensor.axes[i], AXES[name]
        axes.fill_between(band.tau_s, band.low[:, i] / si, band.high[:, i] / si, color=colour, alpha=0.2, lw=0)
        axes.loglog(band.tau_s, band.deviation[:, i] / si, "o", ms=3, mfc="none", mew=0.8, color=colour, label=name)
        described = tau_s[tau_s >= own.from_s]
        axes.loglog(described, np.sqrt(own.allan_variance(described)) / si, "-", lw=1.6, color=colour)
        for term in filter(own.value, TERMS):
            line = np.sqrt(own.allan_variance(tau_s, term)) / si
            axes.loglog(tau_s, line, "--", lw=0.7, alpha=0.7, color=colour)
            lines.setdefault(term, {})[name] = line
    for term, by_axis in lines.items():
        _label(term, tau_s, by_axis, low, axes)
    _shortest(sensor, axes, band)
    axes.loglog([], [], "k-", lw=1.6, label="model")
    axes.loglog([], [], "k--", lw=0.7, label="its terms")
    axes.set_ylim(low, np.nanmax([band.deviation, band.high]) / si * 2)
    axes.grid(True, which="major", color=PALE, lw=0.4, alpha=0.6)
    axes.set(
        ylabel=f"Allan deviation ({unit})", title=SENSORS[kind].capitalize() + ", with 68 % bounds" * bool(np.isfinite(band.low).any())
    )
    axes.legend(fontsize=8, ncols=5, loc="upper right")


def _label(term: str, tau_s: np.ndarray, lines: dict[str, np.ndarray], low: float, axes: Axes) -> None:
    """Name a term at the end of its lines that is away from the data; lines that lie together have one name."""
    named: list[tuple[str, float, float]] = []
    for axis, line in sorted(lines.items(), key=lambda item: -item[1][0]):
        inside = np.flatnonzero(line > 1.2 * low)
        if not len(inside):
            continue
        share = 0.94 if line[-1] < 0.5 * line[0] else 0.06
        at = inside[int(share * (len(inside) - 1))]
        if all(abs(np.log10(tau_s[at] / there)) > 0.15 or abs(np.log10(line[at] / height)) > 0.06 for _, there, height in named):
            named.append((axis, float(tau_s[at]), float(line[at])))
    for axis, there, height in named:
        colour = AXES[axis] if len(named) == len(lines) else "#444444"
        axes.annotate(term, (there, height), (0, 2), textcoords="offset points", color=colour, fontsize=9, ha="center", weight="bold")


def _shortest(sensor: SensorNoise, axes: Axes, band: AllanBand) -> None:
    """Shade averaging times that the model does not describe, where the sensor's filter shapes the noise."""
    from_s = max(own.from_s for own in sensor.axes)
    if from_s > band.tau_s[0]:
        axes.axvspan(band.tau_s[0], from_s, color=PALE, alpha=0.25, lw=0)


def _ratios(sensor: SensorNoise, band: AllanBand, axes: Axes) -> None:
    """Draw the deviations over the model's, with the bounds of the data."""
    for i, name in enumerate("xyz"):
        model = np.sqrt(sensor.axes[i].allan_variance(band.tau_s))
        with np.errstate(divide="ignore", invalid="ignore"):
            low, mid, high = (values[:, i] / model for values in (band.low, band.deviation, band.high))
        axes.fill_between(band.tau_s, low, high, color=AXES[name], alpha=0.2, lw=0)
        axes.semilogx(band.tau_s, mid, "o-", ms=2.5, lw=0.6, mfc="none", color=AXES[name])
    _shortest(sensor, axes, band)
    axes.axhline(1, color=FLOOR, lw=0.8)
    axes.set_ylim(1 / MOST_RATIO, MOST_RATIO)
    axes.set_yscale("log")
    axes.set_yticks([0.5, 0.7, 1, 1.4, 2], labels=["0.5", "0.7", "1", "1.4", "2"])
    axes.minorticks_off()
    axes.set(xlabel="averaging time (s)", ylabel="data / model")
