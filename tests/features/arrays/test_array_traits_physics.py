"""Whose an effect is: equality of the units' estimates, their pooled value, the units that differ, what is common; steps in readings."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from session.base.units import EARTH_RATE_RPS
from tinygc import SimulationOptions
from tinygc.effects import catalogue
from tinygc.features.arrays.events import ArrayEvent
from tinygc.features.arrays.explanation import ArrayExplanation, steps_of
from tinygc.features.arrays.feature import ArrayOptions
from tinygc.features.arrays.fit import events_and_left_out, fit_array
from tinygc.features.arrays.recording import read_array
from tinygc.features.arrays.simulation import simulate_array, write_array
from tinygc.features.arrays.slow_zero import Weighed, pooled
from tinygc.features.arrays.traits import ALIKE, COMMON, DIFFERS, UNDECIDED, _yaw_to_array, trait_of
from tinygc.inference.choose import PRIOR_ODDS, Standing, Statement
from tinygc.reporting.terminal import as_text

OFFSET = catalogue()["timing.gyro_accel_offset"]


def of(values, named=(0,), tests=1, share=0.0, unknown=(), instead=(), sigmas=1.0):
    """The trait of units with these estimates and sigmas."""
    sigmas = np.broadcast_to(sigmas, len(values))
    estimates = {n: (np.array([float(x)]), np.array([[s**2]])) for n, (x, s) in enumerate(zip(values, sigmas, strict=True))}
    claims = {n: SimpleNamespace(says="says", equivalent=instead) for n in named}
    return trait_of(OFFSET, claims, estimates, tests, share, unknown)


def test_an_effect_of_all_units_that_one_alone_shows_significantly_is_no_units_own():
    """2.2 and 1.5, 1.3, 1.6 of their sigmas: only the first is significant, and together they are 3.3 sigmas."""
    values = [2.2, 1.5, 1.3, 1.6]
    found, alone = of(values), of(values, share=1.0)  # four units with one error know no more than one of them
    assert (found.scope, found.statement.standing, alone.scope) == (ALIKE, Standing.FOR, UNDECIDED)
    assert found.statement.p_value == pytest.approx(chi2.sf(4 * 1.65**2, 1))
    assert alone.statement.p_value == pytest.approx(chi2.sf(1.65**2, 1))
    equal = chi2.sf(4 * np.var(values), 3)
    assert f"in all units, one size is not rejected (equal sizes p = {equal:.2g}): 1.65 ± 0.50 s" in found.statement.words


def test_units_that_cannot_show_an_effect_are_not_counted_for_it():
    found = of([1e-3, 0, 0, 0], sigmas=[1e-4, 1e-3, 1e-3, 1e-3])
    assert (found.scope, found.statement.standing) == (UNDECIDED, Standing.UNDECIDED)
    equal = chi2.sf(1e-6 / (1e-8 + 1e-6 / 3), 3)  # of one against the mean of three
    assert (
        f"named in unit 0; units 1, 2, 3 cannot show it (equal sizes p = {equal:.2g}): undecided; 0.00000 ± 0.00058 s"
        in found.statement.words
    )
    assert found.statement.limit == "0.00095 s"
    assert "in all units" not in found.statement.words


#: bars: of the mean of three others; of the chi-square of homogeneity of 0, 0, 0 and x, 3/4 x^2, of five effects tried
OTHERS, OF_FIVE = np.sqrt(chi2.isf(0.05, 1) / 3), np.sqrt(chi2.isf(0.01, 3) * 4 / 3)


@pytest.mark.parametrize(
    ("values", "how", "scope"),
    [
        ([4.0, *[OTHERS + 0.01] * 3], {}, ALIKE),  # the others count where their own pooled value is not zero
        ([3.5, *[OTHERS - 0.01] * 3], {}, UNDECIDED),
        ([4.0, *[OTHERS + 0.01] * 3], {"share": 0.1}, UNDECIDED),
        ([4.0, 8.0], {"named": (0, 1), "tests": 60}, ALIKE),  # equal with p = 0.0047
        ([4.0, 8.0], {"named": (0, 1), "tests": 10}, DIFFERS),
        ([0, 0, 0, OF_FIVE + 0.01], {"named": (3,), "tests": 5}, DIFFERS),
        ([0, 0, 0, OF_FIVE - 0.01], {"named": (3,), "tests": 5}, UNDECIDED),
    ],
)
def test_units_differ_only_where_equality_is_rejected_and_share_only_what_the_others_show(values, how, scope):
    assert of(values, **how).scope == scope


@pytest.mark.parametrize(
    ("values", "how", "apart", "words"),
    [
        ([4.0, 8.0], {"named": (0, 1), "tests": 60}, (), f"equal sizes p = {chi2.sf(8.0, 1):.2g}, one of 60 tests"),
        ([0.1, -0.2, 9.0, 0.1], {"named": (2,)}, (2,), "differs between units: 9.0 ± 1.0 s in unit 2, 0.00 ± 0.58 s in the others"),
        ([1.9, -1.0, -0.5, 0.2, -0.6], {}, (), "below 0.74 s with 95 %"),  # 1.645 / sqrt(5)
        ([5.0, 5.0], {"unknown": (3,), "instead": ("gyro.bandwidth",)}, (), "or gyro.bandwidth: not told apart here"),
        ([5.0, 5.0], {"unknown": (3,)}, (), "unit 3 could not be explained, and may have it too"),
        ([5.0], {"unknown": (3,)}, (), "in one unit"),
    ],
)
def test_words_have_the_sizes_of_the_units_that_differ_and_what_is_not_known(values, how, apart, words):
    found = of(values, **how)
    assert found.apart == apart
    assert words in found.statement.words


# The Earth.


def body(yaws_deg, stills: int = 4):
    """A fit with units mounted anyhow, whose own table axes are turned by yaws against the array's."""
    q, fits, mountings = Rotation.random(stills, random_state=3), [], []
    for number, yaw_deg in enumerate(yaws_deg):
        mountings.append(Rotation.random(random_state=5 + number))
        own = (Rotation.from_euler("z", -yaw_deg, degrees=True) * q * mountings[-1]).as_quat(scalar_first=True)
        log = SimpleNamespace(q_tb=own, stills=[object() for _ in range(stills)])
        fits.append(SimpleNamespace(problem=SimpleNamespace(logs=[log])))
    state = SimpleNamespace(q_tb=q.as_quat(scalar_first=True), mountings=[M.as_matrix() for M in mountings])
    same = SimpleNamespace(stills=[fit.problem.logs[0].stills for fit in fits], group=np.zeros(stills, dtype=int))
    return SimpleNamespace(numbers=tuple(range(len(fits))), prepared=fits, joint=SimpleNamespace(state=state), same=same)


