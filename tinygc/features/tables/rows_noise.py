"""Noise of the rows that compare a sensor with its table: what is known beforehand, and what the recording itself says.

Rest and turn rows have one covariance, whose sizes are estimated by restricted likelihood (``tinygc.inference.noise``):

    white noise of gyroscope and accelerometer, as measured in the stills                                        known
    wander of the gyroscope's zero (bias instability)                                                            estimated about a prior
    repeatability of the table, at each rest anew, in units of the accuracy that each axis declares              estimated
    accelerometer at each rest, gyroscope in each turn: whatever no model has                                    estimated

Rows within a turn have their own: the walk of the angle between its two ends, which are pinned; and the machine's word, by its resolution,
by what is lost between two answers (which grows with the acceleration), and by its stamps, whose error is an angle that grows with the
rate.  Stamps have a jitter, new with each answer and shared by the edges between two answers as their interpolation shares it; and they
wander within a turn, with a correlation that falls by e in some time: a computer's load, and the clock of its board, change slowly.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from tinygc.features.tables.rows import Comparison
from tinygc.inference.noise import ComponentEstimate, Prior, estimate, wander_covariance

WANDER, REPEATABILITY, AT_REST, IN_TURN = "bias wander", "repeatability", "accelerometer at rest", "gyroscope in a turn"
#: spread (ln) of the bias instability about what is known of it
WANDER_SPREAD = 0.7
#: g: usual error of an accelerometer from rest to rest
USUAL_AT_REST_G = 1e-4
#: a table or a gyroscope that scatters by more than so many times what is declared of it has an error; so has an accelerometer that
#: scatters by more than that from rest to rest, g
MOST_OF_DECLARED, MOST_AT_REST_G = 3.0, 1e-3
#: where the search begins: the word's jitter, s, resolution, rad, blur, s^2, wander of its stamps, s, and time of that wander, s
USUAL_WORD = (2e-3, 1e-5, 1e-5, 3e-4, 0.5)
#: bounds of all five: a motor's play and a filter shape the begin of a turn by some tenths of a millisecond, which no column has;
#: the least resolution is that of a few digits of table.csv
WORD_BOUNDS = np.array([[3e-4, 0.1], [1e-6, 0.02], [1e-7, 0.01], [1e-5, 0.1], [0.05, 30.0]])


@dataclass(frozen=True, eq=False)
class RowsNoise:
    """Sizes by name (SI; repeatability in units of the declared accuracy), and factors that whiten stacked rows.

    word (5,): of the machine's word, as ``USUAL_WORD``; value: -2 log of the restricted likelihood of the rows at
    rest and of turns.
    """

    sizes: dict[str, float]
    value: float
    word: np.ndarray
    _outer: np.ndarray = field(repr=False)
    _within: list[np.ndarray] = field(repr=False)

    def whiten(self, rows: np.ndarray) -> np.ndarray:
        """Rows (n, …) in units of their noise, independent of one another."""
        count = len(self._outer)
        parts, start = [solve_triangular(self._outer, rows[:count], lower=True)], count
        for factor in self._within:
            parts.append(solve_triangular(factor, rows[start : start + len(factor)], lower=True))
            start += len(factor)
        return np.concatenate(parts)


class NoiseModel:
    """Covariances of one comparison, without their sizes."""

    def __init__(self, comparison: Comparison):
        seen = comparison.observed
        self._comparison = comparison
        rest, turn = 3 * len(seen.said), 3 * len(seen.first)
        self.outer = rest + turn + rest
        white = np.zeros((self.outer, self.outer))
        np.fill_diagonal(white[:rest, :rest], (seen.accel_walk[None] ** 2 / seen.rest_span_s[:, None]).ravel())
        np.fill_diagonal(white[rest + turn :, rest + turn :], (seen.gyro_walk[None] ** 2 / seen.rest_span_s[:, None]).ravel())
        per_block = np.where(seen.inside, 1 / seen.block_s[:, None], 0.0)
        walked = np.einsum("sbij,j,sb,sbkj->sik", comparison.to_end, seen.gyro_walk**2, per_block, comparison.to_end)
        for number, each in enumerate(walked):
            here = slice(rest + 3 * number, rest + 3 * number + 3)
            white[here, here] = each
        self.white = white
        declared = np.array([axis.sigma_rad for axis in seen.table.axes])
        scattered = np.zeros((len(seen.said), len(declared), len(seen.said) * len(declared)))
        for number in range(len(seen.said)):
            for axis, sigma in enumerate(declared):
                scattered[number, axis, number * len(declared) + axis] = sigma
        scattered = comparison.of_angles(scattered).stacked()[: self.outer]
        rests, turns = np.zeros(self.outer), np.zeros(self.outer)
        rests[:rest], turns[rest : rest + turn] = 1.0, 1.0
        usual_turn = float(np.sqrt(np.median(np.diag(white)[rest : rest + turn])))
        self.components = {
            WANDER: (self._wander(rest, turn), max(seen.instability_rps, 1e-9), Prior(max(seen.instability_rps, 1e-9), WANDER_SPREAD)),
            REPEATABILITY: (scattered @ scattered.T, 1.0, None),
            AT_REST: (np.diag(rests), USUAL_AT_REST_G, None),
            IN_TURN: (np.diag(turns), usual_turn, None),
        }
        self._within = self._parts_within()

    def _wander(self, rest: int, turn: int) -> np.ndarray:
        comparison, seen = self._comparison, self._comparison.observed
        at = np.concatenate([seen.turn_s, seen.rest_s])
        span = np.concatenate([seen.blocks * seen.block_s, seen.rest_span_s])
        wander = wander_covariance(at, span, instability_rps=1.0)
        response = np.zeros((self.outer, 3, len(at)))
        whole = comparison.to_end.sum(axis=1)
        for number, each in enumerate(whole):
            response[rest + 3 * number : rest + 3 * number + 3, :, number] = each
        for number in range(len(seen.rest_s)):
            here = slice(rest + turn + 3 * number, rest + turn + 3 * number + 3)
            response[here, :, len(seen.turn_s) + number] = np.eye(3)
        return np.einsum("nit,tu,miu->nm", response, wander, response, optimize=True)

    def _parts_within(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Of each turn that has rows within: covariance of the pinned walk (W, W) rad^2; rates (W,) rad/s; accelerations (W,) rad/s^2;
        covariance (W, W) rad^2/s^2 of the word for stamps of 1 s; and the time between the edges (W, W) s."""
        comparison, seen = self._comparison, self._comparison.observed
        found = []
        rate = np.gradient(comparison.said_way, axis=1) / seen.block_s[:, None]
        # Where an axis starts or stops within a block, the word between two answers is off by as much as at its neighbours.
        values = np.abs(np.gradient(rate, axis=1)) / seen.block_s[:, None]
        padded = np.pad(values, ((0, 0), (1, 1)), mode="edge")
        change = np.maximum(values, np.maximum(padded[:, :-2], padded[:, 2:]))
        for number, inner in enumerate(comparison.inner):
            if not inner.any():
                continue
            edges = np.flatnonzero(inner) + 1
            share = comparison.share[number]
            time = np.minimum(np.arange(len(share)), seen.blocks[number]) * seen.block_s[number]
            walk = np.minimum(time[:, None], time)
            pin = np.eye(len(share))[edges] - share[edges, None] * np.eye(len(share))[-1]
            variance = float((comparison.axis[number] ** 2) @ seen.gyro_walk**2)
            at = seen.answer_at[number]
            taken = _of_answers(at[edges])
            taken = taken * np.interp(np.arange(taken.shape[1]), at, rate[number])
            apart_s = np.abs(time[edges, None] - time[edges])
            found.append((variance * pin @ walk @ pin.T, rate[number, edges], change[number, edges], taken @ taken.T, apart_s))
        return found

    def estimated(self, r: np.ndarray, J: np.ndarray) -> RowsNoise:
        """Sizes from residuals r (n,) and columns J (n, p) of everything fitted, in units of their priors' sigmas."""
        found = self._sizes(r, J)
        C = self.white + sum((s**2 * v for s, (v, _, _) in zip(found.s, self.components.values(), strict=True)), np.zeros_like(self.white))
        sizes, outer = dict(zip(self.components, found.s.tolist(), strict=True)), np.linalg.cholesky(C)
        x = np.log(USUAL_WORD)
        for _ in range(2 if self._within else 0):  # what the columns take up depends little on the noise of the word
            noise = RowsNoise(sizes, found.value, np.exp(x), outer, self._factors(x))
            white = np.concatenate([noise.whiten(np.column_stack([J, r])), np.eye(J.shape[1] + 1)[:-1]])
            left = r - J @ np.linalg.lstsq(white[:, :-1], white[:, -1], rcond=None)[0]
            x = self._word(left[self.outer :], x)
        return RowsNoise(sizes, found.value, np.exp(x), outer, self._factors(x))

    def _sizes(self, r: np.ndarray, J: np.ndarray) -> ComponentEstimate:
        V, usual, priors = zip(*self.components.values(), strict=True)
        rows = np.arange(self.outer)
        return estimate(r[: self.outer], J[: self.outer], self.white, list(V), np.array(usual), list(priors), [rows], steps=30)

    def excess(self, noise: RowsNoise) -> dict[str, float]:
        """Sizes that are beyond what sensor and table declare, by name, in units of the largest that is not."""
        declared = max(axis.sigma_rad for axis in self._comparison.observed.table.axes)
        most = {
            REPEATABILITY: MOST_OF_DECLARED,
            AT_REST: MOST_AT_REST_G,
            IN_TURN: MOST_OF_DECLARED * float(np.hypot(self.components[IN_TURN][1], np.sqrt(2) * declared)),
        }
        found = {name: noise.sizes[name] / limit for name, limit in most.items()}
        return {name: ratio for name, ratio in found.items() if ratio > 1}

    def value_of(self, r: np.ndarray, J: np.ndarray) -> float:
        """-2 log of the restricted likelihood, as ``RowsNoise.value``, with other columns."""
        return self._sizes(r, J).value

    def known_alone(self, noise: RowsNoise) -> RowsNoise:
        """The same without what was estimated of the table, the accelerometer and single turns."""
        V, _, _ = self.components[WANDER]
        return replace(noise, _outer=np.linalg.cholesky(self.white + noise.sizes[WANDER] ** 2 * V))

    def _factors(self, x: np.ndarray) -> list[np.ndarray]:
        jitter_s, resolution_rad, blur_s2, wander_s, time_s = np.exp(x)
        return [
            np.linalg.cholesky(
                walk
                + jitter_s**2 * jittered
                + wander_s**2 * np.outer(rate, rate) * np.exp(-apart_s / time_s)
                + np.diag((blur_s2 * change) ** 2 + resolution_rad**2)
            )
            for walk, rate, change, jittered, apart_s in self._within
        ]

    def _word(self, left: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Logarithms of the sizes of the machine's word: greatest likelihood of what is left."""
        edges = np.cumsum([0, *(len(rate) for _, rate, *_ in self._within)])

        def cost(x: np.ndarray) -> float:
            total = 0.0
            for factor, start, stop in zip(self._factors(x), edges, edges[1:], strict=False):
                white = solve_triangular(factor, left[start:stop], lower=True)
                total += 2 * float(np.log(np.diag(factor)).sum()) + float(white @ white)
            return total

        found: np.ndarray = minimize(cost, x, method="L-BFGS-B", bounds=np.log(WORD_BOUNDS), options={"maxiter": 15, "ftol": 1e-7}).x
        return found


def _of_answers(answer_at: np.ndarray) -> np.ndarray:
    """(W, N): what each answer has in the word at the edges (W,), by their places among the answers: cubic convolution (Keys 1981), which
    Akima's interpolation is where the rate changes little."""
    d = np.abs(answer_at[:, None] - np.arange(int(answer_at.max()) + 3))
    return np.where(d < 1, (1.5 * d - 2.5) * d**2 + 1, np.where(d < 2, ((2.5 - 0.5 * d) * d - 4) * d + 2, 0.0))
