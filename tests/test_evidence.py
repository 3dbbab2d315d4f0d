"""The evidence of a hypothesis: the true name has the most of it, noise gives way to it, and what chance adds has less than nothing."""

from types import SimpleNamespace

import numpy as np
import pytest
from explained_sessions import both, g_sensitive, lagging, warm
from simulated_twins import make_twin_of

from tinygc.effects import catalogue
from tinygc.explanation.evidence import Evidence, Guess
from tinygc.explanation.search import probabilities, rivals_of, search, without_idle
from tinygc.noise.candidates import candidates
from tinygc.noise.components import STILL_RATE, TURN, WANDER

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")
G_SENSITIVITY, ASYMMETRY = "gyro.g_sensitivity", "gyro.scale_asymmetry"


def faintly_sensitive(t_s, rate, force, temp_c):
    """A twentieth of it: some ten times what could just be seen."""
    return rate + (g_sensitive(t_s, rate, force, temp_c) - rate) / 20


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
        (lagging, {}, "gyro.bandwidth", "timing.axis_skew"),
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


@pytest.mark.parametrize("seed", [1, 2, 3])
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


def test_a_name_takes_over_what_turns_and_rests_seemed_to_err_by(evidence_of):
    evidence = evidence_of(g_sensitive)
    named = hypothesis(evidence, G_SENSITIVITY)
    for component in (STILL_RATE, TURN):
        assert named.noise.size(component) < 0.1 * evidence.nothing.noise.size(component)


# What linear columns promise


@pytest.mark.parametrize("distort", [None, faintly_sensitive])
def test_a_small_linear_effect_is_guessed_as_it_is_weighed(evidence_of, distort):
    """Within three units of -2 log evidence, odds of four and a half: little beside what decides."""
    evidence = evidence_of(distort)
    effect = catalogue()[G_SENSITIVITY]
    promised = evidence._guessed(evidence.nothing, None, effect) + evidence.price(effect)
    assert promised == pytest.approx(hypothesis(evidence, G_SENSITIVITY).score, abs=3)


def test_the_guess_without_an_effect_is_the_hypothesis_without_it(evidence_of):
    evidence = evidence_of(faintly_sensitive)
    have = hypothesis(evidence, G_SENSITIVITY)
    without = evidence._guessed(have, have.effects[0], None)
    assert without == pytest.approx(evidence.nothing.score, abs=3)


# Probabilities


def guess(score: float, *names: str) -> Guess:
    return Guess(tuple(SimpleNamespace(id=name) for name in names), score)


def test_probabilities_are_those_of_the_hypotheses_that_have_the_name():
    odds = [guess(-2 * np.log(share), *names) for share, names in ((0.4, ("a",)), (0.3, ("b",)), (0.2, ("a", "b")), (0.1, ()))]
    found = probabilities(odds)
    assert found == pytest.approx({"a": 0.6, "b": 0.5, "": 0.1})
    assert found["a"] + found["b"] + found[""] - 0.2 == pytest.approx(1)  # both at once are counted twice


def test_probabilities_do_not_mind_where_scores_begin_nor_how_far_they_are_apart():
    one = [guess(0.0, "a"), guess(2 * np.log(3), "b"), guess(5000.0)]
    for shift in (-1e5, 1e5):
        moved = probabilities([Guess(g.effects, g.score + shift) for g in one])
        assert moved == pytest.approx({"a": 0.75, "b": 0.25, "": 0.0})


def test_a_rival_is_what_stands_in_the_same_place_beside_the_same_others():
    best = guess(10.0, "a", "b")
    weighed = [
        best,
        guess(13.0, "c", "b"),
        guess(12.0, "c", "b"),
        guess(11.0, "c"),
        guess(11.5, "b"),
        guess(10.5, "a", "d"),
        guess(9, "a", "b", "d"),
    ]
    assert rivals_of(weighed, best, best.effects[0]) == {"c": 2.0}
    assert rivals_of(weighed, best, best.effects[1]) == {"d": 0.5}
