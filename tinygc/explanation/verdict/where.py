"""Locate: the channels, axes, segments, seconds and the range of a variable in which the mismatch lives."""

from __future__ import annotations

from typing import Any

import numpy as np

from session.common.units import DEG
from tinygc.effects.occurrence import LEVEL
from tinygc.explanation.twin.channels import own_residuals
from tinygc.explanation.twin.variable import Variable, variable_of
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.events import clipped_readings, moments_s
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.readable import theta_of

#: a channel belongs to the mismatch at this level: 0.3 % of quiet sessions over three of them
BELONGS_P = 1e-3
#: an axis, or a segment: two angles pass by chance once in 3000 segments
BELONGS_SIGMAS = 4.0
MOST_SEGMENTS = 12
NOWHERE: dict[str, Any] = {"phases": [], "axes": [], "segments": [], "segment_seconds": [], "seconds": None, "regime": None}


def where(e: Explanation) -> dict:
    """Phases, axes, segments with their seconds, the seconds and the regime in which the mismatch lives; empty where there is none."""
    if e.verdict == "no_mismatch":
        return dict(NOWHERE)
    told = [*e.claimed, *e.findings]
    phases = {phase for claim in e.claimed for phase in claim.effect.seen_in}  # a shape without a name may be seen anywhere
    names = {"closure": "turn", "still": "still", "length": "reference"}
    phases |= {names[name] for name, (before, after) in e.own_p.items() if (after if e.claimed else before) < BELONGS_P}
    order = ("still", "turn", "reference", "timing")
    segments = worst_segments(e)
    spans = _spans(e, segments)
    strongest = next((claim for claim in told if claim.effect.regime), None)
    return {
        "phases": [phase for phase in order if phase in phases],
        "axes": _axes(e, told),
        "segments": segments,
        "segment_seconds": spans,
        "seconds": _seconds(e, strongest, spans),
        "regime": None if strongest is None else _range(e, strongest),
    }


def worst_segments(e: Explanation) -> list[int]:
    """Numbers of the segments that close worst beyond their floor, worst first."""
    sigma = np.sqrt(np.trace(e.problem.floor.own, axis1=1, axis2=2))
    excess = np.linalg.norm(e.proof.before, axis=1) / sigma
    order = np.argsort(-excess)[:MOST_SEGMENTS]
    return [e.proof.before_numbers[i] for i in order if excess[i] > BELONGS_SIGMAS / np.sqrt(2)]


def _axes(e: Explanation, told: list[Claim]) -> list[str]:
    """Body axes whose parameters stand out of their std; from the stills' residual rates where nothing is told."""
    weights = np.zeros(3)
    for claim in told:
        name = claim.effect.parameter.name
        if name not in claim.std or claim.effect.kind == "register":
            continue
        ratio = np.abs(np.ravel(claim.parameters[name])) / np.maximum(np.ravel(claim.std[name]), 1e-300)
        if ratio.size % 3 == 0:
            weights = np.maximum(weights, ratio.reshape(3, -1).max(axis=1))
    if not told:
        part = e.whiten.parts["still"]
        rows = own_residuals(e.twin, e.whiten, e.naming.first)[0][part].reshape(-1, 3)
        weights = np.abs(rows).max(axis=0)
    return [axis for axis, weight in zip("xyz", weights, strict=True) if weight > BELONGS_SIGMAS]


def _spans(e: Explanation, numbers: list[int]) -> list[list[float]]:
    """[from, to] of each segment, s of the session."""
    began = e.problem.began_s
    at = {segment.number: segment for segment in e.problem.segments}
    found = []
    for number in numbers:
        start = float(began[at[number].log] + at[number].start_s)
        found.append([round(start, 3), round(start + at[number].duration_s, 3)])
    return found


def _seconds(e: Explanation, claim: Claim | None, spans: list[list[float]]) -> list[float] | None:
    """[from, to]: where the strongest effect is at least half its greatest, or from the first to the last of its moments."""
    if claim is None:
        return [min(start for start, _ in spans), max(stop for _, stop in spans)] if spans else None
    times = moments_s(e, claim)
    if times is None:
        t_s = np.concatenate([movement.t_s for movement in e.twin.movements])
        strong = _where_strong(e, claim)
        times = t_s if strong is None else t_s[strong]
    return [round(float(times.min()), 3), round(float(times.max()), 3)] if len(times) else None


def _range(e: Explanation, claim: Claim) -> dict | None:
    """The range of the strongest effect's variable: where it is at least half its greatest, or at its moments."""
    regime = variable_of(claim.effect, _theta(e, claim))
    values = _values(e, claim, regime)
    if not len(values) or not np.isfinite(values).all():
        return None
    axis = {} if regime.axis is None else {"axis": "xyz"[regime.axis]}
    return {"variable": regime.variable, "units": regime.units, "from": float(values.min()), "to": float(values.max()), **axis}


def _values(e: Explanation, claim: Claim, regime: Variable) -> np.ndarray:
    if claim.effect.occurs is not None and claim.effect.occurs.counts == LEVEL:
        return clipped_readings(e, claim).magnitude / DEG
    if regime.variable == "time" and (times := moments_s(e, claim)) is not None:
        return times
    if regime.variable == "attitude":
        return regime.of_stills(e.twin)
    by_log = [regime.of_samples(movement) for movement in e.twin.movements]
    if claim.effect.kind == "motion":  # in the turns that are used, and nowhere else
        by_log = [by_log[s.log][s.start : s.stop] for s in e.twin.segments]
    values = np.concatenate(by_log)
    strong = _where_strong(e, claim)
    return values[values > 0.5 * np.quantile(values, 0.999)] if strong is None else values[strong]


def _where_strong(e: Explanation, claim: Claim) -> np.ndarray | None:
    """Samples (N,) bool at which the effect adds at least half of the most it adds; None where it adds to no rate."""
    if claim.effect.kind != "rate":
        return None
    theta = _theta(e, claim)
    strength = np.concatenate([np.linalg.norm(claim.effect.columns(m) @ theta, axis=1) for m in e.twin.movements])
    return strength > 0.5 * np.quantile(strength, 0.999)


def _theta(e: Explanation, claim: Claim) -> np.ndarray | None:
    """(P,) SI; None of what was mended in the registers."""
    return None if claim.effect.kind == "register" else theta_of(claim.effect, claim.parameters, e.naming.fit.state)
