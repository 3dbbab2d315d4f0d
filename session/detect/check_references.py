"""Checks of the references: dials, known turns, the accelerometer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from session.base.rotation import angle_between
from session.base.texts import significant
from session.base.units import DEG, MG
from session.detect.accelerometer import SCALES, LengthFit, ZeroDrift, fit_lengths, force_of, times_of, why_not
from session.detect.dials import down_of_dials
from session.detect.findings import Finding
from session.detect.segments import FoundTurn, LogSegments, angle_read, contradiction
from session.detect.stills import SessionStills, references
from session.log.config import Sensor
from session.log.folder import ATTITUDES, Session
from session.log.logfile import NAME

# Dial readings against gravity: both show which way is down in the sensor.

DIALS = "dials against gravity"
#: a table that stands askew, or a sensor screwed on askew, by more is another convention of angles
ASKEW_DEG = 10.0
#: from there on, down is up
UPSIDE_DOWN_DEG = 150.0


def check_dials(session: Session, found: SessionStills) -> list[Finding]:
    """The angle between the dials' down and the accelerometer's, median and largest over the stills.  Nothing without dial readings."""
    if session.attitudes is None or session.config.protocol.reference != "table" or session.reference is not None:
        return []
    stills = [still for log in session.logs for still in found.of(log).stills]
    rows = [i for i, still in enumerate(stills[: len(session.attitudes)]) if still.problem is None and still.gravity_mps2 > 0]
    rows = [i for i in rows if np.isfinite(session.attitudes[i]).all()]
    if not rows:
        return []
    apart = np.degrees(angle_between(down_of_dials(session.attitudes[rows]), np.array([-stills[i].accel_mean for i in rows])))
    text = f"down differs by {np.median(apart):.2f}° (median of {len(rows)} stills), {apart.max():.2f}° at most (bar {ASKEW_DEG:g}°)"
    if np.median(apart) > UPSIDE_DOWN_DEG:
        do = "all three axes of the accelerometer have the wrong sign, or the dials count z up: roll 0 is the sensor's z down, reading -1 g"
        return [Finding("error", ATTITUDES, DIALS, f"{text}: upside down", do)]
    if np.median(apart) > ASKEW_DEG:
        do = "are the angles roll, pitch, yaw of R = Rz Ry Rx, in degrees, and is each row of the right still?"
        return [Finding("warning", ATTITUDES, DIALS, text, do)]
    return [Finding("ok", ATTITUDES, DIALS, text)]


# Turns of known angle (``turns.csv``) against what the gyro reads of them.

KNOWN_TURN = "known turn"
#: turns that might have been meant: more than these show nothing
MOST_MEANT = 3


def check_known_turns(turns: Sequence[FoundTurn], parts: Sequence[LogSegments]) -> list[Finding]:
    """A finding for each turn of ``turns.csv``: the gyro's angle next to the stated one, or why the turn is not used."""
    named = {id(turn.segment) for turn in turns if turn.problem is None}
    free = [(part, s) for part in parts for s in part.segments if s.accepted and id(s) not in named] if turns else []
    reads = [(segment.number, angle_read(part.found.samples, segment)) for part, segment in free]
    return [_finding(turn, reads) for turn in turns]


def _finding(turn: FoundTurn, free: list[tuple[int, np.ndarray]]) -> Finding:
    """free: number of each turn that no line names, and what the gyro reads of it, (3,) rad."""
    text = f"{turn.known.name}: {turn.known.description}"
    if turn.problem is None:
        return Finding("ok", NAME, KNOWN_TURN, f"{text}; the gyro reads {turn.along_rad / DEG:.2f} deg, uncalibrated")
    meant = [number for number, reads in free if contradiction(turn.known, reads) is None]
    do = "it is not used; turns are counted from 0 as segments are, over all logs or in the log that is named"
    if 0 < len(meant) <= MOST_MEANT:
        do = f"it is not used; such a turn is {' or '.join(map(str, meant))}, counted from 0 over all logs"
    return Finding("warning", NAME, KNOWN_TURN, f"{text}: {turn.problem}", do)


# An uncalibrated accelerometer: the session's own stills calibrate it.

SESSION_FILE, ACCELEROMETER = "session.toml", "accelerometer"
#: a zero that moves within the session
ZERO_DRIFT = "accelerometer's zero"
#: one that no good part has; mg, where the sensor's data sheet is not known: the largest that one of docs/sensors.md allows; sigmas of 95 %
FAR_ZERO, USUAL_ZERO_MG, WITHIN = "accelerometer's zero-g level", 80.0, 1.96
#: of gravity: a sensor whose lengths are farther off has another unit or full scale, not another sensitivity
UNITS_RIGHT = 0.2


