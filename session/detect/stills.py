"""Find the still phases of a log, and rate each one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from session.base.errors import FormatError
from session.base.numeric import runs_of, sigma_of, span_steps, weighted_median
from session.base.rotation import angle_between
from session.base.units import DEG, NS
from session.log.config import StillByHand
from session.log.folder import Session
from session.log.logfile import Log
from session.log.samples import Samples, once

# Short blocks of samples and their moments: the data for stillness and noise.

BLOCK_S = 0.1  #: long against a gyro's filter, short against a hand's pause
MIN_BLOCK_SAMPLES = 8  #: below this a variance shows little
_CHUNK_BLOCKS = 2_000  #: as many as a processor's cache holds, of logs of any length


@dataclass(frozen=True, eq=False)
class Blocks:
    """Moments of consecutive blocks of ``size`` samples: gyro_mean, gyro_var, accel_mean, accel_var, all (B, 3), SI."""

    size: int
    duration_s: float
    gyro_mean: np.ndarray
    gyro_var: np.ndarray
    accel_mean: np.ndarray
    accel_var: np.ndarray

    def __len__(self) -> int:
        return len(self.gyro_mean)


def block_size(period_s: float) -> int:
    """Samples in a block of about ``BLOCK_S``."""
    return max(MIN_BLOCK_SAMPLES, round(BLOCK_S / period_s))


def block_moments(samples: Samples, size: int | None = None) -> Blocks:
    """Cut samples into blocks of ``size`` samples, or of about ``BLOCK_S``; an incomplete block at the end is left out."""
    size = size or block_size(samples.period_s)
    gyro_mean, gyro_var = _gyro_moments(samples, size)
    accel_mean, accel_var = _moments(samples.accel, size)
    return Blocks(size, size * samples.period_s, gyro_mean, gyro_var, accel_mean, accel_var)


@once
def _gyro_moments(samples: Samples, size: int) -> tuple[np.ndarray, np.ndarray]:
    return _moments(samples.gyro, size)


def _moments(values: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    count = len(values) // size
    mean, var = np.empty((count, 3)), np.empty((count, 3))
    for first in range(0, count, _CHUNK_BLOCKS):
        last = min(first + _CHUNK_BLOCKS, count)
        part = values[first * size : last * size].reshape(last - first, size, 3)
        mean[first:last] = np.einsum("bsi->bi", part) / size
        centred = part - mean[first:last, None]
        var[first:last] = np.einsum("bsi,bsi->bi", centred, centred) / (size - 1)
    return mean, var


# Mean, scatter and slope of the readings of a still: all at once, or part by part where it lasted for hours.

#: rows that are looked at at once: more than an hour at 104 Hz
AT_ONCE = 1 << 19
#: samples ``start <= i < stop`` of a still, in order, one pair where nothing interrupts it
Spans = list[tuple[int, int]]


def _trend_of(values: np.ndarray, t_ns: np.ndarray, spans: Spans) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, standard deviation (of single samples) and slope a second, each (3,), of readings (N, 3) of a log at stamps (N,) ns."""
    first = t_ns[spans[0][0]]
    if _count(spans) <= AT_ONCE:
        rows = rows_of(spans)
        t, own = (t_ns[rows] - first) * NS, values[rows]
        mean, centred = np.einsum("ij->j", own) / len(own), t - t.mean()
        square = np.einsum("ij->j", (own - mean) ** 2)
        return mean, np.sqrt(square / (len(own) - 1)), centred @ own / np.sum(centred**2)
    count, t_sum, total = _count(spans), 0.0, np.zeros(3)
    for part in _parts(spans):
        t_sum, total = t_sum + float(np.sum((t_ns[part] - first) * NS)), total + np.sum(values[part], axis=0)
    middle, mean = t_sum / count, total / count
    square, leverage, along = np.zeros(3), 0.0, np.zeros(3)
    for part in _parts(spans):
        centred, off = (t_ns[part] - first) * NS - middle, values[part] - mean
        square, leverage, along = square + np.sum(off**2, axis=0), leverage + float(centred @ centred), along + centred @ off
    return mean, np.sqrt(square / (count - 1)), along / leverage


