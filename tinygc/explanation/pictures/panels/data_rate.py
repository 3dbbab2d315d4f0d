"""Motion that is faster than half the data rate: closure over the data rate that is taken, and where it leads to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tinygc.explanation.pictures.panels.palette import AFTER, BEFORE, FLOOR
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: on either side of the data, a factor
ROOM = 1.35
#: below the lowest of them, a factor: the legend's
ROOM_BELOW = 8.0


@dataclass(frozen=True, eq=False)
class DataRates:
    """rates_hz (K,) that are taken, the native one and every 2nd, 3rd, … sample; closure_deg (K,) rms at each; exponent of the closure in
    the rate; predicted_deg: what motion between the samples makes at the native rate; floor_deg: what noise alone leaves, or None."""

    rates_hz: np.ndarray
    closure_deg: np.ndarray
    exponent: float
    predicted_deg: float
    floor_deg: float | None = None


def draw(axes: Axes, data: DataRates) -> None:
    """Log-log: the closure at each rate, the line of the exponent through the thinned ones, and what it leaves at the native rate."""
    order = np.argsort(data.rates_hz)[::-1]
    rates, closure = np.asarray(data.rates_hz, dtype=float)[order], np.asarray(data.closure_deg, dtype=float)[order]
    axes.loglog(rates[1:], closure[1:], "o", color=BEFORE, ms=7, label="closure, samples left out")
    axes.loglog(rates[:1], closure[:1], "s", color=AFTER, ms=8, label=f"closure as recorded: {closure[0]:.3g}°")
    at = np.array([rates[-1] / ROOM, rates[0] * ROOM])
    line = data.predicted_deg * (at / rates[0]) ** data.exponent
    axes.loglog(at, line, color=BEFORE, lw=1.5, label=f"motion between samples: closure ~ rate$^{{{data.exponent:.1f}}}$")
    axes.loglog(
        rates[:1], [data.predicted_deg], "D", mfc="none", color=BEFORE, ms=9, label=f"of it at {rates[0]:.4g} Hz: {data.predicted_deg:.3g}°"
    )
    if data.floor_deg is not None:
        axes.axhline(data.floor_deg, color=FLOOR, ls="--", label=f"noise alone: {data.floor_deg:.2g}°")
    for number, (rate, angle) in enumerate(zip(rates, closure, strict=True)):
        words = "every sample" if number == 0 else f"every {_ordinal(round(rates[0] / rate))}"
        axes.annotate(words, (rate, angle), xytext=(7, 7), textcoords="offset points", fontsize=8)
    lowest = min([closure.min(), data.predicted_deg, *([data.floor_deg] if data.floor_deg else [])])
    axes.set_xlim(rates[-1] / ROOM, rates[0] * ROOM * 1.3)
    axes.set_ylim(lowest / ROOM_BELOW, max(closure.max(), line.max()) * 1.5)
    axes.set_xticks(rates, [f"{rate:.3g}" for rate in rates])
    axes.minorticks_off()
    axes.set(
        xlabel="samples taken a second (Hz)",
        ylabel="rms closure of the turns (°)",
        title="Fewer samples close worse: the motion is too fast for them",
    )
    axes.legend(fontsize=8, loc="lower left")


def over_rate(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Of a claim whose parameters are the names of ``DataRates``."""
    told = claim.parameters
    floor_deg = float(np.degrees(e.proof.floor_rms))
    draw(axes, DataRates(np.array(told["rates_hz"]), np.array(told["closure_deg"]), told["exponent"], told["predicted_deg"], floor_deg))


def _ordinal(number: int) -> str:
    return f"{number}{ {1: 'st', 2: 'nd', 3: 'rd'}.get(number if number < 20 else number % 10, 'th') } sample"
