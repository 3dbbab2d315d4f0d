"""The detector: blocks of samples become windows at rest, whose innovations are tested.

    block     0.125 s: quiet where its scatter, its rate and the length of its force are those of a rest
    window    16 quiet blocks, but the first and the last of a rest: the means are one reading of the zero and of gravity
    filters   Kalman filters of ``expectation``'s states; their innovations are independent while the calibration holds
    tests     CUSUMs of the innovations (``bars``), for both signs and five sizes, on three axes and on gravity

Arrays have a last axis of independent copies (one in use, many in simulations).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tinygc.features.unit.watch.expectation import (
    BLOCKS,
    CHANNELS,
    CLIP,
    FORCE_WITHIN,
    MOST_GAP,
    MOST_SCATTER,
    MOST_TEMPERATURE_C,
    NOISE_WINDOWS,
    REST_RATE_RPS,
    SHIFTS,
    TIMES_S,
    Settings,
)

#: states of one axis: offset with its walk, Gauss-Markov processes, attitude, coefficient of temperature
PROCESSES = len(TIMES_S)
ATTITUDE, COEFFICIENT, STATES = 1 + PROCESSES, 2 + PROCESSES, 3 + PROCESSES
#: states of gravity: the accelerometer's zero with its walk, Gauss-Markov processes, attitude, coefficient
GRAVITY_ATTITUDE, GRAVITY_COEFFICIENT, GRAVITY_STATES = 3 + PROCESSES, 4 + PROCESSES, 5 + PROCESSES
#: states of the rest detector
MOVING, SETTLING, RESTING = 0, 1, 2


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
    """What one window gave.

    z (4, S): innovations in sigmas, of three axes and of gravity, as they count; whole (4, S): as they are; sigma (2, S): of the
    innovations of an axis and of gravity, normalised; gain (5, S); alarm (4, S): +1 or -1 where a test has passed its bar; taken (S,):
    whether it changed the zero; shift (4, S): number of the test in ``SHIFTS``.
    """

    z: np.ndarray
    whole: np.ndarray
    sigma: np.ndarray
    gain: np.ndarray
    alarm: np.ndarray
    taken: np.ndarray
    shift: np.ndarray


class ZeroFilter:
    """The filters and tests of S independent streams.

    P (5, 5, S) covariance of one axis' states, x (5, 3, S); gravity_P (7, 7, S), gravity_x (7, S);
    own (S,): variance of gravity's length from attitude to attitude; noise (2, S): scatter of rate and force over the stated, averaged;
    cusum (4, 2, 4, S): of each channel, for a rise and for a fall.
    """

    def __init__(self, chosen: Settings, copies: int = 1):
        self.chosen = c = chosen
        self.P = np.zeros((STATES, STATES, copies))
        self.P[0, 0], self.P[ATTITUDE, ATTITUDE], self.P[COEFFICIENT, COEFFICIENT] = c.offset, c.attitude, c.per_k
        self.x = np.zeros((STATES, 3, copies))
        self.gravity_P = np.zeros((GRAVITY_STATES, GRAVITY_STATES, copies))
        for i in range(3):
            self.gravity_P[i, i] = c.accel_offset
        self.own = np.full(copies, c.accel_attitude)
        self._begin_gravity()
        self.gravity_x = np.zeros((GRAVITY_STATES, copies))
        self.noise = np.ones((2, copies))
        self.cusum = np.zeros((len(CHANNELS), 2, len(SHIFTS), copies))
        self._decay, self._gravity_decay = np.ones((STATES, 1)), np.ones((GRAVITY_STATES, 1))
        self._decay[1:ATTITUDE, 0] = self._gravity_decay[3:GRAVITY_ATTITUDE, 0] = c.decay

    def predict(self) -> None:
        """One window of time passes."""
        c, decay, of_gravity = self.chosen, self._decay, self._gravity_decay
        self.x = self.x * decay[:, None]
        self.gravity_x = self.gravity_x * of_gravity
        self.P = self.P * decay[:, None] * decay
        self.gravity_P = self.gravity_P * of_gravity[:, None] * of_gravity
        self.P[0, 0] += c.walk
        for i in range(3):
            self.gravity_P[i, i] += c.accel_walk
        for k in range(PROCESSES):
            self.P[1 + k, 1 + k] += c.drive[k]
            self.gravity_P[3 + k, 3 + k] += c.accel_drive[k]

    def new_rest(self) -> None:
        """The sensor may lie in another attitude now."""
        self.x[ATTITUDE] = 0
        self.P[ATTITUDE] = self.P[:, ATTITUDE] = 0
        self.P[ATTITUDE, ATTITUDE] = self.chosen.attitude
        self.gravity_x[GRAVITY_ATTITUDE:] = 0
        self.gravity_P[GRAVITY_ATTITUDE:] = self.gravity_P[:, GRAVITY_ATTITUDE:] = 0
        self._begin_gravity()

    def _begin_gravity(self) -> None:
        """Variances of what gravity's length has of its own in each rest."""
        self.gravity_P[GRAVITY_ATTITUDE, GRAVITY_ATTITUDE] = self.own
        self.gravity_P[GRAVITY_COEFFICIENT, GRAVITY_COEFFICIENT] = self.chosen.accel_per_k

    def judge(self, window: Window) -> Judged:
        """Take one reading: test it, then let the filters follow it."""
        ratio = window.scatter
        self.noise = self.noise + (ratio - self.noise) / NOISE_WINDOWS
        wide = np.maximum(self.noise, 1)
        wide = np.where(ratio > 2 * wide, ratio, wide)
        warmer = window.warmer[None]
        h = np.concatenate([np.ones((COEFFICIENT, len(window.warmer))), warmer])
        hg = np.concatenate([window.direction, np.ones((1 + PROCESSES, len(window.warmer))), warmer])
        Ph, S = _project(self.P, h, wide[0])
        Phg, Sg = _project(self.gravity_P, hg, wide[1])
        gain, gain_g = Ph / S, Phg / Sg
        innovation = window.rate - np.sum(h[:, None] * self.x, axis=0)
        innovation_g = window.gravity - np.sum(hg * self.gravity_x, axis=0)
        sigma = np.sqrt([S, Sg])
        whole = np.concatenate([innovation / sigma[0], (innovation_g / sigma[1])[None]])
        z = np.clip(whole, -CLIP, CLIP)
        far = np.abs(z) >= CLIP
        alarm, number = self._test(z)
        zero_alarm, gravity_alarm = (alarm[:3] != 0).any(axis=0), alarm[3] != 0
        follow, follow_g = ~zero_alarm & ~far[:3].any(axis=0), ~gravity_alarm & ~far[3]
        self.P = np.where(follow, self.P - Ph[:, None] * Ph / S, self.P)  # symmetric to the bit, however long it runs
        self.x = np.where(follow, self.x + gain[:, None] * innovation, self.x)
        self.gravity_P = np.where(follow_g, self.gravity_P - Phg[:, None] * Phg / Sg, self.gravity_P)
        self.gravity_x = np.where(follow_g, self.gravity_x + gain_g * innovation_g, self.gravity_x)
        # After an alarm the present reading is the new state.
        self.x[0] += np.where(zero_alarm, innovation, 0)
        self.P[0, 0] += np.where(zero_alarm, S, 0)
        # Of gravity it is that of this attitude; in others it may differ by as much.
        self.gravity_P[GRAVITY_ATTITUDE, GRAVITY_ATTITUDE] += np.where(gravity_alarm, Sg, 0)
        self.gravity_x[GRAVITY_ATTITUDE] += np.where(gravity_alarm, innovation_g, 0)
        self.own = np.where(gravity_alarm, np.maximum(innovation_g**2, self.own), self.own)
        self.cusum[:3] = np.where(zero_alarm, 0, self.cusum[:3])
        self.cusum[3] = np.where(gravity_alarm, 0, self.cusum[3])
        return Judged(z, whole, sigma, gain, alarm, follow, number)

    def _test(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Let the CUSUMs of all channels follow z (4, S): sign of an alarm (4, S), or 0, and the shift of its test."""
        c = self.chosen
        step = c.shift[:, None] * z[:, None]
        both = np.stack([self.cusum[:, 0] + step, self.cusum[:, 1] - step], axis=1) - c.shift[:, None] ** 2 / 2
        self.cusum = np.maximum(both, 0)
        over = self.cusum >= c.bar[:, None]
        rise, fall = over[:, 0].any(axis=1), over[:, 1].any(axis=1)
        return np.where(rise, 1, np.where(fall, -1, 0)), np.argmax(over.any(axis=1), axis=1)

    @property
    def lasting(self) -> tuple[np.ndarray, np.ndarray]:
        """(3, S) zero without what the attitude of this rest adds, and its variance (S,) on each axis; normalised."""
        return self._sum(ATTITUDE)

    @property
    def zero(self) -> tuple[np.ndarray, np.ndarray]:
        """The same of the present rest, without the coefficient's part."""
        return self._sum(COEFFICIENT)

    def _sum(self, states: int) -> tuple[np.ndarray, np.ndarray]:
        return self.x[:states].sum(axis=0), np.maximum(self.P[:states, :states].sum(axis=(0, 1)), 0)


def _project(P: np.ndarray, h: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """P h (n, S) and h P h + noise (S,), of a covariance (n, n, S)."""
    Ph = np.sum(P * h, axis=1)
    return Ph, np.sum(h * Ph, axis=0) + noise


#: whether it was quiet, the window that it has completed, and what that gave
Block = tuple[bool, Window | None, Judged | None]


class Detector:
    """One stream: samples in, judged windows out."""

    def __init__(self, chosen: Settings):
        self.chosen, self.filter = chosen, ZeroFilter(chosen)
        self._left = np.zeros((0, 7))  # samples of the block that is not complete
        self._window: list[np.ndarray] = []  # means of the window's blocks
        self._state, self._ticks, self._waiting = MOVING, 0, False

    def feed(self, rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray | None = None) -> Iterator[Block]:
        """Take samples: calibrated rate (N, 3) rad/s, force (N, 3) m/s^2, temp_c (N,).

        Yields after each block.
        """
        c, n = self.chosen, self.chosen.samples
        warm = np.full(len(rate), np.nan) if temp_c is None else np.asarray(temp_c, dtype=float)
        warm = np.where(np.abs(warm) < MOST_TEMPERATURE_C, warm, c.reference_c)
        rows = np.concatenate([self._left, np.column_stack([rate, force, warm])])
        count = len(rows) // n
        self._left = rows[count * n :]
        blocks = rows[: count * n].reshape(count, n, 7)
        with np.errstate(invalid="ignore", over="ignore"):
            means, variance = blocks.mean(axis=1), blocks.var(axis=1, ddof=1)
            # (B,) whether blocks can be of a rest, from means and variances (B, 7) of their samples
            c = self.chosen
            still = (np.abs(means[:, :3]) < REST_RATE_RPS).all(axis=1)
            still &= (variance[:, :3].sum(axis=1) < c.gyro_limit) & (variance[:, 3:6].sum(axis=1) < c.accel_limit)
            off = np.linalg.norm(means[:, 3:6], axis=1) / c.gravity_mps2 - 1
            quiet: list[bool] = (still & (np.abs(off) < FORCE_WITHIN)).tolist()
        for each, is_quiet in zip(means, quiet, strict=True):
            yield is_quiet, *self._block(each, is_quiet)

    def _block(self, mean: np.ndarray, is_quiet: bool) -> tuple[Window | None, Judged | None]:
        found: tuple[Window | None, Judged | None] = (None, None)
        self._ticks += 1
        if self._ticks == BLOCKS:
            self._ticks = 0
            self.filter.predict()
        if not is_quiet:
            self._state, self._window = MOVING, []
            return found
        if self._state == MOVING:
            self._state, self._waiting, self._window = SETTLING, True, []
            return found
        if len(self._window) == BLOCKS:  # this block shows that the last of them was not the end of the rest
            found = self._complete(np.array(self._window))
            self._window = []
        self._state = RESTING
        self._window.append(mean)
        return found

    def _complete(self, blocks: np.ndarray) -> tuple[Window | None, Judged | None]:
        """Judge the window of blocks with means (16, 7)."""
        c, mean, variance = self.chosen, blocks.mean(axis=0), blocks.var(axis=0, ddof=1)
        scatter = np.array([variance[:3].sum() / c.gyro_scatter, variance[3:6].sum() / c.accel_scatter])
        if (scatter > MOST_SCATTER).any():
            return None, None
        direction = mean[3:6] / c.gravity_mps2
        rate = (mean[:3] - direction * c.earth_rps) / c.rate_sigma_rps
        gravity = np.array([(direction @ direction - 1) / 2 / c.gravity_sigma])
        window = Window(rate[:, None], gravity, direction[:, None], mean[6:] - c.reference_c, scatter[:, None])
        if self._waiting:
            self._waiting = False
            self.filter.new_rest()
        return window, self.filter.judge(window)

    def gap(self, samples: int) -> None:
        """Samples are missing: the rest, if it was one, has ended, and time has passed."""
        self._left = self._left[:0]
        self._state, self._window = MOVING, []
        self._ticks += min(samples // self.chosen.samples, MOST_GAP)
        while self._ticks >= BLOCKS:
            self._ticks -= BLOCKS
            self.filter.predict()
