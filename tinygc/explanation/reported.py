"""What a report states: the fit, the explanation, the calibration that is reported, pass or fail."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from session.base import features
from session.base.numeric import sigmas_in
from session.base.progress import Progress, no_report
from session.base.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, EARTH_RATE_RPS, PPM
from session.log.config import Accelerometer
from session.log.folder import Session, file_key, hash_of_log, input_hashes
from tinygc import models
from tinygc.closure.build import build_problem
from tinygc.closure.floor import AllanCurve, angle_random_walk, bias_instability
from tinygc.closure.problem import Problem
from tinygc.effects import AppliedEffect, catalogue
from tinygc.estimation.bias import tilt_rms
from tinygc.estimation.options import FitOptions
from tinygc.estimation.physics import covariance_at_end, loss_words, model_at
from tinygc.estimation.systematic import Systematic
from tinygc.explanation.claims import LEFT
from tinygc.explanation.engine import Explanation, explain_session
from tinygc.explanation.physics import lost_in, physics_methods
from tinygc.fitting.fit import fit_session, prepared_for
from tinygc.fitting.results import AT_END, FitResult
from tinygc.inference.decide import Fact
from tinygc.inference.solve import freedom_of
from tinygc.models.linear import PARAMETERS, LinearModel, field_facts
from tinygc.models.model import accelerometer_table, sensor_table
from tinygc.models.physics import PhysicsModel
from tinygc.models.versions import versions
from tinygc.noise.components import known_whitener
from tinygc.noise.refit import refit
from tinygc.noise.stillness import stillness
from tinygc.noise.thinned import conditions
from tinygc.noise.twin import State, Twin
from tinygc.noise.whitening import Whitener
from tinygc.verdict.acceptance import Acceptance, CandidateFit

# Effects beyond the linear model, measured in every report: g-sensitivity and scale-factor asymmetry, each with its uncertainty.
#
# Both are reported whether or not they are significant.  Each is refitted exactly, together with the linear model, the Earth's unknown
# part and the effects named before, on the closure, the stills' rates and gravity's length.

G_SENSITIVITY, ASYMMETRY = "gyro.g_sensitivity", "gyro.scale_asymmetry"
#: a sigma above this share of the plausible size comes from the prior, not from the session
OBSERVED_SHARE = 0.3


def beyond_linear(twin: Twin, whiten: Whitener, start: State | None = None) -> list[Fact]:
    """Estimate nine g-sensitivities (dps/g: what each axis adds to the true rate per g along each axis) and three asymmetries (ppm: scale
    factor for positive less that for negative rates, over their mean); ``start`` holds the effects that are in the model."""
    start = twin.start() if start is None else start
    named = [claim.effect for claim in start.claims]
    known = {effect.id for effect in named}
    # Fitted together, so that neither effect widens or biases the other through its residuals.
    tried = [catalogue()[name] for name in (G_SENSITIVITY, ASYMMETRY) if name not in known]
    fit = refit(twin, whiten, [*named, *tried], start)
    quantities = []
    for number, claim in enumerate(fit.state.claims):
        covariance = fit.theta_covariance(number) * fit.widened
        if claim.effect.id == G_SENSITIVITY:
            note = ""
            if twin.problem.earth.source == "none":
                # Equal g-sensitivities on the diagonal are a rate about the vertical: the Earth's rotation, if its latitude is unknown.
                alike = np.eye(3).ravel()
                covariance = covariance + np.outer(alike, alike) * EARTH_RATE_RPS**2 / 3
                note = "the diagonal's mean may be the Earth's vertical rate: no latitude is given"
            notes = {f"{axis} per g on {along}": note if axis == along else "" for axis in "xyz" for along in "xyz"}
            quantities += _facts("g-sensitivity", "dps/g", DEG, claim, covariance, notes)
        if claim.effect.id == ASYMMETRY:
            quantities += _facts("scale factor asymmetry", "ppm", PPM / 2, claim, covariance, dict.fromkeys("xyz", ""))
    return sorted(quantities, key=lambda quantity: quantity.word != "g-sensitivity")


def _facts(word: str, unit: str, si: float, claim: AppliedEffect, covariance: np.ndarray, notes: dict[str, str]) -> list[Fact]:
    """A fact of each number of a claim with covariance (P, P), by its component, with its note."""
    sigma = sigmas_in(covariance)
    observed = sigma < OBSERVED_SHARE * claim.effect.parameter.plausible
    return [
        Fact(word, unit, float(claim.theta[i] / si), float(sigma[i] / si), np.inf, bool(observed[i]), name, note=note)
        for i, (name, note) in enumerate(notes.items())
    ]


# Which calibration a report states: the linear one, or the one with physics if ``explain`` named effects and it closes better.

#: names of the two calibrations
LINEAR, PHYSICS = "least_squares", "physics"


@dataclass(frozen=True, eq=False, kw_only=True)
class Adopted(CandidateFit):
    """Calibration that is reported: what its verdict looks at, and more.

    name (least_squares or physics); model, whose parameters are 12 linear ones, then the effects'; claims: the effects in it; quantities in
    the field's terms; accelerometer that gives its references.
    """

    name: str
    model: LinearModel | PhysicsModel
    covariance: np.ndarray
    claims: tuple[AppliedEffect, ...]
    quantities: list[Fact]
    accelerometer: Accelerometer
    allowed: Systematic | None = None

    @property
    def linear(self) -> LinearModel:
        """The linear part of the model."""
        return LinearModel.from_vector(self.vector[:PARAMETERS])

    @property
    def in_use(self) -> LinearModel | PhysicsModel:
        """The model for logs of any time, with effects that follow the session's time held at its end."""
        return self.model.at_end() if isinstance(self.model, PhysicsModel) else self.model

    @property
    def follows_session(self) -> tuple[str, ...]:
        """Ids of effects that follow the session's time, and are constant in ``in_use``."""
        return tuple(claim.effect.id for claim in self.claims if claim.effect.of_one_session)

    @property
    def method(self) -> str:
        """Name that ``fit`` gives to ``in_use``."""
        return self.name + AT_END if self.follows_session else self.name

    @property
    def times_floor(self) -> float:
        """Ratio of held-out closure to the floor."""
        return tilt_rms(self.angles) / self.floor_rms

    @property
    def in_numbers(self) -> str:
        """Number of segments and of parameters, as text."""
        return f"{len(self.numbers)} segments for {len(self.vector)} parameters"

    @property
    def title(self) -> str:
        """Title in tables."""
        return "least squares" if self.name == LINEAR else "linear model with physics"


