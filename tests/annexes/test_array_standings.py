"""Limits of an array's parts by the profile of the likelihood, and the standings that follow from them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from scipy.optimize import brentq
from scipy.stats import chi2
from small_array import small_array

from tinygc.annexes.arrays import standings
from tinygc.annexes.arrays.explanation import ArrayExplanation
from tinygc.annexes.arrays.joint import estimate, split_of
from tinygc.annexes.arrays.profile_limits import rise, upper_component
from tinygc.annexes.arrays.standings import Part, parts_of
from tinygc.annexes.arrays.system import System
from tinygc.explanation.standing import Standing, Statement

BASE = 0.5


def plain(values):
    """Rows without unknowns, all of one component."""
    n = len(values)
    return System(np.zeros((n, 1)), values, np.full(n, BASE), np.ones((1, n)), np.ones(1), np.zeros(1), np.zeros(n, dtype=bool))


def test_a_limit_is_where_the_likelihood_falls_by_a_one_sided_twentieth():
    """-2 log L = n log v + S / v with v = base + t, so the limit solves one equation."""
    values = np.random.default_rng(4).normal(size=80) * np.sqrt(BASE + 1.0)
    square, n = float(np.sum(values**2)), len(values)
    best = square / n
    solution = plain(values).estimated(np.array([0.3]))
    assert solution.t[0] == pytest.approx(best - BASE, rel=1e-3)
    risen = lambda v: n * np.log(v / best) + square * (1 / v - 1 / best)  # noqa: E731
    exact = brentq(lambda t: risen(BASE + t) - chi2.isf(0.1, 1), best - BASE, 20)  # 2.706: each side of 5 %
    assert rise(solution, {0: 2.0}) == pytest.approx(risen(BASE + 2.0), rel=1e-3)
    found = upper_component(solution, 0, float(solution.sigma()[0]))
    assert exact <= found <= 1.04 * exact


def test_where_nothing_shows_the_limit_is_that_of_noise_alone():
    values = np.random.default_rng(4).normal(size=80) * np.sqrt(0.6 * BASE)
    square, n = float(np.sum(values**2)), 80
    solution = plain(values).estimated(np.array([0.3]))
    assert solution.t[0] == 0.0
    risen = lambda v: n * np.log(v / BASE) + square * (1 / v - 1 / BASE)  # noqa: E731
    exact = brentq(lambda t: risen(BASE + t) - chi2.isf(0.1, 1), 1e-9, 20)
    assert exact <= upper_component(solution, 0, np.inf) <= 1.04 * exact


def fitted(**truth):
    made = small_array(units=3, stills=16, seed=3, **truth)
    joint = estimate(made.units, made.same, np.zeros(15))
    return parts_of(joint, split_of(joint), np.full(3, 0.1 * DEG), (0, 2, 5))


def test_an_array_without_errors_of_its_own_has_bounds_and_no_finding():
    parts = fitted()
    assert parts.common.standing is Standing.BOUNDED
    assert [part.standing for part in parts.own] == [Standing.BOUNDED] * 3
    assert "below" in parts.all_own.statement.words
    assert parts.fast is None


def test_what_all_miss_by_and_what_one_misses_by_are_told_apart():
    parts = fitted(common_rad=0.3 * DEG)
    assert parts.common.standing is Standing.FOR
    assert parts.common.size_rad == pytest.approx(np.sqrt(2) * 0.3 * DEG, rel=0.35)
    assert parts.common.upper_rad > parts.common.size_rad
    assert parts.all_own.standing is not Standing.FOR
    parts = fitted(turn_rad=np.array([0.0, 0.4 * DEG, 0.0]))
    assert parts.own[1].standing is Standing.FOR
    assert parts.all_own.standing is Standing.FOR
    assert "in unit 2" in parts.all_own.statement.words
    assert "in any other" in parts.all_own.statement.words
    assert parts.common.standing is not Standing.FOR


def fast_of(factor, zero, claimed, upper=1.0, predicted=0.2 * DEG, floor=0.1 * DEG, monkeypatch=None):
    """The statement on fast motion of a joint estimate with this factor, where the likelihood falls by so much at zero and at the claim."""
    solution = SimpleNamespace(t=np.array([1.0, 0.0, factor**2, 0.0]))
    monkeypatch.setattr(standings, "rise", lambda _, held: zero if held[2] == 0 else claimed)
    monkeypatch.setattr(standings, "upper_component", lambda *_: upper**2)
    return standings._fast(SimpleNamespace(solution=solution, sigmas=np.ones(4)), predicted, floor)


def test_motion_beyond_the_data_rate_is_tested_against_zero_and_against_its_prediction(monkeypatch):
    three = chi2.isf(2 * 0.04, 1)
    there = fast_of(0.9, three, 100.0, monkeypatch=monkeypatch)
    assert there.standing is Standing.FOR
    assert there.statement.p_value == pytest.approx(0.04)
    assert there.size_rad == pytest.approx(0.18 * DEG)
    weak = fast_of(0.9, chi2.isf(2 * 0.06, 1), 100.0, monkeypatch=monkeypatch)
    assert weak.standing is Standing.UNDECIDED
    not_that = fast_of(0.3, 0.0, three, monkeypatch=monkeypatch)
    assert not_that.standing is Standing.AGAINST
    assert "not the predicted 0.13° to 0.3°" in not_that.statement.words
    assert fast_of(0.3, 0.0, chi2.isf(2 * 0.06, 1), monkeypatch=monkeypatch).standing is Standing.UNDECIDED
    assert fast_of(0.3, 0.0, 0.0, upper=0.4, monkeypatch=monkeypatch).standing is Standing.BOUNDED


def a_part(standing, p_value=0.5):
    return Part(Statement("what", standing, "test", p_value, "1°", "2°"), 0.01, 0.02)


@pytest.mark.parametrize(
    ("common", "own", "verdict"),
    [
        (Standing.BOUNDED, Standing.BOUNDED, "no_mismatch"),
        (Standing.BOUNDED, Standing.UNDECIDED, "undecided"),
        (Standing.UNDECIDED, Standing.UNDECIDED, "undecided"),
        (Standing.FOR, Standing.UNDECIDED, "common"),
        (Standing.BOUNDED, Standing.FOR, "own"),
        (Standing.FOR, Standing.FOR, "common_and_own"),
    ],
)
def test_the_verdict_follows_from_the_standings(common, own, verdict):
    parts = SimpleNamespace(common=a_part(common), fast=None, own=(), all_own=a_part(own))
    fit = SimpleNamespace(joint=SimpleNamespace(events=()))
    found = ArrayExplanation(fit, {}, {}, parts, (), None, {}, ())
    assert found.verdict == verdict
    slow = SimpleNamespace(statement=Statement("zero", Standing.FOR, "t", 0.01, "", ""))
    # One cause moves the zero-rate offsets of all units.
    assert replace(found, slow_zero=slow).verdict == ("common_and_own" if own is Standing.FOR else "common")
