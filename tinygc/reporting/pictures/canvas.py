"""The empty page of an explanation's pictures, its colours and its words."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from session.io.errors import CalibrationError
from session.io.results import whole
from tinygc.effects import Effect
from tinygc.explanation.claims import Claim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# The empty page of an explanation: two panels a row, under what it says.


def can_draw() -> bool:
    """Whether matplotlib, which `fit` does without, is installed."""
    return find_spec("matplotlib") is not None


def canvas(rows: int, headline: str, ids: Sequence[str], says: Sequence[str]) -> tuple[Figure, Any]:
    """Figure and its (rows, 2) panels.  Raises CalibrationError where matplotlib is missing."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise CalibrationError("pictures need matplotlib: python -m pip install 'tinygc[plot]', or use --no-pictures") from None
    figure = Figure(figsize=(13, 1.2 + 3.5 * rows), layout="constrained")
    lines = [headline, ", ".join(ids), *(fill(sentence, 150) for sentence in says)]
    figure.suptitle("\n".join(line for line in lines if line), fontsize=11, parse_math=False)
    return figure, figure.subplots(rows, 2)


def save(figure: Figure, path: Path) -> None:
    """As PNG, whole or not at all.  Names of sessions and files are drawn as they are: a dollar sign begins no formula, and a sign that
    the font lacks is a box, not a warning."""
    for panel in figure.axes:
        legend = panel.get_legend()
        for text in (panel.title, panel.xaxis.label, panel.yaxis.label, *panel.texts, *(legend.get_texts() if legend else ())):
            text.set_parse_math(False)  # but the numbers of a logarithmic axis are formulas of matplotlib's own
    with whole(path) as partial, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(partial, dpi=110, format="png")


# Colours that mean the same in every panel.

AXES = {"x": "#c0392b", "y": "#27804a", "z": "#2c5fa8"}
BEFORE, AFTER, FLOOR, PALE = "#c0392b", "#2c5fa8", "#777777", "#bbbbbb"


# Words that panels share: a parameter's name, its value with its sigma in a unit that reads well; the legend that says them.

#: characters that a panel is wide at the legend's size
WIDE = 96
#: share of a panel's height that the legend's title, and each of its lines, takes
LINE = 0.06
#: for which there is always room, so that panels before and after have one scale
LINES = 3
#: unit of a parameter -> how many of another it is, which reads better beside a curve
READS: dict[str, tuple[float, str]] = {
    "s": (1e3, "ms"),
    "fraction": (1e2, "%"),
    "fraction of full scale": (1e2, "% of full scale"),
    "1/°C": (1e6, "ppm/°C"),
}


def entry_name(effect: Effect, entry: int) -> str:
    """``x``; ``x from y`` of a matrix; the parameter's name and a number of anything else."""
    shape = effect.parameter.shape
    if shape == (3,):
        return "xyz"[entry]
    if shape == (3, 3):
        return f"{'xyz'[entry // 3]} from {'xyz'[entry % 3]}"
    return f"{effect.parameter.name} {entry + 1}" if effect.parameter.size > 1 else effect.parameter.name


def _value(claim: Claim, entry: int) -> tuple[float, float]:
    """A parameter and its sigma in the unit of its effect; not a number where the page tells something else instead."""
    name = claim.effect.parameter.name
    values, sigmas = (np.ravel(told.get(name, np.nan)) for told in (claim.parameters, claim.std))
    return (float(values[entry]), float(sigmas[entry])) if entry < len(values) and entry < len(sigmas) else (np.nan, np.nan)


def told_value(claim: Claim, entry: int) -> str:
    """``-4.21 ± 0.05 ms``: to the sigma's first digits; empty where the claim tells other numbers."""
    value, sigma = _value(claim, entry)
    if not np.isfinite(value):
        return ""
    unit = claim.effect.parameter.unit
    times, words = READS.get(unit, (1.0, unit))
    return f"{plain(times * value, times * sigma)} {words}".strip()


def plain(value: float, sigma: float) -> str:
    """A number and its sigma with as many decimals as the sigma has worth telling."""
    if not (np.isfinite(sigma) and sigma > 0):
        return f"{value:.3g}".replace("-", "−")
    decimals = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 9))
    return f"{value:.{decimals}f} ± {sigma:.{decimals}f}".replace("-", "−")


def legend(axes: Axes, title: str | None = None) -> None:
    """Above the data, which is moved down to make room: in as many columns as there is room for."""
    _, labels = axes.get_legend_handles_labels()
    columns = int(np.clip(WIDE // (max(map(len, labels)) + 6), 1, len(labels)))
    lines = max(-(-len(labels) // columns) + (title is not None), LINES)
    low, high = axes.get_ylim()
    axes.set_ylim(low, low + (high - low) / (1 - LINE * lines - 0.03))
    axes.legend(loc="upper center", ncols=columns, fontsize=8, title=title, title_fontsize=8, columnspacing=1.2, borderaxespad=0.3)
