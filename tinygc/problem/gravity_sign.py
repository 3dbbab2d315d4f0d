"""An accelerometer whose three axes are all negated: what can tell, and what cannot.

Negate every specific force, and every place with it: the world seen in a mirror point.  Gravity's direction still turns as the rates say,
lever arms and bumps still fit, lengths are the same.  What does not turn over is a rotation.  So no turn tells the two apart, and only
one thing does whose sense about the vertical is known beforehand: the Earth's rotation, -Omega sin(latitude) about down.  (A dial or a
truth file tells it, too.)  A sensitivity to acceleration that is the same on all axes turns the stills about the vertical as well, and a
latitude with the wrong sign asks for the reverse: both are said beside it.
"""

from __future__ import annotations

import numpy as np

from session.checks.bridges import with_bridges
from session.checks.findings import Finding
from session.common.errors import CalibrationError
from session.common.units import DEG_PER_HOUR
from session.detect.session_stills import SessionStills
from session.log.folder import Session
from tinygc.attitude.earth import vertical_only, vertical_rate
from tinygc.models.linear import LinearModel
from tinygc.problem.build import build_problem
from tinygc.problem.problem import Problem
from tinygc.problem.still_set import StillSet

WHAT = "gravity's sign"
#: sigmas: the Earth as it is must be this far off, and the Earth upside down no farther than that
REFUTED, BORNE_OUT = 8.0, 3.0


def check_gravity_sign(problem: Problem) -> list[Finding]:
    """Whether the stills turn with the Earth, or with an Earth upside down; nothing where the recording cannot tell."""
    session = problem.session
    latitude_deg = session.config.site.latitude_deg
    if latitude_deg is None or session.truths is not None:
        return []
    seen = _vertical(problem.logs, problem.first)
    if seen is None:
        return []
    rate, sigma = seen
    expected = float(vertical_only(latitude_deg).rate_t[2])
    if not (abs(rate - expected) > REFUTED * sigma and abs(rate + expected) < BORNE_OUT * sigma):
        return []
    says = (
        f"the stills turn about down by {rate / DEG_PER_HOUR:+.1f} ± {sigma / DEG_PER_HOUR:.1f}°/h, the Earth by "
        f"{expected / DEG_PER_HOUR:+.1f}°/h at latitude {latitude_deg:g}°: as if gravity were upside down"
    )
    do = "negate all axes of the accelerometer if the one that points up reads -1 g; or is site.latitude_deg wrong? is it g-sensitivity?"
    where = session.logs[0].path.name if len(session.logs) == 1 else session.name
    return [Finding("warning", where, WHAT, says, do)]


def first_look_at_gravity_sign(session: Session, found: SessionStills) -> list[Finding]:
    """The same before anything is fitted: of a session that the first look finds no error in; nothing where it makes no problem.

    found: the session's stills, as the first look has found them.
    """
    if session.config.site.latitude_deg is None or session.truths is not None:
        return []
    whole = with_bridges(session)
    try:
        return check_gravity_sign(build_problem(whole, found=SessionStills(whole, found)))
    except CalibrationError:
        return []  # too few turns: ``fit`` says so


def _vertical(logs: list[StillSet], model: LinearModel) -> tuple[float, float] | None:
    """Rate about down and its sigma, rad/s, over all pieces of carried yaw."""
    rows = [
        (q, still.gyro_mean, log.noise.angle_random_walk / np.sqrt(still.duration_s), int(group))
        for log in logs
        for q, still, group in zip(log.q_tb, log.stills, log.group, strict=True)
        if still.problem is None
    ]
    q, rate, sigma, group = (np.array(column) for column in zip(*rows, strict=True))
    if not (sigma > 0).all():
        return None
    found = [vertical_rate(q[mine], model(rate[mine]), sigma[mine]) for mine in (group == each for each in np.unique(group))]
    known = np.array([each for each in found if each is not None])
    if not len(known):
        return None
    weight = known[:, 1] ** -2
    return float(known[:, 0] @ weight / weight.sum()), float(weight.sum() ** -0.5)
