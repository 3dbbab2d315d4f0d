"""What of a rest goes with its temperature: it is no noise, and is taken off before the slow terms are estimated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from session.base import features
from session.log.rests import RestLog
from tinygc.features.noise.scales import Rest

#: degC: a smaller range has nothing to tell, and the self-heating of a switched-on sensor is larger
LEAST_RANGE_C = 1.0
#: blocks of a long rest, at least
LEAST_BLOCKS = 100


@dataclass(frozen=True, eq=False)
class TemperaturePart:
    """Of one channel: residuals, of each rest (B,), its block means less the part; columns, of each rest (B, p), of what was estimated;
    rms of the part, SI; order of the polynomial."""

    residuals: list[np.ndarray]
    columns: list[np.ndarray]
    rms: float = 0.0
    order: int = 0


def is_long(rest: Rest) -> bool:
    """Whether a rest is long enough to be moved by temperature: a still is not."""
    return int(np.count_nonzero(~rest.bad)) >= LEAST_BLOCKS


def knots_of(rests: Sequence[Rest]) -> Any:
    """Return the long rests' good blocks over temperature; None where one has no temperature, where it hardly changes, or without a feature
    that knows what a zero does over temperature."""
    logs = []
    for rest in filter(is_long, rests):
        good, blocks = ~rest.bad, rest.blocks
        if not np.isfinite(blocks.temp_c[good]).all():
            return None
        none = np.zeros((int(np.count_nonzero(good)), 3))
        means = blocks.mean[good]
        count = np.full(len(none), blocks.size)
        number, temp_c, rates, forces = blocks.number[good], blocks.temp_c[good], means[:, :3], means[:, 3:]
        logs.append(RestLog(Path("rest"), number, rest.block_s, temp_c, rates, forces, none, none, count, 0, 1.0, grid=blocks.grid))
    if not logs or max(float(np.ptp(log.temp_c)) for log in logs) < LEAST_RANGE_C or (model := _model()) is None:
        return None
    return model.knots_of(logs)


def _model() -> Any:
    """What knows how a zero follows temperature; None where nothing does."""
    return next(features.each("zero over temperature"), None)


def temperature_part(rests: Sequence[Rest], channel: int, knots: Any) -> TemperaturePart:
    """Fit the channel's zero over temperature with its lag; without knots there is no part."""
    raw = [rest.blocks.mean[:, channel] for rest in rests]
    none = TemperaturePart(raw, [np.zeros((len(own), 0)) for own in raw])
    if knots is None:
        return none
    if not all(np.isfinite(own).all() for own in raw):  # of an accelerometer that is not there
        return none
    kept = [~rest.bad if is_long(rest) else np.zeros(len(rest.bad), bool) for rest in rests]
    means = np.concatenate([own[mask] for own, mask in zip(raw, kept, strict=True)])
    if (part := _model().part_of(knots, means)) is None:
        return none
    zero, powers = part
    edges = np.cumsum([np.count_nonzero(mask) for mask in kept])[:-1]
    residuals, columns = [], []
    for own, mask, of_zero, of_powers in zip(raw, kept, np.split(zero, edges), np.split(powers, edges), strict=True):
        less, wide = own.copy(), np.zeros((len(own), powers.shape[1]))
        less[mask] -= of_zero
        wide[mask] = of_powers
        residuals.append(less)
        columns.append(wide)
    return TemperaturePart(residuals, columns, float(np.std(zero)), powers.shape[1])