def earth(factors, sigma=0.05):
    """Each unit's estimate in its own axes, of the Earth's rate times a factor; units' yaws are 37, 127, 217, …"""
    rate, yaws = EARTH_RATE_RPS * np.array([0.6, 0.0, -0.8]), [37.0 + 90 * n for n in range(len(factors))]
    covariance = (sigma * EARTH_RATE_RPS) ** 2 * np.eye(3)
    turned = [Rotation.from_euler("z", -yaw, degrees=True).apply(factor * rate) for yaw, factor in zip(yaws, factors, strict=True)]
    turns = [_yaw_to_array(body(yaws), n) for n in range(len(yaws))]
    estimates = {n: (R @ theta, R @ covariance @ R.T) for n, (theta, R) in enumerate(zip(turned, turns, strict=True))}
    return trait_of(catalogue()["earth.rotation"], {0: SimpleNamespace(says="says", equivalent=())}, estimates, 1, 0.0, ())


@pytest.mark.parametrize(
    ("factors", "standing", "words"),
    [
        ([1.0] * 3, Standing.FOR, "one term of all units: 15.04 ± 0.43 °/h"),
        ([3.0] * 3, Standing.AGAINST, "45.12 ± 0.43 °/h, not the Earth's 15.0 °/h"),
        ([0.0] * 3, Standing.BOUNDED, ""),
        ([0.7, 1.3], Standing.UNDECIDED, "which disagree: undecided; 11 to 20 °/h in single units"),
    ],
)
def test_the_earth_that_one_unit_names_is_one_term_of_all(factors, standing, words):
    """Of the last, 0.7 and 1.3 of the Earth's rate, the mean is the Earth's, and 0.6 between them is 8.5 sigmas."""
    found = earth(factors)
    assert (found.scope, found.statement.standing) == (COMMON, standing)
    assert words in found.statement.words
    if len(factors) == 2:
        assert found.statement.p_value == pytest.approx(chi2.sf(0.6**2 / (2 * 0.05**2), 3))
        assert found.statement.limit == "21 °/h"


# Slow motions of the zero-rate offset.


def weighed(shapes=1, gain=40.0, **scores):
    names = {"drift": "gyro.bias_drift", "step": "gyro.bias_step", "warm": "unknown.warm_up"}
    return {names[name]: Weighed(value, gain, 3, shapes, 0.1 * DEG, 0.15 * DEG) for name, value in scores.items()}


