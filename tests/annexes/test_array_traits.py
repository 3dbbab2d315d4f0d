"""Whose an effect is: equality of the units' estimates, their pooled value, the units that differ, and what must be common."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from session.io.units import EARTH_RATE_RPS
from tinygc.annexes.arrays import traits
from tinygc.annexes.arrays.slow_zero import UnitEvidence, pooled, upper_motion
from tinygc.annexes.arrays.traits import (
    ALIKE,
    COMMON,
    DIFFERS,
    READINGS,
    UNDECIDED,
    Estimate,
    departing,
    earth_trait,
    estimate_in,
    pooled_p,
    trait_of,
    traits_of,
    widened,
    yaw_to_array,
)
from tinygc.effects import Movement, catalogue
from tinygc.estimation.systematic import PRIOR_ODDS
from tinygc.explanation.standing import Standing

OFFSET, DRIFT = catalogue()["timing.gyro_accel_offset"], catalogue()["gyro.bias_drift"]


def scalars(values, sigma=1.0, named=(0,)):
    return {n: Estimate(np.array([float(x)]), np.array([[sigma**2]]), n in named) for n, x in enumerate(values)}


def test_an_effect_of_all_units_that_one_alone_shows_significantly_is_no_units_own():
    """2.2 and 1.5, 1.3, 1.6 of their sigmas: only the first is significant, and together they are 3.3 sigmas."""
    found = trait_of(OFFSET, scalars([2.2, 1.5, 1.3, 1.6]), ("says",), tests=1, share=0.0)
    assert found.scope == ALIKE
    assert found.statement.standing is Standing.FOR
    assert found.statement.p_value == pytest.approx(chi2.sf(6.6**2 / 4, 1))
    equal = chi2.sf(sum((x - 1.65) ** 2 for x in (2.2, 1.5, 1.3, 1.6)), 3)
    assert f"in all units, one size is not rejected (equal sizes p = {equal:.2g}): 1.65 ± 0.50 s" in found.words
    assert "own" not in found.words


def test_the_number_of_tests_hinders_rejection_and_does_not_favour_equality():
    """4 and 8, each ± 1: equal with p = 0.0047, which sixty tests make 0.28."""
    found = trait_of(OFFSET, scalars([4.0, 8.0], named=(0, 1)), (), 60, 0.0)
    assert found.scope == ALIKE
    assert f"equal sizes p = {chi2.sf(8.0, 1):.2g}, one of 60 tests" in found.words
    assert trait_of(OFFSET, scalars([4.0, 8.0], named=(0, 1)), (), 10, 0.0).scope == DIFFERS


def test_units_that_cannot_show_an_effect_are_not_counted_for_it():
    blind = {n: Estimate(np.zeros(1), np.array([[1e-6]]), False) for n in (1, 2, 3)}
    found = trait_of(OFFSET, {0: Estimate(np.array([1e-3]), np.array([[1e-8]]), True), **blind}, (), 1, 0.0)
    assert (found.scope, found.statement.standing) == (UNDECIDED, Standing.UNDECIDED)
    equal = chi2.sf(1e-6 / (1e-8 + 1e-6 / 3), 3)  # of one against the mean of three
    assert f"named in unit 0; units 1, 2, 3 cannot show it (equal sizes p = {equal:.2g}): undecided; 0.00000 ± 0.00058 s" in found.words
    assert found.statement.limit == "0.00095 s"
    assert "in all units" not in found.words


def test_the_others_count_where_their_own_pooled_value_is_not_zero():
    """Three others of 1 sigma each, at the bar of their mean's test."""
    bar = np.sqrt(chi2.isf(0.05, 1) / 3)
    assert trait_of(OFFSET, scalars([4.0, *[bar + 0.01] * 3]), (), 1, 0.0).scope == ALIKE
    below = trait_of(OFFSET, scalars([3.5, *[bar - 0.01] * 3]), (), 1, 0.0)
    assert below.scope == UNDECIDED
    assert below.statement.standing is Standing.UNDECIDED
    assert trait_of(OFFSET, scalars([4.0, *[bar + 0.01] * 3]), (), 1, 0.1).scope == UNDECIDED  # errors in common widen it


