"""Segments that a fit has never seen: what the shortcut predicts of them is what exact refits do, and only a true effect improves it."""

import numpy as np
import pytest
from explained_sessions import g_sensitive
from simulated_twins import make_twin_of

from session.io.units import DEG
from tinygc.effects import catalogue
from tinygc.explanation.decision import (
    BORNE_OUT_P,
    borne_out,
    fold_rows,
    folds_of,
    improvement_p,
    left_out,
)
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.search import promises
from tinygc.noise.candidates import scanned
from tinygc.noise.refit import prior_sigmas, refit

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")
TRUE = "gyro.g_sensitivity"
#: none of which is there
FITTED_TO_NOISE = (TRUE, "gyro.scale_nonlinearity", "gyro.scale_asymmetry", "gyro.bandwidth")
SEEDS = range(1, 6)
STEP_AT_S = 33.0


def stepping(t, rate, force, temp):
    return rate + np.where(t > STEP_AT_S, 1.0, 0.0)[:, None] * np.multiply((0.04, -0.03, 0.05), DEG)


@pytest.fixture(scope="module")
def evidence_of(twin_of):
    return lambda distort, segments, seed=5: Evidence(twin_of(distort, segments=segments, seed=seed)[0])


def weighed(evidence, *names):
    return evidence.of(tuple(catalogue()[name] for name in names), evidence.nothing)


def improvement(evidence, names, number=0) -> float:
    have = weighed(evidence, *names)
    return improvement_p(evidence.twin, have, evidence.prior(have.fit), number)


@pytest.mark.parametrize(("distort", "names"), [(g_sensitive, (TRUE,))])
def test_leaving_out_by_algebra_is_refitting_without_those_rows(evidence_of, distort, names):
    """Ten exact refits, each without the rows of its fold: the same to 1 % of the rms of what is left, in every channel."""
    evidence = evidence_of(distort, 20)
    twin, have = evidence.twin, weighed(evidence, *names)
    effects, whiten = list(have.effects), have.whiten
    fit = refit(twin, whiten, effects, have.fit.state)
    shortcut = left_out(twin, whiten, fit.r, fit.J * prior_sigmas(twin, effects))
    exact = np.full(len(shortcut), np.nan)
    for held in folds_of(len(twin.segments)):
        rows = fold_rows(twin, whiten, held)
        part = refit(twin, whiten, effects, fit.state, rows=rows)
        exact[~rows] = twin.residuals(part.state).stacked()[~rows]
    assert np.isfinite(exact).all()  # every row is left out once
    inside = whiten.back(fit.r)
    for part in whiten.parts.values():
        rms = np.sqrt(np.mean(exact[part] ** 2))
        assert np.sqrt(np.mean((shortcut - exact)[part] ** 2)) < 0.01 * rms
        # Rows that were fitted to look better than they are.
        assert np.sqrt(np.mean((inside - exact)[part] ** 2)) > 0.03 * rms
    assert np.sqrt(np.mean(exact[whiten.parts["closure"]] ** 2)) > 1.1 * np.sqrt(np.mean(inside[whiten.parts["closure"]] ** 2))


@pytest.mark.parametrize("seed", [2])
def test_a_true_effect_improves_what_was_left_out(evidence_of, seed):
    """Also beside an effect that was fitted to noise."""
    evidence = evidence_of(g_sensitive, 14, seed)
    assert improvement(evidence, [TRUE]) < 0.1 * BORNE_OUT_P
    assert improvement(evidence, [TRUE, "gyro.scale_nonlinearity"]) < 0.1 * BORNE_OUT_P


@pytest.mark.slow
def test_an_effect_fitted_to_noise_does_not_except_by_chance(evidence_of):
    """Every one of them fits better, with as many numbers as it has; of twenty, chance bears out one."""
    p, gained = [], []
    for seed in SEEDS:
        evidence = evidence_of(None, 14, seed)
        p += [improvement(evidence, [name]) for name in FITTED_TO_NOISE]
        nothing = refit(evidence.twin, evidence.nothing.whiten, [], evidence.nothing.fit.state).chi_square
        fits = [refit(evidence.twin, evidence.nothing.whiten, [catalogue()[name]], evidence.nothing.fit.state) for name in FITTED_TO_NOISE]
        gained += [nothing - fit.chi_square for fit in fits]
    assert np.median(gained) > 1
    assert np.mean(np.array(p) > BORNE_OUT_P) >= 0.85
    assert np.median(p) > 0.3


# Scanned shapes


def steps_of(evidence):
    step = catalogue()["gyro.bias_step"]
    return step.variants(scanned(evidence.twin, step))


@pytest.mark.slow
def test_the_best_of_many_steps_fitted_to_noise_is_borne_out_by_chance_alone(evidence_of):
    """Found with the left-out segments it improves them: so it is found anew without them."""
    with_all, anew = [], []
    for seed in range(1, 21):
        evidence = evidence_of(None, 14, seed)
        steps = steps_of(evidence)
        best = steps[int(np.argmax(promises(evidence, [(evidence.nothing.whiten, evidence.nothing.fit)], steps)))]
        have = evidence.of((best,), evidence.nothing)
        prior = evidence.prior(have.fit)
        with_all.append(improvement_p(evidence.twin, have, prior, 0))
        anew.append(improvement_p(evidence.twin, have, prior, 0, list(have.whiten.each(map(evidence.columns, steps)))))
    assert np.mean(np.array(anew) < BORNE_OUT_P) <= 0.15  # of twenty, one or two
    assert np.median(anew) > np.median(with_all)


def test_a_true_step_is_borne_out_though_its_moment_is_searched_for_anew(evidence_of):
    evidence = evidence_of(stepping, 14)
    have = evidence.of((min(steps_of(evidence), key=lambda e: abs(e.shape["at_s"] - STEP_AT_S)),), evidence.nothing)
    assert borne_out(evidence, have, 0)