def adopt(fit: FitResult, explanation: Explanation | None) -> Adopted:
    """Choose the calibration to report."""
    losses = [loss_words(lost_in(run)) for run in fit.runs]
    if explanation is not None and any(claim.effect.kind == "rate" for claim in explanation.proof.fit.state.claims):
        proof, problem = explanation.proof, explanation.repaired.problem
        if tilt_rms(proof.after) < tilt_rms(proof.before):
            claims = tuple(claim for claim in proof.fit.state.claims if claim.effect.kind == "rate")
            known = conditions(problem)
            candidate = fit.candidate_of(explanation.twin.original, proof.after, proof.after_numbers, (proof.fit, claims, known))
            assert candidate.covariance is not None  # ``candidate_of`` gives one
            return Adopted(
                **vars(candidate) | {"run_losses": losses},
                name=PHYSICS,
                model=model_at(candidate.vector, claims, known),
                claims=claims,
                quantities=field_facts(candidate.vector[:PARAMETERS], candidate.covariance[:PARAMETERS, :PARAMETERS], candidate.unobserved),
                accelerometer=problem.session.config.accelerometer,
            )
    linear = fit.linear.linear
    return Adopted(
        **vars(fit.candidate_of(fit.problem, fit.linear.held_out)) | {"run_losses": losses},
        name=LINEAR,
        model=linear,
        claims=(),
        quantities=field_facts(
            linear.vector, fit.covariance, fit.linear.unobserved, None if fit.allowed is None else fit.allowed.of, fit.sources
        ),
        accelerometer=fit.session.config.accelerometer,
    )


def model_table(adopted: Adopted, fit: FitResult) -> dict:
    """The calibration for logs of any time as ``tinygc-model/1``, as saved by ``fit``."""
    from session import VERSION

    hashes = input_hashes(fit.session)
    more = {"method": adopted.method, "session": fit.session.name, "sha256": hashes, "version": VERSION}
    more |= {"sensor": sensor_table(fit.session.config.sensor), "accelerometer": accelerometer_table(adopted.accelerometer)}
    if adopted.name == LINEAR:
        more |= {"covariance": adopted.covariance.tolist(), "unobserved": fit.linear.unobserved}
    else:
        assert isinstance(adopted.model, PhysicsModel)  # by construction in ``_with_physics``
        more |= covariance_at_end(adopted.model, adopted.covariance)
    return models.to_dict(adopted.in_use, **more)


# Data of a report: the fit, the explanation, and further measurements.