def _mean_as_a_slope_weighs(values: np.ndarray, spans: Spans) -> np.ndarray:
    """(3,) of readings (N, 3), each weighted as a fitted slope weighs a rate at its time: by ``(T/2)^2 - (t - T/2)^2``."""
    first, last = spans[0][0], spans[-1][1] - 1
    size, total = 0.0, np.zeros(3)
    for part in _parts(spans):
        share = (np.arange(part.start, part.stop) - first + 0.5) / (last - first + 1)
        weight = share * (1 - share)
        size, total = size + float(weight.sum()), total + weight @ values[part]
    return total / size


def rows_of(spans: Spans) -> slice | np.ndarray:
    """A slice where nothing interrupts a still: no index has to be held."""
    return slice(*spans[0]) if len(spans) == 1 else np.concatenate([np.arange(*span) for span in spans])


def _count(spans: Spans) -> int:
    return sum(stop - start for start, stop in spans)


def _parts(spans: Spans) -> Iterator[slice]:
    return (slice(at, min(at + AT_ONCE, stop)) for start, stop in spans for at in range(start, stop, AT_ONCE))


# Find the still phases of a log, and rate each.
#
# No setting: the sensor's own noise, measured on the quietest blocks of the log itself, is the yardstick.  A block of 0.1 s is
# quiet when neither the scatter nor the mean of its rate, nor the scatter of its specific force, leaves what that noise allows.
# Runs of quiet blocks are stills.  A constant slow turn is quiet too, so gravity must not move in a still.

QUIET_VARIANCE_RATIO = 3.0  #: of a block's variance to the noise's; pure noise of 3 x 7 degrees of freedom exceeds it once in 10^6
QUIET_ACCEL_RATIO = 6.0  #: looser: a table that trembles by some 0.1 mg still does not turn
MEAN_SIGMAS = 6.0  #: a block's mean rate against its still's
MIN_STILL_FRACTION = 0.7  #: of the protocol's still_s
CREEP_SIGMAS = 6.0
CREEP_RPS = 0.02 * DEG  #: slower than this, a 2 s still moves by less than 0.04 deg
TURNING_RPS = 3.0 * DEG  #: a "still" whose rate differs this much from the others' is a steady turn
BUMP_S = 0.35  #: a shorter disturbance that leaves the attitude as it was does not end a still
NOISE_BLOCKS = 3
BUMP_RAD = 0.1 * DEG


@dataclass(frozen=True, eq=False)
class Still:
    """One still phase, samples ``start <= i < stop``.

    gyro_mean (3,) rad/s; accel_mean (3,) m/s^2; gyro_std, accel_std (3,) scatter of single samples;
    tilt_rate (3,) rad/s: how fast gravity's direction turns, in body axes (nothing about the vertical);
    temp_c or NaN; problem: why it is no reference, or None; bumps: disturbances inside that it survived.
    """

    start: int
    stop: int
    start_s: float
    duration_s: float
    gyro_mean: np.ndarray
    gyro_std: np.ndarray
    accel_mean: np.ndarray
    accel_std: np.ndarray
    tilt_rate: np.ndarray
    temp_c: float
    bumps: int = 0
    problem: str | None = None

    @cached_property
    def gravity_mps2(self) -> float:
        """Length of the mean specific force."""
        return float(np.linalg.norm(self.accel_mean))

    @property
    def middle(self) -> int:
        """Number of its middle sample."""
        return (self.start + self.stop) // 2


@dataclass(frozen=True, eq=False)
class Noise:
    """White noise measured in the stills: gyro (3,) rad/s/sqrt(Hz), accel (3,) m/s^2/sqrt(Hz), one-sided densities.

    The random walk of the integral is the one-sided density / sqrt(2).
    """

    gyro: np.ndarray
    accel: np.ndarray

    @property
    def angle_random_walk(self) -> np.ndarray:
        """(3,) rad/sqrt(s)."""
        return self.gyro / np.sqrt(2)

    @cached_property
    def velocity_random_walk(self) -> np.ndarray:
        """(3,) m/s/sqrt(s)."""
        return self.accel / np.sqrt(2)


def noise_floor(noise: Noise | None, duration_s: float) -> float:
    """rad that the gyro's white noise adds to a turn of this duration, on its worst axis; infinite where the noise is not known."""
    return np.inf if noise is None else float(noise.angle_random_walk.max()) * np.sqrt(duration_s)


