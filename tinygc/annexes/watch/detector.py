"""The detector, in integers and float32: the same operations in the same order as the C of ``embedded``, bit for bit.

    sample    rate, force and temperature become integers; a block of 0.125 s sums them and their squares
    block     quiet where its scatter, its rate and the length of its force are those of a rest: comparisons of integers
    window    16 quiet blocks, but the first and the last of a rest: the means are one reading of the zero and of gravity
    filters   Kalman filters of ``expectation``'s states; their innovations are independent while the calibration holds
    tests     CUSUMs of the innovations (``bars``), for both signs and five sizes, on three axes and on gravity

Arrays have a last axis of independent copies (one in use, many in simulations).  Sums run from the first index to the last.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tinygc.annexes.watch.expectation import MOST_TEMPERATURE_C
from tinygc.annexes.watch.settings import (
    BLOCKS,
    CHANNELS,
    CLIP,
    MOST_FORCE_MPS2,
    MOST_GAP,
    MOST_RATE_RPS,
    MOST_SCATTER,
    NOISE_WINDOWS,
    ROOT_STEPS,
    SHIFTS,
    TEMPERATURE_BITS,
    TIMES_S,
    Settings,
)

#: states of one axis: offset with its walk, Gauss-Markov processes, attitude, coefficient of temperature
PROCESSES = len(TIMES_S)
ATTITUDE, COEFFICIENT, STATES = 1 + PROCESSES, 2 + PROCESSES, 3 + PROCESSES
#: states of gravity: the accelerometer's zero with its walk, Gauss-Markov processes, attitude, coefficient
GRAVITY_ATTITUDE, GRAVITY_COEFFICIENT, GRAVITY_STATES = 3 + PROCESSES, 4 + PROCESSES, 5 + PROCESSES
#: adding this rounds a float32 to the nearest integer, which is then exact
MAGIC, MAGIC_INTEGER = np.float32(12582912.0), 12582912
ONE, HALF, CLIPPED = np.float32(1), np.float32(0.5), np.float32(CLIP)
#: states of the rest detector
MOVING, SETTLING, RESTING = 0, 1, 2


def triangle(states: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row and column of each element of a lower triangle, row by row, and the element (i, j) of the whole matrix."""
    row, column = np.tril_indices(states)
    whole = np.zeros((states, states), dtype=int)
    whole[row, column] = whole[column, row] = np.arange(len(row))
    return row, column, whole


ROW, COLUMN, WHOLE = triangle(STATES)
G_ROW, G_COLUMN, G_WHOLE = triangle(GRAVITY_STATES)


def root(value: np.ndarray) -> np.ndarray:
    """Heron's square root of a float32 of at least 1, of a fixed number of steps."""
    found = HALF * (ONE + value)
    for _ in range(ROOT_STEPS):
        found = HALF * (found + value / found)
    return found


def summed(products: np.ndarray) -> np.ndarray:
    """Sum over the first axis, one after the other."""
    total = products[0]
    for each in products[1:]:
        total = total + each
    return total


@dataclass(frozen=True, eq=False)
class Window:
    """A reading of the zero, or several side by side: rate (3, S) and gravity (S,), normalised; direction (3, S) of the force, in g; warmer
    (S,) K than the reference; scatter (2, S): of the blocks over the stated, of rate and of force."""

    rate: np.ndarray
    gravity: np.ndarray
    direction: np.ndarray
    warmer: np.ndarray
    scatter: np.ndarray


@dataclass(frozen=True, eq=False)
class Judged:
    """What one window gave: z (4, S), innovations in sigmas, of three axes and of gravity, as they count; whole (4, S): as
    they are; sigma (2, S): of the innovations of an axis and
    of gravity, normalised; gain (5, S); alarm (4, S): +1 or -1 where a test has passed its bar; taken (S,): whether it changed the zero;
    shift (4, S): number of the test in ``SHIFTS``."""

    z: np.ndarray
    whole: np.ndarray
    sigma: np.ndarray
    gain: np.ndarray
    alarm: np.ndarray
    taken: np.ndarray
    shift: np.ndarray


