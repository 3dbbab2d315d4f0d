"""What a recording does not observe of a law, gravity within the turns, and the numbers that a second recording must agree with."""

from types import SimpleNamespace

import numpy as np
import pytest
from discovery_answers import law_of

from tinygc.annexes.discovery import search_state, within_turns
from tinygc.annexes.discovery.effect_file import Where, written
from tinygc.annexes.discovery.equivalence import FULL_SCALE, as_effect, some_movement
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.search_state import alike, numbers_of
from tinygc.annexes.discovery.stated_rate import MOST_LACKING, share_lacking
from tinygc.annexes.discovery.unobserved import OPEN, SIGNIFICANT, in_words, not_observed, observed
from tinygc.effects import AppliedEffect, StatedNumbers, load_folder, using
from tinygc.explanation.claims import against_stated

#: the size of the rate times the force: the same for all axes it turns the body about the vertical alone
UPRIGHT = LawForm((Factor("rate_size"), Factor("force")), "full")
TURN = np.eye(3).ravel() / np.sqrt(3)
LEAN = np.array([1.0, -1.0, 0.0])


def covariance(direction, sigma, else_sigma=0.01):
    """Of coefficients, wide along one direction."""
    along = np.outer(direction, direction)
    return else_sigma**2 * (np.eye(len(direction)) - along) + sigma**2 * along


@pytest.mark.parametrize(("share", "open_"), [(0.99, 0), (1.01, 1)])
def test_a_combination_known_to_worse_than_half_of_the_law_is_not_observed(share, open_):
    direction = np.ones(3) / np.sqrt(3)
    size = np.sqrt(np.mean(LEAN**2))
    assert len(not_observed(LEAN, covariance(direction, share * OPEN * size))) == open_


@pytest.mark.parametrize(("sigmas", "open_"), [(0.99, 1), (1.01, 0)])
def test_a_combination_is_kept_whose_own_estimate_is_significant(sigmas, open_):
    direction, sigma = np.ones(3) / np.sqrt(3), 2.0
    theta = LEAN + sigmas * np.sqrt(SIGNIFICANT) * sigma * direction
    assert len(not_observed(theta, covariance(direction, sigma))) == open_


def test_what_is_not_observed_is_found_and_set_to_zero():
    theta = np.outer([1.0, -0.8, 0.9], [0, 0, 1.0]).ravel()
    seen = theta - TURN * (TURN @ theta)
    stated = seen + 0.8 * TURN  # and sigma 0.5: a draw
    (found,) = directions = not_observed(stated, covariance(TURN, 0.5))
    assert abs(found @ TURN) == pytest.approx(1)
    assert observed(directions) @ stated == pytest.approx(seen)
    assert in_words(UPRIGHT, -TURN) == "0.58 (x ← x) + 0.58 (y ← y) + 0.58 (z ← z)"


def test_the_last_combination_stays_whatever_is_known_of_it():
    assert len(not_observed(np.array([0.1, 0.1, 0.1]), np.diag([4.0, 5.0, 6.0]))) == 2


@pytest.fixture
def turned(tmp_path):
    """The effect of a file, and its law, of which a turn about the vertical is not observed."""
    theta = np.outer([1.0, -0.8, 0.9], [0, 0, 1.0]).ravel()
    law = law_of(UPRIGHT, theta - TURN * (TURN @ theta), unobserved=TURN[None], covariance=1e-8 * np.diag(np.arange(1.0, 10.0)))
    (tmp_path / "turned.py").write_text(written(law, Where("here", full_scale_dps=500.0)), encoding="utf-8")
    with using([]):
        return load_folder(tmp_path)[0], law


def test_a_file_does_not_apply_what_was_not_observed(turned):
    effect, law = turned
    movement = effect.shown(some_movement(3))
    assert np.abs(effect.columns(movement) @ TURN).max() < 1e-3 * np.abs(effect.columns(movement)).max()
    whole = as_effect(UPRIGHT).columns(some_movement(3)) @ law.theta
    assert effect.columns(movement) @ law.theta == pytest.approx(whole * FULL_SCALE / movement.fs_rps, abs=1e-3 * np.abs(whole).max())
    assert effect.partly_observed
    assert effect.gauge_convention.settle(TURN) == pytest.approx(0, abs=1e-3)
    assert "closure" not in effect.device.why
    assert "not observed" in effect.device.why


