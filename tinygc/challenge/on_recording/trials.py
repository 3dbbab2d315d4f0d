"""What is concealed in a recording, and how large: multiples of what ``explain`` says would show, else the examination's strengths."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from tinygc.challenge.cases import STRENGTHS
from tinygc.challenge.outsiders import OUTSIDERS
from tinygc.effects import Effect, catalogue

#: of ``seen_from``; the first ones come first where not all can be tried
MULTIPLES = (2.0, 4.0, 1.0, 8.0, 0.5)
#: of an effect's generous sigma: its strong size where this recording names none
STRONG_SHARE = 0.05
#: what bends no rate, and is concealed all the same; the others are the site, and stills that move, which no reading can be given
BY_STRENGTH = ("timing.gyro_accel_offset", "gyro.saturation", "data.glitches", "timing.dropped_samples")
STRONG = "of the strong size"
#: id, size, unit, seen_from
Drawn = tuple[str, float, str, float | None]


@dataclass(frozen=True)
class Trial:
    """One concealed effect: id; size and its unit, or ``STRONG``; seen_from, in that unit, or None; a seed for directions and moments."""

    name: str
    id: str
    size: float
    unit: str
    seen_from: float | None
    seed: int


def draw_trials(seen_from: dict[str, float], own: Collection[str], has_temperature: bool, count: int | None, seed: int) -> list[Trial]:
    """Trials in random order.

    seen_from: effect id -> size in its parameter's unit, of those that this recording can see; own: names that it gets untouched, which
    are not concealed again; count: at most so many, each effect before any is tried at another size.
    """
    rng = np.random.default_rng(seed)
    sized: list[list[Drawn]] = []
    for name in sorted({*catalogue(), *OUTSIDERS} - set(own)):
        effect = catalogue().get(name)
        if not _can_be_concealed(name, effect, has_temperature):
            continue
        sized.append(
            [(name, size, unit, seen_from.get(name) if unit != STRONG else None) for size, unit in _sizes(name, effect, seen_from)]
        )
    in_turn = [
        each for turn in range(max(map(len, sized), default=0)) for each in _shuffled([s for s in sized if turn < len(s)], turn, rng)
    ]
    chosen = in_turn[:count]
    trials = []
    for place, i in enumerate(rng.permutation(len(chosen)).tolist()):
        name, size, unit, promised = chosen[i]
        trials.append(Trial(f"case{place + 1:03d}", name, size, unit, promised, int(rng.integers(2**31))))
    return trials


def _shuffled(sized: list[list[Drawn]], turn: int, rng: np.random.Generator) -> list[Drawn]:
    return [sized[i][turn] for i in rng.permutation(len(sized))]


def _can_be_concealed(name: str, effect: Effect | None, has_temperature: bool) -> bool:
    if not has_temperature and ((effect is not None and "temperature" in effect.inputs) or name == "outside.temperature_curve"):
        return False
    return effect is None or effect.kind == "rate" or name in (*BY_STRENGTH, "reference.accelerometer")


def _sizes(name: str, effect: Effect | None, seen_from: dict[str, float]) -> list[tuple[float, str]]:
    if effect is None or name in BY_STRENGTH:
        return [(strength, STRONG) for strength in STRENGTHS]
    parameter = effect.parameter
    if name in seen_from:
        return [(multiple * seen_from[name], parameter.unit) for multiple in MULTIPLES]
    return [(strength * STRONG_SHARE * parameter.plausible / parameter.si, parameter.unit) for strength in STRENGTHS]
