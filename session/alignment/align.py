"""A session's truth files, read as session.toml says, or else as the recording asks for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from session.alignment.clock import STEP_S, rough_offset
from session.alignment.fine import Fine, refined
from session.alignment.frames import Seen, Way, best_way, frame_of, ways
from session.alignment.spans import Spans, all_spans, carried
from session.common.units import DEG
from session.log.folder import Session
from session.log.truth_reading import ASSUMED, FOUND, GIVEN, TruthAlignment, TruthGiven, TruthReading

#: an offset is taken off where it is as sure as this: of ten EuRoC sequences, whose clocks their authors have aligned, one shows 5.0 and
#: the others 3.0 at most, errors of truth and gyro that go along with the movement (benchmarks/truth_alignment.py)
OFFSET_SIGMAS = 6.0
#: a rotation that is larger is no gyro's misalignment: 2 % of cross-axis sensitivity, the most that data sheets of MEMS sensors allow,
#: about each of three axes; what is less stays in the gyro's matrix
MOUNTING_RAD, MOUNTING_SIGMAS = 2.0 * DEG, 5.0
#: of the truth's rotations, or they are not this gyro's
EXPLAINED = 0.5
FEWEST_SPANS = 10
#: for the search of the clock: what it costs grows with them, and its peak is as wide as a turn
ROUGH_SPANS = 600


def align(session: Session) -> Session:
    """The session with its truths read anew where nothing was given and the recording asks for it; ``alignment`` says how.

    Sessions without a truth, or aligned before, are returned as they are; so is a truth that does not go with the gyro at all.
    """
    if session.truths is None or session.alignment is not None:
        return session
    given = session.config.truth
    told = TruthReading.of(given)
    alignment = _alignment(session, given, told)
    truths = tuple(truth.reread(told, alignment.reading) for truth in session.truths)
    return replace(session, truths=truths, alignment=alignment)


def _alignment(session: Session, given: TruthGiven, told: TruthReading) -> TruthAlignment:
    source = {name: ASSUMED if value is None else GIVEN for name, value in vars(given).items()}
    if any(len(log.samples) < 3 for log in session.logs):
        return _unknown(told, source)
    seen = _seen(session, told)
    if sum(len(one.spans) for one in seen) < FEWEST_SPANS:
        return _unknown(told, source)
    turns = [(one.spans, one.spans.turned(told.read(one.written))) for one in seen]
    rough = rough_offset([one.gyro for one in seen], [_fewer(*pair) for pair in turns], told.offset_s)
    if rough is None:
        return _unknown(told, source)
    # What is given is finer than the search, unless the recording contradicts it.
    start = told.offset_s if abs(rough - told.offset_s) < 1.5 * STEP_S and given.offset_s is not None else rough
    way = best_way(ways(seen, given, start))
    if 1 - way.misfit < EXPLAINED:
        return _unknown(told, source)
    fine = refined(seen, [log.samples for log in session.logs], way.reading)
    return _taken(given, told, source, way, fine)


def _seen(session: Session, told: TruthReading) -> list[Seen]:
    """Spans at the truth's own stamps, and its cells as they are written."""
    found = []
    for log, truth, spans in zip(session.logs, session.truths or (), all_spans(session), strict=True):
        own = replace(spans, begin_s=spans.begin_s - told.offset_s, end_s=spans.end_s - told.offset_s)
        force = session.config.accelerometer.correct(log.samples.accel)
        force = np.where(np.abs(log.samples.accel).sum(axis=1, keepdims=True) > 0, force, 0.0)
        found.append(Seen(carried(log.samples, log.samples.gyro), own, told.written(truth.q_nb), force))
    return found


def _fewer(spans: Spans, turned: np.ndarray) -> tuple[Spans, np.ndarray]:
    every = -(-len(spans) // ROUGH_SPANS) or 1
    picked = slice(None, None, every)
    return Spans(spans.begin_s[picked], spans.end_s[picked], spans.first[picked], spans.last[picked]), turned[picked]


def _unknown(told: TruthReading, source: dict[str, str]) -> TruthAlignment:
    nothing = np.full(3, np.nan)
    return TruthAlignment(told, source, float("nan"), float("nan"), nothing, nothing, None, float("nan"))


def _taken(given: TruthGiven, told: TruthReading, source: dict[str, str], way: Way, fine: Fine | None) -> TruthAlignment:
    """What of a way, and of what was found out finely, is taken; the rest stays as it was told."""
    source, reading = dict(source), replace(way.reading, mounting=told.mounting, offset_s=told.offset_s)
    for name in ("order", "sense"):
        if getattr(given, name) is None and getattr(reading, name) != getattr(told, name):
            source[name] = FOUND
    frame = frame_of(way)
    if given.frame is None and frame is not None:
        source["frame"] = FOUND
        reading = replace(reading, frame=frame)
    mounting, sigma = (way.reading.mounting, np.full(3, np.nan)) if fine is None else (fine.mounting, fine.mounting_sigma)
    offset_s, offset_sigma_s = (way.reading.offset_s, float("nan")) if fine is None else (fine.offset_s, fine.offset_sigma_s)
    turned = Rotation.from_matrix(mounting).as_rotvec()
    if given.mounting is None and np.linalg.norm(turned) > MOUNTING_RAD and _sure(turned, sigma, MOUNTING_SIGMAS):
        source["mounting"] = FOUND
        reading = replace(reading, mounting=mounting)
    if given.offset_s is None and _sure(np.array([offset_s]), np.array([offset_sigma_s]), OFFSET_SIGMAS):
        source["offset_s"] = FOUND
        reading = replace(reading, offset_s=offset_s)
    return TruthAlignment(reading, source, offset_s, offset_sigma_s, turned, sigma, way.up, 1 - way.misfit)


def _sure(values: np.ndarray, sigma: np.ndarray, sigmas: float) -> bool:
    """Whether they differ from zero by so many sigmas; where no sigma is known, whether they do at all in what is known roughly."""
    return bool(np.linalg.norm(values / sigma) > sigmas) if np.isfinite(sigma).all() else bool(values.any())
