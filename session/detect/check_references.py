"""Checks of the references: truth file, its alignment, dials, known turns, the accelerometer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from session.base.errors import CalibrationError
from session.base.numeric import rms_of
from session.base.rotation import angle_between
from session.base.units import DEG, MG
from session.detect.accelerometer import SCALES, LengthFit, ZeroDrift, fit_lengths, force_of, times_of, why_not
from session.detect.dials import down_of_dials
from session.detect.findings import Finding, axes_text, xyz_text
from session.detect.segments import FoundTurn, LogSegments, Segment, angle_read, contradiction
from session.detect.stills import SessionStills, references
from session.detect.truth_segments import cut_at_truth
from session.log.config import FOUND, GIVEN, Config, Sensor, TruthAlignment, TruthGiven, down_of
from session.log.folder import Session
from session.log.logfile import NAME, Log, Truth, TruthOutage

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


# Check of a truth file: its rotations must be the ones that the gyro's rates make.

EXPLAINED = 0.5  #: of the truth's rotations, or they are not this gyro's
MOST_SEGMENTS = 200
SHORT_S = 10.0  #: over more, a bias of some dps turns so far that it is no longer a small correction
LEAST_DEG = 1.0


def check_truth(log: Log, truth: Truth, config: Config, limited: bool = False) -> list[Finding]:
    """The rotations between moments of truth, against the gyro's, a constant bias taken off; limited: whether a ceiling of the gyro, which
    another finding names, is the reason of what they miss."""
    where = truth.path.name
    try:
        cut = cut_at_truth(log.samples, truth, config.sensor, config.protocol)
    except CalibrationError as error:
        return [Finding("error", where, "truth", str(error))]
    good = [(segment, ends) for segment, ends in cut if segment.accepted]
    says = f"{len(truth)} moments, {len(good)} of {len(cut)} segments whole"
    if not good:
        return [Finding("error", where, "truth", f"{says}: {cut[0][0].problem}", "is the truth of this log?")]
    findings = [Finding("ok", where, "truth", says)]
    picked = good[:: -(-len(good) // MOST_SEGMENTS)]
    if float(np.median([segment.duration_s for segment, _ in picked])) > SHORT_S:
        return findings
    from scipy.spatial.transform import Rotation

    gyro = Rotation.from_quat(np.array([_integrated(log, segment) for segment, _ in picked]), scalar_first=True)
    start, end = (Rotation.from_quat(np.array([getattr(ends, name) for _, ends in picked]), scalar_first=True) for name in ("start", "end"))
    duration = np.array([segment.duration_s for segment, _ in picked])[:, None]
    turned = start.inv() * end
    size = rms_of(turned.magnitude()) / DEG
    if size < LEAST_DEG:
        return [*findings, Finding("note", where, "gyro against truth", f"hardly turned ({size:.1f} deg): it cannot test the gyro")]
    misfit, bias = _misfit(gyro, turned, duration)
    says = f"segments of {size:.0f} deg, explained to {1 - misfit:.1%} (bar {EXPLAINED:.0%}) with a bias of {xyz_text(bias / DEG)} dps"
    if misfit <= 1 - EXPLAINED:
        return [*findings, Finding("ok", where, "gyro against truth", says)]
    inverse, _ = _misfit(gyro, start * end.inv(), duration)
    hint = (
        "the inverse explains it: write q_nb, body to navigation frame"
        if inverse < 0.5 * misfit
        else "the gyro's ceiling is the reason"
        if limited
        else "are axes, units and clocks the same?"
    )
    return [*findings, Finding("error", where, "gyro against truth", says, hint)]


def _misfit(gyro: Rotation, turned: Rotation, duration: np.ndarray) -> tuple[float, np.ndarray]:
    """Share of the truth's squared rotation that the gyro leaves, and the bias (3,) rad/s that was taken off."""
    error = (turned.inv() * gyro).as_rotvec()
    bias = np.median(error / duration, axis=0)
    return float(np.sum((error - bias * duration) ** 2) / np.sum(turned.magnitude() ** 2)), bias


