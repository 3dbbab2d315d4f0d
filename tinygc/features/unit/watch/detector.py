"""The detector: blocks of samples become windows at rest, whose innovations are tested.

    block     0.125 s: quiet where its scatter, its rate and the length of its force are those of a rest
    window    16 quiet blocks, but the first and the last of a rest: the means are one reading of the zero and of gravity
    filters   Kalman filters of ``expectation``'s states; their innovations are independent while the calibration holds
    tests     CUSUMs of the innovations (``bars``), for both signs and five sizes, on three axes and on gravity

Arrays have a last axis of independent copies (one in use, many in simulations).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
    Sizes,
)
from tinygc.inference.choose import averaged

#: states of a filter: the zero with its walk, of an axis one, of gravity one for each direction; Gauss-Markov processes; then these two
PROCESSES = len(TIMES_S)
ATTITUDE, COEFFICIENT = -2, -1
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
class WindowResult:
    """What one window gave.

    whole (4, S): innovations in sigmas, of three axes and of gravity; sigma (2, S): of the innovations of an axis and of gravity,
    normalised; gain (5, S); alarm (4, S): +1 or -1 where a test has passed its bar; taken (S,): whether it changed the zero; shift (4, S):
    number of the test in ``SHIFTS``.
    """

    window: Window
    whole: np.ndarray
    sigma: np.ndarray
    gain: np.ndarray
    alarm: np.ndarray
    taken: np.ndarray
    shift: np.ndarray

    @property
    def z(self) -> np.ndarray:
        """(4, S) innovations as they count."""
        return np.clip(self.whole, -CLIP, CLIP)


class Filter:
    """A Kalman filter of n states over readings (A, S), A alike in each of S streams: ``walking`` ones, Gauss-Markov processes, attitude
    and the coefficient of temperature.

    P (n, n, S) covariance, x (n, A, S); own (S,): variance of what each rest has of its own; fresh: states that begin again with each rest.
    """

    def __init__(self, sizes: Sizes, decay: np.ndarray, walking: int, axes: int, copies: int, fresh: slice):
        count = walking + PROCESSES + 2
        self.own, self.per_k, self.fresh, self.each = np.full(copies, sizes.attitude), sizes.per_k, fresh, np.arange(count)
        self.decay, self.growth = np.ones((count, 1)), np.zeros((count, 1))
        self.decay[walking:ATTITUDE, 0], self.growth[walking:ATTITUDE, 0], self.growth[:walking] = decay, sizes.drive, sizes.walk
        self.P, self.x = np.zeros((count, count, copies)), np.zeros((count, axes, copies))
        self.P[self.each[:walking], self.each[:walking]] = sizes.offset
        self._begin()

    def _begin(self) -> None:
        for state, variance in ((ATTITUDE, self.own), (COEFFICIENT, self.per_k)):
            if not self.P[state, state].any():
                self.P[state, state] = variance

    def predict(self) -> None:
        """One window of time passes."""
        self.x = self.x * self.decay[:, None]
        self.P = self.P * self.decay[:, None] * self.decay
        self.P[self.each, self.each] += self.growth

    def new_rest(self) -> None:
        """The sensor may lie in another attitude now."""
        self.x[self.fresh] = 0
        self.P[self.fresh] = self.P[:, self.fresh] = 0
        self._begin()

    def project(self, h: np.ndarray, reading: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """P h (n, S), the innovations' variance h P h + noise (S,) and the innovations (A, S) of readings with these slopes (n, S)."""
        Ph = np.sum(self.P * h, axis=1)
        return Ph, np.sum(h * Ph, axis=0) + noise, reading - np.sum(h[:, None] * self.x, axis=0)

    def follow(self, taken: np.ndarray, Ph: np.ndarray, variance: np.ndarray, innovation: np.ndarray) -> None:
        """Take a reading, of the streams (S,) where it is taken."""
        self.P = np.where(taken, self.P - Ph[:, None] * Ph / variance, self.P)  # symmetric to the bit, however long it runs
        self.x = np.where(taken, self.x + (Ph / variance)[:, None] * innovation, self.x)

    def jump(self, state: int, alarmed: np.ndarray, variance: np.ndarray, innovation: np.ndarray) -> None:
        """After an alarm the present reading is the new state."""
        self.x[state] += np.where(alarmed, innovation, 0)
        self.P[state, state] += np.where(alarmed, variance, 0)

    def total(self, stop: int) -> tuple[np.ndarray, np.ndarray]:
        """(A, S) sum of the states before ``stop``, and its variance (S,)."""
        return self.x[:stop].sum(axis=0), np.maximum(self.P[:stop, :stop].sum(axis=(0, 1)), 0)


