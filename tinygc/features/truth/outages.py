"""Outages of a truth file: spans in which its attitudes part from the gyroscope's far beyond what the rest of the recording shows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from session.base import rotation
from session.base.numeric import median_length, rms_of, runs_of
from session.base.units import NS
from session.log.folder import Session
from session.log.logfile import Log
from session.log.samples import Samples
from tinygc.features.truth.alignment import AlignedLog, Carried, Spans, align, carried, robust, span_rows
from tinygc.features.truth.reading import Truth, TruthOutage, TruthReading, changed

# How far truth and gyro part: between moments about a tenth of a second apart, in units of what is usual at such a movement.
#
# What the gyro's linear errors and the truth's clock explain is taken off by a fit that outliers hardly move.  What is left is usually
#
#     c_0 + c_1 |rate| + c_2 |change of the rate| / time,
#
# since a truth's errors grow with the movement.  All three are estimated from the recording, by least absolute deviations.

#: s: shorter than an outage of a camera system; over less, the noise of dense moments would hide a slow departure
SPAN_S = 0.1
#: of spans: their scatter is then known to a fifth
FEWEST = 20
#: passes of the reweighted fit
PASSES = 12
#: sigmas of the logarithm of a span's parting above its median: by chance one in 10^6 where the logarithm is normal; and where an outage
#: begins and ends, next to such spans
FAR_SIGMAS, NEAR_SIGMAS = 5.0, 3.0
#: scatter of the logarithm of a vector's length with three normal components: less is not credible
LEAST_SCATTER = 0.45
#: s: spans that are as usual for no longer are inside an outage, since two wrong attitudes may agree with the gyro by chance
PAUSE_S = 0.3
#: spans of an outage between two sound stretches: a single wrong moment has two (``without_wrong_moments`` looks for these)
LEAST_SPANS = 3
#: of all spans: where truth and gyro part in more of the recording, what is usual is unknown
MOST_SHARE = 0.4


def without_outages(session: Session) -> Session:
    """The session with its truths aligned as ``align`` does, by their sound moments alone; each truth holds its outages."""
    aligned = align(session)
    found = [find_outages(log, truth) for log, truth in zip(aligned.logs, aligned.reference.truths, strict=True)]
    if not any(found):
        return aligned
    marked = tuple(replace(truth, outages=outages) for truth, outages in zip(session.reference.truths, found, strict=True))
    sound = align(changed(session, truths=marked))
    # An outage may hide that truth and gyro go together; where they do not even without it, it is none.
    return sound if np.isfinite(sound.reference.alignment.explained) else aligned


@dataclass(frozen=True, eq=False)
class Parting:
    """K spans of a log: rate (K, 3) rad/s by which truth and gyro part; times_usual (K,); truth_rate, gyro_rate (K, 3) rad/s; gyro: the
    log carried by its rates without the linear errors."""

    spans: Spans
    rate: np.ndarray
    times_usual: np.ndarray
    truth_rate: np.ndarray
    gyro_rate: np.ndarray
    gyro: Carried


def find_outages(log: Log, truth: Truth) -> tuple[TruthOutage, ...]:
    """All outages of a truth whose clock and mounting are aligned, in order, without those that are clearly the gyro's."""
    parting = _parting(log.samples, truth)
    if parting is None:
        return ()
    found = [(run, _wrong(log, truth, parting, *run)) for run in _runs(parting.times_usual, parting.spans.begin_s, parting.spans.end_s)]
    found = [(_widened(truth, parting, *run), seen) for run, seen in found]
    size = np.linalg.norm(parting.rate, axis=1)
    # Moments that are in no span go with the outage next to them.
    spans = parting.spans
    begins = np.append(0, np.where(spans.last[:-1] == spans.first[1:], spans.first[1:], spans.last[:-1] + 1))
    ends = np.append(np.where(spans.last[:-1] == spans.first[1:], spans.last[:-1], spans.first[1:] - 1), len(truth) - 1)
    return tuple(
        TruthOutage(
            first=int(begins[start]),
            last=int(ends[stop - 1]),
            from_s=float(parting.spans.begin_s[start]),
            to_s=float(parting.spans.end_s[stop - 1]),
            size_rps=rms_of(size[start:stop]),
            times_usual=float(parting.times_usual[start:stop].max()),
            spans=len(size),
            sure=of_truth,
        )
        for (start, stop), (of_truth, of_gyro) in found
        if not of_gyro
    )