def test_a_unit_differs_only_where_equality_is_rejected():
    """The chi-square of homogeneity of 0, 0, 0 and x is 3/4 x^2, of three degrees of freedom."""
    bar = np.sqrt(chi2.isf(0.05, 3) * 4 / 3)
    assert trait_of(OFFSET, scalars([0, 0, 0, bar + 0.01], named=(3,)), (), 1, 0.0).scope == DIFFERS
    assert trait_of(OFFSET, scalars([0, 0, 0, bar - 0.01], named=(3,)), (), 1, 0.0).scope == UNDECIDED
    five = np.sqrt(chi2.isf(0.01, 3) * 4 / 3)  # of five effects that were tried
    assert trait_of(OFFSET, scalars([0, 0, 0, five + 0.01], named=(3,)), (), 5, 0.0).scope == DIFFERS
    assert trait_of(OFFSET, scalars([0, 0, 0, five - 0.01], named=(3,)), (), 5, 0.0).scope == UNDECIDED


def test_the_units_that_differ_are_said_with_their_size_and_that_of_the_others():
    found = trait_of(OFFSET, scalars([0.1, -0.2, 9.0, 0.1], named=(2,)), (), 1, 0.0)
    assert found.apart == (2,)
    assert found.words.startswith("timing.gyro_accel_offset differs between units: 9.0 ± 1.0 s in unit 2, 0.00 ± 0.58 s in the others")


def test_the_odd_ones_go_one_by_one_and_of_two_none_is_the_odd_one():
    covariances = np.ones((5, 1, 1))
    assert departing(np.array([[0.0], [9.0], [0.1], [-9.0], [-0.1]]), covariances) == [1, 3]
    assert departing(np.array([[0.0], [0.5], [0.1], [-0.5], [-0.1]]), covariances) == []
    assert departing(np.array([[0.0], [9.0]]), covariances[:2]) == [0, 1]
    assert departing(np.array([[0.0], [9.0], [18.0], [27.0]]), covariances[:4]) == [0, 1, 2, 3]


def test_named_in_one_unit_and_excluded_from_the_whole_is_bounded():
    found = trait_of(OFFSET, scalars([1.9, -1.0, -0.5, 0.2, -0.6], named=(0,)), (), 1, 0.0)
    assert found.scope == UNDECIDED
    assert found.statement.standing is Standing.BOUNDED
    assert "named in unit 0" in found.words
    assert "below 0.74 s with 95 %" in found.words  # 1.645 / sqrt(5)


def test_what_units_err_by_in_common_is_not_averaged_away():
    one = np.array([[4.0]])
    assert widened(one, 4, 0.0)[0, 0] == 4.0
    assert widened(one, 4, 0.5)[0, 0] == 10.0
    assert widened(one, 4, 1.0)[0, 0] == 16.0  # four units with one error know no more than one of them
    alone = trait_of(OFFSET, scalars([2.2, 1.5, 1.3, 1.6]), (), 1, 1.0)
    assert alone.statement.p_value == pytest.approx(chi2.sf(1.65**2, 1))
    assert alone.scope == UNDECIDED


def test_a_pooled_value_is_tested_by_its_chi_square():
    assert pooled_p(np.array([2.0, 0.0]), np.diag([4.0, 1.0])) == pytest.approx(chi2.sf(1.0, 2))


def test_an_effect_that_stands_for_another_and_a_unit_without_an_answer_are_said():
    found = trait_of(OFFSET, scalars([5.0, 5.0]), (), 1, 0.0, (3,), ("gyro.bandwidth",))
    assert "in units 0, 1, one size is not rejected" in found.words
    assert "or gyro.bandwidth: not told apart here" in found.words
    assert found.words.endswith("unit 3 could not be explained, and may have it too")
    alone = trait_of(OFFSET, scalars([5.0]), (), 1, 0.0, (3,))
    assert alone.scope == UNDECIDED
    assert alone.statement.standing is Standing.UNDECIDED


def body(yaw_deg: float, stills: int = 4):
    """A fit with one unit, mounted anyhow, whose own table axes are turned by a yaw against the array's."""
    q = Rotation.random(stills, random_state=3)
    mounting, yaw = Rotation.random(random_state=5), Rotation.from_euler("z", yaw_deg, degrees=True)
    own = (yaw.inv() * q * mounting).as_quat(scalar_first=True)
    still = [object() for _ in range(stills)]
    state = SimpleNamespace(q_tb=q.as_quat(scalar_first=True), mountings=[mounting.as_matrix()])
    prepared = SimpleNamespace(problem=SimpleNamespace(logs=[SimpleNamespace(q_tb=own, stills=still)]))
    same = SimpleNamespace(stills=[still], group=np.zeros(stills, dtype=int))
    return SimpleNamespace(numbers=(0,), prepared=[prepared], joint=SimpleNamespace(state=state), same=same), yaw.as_matrix()


def test_a_units_own_table_axes_are_turned_to_the_arrays():
    fit, yaw = body(37.0)
    np.testing.assert_allclose(yaw_to_array(fit, 0), yaw, atol=1e-12)


