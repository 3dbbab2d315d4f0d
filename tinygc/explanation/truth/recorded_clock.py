"""An offset of the truth's clock that was found before anything was fitted: a claim like the others, and what it takes up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from session.log.truth_reading import FOUND, TruthAlignment
from tinygc.explanation.truth.names import TruthNames, excess_of, held_out
from tinygc.explanation.truth.truth_effects import OFFSET, common_delays
from tinygc.explanation.truth.truth_explanation import TruthClaim
from tinygc.explanation.truth.truth_twin import TruthTwin
from tinygc.explanation.twin.refit import refit
from tinygc.problem.problem import Problem


def with_recorded_clock(problem: Problem, names: TruthNames, alignment: TruthAlignment | None) -> TruthNames:
    """The same with the offset among the claims, if one was found; before is then what the recording has with the clock set back."""
    if alignment is None or alignment.source["offset_s"] != FOUND:
        return names
    offset_s, sigma_s = alignment.reading.offset_s, alignment.offset_sigma_s
    twin, whiten = TruthTwin(problem), names.decision.whiten
    start = twin.start()
    back = TruthTwin(replace(problem, batch=twin.later(problem.batch, start, -offset_s)))
    first = refit(back, whiten, [], start)
    angles = back.residuals(first.state).closure
    aligned = names.decision.naming.first.chi_square
    own = float(np.clip(1 - aligned / first.chi_square, 0, 1))
    others = [replace(c, share=None if c.share is None else c.share * (1 - own)) for c in names.claims if c.effect.id != OFFSET.id]
    left = next((claim for claim in names.claims if claim.effect.id == OFFSET.id), None)
    theta, sigma = np.array([offset_s]), np.array([sigma_s])
    p_value = float(stats.chi2.sf((offset_s / sigma_s) ** 2, 1)) if np.isfinite(sigma_s) else names.decision.p_value
    claim = TruthClaim(OFFSET, theta, sigma, p_value, own, equivalent=common_delays())
    if left is not None:
        share = own + (left.share or 0.0) * (1 - own)
        claim = replace(left, theta=theta + left.theta, share=share, p_value=min(p_value, left.p_value), equivalent=claim.equivalent)
    return replace(
        names,
        claims=sorted([claim, *others], key=lambda c: -(c.share or 0.0)),
        p_value=min(names.p_value, p_value),
        angles=(angles, names.angles[1]),
        held_out=(held_out(back, whiten, first), names.held_out[1]),
        excess=(excess_of(problem, angles, 0), names.excess[1]),
    )