def _parting(samples: Samples, truth: Truth) -> Parting | None:
    gyro = carried(samples, samples.gyro)
    spans = _chain(samples, truth)
    whole = gyro.whole(spans.begin_s, spans.end_s)
    spans = spans.pick(whole)
    if len(spans) < FEWEST:
        return None
    force = np.zeros_like(samples.gyro)
    error, columns, _ = span_rows(AlignedLog(gyro, spans, truth.q_nb, force), gyro, TruthReading())
    duration = (spans.end_s - spans.begin_s)[:, None]
    theta = robust(error / duration, columns / duration[:, :, None])[0].shortest
    rate = (error - columns @ theta) / duration
    dE = -theta[1:10].reshape(3, 3)
    gyro = carried(samples, samples.gyro @ (np.eye(3) + dE).T - theta[10:])
    turned = rotation.log(rotation.multiply(rotation.conjugate(gyro.at(spans.begin_s)), gyro.at(spans.end_s))) / duration
    change = np.linalg.norm(gyro.rate_at(spans.end_s) - gyro.rate_at(spans.begin_s), axis=1)
    size = np.linalg.norm(rate, axis=1)
    usual = _usual(size, np.column_stack([np.ones(len(size)), np.linalg.norm(turned, axis=1), change]))
    return Parting(spans, rate, size / usual, rotation.log(spans.turned(truth.q_nb)) / duration, turned, gyro)


def _chain(samples: Samples, truth: Truth) -> Spans:
    """Spans that follow each other, each as short as the moments allow but no shorter than ``SPAN_S``; none across windows."""
    t_s = (truth.t_ns - samples.t_ns[0]) * NS
    ends, at = [0], 0
    while (at := int(np.searchsorted(t_s, t_s[at] + 0.999 * SPAN_S))) < len(t_s):
        ends.append(at)
    first, last = np.array(ends[:-1], dtype=int), np.array(ends[1:], dtype=int)
    if truth.window is not None:
        kept = truth.window[first] == truth.window[last]
        first, last = first[kept], last[kept]
    return Spans(t_s[first], t_s[last], first, last)


