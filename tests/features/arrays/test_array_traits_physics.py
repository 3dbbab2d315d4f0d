"""Whose an effect is: equality of the units' estimates, their pooled value, the units that differ, what is common; steps in readings."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from scipy.spatial.transform import Rotation
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from session.base.texts import measured
from session.base.units import EARTH_RATE_RPS
from tinygc import SimulationOptions
from tinygc.effects import catalogue
from tinygc.features.arrays.events import ArrayEvent
from tinygc.features.arrays.explanation import ArrayShown, steps_of
from tinygc.features.arrays.feature import ArrayOptions
from tinygc.features.arrays.fit import events_and_left_out, fit_array
from tinygc.features.arrays.recording import read_array
from tinygc.features.arrays.simulation import simulate_array, write_array
from tinygc.features.arrays.traits import ALIKE, COMMON, DIFFERS, UNDECIDED, _yaw_to_array, slow_zero, trait_of
from tinygc.inference.choose import PRIOR_ODDS, STEPS, Standing, Statement
from tinygc.reporting.terminal import as_text

OFFSET = catalogue()["timing.gyro_accel_offset"]
PLAUSIBLE = OFFSET.parameter.plausible


def of(values, named=(0,), share=0.0, unknown=(), instead=(), sigmas=1.0):
    """The trait of units with these estimates and sigmas, in thousandths of the plausible size."""
    sigmas = np.broadcast_to(sigmas, len(values))
    scale = OFFSET.parameter.plausible / 1000
    each = enumerate(zip(values, sigmas, strict=True))
    estimates = {n: (np.array([scale * x]), np.array([[(scale * s) ** 2]])) for n, (x, s) in each}
    claims = {n: SimpleNamespace(description="does", equivalent=instead) for n in named}
    return trait_of(OFFSET, claims, estimates, share, unknown)


def scope(found):
    return found.figures["scope"]


def log_evidence(values, share=0.0):
    """Of one value of units with sigma 1, against zero, the mean over its scales, by normal densities, with its prior odds."""
    covariance = np.full((len(values),) * 2, share) + (1 - share) * np.eye(len(values))
    zero = multivariate_normal(np.zeros(len(values)), covariance).logpdf(values)
    with_one = [multivariate_normal(np.zeros(len(values)), covariance + (1000 * s) ** 2).logpdf(values) for s in STEPS]
    return logsumexp(with_one) - np.log(len(STEPS)) - zero + np.log(PRIOR_ODDS)


def test_the_evidence_for_one_value_is_that_of_all_units_together():
    """3.6, 3.1, 2.9, 3.3: over all of them 6.4 sigmas of the mean, of which a unit alone shows half; one error of all leaves 3.2."""
    values = [3.6, 3.1, 2.9, 3.3]
    found, alone = of(values), of(values, share=0.99)  # four units with one error know no more than one of them
    assert (scope(found), found.standing, scope(alone)) == (ALIKE, Standing.FOR, UNDECIDED)
    assert f"in all units, of one size: {measured(3.225e-3 * PLAUSIBLE, 0.5e-3 * PLAUSIBLE)} s" in found.words
    together, own = np.exp(log_evidence(values)), [np.exp(log_evidence([x])) for x in values]
    # The sets that a climb from none reaches: together, single ones, and with one of them apart.
    apart = [np.exp(log_evidence([y for k, y in enumerate(values) if k != n])) * one for n, one in enumerate(own)]
    assert found.p_value == pytest.approx(1 - together / (1 + together + sum(own) + sum(apart)), rel=1e-6)
    assert 0 < of([12.0, 16.0]).p_value < 1e-20  # one of them has none
    assert 0 < of([12.0, 30.0]).p_value < 1e-20  # they have one value


@pytest.mark.parametrize(
    ("values", "how", "expected"),
    [
        ([12.0, 12.0], {"named": (0, 1)}, ALIKE),
        ([12.0, 16.0], {"named": (0, 1)}, UNDECIDED),  # both have it, and 2.8 sigmas are between them
        ([12.0, 30.0], {"named": (0, 1)}, DIFFERS),
        ([0.1, -0.2, 9.0, 0.1], {"named": (2,)}, DIFFERS),
        ([1.0, -0.5, 0.3, 2.4], {"named": (3,)}, UNDECIDED),
        ([9.0], {}, UNDECIDED),  # one unit says nothing of others
        ([10.0, 0.0, 0.0, 0.0], {"sigmas": [1, 10, 10, 10]}, UNDECIDED),  # blind units show neither
    ],
)
def test_units_differ_or_share_only_what_the_evidence_shows(values, how, expected):
    assert scope(of(values, **how)) == expected


@pytest.mark.parametrize(
    ("values", "how", "apart", "words"),
    [
        ([0.1, -0.2, 9.0, 0.1], {"named": (2,)}, (2,), "differs between units: {9.0 ± 1.0} s in unit 2, {0.0 ± 0.57735} s in the others"),
        ([1.9, -1.0, -0.5, 0.2, -0.6], {}, (), "below {0.7356} s with 95 %"),  # 1.645 / sqrt(5)
        ([1.9, -1.0, -0.5, 0.2, -0.6], {"named": (0, 3)}, (), "below {0.7356} s with 95 %"),  # less than the largest that is named
        ([5.0] * 4, {"share": 0.2}, (), "of one size: {5.0 ± 0.63246} s"),  # sqrt((1 + 3 * 0.2) / 4)
        ([0.1, 0.1, 0.2, 4.2], {}, (), "of one size in 4 units: undecided; {1.15 ± 0.5} s; more than {5.845} s is excluded"),  # 4.2 + 1.645
        ([12.0, 16.0], {}, (), "in all units, of one size, or each its own (p = 0.064), in the mean: {14.0 ± 0.70711} s"),
        ([9.0], {}, (), "named in unit 0: undecided; {9.0 ± 1.0} s; more than {10.645} s is excluded with 95 %"),
        ([5.0, 5.0], {"unknown": (3,), "instead": ("gyro.bandwidth",)}, (), "or gyro.bandwidth: not separable here"),
        ([9.0, 9.0], {"unknown": (3,)}, (), "in units 0, 1, of one size"),
        ([5.0, 5.0], {"unknown": (3,)}, (), "unit 3 could not be explained, and may have it too"),
    ],
)
def test_words_have_the_sizes_of_the_units_that_differ_and_what_is_not_known(values, how, apart, words):
    found = of(values, **how)
    assert found.figures["apart"] == apart

    def in_seconds(match):
        value, _, sigma = match[1].partition(" ± ")
        scaled = float(value) * PLAUSIBLE / 1000
        return measured(scaled, float(sigma) * PLAUSIBLE / 1000) if sigma else f"{scaled:.2g}"

    assert re.sub(r"\{(.*?)\}", in_seconds, words) in found.words


# The Earth.


def body(yaws_deg, stills=4):
    """A fit with units mounted anyhow, whose own table axes are turned by yaws against the array's."""
    q, fits, mountings = Rotation.random(stills, random_state=3), [], []
    for number, yaw_deg in enumerate(yaws_deg):
        mountings.append(Rotation.random(random_state=5 + number))
        own = (Rotation.from_euler("z", -yaw_deg, degrees=True) * q * mountings[-1]).as_quat(scalar_first=True)
        log = SimpleNamespace(q_tb=own, stills=[object() for _ in range(stills)])
        fits.append(SimpleNamespace(problem=SimpleNamespace(logs=[log])))
    state = SimpleNamespace(q_tb=q.as_quat(scalar_first=True), mountings=[M.as_matrix() for M in mountings])
    same = SimpleNamespace(stills=[fit.problem.logs[0].stills for fit in fits], group=np.zeros(stills, dtype=int))
    return SimpleNamespace(numbers=tuple(range(len(fits))), units=fits, joint=SimpleNamespace(state=state), same=same)


