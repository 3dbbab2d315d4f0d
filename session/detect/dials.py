"""Dial readings that are wrong, found by gravity in the same still and by the gyroscope's turns on either side.

A row typed wrongly, repeated or exchanged with another is off by degrees, the others by hundredths.  So each row is held against what the
others are usually off by, and one that is beyond chance is left out.  Gravity sees roll and pitch; yaw is seen by the gyroscope, whose
scale, alignment and mounting are fitted to all turns at once, robustly, so that the wrong rows have no weight in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from session.base import rotation
from session.base.numeric import running_sum
from session.base.rotation import angle_between, identities
from session.base.units import DEG
from session.detect.findings import Finding
from session.detect.segments import APART_RAD, APART_SHARE, LogSegments, Segment, rate_in
from session.detect.stills import Still
from session.log.folder import ATTITUDES, Session
from session.log.samples import Samples

DIAL_ROW, DIAL_TURN = "dial reading", "dials against gyro"
#: the median of the length of two, and of three, normal errors, in their standard deviations
MEDIAN_OF_2, MEDIAN_OF_3 = 1.1774, 1.5382
#: probability that chance alone takes a row out of a session
BY_CHANCE = 1e-3
#: fewer show nothing of a usual row; more wrong rows than this share are another convention of angles, or another numbering
FEWEST, MOST_WRONG = 5, 0.25
#: prior of an uncalibrated gyroscope's scale and alignment, one sigma of each element; and of the sensor's mounting on the table, rad
PRIOR_E, PRIOR_MOUNTING_RAD = 0.05, 5 * DEG
ROUNDS = 30
#: parts of a turn in which its rate counts as constant
BLOCKS = 100


def without_wrong_dials(session: Session, parts: Sequence[LogSegments]) -> tuple[Session, list[LogSegments], list[Finding]]:
    """A session without the dial readings that gravity or the turns contradict, its segments, and what to report of each.

    A turn alone that the dials contradict, while the readings on either side agree with their other turns, is rejected.  A session whose
    reference is not the table, and one with many contradictions, is returned as it is: the first look reports those of gravity; many wrong
    yaws make the usual turn wrong, and only the fit shows them.
    """
    table = session.attitudes
    if table is None or session.config.protocol.reference != "table" or session.reference is not None:
        return session, list(parts), []
    stills = [still for part in parts for still in part.stills]
    known = np.array([i < len(table) and bool(np.isfinite(table[i]).all()) and still.problem is None for i, still in enumerate(stills)])
    dial_rad = session.config.protocol.dial_sigma_deg * DEG
    wrong = _against_gravity(table, stills, known, dial_rad)
    known[list(wrong)] = False
    by_turns, turns = _against_turns(table, stills, known, parts, dial_rad)
    wrong |= by_turns
    if len(wrong) > max(2, MOST_WRONG * len(stills)):
        return session, list(parts), []
    findings = []
    table = table.copy()
    for still, text in sorted(wrong.items()):
        table[still] = np.nan
        line = session.attitude_lines[still] if still < len(session.attitude_lines) else None
        where = ATTITUDES if line is None else f"{ATTITUDES} line {line}"
        findings.append(Finding("warning", where, DIAL_ROW, f"still {still}: {text}: left out", "correct or remove that row"))
    for segment, text in turns.items():
        findings.append(Finding("warning", ATTITUDES, DIAL_TURN, f"turn {segment}: {text}: left out", "were samples lost in it?"))
    kept = []
    for part in parts:
        segments = [replace(s, problem=turns[s.number], breaks_yaw=True) if s.number in turns and s.accepted else s for s in part.segments]
        kept.append(replace(part, segments=segments))
    return replace(session, attitudes=table), kept, findings


def down_of_dials(angles: np.ndarray) -> np.ndarray:
    """(…, 3) unit: down in the sensor, of roll, pitch, yaw (…, 3) rad."""
    roll, pitch, _ = np.moveaxis(angles, -1, 0)
    return np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)], axis=-1)


def _against_gravity(table: np.ndarray, stills: Sequence[Still], known: np.ndarray, dial_rad: float) -> dict[int, str]:
    """Rows that gravity contradicts, by the number of their still over all logs, and how."""
    rows = np.flatnonzero(known)
    if len(rows) < FEWEST:
        return {}
    apart = angle_between(down_of_dials(table[rows]), np.array([-stills[i].accel_mean for i in rows.tolist()]))
    usual = float(np.median(apart))
    sigma = max(usual / MEDIAN_OF_2, dial_rad)
    limit = sigma * np.sqrt(2 * np.log(len(rows) / BY_CHANCE))
    return {
        int(row): f"its down differs from gravity's by {angle / DEG:.2f}° (the usual row by {usual / DEG:.2f}°)"
        for row, angle in zip(rows, apart, strict=True)
        if angle > limit
    }


def _against_turns(
    table: np.ndarray, stills: Sequence[Still], known: np.ndarray, parts: Sequence[LogSegments], dial_rad: float
) -> tuple[dict[int, str], dict[int, str]]:
    """Rows whose turns on either side miss them, and turns that alone are missed, by their numbers."""
    number = {id(still): i for i, still in enumerate(stills)}
    found: list[tuple[Segment, Samples, int, int]] = []
    for part in parts:
        for segment in part.segments:
            before, after = (number[id(still)] for still in segment.stills)
            if segment.accepted and known[before] and known[after]:
                found.append((segment, part.found.samples, before, after))
    if len(found) < FEWEST:
        return {}, {}
    missed, usual = _missed(
        np.array([_blocks(samples, segment) for segment, samples, _, _ in found]),
        rotation.from_euler(*table[[first for _, _, first, _ in found]].T),
        rotation.from_euler(*table[[last for _, _, _, last in found]].T),
        dial_rad,
    )
    sigma = max(usual / MEDIAN_OF_3, np.sqrt(2) * dial_rad)
    beyond = missed > sigma * (np.sqrt(2 * np.log(len(found) / BY_CHANCE)) + 1)
    sides: dict[int, list[int]] = {}
    for i, (_, _, first, last) in enumerate(found):
        for still in (first, last):
            sides.setdefault(still, []).append(i)
    both = {still for still, mine in sides.items() if len(mine) > 1 and beyond[mine].all()}
    rows, turns, than = set(both), {}, f"the usual turn by {usual / DEG:.2f}°"
    for i in np.flatnonzero(beyond).tolist():
        segment, _, first, last = found[i]
        if {first, last} & both:
            continue
        # At an end of the session, or next to a row that is out already, a reading has one turn only.
        single = [still for still in (first, last) if len(sides[still]) == 1]
        if len(single) == 1:
            rows.add(single[0])
        elif missed[i] > APART_RAD + APART_SHARE * segment.turn_deg * DEG:
            turns[segment.number] = f"the dials turn by {missed[i] / DEG:.1f}° otherwise than the gyro ({than})"
    return {still: f"the gyro's turns around it miss it by {missed[sides[still]].min() / DEG:.2f}° ({than})" for still in rows}, turns


def _missed(turn: np.ndarray, first: np.ndarray, last: np.ndarray, dial_rad: float) -> tuple[np.ndarray, float]:
    """What the dials' turns differ from the gyroscope's by, (S,) rad, and the median of that.

    turn (S, B, 3) rad: rotation vectors of consecutive parts; first, last (S, 4): body to table by the dials.  The gyroscope's scale and
    alignment and a constant mounting are fitted by least squares with Cauchy weights, whose scale is the median residual's.
    """
    count, size, _ = turn.shape
    q = rotation.exp(turn)
    step = rotation.matrix(q)
    after, design = identities(count), np.zeros((count, 3, 3, 3))
    for b in reversed(range(size)):  # after: from the part's end to the turn's
        design += np.einsum("sij,sk->sijk", after.transpose(0, 2, 1), turn[:, b])
        after = step[:, b] @ after
    turned = rotation.multiply(rotation.conjugate(first), last)
    apart = rotation.log(rotation.multiply(rotation.conjugate(rotation.compose(q)), turned))
    columns = np.concatenate([design.reshape(count, 3, 9), np.eye(3) - after.transpose(0, 2, 1)], axis=2)
    prior = np.diag([PRIOR_E**-2.0] * 9 + [PRIOR_MOUNTING_RAD**-2.0] * 3)
    x = np.zeros(12)
    for _ in range(ROUNDS):
        left = np.linalg.norm(apart - columns @ x, axis=1)
        scale = max(float(np.median(left)) / MEDIAN_OF_3, dial_rad)
        weight = 1 / (scale**2 + left**2)
        hessian = np.einsum("sip,s,siq->pq", columns, weight, columns) + prior
        x = np.linalg.solve(hessian, np.einsum("sip,s,si->p", columns, weight, apart))
    left = np.linalg.norm(apart - columns @ x, axis=1)
    return left, float(np.median(left))


def _blocks(samples: Samples, segment: Segment) -> np.ndarray:
    """(B, 3) rad: the rotation by the measured rate in equal parts of a segment, the bias of its stills taken off."""
    t_s, rate = rate_in(samples, segment)
    angle = running_sum((rate[1:] + rate[:-1]) / 2 * np.diff(t_s)[:, None])
    edges = np.linspace(0, t_s[-1], BLOCKS + 1)
    return np.diff(np.stack([np.interp(edges, t_s, angle[:, i]) for i in range(3)], axis=1), axis=0)
