"""Picture of rate steps: the output with the chosen law, and what the law and a straight line leave, for each sensor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tinygc.features.tables.rates.choice import Choice
from tinygc.features.tables.rates.sweep import Sweep, transfer
from tinygc.features.tables.rates.text import curve_words, headline
from tinygc.reporting.pictures.canvas import AFTER, BEFORE, FLOOR, PALE, canvas, legend

if TYPE_CHECKING:
    from tinygc.reporting.pictures.canvas import Axes, Figure

#: rates at which a law is drawn
DRAWN = 801
#: sensors and sweeps of one picture, at most
MOST_ROWS = 8
MARKS = "os^Dv<>p"


def figure_of(choices: Sequence[Choice], sweeps: Sequence[Sweep]) -> Figure:
    """Return the picture as a matplotlib figure.  Raises CalibrationError where matplotlib is missing."""
    shown, swept = choices[:MOST_ROWS], sweeps[: max(MOST_ROWS - len(choices), 1)]
    figure, grid = canvas(len(shown) + len(swept), "Rate steps" if shown else "Sine sweep", [], [])
    panels = np.reshape(grid, (-1, 2))
    for (curve, left), choice in zip(panels, shown, strict=False):
        _output(choice, curve)
        _residuals(choice, left)
    for (gain, phase), sweep in zip(panels[len(shown) :], swept, strict=True):
        _response(sweep, gain, phase)
    return figure


def _output(choice: Choice, axes: Axes) -> None:
    points, grid = choice.points, np.linspace(choice.points.rate_dps.min(), choice.points.rate_dps.max(), DRAWN)
    axes.plot(grid, choice.line.at(grid), "--", color=FLOOR, lw=0.8, label="straight line")
    axes.plot(grid, choice.fit.at(grid), "-", color=AFTER, lw=1.2, label=choice.fit.hypothesis.name)
    for n, curve in enumerate(points.curves):
        own = points.curve == n
        axes.plot(
            points.rate_dps[own],
            points.output[own],
            MARKS[n % len(MARKS)],
            ms=4,
            mfc="none",
            color=BEFORE,
            label=curve_words(curve) or None,
        )
    axes.grid(True, color=PALE, lw=0.4, alpha=0.6)
    axes.set(xlabel="rate (°/s)", ylabel=f"output ({points.unit})", title=headline(choice).partition(":")[0])
    legend(axes)


def _residuals(choice: Choice, axes: Axes) -> None:
    points = choice.points
    for n in range(len(points.curves)):
        own = points.curve == n
        order = np.argsort(points.rate_dps[own], kind="stable")
        axes.plot(
            points.rate_dps[own][order],
            choice.fit.residuals[own][order],
            MARKS[n % len(MARKS)] + "-",
            ms=4,
            mfc="none",
            lw=0.6,
            color=AFTER,
        )
    noise = choice.fit.noise * (points.sigma if points.is_known else np.ones(len(points)))
    order = np.argsort(points.rate_dps, kind="stable")
    axes.fill_between(points.rate_dps[order], -noise[order], noise[order], color=FLOOR, alpha=0.2, lw=0, label="noise, 1 σ")
    axes.axhline(0, color=FLOOR, lw=0.8)
    axes.grid(True, color=PALE, lw=0.4, alpha=0.6)
    axes.set(xlabel="rate (°/s)", ylabel=f"left ({points.unit})", title=f"what the law leaves (a straight line: {choice.line.rms:.3g} rms)")


def _response(sweep: Sweep, gain: Axes, phase: Axes) -> None:
    response = sweep.response
    f = np.geomspace(response.frequency_hz.min(), response.frequency_hz.max(), 200)
    model = transfer(sweep.model, f, sweep.vector)
    at = np.angle(transfer(sweep.model, response.frequency_hz, sweep.vector))
    measured = at + np.angle(np.exp(1j * (response.phase - at)))
    gain.errorbar(response.frequency_hz, response.gain, response.gain_sigma, fmt="o", ms=4, mfc="none", color=BEFORE)
    gain.plot(f, np.abs(model), color=AFTER)
    phase.errorbar(response.frequency_hz, np.degrees(measured), np.degrees(response.phase_sigma), fmt="o", ms=4, mfc="none", color=BEFORE)
    phase.plot(f, np.degrees(np.angle(model)), color=AFTER)
    for axes, label in ((gain, "gain"), (phase, "phase (°)")):
        axes.set_xscale("log")
        axes.grid(True, color=PALE, lw=0.4, alpha=0.6)
        axes.set(xlabel="frequency (Hz)", ylabel=label)
    gain.set_title(sweep.headline)
