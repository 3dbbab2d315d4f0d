"""Recorded less predicted, channel by channel: the one table that the terminal, the report and the JSON show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.explanation.twin.channels import own_residuals, unknown_rows
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.titles import CHANNELS

#: what stands above it
HEADING = "Recorded less predicted, in sigmas of the noise (rms; 1 is noise alone)"


@dataclass(frozen=True)
class ChannelRms:
    """channel: in words; values: how many; before: rms in sigmas that the linear model leaves; after: that with what is named is left,
    None where nothing that is fitted was named, or moves the channel."""

    channel: str
    values: int
    before: float
    after: float | None


def is_refitted(e: Explanation) -> bool:
    """Whether the fit knows more than the linear model: what was mended in the registers was mended before either."""
    return bool(e.naming.fit.state.claims)


def channel_rms(e: Explanation) -> dict[str, tuple[float, float]]:
    """Of each channel by itself, (before, after): rms in sigmas of its own noise, over the values that its own calibration leaves free.

    Whitened together, a misfit of the closure would spread over channels that are healthy: gravity's length is the accelerometer's alone.
    """
    looks = [own_residuals(e.twin, e.whiten, fit) for fit in (e.naming.first, e.naming.fit)]
    found = {}
    for name, part in e.whiten.parts.items():
        before, after = (float(np.sqrt(np.sum(r[part] ** 2) / max(values_of(e, name) - taken[name], 1))) for r, taken in looks)
        found[name] = before, after
    return found


def values_of(e: Explanation, name: str) -> int:
    """How many values a channel has: rows of angles that no reference sees are none."""
    part = e.whiten.parts[name]
    return part.stop - part.start - unknown_rows(e.twin, name)


def residual_table(e: Explanation) -> list[ChannelRms]:
    """The table's rows: the channels that are fitted, then slope and scatter within the stills, which no effect that is fitted moves."""
    rows = []
    for name, (before, after) in channel_rms(e).items():
        rows.append(ChannelRms(CHANNELS[name], values_of(e, name), before, after if is_refitted(e) else None))
    assert e.within is not None  # an explanation that is told is whole
    for name in ("slope", "scatter"):
        rows.append(ChannelRms(f"{name} of the rate within each still", e.within.slope.size, e.within.rms(name), None))
    return rows
