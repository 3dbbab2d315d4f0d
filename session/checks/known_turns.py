"""Turns of known angle (``turns.csv``) against what the gyro reads of them."""

from __future__ import annotations

import numpy as np

from session.checks.findings import Finding
from session.common.units import DEG
from session.detect.known_turns import FoundTurn, angle_read, contradiction, find_known_turns
from session.detect.segments import Segment, cut_segments
from session.detect.session_stills import SessionStills
from session.log.folder import KNOWN_TURNS, Session
from session.log.samples import Samples

WHAT = "known turn"
#: turns that might have been meant: more than these say nothing
MOST_MEANT = 3


def check_known_turns(session: Session, found: SessionStills) -> list[Finding]:
    """A finding for each turn of ``turns.csv``: the gyro's angle beside the stated one, or why the turn is not used."""
    if not session.turns:
        return []
    samples: list[Samples] = []
    names: list[str] = []
    segments: list[Segment] = []
    for log in session.logs:
        here = found.of(log)
        if here.noise is None:
            continue
        cut = cut_segments(
            here.samples, here.stills, session.config.sensor, session.config.protocol, log=len(samples), number=len(segments)
        )
        samples.append(here.samples)
        names.append(log.path.name)
        segments += cut
    turns = find_known_turns(session.turns, segments, samples, names)
    named = {id(turn.segment) for turn in turns if turn.problem is None}
    free = [segment for segment in segments if segment.accepted and id(segment) not in named]
    reads = [(segment.number, angle_read(samples[segment.log], segment)) for segment in free]
    return [_finding(turn, reads) for turn in turns]


def _finding(turn: FoundTurn, free: list[tuple[int, np.ndarray]]) -> Finding:
    """free: number of each turn that no line names, and what the gyro reads of it, (3,) rad."""
    says = f"{turn.known.name}: {turn.known.says}"
    if turn.problem is None:
        return Finding("ok", KNOWN_TURNS, WHAT, f"{says}; the gyro reads {turn.along_rad / DEG:.2f} deg, uncalibrated")
    meant = [number for number, reads in free if contradiction(turn.known, reads) is None]
    do = "it is not used; turns are counted from 0 as segments are, over all logs or in the log that is named"
    if 0 < len(meant) <= MOST_MEANT:
        do = f"it is not used; such a turn is {' or '.join(map(str, meant))}, counted from 0 over all logs"
    return Finding("warning", KNOWN_TURNS, WHAT, f"{says}: {turn.problem}", do)
