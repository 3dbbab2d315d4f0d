"""The evidence of a hypothesis: the true name has the most of it, noise gives way to it, and what chance adds has less than nothing."""

import numpy as np
import pytest
from explained_sessions import both, lagging, warm
from simulated_twins import make_twin_of

from tinygc.effects import catalogue
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.search import search, without_idle
from tinygc.noise.candidates import candidates
from tinygc.noise.components import WANDER

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")
G_SENSITIVITY, ASYMMETRY = "gyro.g_sensitivity", "gyro.scale_asymmetry"


@pytest.fixture(scope="module")
def evidence_of(twin_of):
    """Of a small session, made once for each thing that is concealed in it."""
    made = {}

    def make(distort=None, **options) -> Evidence:
        key = distort, tuple(options.items())
        if key not in made:
            made[key] = Evidence(twin_of(distort, **{"segments": 16, "seed": 5, **options})[0])
        return made[key]

    return make


def hypothesis(evidence, *names):
    return evidence.of(tuple(catalogue()[name] for name in names), evidence.nothing)


def searched(evidence):
    return search(evidence, candidates(evidence.twin), evidence.nothing)


# Which name


@pytest.mark.parametrize(
    ("distort", "options", "true", "alike"),
    [
        (lagging, {}, "gyro.bandwidth", "gyro.angular_acceleration"),
        (warm, {"warm_up_c": 8.0}, "gyro.thermal_bias", "gyro.bias_drift"),
    ],
)
def test_the_true_one_of_two_lookalikes_has_more_evidence_where_it_is_strong(evidence_of, distort, options, true, alike):
    """Odds of twenty at least, and both are better than nothing."""
    evidence = evidence_of(distort, **options)
    right, wrong = hypothesis(evidence, true), hypothesis(evidence, alike)
    assert right.score < wrong.score - 2 * np.log(20)
    assert wrong.score < evidence.nothing.score


@pytest.mark.parametrize("seed", [1])
def test_where_nothing_is_hidden_nothing_is_named(evidence_of, seed):
    evidence = evidence_of(None, segments=14, seed=seed)
    assert searched(evidence) is evidence.nothing
    # What chance gains is less than the name's price.
    assert hypothesis(evidence, G_SENSITIVITY).score > evidence.nothing.score


def test_two_effects_at_once_are_both_found(evidence_of):
    assert searched(evidence_of(both)).ids == {G_SENSITIVITY, ASYMMETRY}


def test_a_needless_effect_is_taken_out_again_and_the_others_stay(evidence_of):
    evidence = evidence_of(both)
    true = hypothesis(evidence, G_SENSITIVITY, ASYMMETRY)
    more = hypothesis(evidence, G_SENSITIVITY, ASYMMETRY, "gyro.scale_nonlinearity")
    assert more.fit.chi_square < true.fit.chi_square + 1  # it fits no worse, and is paid for
    assert more.score > true.score
    assert without_idle(evidence, more).ids == true.ids
    assert without_idle(evidence, true) is true


# Noise and names


def test_the_bias_stops_wandering_when_the_temperature_is_named(evidence_of):
    evidence = evidence_of(warm, warm_up_c=8.0)
    known = evidence.twin.problem.instability.rps
    named = hypothesis(evidence, "gyro.thermal_bias")
    assert evidence.nothing.noise.size(WANDER) > 5 * known
    assert named.noise.size(WANDER) == pytest.approx(known, rel=0.5)
    assert evidence.nothing.noise.unusual
    assert not named.noise.unusual
