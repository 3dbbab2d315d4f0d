"""When it happened: the moments of what was found in the registers and in the stills, in seconds of the session."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import DEG
from session.log.readings import pieces
from session.log.samples import start_times
from tinygc.effects.occurrence import LEVEL, ROWS, SECONDS, STILLS
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation


@dataclass(frozen=True, eq=False)
class Clipped:
    """Readings (K,) at a level: seconds of the session, and their size, rad/s."""

    t_s: np.ndarray
    magnitude: np.ndarray


def moments_s(e: Explanation, claim: Claim) -> np.ndarray | None:
    """(K,) of an effect that has moments, at least two for a span; None for one that has not."""
    occurs = claim.effect.occurs
    if occurs is None:
        return None
    if occurs.counts == LEVEL:
        return clipped_readings(e, claim).t_s
    if occurs.counts == ROWS:
        return reading_s(e, np.array(claim.parameters[occurs.key], dtype=int))
    if occurs.counts == SECONDS:
        return np.array(claim.parameters[occurs.key], dtype=float)
    if occurs.counts == STILLS:
        began = e.problem.began_s
        spans = [(began[i] + s.start_s, began[i] + s.start_s + s.duration_s) for i, log in enumerate(e.problem.logs) for s in log.stills]
        return np.ravel([spans[number] for number in claim.parameters[occurs.key]])
    raise ValueError(f"{claim.effect.id}: occurs counts {occurs.counts!r}")


def clipped_readings(e: Explanation, claim: Claim) -> Clipped:
    """All readings at the level of a claim that happens there."""
    assert claim.effect.occurs is not None
    key = claim.effect.occurs.key
    level = claim.parameters[key] * DEG
    magnitude = np.concatenate([np.abs(part).max(axis=1) for log in e.session.logs for _, part in pieces(log.samples.gyro)])
    rows = np.flatnonzero(magnitude >= level - claim.std[key] * DEG)
    return Clipped(reading_s(e, rows), magnitude[rows])


def reading_s(e: Explanation, rows: np.ndarray) -> np.ndarray:
    """(K,) of rows that are counted over all logs."""
    logs = [log.samples for log in e.session.logs]
    return np.concatenate([began + samples.t_s for began, samples in zip(start_times(logs)[:-1], logs, strict=True)])[rows]