def _integrated(log: Log, segment: Segment) -> np.ndarray:
    """Quaternion (4,) of a segment's rotation by the measured rate."""
    part = log.samples.between(segment.start, segment.stop)
    from scipy.spatial.transform import Rotation

    steps = Rotation.from_rotvec((part.gyro[1:] + part.gyro[:-1]) / 2 * part.dt_s[:, None])
    while len(steps) > 1:
        even = len(steps) // 2 * 2
        product = steps[0:even:2] * steps[1:even:2]
        steps = product if even == len(steps) else Rotation.concatenate([product, steps[even:]])
    return steps.as_quat(scalar_first=True).reshape(4)


# A truth file whose clock, frame or mounting departs from docs/formats.md: it is estimated, corrected and reported.

CLOCK, FRAME, ATTITUDE, MOUNTING = "truth's clock", "truth's frame", "truth's attitudes", "truth's mounting"
OUTAGE, CEILING = "truth's outages", "gyro ceiling"
#: what fit and explain say as well, where it is more than ok
SAID = (CLOCK, FRAME, ATTITUDE, MOUNTING, OUTAGE)
MS = 1e-3
#: of the world's up from the nearest axis: an accelerometer's zero-g offset of 35 mg, more than data sheets of MEMS sensors allow but few
TILTED_DEG = 2.0
WORLDS = {"ned": "z down", "enu": "z up", "y_up": "y up", "y_down": "y down", "x_up": "x up", "x_down": "x down"}


def with_aligned_truth(session: Session) -> tuple[Session, list[Finding]]:
    """A session whose truth files are read as the recording shows, where ``[truth]`` does not state it, and the findings.

    A session without a truth is returned as it is.  So is one whose truth does not go with its gyro: the first look says that.
    """
    if session.truths is None:
        return session, []
    from session.detect.truth_outages import without_outages  # whose SciPy no session without a truth waits for

    aligned = without_outages(session)
    alignment = aligned.alignment
    assert alignment is not None  # ``without_outages`` gives one to every session with a truth
    where = session.truths[0].path.name if len(session.truths) == 1 else "truth files"
    given = session.config.truth
    findings = [_clock(alignment), *_attitude(alignment), _frame(alignment, given), _mounting(alignment, given)]
    findings += _ceiling(session, alignment)
    findings += [_outage(truth, outage) for truth in aligned.truths or () for outage in truth.outages]
    return aligned, [Finding(level, where, what, says, do) for level, what, says, do in findings if what]


def frame_text(alignment: TruthAlignment) -> str:
    """The truth's world and how its quaternions are written, each with where that is from."""
    reading, source = alignment.reading, alignment.source
    parts = [f"world with {WORLDS[reading.frame]} ({source['frame']})"]
    if reading.sense != "body_to_world":
        parts.append(f"quaternions from the world to the body ({source['sense']})")
    if reading.order != "wxyz":
        parts.append(f"scalar last ({source['order']})")
    return "; ".join(parts)


def offset_text(alignment: TruthAlignment) -> str:
    """The truth's clock against the gyro's, and what was made of it."""
    used = alignment.reading.offset_s / MS
    seen = _offset_seen(alignment)
    if alignment.source["offset_s"] == GIVEN:
        return f"{used:+.2f} ms as given; the recording shows {seen}"
    return f"{seen}, added to its stamps" if alignment.source["offset_s"] == FOUND else f"{seen}: left as it is"


def mounting_text(alignment: TruthAlignment) -> str:
    """The rotation from the gyro's axes to the truth's body, and what was made of it."""
    seen = _turned_seen(alignment)
    made = {GIVEN: "", FOUND: ", taken off"}.get(alignment.source["mounting"], ", left in E")
    return seen + made


def _offset_seen(alignment: TruthAlignment) -> str:
    if not np.isfinite(alignment.offset_s):
        return "not known"
    if not np.isfinite(alignment.offset_sigma_s):
        return f"{alignment.offset_s / MS:+.0f} ms, roughly"
    return f"{alignment.offset_s / MS:+.2f} ± {alignment.offset_sigma_s / MS:.2f} ms"


def _turned_seen(alignment: TruthAlignment) -> str:
    if not np.isfinite(alignment.turned).all():
        return "not known"
    sigma = f" ± {xyz_text(alignment.turned_sigma / DEG)}" if np.isfinite(alignment.turned_sigma).all() else ""
    return f"{xyz_text(alignment.turned / DEG)}{sigma}°"


