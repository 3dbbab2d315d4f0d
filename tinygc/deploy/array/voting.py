"""Which units of an array are believed: the bars, the numbers that a vote needs, and what it says.

Each unit's rate is held against the units' weighted median.  What is allowed is one sample's noise, the units' disagreement in the
calibration (bias, scale times rate, delay times the rate's change), and the median's own noise; d^2 over that variance, the greatest of
the axes, is a sample's ``u``.  Two means over ``MEMORY_S`` follow each unit: of d (an offset shows in it below the noise), and of u.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.array.fused.agreement import ends, fixed_variance, sample_variance, vote_weights
from tinygc.array.fused.model import ArrayModel
from tinygc.array.fused.weights import combined

#: s that a unit's past counts; a lie of 5 bars is found in about a tenth of it
MEMORY_S = 0.5
#: a sample farther than this from the median, in sigmas, is set aside at once (benchmarks/array_votes.py)
ASIDE = 6.0
#: sigmas of the mean difference, and the mean of u, from which on a unit is out (benchmarks/array_votes.py)
SLOW, FAST = 6.0, 9.0
#: share of both, squared sigmas, below which a unit agrees again, and s that it has to (benchmarks/array_votes.py)
BACK, HOLD_S = 0.5, 1.0
#: s without a sample, and of one and the same reading on all axes, after which a unit is dead or stuck
DEAD_S, STUCK_S = 0.1, 0.5
#: samples of one and the same reading after which a unit that differs is said to be stuck
SOON_STUCK = 4
#: of the median's variance to the mean's, many normal units
MEDIAN = np.pi / 2
#: fewer units cannot say which one of them lies
FEWEST = 3

#: why a unit is out
IN, DIFFERS, DEAD, STUCK = 0, 1, 2, 3
REASONS = {DIFFERS: "differs from the others", DEAD: "gives no samples", STUCK: "gives one and the same reading"}
BETWEEN_TWO = "two units differ: which one lies nobody can say"


@dataclass(frozen=True, eq=False)
class Tables:
    """What the vote needs of a model, SI: matrix (N, 3, 3) and offset (N, 3) take the measured rate to the array's frame; weights
    (N, 3, 3); share (N,) in the median; noise (N, 3) variance of a sample with the median's; fixed
    (N, 3) variance that stands: bias of the disagreement, bias instability, parameters; spread (N, 3, 3), what each unit adds to a
    sample's variance of the combination; own (3,) variance of the combination by its parameters at rest; end (N,); scale2,
    delay2 of the disagreement, the last over the squared period; alpha of the means; dead, stuck, hold in samples."""

    matrix: np.ndarray
    offset: np.ndarray
    weights: np.ndarray
    share: np.ndarray
    noise: np.ndarray
    fixed: np.ndarray
    spread: np.ndarray
    own: np.ndarray
    end: np.ndarray
    scale2: float
    delay2: float
    alpha: float
    dead: int
    stuck: int
    hold: int

    @classmethod
    def of(cls, model: ArrayModel) -> Tables:
        """Of a model."""
        rate, apart = model.rate_hz, model.disagreement
        own = model.parameter_sigma()
        white = model.density * rate / 2
        alone = np.stack([white[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(len(model))])
        spread = model.weights @ alone @ model.weights.transpose(0, 2, 1)
        # what correlation adds to the whole is laid on all units alike
        spread *= np.trace(combined(model.weights, white)) / np.trace(spread.sum(axis=0))
        noise = sample_variance(model)
        return cls(
            model.matrices,
            model.offsets,
            model.weights,
            vote_weights(model),
            noise + MEDIAN * np.diag(spread.sum(axis=0)),
            fixed_variance(model),
            spread,
            np.zeros(3) if own is None else np.square(own),
            ends(model),
            apart.scale**2,
            (apart.delay_s * rate) ** 2,
            min(1 / (MEMORY_S * rate), 1 / 16),
            max(round(DEAD_S * rate), 2),
            max(round(STUCK_S * rate), 4),
            max(round(HOLD_S * rate), 4),
        )

    @property
    def share_of_noise(self) -> float:
        """The variance of a mean of white noise, by that of a sample."""
        return self.alpha / (2 - self.alpha)


@dataclass(frozen=True)
class Event:
    """sample (from 0) after which a unit (its number; None where two disagree and neither is known to lie) is ``out``, ``in`` again, or
    units ``disagree`` or ``agree`` again; reason; size and bar, rad/s, of what differs, NaN of others."""

    sample: int
    unit: int | None
    what: str
    reason: str = ""
    size_rps: float = float("nan")
    bar_rps: float = float("nan")