def test_a_file_holds_the_numbers_that_another_recording_must_agree_with(turned):
    effect, law = turned
    assert effect.stated.theta == pytest.approx(law.theta, rel=1e-5)
    assert effect.stated.covariance == pytest.approx(law.covariance, rel=1e-5, abs=1e-20)
    same = against_stated(AppliedEffect(effect, law.theta), law.covariance)
    assert same.p_value == pytest.approx(1)
    assert "agree" in same.words
    away = law.theta + 20 * np.sqrt(law.covariance[0, 0]) * np.eye(9)[1]
    other = against_stated(AppliedEffect(effect, away), law.covariance)
    assert other.p_value < 1e-10
    assert "contradicted" in other.words


def test_the_difference_counts_in_both_covariances_and_by_the_shape():
    stated = StatedNumbers(np.array([1.0, 2.0]), np.diag([9.0, 16.0]), (57.0, 3.0))
    there = np.array([6.0, 2.0]), np.diag([16.0, 9.0])
    assert stated.against(*there) == (pytest.approx(1.0), 2)
    assert stated.against(*there, 42.0) == (pytest.approx(1.0 + 15**2 / 18), 3)
    fixed = StatedNumbers(np.zeros(2), np.diag([1.0, 0.0]))
    assert fixed.against(np.array([2.0, 5.0]), np.diag([1.0, 0.0])) == (pytest.approx(2.0), 1)


@pytest.mark.parametrize(("nearer", "prefers"), [(12, True), (9, False)])
def test_gravity_within_the_turns_decides_by_pairs_of_turns(monkeypatch, nearer, prefers):
    """Of 12 turns, all or three quarters nearer."""
    one, other = SimpleNamespace(fit="one"), SimpleNamespace(fit="other")
    squares = {"one": np.ones(12), "other": np.where(np.arange(12) < nearer, 1.5, 0.4) + np.arange(12) / 1e3}
    monkeypatch.setattr(
        within_turns, "lever_equations", lambda twin, fit: SimpleNamespace(solve=lambda: None, left=lambda solution: squares[fit])
    )
    within = within_turns.WithinTurns(None)
    assert within.prefers(one, other) == prefers
    assert not within.prefers(other, one)
    assert not within.prefers(one, one)


def test_forms_of_the_laws_gain_are_weighed_the_plainest_first_and_the_law_without_its_lag():
    late = LawForm((Factor("rate", "size", None, 0.15),))
    plain, square, far = LawForm((Factor("speed_slope"),)), LawForm((Factor("rate", "excess", 0.1),)), LawForm((Factor("force"),), "full")
    forms = [late, square, plain, far]
    gains = np.array([[1000.0, 985.0, 985.0, 900.0], [1000.0, 10.0, 10.0, 10.0]])
    screening = SimpleNamespace(forms=forms, gain=gains)
    evidence = SimpleNamespace(forms={"discovered.n0": late}, effect_of=lambda form: form)
    searched = SimpleNamespace(evidence=evidence, round_of=lambda law: SimpleNamespace(screening=screening))
    found = alike(searched, SimpleNamespace(id="discovered.n0"))
    assert found == [LawForm((Factor("rate", "size"),)), plain, square]
    assert numbers_of(plain) < numbers_of(late) < numbers_of(LawForm((Factor("rate", "excess", 0.1, 1.0),)))
    assert len(found) <= search_state.MOST_ALIKE


@pytest.mark.parametrize(("sigma", "lacks"), [(0.05, False), (0.4, True)])
def test_numbers_must_be_known_well_enough_for_the_stated_rate(sigma, lacks):
    """One number for each axis, known to a share: the rate of a draw lacks the mean square of that share."""
    form = LawForm((Factor("rate", "square"),))
    covariance = sigma**2 * np.eye(3)
    found = share_lacking(form, np.array([1.0, -1.0, 1.0]), covariance, None, np.eye(3), [some_movement(3)])
    assert (found > MOST_LACKING) == lacks


def test_a_threshold_that_is_not_known_counts_with_the_coefficients_that_follow_it():
    form, theta = LawForm((Factor("rate", "signed_beyond", 0.2),)), np.array([1.0, -1.0, 1.0])
    given = (form, theta, 1e-8 * np.eye(3)), (np.eye(3), [some_movement(3)])
    sharp, wide = ((np.array([[spread**2]]), np.zeros((3, 1))) for spread in (0.001, 0.5))
    assert share_lacking(*given[0], sharp, *given[1]) == 0
    assert share_lacking(*given[0], wide, *given[1]) > 0.5
    follows = np.array([[0.01]]), np.array([[50.0], [50.0], [50.0]])
    assert share_lacking(*given[0], follows, *given[1]) > 0.5
