"""Noise of the rows that compare a sensor with its table: what is known beforehand, and what the recording itself shows.

All of it is variance components, whose sizes are estimated together by restricted likelihood (``tinygc.inference.noise``).  Rest and turn
rows have one covariance:

    white noise of gyroscope and accelerometer, as measured in the stills                                        known
    wander of the gyroscope's zero (bias instability)                                                            estimated about a prior
    repeatability of the table, newly at each rest, in units of the accuracy that each axis declares              estimated
    accelerometer at each rest, gyroscope in each turn: whatever no model has                                    estimated

Rows within a turn have their own: the walk of the angle between its two ends, which are pinned; and the machine's word, by its resolution,
by what is lost between two answers (which grows with the acceleration), and by its stamps, whose error is an angle that grows with the
rate.  Stamps have a jitter, new with each answer and shared by the edges between two answers as their interpolation shares it; and they
wander within a turn, fast and slowly: a computer's load, and the clock of its board, change.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_triangular

from session.base.rotation import identities
from tinygc.features.tables.rows import Comparison, cubic_weights
from tinygc.inference.noise import Prior, estimate_parts, wander_covariance

WANDER, REPEATABILITY, AT_REST, IN_TURN = "bias wander", "repeatability", "accelerometer at rest", "gyroscope in a turn"
#: of the machine's word, with where the search begins: s, rad, s^2; the wander of its stamps has two times, s
JITTER, RESOLUTION, BLUR = "jitter of stamps", "resolution of the word", "blur of the word"
USUAL_WORD = {JITTER: 2e-3, RESOLUTION: 1e-5, BLUR: 1e-5}
STAMPS_S, USUAL_STAMPS_S = (0.3, 5.0), 3e-4
#: the least of the word's noise: a motor's play and a filter shape the begin of a turn by some tenths of a millisecond, which no column
#: has; the least resolution is that of a few digits of table.csv
LEAST_WORD = {JITTER: 3e-4, RESOLUTION: 1e-6}
#: spread (ln) of the bias instability about what is known of it
WANDER_SPREAD = 0.7
#: g: usual error of an accelerometer from rest to rest
USUAL_AT_REST_G = 1e-4
#: a table or a gyroscope that scatters by more than so many times what is declared of it has an error; so has an accelerometer that
#: scatters by more than that from rest to rest, g
MOST_OF_DECLARED, MOST_AT_REST_G = 3.0, 1e-3
#: greatest number of steps of the search
MOST_STEPS = 30


@dataclass(frozen=True, eq=False)
class RowsNoise:
    """Sizes by name (SI; repeatability in units of the declared accuracy; of the wander of stamps by its time), and the factors, one behind
    the other, that whiten stacked rows.  value: -2 log of the restricted likelihood."""

    sizes: dict[str | float, float]
    value: float
    _factors: list[np.ndarray] = field(repr=False)

    def whiten(self, rows: np.ndarray) -> np.ndarray:
        """Rows (n, …) in units of their noise, independent of one another."""
        ends = np.cumsum([len(factor) for factor in self._factors])
        parts = zip(self._factors, np.split(rows, ends[:-1]), strict=True)
        return np.concatenate([solve_triangular(factor, part, lower=True) for factor, part in parts])

    @property
    def stamps(self) -> tuple[float, float, float]:
        """Jitter and wander of the word's stamps, s, and the mean time of that wander, s."""
        variance = np.array([self.sizes[time_s] ** 2 for time_s in STAMPS_S])
        whole = float(variance.sum())
        return float(np.hypot(self.sizes[JITTER], LEAST_WORD[JITTER])), float(np.sqrt(whole)), float(variance @ STAMPS_S) / (whole or 1.0)