def earths(factors, sigma=0.05, named=(0,)):
    """Each unit's estimate in its own axes, of the Earth's rate times a factor; units' yaws are 0, 90, 180, …"""
    rate = EARTH_RATE_RPS * np.array([0.6, 0.0, -0.8])
    turns = {n: Rotation.from_euler("z", 90 * n, degrees=True).as_matrix() for n in range(len(factors))}
    covariance = (sigma * EARTH_RATE_RPS) ** 2 * np.eye(3)
    return {n: Estimate(turns[n].T @ (factor * rate), covariance, n in named) for n, factor in enumerate(factors)}, turns


def test_the_earth_that_one_unit_names_is_one_term_of_all(monkeypatch):
    estimates, turns = earths([1.0, 1.0, 1.0])
    monkeypatch.setattr(traits, "yaw_to_array", lambda _, number: turns[number])
    found = earth_trait(estimates, None, (0,), ("says",), 1, 0.0)
    assert found.scope == COMMON
    assert found.statement.standing is Standing.FOR
    assert "one term of all units: 15.04 ± 0.43 °/h" in found.words
    assert "own" not in found.words


def test_a_common_rotation_that_is_not_the_earths_counts_against_it(monkeypatch):
    estimates, turns = earths([3.0, 3.0, 3.0])
    monkeypatch.setattr(traits, "yaw_to_array", lambda _, number: turns[number])
    found = earth_trait(estimates, None, (0,), ("says",), 1, 0.0)
    assert found.statement.standing is Standing.AGAINST
    assert "45.12 ± 0.43 °/h, not the Earth's 15.0 °/h" in found.words
    estimates, turns = earths([0.0, 0.0, 0.0])
    assert earth_trait(estimates, None, (0,), ("says",), 1, 0.0).statement.standing is Standing.BOUNDED


def test_units_that_disagree_on_the_rotation_leave_it_undecided(monkeypatch):
    """0.7 and 1.3 of the Earth's rate: their mean is the Earth's, and 0.6 between them is 8.5 sigmas."""
    estimates, turns = earths([0.7, 1.3])
    monkeypatch.setattr(traits, "yaw_to_array", lambda _, number: turns[number])
    found = earth_trait(estimates, None, (0,), ("says",), 1, 0.0)
    assert found.statement.standing is Standing.UNDECIDED
    assert found.statement.p_value == pytest.approx(chi2.sf(0.6**2 / (2 * 0.05**2), 3))
    assert "which disagree: undecided; 11 to 20 °/h in single units" in found.words
    assert found.statement.limit == "21 °/h"


def claim(name, p_value=1e-3, probability=0.9, equivalent=()):
    return SimpleNamespace(effect=catalogue()[name], p_value=p_value, probability=probability, says=f"{name} says", equivalent=equivalent)


def gravity(offset_s, sigma_s=1e-3):
    return SimpleNamespace(offset_s=offset_s, whole_sigma_s=sigma_s)


def explained(claims, offset_s):
    naming = SimpleNamespace(fit=SimpleNamespace(state=SimpleNamespace(claims=())))
    return SimpleNamespace(claimed=claims, gravity=gravity(offset_s), naming=naming, twin=None)


def test_every_units_estimate_counts_named_or_not(monkeypatch):
    monkeypatch.setattr(traits, "candidates", lambda twin: [OFFSET])
    one = {0: explained([claim(OFFSET.id)], 4e-3), 1: explained([], 3e-3), 2: explained([], 3.2e-3)}
    (found,) = traits_of(one, None, lambda effect: 0.0, (), set())
    assert found.scope == ALIKE
    assert found.units == (0,)
    assert [each.named for each in found.estimates.values()] == [True, False, False]
    assert estimate_in(one[1], OFFSET, (), False).theta[0] == 3e-3
    other = {**one, 2: explained([], -6e-3)}
    (found,) = traits_of(other, None, lambda effect: 0.0, (), set())
    assert (found.scope, found.apart) == (DIFFERS, (2,))


def test_what_detectors_find_in_readings_says_nothing_of_the_other_units(monkeypatch):
    monkeypatch.setattr(traits, "candidates", lambda twin: [])
    one = {0: explained([claim("data.glitches"), claim("reference.not_still"), claim("motion.undersampled")], 0), 1: explained([], 0)}
    glitch, still = traits_of(one, None, lambda effect: 0.0, (), {"gyro.bias_drift"})
    assert (glitch.scope, still.scope) == (READINGS, COMMON)
    assert "in the readings of unit 0" in glitch.words
    assert "of the body, seen by unit 0" in still.words


