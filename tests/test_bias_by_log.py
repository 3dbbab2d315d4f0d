"""The bias of a fit: which source is taken, by each rule, and the bias of each log beside a search by scipy."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares
from small_sessions import small_session
from small_turns import PERFECT, TRUE, angles_by_scipy

from session.io.errors import CalibrationError
from session.io.units import DEG
from tinygc.estimation import bias
from tinygc.estimation.bias import BiasChoice, bias_by_log, choose, closes_better, less_by_chance, level_days, levelled
from tinygc.estimation.options import FitOptions
from tinygc.models.linear import LinearModel


def test_better_by_chance_is_the_exact_signed_rank_of_tilts_that_are_smaller_altogether():
    usual = np.array([[3.0, 4.0, 9.0], [0.0, 2.0, 9.0], [1.0, 0.0, 9.0]])  # tilts of 5, 2 and 1; the third angle does not count
    assert less_by_chance(usual, usual * [0.5, 0.5, 99]) == 1 / 8  # all three of eight signs
    assert less_by_chance(usual, usual[:, :2] * [[0.5], [0.5], [1.1]]) == 2 / 8  # the smallest difference the other way
    assert less_by_chance(usual, usual[:, :2] * [[0.5], [1.0], [1.0]]) == 1 / 2
    assert less_by_chance(usual, usual) == 1.0
    assert less_by_chance(usual, usual[:, :2] * [[1.1], [0.1], [0.1]]) == 1.0  # the root mean square is not smaller
    assert less_by_chance(usual[:2], np.array([[5.0, 0], [0, 2.0]])) == 1.0


def test_the_smaller_held_out_error_decides_and_of_few_turns_a_test():
    usual = np.random.default_rng(1).standard_normal((13, 2))
    assert closes_better(usual, 0.989 * usual)
    assert not closes_better(usual, 0.991 * usual)  # as good as equal
    mixed = usual * np.where(np.arange(13) < 7, 1.2, 0.5)[:, None]
    assert closes_better(usual, mixed)
    assert not closes_better(usual[:12], mixed[:12])  # seven of twelve are worse
    assert closes_better(usual[:12], 0.9 * usual[:12])


@pytest.mark.parametrize(
    ("asked", "ends", "stills", "prior", "unobserved", "turns", "used"),
    [
        ("auto", 1.0, 0.5, None, (), 7, "stills"),
        ("auto", 0.5, 1.0, None, (), 7, "ends"),
        ("auto", 1.0, 1.0, None, (), 7, "ends"),
        ("ends", 1.0, 0.5, None, (), 7, "ends"),
        ("stills", 0.5, 1.0, None, (), 7, "stills"),
        ("auto", 1.0, 1.0, "lot", (), 7, "stills"),  # no worse by more than chance
        ("auto", 0.5, 1.0, "lot", (), 7, "ends"),
        ("auto", 0.5, 1.0, None, (), 6, "stills"),  # too few turns for their ends to show it
        ("auto", 0.5, 1.0, None, ("bx",), "known", "stills"),  # with stated angles, where they do not show it
        ("auto", 0.5, 1.0, None, ("s_xx",), "known", "ends"),
        ("auto", 0.5, 1.0, None, ("s_xx",), "few known", "ends"),
    ],
)
def test_the_source_is_the_one_asked_for_or_shown_to_be_better(monkeypatch, asked, ends, stills, prior, unobserved, turns, used):
    counts = {"known": (4, 3), "few known": (2, 2)}.get(turns) or (4, turns - 4)
    problem = replace(small_session(counts, kind="known" if isinstance(turns, str) else "tilt"), prior=prior)
    unobserved = tuple({"bx": bias.NAMES[bias.BIAS][0], "s_xx": bias.NAMES[0]}[name] for name in unobserved)
    asked_for = []

    def run_method(name, problem, options, before=None):
        size = (ends if problem.rest_rps is None else stills) * np.ones((8, 2))
        asked_for.append((name, before))
        return SimpleNamespace(held_out=size * DEG, notes={"unobserved": unobserved})

    monkeypatch.setattr(bias, "run_method", run_method)
    choice, chosen, fit = choose(problem, FitOptions(bias=asked))
    assert (choice.used, chosen.rest_rps is not None) == (used, used == "stills")
    assert fit.held_out is choice.held_out[used]
    assert choice.p_value == (1 / 256 if stills < ends else 1.0)
    assert asked_for[0] == ("least_squares", None)
    assert set(asked_for[1][1]) == {"least_squares"}
    assert choice.of_lot == (prior is not None)
    assert choice.unseen == (turns == 6 or unobserved == bias.NAMES[bias.BIAS][:1])
    table = choice.to_json()
    assert (table["requested"], table["used"], table["p_value"]) == (asked, used, choice.p_value)
    assert table["ends_holdout_tilt_rms_deg"] == pytest.approx(ends * np.sqrt(2))
    assert table["stills_holdout_tilt_rms_deg"] == pytest.approx(stills * np.sqrt(2))


@pytest.mark.parametrize(
    ("more", "truths", "why"),
    [
        ({}, True, "do not lie between stills"),
        ({"still_rates": True}, False, "--still-rates"),
        ({"bias_per_log": True}, False, "--bias-per-log"),
    ],
)
def test_stills_that_cannot_be_used_are_refused_or_passed_over(monkeypatch, more, truths, why):
    monkeypatch.setattr(bias, "run_method", lambda *_, **__: "fit")
    problem = small_session(truths=truths)
    with pytest.raises(CalibrationError, match=f"--bias stills: .*{why}"):
        choose(problem, FitOptions(bias="stills", **more))
    choice, same, fit = choose(problem, FitOptions(**more))
    assert (choice.used, choice.held_out, same, fit) == ("ends", {}, problem, "fit")
    assert choice.words == "Bias from the ends of the turns."
    assert choice.to_json()["ends_holdout_tilt_rms_deg"] is None


@pytest.mark.parametrize(
    ("asked", "used", "unseen", "of_lot", "words"),
    [
        ("auto", "stills", False, False, "of each turn from the stills around it (which closes held-out turns better);"),
        ("auto", "ends", False, False, "from the ends of the turns (so few turns do not tell that the stills are better, p = 0.031);"),
        ("ends", "ends", True, True, "from the ends of the turns (as asked);"),
        ("auto", "stills", True, False, "of each turn from the stills around it: the ends of so few turns do not show it."),
        ("auto", "stills", False, True, "with a lot's prior and few turns, using their ends is not significantly better."),
        ("auto", "ends", False, True, "so few turns do not tell that the stills are better"),
        ("stills", "stills", False, True, "(as asked);"),
        ("stills", "stills", True, False, "(as asked);"),
    ],
)
def test_a_choice_says_why(asked, used, unseen, of_lot, words):
    held = {"ends": np.array([[3.0, 4.0]]) * DEG, "stills": np.array([[0.0, 1.0]]) * DEG}
    said = BiasChoice(asked, used, held, 0.0312, unseen, of_lot).words
    assert words in said
    if said.endswith("°."):
        assert said.endswith("held out with the ends 5.0000°, with the stills 1.0000°.")


def test_the_bias_of_each_log_closes_its_turns_best():
    problem = small_session((4, 3))
    off = LinearModel(TRUE.E, TRUE.B + np.array([1e-3, -2e-3, 3e-3]))
    owner = np.array([segment.log for segment in problem.used])
    for sigma in (None, np.linspace(1e-3, 9e-3, 14).reshape(7, 2)):
        found = bias_by_log(problem, off, sigma)
        weights = problem.floor.sigma if sigma is None else sigma
        for log in (0, 1):
            part = problem.batch.pick(owner == log)

            def left(change, part=part, weight=1 / weights[owner == log]):
                return (angles_by_scipy(part, off.vector + np.r_[np.zeros(9), change]) * weight).ravel()

            best = least_squares(left, np.zeros(3), x_scale=1e-3, xtol=1e-12, ftol=1e-12, gtol=1e-12).x
            np.testing.assert_allclose(found[log], best, rtol=2e-3, atol=1e-6)


def test_a_log_of_one_turn_has_no_bias_of_its_own():
    found = bias_by_log(small_session((4, 1)), TRUE)
    assert np.isfinite(found).all(axis=1).tolist() == [True, False]
    assert np.isfinite(bias_by_log(small_session((4, 2)), TRUE)).all()


@pytest.fixture(scope="module")
def two_days():
    """Twelve turns in each of two logs, the second of another bias."""
    problem = small_session((12, 12), noise=3.0)
    owner = np.array([segment.log for segment in problem.used])
    moved = problem.batch.rate + (owner == 1)[:, None, None] * np.array([2e-3, -1e-3, 3e-3])
    problem = replace(problem, batch=replace(problem.batch, rate=moved), first=PERFECT)
    return problem, owner, level_days(problem)


def test_biases_of_days_are_those_of_one_fit_of_all_beside_a_common_matrix(two_days):
    """Twelve parameters and a bias of the second log more, weighted alike, by scipy."""
    problem, owner, days = two_days

    def left(x):
        shifted = replace(problem.batch, earth=problem.batch.earth - (owner == 1)[:, None, None] * x[12:])
        return (angles_by_scipy(shifted, TRUE.vector + x[:12]) / days.sigma).ravel()

    best = least_squares(left, np.zeros(15), x_scale=1e-3, xtol=1e-12, ftol=1e-12, gtol=1e-12).x[12:]
    sigma = 2e-5
    np.testing.assert_allclose(days.offsets[1] - days.offsets[0], best, atol=sigma)
    np.testing.assert_allclose(days.offsets.sum(axis=0), 0, atol=1e-12)  # from their median
    np.testing.assert_allclose(days.sigma_rps, np.sqrt(np.sum(days.offsets**2, axis=0)), rtol=1e-12)  # of two: one degree of freedom
    np.testing.assert_allclose(days.batch.earth, problem.batch.earth - days.offsets[owner][:, None], atol=1e-15)
    np.testing.assert_array_less(np.abs(best), 1e-2)


def test_a_levelled_floor_is_widened_by_its_turns_factors(two_days):
    problem, _, days = two_days
    found, spread = levelled(problem)
    factor = np.repeat((days.sigma / problem.floor.sigma)[:, 0], 2)
    np.testing.assert_allclose(found.floor.dense(), problem.floor.dense() * np.outer(factor, factor), rtol=1e-12)
    np.testing.assert_allclose(found.floor.wider, problem.floor.wider * factor[::2, None, None] ** 2, rtol=1e-12)
    np.testing.assert_allclose(found.floor.sigma, days.sigma, rtol=1e-12)
    np.testing.assert_array_equal(spread, days.sigma_rps)
    assert np.ptp(factor) > 0.1
    bare = levelled(replace(problem, floor=replace(problem.floor, wider=None)))[0]
    assert bare.floor.wider is None


def test_a_day_of_one_turn_has_no_share_in_the_spread():
    problem = small_session((12, 1))
    days = level_days(problem)
    np.testing.assert_allclose(days.offsets[0], 0, atol=1e-12)
    assert np.isnan(days.offsets[1]).all()
    np.testing.assert_allclose(days.sigma_rps, 0, atol=1e-12)
    np.testing.assert_array_equal(days.batch.earth[-1], problem.batch.earth[-1])


def test_three_days_have_two_degrees_of_freedom():
    problem = small_session((8, 4))
    segments = [replace(s, log=2) if s.log == 0 and s.number > 4 else s for s in problem.segments]
    days = level_days(replace(problem, segments=segments, logs=[*problem.logs, problem.logs[0]]))
    np.testing.assert_array_equal(np.median(days.offsets, axis=0), 0)
    np.testing.assert_allclose(days.sigma_rps, np.sqrt(np.sum(days.offsets**2, axis=0) / 2), rtol=1e-12)