def references(stills: Sequence[Still]) -> list[Still]:
    """Those without a problem."""
    return [still for still in stills if still.problem is None]


def find_stills(samples: Samples, still_s: float = 1.0) -> tuple[list[Still], Noise | None]:
    """Still phases of about ``still_s`` or longer, in order, and the noise in them (None where there is no still).

    Phases that are quiet but no reference (they creep) are in the list, with their problem.
    """
    blocks = block_moments(samples)
    if len(blocks) < 3:
        return [], None
    quiet, spread = quiet_runs(blocks)
    # Join runs that only a short bump parts, one that left the attitude where it was. A still is a list of runs.
    runs: list[list[tuple[int, int]]] = []
    for run in quiet:
        before = runs[-1][-1] if runs else None
        if before and _same_rest(before, run, blocks, spread):
            runs[-1].append(run)
        else:
            runs.append([run])
    shortest = MIN_STILL_FRACTION * still_s / blocks.duration_s
    runs = [run for run in runs if sum(stop - start for start, stop in run) >= shortest]
    if not runs:
        return [], None
    noise = _noise(runs, blocks)
    stills = [_settled(samples, run, blocks.size, noise, round(shortest)) for run in runs]
    # A turn at constant rate is quiet as well; its rate separates it from the stills.
    usual = _usual_rate(*(np.array([getattr(still, name) for still in stills]) for name in ("gyro_mean", "duration_s")))
    return [still for still in stills if np.abs(still.gyro_mean - usual).max() <= TURNING_RPS], noise


def quiet_runs(blocks: Blocks, by_force: bool = False) -> tuple[list[tuple[int, int]], np.ndarray]:
    """Runs (start, stop) of quiet blocks at a constant rate, however short; (3,) what noise alone scatters a block's mean rate by.

    by_force: quiet by the specific force alone, whatever the gyroscope does, and with that steady.
    """
    quiet, means = _quiet_blocks(blocks, by_force), blocks.accel_mean if by_force else blocks.gyro_mean
    # (3,) standard deviation of a block's mean from noise alone: from differences of neighbours, robustly.
    both = quiet[1:] & quiet[:-1]
    spread = np.full(3, np.inf) if not both.any() else sigma_of(np.diff(means, axis=0)[both]) / np.sqrt(2)
    # Split each run where a block's mean rate leaves the run's: the slow ends of a turn are not still.
    kept = []
    for start, stop in np.transpose(runs_of(quiet)).tolist():
        mean = means[start:stop]
        steady = (np.abs(mean - np.median(mean, axis=0)) < MEAN_SIGMAS * spread).all(axis=1)
        kept += (np.transpose(runs_of(steady)) + start).tolist()
    return kept, spread


def _quiet_blocks(blocks: Blocks, by_force: bool) -> np.ndarray:
    """Blocks (B,) bool whose scatter is the noise's own."""
    quiet = np.ones(len(blocks), dtype=bool)
    for variance, ratio in ((blocks.gyro_var, QUIET_VARIANCE_RATIO), (blocks.accel_var, QUIET_ACCEL_RATIO))[by_force:]:
        noise = noise_variance(variance)
        # The worst axis counts as well as the sum: a slow turn shows in one axis only.
        with np.errstate(over="ignore"):  # a clamped axis has almost no noise
            quiet &= (variance / noise).mean(axis=1) < ratio
        quiet &= (variance < 2 * ratio * noise).all(axis=1)
    return quiet


def noise_variance(variance: np.ndarray) -> np.ndarray:
    """(3,) variance of the sensor's noise from that of blocks (B, 3): the median of the quiet ones, found from the quietest twentieth."""
    total = variance.sum(axis=1)
    alive = total > 0  # a register that stands still has no scatter at all, and shows nothing of the noise
    if not alive.any():
        return np.full(3, np.finfo(float).tiny)
    bar = 4 * np.quantile(total[alive], 0.05)
    for _ in range(3):
        calm = variance[alive & (total < bar)]
        bar = QUIET_VARIANCE_RATIO * np.median(calm.sum(axis=1))
    return np.maximum(np.median(calm, axis=0), np.finfo(float).tiny)