def _usual(size: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(K,) what sizes (K,) usually are by columns (K, P), none of which makes them smaller: least absolute deviations, relative."""
    scale = np.maximum(columns.mean(axis=0), 1e-30)
    design, usual = columns / scale, np.full(len(size), max(float(np.median(size)), 1e-12))
    for _ in range(PASSES):
        weight = 1 / np.sqrt(np.maximum(np.abs(size - usual), 0.05 * usual) * usual)
        found = nnls(design * weight[:, None], size * weight)[0]
        usual = np.maximum(design @ found, 1e-3 * float(np.median(size)) + 1e-15)
    return usual


def _levels(times_usual: np.ndarray) -> tuple[float, float]:
    """Median and scatter of the logarithm."""
    level = np.log(np.maximum(times_usual, 1e-9))
    middle = float(np.median(level))
    return middle, max(1.4826 * float(np.median(np.abs(level - middle))), LEAST_SCATTER)


def _near(times_usual: np.ndarray) -> float:
    """Times of what is usual at which an outage begins and ends."""
    middle, scatter = _levels(times_usual)
    return float(np.exp(middle + NEAR_SIGMAS * scatter))


def _runs(times_usual: np.ndarray, begin_s: np.ndarray, end_s: np.ndarray) -> list[tuple[int, int]]:
    """(start, stop) of the spans of each outage."""
    middle, scatter = _levels(times_usual)
    far, near = (times_usual > np.exp(middle + sigmas * scatter) for sigmas in (FAR_SIGMAS, NEAR_SIGMAS))
    for start, stop in zip(*runs_of(~near), strict=True):
        inside = start > 0 and stop < len(near)
        if inside and end_s[stop - 1] - begin_s[start] <= PAUSE_S:
            near[start:stop] = True
    edge = np.zeros(len(near), dtype=bool)  # next to one, there is no sound stretch that a single wrong moment would join
    gaps = np.flatnonzero(begin_s[1:] > end_s[:-1] + 1e-6)
    edge[[0, len(near) - 1, *gaps, *(gaps + 1)]] = True
    found = []
    for start, stop in zip(*runs_of(near), strict=True):
        count = int(far[start:stop].sum())
        if count >= LEAST_SPANS or (count and edge[start:stop].any()):
            found.append((int(start), int(stop)))
    return found if sum(stop - start for start, stop in found) <= MOST_SHARE * len(near) else []


# Where an outage begins and ends: a truth that freezes while the body is slow parts from the gyro by a small rate, for long.
#
# From the first moment of an outage that parts fast the gyro is carried back.  If that moment was wrong already, all sound ones before it
# are off by one rotation, seen in the world; and likewise after the last one.

#: s that are looked at on either side
REACH_S = 2.0


def _widened(truth: Truth, parting: Parting, start: int, stop: int) -> tuple[int, int]:
    """(start, stop) with the spans on both sides in which the truth is off already, or still."""
    spans = parting.spans
    joined = spans.last[:-1] == spans.first[1:]
    length_s = float(np.median(spans.end_s - spans.begin_s))
    reach = max(1, round(REACH_S / length_s))
    usual_rad = np.linalg.norm(parting.rate, axis=1) / np.maximum(parting.times_usual, 1e-9) * length_s
    near = _near(parting.times_usual)
    low = start
    while low > max(start - reach, 0) and joined[low - 1]:
        low -= 1
    before = _off(truth, parting, spans.first[low : start + 1][::-1], near * float(np.median(usual_rad[low : start + 1])))
    high = stop
    while high < min(stop + reach, len(spans)) and joined[high - 1]:
        high += 1
    after = _off(truth, parting, spans.last[stop - 1 : high], near * float(np.median(usual_rad[stop - 1 : high])))
    return start - before, stop + after


def _off(truth: Truth, parting: Parting, moments: np.ndarray, least_rad: float) -> int:
    """How many moments (M,), beginning with one of an outage, are off; the last third are taken to be sound."""
    if len(moments) < LEAST_SPANS:
        return 0
    apart = _apart(truth, parting, int(moments[0]), moments)
    world = rotation.multiply(rotation.multiply(truth.q_nb[moments], apart), rotation.conjugate(truth.q_nb[moments]))
    off = rotation.log(world)
    sound = np.median(off[-(len(off) // 3) :], axis=0)
    least_rad = least_rad * np.sqrt(len(off) / 2)  # errors of truth and gyro add up on the way
    if np.linalg.norm(sound) < least_rad:
        return 0
    return int(np.argmax(np.linalg.norm(off - sound, axis=1) < least_rad)) or len(moments) - 1


# Whose error a parting is: the truth's or the gyro's.
#
# - The truth comes back to where the gyro has been carried meanwhile: the gyro has been right.  A fault of the gyro stays in its attitude.
# - The accelerometer: gravity, seen in the body, goes with one of the two attitudes.
# - The truth repeats its values while the body turns: it is frozen.
# - One of the two leaps, from span to span, as it does nowhere else in the recording, and the other does not.
# - The gyro stands at its limit, or differs by a constant rate: a step of its bias.

#: share of the largest angle between both by which they differ after an outage of the truth
RETURNS = 0.25
#: sigmas of the accelerometer's answer; s over which the body's own acceleration is independent; fewest moments
FORCE_SIGMAS, FORCE_S = 3.0, 0.25
#: share of the moments that repeat the one before them exactly; and times the share elsewhere
FROZEN = 0.5
#: rad/s: a body that turns faster does not repeat its attitude
TURNS_RPS = 0.1
#: times the largest leap elsewhere, and times the leap of the other there
LEAPS = 1.5
#: share of the parting's mean square that its mean explains
CONSTANT = 0.8
#: a reading stands at its limit where it stays this near to the log's largest for this long: a hand's peak is rounder
LIMIT_SHARE, LIMIT_S = 0.02, 0.1


def _wrong(log: Log, truth: Truth, parting: Parting, start: int, stop: int) -> tuple[bool, bool]:
    """Whether the truth alone is wrong in the spans from start to stop, and whether the gyro alone is.

    What speaks for either is strong or weak; weak witnesses are heard where there are no strong ones.
    """
    returns = _returns(truth, parting, start, stop)
    for_truth, for_gyro = _by_force(log, truth, parting, start, stop)
    leaps_truth, leaps_gyro = _leaps(parting, start, stop)
    frozen = _frozen(truth, parting, start, stop)
    of_truth, of_gyro = returns or for_gyro or frozen, for_truth
    if not (of_truth or of_gyro):
        of_truth, of_gyro = leaps_truth, leaps_gyro or _stands(log.samples, parting, start, stop) or _constant(parting, start, stop)
    return of_truth and not of_gyro, of_gyro and not of_truth


def _apart(truth: Truth, parting: Parting, base: int, moments: np.ndarray) -> np.ndarray:
    """(M, 4) from the attitude that the gyro carries from a moment of the truth to the truth's own, at others."""
    gyro = parting.gyro.at(_times(truth, parting, np.append(moments, base)))
    carried_on = rotation.multiply(truth.q_nb[base], rotation.multiply(rotation.conjugate(gyro[-1]), gyro[:-1]))
    return rotation.multiply(rotation.conjugate(carried_on), truth.q_nb[moments])


def _times(truth: Truth, parting: Parting, moments: np.ndarray) -> np.ndarray:
    """s since the log's first sample."""
    spans = parting.spans
    return spans.begin_s[0] + (truth.t_ns[moments] - truth.t_ns[spans.first[0]]) * NS


def _bounds(parting: Parting, start: int, stop: int) -> tuple[int | None, int | None]:
    """Sound moments before and after, to which the log leads without a gap; None where there is none."""
    spans = parting.spans
    before = start > 0 and spans.last[start - 1] == spans.first[start]
    after = stop < len(spans) and spans.last[stop - 1] == spans.first[stop]
    return int(spans.first[start]) if before else None, int(spans.last[stop - 1]) if after else None


def _returns(truth: Truth, parting: Parting, start: int, stop: int) -> bool:
    before, after = _bounds(parting, start, stop)
    if before is None or after is None:
        return False
    angle = np.linalg.norm(rotation.log(_apart(truth, parting, before, np.arange(before, after + 1))), axis=1)
    return bool(angle[-1] < RETURNS * angle.max())


def _by_force(log: Log, truth: Truth, parting: Parting, start: int, stop: int) -> tuple[bool, bool]:
    """Whether gravity goes with the truth, and whether with the gyro."""
    before, after = _bounds(parting, start, stop)
    base = before if before is not None else after
    accel = log.samples.accel
    if base is None or not np.abs(accel).any():
        return False, False
    spans = parting.spans
    moments = np.arange(spans.first[start], spans.last[stop - 1] + 1)
    inside = np.zeros(len(truth), dtype=bool)
    inside[moments] = True
    row = parting.gyro.nearest(_times(truth, parting, np.arange(len(truth))))[0]
    known = np.abs(accel[row]).sum(axis=1) > 0
    g = median_length(accel[row][known]) if known.any() else 0.0
    up = np.array([0.0, 0.0, -g])
    by_truth = Rotation.from_quat(truth.q_nb, scalar_first=True).inv().apply(up)
    outside = known & ~inside
    if outside.sum() < FEWEST or not known[moments].any():
        return False, False
    noise = rms_of((accel[row] - by_truth)[outside])
    q_gyro = rotation.multiply(truth.q_nb[moments], rotation.conjugate(_apart(truth, parting, base, moments)))
    by_gyro = Rotation.from_quat(q_gyro, scalar_first=True).inv().apply(up)
    use = known[moments]
    way, seen = (by_truth[moments] - by_gyro)[use], (accel[row][moments] - by_gyro)[use]
    square = float(np.mean(np.sum(way**2, axis=1)))
    if square == 0:
        return False, False
    share = float(np.mean(np.sum(way * seen, axis=1))) / square  # 0: gravity goes with the gyro; 1: with the truth
    independent = max(1.0, (spans.end_s[stop - 1] - spans.begin_s[start]) / FORCE_S)
    sigma = noise / np.sqrt(square * independent)
    return share - FORCE_SIGMAS * sigma > 0.5, share + FORCE_SIGMAS * sigma < 0.5


def _frozen(truth: Truth, parting: Parting, start: int, stop: int) -> bool:
    repeats = np.append(False, (truth.q_nb[1:] == truth.q_nb[:-1]).all(axis=1))
    row = parting.gyro.nearest(_times(truth, parting, np.arange(len(truth))))[0]
    turning = np.linalg.norm(parting.gyro.rate[row], axis=1) > TURNS_RPS
    inside = np.zeros(len(truth), dtype=bool)
    inside[parting.spans.first[start] + 1 : parting.spans.last[stop - 1] + 1] = True
    here, elsewhere = repeats[inside & turning], repeats[~inside & turning]
    return bool(len(here) and here.mean() > FROZEN and (not len(elsewhere) or elsewhere.mean() < FROZEN * here.mean()))


def _leaps(parting: Parting, start: int, stop: int) -> tuple[bool, bool]:
    """Whether the truth's rate leaps as nowhere else and the gyro's does not; and the other way round."""
    joined = parting.spans.last[:-1] == parting.spans.first[1:]
    truth, gyro = (np.linalg.norm(np.diff(rate, axis=0), axis=1) * joined for rate in (parting.truth_rate, parting.gyro_rate))
    inside = np.zeros(len(truth), dtype=bool)
    inside[max(start - 1, 0) : stop] = True
    found = []
    for own, other in ((truth, gyro), (gyro, truth)):
        if not inside.any() or inside.all():
            return False, False
        at = int(np.argmax(np.where(inside, own, -1.0)))
        found.append(own[at] > LEAPS * own[~inside].max() and own[at] > LEAPS * other[at])
    return bool(found[0]), bool(found[1])


def _constant(parting: Parting, start: int, stop: int) -> bool:
    rate = parting.rate[start:stop]
    square = float(np.mean(np.sum(rate**2, axis=1)))
    return stop - start >= LEAST_SPANS and float(np.sum(np.mean(rate, axis=0) ** 2)) > CONSTANT * square


def _stands(samples: Samples, parting: Parting, start: int, stop: int) -> bool:
    part = slice(*np.searchsorted(samples.t_s, [parting.spans.begin_s[start], parting.spans.end_s[stop - 1]]))
    least = max(3, round(LIMIT_S / samples.period_s))
    for axis in range(3):
        for sign in (1.0, -1.0):
            readings = sign * samples.gyro[:, axis]
            starts, stops = runs_of(readings[part] > (1 - LIMIT_SHARE) * readings.max())
            if readings.max() > 0 and len(starts) and (stops - starts).max() >= least:
                return True
    return False
