"""A first try of an effect that comes from outside: what is plainly wrong is said where the file can still be named."""

from __future__ import annotations

from typing import Any

import numpy as np

from session.common.units import DEG
from tinygc.effects.effect import Effect
from tinygc.effects.errors import EffectError
from tinygc.effects.movement import Movement

SAMPLES, RATE_HZ, FULL_SCALE_DPS = 64, 104.0, 500.0


def tried(effect: Any, where: str) -> Effect:
    """The effect, if it is one and gives what it should for a short movement.  EffectError that begins with ``where``."""
    if not isinstance(effect, Effect):
        raise EffectError(f"{where}: EFFECT is of type {type(effect).__name__}, expected tinygc.effects.Effect")
    try:
        grid = None if effect.scan is None else effect.scan.grid
        values = np.array([SAMPLES / RATE_HZ / 2]) if grid is None else grid([short_movement()])
        for one in effect.variants(values[:1]):
            _try(one)
    except EffectError as error:
        raise EffectError(f"{where}: {error}") from None
    except Exception as error:
        what = " ".join(str(error).split())
        raise EffectError(f"{where}: {effect.id} fails on a movement of {SAMPLES} samples: {type(error).__name__}: {what}") from None
    return effect


def _try(effect: Effect) -> None:
    movement, size = short_movement(), effect.parameter.size
    _expect(effect, "columns", effect.columns(effect.shown(movement)), (SAMPLES, 3, size))
    theta = np.full(size, 1e-3 * effect.parameter.plausible)
    if effect.kind == "rate":
        _expect(effect, "distort", effect.distort(movement, theta), (SAMPLES, 3))
        _expect(effect, "correct", effect.correct(movement.rate, movement, theta), (SAMPLES, 3))
    if not isinstance(said := effect.says(theta), str):
        raise EffectError(f"{effect.id}: says gives {type(said).__name__}, expected a sentence")


def _expect(effect: Effect, name: str, value: Any, shape: tuple[int, ...]) -> None:
    if np.shape(value) != shape or not np.isfinite(value).all():
        raise EffectError(f"{effect.id}: {name} gives shape {np.shape(value)} or numbers that are not finite, expected {shape}")


def short_movement() -> Movement:
    """Half a second of a hand's turn, warming up, vibrated."""
    t_s = np.arange(SAMPLES) / RATE_HZ
    turn = np.stack([np.sin(9 * t_s), np.cos(7 * t_s), np.sin(5 * t_s + 1)], axis=-1)
    force = turn / np.linalg.norm(turn, axis=1, keepdims=True)
    return Movement(
        t_s, 1 / RATE_HZ, 100 * DEG * turn, force, 25 + t_s, 0.1 + 0 * t_s, SAMPLES / RATE_HZ, FULL_SCALE_DPS * DEG, first_temp_c=25.0
    )
