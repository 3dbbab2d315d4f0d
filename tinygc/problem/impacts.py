"""Turns with an impact: how much less certain they are, by the closure of these very turns.

An impact of j g makes a turn's end uncertain by s j.  The calibration of the turns without one predicts the others; s is what these miss
beyond what that prediction and the usual turn's misfit allow: the median of its likelihood over s (a flat prior), where the turns
themselves bear it out, else 0.  One sensor filters an impact and loses nothing of it, another loses degrees (docs/real-recordings.md): a
constant would be wrong for both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from session.common.units import DEG
from session.detect.impacts import Impact
from session.detect.segments import Segment
from tinygc import closure
from tinygc.closure.floor import Floor
from tinygc.closure.least_squares import fit_least_squares
from tinygc.models import linear
from tinygc.models.linear import PARAMETERS, LinearModel
from tinygc.problem.widened import Widening

#: turns without an impact that tell a calibration of 12 parameters, and how far it misses; with fewer, all turns tell it
FEWEST_CALM = 9
#: twice the logarithm of the likelihood by which s must be better than none: by chance once in 20 (Self & Liang 1987: s cannot be negative)
BORNE_OUT = 2.71
#: rad per g that are tried: from a thousandth of a degree to ten degrees
GRID = np.concatenate([[0.0], np.geomspace(1e-3, 10.0, 120)]) * DEG


@dataclass(frozen=True, eq=False)
class Hits:
    """Of S segments: jump_g (S,), root of the sum of squares of their impacts', 0 without one; says (S,): what happened, where."""

    jump_g: np.ndarray
    says: list[str]


def hits_of(segments: Sequence[Segment], impacts: Sequence[Sequence[Impact]]) -> Hits:
    """impacts: of each log."""
    inside = [[each for each in impacts[s.log] if s.start <= each.row < s.stop - 1] for s in segments]
    jumps = np.array([np.sqrt(sum(each.jump_g**2 for each in own)) for own in inside])
    return Hits(jumps, [_words(own) for own in inside])


def widened_by_impacts(
    segments: Sequence[Segment], hits: Hits, batch: closure.Batch, floor: Floor, start: LinearModel
) -> tuple[np.ndarray, list[Widening]]:
    """(S, 3, 3) rad^2 that impacts add to the ends of S segments; of the batch with its floor, the search begun at a model."""
    hit = hits.jump_g > 0
    more = np.zeros((len(batch), 3, 3))
    if not hit.any():
        return more, []
    per_g = _per_g(hits.jump_g, batch, floor, start)
    if not per_g:
        return more, []
    more[hit] = np.square(per_g * hits.jump_g[hit])[:, None, None] * np.eye(3)
    said = [
        Widening(segment.number, "impact", float(np.sqrt(2) * per_g * jump), says)
        for segment, jump, says in zip(segments, hits.jump_g, hits.says, strict=True)
        if jump > 0
    ]
    return more, said


def _per_g(jump_g: np.ndarray, batch: closure.Batch, floor: Floor, start: LinearModel) -> float:
    """rad per g and angle."""
    hit = jump_g > 0
    own = ~hit if (~hit).sum() >= FEWEST_CALM else np.ones_like(hit)
    fit = fit_least_squares(batch.pick(own), floor.sigma[own], start)
    rate = fit.model(batch.rate)
    angles = closure.error_angles(closure.segment_residuals(batch, rate))[:, :2]
    design = linear.columns(closure.sensitivity(batch, rate), batch.rate)[:, :2]
    variance = floor.sigma[:, :2] ** 2
    # What the calibration of the others allows, and by how much more the usual turn misses.
    freedom = max(2 * int(own.sum()) - PARAMETERS, 1)
    usual = max(1.0, float(np.sum(angles[own] ** 2 / variance[own])) / freedom)
    known = np.einsum("sdp,pq,seq->sde", design[hit], fit.covariance, design[hit]) + variance[hit][:, :, None] * np.eye(2)
    size, axes = np.linalg.eigh(usual * known)
    square = np.einsum("sd,sde->se", angles[hit], axes) ** 2
    total = size + np.square(GRID[:, None, None] * jump_g[hit][:, None])
    likelihood = -np.sum(np.log(total) + square / total, axis=(1, 2)) / 2
    if 2 * (likelihood.max() - likelihood[0]) < BORNE_OUT:
        return 0.0
    weight = np.exp(likelihood - likelihood.max()) * np.gradient(GRID)
    return float(np.interp(0.5, np.cumsum(weight) / weight.sum(), GRID))


def _words(impacts: list[Impact]) -> str:
    if not impacts:
        return ""
    worst = max(impacts, key=lambda each: each.jump_g)
    count = f"{len(impacts)} impacts, the hardest" if len(impacts) > 1 else "an impact"
    return f"{count} of {worst.jump_g:.1f} g from one reading to the next at {worst.at_s:.2f} s"
