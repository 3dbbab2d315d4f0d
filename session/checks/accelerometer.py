"""An accelerometer that nobody has calibrated: the session's own stills do it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.accelerometer.from_stills import force_of, why_not
from session.accelerometer.lengths import LengthFit, fit_lengths
from session.accelerometer.parameters import SCALES
from session.checks.findings import Finding
from session.common.units import MG
from session.detect.session_stills import SessionStills
from session.log.folder import Session

WHERE, WHAT = "session.toml", "accelerometer"
#: of gravity: a sensor whose lengths are farther off has another unit or full scale, not another sensitivity
UNITS_RIGHT = 0.2


def own_fit(session: Session, known: SessionStills | None = None) -> LengthFit | None:
    """What the stills of a session give, as a correction of what its session.toml does; None where its readings are not gravity's.

    known: the session's stills, where somebody has asked for them before.
    """
    known = known or SessionStills(session)
    stills = [still for log in session.logs for still in known.of(log).stills]
    force, site = force_of([still for still in stills if still.problem is None]), session.config.site
    if not len(force):
        return None
    found = fit_lengths(force, site.expected_gravity_mps2, session.config.accelerometer, site.gravity_sigma_mps2)
    # A zero of half a g moves the lengths by as much; what is wrong with the units shows in the scale.
    length = np.median(np.linalg.norm(force, axis=1)) / site.expected_gravity_mps2 if found.rung is None else np.mean(found.x[SCALES])
    return found if abs(length - 1) < UNITS_RIGHT else None


def with_own_accelerometer(session: Session, anew: bool = False, looked_at: SessionStills | None = None) -> tuple[Session, list[Finding]]:
    """A session whose ``session.toml`` has no ``[accelerometer]``, with the one that its stills give, and what to say of it.

    anew: also where it has one, which then only defines the body frame.  Otherwise such a session is returned as it is; so is one whose
    reference is a truth file, and one whose stills fix no number.  looked_at: its stills, where somebody has asked for them before.
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
        known = "calibrate the accelerometer anew where it is to be known better"
    if own.rung is None:
        do = f"its errors become the gyroscope's; rest it on more sides, or {known}"
        return session, [Finding("warning", WHERE, WHAT, f"{given}, but {why_not(own)}", do)]
    says = (
        f"{given}: {own.rung.says} from {len(own.before)} stills in {own.attitudes} attitudes; "
        f"gravity's spread {spread_mg(own.before):.2f} mg before, {spread_mg(own.after):.2f} mg after"
    )
    level, do = "note", f"they are of these very stills: {known}"
    if own.unobserved:
        level, says = "warning", f"{says}; not observable: {', '.join(own.unobserved)}"
        do = f"rest it on edges and corners, too, or {known}"
    found = [Finding(level, WHERE, WHAT, says, do)]
    if config.site.gravity_mps2 is None:
        say = "not given: the scale that all axes share is fitted to standard gravity, and known to 0.2 % (one sigma)"
        found.append(Finding("note", WHERE, "site.gravity_mps2", say, "give local gravity, to 0.001 m/s², for a true scale"))
    return replace(session, config=replace(config, accelerometer=own.accelerometer)), found


def spread_mg(misses: np.ndarray) -> float:
    """mg: how far lengths that miss gravity's by misses (S,) m/s^2 lie apart."""
    return float(np.std(misses)) / MG