@dataclass(frozen=True, eq=False)
class ReportData:
    """Data of a report.

    fit; explanation or None; adopted: the reported calibration; decision; quantities: every number of the parameter tables, in the field's
    terms; allan or None; hashes of the session's files; versions; made: date and time of the report; limit_deg or None; searched: result
    of an earlier ``explain --discover``, as the discovery feature reads it, or None.
    """

    fit: FitResult
    explanation: Explanation | None
    adopted: Adopted
    decision: Acceptance
    quantities: list[Fact]
    allan: AllanCurve | None
    hashes: dict[str, str]
    versions: dict[str, str]
    made: str
    limit_deg: float | None
    searched: Any = None

    @property
    def problem(self) -> Problem:
        """The problem that was fitted."""
        return self.fit.problem

    @property
    def ranges_known(self) -> bool:
        """Whether the full scales are the sensor's, by its data sheet or since the logs are registers; else they may be assumed."""
        session = self.fit.session
        return session.config.sensor.profile is not None or all(log.raw for log in session.logs)

    @property
    def verdict(self) -> str | None:
        """Verdict of ``explain``; None if it was not run."""
        return None if self.explanation is None else self.explanation.verdict


def gather(
    session: Session | Path,
    options: FitOptions,
    *,
    explain: bool = True,
    limit_deg: float | None = None,
    fit: FitResult | None = None,
    progress: Progress | None = None,
) -> ReportData:
    """Run fit and explain of a session or a session folder.

    fit: the fit of this session with these options, where it was run before.
    The session is read, checked and turned into a problem once, for both.  Raises what ``fit_session`` and ``explain_session`` raise.
    """
    progress = progress or no_report
    prepared = None
    folder = session if isinstance(session, Path) else None if session.in_memory else session.folder
    if explain or fit is None:
        prepared = prepared_for(session, options, progress)
    logs = {file_key(log.path): hash_of_log(log) for log in prepared.session.logs} if explain and prepared is not None else {}
    if fit is None:
        fit = fit_session(session, options, progress, prepared=prepared, physics=physics_methods)
    if options.exclude and prepared is not None and explain:  # segments excluded from the fit are explained all the same
        prepared = prepared.as_given()
        problem = build_problem(prepared.session, use_earth=options.earth, found=prepared.problem.found)
        prepared = replace(prepared, problem=problem.changed(at_rest=prepared.problem.at_rest))
    how: dict[str, Any] = {"seed": options.seed, "use_earth": options.earth, "progress": progress, "prepared": prepared}
    explanation = explain_session(session, fit=fit, **how) if explain else None
    progress("further figures of the session", 0, 1)
    # With a further reference the linear model is reported: what is named there may be the reference's.
    of_sensor = explanation if fit.session.reference is None else None
    adopted = adopt(fit, of_sensor)
    allan = stillness(fit.problem)
    # The twin needs stills, which a session with a further reference may lack.
    beyond = [] if fit.session.reference is not None else _beyond(fit, explanation, adopted)
    quantities = [*adopted.quantities, *beyond, *_noise(allan)]
    # UTC time, or that of SOURCE_DATE_EPOCH, which makes reports reproducible to the byte.
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    moment = datetime.fromtimestamp(int(epoch), UTC) if epoch.isdigit() else datetime.now(UTC)
    return ReportData(
        fit=fit,
        explanation=explanation,
        adopted=adopted,
        decision=decided(fit, of_sensor, adopted, limit_deg),
        quantities=quantities,
        allan=allan,
        hashes=input_hashes(fit.session),
        versions=versions(),
        made=moment.strftime("%Y-%m-%d %H:%M UTC"),
        limit_deg=limit_deg,
        searched=features.first("earlier results of a report", folder, logs) if explain and folder is not None else None,
    )


def decided(fit: FitResult, explanation: Explanation | None, adopted: Adopted, limit_deg: float | None = None) -> Acceptance:
    """The verdict of ``fit`` on the adopted calibration; with named effects, what is left without a name is a doubt."""
    is_linear = adopted.name == LINEAR
    left = [] if is_linear or explanation is None or explanation.verdict not in LEFT else [explanation.words[0]]
    return fit.decided(adopted, is_linear, limit_deg, left)


def _beyond(fit: FitResult, explanation: Explanation | None, adopted: Adopted) -> list[Fact]:
    if explanation is not None and adopted.claims:
        return beyond_linear(explanation.twin, explanation.whiten, explanation.naming.fit.state)
    twin = explanation.twin if explanation is not None else Twin(fit.problem)
    whiten = explanation.whiten if explanation is not None else known_whitener(twin)
    return beyond_linear(twin, whiten)


def _noise(curve: AllanCurve | None) -> list[Fact]:
    """Angle random walk and bias instability of each axis."""
    if curve is None:
        return []
    return [
        Fact(word, unit, read.value / si, read.sigma / si, freedom, read.observed, axis, at_most=read.at_most / si)
        for word, unit, si, reading in (
            ("angle random walk", "°/√h", DEG_PER_SQRT_HOUR, angle_random_walk),
            ("bias instability", "°/h", DEG_PER_HOUR, bias_instability),
        )
        for number, axis in enumerate("xyz")
        for read in [reading(curve, number)]
        for freedom in [freedom_of(read.value, read.sigma) if read.observed else np.inf]
    ]
