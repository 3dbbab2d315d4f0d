"""Prepare a session: read it, check it, find its stills, build the problem; check the sign of the accelerometer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.base.errors import CalibrationError
from session.base.progress import Reporter, no_report
from session.base.texts import probability
from session.base.units import DEG_PER_HOUR
from session.detect.check_references import ACCELEROMETER, ZERO_DRIFT, drift_finding, with_own_accelerometer
from session.detect.check_samples import BRIDGED, IMPACTS, with_bridges
from session.detect.check_stills import TURNS
from session.detect.findings import Finding, as_arguments, stop_at_errors
from session.detect.first_look import CHANGED, check_session
from session.detect.stamp_errors import STAMPS
from session.detect.stills import SessionStills
from session.log.folder import Session, read_session
from tinygc.closure.build import build_problem, reference_stills
from tinygc.closure.earth import vertical_only, vertical_rate
from tinygc.closure.joint import GIVEN_SIGMA_MG, REFUTED_P, fit_joint, recalibrated
from tinygc.closure.least_squares import PriorOf
from tinygc.closure.problem import NOT_TAKEN, AtRest, JointFit, Problem
from tinygc.closure.runs import read_closure_runs
from tinygc.closure.stills import StillSet
from tinygc.models.linear import LinearModel

# An accelerometer with all three axes negated: how it is detected.
#
# Negating every specific force and every position is a point reflection.  Gravity's direction follows the gyro, lever arms and impacts
# still fit, lengths are unchanged, and rotations are not affected.  So no turn detects the negation.  It takes a rotation whose sense about
# the vertical is known: the Earth's, -Omega sin(latitude) about down.  (Any other reference does, too.)  A g-sensitivity common to
# all axes also looks like a rate about the vertical, and a latitude of the wrong sign like the negation: the message names both.

GRAVITY_SIGN = "gravity's sign"
#: sigmas: the true Earth's rate must be off by at least the first, the reversed one by at most the second
REFUTED, CONFIRMED = 8.0, 3.0
#: turns of which a first look builds the problem: more than a good session has (40), and ``fit`` alone needs all of a longer one
LOOKED_AT = 60


def check_gravity_sign(problem: Problem) -> list[Finding]:
    """Check whether the stills turn with the Earth or against it; no finding where the recording does not show it."""
    session = problem.session
    latitude_deg = session.config.site.latitude_deg
    if latitude_deg is None or session.reference is not None:
        return []
    seen = _vertical(problem.logs, problem.first)
    if seen is None:
        return []
    rate, sigma = seen
    expected = float(vertical_only(latitude_deg).rate_t[2])
    if not (abs(rate - expected) > REFUTED * sigma and abs(rate + expected) < CONFIRMED * sigma):
        return []
    text = (
        f"the stills turn about down by {rate / DEG_PER_HOUR:+.1f} ± {sigma / DEG_PER_HOUR:.1f}°/h, the Earth by "
        f"{expected / DEG_PER_HOUR:+.1f}°/h at latitude {latitude_deg:g}°: the wrong way round"
    )
    do = "is site.latitude_deg right (south is negative)? negate all axes of the accelerometer if the one that points up reads -1 g"
    where = session.logs[0].path.name if len(session.logs) == 1 else session.name
    return [Finding("warning", where, GRAVITY_SIGN, text, do)]


def first_look_at_fit(session: Session, found: SessionStills, at_rest: AtRest | None = None) -> list[Finding]:
    """Build the problem that ``fit`` solves, for a session without errors: what ``fit`` would refuse is an error; the sign of gravity; and
    what contradicts the noise figures of the unit.  Of a session of more turns, ``LOOKED_AT`` of them, in as much memory as these take.

    found: the session's stills, as the first check detected them; at_rest: the noise figures.
    """
    whole = with_bridges(session)
    try:
        problem = build_problem(whole, found=SessionStills(whole, found), most=LOOKED_AT)
        read_closure_runs(problem)
    except CalibrationError as error:
        return [Finding("error", session.name, "fit", str(error).removeprefix(f"{session.folder}: "))]
    measured = None if at_rest is None else at_rest(problem)
    part = []
    if passed := sum(segment.problem == NOT_TAKEN for segment in problem.segments):
        text = f"{len(problem.used)} of {len(problem.used) + passed} turns stand for all, from the first to the last: they can be fitted"
        part = [Finding("note", session.name, "turns fitted here", text)]
    return part + check_gravity_sign(problem) + ([] if measured is None else measured.findings(session.name))


def _vertical(logs: list[StillSet], model: LinearModel) -> tuple[float, float] | None:
    """Rate about down and its sigma, rad/s, over all yaw groups."""
    q, rate, sigma, group = reference_stills(logs)
    if not (sigma > 0).all():
        return None
    found = [vertical_rate(q[mine], model(rate[mine]), sigma[mine]) for mine in (group == each for each in np.unique(group))]
    known = np.array([each for each in found if each is not None])
    if not len(known):
        return None
    weight = known[:, 1] ** -2
    return float(known[:, 0] @ weight / weight.sum()), float(weight.sum() ** -0.5)


# The first steps of every command: read the session, check it, find its stills, build the problem.

#: use of the accelerometer calibration of session.toml: as given; not at all; as a prior with its sigma
ACCELEROMETERS = ("given", "fit", "prior")
#: mg: a prior that only separates a scale of all axes from gravity's length
WIDE_MG = 100.0
#: in addition to these: the given calibration is a prior, unless the recording refutes it
AUTO = "auto"


@dataclass(frozen=True, eq=False)
class Prepared:
    """A session ready to be fitted.

    findings of the first check, none of them an error; problem of the session; given: the problem with the accelerometer calibration of
    session.toml, or without the drift of its zero, if ``problem`` has another.
    """

    findings: list[Finding]
    problem: Problem
    given: Problem | None = None

    def __post_init__(self) -> None:
        if self.session.in_memory:
            object.__setattr__(self, "findings", [as_arguments(finding) for finding in self.findings])

    @property
    def session(self) -> Session:
        """The session that the problem was built from."""
        return self.problem.session

    @property
    def warnings(self) -> list[Finding]:
        """Findings on lost accuracy, data repair, an accelerometer calibrated by the session itself, a corrected reference.

        Wrong stamps are reported first, and nothing else with them.
        """
        stamps = [f for f in self.findings if f.what in STAMPS and f.level == "warning"]
        own = (CHANGED, BRIDGED, IMPACTS) if stamps else (CHANGED, ACCELEROMETER, BRIDGED, IMPACTS)
        reported = () if self.session.reference is None else self.session.reference.reported
        others = [f for f in self.findings if f.what not in STAMPS]
        return stamps + [f for f in others if f.level == "warning" or f.what in own or (f.what in reported and f.level == "note")]

    def as_given(self) -> Prepared:
        """The session with the calibration of session.toml, if there is one, and without a drift of its zero that was fitted."""
        if self.given is None:
            return self
        dropped = [ZERO_DRIFT] if self.given.joint is not None else [ZERO_DRIFT, ACCELEROMETER]
        return Prepared([f for f in self.findings if f.what not in dropped], self.given)


def prepare(
    session: Session | Path,
    *,
    use_earth: bool = True,
    exclude: tuple[int, ...] = (),
    accelerometer: str = AUTO,
    progress: Reporter = no_report,
    known: SessionStills | None = None,
    near: LinearModel | None = None,
    prior: PriorOf | None = None,
    at_rest: AtRest | None = None,
) -> Prepared:
    """Build the problem of a session or session folder.

    accelerometer: ``given``, ``fit``, ``prior`` or ``auto``, see ``ACCELEROMETERS``; it is fitted if session.toml has no calibration.
    known: the stills of this session, if already detected; near: a model near the gyroscope's; prior: of the unit, which reduces the number
    of turns needed; at_rest: noise figures of the unit.
    Raises DataError for the first error of the first check, CalibrationError for ``given`` without a calibration, and the errors of
    ``read_session`` and ``build_problem``.
    """
    if not isinstance(session, Session):
        session = read_session(session, lambda name: progress(f"reading {name}"))
    source = session.config.accelerometer.source
    if session.config.accelerometer.own_stills and accelerometer == AUTO:
        accelerometer = "fit"  # a calibration from these stills is no independent information
    if accelerometer in ("given", "prior") and source == "none":
        if session.in_memory:
            raise CalibrationError(f"{session.name}: it has no accelerometer= to take as {accelerometer}; leave that option out")
        raise CalibrationError(
            f"{session.folder}: session.toml gives no [accelerometer] to take as {accelerometer}; leave --accelerometer out"
        )
    session, own = with_own_accelerometer(session, refit=accelerometer == "fit", looked_at=known)
    session, aligned = session.examined()
    progress("first look")
    found = looked_at = SessionStills(session) if known is None else known.under(session)
    findings = own + aligned + check_session(session, found)
    # ``build_problem`` refuses too few turns in the same words, and knows of a prior and of what is left out by request.
    errors = [finding for finding in findings if finding.what != TURNS]
    stop_at_errors([as_arguments(finding) for finding in errors] if session.in_memory else errors)
    findings = [finding for finding in findings if finding.level != "error"]
    whole = with_bridges(session)
    found = SessionStills(whole, found)
    problem = build_problem(whole, use_earth=use_earth, exclude=exclude, found=found, near=near, prior=prior, progress=progress)
    if use_earth:
        findings = findings + check_gravity_sign(problem)
    if at_rest is not None and (measured := at_rest(problem)) is not None:
        problem = problem.changed(at_rest=measured)
        findings = findings + measured.findings(session.name)
    if accelerometer == "given" or source not in ("given", "none"):  # or an earlier estimate
        return Prepared(findings, problem)
    progress("accelerometer")
    if source == "none" or accelerometer == "fit":
        return _fitted(findings, problem, own)
    joint = fit_joint(problem, "prior", session.config.accelerometer.sigma_mg or GIVEN_SIGMA_MG)
    if joint is None or joint.p_value is None:
        return Prepared(findings, problem)
    if joint.p_value > REFUTED_P:
        return Prepared(findings + drift_finding(joint.drift), recalibrated(problem, joint), problem)
    own_findings = [_refuted(joint, fit_joint(problem, "prior", WIDE_MG, tested=False))]
    if accelerometer == "prior":
        return Prepared(own_findings + findings + drift_finding(joint.drift), recalibrated(problem, joint), problem)
    free = prepare(
        session,
        use_earth=use_earth,
        exclude=exclude,
        accelerometer="fit",
        progress=progress,
        known=looked_at,
        near=problem.first,
        prior=prior,
        at_rest=at_rest,
    )
    return Prepared(own_findings + free.findings, free.problem, problem)


def _fitted(findings: list[Finding], problem: Problem, own: list[Finding]) -> Prepared:
    """Prepare the jointly fitted problem; parameters observed by turns and not by lengths are observable after all."""
    joint = fit_joint(problem, "fit") if problem.session.config.accelerometer.source == "stills" else None
    if joint is None:
        return Prepared(findings, problem)
    own_findings = [_joint_finding(f, joint) if f in own and f.what == ACCELEROMETER else f for f in findings if f.what != ZERO_DRIFT]
    if joint.drift is None:
        return Prepared(own_findings, recalibrated(problem, joint))
    constant = fit_joint(problem, "fit", drifts=False)
    assert constant is not None  # the same problem was fitted before
    return Prepared(own_findings + drift_finding(joint.drift), recalibrated(problem, joint), recalibrated(problem, constant))


def _joint_finding(finding: Finding, joint: JointFit) -> Finding:
    text = finding.description.split("; not observable")[0]
    if not joint.unobserved:
        return replace(finding, level="note", description=text + "; sharpened by the turns")
    return replace(finding, description=f"{text}; not observable: {', '.join(joint.unobserved)}")


def _refuted(joint: JointFit, free: JointFit | None) -> Finding:
    text = f"the given calibration no longer agrees with the data ({probability(joint.p_value)})"
    if free is not None:
        text += f": {free.words}"
    do = "the fit takes what these stills and turns give; calibrate the accelerometer again, or keep it with --accelerometer given"
    return Finding("warning", "session.toml", ACCELEROMETER, text, do)