def _clock(alignment: TruthAlignment) -> tuple[str, str, str, str]:
    from session.detect.truth_alignment import OFFSET_SIGMAS

    source, used, says = alignment.source["offset_s"], alignment.reading.offset_s, offset_text(alignment)
    if source == GIVEN and not np.isfinite(alignment.offset_s):
        return "note", CLOCK, says, "is truth.offset_s this truth's? what is within 2 s of it is searched"
    if source == GIVEN:
        apart = abs(alignment.offset_s - used) > OFFSET_SIGMAS * alignment.offset_sigma_s
        return ("warning", CLOCK, says, "correct truth.offset_s, or leave it out to have it found") if apart else ("ok", CLOCK, says, "")
    if source == FOUND:
        stamps = "early" if used > 0 else "late"
        return "note", CLOCK, f"its stamps are {stamps}: {says}", f"truth.offset_s = {used:.6f} in session.toml keeps it"
    return ("ok" if np.isfinite(alignment.offset_s) else "note"), CLOCK, says, ""


def _attitude(alignment: TruthAlignment) -> list[tuple[str, str, str, str]]:
    found = []
    if alignment.source["sense"] == FOUND:
        found.append(
            ("note", ATTITUDE, "the gyro turns as their inverse does: they take the world to the body", 'truth.sense = "world_to_body"')
        )
    if alignment.source["order"] == FOUND:
        found.append(("note", ATTITUDE, "the gyro turns as they do with the scalar last", 'truth.order = "xyzw", or a header qx,qy,qz,qw'))
    return [(level, what, says, f"{do} in session.toml keeps it") for level, what, says, do in found]


def _ceiling(session: Session, alignment: TruthAlignment) -> list[tuple[str, str, str, str]]:
    """What the reference is not to be accused of: the gyro stops below its range."""
    found = np.isfinite(alignment.ceiling_rps)
    if not found.any():
        return []
    levels = " and ".join(f"{level:.4g}" for level in alignment.ceiling_rps[found] / DEG)
    stay, go = ("stays", "goes") if found.sum() == 1 else ("stay", "go")
    says = (
        f"{axes_text(found)} {stay} at ±{levels} dps, of ±{session.config.sensor.gyro_fs_dps:g}, wherever the truth turns faster, and {go} "
        f"along with it below: {alignment.ceiling_share:.0%} of the readings are there"
    )
    return [("error", CEILING, says, "what is beyond is lost: turn slower, or look for the limit in the sensor's settings")]


def _frame(alignment: TruthAlignment, given: TruthGiven) -> tuple[str, str, str, str]:
    frame, up = alignment.reading.frame, alignment.up
    if not np.isfinite(alignment.explained):
        return "note", FRAME, f"{WORLDS[frame]} ({alignment.source['frame']}): truth and gyro do not go together, so nothing tells it", ""
    if up is None:
        return "note", FRAME, f"{WORLDS[frame]} ({alignment.source['frame']}): no specific force to tell it by", ""
    tilt_deg = float(np.degrees(np.arccos(np.clip(-up @ down_of(frame) / max(np.linalg.norm(up), 1e-12), -1, 1))))
    says = f"{WORLDS[frame]} ({alignment.source['frame']}), gravity says {tilt_deg:.1f}° from it"
    if tilt_deg > 45:
        do = "correct truth.frame, or leave it out to have it found" if given.frame else "give truth.frame and truth.mounting"
        return "warning", FRAME, says, do
    if tilt_deg > TILTED_DEG:
        return "note", FRAME, says, "the truth's world is tilted, or the accelerometer is off"
    keeps = f'truth.frame = "{frame}" in session.toml keeps it; an accelerometer whose three axes are all negated looks the same'
    return ("note", FRAME, says, keeps) if alignment.source["frame"] == FOUND and frame != "ned" else ("ok", FRAME, says, "")