class NoiseModel:
    """Covariances of one comparison, without their sizes.

    usual: name -> usual size and prior; blocks: of all rows at rest and of turns, then of the rows within each turn that has any: the
    known covariance, and by name those of size one.
    """

    def __init__(self, comparison: Comparison):
        seen = comparison.observed
        self._comparison = comparison
        rest, turn = 3 * len(seen.reported), 3 * len(seen.first)
        self.outer = rest + turn + rest
        white = np.zeros((self.outer, self.outer))
        np.fill_diagonal(white[:rest, :rest], (seen.accel_walk[None] ** 2 / seen.rest_span_s[:, None]).ravel())
        np.fill_diagonal(white[rest + turn :, rest + turn :], (seen.gyro_walk[None] ** 2 / seen.rest_span_s[:, None]).ravel())
        per_block = np.where(seen.inside, 1 / seen.block_s[:, None], 0.0)
        walked = np.einsum("sbij,j,sb,sbkj->sik", comparison.to_end, seen.gyro_walk**2, per_block, comparison.to_end)
        turns = np.arange(len(walked))
        white[rest : rest + turn, rest : rest + turn].reshape(len(turns), 3, len(turns), 3)[turns, :, turns] = walked
        declared = np.array([axis.sigma_rad for axis in seen.table.axes])
        scattered = np.einsum("qr,kl,k->qkrl", np.eye(len(seen.reported)), np.eye(len(declared)), declared)
        scattered = comparison.of_angles(scattered.reshape(*seen.reported.shape, -1))[: self.outer]
        kind = np.repeat([0, 1, 2], [rest, turn, rest])
        wander = max(seen.instability_rps, 1e-9)
        self.usual: dict[str | float, tuple[float, Prior | None]] = {
            WANDER: (wander, Prior(wander, WANDER_SPREAD)),
            REPEATABILITY: (1.0, None),
            AT_REST: (USUAL_AT_REST_G, None),
            IN_TURN: (float(np.sqrt(np.median(np.diag(white)[kind == 1]))), None),
            **{name: (size, None) for name, size in USUAL_WORD.items()},
            **dict.fromkeys(STAMPS_S, (USUAL_STAMPS_S, None)),
        }
        outer: dict[str | float, np.ndarray] = {
            WANDER: self._wander(rest),
            REPEATABILITY: scattered @ scattered.T,
            AT_REST: np.diag((kind == 0).astype(float)),
            IN_TURN: np.diag((kind == 1).astype(float)),
        }
        self.blocks = [(white, outer), *self._within()]

    def _wander(self, rest: int) -> np.ndarray:
        comparison, seen = self._comparison, self._comparison.observed
        at = np.concatenate([seen.turn_s, seen.rest_s])
        span = np.concatenate([seen.blocks * seen.block_s, seen.rest_span_s])
        wander = wander_covariance(at, span, instability_rps=1.0)
        response = np.zeros((self.outer // 3, 3, 3, len(at)))
        numbers = np.arange(len(at))
        response[rest // 3 + numbers, :, :, numbers] = np.concatenate([comparison.to_end.sum(axis=1), identities(len(seen.rest_s))])
        flat = response.reshape(self.outer, 3, -1)
        return np.einsum("nit,tu,miu->nm", flat, wander, flat, optimize=True)

    def _within(self) -> list[tuple[np.ndarray, dict[str | float, np.ndarray]]]:
        """Of each turn that has rows within: covariance (W, W) rad^2 of the pinned walk and the least noise of the word, and by name those
        (W, W) of the word."""
        comparison, seen = self._comparison, self._comparison.observed
        found = []
        rate = np.gradient(comparison.reported_way, axis=1) / seen.block_s[:, None]
        # Where an axis starts or stops within a block, the word between two answers is off by as much as at its neighbours.
        values = np.abs(np.gradient(rate, axis=1)) / seen.block_s[:, None]
        padded = np.pad(values, ((0, 0), (1, 1)), mode="edge")
        change = np.maximum(values, np.maximum(padded[:, :-2], padded[:, 2:]))
        for number in np.flatnonzero(comparison.inner.any(axis=1)):
            edges = np.flatnonzero(comparison.inner[number]) + 1
            share = comparison.share[number]
            time = np.minimum(np.arange(len(share)), seen.blocks[number]) * seen.block_s[number]
            walk = np.minimum(time[:, None], time)
            pin = np.eye(len(share))[edges] - share[edges, None] * np.eye(len(share))[-1]
            variance = float((comparison.axis[number] ** 2) @ seen.gyro_walk**2)
            at = seen.answer_at[number]
            taken = cubic_weights(at[edges], int(at.max()) + 3)  # as Akima's interpolation has them where the rate changes little
            taken = taken * np.interp(np.arange(taken.shape[1]), at, rate[number])
            apart_s, squared = np.abs(time[edges, None] - time[edges]), np.outer(rate[number, edges], rate[number, edges])
            of: dict[str | float, np.ndarray] = {
                JITTER: taken @ taken.T,
                RESOLUTION: np.eye(len(edges)),
                BLUR: np.diag(change[number, edges] ** 2),
                **{time_s: squared * np.exp(-apart_s / time_s) for time_s in STAMPS_S},
            }
            least = (size**2 * of[name] for name, size in LEAST_WORD.items())
            found.append((variance * pin @ walk @ pin.T + sum(least, np.zeros_like(apart_s)), of))
        return found

    def estimated(self, r: np.ndarray, J: np.ndarray, before: RowsNoise | None = None) -> RowsNoise:
        """Sizes from residuals r (n,) and columns J (n, p) of everything fitted, in units of their priors' sigmas; before: an earlier
        estimate, where the search begins."""
        ends = np.cumsum([len(base) for base, _ in self.blocks])[:-1]
        parts = []
        for own, columns, (base, of) in zip(np.split(r, ends), np.split(J, ends), self.blocks, strict=True):
            nothing = np.zeros_like(base)
            parts.append((own, columns, base, [of[name] * size**2 if name in of else nothing for name, (size, _) in self.usual.items()]))
        usual, priors = zip(*self.usual.values(), strict=True)
        start = None if before is None else np.array(list(before.sizes.values()))
        found = estimate_parts(parts, np.array(usual), list(priors), start, steps=MOST_STEPS, most_searched=len(parts))
        return self.of_sizes(dict(zip(self.usual, found.s.tolist(), strict=True)), found.value)

    def of_sizes(self, sizes: dict[str | float, float], value: float = np.nan) -> RowsNoise:
        """The noise of these sizes."""
        covariances = (base + sum((sizes[name] ** 2 * V for name, V in of.items()), np.zeros_like(base)) for base, of in self.blocks)
        return RowsNoise(sizes, value, list(map(np.linalg.cholesky, covariances)))

    def known_alone(self, noise: RowsNoise) -> RowsNoise:
        """The same without what was estimated of the table, the accelerometer and single turns."""
        return self.of_sizes(noise.sizes | dict.fromkeys((REPEATABILITY, AT_REST, IN_TURN), 0.0))

    def excess(self, noise: RowsNoise) -> dict[str, float]:
        """Sizes that are beyond what sensor and table declare, by name, in units of the largest that is not."""
        declared = max(axis.sigma_rad for axis in self._comparison.observed.table.axes)
        most = {
            REPEATABILITY: MOST_OF_DECLARED,
            AT_REST: MOST_AT_REST_G,
            IN_TURN: MOST_OF_DECLARED * float(np.hypot(self.usual[IN_TURN][0], np.sqrt(2) * declared)),
        }
        found = {name: noise.sizes[name] / limit for name, limit in most.items()}
        return {name: ratio for name, ratio in found.items() if ratio > 1}
