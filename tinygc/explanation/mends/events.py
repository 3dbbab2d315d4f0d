"""What the registers propose: moments at which readings may be false, or samples missing.  Each is a claim that closure decides."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.detect import interpolation
from session.detect.bridges import GAP
from session.log.folder import Session
from session.log.samples import Samples
from tinygc.explanation.mends import lost_samples
from tinygc.explanation.mends.false_readings import Glitches, find_glitches, without_glitches

FALSE, LOST = "data.glitches", "timing.dropped_samples"


@dataclass(frozen=True)
class Event:
    """id, ``FALSE`` or ``LOST``; log; row of the first false reading, or after which samples may be missing; samples that are false; accel:
    whether the accelerometer's are false, too, as in rows that no sensor gives."""

    id: str
    log: int
    row: int
    samples: int = 0
    accel: bool = False


def proposed(session: Session) -> list[Event]:
    """False readings of every log, then losses in what is left with these bridged."""
    events: list[Event] = []
    for number, log in enumerate(session.logs):
        samples = log.samples
        if (glitches := find_glitches(samples)) is not None:
            columns = zip(glitches.rows.tolist(), glitches.samples.tolist(), glitches.accel.tolist(), strict=True)
            events += [Event(FALSE, number, row, count, accel) for row, count, accel in columns]
            samples = without_glitches(samples, glitches)
        samples = session.calibrated(replace(log, samples=samples))
        losses = lost_samples.possible_losses(lost_samples.find_jumps(samples), samples.duration_s)
        events += [Event(LOST, number, row) for row in losses.tolist()]
    return [event for event in events if not _in_bridge(session, event)]


def _in_bridge(session: Session, event: Event) -> bool:
    """Whether an event is where readings were put in: what looks wrong there is no reading's, and the stamps have told the loss."""
    first, last = event.row, event.row + max(event.samples, 1)
    bridges = session.logs[event.log].bridges
    gaps = [each for each in bridges if each.what == GAP]
    return any(first <= each.row + each.count + interpolation.SIDE and last >= each.row - interpolation.SIDE for each in gaps)


def bridged(session: Session, events: list[Event]) -> Session:
    """The session with false readings replaced by what their neighbours say; losses are left as they are."""
    logs = []
    for number, log in enumerate(session.logs):
        mine = [event for event in events if event.id == FALSE and event.log == number]
        if mine:
            rows, counts, accel = (np.array([getattr(e, name) for e in mine]) for name in ("row", "samples", "accel"))
            log = replace(log, samples=without_glitches(log.samples, Glitches(rows, counts, accel)))
        logs.append(log)
    return replace(session, logs=tuple(logs))


@dataclass(frozen=True)
class Crossing:
    """How a gap is crossed: order of the polynomial, and the rotation, rad rms per axis, that it misses."""

    order: int
    missed_rad: float


def crossing(samples: Samples, event: Event, length: int) -> Crossing:
    """Of an event; length: how many samples each loss has, where it is one."""
    return Crossing(*interpolation.best_order(samples, np.array([event.row]), event.samples or max(length, 1)))
