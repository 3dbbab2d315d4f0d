"""Words that panels share: a parameter's name, its value with its sigma in a unit that reads well; the legend that says them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tinygc.effects import Effect
from tinygc.explanation.verdict.claims import Claim

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