def weighed(shapes=1, **scores):
    names = {"drift": "gyro.bias_drift", "step": "gyro.bias_step", "warm": "unknown.warm_up"}
    score = {names[name]: value for name, value in scores.items()}
    of_each = [dict.fromkeys(score, value) for value in ((40.0, 3), shapes, 0.1 * DEG, 0.15 * DEG)]
    return UnitEvidence(score, *of_each)


def test_the_family_is_decided_by_the_evidence_of_all_units():
    """Each unit prefers another member by a little; over both, the drift is better by 2 than the warm-up."""
    units = {0: weighed(drift=-20.0, warm=-21.0, step=0.0), 1: weighed(drift=-23.0, warm=-20.0, step=0.0)}
    found = pooled(units, {0: ("unknown.warm_up",), 1: ("gyro.bias_drift",)}, thermometer=False)
    assert next(iter(found.shares)) == "gyro.bias_drift"
    assert found.shares["gyro.bias_drift"] == pytest.approx(1 / (1 + np.exp(-1)), abs=1e-4)
    assert found.statement.standing is Standing.FOR
    assert found.statement.p_value == pytest.approx(3 * chi2.sf(80.0, 6))
    assert "most likely a steady drift" in found.statement.words
    assert "or a warm-up within the session (0.27)" in found.statement.words
    assert "temperature was not recorded" in found.statement.words
    assert "not recorded" not in pooled(units, {}, thermometer=True).statement.words


def test_prior_odds_are_paid_once_and_evidence_against_all_members_names_none():
    once = 2 * np.log(1 / PRIOR_ODDS)
    there = {0: weighed(drift=1.0), 1: weighed(drift=once - 1.1)}
    assert pooled(there, {}, True).statement.standing is Standing.FOR
    assert pooled({**there, 1: weighed(drift=once - 0.9)}, {}, True).statement.standing is Standing.UNDECIDED
    weak = {n: replace(unit, gain={"gyro.bias_drift": (3.0, 3)}) for n, unit in there.items()}
    assert pooled(weak, {}, True).statement.standing is Standing.UNDECIDED


def test_a_member_that_one_unit_cannot_have_is_none_of_all():
    found = pooled({0: weighed(drift=-9.0, step=-50.0), 1: weighed(drift=-9.0)}, {}, True)
    assert list(found.shares) == ["gyro.bias_drift"]
    assert pooled({0: weighed(step=-9.0), 1: weighed(drift=-9.0)}, {}, True) is None
    assert "as a steady drift" in found.statement.words


def test_the_shapes_tried_in_each_unit_count():
    found = pooled({0: weighed(shapes=7, step=-40.0, drift=0.0), 1: weighed(shapes=5, step=-40.0, drift=0.0)}, {}, True)
    assert found.statement.p_value == pytest.approx(2 * 7 * 5 * chi2.sf(80.0, 6))


@pytest.mark.parametrize(("times", "alone"), [(0.99, 1), (1.01, 2)])
def test_the_statement_counts_the_units_that_show_the_motion_by_themselves(times, alone):
    """By each unit's chi-square, over two members and the five shapes that were tried: 5 % is the limit of one."""
    units = {0: weighed(shapes=5, drift=-20.0, warm=0.0), 1: weighed(shapes=5, drift=-20.0, warm=0.0)}
    units[1].gain["gyro.bias_drift"] = float(chi2.isf(0.05 / 10, 3)) * times, 3
    assert pooled(units, {}, True).statement.words.count(f"{alone} of 2 show it alone") == 1


def test_the_limit_of_a_slow_motion_is_that_of_its_estimate():
    """A drift over the log: (t / duration - 1/2) theta, from the first to the last of 100 samples; y moves most, z is known least."""
    t = np.arange(100.0)
    zero = np.zeros((100, 3))
    more = {"vibration_g2": np.zeros(100), "first_temp_c": 25.0}
    twin = SimpleNamespace(
        movements=[Movement(t_s=t, rate=zero, force_g=zero, temp_c=zero[:, 0], dt_s=1.0, fs_rps=1.0, duration_s=100, **more)]
    )
    upper = upper_motion(twin, DRIFT, np.array([0.1, -0.4, 0.2]), np.diag([0.01, 0.04, 0.25]) ** 2)
    assert upper == pytest.approx(0.99 * (0.2 + norm.isf(0.05) * 0.25))
    weak = {n: replace(weighed(drift=5.0), upper_rps={"gyro.bias_drift": n * 0.2 * DEG}) for n in (1, 2)}
    statement = pooled(weak, {}, True).statement
    assert "undecided; by 0.1 to 0.1 dps" in statement.words
    assert statement.limit == "0.4 dps"
