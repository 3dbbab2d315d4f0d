"""Named physics in a fit's result: its record, and the covariance of its parameters.

``tinygc/explanation/physics.py`` makes the record; a fit receives it and depends on no layer above.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from session.base.progress import Reporter
from session.base.texts import listed
from session.log.config import NominalRate
from tinygc.closure.problem import Problem
from tinygc.closure.runs import ClosureRun
from tinygc.effects import AppliedEffect, Conditions
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.models.linear import NAMES, PARAMETERS, LinearModel
from tinygc.models.physics import PhysicsModel
from tinygc.noise.refit import Refit
from tinygc.noise.twin import LINEAR, State, claim_slice


@dataclass(frozen=True, eq=False)
class PhysicsFit:
    """Named physics fitted together with the linear model.

    model; problem it was fitted to, after data repair; left: the problem as a sensor without the effects would have recorded it; fit of the
    effects with the linear model of that; angles (S, d) rad of the segments, and held_out; repaired: ids of the effects repaired before;
    refused: whether a mismatch remains that has no name; methods: those that include the physics, by name; run_errors: their errors
    (3,) rad in each closure run; lost_s: times in each run after which samples seem to be missing; of_force: the effects of
    the accelerometer among those fitted, as JSON: no model has them.
    """

    model: PhysicsModel
    problem: Problem
    left: Problem
    fit: Refit
    angles: np.ndarray
    held_out: np.ndarray
    repaired: tuple[str, ...]
    refused: bool = False
    methods: dict[str, MethodFit] = field(default_factory=dict)
    run_errors: list[dict[str, np.ndarray]] = field(default_factory=list)
    lost_s: tuple[np.ndarray, ...] = ()
    of_force: tuple[dict, ...] = ()


#: function that gives the roll, pitch and yaw errors (3,) rad of a closure run under a trial vector of parameters
RunErrors = Callable[[np.ndarray, ClosureRun], np.ndarray]
#: function that fits named physics; its arguments are the problem as given, that of the fit and its least squares, its options, its closure
#: runs, and a progress callback
FitPhysics = Callable[[Problem, Problem, MethodFit, FitOptions, Sequence[ClosureRun], Reporter], PhysicsFit]


def errors_with_physics(claims: Sequence[AppliedEffect], known: Conditions, earth_t: np.ndarray) -> RunErrors:
    """Return the function that gives a closure run's errors (3,) rad under a trial vector (12 + P,): the linear model, then these effects.

    known: reference conditions of the effects; earth_t (3,) rad/s: correction of the Earth's rate that was fitted with them.
    """

    def errors(trial: np.ndarray, run: ClosureRun) -> np.ndarray:
        rate = run.rates(model_at(trial, claims, known))
        return run.with_earth(earth_t, rate).errors_at(rate)

    return errors


def model_at(trial: np.ndarray, claims: Sequence[AppliedEffect], known: Conditions) -> PhysicsModel:
    """Return the model with physics for a trial vector (12 + P,): the linear model, then theta of each effect."""
    at, changed = PARAMETERS, []
    for claim in claims:
        changed.append(AppliedEffect(claim.effect, trial[at : at + len(claim.theta)]))
        at += len(claim.theta)
    return PhysicsModel(LinearModel.from_vector(trial), tuple(changed), known)


def rate_covariance(found: Refit, clock: NominalRate | None) -> np.ndarray:
    """Return the covariance (12 + P, 12 + P) of E row by row, B in rad/s, and the theta of each rate effect in SI; inflated where the
    refit's residuals exceed the noise.  clock: of the logs, with which all of them scale."""
    rows = rows_of_rates(found.state)
    covariance = found.covariance[np.ix_(rows, rows)] * found.widened
    return covariance if clock is None else covariance + clock.covariance(found.state.vector[rows])


def rows_of_rates(state: State) -> np.ndarray:
    """Return the rows of ``State.vector`` that belong to the linear model and the effects that add to the rate."""
    added = [claim_slice(state.claims, number) for number, claim in enumerate(state.claims) if claim.effect.kind == "rate"]
    return np.concatenate([np.arange(part.start, part.stop) for part in (LINEAR, *added)])


def covariance_at_end(model: PhysicsModel, covariance: np.ndarray) -> dict:
    """Return the table for the model as of the session's end, from this model's covariance (12 + P, 12 + P)."""
    slope = model.at_end_slope()
    return covariance_table(model.at_end().undone, slope @ covariance @ slope.T)


def covariance_table(claims: tuple[AppliedEffect, ...], covariance: np.ndarray) -> dict:
    """Return the covariance with the names of its parameters for the model file; theta as in ``theta_si``."""
    effects = [f"{claim.effect.id}[{i}]" for claim in claims for i in range(len(claim.theta))]
    return {"covariance": covariance.tolist(), "covariance_of": [*NAMES, *effects]}


def loss_words(lost_s: np.ndarray) -> str:
    """Describe missing samples in one sentence, empty without any."""
    if not len(lost_s):
        return ""
    first = listed([f"{moment:.1f}" for moment in lost_s], 3)
    return f"samples seem lost in it, after {first} s; nothing in a closure run is repaired, so its errors are not the calibration's"
