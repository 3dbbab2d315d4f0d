"""Everything a fit found."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from session.checks.first_look import Finding
from session.log.folder import Session
from tinygc.closure.uncertainty import GoodnessOfFit
from tinygc.fitting.accelerometer import AccelerometerFit, accelerometer_fit
from tinygc.fitting.against_raw import AgainstRaw
from tinygc.fitting.bias_choice import BiasChoice
from tinygc.fitting.lot_prior import LotUse
from tinygc.fitting.model_to_use import ModelToUse, model_to_use
from tinygc.fitting.stated_noise import StatedNoise
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.problem.closure_run import ClosureRun
from tinygc.problem.problem import Problem

if TYPE_CHECKING:
    from tinygc.fitting.physics.fit_physics import PhysicsFit


#: ends the name of a model for any time, as of its session's end, beside one that follows the session's time
AT_END = "_at_end"
#: methods that are fitted to the problem that physics is
PHYSICS = ("physics", "tinygc_physics")


@dataclass(frozen=True, eq=False)
class FitResult:
    """Everything a fit found.

    methods by name; runs with errors_rad by file and method; covariance (12, 12) of least squares' parameters, already scaled by
    ``widened``, what no noise explains; accelerometer_covariance (12, 12): what of it the accelerometer's pre-calibration adds; noise
    that the recording shows, None where it is not estimated; bias_from: where the bias comes from; other_choice: least squares with the
    opposite choice of still rates; against_raw: whether what was fitted is better than nothing; first_order_rad: the largest error of
    the paper's integrator on these segments; warnings of the first look; physics that was fitted as well, or None; reused: methods that
    were not fitted again, but taken from what had been saved; lost_s: with physics, moments in each run after which samples seem to be
    missing; bias_sigma_rps (3,): spread of the logs' biases, where each had its own; joint_covariance (21, 21): of both sensors together
    (``accelerometer.JOINT_NAMES``), widened as well, where they were estimated together; joint_shared
    (21, 21): what of it comes from a calibration that was given; lot: what came from the prior of a lot, None without one.
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
    other_choice: MethodFit
    against_raw: AgainstRaw
    first_order_rad: float
    warnings: list[Finding]
    physics: PhysicsFit | None = None
    reused: tuple[str, ...] = ()
    bias_sigma_rps: np.ndarray | None = None
    lost_s: tuple[np.ndarray, ...] = ()
    noise: StatedNoise | None = None
    accelerometer_covariance: np.ndarray | None = None
    joint_covariance: np.ndarray | None = None
    joint_shared: np.ndarray | None = None
    lot: LotUse | None = None

    def __repr__(self) -> str:
        return f"<FitResult {self.session.name}: {', '.join(self.methods)}>"

    @property
    def accelerometer(self) -> AccelerometerFit:
        """That its references rest on."""
        config = self.session.config
        return accelerometer_fit(config.accelerometer, self.problem.joint, self.joint_covariance, config.site.expected_gravity_mps2)

    @property
    def session(self) -> Session:
        """That was fitted."""
        return self.problem.session

    @cached_property
    def use(self) -> ModelToUse:
        """Which of the models to use, and why."""
        problems = {name: self.physics.problem if self.physics and name in PHYSICS else self.problem for name in self.methods}
        return model_to_use(self.methods, self.against_raw, {name: [s.number for s in p.used] for name, p in problems.items()})

    @property
    def file_to_use(self) -> str | None:
        """The name of that model's file; of one that follows its session's time, the one for any time."""
        name, physics = self.use.method, self.physics
        if name is None:
            return None
        return f"model_{name}{AT_END if physics and name in PHYSICS and physics.model.session_s is not None else ''}.json"