def test_the_family_is_decided_by_the_evidence_of_all_units():
    """Each unit prefers another member by a little; over both, the drift is better by 2 than the warm-up."""
    units = {0: weighed(drift=-20.0, warm=-21.0, step=0.0), 1: weighed(drift=-23.0, warm=-20.0, step=0.0)}
    found, table = pooled(units, {0: ("unknown.warm_up",), 1: ("gyro.bias_drift",)}, thermometer=False)
    name, share = next(iter(table["shares"].items()))
    assert table["by_unit"][1] == {"number": 1, "size_dps": pytest.approx(0.1), "named": ("gyro.bias_drift",)}
    assert (name, share) == ("gyro.bias_drift", pytest.approx(1 / (1 + np.exp(-1)), abs=1e-4))
    assert found.standing is Standing.FOR
    assert found.p_value == pytest.approx(3 * chi2.sf(80.0, 6))
    for words in ("most likely a steady drift", "or a warm-up within the session (0.27)", "temperature was not recorded"):
        assert words in found.words
    assert "not recorded" not in pooled(units, {}, thermometer=True)[0].words
    shapes = {n: weighed(shapes=count, step=-40.0, drift=0.0) for n, count in enumerate((7, 5))}  # those tried in each unit count
    assert pooled(shapes, {}, True)[0].p_value == pytest.approx(2 * 7 * 5 * chi2.sf(80.0, 6))


def test_prior_odds_are_paid_once_and_evidence_against_all_members_names_none():
    once = 2 * np.log(1 / PRIOR_ODDS)
    for drift, gain, standing in (
        (once - 1.1, 40.0, Standing.FOR),
        (once - 0.9, 40.0, Standing.UNDECIDED),
        (once - 1.1, 3.0, Standing.UNDECIDED),
    ):
        units = {0: weighed(gain=gain, drift=1.0), 1: weighed(gain=gain, drift=drift)}
        assert pooled(units, {}, True)[0].standing is standing


# Steps in readings, events, and the verdict.


@pytest.fixture(scope="module")
def hit(tmp_path_factory):
    """A body that is knocked in the middle turn, and a last unit that reads falsely in the second."""
    options = SimulationOptions(segments=8, closure_s=0, odr_hz=62.5, seed=8)
    made = simulate_array(options, ArrayOptions(units=2, knock_deg=1.0, false_reading_dps=60.0))
    return made.plan, fit_array(read_array(write_array(made, tmp_path_factory.mktemp("hit") / "array")), bias="ends")


def test_a_false_reading_is_in_one_unit_and_a_knock_in_all(hit):
    plan, fit = hit
    false, *knocks = steps_of(fit)
    assert (false.what, false.unit) == ("false reading", 1)
    assert false.at_s == pytest.approx(np.mean(plan.turns[1]), abs=0.1)
    assert false.felt < 0.2
    assert {moment.what for moment in knocks} == {"knock"}
    assert all(moment.at_s == pytest.approx(np.mean(plan.turns[4]), abs=0.1) for moment in knocks)


def test_units_that_stand_out_together_are_not_blamed(hit):
    """A blow is felt by all and sampled by each otherwise: of more than one unit at once none is said to read falsely."""
    _, fit = hit
    one, other = (ArrayEvent("turn", unit, 30.0, size * DEG, 1e-9, 3, 4) for unit, size in ((1, 0.5), (0, 2.0)))
    alone, both = (replace(fit, joint=replace(fit.joint, events=events)) for events in ((one,), (one, other)))
    words, together = (line.plain for each in (alone, both) for line in events_and_left_out(each))
    assert "unit 1 misses this turn by 0.5° against the other (F test, p = 1e-09): its own readings" in words
    assert "2 of 2 units stand out in this turn, each in its own way (unit 0 by 2°, unit 1 by 0.5°)" in together
    assert "its own readings" not in together
    assert "; 2 equal ones would have 1.41 times less." in " ".join(as_text(alone.page).split())
    assert [verdict(fit=each) for each in (alone, both)] == ["own", "common"]


def verdict(common=Standing.BOUNDED, own=Standing.BOUNDED, slow=None, fit=None):
    common, own, slow = (standing and Statement("what", standing, "test", 0.01, "", "") for standing in (common, own, slow))
    joint = SimpleNamespace(events=()) if fit is None else fit.joint
    stated = SimpleNamespace(joint=joint, split=SimpleNamespace(common=common, alone=own))
    return ArrayExplanation(stated, {}, {}, (), slow and (slow, {}), {}, ()).verdict


@pytest.mark.parametrize(
    ("common", "own", "expected"),
    [
        (Standing.BOUNDED, Standing.BOUNDED, "no_mismatch"),
        (Standing.BOUNDED, Standing.UNDECIDED, "undecided"),
        (Standing.FOR, Standing.UNDECIDED, "common"),
        (Standing.BOUNDED, Standing.FOR, "own"),
        (Standing.FOR, Standing.FOR, "common_and_own"),
    ],
)
def test_the_verdict_follows_from_the_standings_and_one_cause_of_all_zeros_is_common(common, own, expected):
    assert verdict(common, own) == expected
    assert verdict(common, own, Standing.FOR) == ("common_and_own" if own is Standing.FOR else "common")
