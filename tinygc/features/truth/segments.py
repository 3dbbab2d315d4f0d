"""Segments between moments of a truth file, and the rests of a vehicle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.base.errors import DataError
from session.base.numeric import nearest_row, runs_of
from session.base.rotation import unit_vectors
from session.base.units import DEG, NS, NS_PER_S
from session.detect.segments import LONGEST_TURN_SEGMENTS, Segment, why_broken
from session.log.config import Protocol, Sensor
from session.log.samples import Samples
from tinygc.features.truth.reading import Truth

# Rests: phases in which a vehicle stands, though its motors may shake it.
#
# A still (``session/detect/stills.py``) is quiet to the sensor's own noise; a rest need not be: only the means over quarter seconds of
# rate and specific force stay where they are.  Good for a bias, not for a reference.

MOTION_BLOCK_S = 0.25
LEAST_S = 1.5
#: scatter of the blocks' means, one sigma, per axis: a hovering vehicle sways by ten times as much
RATE_RPS = 0.25 * DEG
FORCE_MPS2 = 0.06


def find_rests(samples: Samples) -> list[tuple[slice, np.ndarray]]:
    """Samples and mean rate (3,) of all rests of at least 1.5 s, in order; none has rows whose specific force is exactly zero."""
    size = max(1, round(MOTION_BLOCK_S / samples.period_s))
    count, length = len(samples) // size, round(LEAST_S / MOTION_BLOCK_S)
    if count < length:
        return []
    blocks = [values[: count * size].reshape(count, size, 3) for values in (samples.gyro, samples.accel)]
    steady = np.ones(count - length + 1, dtype=bool)
    for values, bar in zip(blocks, (RATE_RPS, FORCE_MPS2), strict=True):
        windows = np.lib.stride_tricks.sliding_window_view(values.mean(axis=1), length, axis=0)
        steady &= (windows.std(axis=-1, ddof=1) < bar).all(axis=1)
    whole = (np.abs(blocks[1]).sum(axis=2) > 0).all(axis=1)
    steady &= np.lib.stride_tricks.sliding_window_view(whole, length).all(axis=1)
    rest = np.zeros(count, dtype=bool)
    for start in np.flatnonzero(steady):
        rest[start : start + length] = True
    rows = [slice(int(start) * size, int(stop) * size) for start, stop in zip(*runs_of(rest), strict=True)]
    return [(part, samples.gyro[part].mean(axis=0)) for part in rows]


# Segments between moments of a truth file, and the attitudes at their ends.


@dataclass(frozen=True, eq=False)
class TruthEnds:
    """Attitudes (4,) of a segment at its first and last sample, and the moments of the truth they come from."""

    start: np.ndarray
    end: np.ndarray
    first: int
    last: int


def cut_at_truth(
    samples: Samples, truth: Truth, sensor: Sensor, protocol: Protocol, *, log: int = 0, number: int = 0, put_in: np.ndarray | None = None
) -> list[tuple[Segment, TruthEnds]]:
    """Segments between sound moments of the truth, accepted or with the reason why not; ``number`` is given to the first; put_in: as in
    ``cut_segments``.

    Raises DataError where the truth's times are not the log's.
    """
    moments_inside(samples, truth)  # or it is refused
    nearest = nearest_row(samples.t_ns, truth.t_ns)
    there = np.abs(samples.t_ns[nearest] - truth.t_ns) * NS < samples.period_s
    q = _at_samples(samples, truth, nearest)
    segments: list[tuple[Segment, TruthEnds]] = []
    for first, last in _pairs(truth, protocol.segment_s):
        start = int(nearest[first])
        stop = max(int(nearest[last]), start + 1) + 1
        duration_s = float(samples.t_ns[stop - 1] - samples.t_ns[start]) * NS
        missing = None if there[first] and there[last] else "the log has no sample at one of its moments of truth"
        problem = broken = missing or why_broken(samples, slice(start + 1, stop), sensor, put_in)
        if problem is None and duration_s > LONGEST_TURN_SEGMENTS * protocol.segment_s:
            problem = f"{duration_s:.0f} s between moments of truth: too long for a segment"
        rate = np.linalg.norm(samples.gyro[start:stop] - samples.gyro[start:stop].mean(axis=0), axis=1)
        segment = Segment(
            number=number + len(segments),
            log=log,
            first=None,
            last=None,
            start=start,
            stop=stop,
            start_s=float(samples.t_ns[start] - samples.t_ns[0]) * NS,
            duration_s=duration_s,
            turn_s=duration_s,
            turn_deg=float(np.trapezoid(rate, samples.t_s[start:stop])) / DEG,
            problem=problem,
            breaks_yaw=broken is not None,
        )
        segments.append((segment, TruthEnds(q[first], q[last], first, last)))
    return segments


def moments_inside(samples: Samples, truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """Rows (K,) of the log that are nearest to the sound moments within it, and ``q_nb`` (K, 4) there.  DataError where there is none."""
    nearest = nearest_row(samples.t_ns, truth.t_ns)
    inside = truth.sound & (np.abs(samples.t_ns[nearest] - truth.t_ns) * NS < samples.period_s)
    if not inside.any():
        raise DataError(f"{truth.path.name}: none of its {len(truth)} moments lies within the log; are its times on the log's clock?")
    return nearest[inside], _at_samples(samples, truth, nearest)[inside]


def _at_samples(samples: Samples, truth: Truth, nearest: np.ndarray) -> np.ndarray:
    """(K, 4): the truth carried to its nearest sample, at most half a period, with the rate that is read there."""
    late_s = ((samples.t_ns[nearest] - truth.t_ns) * NS).clip(-samples.period_s, samples.period_s)
    half = samples.gyro[nearest] * late_s[:, None] / 2
    w, v = truth.q_nb[:, :1], truth.q_nb[:, 1:]
    q = np.concatenate([w - np.sum(v * half, axis=1, keepdims=True), v + w * half + np.cross(v, half)], axis=1)
    return unit_vectors(q)


def _pairs(truth: Truth, segment_s: float) -> list[tuple[int, int]]:
    """Sound moments (first, last) that bound each segment."""
    sound = np.flatnonzero(truth.sound)
    if truth.window is not None:
        rows = [sound[truth.window[sound] == number] for number in dict.fromkeys(truth.window[sound].tolist())]
        return [(int(row[0]), int(row[-1])) for row in rows if len(row) > 1]
    pairs: list[tuple[int, int]] = []
    t_ns, first = truth.t_ns[sound], 0
    while True:
        # The moment nearest to the protocol's length, but always a later one.
        aim = t_ns[first] + round(segment_s * NS_PER_S)
        last = max(int(np.searchsorted(t_ns, aim)), first + 1)
        if last < len(t_ns) and last - 1 > first and aim - t_ns[last - 1] < t_ns[last] - aim:
            last -= 1
        if last >= len(t_ns):
            return pairs or [(int(sound[0]), int(sound[-1]))]
        pairs.append((int(sound[first]), int(sound[last])))
        first = last