def own_fit(session: Session, known: SessionStills | None = None) -> LengthFit | None:
    """What the stills of a session give, as a correction of what its session.toml does; None where its readings are not gravity's.

    known: the session's stills, where they were found before.
    """
    known = known or SessionStills(session)
    logs = [known.of(log) for log in session.logs]
    stills, site = [references(log.stills) for log in logs], session.config.site
    force = force_of([still for log in stills for still in log])
    if not len(force):
        return None
    white = [np.mean(log.noise.velocity_random_walk**2) / still.duration_s for log in logs if log.noise for still in references(log.stills)]
    white_mps2 = float(np.sqrt(np.mean(white or 0.0)))
    times = times_of(stills, [log.samples for log in session.logs])
    found = fit_lengths(force, site.expected_gravity_mps2, session.config.accelerometer, site.gravity_sigma_mps2, white_mps2, *times)
    # A zero of half a g moves the lengths by as much; what is wrong with the units shows in the scale.
    length = np.median(np.linalg.norm(force, axis=1)) / site.expected_gravity_mps2 if found.rung is None else np.mean(found.x[SCALES])
    return found if abs(length - 1) < UNITS_RIGHT else None


def with_own_accelerometer(session: Session, refit: bool = False, looked_at: SessionStills | None = None) -> tuple[Session, list[Finding]]:
    """A session whose ``session.toml`` has no ``[accelerometer]``, with the one that its stills give, and what to report of it.

    refit: also where it has one, which then only defines the body frame.  Otherwise such a session is returned as it is; so is one that
    has another reference, and one whose stills fix no number.  known: its stills, where they were found before.
    """
    config = session.config
    none = config.accelerometer.source == "none"
    if not (none or refit) or session.reference is not None:
        return session, []
    own = own_fit(session, looked_at)
    if own is None:
        return session, []  # the first look reports what is wrong
    given, known = "none is given", "give [accelerometer] where it is known better"
    if not none:
        given = "the one that is given is not used" + (", being of these stills itself" if config.accelerometer.own_stills else "")
        known = "calibrate the accelerometer again where it is to be known better"
    if own.rung is None:
        do = f"its errors become the gyroscope's; rest it on more sides, or {known}"
        return session, [Finding("warning", SESSION_FILE, ACCELEROMETER, f"{given}, but {why_not(own)}", do)]
    text = (
        f"{given}: {own.rung.description} from {len(own.before)} stills in {own.attitudes} attitudes "
        f"(gravity's spread {spread_mg(own.before):.2f} mg before, {spread_mg(own.after):.2f} mg after)"
    )
    level, do = "note", "OK as it is; a certificate's numbers, where there are any, go into [accelerometer]"
    if own.unobserved:
        level, text = "warning", f"{text}; not observable: {', '.join(own.unobserved)}"
        do = f"rest it on edges and corners, too, or {known}"
    found = [Finding(level, SESSION_FILE, ACCELEROMETER, text, do), *_check_zero(own, config.sensor), *drift_finding(own.drift)]
    if config.site.gravity_mps2 is None:
        text = "standard gravity is taken, so that the accelerometer's scale is known to 0.2 %"
        found.append(Finding("note", SESSION_FILE, "site.gravity_mps2", text, "optional: local gravity, to 0.001 m/s²"))
    return replace(session, config=replace(config, accelerometer=own.accelerometer)), found


def _check_zero(own: LengthFit, sensor: Sensor) -> list[Finding]:
    """The accelerometer's zero against the greatest that its data sheet allows, or that of any such sensor; nothing within it (95 %)."""
    name, bar = sensor.typical("accel_zero_mg") or ("MEMS accelerometers", USUAL_ZERO_MG)
    value, sigma = (each / MG for each in own.zero)
    if np.all(np.abs(value) - WITHIN * sigma <= bar):
        return []
    shown = ", ".join(f"{each:+.1f} ± {significant(s, 1)}" for each, s in zip(value, sigma, strict=True))
    do = "a calibration removes it; a unit that far off is worth a look, or the units and the mounting of its axes"
    return [Finding("warning", SESSION_FILE, FAR_ZERO, f"{shown} mg, bar {bar:g} ({name})", do)]


def drift_finding(drift: ZeroDrift | None) -> list[Finding]:
    """What to report of a significant drift; nothing of another."""
    if drift is None or not drift.significant:
        return []
    do = "it is fitted with the rest, which else would take it for nonorthogonality; let the sensor warm up before the first still"
    return [Finding("warning", SESSION_FILE, ZERO_DRIFT, drift.words, do)]


def spread_mg(misses: np.ndarray) -> float:
    """mg: how far lengths that miss gravity's by misses (S,) m/s^2 lie apart."""
    return float(np.std(misses)) / MG
