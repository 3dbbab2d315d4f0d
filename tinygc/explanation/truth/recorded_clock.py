"""The truth's clock as it was recorded: found before anything was fitted, or beside a delay of the gyro's axes; a claim like the others."""

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

#: a clock that stands beside a delay, unasked, is said where it is as sure as this: by chance once in 370
SAID_SIGMAS = 3.0


def with_recorded_clock(problem: Problem, names: TruthNames, alignment: TruthAlignment | None) -> TruthNames:
    """The same with the whole offset of the clock among the claims; if one was found beforehand, before is what the recording has with the
    clock set back."""
    found_s = alignment.reading.offset_s if alignment is not None and alignment.source["offset_s"] == FOUND else 0.0
    named = next((claim for claim in names.claims if claim.effect.id == OFFSET.id), None)
    others = [claim for claim in names.claims if claim is not named]
    left_s, sigma_s = _left(names)
    if found_s and not np.isfinite(sigma_s) and alignment is not None:
        sigma_s = alignment.offset_sigma_s
    whole_s = found_s + left_s
    if not found_s and named is not None:
        return names
    if not abs(whole_s) > SAID_SIGMAS * sigma_s and named is None:
        return replace(names, claims=others)
    first_share, names = _set_back(problem, names, found_s) if found_s else (0.0, names)
    others = [replace(claim, share=None if claim.share is None else claim.share * (1 - first_share)) for claim in others]
    p_value = float(stats.chi2.sf((whole_s / sigma_s) ** 2, 1))
    theta, sigma = np.array([whole_s]), np.array([sigma_s])
    claim = TruthClaim(OFFSET, theta, sigma, p_value, first_share, equivalent=common_delays())
    if named is not None:
        share = first_share + (named.share or 0.0) * (1 - first_share)
        claim = replace(named, theta=theta, sigma=sigma, share=share, p_value=min(p_value, named.p_value))
    return replace(names, claims=sorted([claim, *others], key=lambda c: -(c.share or 0.0)), p_value=min(names.p_value, p_value))


def _left(names: TruthNames) -> tuple[float, float]:
    """s that the last fit has of the clock, and its sigma; nan where the clock is none of its claims."""
    for number, claim in enumerate(names.fit.state.claims):
        if claim.effect is OFFSET:
            return float(claim.theta[0]), float(np.sqrt(names.fit.theta_covariance(number)[0, 0]))
    return 0.0, float("nan")


def _set_back(problem: Problem, names: TruthNames, found_s: float) -> tuple[float, TruthNames]:
    """The share of chi-square that a clock that was found takes up, and the names with what there was before it did."""
    twin, whiten = TruthTwin(problem), names.decision.whiten
    start = twin.start()
    back = TruthTwin(replace(problem, batch=twin.later(problem.batch, start, -found_s)))
    first = refit(back, whiten, [], start)
    angles = back.residuals(first.state).closure
    share = float(np.clip(1 - names.decision.naming.first.chi_square / first.chi_square, 0, 1))
    return share, replace(
        names,
        angles=(angles, names.angles[1]),
        held_out=(held_out(back, whiten, first), names.held_out[1]),
        excess=(excess_of(problem, angles, 0), names.excess[1]),
    )
