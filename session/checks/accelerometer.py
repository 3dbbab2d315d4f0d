"""An accelerometer that nobody has calibrated: the session's own stills do it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.accelerometer.from_stills import attitudes_of, fit_length, force_of
from session.checks.findings import Finding
from session.common.errors import SegmentError
from session.common.units import MG
from session.detect.stills import find_stills
from session.log.folder import Session

WHERE, WHAT = "session.toml", "accelerometer"
#: of gravity: a sensor whose lengths are farther off has another unit or full scale, not another sensitivity
UNITS_RIGHT = 0.2


def with_own_accelerometer(session: Session) -> tuple[Session, list[Finding]]:
    """A session whose ``session.toml`` has no ``[accelerometer]``, with the one that its stills give, and what to say of it.

    A session that has one, or whose reference is a truth file, is returned as it is.  So is one whose stills do not fix nine numbers.
    """
    config = session.config
    if config.accelerometer.source != "none" or session.truths is not None:
        return session, []
    stills = [still for log in session.logs for still in find_stills(log.samples, config.protocol.still_s)[0] if still.problem is None]
    force, gravity = force_of(stills), config.site.expected_gravity_mps2
    lengths = np.linalg.norm(force, axis=1)
    if not len(force) or abs(np.median(lengths) / gravity - 1) > UNITS_RIGHT:
        return session, []  # the first look says what is wrong
    try:
        own = fit_length(force, gravity)
    except SegmentError as error:
        do = "its errors become the gyroscope's; rest it on more sides, or give [accelerometer]"
        return session, [Finding("warning", WHERE, WHAT, f"none is given, and {error}", do)]
    left = np.linalg.norm(own.correct(force), axis=1)
    says = (
        f"none is given: nine numbers from {len(force)} stills in {attitudes_of(force)} attitudes; "
        f"gravity's spread {np.std(lengths) / MG:.2f} mg before, {np.std(left) / MG:.2f} mg after"
    )
    do = "they are of these very stills: give [accelerometer] where it is known better"
    return replace(session, config=replace(config, accelerometer=own)), [Finding("note", WHERE, WHAT, says, do)]
