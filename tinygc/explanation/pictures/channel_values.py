"""What a picture of an explanation shows of the twin's channels: what is left in them, and what an effect says of it.

The fit holds all that is drawn against a variable, with a name or without one.  So what it leaves is after, and with the effect added
again it is before.
"""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from tinygc.attitude import rotation
from tinygc.closure.residual import closure_angles
from tinygc.explanation.twin.variable import Variable, variable_of
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.readable import theta_of


def told(e: Explanation) -> Claim | None:
    """The strongest effect that adds to the rates, which is what can be drawn against a variable."""
    return next((claim for claim in [*e.claimed, *e.findings] if claim.effect.kind == "rate"), None)


def theta(e: Explanation, claim: Claim) -> np.ndarray:
    """(P,) SI, the parameters of a claim as the fit has them."""
    return theta_of(claim.effect, claim.parameters, e.naming.fit.state)


def variable_for(e: Explanation, claim: Claim | None) -> Variable:
    """The variable that a claim is drawn against; time where there is none."""
    return variable_of(None) if claim is None else variable_of(claim.effect, theta(e, claim))


def rates_per_still(e: Explanation) -> tuple[np.ndarray, np.ndarray]:
    """Residual rates (Q, 3) dps in the stills, before and after."""
    before, after = (e.twin.residuals(fit.state).still / DEG for fit in (e.naming.first, e.naming.fit))
    return before, after


def lengths_per_still(e: Explanation) -> tuple[np.ndarray, np.ndarray]:
    """Residual lengths of gravity (Q,) m/s^2 in the stills, before and after."""
    before, after = (e.twin.residuals(fit.state).length for fit in (e.naming.first, e.naming.fit))
    return before, after


def added_in_stills(e: Explanation, claim: Claim, values: np.ndarray | None = None) -> np.ndarray:
    """(Q, 3) dps that an effect adds to each still's mean rate; values (P,) SI in place of its parameters, to see a part of it."""
    twin = e.twin
    values = theta(e, claim) if values is None else values
    if claim.effect.kind == "earth":
        return np.einsum("qji,j->qi", rotation.matrix(twin.q_tb), values) / DEG
    by_log = [claim.effect.columns(m.with_rate(rate)) @ values for m, rate in zip(twin.movements, e.replay.rates, strict=True)]
    return np.array([by_log[log][still.start : still.stop].mean(axis=0) for log, still in twin.stills]) / DEG


def recorded_in_stills(e: Explanation, claim: Claim) -> np.ndarray:
    """(Q, 3) dps that the recording has in each still of what the effect should explain."""
    _, after = rates_per_still(e)
    return after + added_in_stills(e, claim)


def added_to_closure(e: Explanation, claim: Claim) -> tuple[np.ndarray, np.ndarray]:
    """(S, d) rad that an effect adds to the closure of each segment, to first order, and what the recording has of it."""
    added = -e.replay.columns(claim.effect).closure @ theta(e, claim)
    return added, e.twin.residuals(e.naming.fit.state, e.replay.rates).closure + added


def closure_as_recorded(e: Explanation) -> dict[int, float]:
    """Closure in degrees, by the segment's number, of what was recorded with nothing mended, by the linear model of what was mended."""
    angles = closure_angles(e.problem.batch, e.naming.fit.state.model)
    return dict(zip((segment.number for segment in e.problem.used), np.linalg.norm(angles[:, :2], axis=1) / DEG, strict=True))


def closure_by_segment(e: Explanation) -> tuple[dict[int, float], dict[int, float]]:
    """Held-out closure in degrees by the segment's number, before and after."""
    before, after = (np.linalg.norm(angles[:, :2], axis=1) / DEG for angles in (e.proof.before, e.proof.after))
    return dict(zip(e.proof.before_numbers, before, strict=True)), dict(zip(e.proof.after_numbers, after, strict=True))
