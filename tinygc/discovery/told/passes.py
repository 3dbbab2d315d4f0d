"""How many passes of substitution undo a law, by trial on a drawn movement: what a written file declares, and its C does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tinygc.discovery.grammar.as_effect import columns_of
from tinygc.discovery.grammar.form import Form
from tinygc.discovery.grammar.some_movement import FULL_SCALE, some_movement
from tinygc.effects import Movement
from tinygc.effects.device import PASSES
from tinygc.effects.jumps import undone_with_jumps
from tinygc.effects.undo import MOST_PASSES, substituted

#: Hz, the highest at which a proof undoes an effect; s of movement
RATE_HZ, LENGTH_S = 833.0, 8.0
#: of the size found, that another unit may have, of each sign: what a proof hides
STRONGER, DRAWN = 1.5, 2
#: share of what is added that may be left: a proof asks for 5e-3; and of rows that may be left with more, as at the rate
#: that ends a rest
LEFT, ASTRAY = 1e-3, 0.01
#: of a rate beside 1 rad/s, what C may leave: single precision rounds as much
LEFT_IN_C = 2e-6


def passes_of(form: Form, theta: np.ndarray, jumps: bool, full_scale: float = FULL_SCALE) -> int | None:
    """Passes of all rows alike that take off what a law adds, theta (P,) SI; None where ``MOST_PASSES`` do not."""
    moved = _movement(full_scale)

    def left(size: np.ndarray, passes: int) -> bool:
        def added(movement: Movement) -> np.ndarray:
            return columns_of(form, movement) @ size

        distorted = moved.rate + (adds := added(moved))
        undone = undone_with_jumps if jumps else substituted
        rate = undone(distorted, moved, added, passes)
        off = np.abs(rate - moved.rate).max(axis=1) > LEFT * np.abs(adds).max(initial=1e-12)
        return bool(off.mean() > ASTRAY)

    return _least(theta, left)


def passes_in_c(form: Form, theta: np.ndarray, full_scale: float = FULL_SCALE) -> int | None:
    """The same of single precision, to full scale; rows are alone."""
    rng, moved = np.random.default_rng(0), _movement(full_scale)
    moved = replace(moved, rate=rng.uniform(-full_scale, full_scale, np.shape(moved.rate)))

    def left(size: np.ndarray, passes: int) -> bool:
        rate = substituted(moved.rate, moved, lambda movement: columns_of(form, movement) @ size, passes)
        again = rate + columns_of(form, moved.with_rate(rate)) @ size
        return bool((np.abs(again - moved.rate) > LEFT_IN_C * (1 + np.abs(moved.rate))).any())

    return _least(theta, left)


def _least(theta: np.ndarray, left: Callable[[np.ndarray, int], bool]) -> int | None:
    rng, rms = np.random.default_rng(0), float(np.sqrt(np.mean(theta**2)))
    sizes = [STRONGER * theta, *(STRONGER * rms * rng.choice((-1.0, 1.0), (DRAWN, len(theta))))]
    passes = PASSES
    for size in sizes:
        while left(size, passes):
            if passes >= MOST_PASSES:
                return None
            passes = min(passes + 1 + passes // 4, MOST_PASSES)
    return passes


def _movement(full_scale: float) -> Movement:
    """(N,) rows of a drawn one, straight between its samples: more abrupt than a hand."""
    drawn = some_movement(0)
    t_s = drawn.t_s[0] + np.arange(0.0, LENGTH_S, 1 / RATE_HZ)

    def at(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1)
        return np.stack([np.interp(t_s, drawn.t_s, column) for column in flat.T], axis=-1).reshape(-1, *values.shape[1:])

    return replace(
        drawn,
        t_s=t_s,
        dt_s=1 / RATE_HZ,
        rate=at(drawn.rate) * full_scale / FULL_SCALE,
        force_g=at(drawn.force_g),
        temp_c=at(drawn.temp_c),
        vibration_g2=at(drawn.vibration_g2),
        fs_rps=full_scale,
    )