class ZeroFilter:
    """The filters and tests of S independent streams, all float32.

    P (15, S) covariance of one axis' states, row by row of the lower triangle, x (5, 3, S); gravity_P (28, S), gravity_x (7, S);
    own (S,): variance of gravity's length from attitude to attitude; noise (2, S): scatter of rate and force over the stated, averaged;
    cusum (4, 2, 4, S): of each channel, for a rise and for a fall.
    """

    def __init__(self, chosen: Settings, copies: int = 1):
        self.chosen = c = chosen
        self.P = np.zeros((len(ROW), copies), np.float32)
        self.P[WHOLE[0, 0]], self.P[WHOLE[ATTITUDE, ATTITUDE]] = c.offset, c.attitude
        self.P[WHOLE[COEFFICIENT, COEFFICIENT]] = c.per_k
        self.x = np.zeros((STATES, 3, copies), np.float32)
        self.gravity_P = np.zeros((len(G_ROW), copies), np.float32)
        for i in range(3):
            self.gravity_P[G_WHOLE[i, i]] = c.accel_offset
        self.own = np.full(copies, c.accel_attitude, np.float32)
        self._begin_gravity()
        self.gravity_x = np.zeros((GRAVITY_STATES, copies), np.float32)
        self.noise = np.ones((2, copies), np.float32)
        self.cusum = np.zeros((len(CHANNELS), 2, len(SHIFTS), copies), np.float32)
        self._decay, self._gravity_decay = np.ones(STATES, np.float32), np.ones(GRAVITY_STATES, np.float32)
        self._decay[1:ATTITUDE] = self._gravity_decay[3:GRAVITY_ATTITUDE] = c.decay
        self._coefficient = np.ones((STATES, copies), np.float32)

    def predict(self) -> None:
        """One window of time passes."""
        c, decay, of_gravity = self.chosen, self._decay, self._gravity_decay
        self.x = self.x * decay[:, None, None]
        self.gravity_x = self.gravity_x * of_gravity[:, None]
        self.P = (self.P * decay[ROW][:, None]) * decay[COLUMN][:, None]
        self.gravity_P = (self.gravity_P * of_gravity[G_ROW][:, None]) * of_gravity[G_COLUMN][:, None]
        self.P[0] = self.P[0] + c.walk
        for i in range(3):
            at = G_WHOLE[i, i]
            self.gravity_P[at] = self.gravity_P[at] + c.accel_walk
        for k in range(PROCESSES):
            at, at_gravity = WHOLE[1 + k, 1 + k], G_WHOLE[3 + k, 3 + k]
            self.P[at] = self.P[at] + c.drive[k]
            self.gravity_P[at_gravity] = self.gravity_P[at_gravity] + c.accel_drive[k]

    def new_rest(self) -> None:
        """The sensor may lie in another attitude now."""
        c = self.chosen
        self.x[ATTITUDE] = 0
        self.P[WHOLE[ATTITUDE]] = 0
        self.P[WHOLE[ATTITUDE, ATTITUDE]] = c.attitude
        self.gravity_x[GRAVITY_ATTITUDE:] = 0
        self.gravity_P[G_WHOLE[GRAVITY_ATTITUDE:]] = 0
        self._begin_gravity()

    def _begin_gravity(self) -> None:
        """Variances of what gravity's length has of its own in each rest."""
        self.gravity_P[G_WHOLE[GRAVITY_ATTITUDE, GRAVITY_ATTITUDE]] = self.own
        self.gravity_P[G_WHOLE[GRAVITY_COEFFICIENT, GRAVITY_COEFFICIENT]] = self.chosen.accel_per_k

    def judge(self, window: Window) -> Judged:
        """Take one reading: test it, then let the filters follow it."""
        ratio = window.scatter
        self.noise = self.noise + (ratio - self.noise) * np.float32(1 / NOISE_WINDOWS)
        wide = np.where(self.noise > ONE, self.noise, ONE)
        wide = np.where(ratio > wide + wide, ratio, wide)
        h = self._coefficient
        h[COEFFICIENT] = window.warmer
        hg = np.concatenate([window.direction, np.ones((1 + PROCESSES, len(window.warmer)), np.float32), window.warmer[None]])
        Ph, S = _project(self.P[WHOLE], h, wide[0])
        Phg, Sg = _project(self.gravity_P[G_WHOLE], hg, wide[1])
        gain, gain_g = Ph / S, Phg / Sg
        innovation = window.rate - summed(h[:, None] * self.x)
        innovation_g = window.gravity - summed(hg * self.gravity_x)
        sigma = np.stack([root(S), root(Sg)])
        whole = np.concatenate([innovation / sigma[0], (innovation_g / sigma[1])[None]])
        z = np.where(whole > CLIPPED, CLIPPED, np.where(whole < -CLIPPED, -CLIPPED, whole))
        far = (z >= CLIPPED) | (z <= -CLIPPED)
        alarm, number = self._test(z)
        zero_alarm, gravity_alarm = (alarm[:3] != 0).any(axis=0), alarm[3] != 0
        follow, follow_g = ~zero_alarm & ~far[:3].any(axis=0), ~gravity_alarm & ~far[3]
        P = _updated(self.P, self.P[WHOLE], Ph, gain, h, wide[0], ROW, COLUMN)
        gravity_P = _updated(self.gravity_P, self.gravity_P[G_WHOLE], Phg, gain_g, hg, wide[1], G_ROW, G_COLUMN)
        self.P = np.where(follow, P, self.P)
        self.x = np.where(follow, self.x + gain[:, None] * innovation, self.x)
        self.gravity_P = np.where(follow_g, gravity_P, self.gravity_P)
        self.gravity_x = np.where(follow_g, self.gravity_x + gain_g * innovation_g, self.gravity_x)
        # After an alarm the present reading is the new state.
        self.x[0] = np.where(zero_alarm, self.x[0] + innovation, self.x[0])
        self.P[0] = np.where(zero_alarm, self.P[0] + S, self.P[0])
        # Of gravity it is that of this attitude; in others it may differ by as much.
        at = G_WHOLE[GRAVITY_ATTITUDE, GRAVITY_ATTITUDE]
        self.gravity_P[at] = np.where(gravity_alarm, self.gravity_P[at] + Sg, self.gravity_P[at])
        here, change = self.gravity_x[GRAVITY_ATTITUDE], innovation_g * innovation_g
        self.gravity_x[GRAVITY_ATTITUDE] = np.where(gravity_alarm, here + innovation_g, here)
        self.own = np.where(gravity_alarm & (change > self.own), change, self.own)
        self.cusum[:3] = np.where(zero_alarm, np.float32(0), self.cusum[:3])
        self.cusum[3] = np.where(gravity_alarm, np.float32(0), self.cusum[3])
        return Judged(z, whole, sigma, gain, alarm, follow, number)

    def _test(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Let the CUSUMs of all channels follow z (4, S): sign of an alarm (4, S), or 0, and the shift of its test."""
        c = self.chosen
        step = c.shift[None, :, None] * z[:, None]
        both = np.stack([self.cusum[:, 0] + step, self.cusum[:, 1] - step], axis=1) - c.half[None, None, :, None]
        self.cusum = np.where(both > 0, both, np.float32(0))
        over = self.cusum >= c.bar[None, None, :, None]
        rise, fall = over[:, 0].any(axis=1), over[:, 1].any(axis=1)
        return np.where(rise, 1, np.where(fall, -1, 0)), np.argmax(over.any(axis=1), axis=1)

    @property
    def lasting(self) -> tuple[np.ndarray, np.ndarray]:
        """(3, S) zero without what the attitude of this rest adds, and its variance (S,) on each axis; normalised."""
        among = WHOLE[:ATTITUDE, :ATTITUDE].ravel()
        return summed(self.x[:ATTITUDE]), np.maximum(self.P[among].sum(axis=0), 0)

    @property
    def zero(self) -> np.ndarray:
        """(3, S) normalised: zero of the present rest without the coefficient's part."""
        return summed(self.x[:COEFFICIENT])


def _project(P: np.ndarray, h: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """P h (n, S) and h P h + noise (S,), of a covariance (n, n, S)."""
    Ph = summed(np.swapaxes(P, 0, 1) * h[:, None])
    return Ph, summed(h * Ph) + noise


def _updated(
    P: np.ndarray,
    whole: np.ndarray,
    Ph: np.ndarray,
    gain: np.ndarray,
    h: np.ndarray,
    noise: np.ndarray,
    row: np.ndarray,
    column: np.ndarray,
) -> np.ndarray:
    """The covariance after a reading, in Joseph's form: M = P - K (P h)', P = M - (M h) K' + noise K K'."""
    M = whole - gain[:, None] * Ph[None]
    Mh = summed(np.swapaxes(M, 0, 1) * h[:, None])
    return (M[row, column] - Mh[row] * gain[column]) + (noise * gain[row]) * gain[column]


#: number of its last sample in the stream, whether it was quiet, the window that it has completed, and what that gave
Block = tuple[int, bool, Window | None, Judged | None]


class Detector:
    """One stream: samples in, judged windows out."""

    def __init__(self, chosen: Settings):
        self.chosen, self.filter = chosen, ZeroFilter(chosen)
        self._left = np.zeros((0, 8), np.int64)  # samples of the block that is not complete
        self.state, self.blocks, self.ticks, self.waiting = MOVING, 0, 0, False
        self._reset_window()
        self.position = 0  # samples so far

    def _reset_window(self) -> None:
        self.blocks = 0
        self.sums, self.temperature, self.squares = np.zeros(6, np.int64), 0, np.zeros(2, np.int64)

    def integers(self, rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray | None) -> np.ndarray:
        """(N, 8) of float32 rate (N, 3), force (N, 3), temp_c (N,): six readings, the temperature, whether the sample can be of a rest."""
        c = self.chosen
        values = np.concatenate([rate, force], axis=1, dtype=np.float32)
        limit = np.repeat(np.array([MOST_RATE_RPS, MOST_FORCE_MPS2], np.float32), 3)
        good = np.all((values > -limit) & (values < limit), axis=1)
        scale = np.repeat(np.array([c.rate_scale, c.force_scale], np.float32), 3)
        whole = (np.where(good[:, None], values, np.float32(0)) * scale + MAGIC).astype(np.int64) - MAGIC_INTEGER
        whole[~good] = 0
        warm = np.full(len(rate), c.reference, np.float32) if temp_c is None else np.asarray(temp_c, np.float32)
        most = np.float32(MOST_TEMPERATURE_C)
        warm = np.where((warm > -most) & (warm < most), warm, c.reference)
        celsius = (warm * np.float32(2**TEMPERATURE_BITS) + MAGIC).astype(np.int64) - MAGIC_INTEGER
        return np.column_stack([whole, celsius, good])

    def feed(self, rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray | None = None) -> Iterator[Block]:
        """Take samples: calibrated rate (N, 3) rad/s, force (N, 3) m/s^2, temp_c (N,).

        Yields after each block.
        """
        n = self.chosen.samples
        rows = np.concatenate([self._left, self.integers(rate, force, temp_c)])
        count = len(rows) // n
        self._left = rows[count * n :]
        blocks = rows[: count * n].reshape(count, n, 8)
        sums = blocks.sum(axis=1)
        squares = np.stack([(blocks[:, :, part] ** 2).sum(axis=(1, 2)) for part in (slice(0, 3), slice(3, 6))], axis=1)
        quiet: list[bool] = self._quiet(sums, squares).tolist()
        for each, is_quiet in zip(sums, quiet, strict=True):
            self.position += n
            yield self.position, is_quiet, *self._block(each, is_quiet)

    def _quiet(self, sums: np.ndarray, squares: np.ndarray) -> np.ndarray:
        """(B,) whether blocks can be of a rest, from their sums (B, 8) and sums of squares (B, 2)."""
        c, n = self.chosen, self.chosen.samples
        own = np.stack([(sums[:, part] ** 2).sum(axis=1) for part in (slice(0, 3), slice(3, 6))], axis=1)
        scatter = n * squares - own
        still = (sums[:, 7] == n) & (np.abs(sums[:, :3]) < c.rate_limit).all(axis=1)
        quiet = still & (scatter[:, 0] < c.gyro_limit) & (scatter[:, 1] < c.accel_limit)
        return quiet & (own[:, 1] > c.gravity_low) & (own[:, 1] < c.gravity_high)

    def _block(self, sums: np.ndarray, is_quiet: bool) -> tuple[Window | None, Judged | None]:
        found: tuple[Window | None, Judged | None] = (None, None)
        self.ticks += 1
        if self.ticks == BLOCKS:
            self.ticks = 0
            self.filter.predict()
        if not is_quiet:
            self.state = MOVING
            self._reset_window()
            return found
        if self.state == MOVING:
            self.state, self.waiting = SETTLING, True
            self._reset_window()
            return found
        if self.blocks == BLOCKS:  # this block shows that the last of them was not the end of the rest
            found = self._window()
            self._reset_window()
        self.state = RESTING
        self.sums += sums[:6]
        self.temperature += int(sums[6])
        for k, part in enumerate((slice(0, 3), slice(3, 6))):
            self.squares[k] += int((sums[part] ** 2).sum())
        self.blocks += 1
        return found

    def _window(self) -> tuple[Window | None, Judged | None]:
        c, sums = self.chosen, self.sums
        own = np.array([(sums[part] ** 2).sum() for part in (slice(0, 3), slice(3, 6))])
        scatter = (BLOCKS * self.squares - own).astype(np.float32) * np.array([c.gyro_scatter, c.accel_scatter])
        most = np.float32(MOST_SCATTER)
        if scatter[0] > most or scatter[1] > most:
            return None, None
        direction = sums[3:, None].astype(np.float32) * c.force_unit
        length = summed(direction * direction)
        rate = sums[:3, None].astype(np.float32) * c.rate_unit[:, None] - direction * c.earth[:, None]
        warmer = np.array([self.temperature], np.float32) * c.temperature_unit - c.reference
        window = Window(rate, (length - ONE) * c.gravity_unit, direction, warmer, scatter[:, None])
        if self.waiting:
            self.waiting = False
            self.filter.new_rest()
        return window, self.filter.judge(window)

    def gap(self, samples: int) -> None:
        """Samples are missing: the rest, if it was one, has ended, and time has passed."""
        self._left = self._left[:0]
        self.state = MOVING
        self._reset_window()
        self.position += samples
        self.ticks += min(samples // self.chosen.samples, MOST_GAP)
        while self.ticks >= BLOCKS:
            self.ticks -= BLOCKS
            self.filter.predict()
