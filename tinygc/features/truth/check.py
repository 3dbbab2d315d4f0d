"""The first look at truth files: their rotations against the gyroscope's, and what was found out of their clock, frame and mounting."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from session.base.errors import CalibrationError
from session.base.numeric import rms_of
from session.base.rotation import conjugate, multiply
from session.base.rotation import log as rotation_vector
from session.base.texts import significant
from session.base.units import DEG
from session.detect.findings import Finding, xyz_text
from session.log.folder import Session
from session.log.logfile import Log
from tinygc.features.truth.alignment import EXPLAINED, LONGEST_S, MOUNTING_RAD, OFFSET_SIGMAS, carried
from tinygc.features.truth.outages import without_outages
from tinygc.features.truth.reading import (
    ATTITUDE,
    CLOCK,
    FOUND,
    FRAME,
    GIVEN,
    MOUNTING,
    OUTAGE,
    Truth,
    TruthAlignment,
    TruthGiven,
    TruthOutage,
    down_of,
    given_in,
)
from tinygc.features.truth.segments import cut_at_truth

# Check of a truth file: its rotations must be the ones that the gyro's rates make.

MOST_SEGMENTS = 200
LEAST_DEG = 1.0


def check_truth(session: Session, log: Log) -> list[Finding]:
    """The rotations between moments of truth, against the gyro's, a constant bias taken off."""
    truth, config = session.reference.truths[session.logs.index(log)], session.config
    where = truth.path.name
    try:
        cut = cut_at_truth(log.samples, truth, config.sensor, config.protocol)
    except CalibrationError as error:
        return [Finding("error", where, "truth", str(error))]
    good = [(segment, ends) for segment, ends in cut if segment.accepted]
    text = f"{len(truth)} moments, {len(good)} of {len(cut)} segments whole"
    if not good:
        return [Finding("error", where, "truth", f"{text}: {cut[0][0].problem}", "is the truth of this log?")]
    findings = [Finding("ok", where, "truth", text)]
    picked = good[:: -(-len(good) // MOST_SEGMENTS)]
    if float(np.median([segment.duration_s for segment, _ in picked])) > LONGEST_S:
        return findings
    q = carried(log.samples, log.samples.gyro).q
    begin, last = (np.array([getattr(segment, name) for segment, _ in picked]) for name in ("start", "stop"))
    gyro = multiply(conjugate(q[begin]), q[last - 1])
    start, end = (np.array([getattr(ends, name) for _, ends in picked]) for name in ("start", "end"))
    duration = np.array([segment.duration_s for segment, _ in picked])[:, None]
    turned = multiply(conjugate(start), end)
    size = rms_of(np.linalg.norm(rotation_vector(turned), axis=1)) / DEG
    if size < LEAST_DEG:
        return [*findings, Finding("note", where, "gyro against truth", f"hardly turned ({size:.1f} deg): it cannot test the gyro")]
    misfit, bias = _misfit(gyro, turned, duration)
    text = f"segments of {size:.0f} deg, explained to {1 - misfit:.1%} (bar {EXPLAINED:.0%}) with a bias of {xyz_text(bias / DEG)} dps"
    if misfit <= 1 - EXPLAINED:
        return [*findings, Finding("ok", where, "gyro against truth", text)]
    inverse, _ = _misfit(gyro, multiply(start, conjugate(end)), duration)
    hint = (
        "the inverse explains it: write q_nb, body to navigation frame"
        if inverse < 0.5 * misfit
        else "are axes, units and clocks the same?"
    )
    return [*findings, Finding("error", where, "gyro against truth", text, hint)]


def _misfit(gyro: np.ndarray, turned: np.ndarray, duration: np.ndarray) -> tuple[float, np.ndarray]:
    """Share of the truth's squared rotation that the gyro leaves, and the bias (3,) rad/s that was taken off."""
    error = rotation_vector(multiply(conjugate(turned), gyro))
    bias = np.median(error / duration, axis=0)
    return float(np.sum((error - bias * duration) ** 2) / np.sum(rotation_vector(turned) ** 2)), bias


# A truth file whose clock, frame or mounting departs from docs/formats.md: it is estimated, corrected and reported.

MS = 1e-3
#: of the world's up from the nearest axis: an accelerometer's zero-g offset of 35 mg, more than data sheets of MEMS sensors allow but few
TILTED_DEG = 2.0
WORLDS = {"ned": "z down", "enu": "z up", "y_up": "y up", "y_down": "y down", "x_up": "x up", "x_down": "x down"}


def with_aligned_truth(session: Session) -> tuple[Session, list[Finding]]:
    """A session whose truth files are read as the recording shows, where ``[truth]`` does not state it, and the findings.

    One whose truth does not go with its gyro is returned as it is: the first look reports that.
    """
    aligned = without_outages(session)
    alignment, truths = aligned.reference.alignment, aligned.reference.truths
    where = truths[0].path.name if len(truths) == 1 else "truth files"
    given = given_in(session.config)
    findings = [_clock(alignment), *_attitude(alignment), _frame(alignment, given), _mounting(alignment, given)]
    findings += [_outage(truth, outage) for truth in truths for outage in truth.outages]
    return aligned, [Finding(level, where, what, text, do) for level, what, text, do in findings if what]


def frame_text(alignment: TruthAlignment) -> str:
    """The truth's world and how its quaternions are written, each with where that is from."""
    reading, source = alignment.reading, alignment.source
    parts = [f"world with {WORLDS[reading.frame]} ({source['frame']})"]
    if reading.sense != "body_to_world":
        parts.append(f"quaternions from the world to the body ({source['sense']})")
    if reading.order != "wxyz":
        parts.append(f"scalar last ({source['order']})")
    return "; ".join(parts)


def words(found: TruthAlignment) -> str:
    """All of it in a line."""
    return f"Truth: clock {offset_text(found)}; {frame_text(found)}; gyro to truth {mounting_text(found)}."


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
    source, used, text = alignment.source["offset_s"], alignment.reading.offset_s, offset_text(alignment)
    if source == GIVEN and not np.isfinite(alignment.offset_s):
        return "note", CLOCK, text, "is truth.offset_s this truth's? what is within 2 s of it is searched"
    if source == GIVEN:
        apart = abs(alignment.offset_s - used) > OFFSET_SIGMAS * alignment.offset_sigma_s
        return ("warning", CLOCK, text, "correct truth.offset_s, or leave it out to have it found") if apart else ("ok", CLOCK, text, "")
    if source == FOUND:
        stamps = "early" if used > 0 else "late"
        return "note", CLOCK, f"its stamps are {stamps}: {text}", f"truth.offset_s = {used:.6f} in session.toml keeps it"
    return ("ok" if np.isfinite(alignment.offset_s) else "note"), CLOCK, text, ""


def _attitude(alignment: TruthAlignment) -> list[tuple[str, str, str, str]]:
    found = []
    if alignment.source["sense"] == FOUND:
        found.append(
            ("note", ATTITUDE, "the gyro turns as their inverse does: they take the world to the body", 'truth.sense = "world_to_body"')
        )
    if alignment.source["order"] == FOUND:
        found.append(("note", ATTITUDE, "the gyro turns as they do with the scalar last", 'truth.order = "xyzw", or a header qx,qy,qz,qw'))
    return [(level, what, text, f"{do} in session.toml keeps it") for level, what, text, do in found]


def _frame(alignment: TruthAlignment, given: TruthGiven) -> tuple[str, str, str, str]:
    frame, up = alignment.reading.frame, alignment.up
    if not np.isfinite(alignment.explained):
        return "note", FRAME, f"{WORLDS[frame]} ({alignment.source['frame']}): truth and gyro do not go together, so it is unknown", ""
    if up is None:
        return "note", FRAME, f"{WORLDS[frame]} ({alignment.source['frame']}): no specific force to find it by", ""
    tilt_deg = float(np.degrees(np.arccos(np.clip(-up @ down_of(frame) / max(np.linalg.norm(up), 1e-12), -1, 1))))
    text = f"{WORLDS[frame]} ({alignment.source['frame']}), gravity shows {tilt_deg:.1f}° from it"
    if tilt_deg > 45:
        do = "correct truth.frame, or leave it out to have it found" if given.frame else "give truth.frame and truth.mounting"
        return "warning", FRAME, text, do
    if tilt_deg > TILTED_DEG:
        return "note", FRAME, text, "the truth's world is tilted, or the accelerometer is off"
    keeps = f'truth.frame = "{frame}" in session.toml keeps it; an accelerometer whose three axes are all negated looks the same'
    return ("note", FRAME, text, keeps) if alignment.source["frame"] == FOUND and frame != "ned" else ("ok", FRAME, text, "")


def _mounting(alignment: TruthAlignment, given: TruthGiven) -> tuple[str, str, str, str]:
    text = f"gyro to truth {mounting_text(alignment)}"
    if given.mounting is not None:
        apart = Rotation.from_matrix(given.mounting).inv() * Rotation.from_rotvec(np.nan_to_num(alignment.turned))
        angle = float(apart.magnitude()) if np.isfinite(alignment.turned).all() else 0.0
        text = f"as given; the recording shows {_turned_seen(alignment)}, {angle / DEG:.1f}° from it"
        do = "correct truth.mounting, or leave it out to have it found"
        return ("warning", MOUNTING, text, do) if angle > MOUNTING_RAD else ("ok", MOUNTING, text, "")
    if alignment.source["mounting"] == FOUND:
        rows = ", ".join(f"[{', '.join(f'{value:.6f}' for value in row)}]" for row in alignment.reading.mounting)
        return "note", MOUNTING, f"{text}: a gyro's common misalignment is in it", f"truth.mounting = [{rows}] in session.toml keeps it"
    return "ok", MOUNTING, text, ""


def _outage(truth: Truth, outage: TruthOutage) -> tuple[str, str, str, str]:
    span, apart = f"{outage.from_s:.1f} to {outage.to_s:.1f} s", f"parts from the gyro by {significant(outage.size_rps / DEG)} dps rms"
    whose = ", and it is the truth that is wrong" if outage.sure else "; the truth or the gyro is wrong"
    return "note", OUTAGE, f"{truth.path.name}, {span}: it {apart}{whose}", "its moments there are left out: look at the truth's residuals"