def earth(factors, sigma=0.05):
    """Each unit's estimate in its own axes, of the Earth's rate times a factor; units' yaws are 37, 127, 217, …"""
    rate, yaws = EARTH_RATE_RPS * np.array([0.6, 0.0, -0.8]), [37.0 + 90 * n for n in range(len(factors))]
    covariance = (sigma * EARTH_RATE_RPS) ** 2 * np.eye(3)
    turned = [Rotation.from_euler("z", -yaw, degrees=True).apply(factor * rate) for yaw, factor in zip(yaws, factors, strict=True)]
    turns = [_yaw_to_array(body(yaws), n) for n in range(len(yaws))]
    estimates = {n: (R @ theta, R @ covariance @ R.T) for n, (theta, R) in enumerate(zip(turned, turns, strict=True))}
    return trait_of(catalogue()["earth.rotation"], {0: SimpleNamespace(description="does", equivalent=())}, estimates, 0.0, ())


@pytest.mark.parametrize(
    ("factors", "standing", "words"),
    [
        ([1.0] * 3, Standing.FOR, "in all units, of one size: 15.04 ± 0.43 °/h"),
        ([3.0] * 3, Standing.AGAINST, "45.12 ± 0.43 °/h, not the Earth's 15.0 °/h"),
        ([0.0] * 3, Standing.BOUNDED, ""),
        ([0.3], Standing.AGAINST, "4.51 ± 0.75 °/h, not the Earth's 15.0 °/h"),
        ([1.0], Standing.FOR, "15.04 ± 0.75 °/h"),
        ([0.05], Standing.BOUNDED, "named in unit 0: below"),
        ([0.7, 1.3], Standing.UNDECIDED, "differs between units: undecided; 10.53 ± 0.75 °/h in unit 0, 19.55 ± 0.75 °/h in unit 1"),
    ],
)
def test_the_earth_that_one_unit_names_is_one_term_of_all(factors, standing, words):
    """Of the last, 0.7 and 1.3 of the Earth's rate, the mean is the Earth's, and 0.6 between them is 8.5 sigmas."""
    found = earth(factors)
    assert (scope(found), found.standing) == (COMMON, standing)
    assert words in found.words