def _same_rest(a: tuple[int, int], b: tuple[int, int], blocks: Blocks, spread: np.ndarray) -> bool:
    gap_s = (b[0] - a[1]) * blocks.duration_s
    if gap_s > BUMP_S or min(a[1] - a[0], b[1] - b[0]) < 2:
        return False
    bias = blocks.gyro_mean[a[0] : a[1]].mean(axis=0)
    turned = (blocks.gyro_mean[a[1] : b[0]] - bias).sum(axis=0) * blocks.duration_s
    noise = 4 * float(spread.max()) * blocks.duration_s * np.sqrt(b[0] - a[1])
    down = [blocks.accel_mean[first:last].mean(axis=0) for first, last in (a, b)]
    lengths = np.prod(np.linalg.norm(down, axis=1))
    if not lengths:  # no gravity, as where an accelerometer was not recorded, is no reason to take two rests for one
        return False
    tilted = np.linalg.norm(np.cross(*down)) / lengths
    return bool(np.linalg.norm(turned) < BUMP_RAD + noise and tilted < BUMP_RAD)


def _noise(runs: list[list[tuple[int, int]]], blocks: Blocks) -> Noise:
    """Overlapping Allan variance inside the stills (IEEE 952, C.1), over three blocks: long against the sensor's own filter, whose
    correlation would hide some per cent of the noise from a shorter one."""
    longest = max(b - a for run in runs for a, b in run)
    size = min(NOISE_BLOCKS, longest // 2)

    def density(mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
        if size == 0:  # stills of a single block: what is left is the scatter of single samples, as if it were white
            inside = np.concatenate([variance[a:b] for run in runs for a, b in run])
            return np.sqrt(2 * np.mean(inside, axis=0) * blocks.duration_s / blocks.size)
        steps = [span_steps(mean[a:b], size) for run in runs for a, b in run]
        return np.sqrt(np.mean(np.concatenate(steps) ** 2, axis=0) * size * blocks.duration_s)  # sqrt(2 x AVAR/2 x tau), one-sided

    return Noise(density(blocks.gyro_mean, blocks.gyro_var), density(blocks.accel_mean, blocks.accel_var))


def measure(samples: Samples, run: list[tuple[int, int]], size: int) -> Still:
    """The still of a run's blocks of ``size`` samples, as it stands."""
    spans = [(a * size, b * size) for a, b in run]
    first, last = spans[0][0], spans[-1][1] - 1
    gyro_mean, gyro_std, _ = _trend_of(samples.gyro, samples.t_ns, spans)
    accel_mean, accel_std, slope = _trend_of(samples.accel, samples.t_ns, spans)
    # A direction d fixed in the world, seen from a body that turns with omega: dd/dt = -omega x d, so omega = dd/dt x d + (about d).
    squared = accel_mean @ accel_mean
    tilt_rate = np.cross(slope, accel_mean) / squared if squared else np.full(3, np.nan)
    return Still(
        start=int(first),
        stop=int(last) + 1,
        start_s=samples.at_s(first),
        duration_s=float((samples.t_ns[last] - samples.t_ns[first]) * NS) + samples.period_s,
        gyro_mean=gyro_mean,
        gyro_std=gyro_std,
        accel_mean=accel_mean,
        accel_std=accel_std,
        tilt_rate=tilt_rate,
        temp_c=float("nan") if samples.temp_c is None else float(samples.temp_c[rows_of(spans)].mean()),
        bumps=len(run) - 1,
    )


def _settled(samples: Samples, run: list[tuple[int, int]], size: int, noise: Noise, shortest: int) -> Still:
    """The still once it has come to rest: what settles at its ends is cut off; one that never rests has a problem."""
    whole = still = measure(samples, run, size)
    # What the gyro reads (3,) at rest: its mean over a still, weighted as gravity's slope is, less the rate at which gravity turns.
    zero_rate = _mean_as_a_slope_weighs(samples.gyro, [(a * size, b * size) for a, b in run]) - whole.tilt_rate
    while _creep(still, whole, zero_rate, noise):
        length = sum(stop - start for start, stop in run)
        cut = max(1, length // 10)
        if length - cut < max(shortest, 3):
            return replace(whole, problem=_creep_words(whole))
        ends = [_without_end(run, cut, at_start) for at_start in (True, False)]
        run, still = min(((end, measure(samples, end, size)) for end in ends), key=lambda pair: _horizontal_rate(pair[1], zero_rate))
    return still


def _creep_words(still: Still) -> str:
    axis = "xyz"[int(np.argmax(np.abs(still.tilt_rate)))]
    return f"creeps {np.linalg.norm(still.tilt_rate) / DEG:.3f} dps about {axis} (gravity moves in it)"


def _horizontal_rate(still: Still, zero_rate: np.ndarray) -> float:
    """rad/s at which a still's gyro turns gravity's direction."""
    rate, down = still.gyro_mean - zero_rate, still.accel_mean / still.gravity_mps2
    return float(np.linalg.norm(rate - down * (down @ rate)))


def _creep(still: Still, whole: Still, zero_rate: np.ndarray, noise: Noise) -> bool:
    """Whether gravity turns in what is left of a still: by the accelerometer alone, or by the gyro since it was whole.

    The second is sharper in what is short: gravity's slope goes with duration^-1.5, so a steady creep that is only cut short enough
    would pass the first.
    """

    def tilt_sigma(duration_s: float) -> float:
        slope = float(noise.velocity_random_walk.max()) * np.sqrt(12 / duration_s**3)
        return slope / still.gravity_mps2 if still.gravity_mps2 else np.inf

    if np.linalg.norm(still.tilt_rate) > max(CREEP_SIGMAS * tilt_sigma(still.duration_s), CREEP_RPS):
        return True
    sigma = np.hypot(tilt_sigma(whole.duration_s), noise.angle_random_walk.max() / np.sqrt(still.duration_s))
    return still is not whole and _horizontal_rate(still, zero_rate) > max(CREEP_SIGMAS * sigma, CREEP_RPS)


def _without_end(run: list[tuple[int, int]], cut: int, at_start: bool) -> list[tuple[int, int]]:
    """A still's runs of blocks, ``cut`` blocks shorter at one end."""
    blocks = np.concatenate([np.arange(start, stop) for start, stop in run])
    first, last = (blocks[cut], blocks[-1] + 1) if at_start else (blocks[0], blocks[-cut - 1] + 1)
    return [(max(a, first), min(b, last)) for a, b in run if max(a, first) < min(b, last)]


def _usual_rate(rates: np.ndarray, durations_s: np.ndarray) -> np.ndarray:
    """(3,) rad/s: what most of the time at rest reads, of mean rates (Q, 3) over durations (Q,) s."""
    return np.array([weighted_median(rates[:, i], durations_s) for i in range(3)])


# Rests of a log that are no reference, each with its reason: an operator who sees where the table was not left alone can do better.
#
# A rest is what is quiet, at the rate that the stills have.  A pause of less than ``LEAST_S`` is part of a turn.

LEAST_S = 0.25  #: a hand that changes its direction rests for less
KNOCK_S = 1.0  #: rests of one attitude that are parted by less were one, and something knocked at it
SAME_ATTITUDE_RAD = 0.5 * DEG  #: a table that is knocked comes back to within this; a turn goes farther


@dataclass(frozen=True)
class UnusedRest:
    """start_s of the log; duration_s; cause, ``creeps``, ``turns``, ``knocked`` or ``too short``; why it is no reference, in words."""

    start_s: float
    duration_s: float
    cause: str
    why: str

    def __str__(self) -> str:
        return f"at {self.start_s:.1f} s ({self.duration_s:.1f} s): {self.why}"


def unused_rests(samples: Samples, stills: list[Still], still_s: float) -> list[UnusedRest]:
    """All of a log that ``find_stills`` did not take for a reference, in order; stills are what it found."""
    found = [UnusedRest(still.start_s, still.duration_s, "creeps", still.problem) for still in stills if still.problem]
    blocks = block_moments(samples)
    if len(blocks) < 3:
        return found
    runs, _ = quiet_runs(blocks)
    runs = [run for run in runs if (run[1] - run[0]) * blocks.duration_s >= LEAST_S]
    rates = np.array([blocks.gyro_mean[start:stop].mean(axis=0) for start, stop in runs]).reshape(-1, 3)
    lengths = np.array([stop - start for start, stop in runs], dtype=float)
    usual = np.median([still.gyro_mean for still in stills], axis=0) if stills else _usual_rate(rates, lengths) if runs else np.zeros(3)
    taken = np.array([(still.start // blocks.size, -(-still.stop // blocks.size)) for still in stills], dtype=int).reshape(-1, 2)
    shortest_s = MIN_STILL_FRACTION * still_s
    for number, (run, rate) in enumerate(zip(runs, rates, strict=True)):
        if np.any((run[0] < taken[:, 1]) & (run[1] > taken[:, 0])):
            continue
        duration_s, off = (run[1] - run[0]) * blocks.duration_s, np.abs(rate - usual).max()
        cause, why = "too short", f"too short, expected {shortest_s:.2g} s"
        if off > TURNING_RPS:
            if duration_s < shortest_s:
                continue  # the middle of a slow turn
            cause, why = "turns", f"turns at a steady {off / DEG:.1f} dps"
        elif (knock_s := _knock_s(number, runs, blocks)) is not None:
            cause, why = "knocked", f"{why}: {knock_s:.1f} s of movement part it from a rest in the same attitude"
        found.append(UnusedRest(samples.at_s(run[0] * blocks.size), duration_s, cause, why))
    return sorted(found, key=lambda rest: rest.start_s)


def _knock_s(number: int, runs: list[tuple[int, int]], blocks: Blocks) -> float | None:
    """s of movement between a run and a neighbour in the same attitude; None where there is no such neighbour."""
    for other in (number - 1, number + 1):
        if not 0 <= other < len(runs):
            continue
        (first, last) = sorted((runs[number], runs[other]))
        apart_s = (last[0] - first[1]) * blocks.duration_s
        down = [blocks.accel_mean[start:stop].mean(axis=0) for start, stop in (first, last)]
        angle = angle_between(*down)
        if apart_s <= KNOCK_S and angle < SAME_ATTITUDE_RAD:
            return apart_s
    return None


# Stills that a person changed (``[[still]]`` of session.toml): each is found again by a moment in it.

#: the problem of a still, and of a segment, that a person left out
BY_HAND = "was left out by hand (session.toml)"


def still_at(stills: Sequence[Still], samples: Samples, at_s: float) -> int | None:
    """Number of the still that holds a moment of the samples' clock."""
    return next((i for i, s in enumerate(stills) if samples.t_ns[s.start] * NS <= at_s <= samples.t_ns[s.stop - 1] * NS), None)


def changed_by_hand(samples: Samples, stills: list[Still], noise: Noise | None, rows: Sequence[StillByHand], where: str) -> list[Still]:
    """The stills of one log, in their order: with the ends that a person gave them, or left out.  Raises FormatError, which begins with
    ``where``, for a row that means no still, or for ends that none can have."""
    changed, least = list(stills), block_size(samples.period_s)
    for row in rows:
        number, at = still_at(stills, samples, row.at_s), f"{where}, at {row.at_s:.2f} s"
        if number is None:
            raise FormatError(f"{at}: no still was found there (s of the log's clock); correct at_s, or remove the entry")
        if row.from_s is None and row.to_s is None:
            changed[number] = replace(stills[number], problem=BY_HAND)
            continue
        if row.from_s is None or row.to_s is None:
            raise FormatError(f"{at}: only one end is given; give from_s and to_s, or neither to leave the still out")
        start = int(np.searchsorted(samples.t_ns, round(row.from_s / NS), "left"))
        stop = int(np.searchsorted(samples.t_ns, round(row.to_s / NS), "right"))
        outside = row.from_s < samples.t_ns[0] * NS - EDGE_S or row.to_s > samples.t_ns[-1] * NS + EDGE_S
        if outside or stop - start < least:
            why = "outside of the log" if outside else f"shorter than {least * samples.period_s:.2g} s"
            raise FormatError(f"{at}: from {row.from_s:.2f} to {row.to_s:.2f} s is {why}; correct from_s and to_s")
        moved = measure(samples, [(start, stop)], 1)
        changed[number] = replace(moved, problem=_problem(moved, stills[number], stills, noise))
    for before, after in pairwise(changed):
        if after.start < before.stop:
            raise FormatError(f"{where}: two stills overlap at {samples.t_ns[after.start] * NS:.2f} s; correct from_s and to_s")
    return changed


def _problem(moved: Still, found: Still, stills: Sequence[Still], noise: Noise | None) -> str | None:
    """Why a still with other ends is no reference, by what ``find_stills`` requires."""
    for what, bar in (("gyro", QUIET_VARIANCE_RATIO), ("accel", QUIET_ACCEL_RATIO)):
        scatter, still = (getattr(each, f"{what}_std") ** 2 for each in (moved, found))
        if (times := float((scatter / np.maximum(still, np.finfo(float).tiny)).mean())) > bar:
            return f"moves: its readings scatter {np.sqrt(times):.0f} times as much as where it was found"
    off = float(np.abs(moved.gyro_mean - np.median([still.gyro_mean for still in stills], axis=0)).max())
    if off > TURNING_RPS:
        return f"turns at a steady {off / DEG:.1f} dps"
    return _creep_words(moved) if noise is not None and _creep(moved, moved, moved.gyro_mean, noise) else None


EDGE_S = 1e-6  #: a log's own end, as a decimal number has it


# The stills of a session's logs and closure runs, each found once.

#: calibrations whose matrices differ by less find the same stills: a scatter moves by 1 %, and ends a still at 2.4 times the noise's
NEARLY = 0.01


@dataclass(frozen=True, eq=False)
class LogStills:
    """One log: samples with the accelerometer's pre-calibration applied, stills in them, their noise (None where nothing is still);
    still_s: how long a still should be, s; detected: the same stills as they were found, where a person changed some."""

    samples: Samples
    stills: list[Still]
    noise: Noise | None
    still_s: float = 1.0
    detected: list[Still] | None = None

    @cached_property
    def unused(self) -> list[UnusedRest]:
        """Rests that are no reference, with their reasons; found on first access."""
        return unused_rests(self.samples, self.detected or self.stills, self.still_s)


class SessionStills:
    """Made once where a session is read, and handed on: to the first look, the problem, the closure runs."""

    def __init__(self, session: Session, known: SessionStills | None = None):
        """known: of the same session before some of its logs were repaired; the others are not searched again."""
        self._session = session
        self._found: list[tuple[Log, LogStills]] = [] if known is None else list(known._found)

    def under(self, session: Session) -> SessionStills:
        """Of the same logs under another calibration of the accelerometer: the same stills where it is nearly the one before, else to be
        found again, since the scatter of each axis decides what is still."""
        return self.recalibrated(session) if abs(self._change(session) - np.eye(3)).max() < NEARLY else SessionStills(session)

    def recalibrated(self, session: Session) -> SessionStills:
        """The same stills of the same logs under another calibration: their means and the scatter of independent axes follow it."""
        other = SessionStills(session)
        before, after = self._session.config.accelerometer, session.config.accelerometer
        squares = self._change(session) ** 2

        def scatter(sigma: np.ndarray) -> np.ndarray:
            return np.asarray(np.sqrt(squares @ sigma**2))

        for log, found in self._found:
            stills = [
                replace(still, accel_mean=after.correct(before.measured(still.accel_mean)), accel_std=scatter(still.accel_std))
                for still in found.stills
            ]
            noise = found.noise and replace(found.noise, accel=scatter(found.noise.accel))
            again = LogStills(session.calibrated(log), stills, noise, found.still_s, found.detected)
            if "unused" in found.__dict__:
                again.__dict__["unused"] = found.unused
            other._found.append((log, again))
        return other

    def _change(self, session: Session) -> np.ndarray:
        """(3, 3): what the other calibration makes of a specific force under this one, but for an offset."""
        return np.asarray(session.config.accelerometer.matrix @ np.linalg.inv(self._session.config.accelerometer.matrix))

    def samples(self) -> list[Samples]:
        """Of each log that was looked at."""
        return [found.samples for _, found in self._found]

    def of(self, log: Log) -> LogStills:
        """What is found in a log or closure run of the session: found on first access."""
        for looked_at, found in self._found:
            if looked_at is log:
                return found
        samples, config = self._session.calibrated(log), self._session.config
        stills, noise = find_stills(samples, config.protocol.still_s)
        rows = [row for row in config.still if row.log.removesuffix(".gz") == log.path.name.removesuffix(".gz")]
        where = f"{self._session.folder / 'session.toml'}: [[still]] of {log.path.name}"
        mine = changed_by_hand(samples, stills, noise, rows, where) if rows else stills
        found = LogStills(samples, mine, noise, config.protocol.still_s, stills if rows else None)
        self._found.append((log, found))
        return found
