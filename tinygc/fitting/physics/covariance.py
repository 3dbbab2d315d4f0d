"""What a refit knows of its parameters together: the linear model's and the effects' that add to the rate."""

from __future__ import annotations

import numpy as np

from tinygc.effects import AppliedEffect
from tinygc.explanation.twin.layout import LINEAR, claim_slice
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.state import State
from tinygc.models.linear import NAMES
from tinygc.models.physics import PhysicsModel


def rate_covariance(found: Refit) -> np.ndarray:
    """(12 + P, 12 + P) of E row by row, B in rad/s, and the theta of each rate effect in SI; widened where the refit leaves more than
    noise does."""
    rows = rows_of_rates(found.state)
    widen = max(1.0, found.chi_square / max(len(found.r) - found.J.shape[1], 1))
    return found.covariance[np.ix_(rows, rows)] * widen


def rows_of_rates(state: State) -> np.ndarray:
    """Of ``State.vector``: the linear model, and the effects that add to the rate."""
    added = [claim_slice(state.claims, number) for number, claim in enumerate(state.claims) if claim.effect.kind == "rate"]
    return np.concatenate([np.arange(part.start, part.stop) for part in (LINEAR, *added)])


def covariance_at_end(model: PhysicsModel, covariance: np.ndarray) -> dict:
    """The same for the model as of the session's end, from this model's covariance (12 + P, 12 + P)."""
    slope = model.at_end_slope()
    return covariance_table(model.at_end().undone, slope @ covariance @ slope.T)


def covariance_table(claims: tuple[AppliedEffect, ...], covariance: np.ndarray) -> dict:
    """For the model file: the covariance, and of what; theta as in ``theta_si``."""
    effects = [f"{claim.effect.id}[{i}]" for claim in claims for i in range(len(claim.theta))]
    return {"covariance": covariance.tolist(), "covariance_of": [*NAMES, *effects]}
