"""The empty page of an explanation: two panels a row, under what it says."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from session.common.errors import CalibrationError
from session.files.results import whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
