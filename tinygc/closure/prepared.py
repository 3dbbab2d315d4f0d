"""Prepare a session: read it, check it, find its stills, build the problem; the sign of the accelerometer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.detect.check_references import ACCELEROMETER, SAID, with_aligned_truth, with_own_accelerometer
from session.detect.check_samples import BRIDGED, IMPACTS, with_bridges
from session.detect.findings import Finding, stop_at_errors
from session.detect.first_look import check_session
from session.detect.stills import SessionStills
from session.io.errors import CalibrationError
from session.io.folder import Session, read_session
from session.io.units import DEG_PER_HOUR
from tinygc.attitude.earth import vertical_only, vertical_rate
from tinygc.closure.build import build_problem
from tinygc.closure.joint import GIVEN_SIGMA_MG, REFUTED_P, fit_joint, recalibrated
from tinygc.closure.prior import PriorOf
from tinygc.closure.problem import JointFit, Problem
from tinygc.closure.stills import StillSet
from tinygc.models.linear import LinearModel

# An accelerometer whose three axes are all negated: what can tell, and what cannot.
#
# Negate every specific force, and every place with it: the world seen in a mirror point.  Gravity's direction still turns as the rates say,
# lever arms and bumps still fit, lengths are the same.  What does not turn over is a rotation.  So no turn tells the two apart, and only
# one thing does whose sense about the vertical is known beforehand: the Earth's rotation, -Omega sin(latitude) about down.  (A dial or a
# truth file tells it, too.)  A sensitivity to acceleration that is the same on all axes turns the stills about the vertical as well, and a
# latitude with the wrong sign asks for the reverse: both are said beside it.

GRAVITY_SIGN = "gravity's sign"
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
    return [Finding("warning", where, GRAVITY_SIGN, says, do)]


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


# What every job on a session begins with: read it, look for boring causes, find its stills, build the problem.  Each once.

#: what is believed of a calibration of the accelerometer that session.toml gives: all of it; nothing; what its sigma says
ACCELEROMETERS = ("given", "fit", "prior")
#: mg: a prior that only keeps a scale of all axes from what is gravity's own length
WIDE_MG = 100.0
#: beside these: a given one is a prior, unless the recording refutes it
AUTO = "auto"


@dataclass(frozen=True, eq=False)
class Prepared:
    """findings of the first look, none of them an error; problem of the session; given: the same with the accelerometer's calibration as
    session.toml gives it, where the problem has another."""

    findings: list[Finding]
    problem: Problem
    given: Problem | None = None

    @property
    def session(self) -> Session:
        """That it was made of."""
        return self.problem.session

    @property
    def warnings(self) -> list[Finding]:
        """What costs accuracy, what was put in, an accelerometer that the session itself has calibrated, a truth file that is not read as
        it stands."""
        own = (ACCELEROMETER, BRIDGED, IMPACTS)
        return [f for f in self.findings if f.level == "warning" or f.what in own or (f.what in SAID and f.level == "note")]

    def as_given(self) -> Prepared:
        """With the calibration that session.toml gives; the same where it gives none."""
        return self if self.given is None else Prepared([f for f in self.findings if f.what != ACCELEROMETER], self.given)


def prepare(
    session: Session | Path,
    *,
    use_earth: bool = True,
    exclude: tuple[int, ...] = (),
    accelerometer: str = AUTO,
    progress: Callable[[str], None] = lambda what: None,
    known: SessionStills | None = None,
    near: LinearModel | None = None,
    prior: PriorOf | None = None,
) -> Prepared:
    """From a session, or a session folder, to its problem.

    accelerometer: ``given``, ``fit``, ``prior`` or ``auto``, see ``ACCELEROMETERS``; where session.toml gives none, it is fitted.
    known: the stills of this very session, where somebody has asked for them before; near: a gyroscope's model near its own;
    prior: what is known of the unit beforehand, with which fewer turns are enough.
    Raises DataError for the first error of the first look, CalibrationError where a given calibration is asked for and there is none, and
    the errors of ``read_session`` and ``build_problem``.
    """
    if not isinstance(session, Session):
        session = read_session(session, lambda name: progress(f"reading {name}"))
    source = session.config.accelerometer.source
    if session.config.accelerometer.own_stills and accelerometer == AUTO:
        accelerometer = "fit"  # beside these very stills it is no knowledge of its own
    if accelerometer in ("given", "prior") and source == "none":
        raise CalibrationError(
            f"{session.folder}: session.toml gives no [accelerometer] to take as {accelerometer}; leave --accelerometer out"
        )
    session, own = with_own_accelerometer(session, anew=accelerometer == "fit", looked_at=known)
    session, aligned = with_aligned_truth(session)
    progress("first look")
    found = looked_at = SessionStills(session) if known is None else known.under(session)
    findings = own + aligned + check_session(session, found)
    stop_at_errors(findings)
    whole = with_bridges(session)
    found = SessionStills(whole, found)
    problem = build_problem(whole, use_earth=use_earth, exclude=exclude, found=found, near=near, prior=prior, progress=progress)
    if use_earth:
        findings = findings + check_gravity_sign(problem)
    if accelerometer == "given" or source not in ("given", "none"):  # or an estimation that has been made before
        return Prepared(findings, problem)
    progress("accelerometer")
    if source == "none" or accelerometer == "fit":
        return _fitted(findings, problem, own)
    joint = fit_joint(problem, "prior", session.config.accelerometer.sigma_mg or GIVEN_SIGMA_MG)
    if joint is None or joint.p_value is None:
        return Prepared(findings, problem)
    if joint.p_value > REFUTED_P:
        return Prepared(findings, recalibrated(problem, joint), problem)
    said = [_refuted(joint, fit_joint(problem, "prior", WIDE_MG, judged=False))]
    if accelerometer == "prior":
        return Prepared(said + findings, recalibrated(problem, joint), problem)
    free = prepare(
        session,
        use_earth=use_earth,
        exclude=exclude,
        accelerometer="fit",
        progress=progress,
        known=looked_at,
        near=problem.first,
        prior=prior,
    )
    return Prepared(said + free.findings, free.problem, problem)


def _fitted(findings: list[Finding], problem: Problem, own: list[Finding]) -> Prepared:
    """With the numbers that stills and turns give together; those that turns tell and lengths do not are observable after all."""
    joint = fit_joint(problem, "fit") if problem.session.config.accelerometer.source == "stills" else None
    if joint is None:
        return Prepared(findings, problem)
    return Prepared(
        [_joint_finding(f, joint) if f in own and f.what == ACCELEROMETER else f for f in findings], recalibrated(problem, joint)
    )


def _joint_finding(finding: Finding, joint: JointFit) -> Finding:
    says = finding.says.split("; not observable")[0]
    if not joint.unobserved:
        return replace(finding, level="note", says=says + "; sharpened by the turns")
    return replace(finding, says=f"{says}; not observable: {', '.join(joint.unobserved)}")


def _refuted(joint: JointFit, free: JointFit | None) -> Finding:
    says = f"the given calibration no longer agrees with the data (p = {joint.p_value:.1g})"
    if free is not None:
        says += f": {free.words}"
    do = "the fit takes what these stills and turns give; calibrate the accelerometer again, or keep it with --accelerometer given"
    return Finding("warning", "session.toml", ACCELEROMETER, says, do)
