"""Which calibration a report states: the linear one, or, where ``explain`` has named physics and it closes better, the one with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from session.log.config import Accelerometer
from session.log.hashes import input_hashes
from tinygc import models
from tinygc.closure.bias_wander import wander_covariance
from tinygc.closure.uncertainty import MISMATCH_P
from tinygc.effects import AppliedEffect
from tinygc.explanation.verdict.explain import Explanation
from tinygc.fitting.physics.covariance import covariance_at_end, rate_covariance, rows_of_rates
from tinygc.fitting.physics.lost_in_runs import loss_words, lost_in
from tinygc.fitting.result import AT_END, FitResult
from tinygc.models.accelerometer import accelerometer_table, sensor_table
from tinygc.models.field_parameters import Quantity, field_quantities
from tinygc.models.linear import BIAS, PARAMETERS, LinearModel
from tinygc.models.physics import PhysicsModel
from tinygc.problem.closure_run import ClosureRun
from tinygc.problem.conditions import conditions
from tinygc.report.html.numbers import tilt_rms

#: of what is left after naming, channel by channel (tinygc.explain)
LINEAR, PHYSICS = "least_squares", "physics"


@dataclass(frozen=True, eq=False)
class Adopted:
    """name (least_squares or physics); model; angles (S, d) rad held out, of segments by their numbers; floor_rms rad of tilt that
    noise alone leaves on them; closure_p: of what it leaves on segments that it was fitted to, with closure_freedom degrees (None: with
    more data than these segments);
    vector and covariance of its parameters (12 linear ones first, then the effects'); claims: the effects in it; errors (3,) rad of
    each closure run and how probable more is from what is known to be uncertain; run_losses: a sentence for each run in which
    samples seem lost, else none; quantities in the field's words; accelerometer that its references rest on."""

    name: str
    model: LinearModel | PhysicsModel
    angles: np.ndarray
    numbers: list[int]
    floor_rms: float
    closure_p: float
    closure_freedom: int | None
    vector: np.ndarray
    covariance: np.ndarray
    claims: tuple[AppliedEffect, ...]
    run_errors: list[np.ndarray]
    run_p: list[float]
    run_losses: list[str]
    quantities: list[Quantity]
    accelerometer: Accelerometer

    @property
    def linear(self) -> LinearModel:
        """Its linear part."""
        return LinearModel.from_vector(self.vector[:PARAMETERS])

    @property
    def in_use(self) -> LinearModel | PhysicsModel:
        """The model for logs of any time, as of the session's end."""
        return self.model.at_end() if isinstance(self.model, PhysicsModel) else self.model

    @property
    def follows_session(self) -> tuple[str, ...]:
        """Ids of its effects that follow the session's time, and stand still in ``in_use``."""
        return tuple(claim.effect.id for claim in self.claims if claim.effect.of_one_session)

    @property
    def method(self) -> str:
        """What ``fit`` calls ``in_use``."""
        return self.name + AT_END if self.follows_session else self.name

    @property
    def times_floor(self) -> float:
        """Held-out closure over what noise alone leaves."""
        return tilt_rms(self.angles) / self.floor_rms

    @property
    def in_numbers(self) -> str:
        """By how much data its parameters are held."""
        return f"{len(self.numbers)} segments for {len(self.vector)} parameters"

    @property
    def title(self) -> str:
        """In tables."""
        return "least squares" if self.name == LINEAR else "linear model with physics"


def adopt(fit: FitResult, explanation: Explanation | None) -> Adopted:
    """The calibration to report."""
    if explanation is not None and any(claim.effect.kind == "rate" for claim in explanation.naming.fit.state.claims):
        before, after = (tilt_rms(x) for x in (explanation.proof.before, explanation.proof.after))
        if after < before:
            return _with_physics(fit, explanation)
    linear = fit.linear.model
    assert isinstance(linear, LinearModel)
    vector, covariance = linear.vector, fit.covariance

    def errors(trial: np.ndarray, run: ClosureRun) -> np.ndarray:
        return run.errors(LinearModel.from_vector(trial), fit.options.integrator)

    unobserved = tuple(fit.linear.notes.get("unobserved", ()))
    return Adopted(
        name=LINEAR,
        model=linear,
        angles=fit.linear.held_out,
        numbers=[segment.number for segment in fit.problem.used],
        floor_rms=fit.problem.floor.tilt_rms,
        closure_p=fit.goodness.p_value,
        closure_freedom=fit.goodness.freedom,
        vector=vector,
        covariance=covariance,
        claims=(),
        **_runs(fit, vector, covariance, errors),
        quantities=field_quantities(vector, covariance, unobserved),
        accelerometer=fit.session.config.accelerometer,
    )


def _with_physics(fit: FitResult, explanation: Explanation) -> Adopted:
    found = explanation.naming.fit
    claims = tuple(claim for claim in found.state.claims if claim.effect.kind == "rate")
    known = conditions(explanation.mended.problem)
    vector, covariance = found.state.vector[rows_of_rates(found.state)], rate_covariance(found)

    def model(trial: np.ndarray) -> PhysicsModel:
        at, changed = PARAMETERS, []
        for claim in claims:
            changed.append(AppliedEffect(claim.effect, trial[at : at + len(claim.theta)]))
            at += len(claim.theta)
        return PhysicsModel(LinearModel.from_vector(trial), tuple(changed), known)

    def errors(trial: np.ndarray, run: ClosureRun) -> np.ndarray:
        rate = run.rates(model(trial))
        return run.with_earth(found.state.earth_t, rate).errors_at(rate)

    return Adopted(
        name=PHYSICS,
        model=model(vector),
        angles=explanation.proof.after,
        numbers=explanation.proof.after_numbers,
        floor_rms=explanation.proof.floor_rms,
        closure_p=float(explanation.left["closure"]),
        closure_freedom=None,
        vector=vector,
        covariance=covariance,
        claims=claims,
        **_runs(fit, vector, covariance, errors),
        quantities=field_quantities(vector[:PARAMETERS], covariance[:PARAMETERS, :PARAMETERS]),
        accelerometer=explanation.mended.problem.session.config.accelerometer,
    )


def _runs(fit: FitResult, vector: np.ndarray, covariance: np.ndarray, errors: Callable[[np.ndarray, ClosureRun], np.ndarray]) -> dict:
    """Each closure run's error, and the probability of more from noise, from the parameters' own uncertainty, and from a bias that has
    wandered on since the session."""
    from scipy.stats import chi2

    found, p = [], []
    sigma = np.sqrt(np.diag(covariance))
    for run in fit.runs:
        error = errors(vector, run)
        slope = np.stack([(errors(vector + step, run) - error) / step.max() for step in np.diag(sigma)], axis=1)
        drift = slope[:, BIAS] * np.sqrt(_wander_since(fit, run))
        expected = np.diag(run.floor_rad**2) + slope @ covariance @ slope.T + drift @ drift.T
        found.append(error)
        p.append(float(chi2.sf(error @ np.linalg.solve(expected, error), 3)))
    return {"run_errors": found, "run_p": p, "run_losses": [loss_words(lost_in(run)) for run in fit.runs]}


def _wander_since(fit: FitResult, run: ClosureRun) -> float:
    """(rad/s)^2: variance of the bias in the run less its mean in the session."""
    moments = np.r_[run.began_s + run.duration_s / 2, fit.problem.middle_s]
    spans = np.r_[run.duration_s, fit.problem.batch.duration_s]
    wander = wander_covariance(moments, spans, instability_rps=fit.problem.instability.rps)
    contrast = np.r_[1.0, np.full(len(moments) - 1, -1 / (len(moments) - 1))]
    return float(contrast @ wander @ contrast)


def agrees(p_value: float) -> bool:
    """Whether noise explains it."""
    return p_value >= MISMATCH_P


def model_table(adopted: Adopted, fit: FitResult) -> dict:
    """The calibration for logs of any time as ``tinygc-model/1``, as ``fit`` saves it."""
    from session.common.version import VERSION

    hashes = input_hashes(fit.session)
    more = {"method": adopted.method, "session": fit.session.name, "sha256": hashes, "version": VERSION}
    more |= {"sensor": sensor_table(fit.session.config.sensor), "accelerometer": accelerometer_table(adopted.accelerometer)}
    if adopted.name == LINEAR:
        more |= {"covariance": adopted.covariance.tolist(), "unobserved": fit.linear.notes.get("unobserved", [])}
    else:
        assert isinstance(adopted.model, PhysicsModel)  # as ``_with_physics`` makes it
        more |= covariance_at_end(adopted.model, adopted.covariance)
    return models.to_dict(adopted.in_use, **more)
