"""The result of a fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from session.detect.check_stills import NO_STILLS
from session.detect.check_time import looks_counted
from session.detect.findings import Finding
from session.detect.signatures import FILTER, TRACKED
from session.log.config import NominalRate
from session.log.folder import Session
from tinygc.closure.least_squares import PriorUse
from tinygc.closure.problem import Problem
from tinygc.closure.runs import ClosureRun
from tinygc.closure.uncertainty import GoodnessOfFit, goodness
from tinygc.estimation.accelerometer import AccelerometerFit, accelerometer_fit
from tinygc.estimation.bias import BiasChoice
from tinygc.estimation.choice import AgainstRaw, ModelToUse, model_to_use
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.estimation.physics import errors_with_physics, rate_covariance, rows_of_rates
from tinygc.estimation.spread import ACCELEROMETER, USUAL, Spread
from tinygc.estimation.stated_noise import StatedNoise
from tinygc.estimation.systematic import Systematic
from tinygc.inference.decide import KINDS
from tinygc.inference.solve import Source
from tinygc.models.linear import LinearModel
from tinygc.verdict.acceptance import Acceptance, CandidateFit, decide, promise_of, run_p_values, too_good, too_wide
from tinygc.verdict.model_tests import GRAVITY, ModelTest, model_tests

if TYPE_CHECKING:
    from tinygc.effects import AppliedEffect, Conditions
    from tinygc.estimation.physics import PhysicsFit
    from tinygc.noise.refit import Refit


#: findings of the first look with which a pass is weak evidence: not all of the log was used, or not all turns are alike
DOUBTED = (NO_STILLS, FILTER, TRACKED)

AT_END = "_at_end"
#: methods that are fitted to the problem of the named physics
PHYSICS = ("physics", "tinygc_physics")


@dataclass(frozen=True, eq=False)
class FitResult:
    """The result of a fit.

    methods by name; runs with errors_rad by file and method; covariance (12, 12) of least squares' parameters, already scaled by
    ``widened``, the variance inflation that no noise explains; accelerometer_covariance (12, 12): its part from the accelerometer's
    pre-calibration; noise estimated from the recording, None where it is not; bias_from: source of the bias; against_raw: whether the fits
    are better than raw rates; warnings of the first check; physics that was fitted as well, or None;
    joint_covariance (21, 21): of both sensors (``accelerometer.JOINT_NAMES``), inflated as well, where they were estimated jointly, and
    joint_sources that it is the sum of; joint_shared (21, 21): its part from a given calibration; prior: its use, None without one;
    not_run: why a requested method cannot run on this session, by name; allowed: how far one effect that the recording still
    allows moves the parameters, None where the noise is not estimated; spread: of the unit's 21 numbers
    between its sessions; sources: the parts that ``covariance`` is the sum of.
    """

    problem: Problem
    options: FitOptions
    methods: dict[str, MethodFit]
    runs: list[ClosureRun]
    run_errors: list[dict[str, np.ndarray]]
    goodness: GoodnessOfFit
    linear: MethodFit
    covariance: np.ndarray
    widened: float
    bias_from: BiasChoice
    against_raw: AgainstRaw
    warnings: list[Finding]
    physics: PhysicsFit | None = None
    noise: StatedNoise | None = None
    accelerometer_covariance: np.ndarray | None = None
    joint_covariance: np.ndarray | None = None
    joint_sources: tuple[Source, ...] = ()
    joint_shared: np.ndarray | None = None
    prior: PriorUse | None = None
    not_run: dict[str, str] = field(default_factory=dict)
    allowed: Systematic | None = None
    spread: Spread = USUAL
    sources: tuple[Source, ...] = ()

    def __repr__(self) -> str:
        return f"<FitResult {self.session.name}: {', '.join(self.methods)}>"

    @cached_property
    def accelerometer(self) -> AccelerometerFit:
        """The accelerometer's calibration that the references depend on."""
        config = self.session.config
        gravity_mps2 = config.site.expected_gravity_mps2
        found = accelerometer_fit(config.accelerometer, self.problem.joint, self.joint_covariance, gravity_mps2, self.joint_sources)
        return replace(found, between=self.spread.at(ACCELEROMETER))

    @property
    def session(self) -> Session:
        """The fitted session."""
        return self.problem.session

    @property
    def nominal_rate(self) -> NominalRate | None:
        """The data rate that stands for a clock: the scale common to all axes is no better known.  None where stamps are measured."""
        return self.session.nominal_rate

    @cached_property
    def use(self) -> ModelToUse:
        """The model to use, and why."""
        problems = {name: self.physics.problem if self.physics and name in PHYSICS else self.problem for name in self.methods}
        return model_to_use(self.methods, self.against_raw, {name: [s.number for s in p.used] for name, p in problems.items()})

    @cached_property
    def candidate(self) -> CandidateFit:
        """The figures that the verdict looks at: those of named physics where that is the model to use, else of least squares."""
        physics, name = self.physics, self.use.method
        # Another than least squares closes by its own errors, and within the same uncertainties.
        left = [found[name] for found in self.run_errors] if name in self.methods else None
        if physics is not None and name in PHYSICS:
            terms = physics.fit, physics.model.claims, physics.model.known
            return self.candidate_of(physics.problem, self.methods[name].held_out, terms=terms, left=left)
        return self.candidate_of(self.problem, self.methods.get(name or "", self.linear).held_out, left=left)

    def candidate_of(
        self,
        problem: Problem,
        angles: np.ndarray,
        numbers: list[int] | None = None,
        terms: tuple[Refit, tuple[AppliedEffect, ...], Conditions] | None = None,
        left: list[np.ndarray] | None = None,
    ) -> CandidateFit:
        """The figures of the linear model, or of a fit with effects under their conditions.  angles (S, d) rad, held out, of the segments
        with these numbers, those of the problem if None; left: errors of the closure runs, by the model itself if None."""
        errors: Callable[[np.ndarray, ClosureRun], np.ndarray]
        chance: tuple[float, int | None]
        if terms is None:
            vector, covariance, chance = self.linear.linear.vector, self.covariance, (self.goodness.p_value, self.goodness.freedom)
            errors = lambda trial, run: run.errors(LinearModel.from_vector(trial))  # noqa: E731
        else:
            fit, claims, known = terms
            vector, covariance = fit.state.vector[rows_of_rates(fit.state)], rate_covariance(fit, self.session.clock)
            errors, chance = errors_with_physics(claims, known, fit.state.earth_t), (fit.p_value, None)
        return CandidateFit(
            angles,
            [segment.number for segment in problem.used] if numbers is None else numbers,
            vector,
            problem.floor.tilt_rms,
            closure_p=chance[0],
            closure_freedom=chance[1],
            run_errors=[errors(vector, run) for run in self.runs] if left is None else left,
            run_p=run_p_values(self.problem, self.runs, vector, covariance, errors, self.spread, left),
            run_losses=[""] * len(self.runs),
            run_floors=[run.floor_rad for run in self.runs],
            covariance=covariance,
            sources=self.sources if terms is None else (),
            unobserved=self.linear.unobserved,
            allowed=self.allowed if terms is None else None,
        )

    @cached_property
    def doubts(self) -> list[str]:
        """Reasons, other than the closure's, for which a pass of this session is weak evidence."""
        known = [] if self.nominal_rate is None else [self.nominal_rate.doubt]
        if not self.against_raw.held_out:
            known.append("no method was fitted: ask for least_squares")
        if counted := [log.path.name for log in self.session.logs if looks_counted(log, self.session.config.sensor)]:
            known.append(f"{counted[0]}: the stamps look counted, so the scale common to all axes is not known; give sensor.odr_sigma")
        known += [f"{w.where}: {w.what}: {w.description}" for w in self.warnings if w.what in DOUBTED]
        return known + too_good(goodness(self.problem.batch, self.problem.floor, self.linear.linear).p_value)

    def verdict(self, limit_deg: float | None = None) -> Acceptance:
        """PASS, NOT DECIDED or FAIL, with the rule and the reasons."""
        if limit_deg not in self._verdicts:
            is_linear = self.use.method not in PHYSICS
            more = [KINDS["partly_explained"].word] if not is_linear and self.physics is not None and self.physics.refused else []
            self._verdicts[limit_deg] = self.decided(self.candidate, is_linear, limit_deg, more)
        return self._verdicts[limit_deg]

    @cached_property
    def _verdicts(self) -> dict[float | None, Acceptance]:
        """By limit, deg: the screen, the files and the exit code have the same."""
        return {}

    def decided(self, candidate: CandidateFit, is_linear: bool, limit_deg: float | None = None, doubts: Sequence[str] = ()) -> Acceptance:
        """The verdict on a calibration of this session.  is_linear: whether it is the linear model, of which ``tests`` are; doubts other
        than this session's own, and than those of an effect missing from the linear model that may have moved it too far."""
        wide = [] if self.allowed is None or not is_linear else too_wide(self.allowed.tilt_rms, limit_deg, self.against_raw)
        return decide(
            candidate,
            [run.file for run in self.runs],
            limit_deg,
            self.against_raw,
            self.accelerometer,
            [*self.doubts, *wide, *doubts],
            self.session.config.requirements,
            [test for test in self.tests if is_linear or test.name == GRAVITY],
            promise_of(self.problem),
        )

    @cached_property
    def without_physics(self) -> FitResult:
        """The fit without the physics that were named in it: ``explain`` takes it so, since its verdict is on what is to be explained."""
        if self.physics is None:
            return self
        methods = {name: fit for name, fit in self.methods.items() if name not in PHYSICS}
        errors = [{name: error[name] for name in methods} for error in self.run_errors]
        held_out = {name: tilt for name, tilt in self.against_raw.held_out.items() if name in methods}
        raw = replace(self.against_raw, held_out=held_out)
        return replace(self, physics=None, methods=methods, run_errors=errors, against_raw=raw)

    @cached_property
    def tests(self) -> tuple[ModelTest, ...]:
        """Whether the recording contradicts the linear model."""
        runs = dict(zip((run.file for run in self.runs), self.without_physics.candidate.run_p, strict=True))
        latitude_deg = self.session.config.site.latitude_deg
        return model_tests(self.goodness, runs, self.noise, self.allowed, self.accelerometer, latitude_deg)

    @property
    def file_to_use(self) -> str | None:
        """The name of that model's file; where it follows its session's time, that of the model for any time."""
        name, physics = self.use.method, self.physics
        if name is None:
            return None
        return f"model_{name}{AT_END if physics and name in PHYSICS and physics.model.session_s is not None else ''}.json"