def _mounting(alignment: TruthAlignment, given: TruthGiven) -> tuple[str, str, str, str]:
    from scipy.spatial.transform import Rotation

    from session.detect.truth_alignment import MOUNTING_RAD

    says = f"gyro to truth {mounting_text(alignment)}"
    if given.mounting is not None:
        apart = Rotation.from_matrix(given.mounting).inv() * Rotation.from_rotvec(np.nan_to_num(alignment.turned))
        angle = float(apart.magnitude()) if np.isfinite(alignment.turned).all() else 0.0
        says = f"as given; the recording shows {_turned_seen(alignment)}, {angle / DEG:.1f}° from it"
        do = "correct truth.mounting, or leave it out to have it found"
        return ("warning", MOUNTING, says, do) if angle > MOUNTING_RAD else ("ok", MOUNTING, says, "")
    if alignment.source["mounting"] == FOUND:
        rows = ", ".join(f"[{', '.join(f'{value:.6f}' for value in row)}]" for row in alignment.reading.mounting)
        return "note", MOUNTING, f"{says}: a gyro's common misalignment is in it", f"truth.mounting = [{rows}] in session.toml keeps it"
    return "ok", MOUNTING, says, ""


def _outage(truth: Truth, outage: TruthOutage) -> tuple[str, str, str, str]:
    span, apart = f"{outage.from_s:.1f} to {outage.to_s:.1f} s", f"parts from the gyro by {outage.size_rps / DEG:.3g} dps rms"
    whose = ", and it is the truth that is wrong" if outage.sure else "; the truth or the gyro is wrong"
    return "note", OUTAGE, f"{truth.path.name}, {span}: it {apart}{whose}", "its moments there are left out: look at the truth's residuals"


# Dial readings against gravity: both say which way is down in the sensor.

DIALS_FILE, DIALS = "attitudes.csv", "dials against gravity"
#: a table that stands askew, or a sensor screwed on askew, by more is another convention of angles
ASKEW_DEG = 10.0
#: from there on, down is up
UPSIDE_DOWN_DEG = 150.0


def check_dials(session: Session, found: SessionStills) -> list[Finding]:
    """The angle between the dials' down and the accelerometer's, median and largest over the stills.  Nothing without dial readings."""
    if session.attitudes is None or session.config.protocol.reference != "table" or session.truths is not None:
        return []
    stills = [still for log in session.logs for still in found.of(log).stills]
    rows = [i for i, still in enumerate(stills[: len(session.attitudes)]) if still.problem is None and still.gravity_mps2 > 0]
    rows = [i for i in rows if np.isfinite(session.attitudes[i]).all()]
    if not rows:
        return []
    apart = np.degrees(angle_between(down_of_dials(session.attitudes[rows]), np.array([-stills[i].accel_mean for i in rows])))
    says = f"down differs by {np.median(apart):.2f}° (median of {len(rows)} stills), {apart.max():.2f}° at most (bar {ASKEW_DEG:g}°)"
    if np.median(apart) > UPSIDE_DOWN_DEG:
        do = "all three axes of the accelerometer have the wrong sign, or the dials count z up: roll 0 is the sensor's z down, reading -1 g"
        return [Finding("error", DIALS_FILE, DIALS, f"{says}: upside down", do)]
    if np.median(apart) > ASKEW_DEG:
        do = "are the angles roll, pitch, yaw of R = Rz Ry Rx, in degrees, and is each row of the still that it says?"
        return [Finding("warning", DIALS_FILE, DIALS, says, do)]
    return [Finding("ok", DIALS_FILE, DIALS, says)]


# Turns of known angle (``turns.csv``) against what the gyro reads of them.

KNOWN_TURN = "known turn"
#: turns that might have been meant: more than these say nothing
MOST_MEANT = 3


def check_known_turns(turns: Sequence[FoundTurn], parts: Sequence[LogSegments]) -> list[Finding]:
    """A finding for each turn of ``turns.csv``: the gyro's angle next to the stated one, or why the turn is not used."""
    named = {id(turn.segment) for turn in turns if turn.problem is None}
    free = [(part, s) for part in parts for s in part.segments if s.accepted and id(s) not in named] if turns else []
    reads = [(segment.number, angle_read(part.found.samples, segment)) for part, segment in free]
    return [_finding(turn, reads) for turn in turns]


