"""What every job on a session begins with: read it, look for boring causes, find its stills, build the problem.  Each once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from session.checks.accelerometer import WHAT, with_own_accelerometer
from session.checks.alignment import SAID, with_aligned_truth
from session.checks.bridges import WHAT as BRIDGED
from session.checks.bridges import with_bridges
from session.checks.findings import Finding, stop_at_errors
from session.checks.first_look import check_session
from session.checks.impacts import WHAT as IMPACTS
from session.common.errors import CalibrationError
from session.detect.session_stills import SessionStills
from session.log.folder import Session, read_session
from tinygc.lot.lot import Lot
from tinygc.models.linear import LinearModel
from tinygc.problem.build import build_problem
from tinygc.problem.gravity_sign import check_gravity_sign
from tinygc.problem.joint import GIVEN_SIGMA_MG, REFUTED_P, fit_joint
from tinygc.problem.joint_fit import JointFit
from tinygc.problem.problem import Problem
from tinygc.problem.recalibrated import recalibrated

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
        own = (WHAT, BRIDGED, IMPACTS)
        return [f for f in self.findings if f.level == "warning" or f.what in own or (f.what in SAID and f.level == "note")]

    def as_given(self) -> Prepared:
        """With the calibration that session.toml gives; the same where it gives none."""
        return self if self.given is None else Prepared([f for f in self.findings if f.what != WHAT], self.given)


def prepare(
    session: Session | Path,
    *,
    use_earth: bool = True,
    exclude: tuple[int, ...] = (),
    accelerometer: str = AUTO,
    progress: Callable[[str], None] = lambda what: None,
    known: SessionStills | None = None,
    near: LinearModel | None = None,
    lot: Lot | None = None,
) -> Prepared:
    """From a session, or a session folder, to its problem.

    accelerometer: ``given``, ``fit``, ``prior`` or ``auto``, see ``ACCELEROMETERS``; where session.toml gives none, it is fitted.
    known: the stills of this very session, where somebody has asked for them before; near: a gyroscope's model near its own;
    lot: that fewer turns are enough with.
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
    problem = build_problem(whole, use_earth=use_earth, exclude=exclude, found=found, near=near, lot=lot, progress=progress)
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
        lot=lot,
    )
    return Prepared(said + free.findings, free.problem, problem)


def _fitted(findings: list[Finding], problem: Problem, own: list[Finding]) -> Prepared:
    """With the numbers that stills and turns give together; those that turns tell and lengths do not are observable after all."""
    joint = fit_joint(problem, "fit") if problem.session.config.accelerometer.source == "stills" else None
    if joint is None:
        return Prepared(findings, problem)
    return Prepared([_joint_finding(f, joint) if f in own and f.what == WHAT else f for f in findings], recalibrated(problem, joint))


def _joint_finding(finding: Finding, joint: JointFit) -> Finding:
    says = finding.says.split("; not observable")[0]
    if not joint.unobserved:
        return replace(finding, level="note", says=says + "; sharpened by the turns")
    return replace(finding, says=f"{says}; not observable: {', '.join(joint.unobserved)}")


def _refuted(joint: JointFit, free: JointFit | None) -> Finding:
    says = f"the calibration that is given no longer holds (p = {joint.p_value:.1g})"
    if free is not None:
        says += f": {free.words}"
    do = "the fit takes what these stills and turns give; calibrate the accelerometer again, or keep it with --accelerometer given"
    return Finding("warning", "session.toml", WHAT, says, do)
