"""An accelerometer that nobody has calibrated: the session's own stills do it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.accelerometer.from_stills import force_of, why_not
from session.accelerometer.lengths import LengthFit, fit_lengths
from session.checks.findings import Finding
from session.common.units import MG
from session.detect.stills import find_stills
from session.log.folder import Session

WHERE, WHAT = "session.toml", "accelerometer"
#: of gravity: a sensor whose lengths are farther off has another unit or full scale, not another sensitivity
UNITS_RIGHT = 0.2


def own_fit(session: Session) -> LengthFit | None:
    """What the stills of a session give, as a correction of what its session.toml does; None where its readings are not gravity's."""
    samples = [session.calibrated(log) for log in session.logs]
    stills = [still for log in samples for still in find_stills(log, session.config.protocol.still_s)[0]]
    force, gravity = force_of([still for still in stills if still.problem is None]), session.config.site.expected_gravity_mps2
    if not len(force) or abs(np.median(np.linalg.norm(force, axis=1)) / gravity - 1) > UNITS_RIGHT:
        return None
    return fit_lengths(force, gravity, session.config.accelerometer)


def with_own_accelerometer(session: Session, anew: bool = False) -> tuple[Session, list[Finding]]:
    """A session whose ``session.toml`` has no ``[accelerometer]``, with the one that its stills give, and what to say of it.

    anew: also where it has one, which then only defines the body frame.  Otherwise such a session is returned as it is; so is one whose
    reference is a truth file, and one whose stills fix no number.
    """
    config = session.config
    none = config.accelerometer.source == "none"
    if not (none or anew) or session.truths is not None:
        return session, []
    own = own_fit(session)
    if own is None:
        return session, []  # the first look says what is wrong
    given = "none is given" if none else "the one that is given is not used"
    if own.rung is None:
        do = "its errors become the gyroscope's; rest it on more sides, or give [accelerometer]"
        return session, [Finding("warning", WHERE, WHAT, f"{given}, but {why_not(own)}", do)]
    says = (
        f"{given}: {own.rung.says} from {len(own.before)} stills in {own.attitudes} attitudes; "
        f"gravity's spread {spread_mg(own.before):.2f} mg before, {spread_mg(own.after):.2f} mg after"
    )
    level, do = "note", "they are of these very stills: give [accelerometer] where it is known better"
    if own.unobserved:
        level, says = "warning", f"{says}; not observable: {', '.join(own.unobserved)}"
        do = "rest it on edges and corners, too, or give [accelerometer]"
    return replace(session, config=replace(config, accelerometer=own.accelerometer)), [Finding(level, WHERE, WHAT, says, do)]


def spread_mg(misses: np.ndarray) -> float:
    """mg: how far lengths that miss gravity's by misses (S,) m/s^2 lie apart."""
    return float(np.std(misses)) / MG
