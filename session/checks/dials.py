"""Dial readings against gravity: both say which way is down in the sensor."""

from __future__ import annotations

import numpy as np

from session.checks.findings import Finding
from session.detect.session_stills import SessionStills
from session.log.folder import Session

WHERE, WHAT = "attitudes.csv", "dials against gravity"
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
    roll, pitch, _ = session.attitudes[rows].T
    dialled = np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)], axis=-1)
    measured = np.array([-stills[i].accel_mean / stills[i].gravity_mps2 for i in rows])
    apart = np.degrees(np.arctan2(np.linalg.norm(np.cross(dialled, measured), axis=1), np.sum(dialled * measured, axis=1)))
    says = f"down differs by {np.median(apart):.2f}° (median of {len(rows)} stills), {apart.max():.2f}° at most (bar {ASKEW_DEG:g}°)"
    if np.median(apart) > UPSIDE_DOWN_DEG:
        do = "all three axes of the accelerometer have the wrong sign, or the dials count z up: roll 0 is the sensor's z down, reading -1 g"
        return [Finding("error", WHERE, WHAT, f"{says}: upside down", do)]
    if np.median(apart) > ASKEW_DEG:
        do = "are the angles roll, pitch, yaw of R = Rz Ry Rx, in degrees, and is each row of the still that it says?"
        return [Finding("warning", WHERE, WHAT, says, do)]
    return [Finding("ok", WHERE, WHAT, says)]
