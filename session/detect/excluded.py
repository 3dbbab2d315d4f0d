"""Turns that ``session.toml`` leaves out: each is found again by a moment in which it moved, whatever its number is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from session.common.units import NS
from session.detect.segments import Segment
from session.log.config import LeftOut
from session.log.samples import Samples

EXCLUDED = "left out in session.toml"


def without_excluded(segments: list[Segment], samples: Samples, log: Path, rows: Sequence[LeftOut]) -> list[Segment]:
    """The segments of one log; those that hold one of its moments have a problem."""
    moments = moments_of(log, rows)
    return [replace(s, problem=EXCLUDED) if any(moved_at(s, samples, at_s) for at_s in moments) else s for s in segments]


def moments_of(log: Path, rows: Sequence[LeftOut]) -> list[float]:
    """Of one log, packed or not, s of its clock."""
    return [row.at_s for row in rows if row.log.removesuffix(".gz") == log.name.removesuffix(".gz")]


def moved_at(segment: Segment, samples: Samples, at_s: float) -> bool:
    """Whether a moment of the samples' clock lies between its two stills; in all of it where it lies between moments of a truth file."""
    start, stop = segment.start, segment.stop - 1
    if segment.first is not None and segment.last is not None:
        start, stop = segment.first.stop - 1, segment.last.start
    return bool(samples.t_ns[start] * NS <= at_s <= samples.t_ns[stop] * NS)
