"""Noise terms of rest logs and stills together, by likelihood."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.annexes.noise.summary import RestSums
from tinygc.noise.figures import NoiseFigures

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class AllanBand:
    """Allan deviation of one sensor: tau_s (K,); deviation, low, high (K, 3) SI, with 68 % bounds; NaN where an axis has none."""

    tau_s: np.ndarray
    deviation: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class NoiseEstimate:
    """figures; allan: of ``gyro`` and ``accel``, of the same data; said: what was left out or is to be known, one sentence each;
    left_out_s: time that is not used."""

    figures: NoiseFigures
    allan: dict[str, AllanBand]
    said: tuple[str, ...]
    left_out_s: float


def estimate_noise(sums: Sequence[RestSums], progress: Progress = lambda what, done, of: None) -> NoiseEstimate:
    """Estimate the terms of one unit from all its rest logs and stills."""
    raise NotImplementedError


def known_after_s(figures: NoiseFigures, kind: str, axis: int, name: str, relative: float = 0.2) -> float:
    """Duration of rest, s, after which a term (of its present size, or of its limit) is known to a relative sigma; inf where never."""
    raise NotImplementedError
