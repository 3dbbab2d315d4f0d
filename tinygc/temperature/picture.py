"""The picture of a fit over temperature: each axis' zero up and down, what is left, the Allan deviation, E where sessions tell it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG, DEG_PER_HOUR
from tinygc.explanation.pictures.canvas import canvas, save
from tinygc.explanation.pictures.panels.palette import AXES, PALE
from tinygc.models.field_parameters import scale_factor_errors
from tinygc.models.linear import MATRIX
from tinygc.temperature.rest_fit import RestFit
from tinygc.temperature.thermal_fit import ThermalFit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: how a way is drawn
UP, DOWN = "#c0392b", "#2c5fa8"


def draw(fit: ThermalFit, path: Path) -> None:
    """Write the picture as PNG.  Raises CalibrationError where matplotlib is missing."""
    save(figure_of(fit), path)


def figure_of(fit: ThermalFit) -> Figure:
    """The picture as a matplotlib figure.  Raises CalibrationError where matplotlib is missing."""
    rests = fit.rests
    rows = (3 if rests is not None else 0) + (1 if fit.sessions is not None or (rests is not None and rests.allan is not None) else 0)
    figure, grid = canvas(max(rows, 1), f"{fit.name}: over temperature", [], [])
    grid = np.atleast_2d(grid)
    if rests is not None:
        for axis in range(3):
            _zero(rests, axis, grid[axis, 0])
            _left(rests, axis, grid[axis, 1])
    last = grid[-1] if rows % 3 == 1 or rests is None else None
    if last is not None:
        if rests is not None and rests.allan is not None:
            _allan(rests, last[0])
        else:
            last[0].axis("off")
        if fit.sessions is not None:
            _scale(fit, last[1])
        else:
            last[1].axis("off")
    return figure


def _ways(rests: RestFit) -> list[tuple[str, str, np.ndarray]]:
    direction = rests.knots.direction
    return [(name, colour, direction == way) for name, colour, way in (("up", UP, 1), ("down", DOWN, -1), ("", PALE, 0))]


def _zero(rests: RestFit, axis: int, axes: Axes) -> None:
    """Means of knots, each log's own zero taken to the common one, and the model."""
    knots, fit = rests.knots, rests.gyro[axis]
    values = knots.mean(np.concatenate([log.gyro[:, axis] for log in knots.logs])) / DEG
    for name, colour, which in _ways(rests):
        if which.any():
            axes.plot(knots.temp_c[which], values[which], "o", ms=3, mfc="none", color=colour, label=name or None)
    at = np.linspace(*rests.range_c, 200)
    curve = np.polynomial.polynomial.polyval(at - knots.reference_c, fit.terms) / DEG
    label = f"order {fit.order}" + (f", lag {fit.tau_s:.0f} s" if fit.tau_s else "")
    axes.plot(at, curve, "k-", lw=1, label=label)
    axes.set(xlabel="temperature (°C)", ylabel="rate at rest (dps)", title=f"{'xyz'[axis]}: zero over temperature")
    axes.legend(fontsize=8)


def _left(rests: RestFit, axis: int, axes: Axes) -> None:
    """What the model leaves, by the element's temperature, against what is held out."""
    knots, fit = rests.knots, rests.gyro[axis]
    values = knots.mean(np.concatenate([log.gyro[:, axis] for log in knots.logs]))
    element = knots.mean(knots.element_c(fit.tau_s))
    model = np.polynomial.polynomial.polyval(knots.mean(knots.element_c(fit.tau_s)) - knots.reference_c, fit.terms)
    left = (values - model) / DEG
    for number in range(len(knots.logs)):
        left[knots.of == number] -= left[knots.of == number].mean()
    for _, colour, which in _ways(rests):
        for sweep in np.unique(knots.sweep[which]):
            here = knots.sweep == sweep
            axes.plot(element[here], left[here], "o-", ms=3, lw=0.5, mfc="none", color=colour)
    band = fit.held_out / DEG
    axes.axhspan(-band, band, color=PALE, alpha=0.3, label=f"held out, {band:.2g} dps rms")
    axes.set(xlabel="temperature of the element (°C)", ylabel="left (dps)", title=f"{'xyz'[axis]}: what the model leaves")
    axes.legend(fontsize=8)


def _allan(rests: RestFit, axes: Axes) -> None:
    assert rests.allan is not None
    for i, axis in enumerate("xyz"):
        axes.loglog(rests.allan.tau_s, rests.allan.deviation[:, i] / DEG_PER_HOUR, "-", color=AXES[axis], label=axis)
    axes.set(xlabel="averaging time (s)", ylabel="Allan deviation (°/h)", title="Allan deviation of what temperature leaves")
    axes.legend(fontsize=8)


def _scale(fit: ThermalFit, axes: Axes) -> None:
    """Scale factor errors of the sessions, and the model with one sigma."""
    assert fit.sessions is not None
    at = np.linspace(*fit.model.range_c, 60)
    E = fit.model.E(at)
    sigma = np.array([fit.sigma_at(float(temp_c))[0] for temp_c in at])
    for i, axis in enumerate("xyz"):
        mid = scale_factor_errors(E)[:, i] * 1e6
        axes.plot(at, mid, "-", color=AXES[axis], label=axis)
        axes.fill_between(at, mid - sigma[:, i, i] * 1e6, mid + sigma[:, i, i] * 1e6, color=AXES[axis], alpha=0.15)
        for point in fit.sessions.points:
            value, error = scale_factor_errors(point.values[MATRIX].reshape(3, 3))[i] * 1e6, np.sqrt(point.covariance[4 * i, 4 * i]) * 1e6
            axes.errorbar(point.temp_c, value, yerr=error, fmt="o", ms=4, color=AXES[axis])
    axes.set(xlabel="temperature (°C)", ylabel="scale factor error (ppm)", title="Scale factor error over temperature")
    axes.legend(fontsize=8)