# Slow motions of the zero-rate offset.


def weighed(**scores):
    names = {"drift": "gyro.bias_drift", "step": "gyro.bias_step", "warm": "unknown.warm_up"}
    return {names[name]: (value, 0.1 * DEG, 0.15 * DEG) for name, value in scores.items()}


def test_the_family_is_decided_by_the_evidence_of_all_units():
    """Each unit prefers another member by a little; over both, the drift is better by 2 than the warm-up."""
    units = {0: weighed(drift=-20.0, warm=-21.0, step=0.0), 1: weighed(drift=-23.0, warm=-20.0, step=0.0)}
    found = slow_zero(units, {0: ("unknown.warm_up",), 1: ("gyro.bias_drift",)}, thermometer=False)
    once = 2 * np.log(1 / PRIOR_ODDS)
    each = np.exp(-(np.array([-43.0, -41.0, 0.0]) - once) / 2)
    name, share = next(iter(found.figures["shares"].items()))
    assert found.figures["by_unit"][1] == {"number": 1, "size_dps": pytest.approx(0.1), "named": True}
    assert (name, share) == ("gyro.bias_drift", pytest.approx(each[0] / each.sum()))
    assert found.standing is Standing.FOR
    assert found.p_value == pytest.approx(1 / (1 + each.sum()))
    for words in (
        "most likely a steady drift",
        "or a warm-up within the session (0.27)",
        "temperature was not recorded",
        "2 of 2 show it alone",
    ):
        assert words in found.words
    assert "not recorded" not in slow_zero(units, {}, thermometer=True).words


def test_prior_odds_are_paid_once_and_evidence_against_all_members_names_none():
    """19 to 1 is 5.89 of -2 log."""
    once = 2 * np.log(1 / PRIOR_ODDS)
    for drift, standing in ((once - 5.99, Standing.FOR), (once - 5.79, Standing.UNDECIDED)):
        units = {0: weighed(drift=1.0), 1: weighed(drift=drift - 1.0)}
        assert slow_zero(units, {}, True).standing is standing


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
    assert "unit 1 misses this turn by 0.50° against the other (F test, p < 0.001): its own readings" in words
    assert "2 of 2 units stand out in this turn, each in its own way (unit 0 by 2.0°, unit 1 by 0.50°)" in together
    assert "its own readings" not in together
    assert "together 1.42 × less noise" in as_text(alone.page).splitlines()[0]
    assert [verdict(fit=each) for each in (alone, both)] == ["own", "common"]


def verdict(common=Standing.BOUNDED, own=Standing.BOUNDED, slow=None, fit=None):
    scopes = zip((common, own, slow), ("common", "own", "common"), strict=True)
    stated = [each and Statement("what", each, "test", 0.01, "", "", figures={"scope": scope}) for each, scope in scopes]
    joint = SimpleNamespace(events=()) if fit is None else fit.joint
    told = SimpleNamespace(joint=joint, split=SimpleNamespace(common=stated[0], alone=stated[1]))
    return ArrayShown(told, {}, {}, [each for each in stated if each], ()).verdict


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
