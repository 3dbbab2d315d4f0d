"""From what size on each effect would have been seen in this recording: what a `no_mismatch` is worth, and what it cannot know."""

from __future__ import annotations

from collections import Counter

import numpy as np

from tinygc.effects import Effect, catalogue
from tinygc.explanation.naming.candidates import candidates
from tinygc.explanation.naming.evidence import least_gain
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener


def seen_from(twin: Twin, whiten: Whitener, fit: Refit) -> dict[str, float]:
    """Effect id -> the size, in the parameter's unit, from which half of its directions are said; inf where no plausible one would be.

    Said is what is more probable than nothing (``evidence.least_gain``).  An effect whose shape is scanned (a step) is taken at the moment
    that shows it best.  Linear, beside all that ``fit`` has.
    """
    q, _ = np.linalg.qr(fit.J / np.linalg.norm(fit.J, axis=0))
    sizes: dict[str, float] = {}
    tried, replay = candidates(twin), Replay(twin, fit)
    shapes = Counter(effect.id for effect in tried)
    for effect in tried:
        columns = whiten(replay.columns(effect).stacked())
        size = _size(effect, columns - q @ (q.T @ columns), float(np.sqrt(least_gain(effect, shapes[effect.id]))))
        sizes[effect.id] = min(size, sizes.get(effect.id, np.inf))
    return sizes


def in_words(sizes: dict[str, float]) -> list[str]:
    """Two lines at most: from what size on each would have shown, and what could not."""
    known = catalogue()
    shown = ", ".join(f"{name} {size:.2g} {known[name].parameter.unit}" for name, size in sizes.items() if np.isfinite(size))
    blind = ", ".join(name for name, size in sizes.items() if not np.isfinite(size))
    lines = [f"would have been named from: {shown}"] if shown else []
    return lines + ([f"not observable in this recording: {blind}"] if blind else [])


def _size(effect: Effect, columns: np.ndarray, sigmas: float) -> float:
    # The median: of a delay, what all axes have in common is the clock's and hardly shows, whatever the recording.
    strength = float(np.median(np.linalg.svd(columns * effect.parameter.plausible, compute_uv=False)))
    return sigmas / strength * effect.parameter.plausible / effect.parameter.si if strength > sigmas else float("inf")