class ZeroFilter:
    """The filters and tests of S independent streams: rate, of three axes with one covariance, and gravity, whose slopes by the
    accelerometer's zero are the direction.

    noise (2, S): scatter of rate and force over the stated, averaged; cusum (4, 2, 4, S): of each channel, for a rise and for a fall.
    """

    def __init__(self, chosen: Settings, copies: int = 1):
        self.chosen = chosen
        self.rate = Filter(chosen.rate, chosen.decay, 1, 3, copies, slice(ATTITUDE, COEFFICIENT))
        self.gravity = Filter(chosen.gravity, chosen.decay, 3, 1, copies, slice(ATTITUDE, None))
        self.noise = np.ones((2, copies))
        self.cusum = np.zeros((len(CHANNELS), 2, len(SHIFTS), copies))

    def predict(self) -> None:
        """One window of time passes."""
        self.rate.predict()
        self.gravity.predict()

    def new_rest(self) -> None:
        """The sensor may lie in another attitude now."""
        self.rate.new_rest()
        self.gravity.new_rest()

    def evaluate(self, window: Window) -> WindowResult:
        """Take one reading: test it, then let the filters follow it."""
        ratio = window.scatter
        self.noise = self.noise + (ratio - self.noise) / NOISE_WINDOWS
        wide = np.maximum(self.noise, 1)
        wide = np.where(ratio > 2 * wide, ratio, wide)
        one = np.ones((1, len(window.warmer)))
        channels = (
            (self.rate, slice(0, 3), 0, one, window.rate, wide[0]),
            (self.gravity, slice(3, 4), ATTITUDE, window.direction, window.gravity[None], wide[1]),
        )
        seen = [
            each.project(np.concatenate([slope, *[one] * (1 + PROCESSES), window.warmer[None]]), reading, noise)
            for each, *_, slope, reading, noise in channels
        ]
        sigma = np.sqrt([variance for _, variance, _ in seen])
        whole = np.concatenate([innovation / own for (*_, innovation), own in zip(seen, sigma, strict=True)])
        far = np.abs(whole) >= CLIP
        alarm, number = self._test(np.clip(whole, -CLIP, CLIP))
        taken = []
        for (each, part, state, *_), projected in zip(channels, seen, strict=True):
            alarmed = (alarm[part] != 0).any(axis=0)
            taken.append(~alarmed & ~far[part].any(axis=0))
            each.follow(taken[-1], *projected)
            each.jump(state, alarmed, *projected[1:])
            self.cusum[part] = np.where(alarmed, 0, self.cusum[part])
        # Of gravity the new state is that of this attitude; in others it may differ by as much.
        own = self.gravity.own
        self.gravity.own = np.where(alarm[3] != 0, np.maximum(seen[1][2][0] ** 2, own), own)
        return WindowResult(window, whole, sigma, seen[0][0] / seen[0][1], alarm, taken[0], number)

    def _test(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Let the CUSUMs of all channels follow z (4, S): sign of an alarm (4, S), or 0, and the shift of its test."""
        step = SHIFTS[:, None] * z[:, None]
        both = np.stack([self.cusum[:, 0] + step, self.cusum[:, 1] - step], axis=1) - SHIFTS[:, None] ** 2 / 2
        self.cusum = np.maximum(both, 0)
        over = self.cusum >= self.chosen.bar[:, None]
        rise, fall = over[:, 0].any(axis=1), over[:, 1].any(axis=1)
        return np.where(rise, 1, np.where(fall, -1, 0)), np.argmax(over.any(axis=1), axis=1)


class Detector:
    """One stream: samples in, tested windows out."""

    def __init__(self, chosen: Settings):
        self.chosen, self.filter = chosen, ZeroFilter(chosen)
        self._left = np.zeros((0, 7))  # samples of the block that is not complete
        self._window: list[np.ndarray] = []  # means of the window's blocks
        self._state, self._ticks, self._waiting = MOVING, 0, False

    def feed(self, rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray | None = None) -> Iterator[tuple[bool, WindowResult | None]]:
        """Take samples: calibrated rate (N, 3) rad/s, force (N, 3) m/s^2, temp_c (N,).

        Yields after each block whether it was quiet, and what the window gave that it has completed.
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
            still = (np.abs(means[:, :3]) < REST_RATE_RPS).all(axis=1)
            still &= (variance[:, :6].reshape(count, 2, 3).sum(axis=2) < c.limit).all(axis=1)
            off = np.linalg.norm(means[:, 3:6], axis=1) / c.expected.gravity_mps2 - 1
            quiet: list[bool] = (still & (np.abs(off) < FORCE_WITHIN)).tolist()
        for each, is_quiet in zip(means, quiet, strict=True):
            yield is_quiet, self._block(each, is_quiet)

    def _block(self, mean: np.ndarray, is_quiet: bool) -> WindowResult | None:
        self._ticks += 1
        if self._ticks == BLOCKS:
            self._ticks = 0
            self.filter.predict()
        if not is_quiet:
            self._state, self._window = MOVING, []
            return None
        if self._state == MOVING:
            self._state, self._waiting, self._window = SETTLING, True, []
            return None
        found = None
        if len(self._window) == BLOCKS:  # this block shows that the last of them was not the end of the rest
            found = self._complete(np.array(self._window))
            self._window = []
        self._state = RESTING
        self._window.append(mean)
        return found

    def _complete(self, blocks: np.ndarray) -> WindowResult | None:
        """Test the window of blocks with means (16, 7)."""
        c, mean = self.chosen, blocks.mean(axis=0)
        scatter = blocks.var(axis=0, ddof=1)[:6].reshape(2, 3).sum(axis=1) / c.scatter
        if (scatter > MOST_SCATTER).any():
            return None
        direction = mean[3:6] / c.expected.gravity_mps2
        rate = (mean[:3] - direction * c.expected.earth_rps) / c.rate_sigma_rps
        gravity = np.array([(direction @ direction - 1) / 2 / c.gravity_sigma])
        if self._waiting:
            self._waiting = False
            self.filter.new_rest()
        return self.filter.evaluate(Window(rate[:, None], gravity, direction[:, None], mean[6:] - c.reference_c, scatter[:, None]))

    def gap(self, samples: int) -> None:
        """Samples are missing: the rest, if it was one, has ended, and time has passed."""
        self._left = self._left[:0]
        self._state, self._window = MOVING, []
        self._ticks += min(samples // self.chosen.samples, MOST_GAP)
        while self._ticks >= BLOCKS:
            self._ticks -= BLOCKS
            self.filter.predict()


# What an alarm is likely to be: a step or a ramp of one channel, when it began, and its size with its sigma.
#
# The filter follows a change, so that its innovations show only what it has not followed yet: a change u(t) of the reading gives the mean
# innovation g, by the same gains.  For each moment and form, the size is sum(z g) / sum(g^2) in sigmas, the log likelihood ratio half of
# sum(z g)^2 / sum(g^2).  The likeliest ones are named; the size is the mean over all moments, and over both forms where they are not
# separated, by their probabilities, and its sigma contains how they differ.
#
# A moment lies anywhere within a window: a step then moves that window's mean by a part of its size, which from one window on alone would
# look like a ramp.  g is linear between a change at a window and one at the next.

#: log likelihood ratio by which one form must be better than the other: odds of twenty to one
SEPARATED = 3.0
#: sigma of the prior of a size, in the likeliest one's: moments just before the end, which show no size, then have little of the mean
WIDE = 3.0
#: places within a window, of the whole and about the likeliest one in its sigmas
PLACES, SIGMAS = np.linspace(0, 1, 9), np.linspace(-4, 4, 9)
#: windows before the test's own beginning among which the change is looked for, and moments that are tried
BEFORE, TRIED = 30, 60


#: s of a window's end, and what it gave, of whose copies the first counts
Reading = tuple[float, WindowResult]


@dataclass(frozen=True)
class Change:
    """kind: ``step``, ``ramp`` or ``step or ramp``; began_s: of the likeliest moment; earlier: whether it may have begun before what is
    remembered; size now, and its sigma, over all moments, normalised."""

    kind: str
    began_s: float
    earlier: bool
    size: float
    sigma: float

    def words(self, amount: str) -> str:
        """In words: ``step of +0.12 ± 0.01 dps at 120 s``."""
        moment = f"{self.began_s:.0f} s{' or earlier' if self.earlier else ''}"
        if self.kind == "step":
            return f"step of {amount} at {moment}"
        if self.kind == "ramp":
            return f"drift of {amount} since {moment}"
        return f"step or drift of {amount} since {moment}"


def change_of(records: Sequence[Reading], channel: int, begun: int, chosen: Settings) -> Change:
    """The likeliest change of a channel (``settings.CHANNELS``), by a test whose sum began ``begun`` windows before the last record."""
    rows, count = list(records), len(records)
    first = max(0, count - 1 - begun - BEFORE)
    moments = np.unique(np.linspace(first, count - 1, TRIED).round().astype(int))
    t_s = np.array([each for each, _ in rows])
    forms = [_within_windows(rows, moments, ramp, channel, chosen) for ramp in (False, True)]
    gains = [score**2 / information / 2 for score, information, *_ in forms]
    better = float(gains[0].max() - gains[1].max())
    kind = "step" if better > SEPARATED else "ramp" if better < -SEPARATED else "step or ramp"
    likelier = int(better < 0)
    at = np.unravel_index(np.argmax(gains[likelier]), gains[likelier].shape)
    taken = forms if kind == "step or ramp" else [forms[likelier]]
    score, information, share, _ = (np.concatenate([each.ravel() for each in of]) for of in zip(*taken, strict=True))
    best = abs(forms[likelier][0][at] / forms[likelier][1][at])
    precision = information + 1 / max(WIDE * best, 1e-12) ** 2
    sizes = score / precision
    weight = share * np.exp(score * sizes / 2 - max(each.max() for each in gains)) / np.sqrt(precision)
    size, sigma = averaged(weight / weight.sum(), sizes, precision**-0.5)
    moment = int(moments[at[0]])
    began = t_s[moment - 1] + forms[likelier][3][at] * (t_s[moment] - t_s[moment - 1]) if moment > 0 else t_s[0]
    return Change(kind, float(began), moment == 0 and count > 1, size, sigma)


def _within_windows(
    rows: Sequence[Reading], moments: np.ndarray, ramp: bool, channel: int, chosen: Settings
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of a change in each window of the moments, at K places within it: score and information of its size now, the prior share of the
    place, and the place, 0 to 1; each (M, K)."""
    t_s, z = (np.array(column) for column in zip(*((at, result.whole[channel, 0]) for at, result in rows), strict=True))
    ends = [np.minimum(moments + later, len(rows) - 1) for later in (0, 1)]
    own, after = (_response(rows, moments + later, ramp, channel, chosen) for later in (0, 1))
    A, B, C, a, b = (np.sum(own**2, axis=0), np.sum(own * after, axis=0), np.sum(after**2, axis=0), own.T @ z, after.T @ z)
    # The likeliest place, and its sigma, are those of least squares by both columns.
    parts = np.stack([C * a - B * b, A * b - B * a])
    with np.errstate(divide="ignore", invalid="ignore"):
        best = np.clip(np.nan_to_num(parts[1] / parts.sum(axis=0)), 0, 1)
        width = np.sqrt(np.maximum((best**2 * C + 2 * best * (1 - best) * B + (1 - best) ** 2 * A) * (A * C - B**2), 0.0))
        width = np.nan_to_num(width / np.abs(parts.sum(axis=0)), posinf=1.0)
    about = np.clip(best[:, None] + width[:, None] * SIGMAS, 0, 1)
    f = np.sort(np.concatenate([about, np.broadcast_to(PLACES, (len(moments), len(PLACES)))], axis=1), axis=1)
    gaps = np.diff(f, axis=1, prepend=0.0, append=1.0)
    e, A, B, C, a, b = (1 - f, *(each[:, None] for each in (A, B, C, a, b)))
    # What a size now, not a slope, would add.
    grown = np.maximum(t_s[-1] - e * t_s[ends[0]][:, None] - f * t_s[ends[1]][:, None], 1e-9) if ramp else 1.0
    information = np.maximum((e**2 * A + 2 * e * f * B + f**2 * C) / grown**2, 1e-12)
    return (e * a + f * b) / grown, information, (gaps[:, 1:] + gaps[:, :-1]) / 2, f


def _response(rows: Sequence[Reading], moments: np.ndarray, ramp: bool, channel: int, chosen: Settings) -> np.ndarray:
    """(N, M) mean innovation, in sigmas, of a unit step at each moment, or of a ramp of a unit a second from there on.

    Of gravity, whose filter depends on the attitude, the innovation is taken as the change itself.
    """
    index = np.arange(len(rows))
    t_s = np.array([each for each, _ in rows])
    after = index[:, None] >= moments[None]
    change = np.where(after, t_s[:, None] - t_s[np.minimum(moments, len(rows) - 1)][None] if ramp else 1.0, 0.0)
    if channel == 3:
        return change / np.array([result.sigma[1, 0] for _, result in rows])[:, None]
    decay = np.r_[1.0, chosen.decay, 1.0, 1.0]
    x, found = np.zeros((len(decay), len(moments))), np.empty(change.shape)
    for number, (_, result) in enumerate(rows):
        h = np.r_[np.ones(len(decay) - 1), result.window.warmer[0]]
        innovation = change[number] - h @ x
        found[number] = innovation / result.sigma[0, 0]
        if result.taken[0]:
            x = x + result.gain[:, :1] * innovation
        x = x * decay[:, None]
    return found
