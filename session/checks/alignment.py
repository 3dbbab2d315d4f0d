"""A truth file whose clock, frame or mounting is not the contract's: found out, taken into account, and said."""

from __future__ import annotations

import numpy as np

from session.checks.findings import Finding, xyz_text
from session.common.units import DEG
from session.log.folder import Session
from session.log.truth_reading import FOUND, GIVEN, TruthAlignment, TruthGiven, down_of

CLOCK, FRAME, ATTITUDE, MOUNTING = "truth's clock", "truth's frame", "truth's attitudes", "truth's mounting"
#: what fit and explain say as well, where it is more than ok
SAID = (CLOCK, FRAME, ATTITUDE, MOUNTING)
MS = 1e-3
#: of the world's up from the nearest axis: an accelerometer's zero-g offset of 35 mg, more than data sheets of MEMS sensors allow but few
TILTED_DEG = 2.0
WORLDS = {"ned": "z down", "enu": "z up", "y_up": "y up", "y_down": "y down", "x_up": "x up", "x_down": "x down"}


def with_aligned_truth(session: Session) -> tuple[Session, list[Finding]]:
    """A session whose truth files are read as the recording asks for, where ``[truth]`` does not say how, and what to say of it.

    A session without a truth is returned as it is.  So is one whose truth does not go with its gyro: the first look says that.
    """
    if session.truths is None:
        return session, []
    from session.alignment.align import align  # whose SciPy no session without a truth waits for

    aligned = align(session)
    alignment = aligned.alignment
    assert alignment is not None  # ``align`` gives one to every session with a truth
    where = session.truths[0].path.name if len(session.truths) == 1 else "truth files"
    given = session.config.truth
    findings = [_clock(alignment), *_attitude(alignment), _frame(alignment, given), _mounting(alignment, given)]
    return aligned, [Finding(level, where, what, says, do) for level, what, says, do in findings if what]


def truth_words(alignment: TruthAlignment) -> str:
    """How the truth was read, in a sentence for a report."""
    return f"clock {offset_text(alignment)}; {frame_text(alignment)}; gyro to truth {mounting_text(alignment)}"


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
    from session.alignment.align import OFFSET_SIGMAS

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

    from session.alignment.align import MOUNTING_RAD

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
