"""Empty page of an explanation's pictures, its colours and labels."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from session.base.errors import CalibrationError
from session.base.results import whole
from session.base.texts import measured
from tinygc.effects import Effect
from tinygc.explanation.claims import Claim

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure


# The empty page of an explanation: two panels per row, below its text.


def has_matplotlib() -> bool:
    """Whether matplotlib is installed, which `fit` does not need."""
    return find_spec("matplotlib") is not None


def canvas(rows: int, headline: str, ids: Sequence[str], says: Sequence[str]) -> tuple[Figure, Any]:
    """Create the figure and its (rows, 2) panels.  Raises CalibrationError if matplotlib is missing."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise CalibrationError("pictures need matplotlib: python -m pip install 'tinygc[plot]', or use --no-pictures") from None
    figure = Figure(figsize=(13, 1.2 + 3.5 * rows), layout="constrained")
    lines = [headline, ", ".join(ids), *(fill(sentence, 150) for sentence in says)]
    figure.suptitle("\n".join(line for line in lines if line), fontsize=11, parse_math=False)
    return figure, figure.subplots(rows, 2)


def colour_scale(low: float, high: float) -> tuple[Any, Any]:
    """Normalisation of values from low to high, and the colour map of the normalised values."""
    from matplotlib import colormaps
    from matplotlib.colors import Normalize

    return Normalize(low, high), colormaps["viridis"]


def save(figure: Figure, path: Path) -> None:
    """Write a PNG atomically.

    Names of sessions and files are drawn literally: a dollar sign starts no formula, and a character missing from the font is drawn as a
    box without a warning.
    """
    for panel in figure.axes:
        legend = panel.get_legend()
        for text in (panel.title, panel.xaxis.label, panel.yaxis.label, *panel.texts, *(legend.get_texts() if legend else ())):
            text.set_parse_math(False)  # except on logarithmic axes, whose numbers matplotlib writes as formulas
    with whole(path) as file, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(file, dpi=110, format="png")


def saved(figure: Figure, path: Path) -> Figure:
    """Write a PNG, in a folder that is made where it is missing, and return the figure."""
    if path.is_dir():
        raise CalibrationError(f"{path}: that is a folder; give a file")
    path.parent.mkdir(parents=True, exist_ok=True)
    save(figure, path)
    return figure


# Colours, with the same meaning in every panel.

AXES = {"x": "#c0392b", "y": "#27804a", "z": "#2c5fa8"}
BEFORE, AFTER, FLOOR, PALE = "#c0392b", "#2c5fa8", "#777777", "#bbbbbb"


# Labels that panels share: a parameter's name, its value with its sigma in a readable unit, the legend.

#: characters across a panel at the legend's size
WIDE = 96
#: share of a panel's height for each line of the legend, title included
LINE = 0.06
#: least number of lines reserved, which gives panels before and after the same scale
LINES = 3
#: unit of a parameter -> factor to a more readable unit, and its name
READS: dict[str, tuple[float, str]] = {
    "s": (1e3, "ms"),
    "fraction": (1e2, "%"),
    "fraction of full scale": (1e2, "% of full scale"),
    "1/°C": (1e6, "ppm/°C"),
}


def entry_name(effect: Effect, entry: int) -> str:
    """Name ``x``; ``x from y`` in a matrix; otherwise the parameter's name, with a number if there are several."""
    shape = effect.parameter.shape
    if shape == (3,):
        return "xyz"[entry]
    if shape == (3, 3):
        return f"{'xyz'[entry // 3]} from {'xyz'[entry % 3]}"
    return f"{effect.parameter.name} {entry + 1}" if effect.parameter.size > 1 else effect.parameter.name


def _value(claim: Claim, entry: int) -> tuple[float, float]:
    """A parameter and its sigma in the unit of its effect; NaN if the claim states other numbers instead."""
    name = claim.effect.parameter.name
    values, sigmas = (np.ravel(told.get(name, np.nan)) for told in (claim.parameters, claim.std))
    return (float(values[entry]), float(sigmas[entry])) if entry < len(values) and entry < len(sigmas) else (np.nan, np.nan)


def value_text(claim: Claim, entry: int) -> str:
    """Text ``-4.21 ± 0.05 ms``, to the sigma's first digits; empty if the claim states other numbers."""
    value, sigma = _value(claim, entry)
    if not np.isfinite(value):
        return ""
    unit = claim.effect.parameter.unit
    times, words = READS.get(unit, (1.0, unit))
    return f"{measured(times * value, times * sigma)} {words}".strip()


def zero_line(axes: Axes) -> None:
    """Draw a thin line at zero."""
    axes.axhline(0, color=FLOOR, lw=0.8)


def legend(axes: Axes, title: str | None = None) -> None:
    """Draw the legend above the data in as many columns as fit, and extend the y axis to make room."""
    _, labels = axes.get_legend_handles_labels()
    columns = int(np.clip(WIDE // (max(map(len, labels)) + 6), 1, len(labels)))
    lines = max(-(-len(labels) // columns) + (title is not None), LINES)
    low, high = axes.get_ylim()
    axes.set_ylim(low, low + (high - low) / (1 - LINE * lines - 0.03))
    axes.legend(loc="upper center", ncols=columns, fontsize=8, title=title, title_fontsize=8, columnspacing=1.2, borderaxespad=0.3)