def _finding(turn: FoundTurn, free: list[tuple[int, np.ndarray]]) -> Finding:
    """free: number of each turn that no line names, and what the gyro reads of it, (3,) rad."""
    says = f"{turn.known.name}: {turn.known.says}"
    if turn.problem is None:
        return Finding("ok", NAME, KNOWN_TURN, f"{says}; the gyro reads {turn.along_rad / DEG:.2f} deg, uncalibrated")
    meant = [number for number, reads in free if contradiction(turn.known, reads) is None]
    do = "it is not used; turns are counted from 0 as segments are, over all logs or in the log that is named"
    if 0 < len(meant) <= MOST_MEANT:
        do = f"it is not used; such a turn is {' or '.join(map(str, meant))}, counted from 0 over all logs"
    return Finding("warning", NAME, KNOWN_TURN, f"{says}: {turn.problem}", do)


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


def with_own_accelerometer(session: Session, anew: bool = False, looked_at: SessionStills | None = None) -> tuple[Session, list[Finding]]:
    """A session whose ``session.toml`` has no ``[accelerometer]``, with the one that its stills give, and what to say of it.

    anew: also where it has one, which then only defines the body frame.  Otherwise such a session is returned as it is; so is one whose
    reference is a truth file, and one whose stills fix no number.  known: its stills, where they were found before.
    """
    config = session.config
    none = config.accelerometer.source == "none"
    if not (none or anew) or session.truths is not None:
        return session, []
    own = own_fit(session, looked_at)
    if own is None:
        return session, []  # the first look says what is wrong
    given, known = "none is given", "give [accelerometer] where it is known better"
    if not none:
        given = "the one that is given is not used" + (", being of these stills itself" if config.accelerometer.own_stills else "")
        known = "calibrate the accelerometer again where it is to be known better"
    if own.rung is None:
        do = f"its errors become the gyroscope's; rest it on more sides, or {known}"
        return session, [Finding("warning", SESSION_FILE, ACCELEROMETER, f"{given}, but {why_not(own)}", do)]
    says = (
        f"{given}: {own.rung.says} from {len(own.before)} stills in {own.attitudes} attitudes; "
        f"gravity's spread {spread_mg(own.before):.2f} mg before, {spread_mg(own.after):.2f} mg after"
    )
    level, do = "note", f"they are of these very stills: {known}"
    if own.unobserved:
        level, says = "warning", f"{says}; not observable: {', '.join(own.unobserved)}"
        do = f"rest it on edges and corners, too, or {known}"
    found = [Finding(level, SESSION_FILE, ACCELEROMETER, says, do), *_check_zero(own, config.sensor), *drift_finding(own.drift)]
    if config.site.gravity_mps2 is None:
        say = "not given: the scale that all axes share is fitted to standard gravity, and known to 0.2 % (one sigma)"
        found.append(Finding("note", SESSION_FILE, "site.gravity_mps2", say, "give local gravity, to 0.001 m/s², for a true scale"))
    return replace(session, config=replace(config, accelerometer=own.accelerometer)), found


def _check_zero(own: LengthFit, sensor: Sensor) -> list[Finding]:
    """The accelerometer's zero against the greatest that its data sheet allows, or that of any such sensor; nothing within it (95 %)."""
    name, bar = sensor.typical("accel_zero_mg") or ("MEMS accelerometers", USUAL_ZERO_MG)
    value, sigma = (each / MG for each in own.zero)
    if np.all(np.abs(value) - WITHIN * sigma <= bar):
        return []
    shown = ", ".join(f"{each:+.1f} ± {s:.1g}" for each, s in zip(value, sigma, strict=True))
    do = "a calibration removes it; a unit that far off is worth a look, or the units and the mounting of its axes"
    return [Finding("warning", SESSION_FILE, FAR_ZERO, f"{shown} mg, bar {bar:g} ({name})", do)]


def drift_finding(drift: ZeroDrift | None) -> list[Finding]:
    """What to say of a significant drift; nothing of another."""
    if drift is None or not drift.significant:
        return []
    do = "it is fitted with the rest, which else would take it for nonorthogonality; let the sensor warm up before the first still"
    return [Finding("warning", SESSION_FILE, ZERO_DRIFT, drift.words, do)]


def spread_mg(misses: np.ndarray) -> float:
    """mg: how far lengths that miss gravity's by misses (S,) m/s^2 lie apart."""
    return float(np.std(misses)) / MG
