"""Claims term by term: display units, sigmas, probabilities, what was considered, and how p-values and numbers are written."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from tinygc.effects import AppliedEffect, Parts, catalogue
from tinygc.effects.effect import StatedNumbers
from tinygc.explanation.claims import (
    AgainstStated,
    Considered,
    against_stated,
    considered_of,
    described,
    measured,
    named_claims,
    offset_claim,
    p_entry,
    p_words,
    readable,
    repair_claims,
    theta_of,
)
from tinygc.explanation.search import NamedEffect
from tinygc.noise.turn_gravity import TurnGravity

DEG = np.pi / 180
EFFECTS = catalogue()
STEP, SKEW, VIBRATION = (EFFECTS[name] for name in ("gyro.bias_step", "timing.axis_skew", "gyro.vibration_rectification"))


# Numbers and p-values as text


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.00095123, 1.2e-5, "0.000951 ± 0.000012"),
        (1234.56, 12.3, "1235 ± 12"),
        (1234.56, 1.23, "1234.6 ± 1.2"),
        (123456.0, 1234.0, "123500 ± 1200"),
        (12345.0, 123.0, "12340 ± 120"),
        (1.23456789, None, "1.2346"),
        (1.23456789, 0.0, "1.2346"),
        (1.23456789, -1.0, "1.2346"),
        (1.23456789, np.inf, "1.2346"),
        (np.nan, 1.0, "nan"),
        (1.0, 1.2e-11, "1.000000000000 ± 0.000000000012"),
        (1.0, 1.2e-12, "1 ± 1.2e-12"),
    ],
)
def test_a_number_has_two_digits_of_its_sigma(value, std, text):
    assert measured(value, std) == text


def test_a_p_value_that_underflows_is_a_bound():
    assert p_entry("p", 0.02) == {"p": 0.02}
    assert p_entry("p", 0.02, bound=True) == {"p": 0.02, "p_is_upper_bound": True}
    assert p_entry("p", 1e-300) == {"p": 1e-300}
    assert p_entry("p", 1e-301) == {"p": 1e-300, "p_is_upper_bound": True}
    assert [p_words(0.0123), p_words(0.0123, bound=True), p_words(1e-99), p_words(1.1e-99)] == [
        "= 0.012",
        "< 0.012",
        "< 1e-99",
        "= 1.1e-99",
    ]


# Parameters and their sigmas in display units


def test_parameters_are_in_their_units_with_what_the_effect_is_known_to():
    """Vibration rectification is known to a tenth of itself besides; a negative variance is none."""
    theta = np.array([0.2, -0.1, 0.0]) * DEG
    covariance = np.diag([(0.01 * DEG) ** 2, (0.002 * DEG) ** 2, -1e-12])
    found, values, std = readable(AppliedEffect(VIBRATION, theta), covariance)
    assert found is theta
    assert values == {"dps_per_g2": pytest.approx([0.2, -0.1, 0.0])}
    assert std == {"dps_per_g2": pytest.approx([np.hypot(0.01, 0.02), np.hypot(0.002, 0.01), 0.0])}


def test_sigmas_of_a_convention_are_of_what_differs():
    """The first axis has zero by convention: what all have in common is in no sigma."""
    theta = np.array([0.0, 0.001, 0.004])
    covariance = np.ones((3, 3)) + np.diag([1.0, 4.0, 9.0]) * 1e-8
    _, _, std = readable(AppliedEffect(SKEW, theta), covariance)
    assert std["seconds"] == pytest.approx(np.sqrt([0.0, 5e-8, 10e-8]))


def test_an_axis_is_said_from_three_sigmas_on_or_as_the_surest():
    theta = np.array([0.3, 0.2, 0.1]) * DEG
    for sigmas, said in (((3.01, 3.01, 2.99), [1, 1, 0]), ((2.5, 2.9, 2.8), [0, 1, 0]), ((9.0, 0.1, 3.1), [1, 0, 1])):
        covariance = np.diag((theta / sigmas) ** 2)
        assert described(STEP, theta, covariance) == STEP.describe(theta * said)


def test_theta_is_the_states_own_where_it_holds_the_effect():
    state = SimpleNamespace(claims=[AppliedEffect(STEP, np.array([1.0, 2.0, 3.0]))])
    assert theta_of(STEP, {"dps": [9.0, 9.0, 9.0]}, state).tolist() == [1.0, 2.0, 3.0]
    assert theta_of(VIBRATION, {"dps_per_g2": [1.0, 2.0, 3.0]}, state) == pytest.approx(np.array([1.0, 2.0, 3.0]) * DEG)
    parts = Parts((("slow", 2.0, (0, 1)), ("fast", 10.0, (2,))), np.eye(3))
    split = replace(VIBRATION, derived=parts)
    written, _ = parts.values(np.array([2.0, 4.0, 30.0]), np.eye(3))
    assert theta_of(split, written, state) == pytest.approx([2.0, 4.0, 30.0])
    assert theta_of(replace(STEP, derived=parts), written, state).tolist() == [1.0, 2.0, 3.0]


# Against what a file states


def test_numbers_are_held_against_those_that_the_file_states():
    stated = StatedNumbers(np.array([0.1, 0.0, -0.1]), np.diag([1e-4, 1e-4, 4e-4]))
    own = replace(STEP, stated=stated)
    theta, covariance = np.array([0.13, 0.02, -0.05]), np.diag([3e-4, 0.0, 0.0])
    found = against_stated(AppliedEffect(own, theta), covariance)
    assert found.chi_square == pytest.approx(0.03**2 / 4e-4 + 0.02**2 / 1e-4 + 0.05**2 / 4e-4)
    assert found.freedom == 3
    assert found.p_value == pytest.approx(chi2.sf(found.chi_square, 3))
    assert found.to_json() == {"chi_square": found.chi_square, "freedom": 3, "p_value": found.p_value}
    assert against_stated(AppliedEffect(STEP, theta), covariance) is None


def test_a_scanned_shape_counts_in_si():
    """A step at 12 s here, and stated at 10 ± 1 s: both recordings err by as much."""
    stated = StatedNumbers(np.zeros(3), np.eye(3), (10.0, 1.0))
    own = replace(STEP, stated=stated, shape={"at_s": 12.0})
    found = against_stated(AppliedEffect(own, np.zeros(3)), np.eye(3))
    assert (found.chi_square, found.freedom) == (pytest.approx(2.0), 4)
    minutes = replace(own, shape={"at_s": 0.25}, scan=replace(STEP.scan, si=60.0))
    assert against_stated(AppliedEffect(minutes, np.zeros(3)), np.eye(3)).chi_square == pytest.approx(5.0**2 / 2)


def test_agreement_is_said_down_to_one_in_a_thousand():
    bar = chi2.isf(1e-3, 3)
    assert AgainstStated(bar * 0.999, 3).words.startswith("the numbers agree with those that its file states (p = 0.001)")
    assert "the law as stated is contradicted" in AgainstStated(bar * 1.001, 3).words


# What was considered, and what the repairs claim


def verdict(name, events, accepted, probability):
    return SimpleNamespace(
        id=name, events=list(range(events)), accepted=list(range(accepted)), probability=probability, before_rad=0.1, tried_rad=0.2
    )


def repaired(verdicts=(), clipping=None, found=None, p_value=None):
    return SimpleNamespace(verdicts=list(verdicts), clipping=clipping, found=found or {}, p_value=p_value or {})


def test_what_was_considered_is_listed_the_most_probable_first():
    clipping = SimpleNamespace(borne_out=False, excess=2.0, numbers=[3, 4, 5])
    verdicts = [verdict("a", 5, 0, 0.4), verdict("b", 5, 2, 0.9), verdict("c", 4, 4, 0.99)]
    found = considered_of(repaired(verdicts, clipping), {"d": 0.2, "e": 0.6})
    assert found == [
        Considered("e", 0.6),
        Considered("a", 0.4, 5, (0.1, 0.2)),
        Considered("d", 0.2),
        Considered("b", 0.0, 3, (0.1, 0.2)),
        Considered("gyro.saturation", 0.0, 3),
    ]
    for other in (SimpleNamespace(borne_out=True, excess=2.0, numbers=[3]), SimpleNamespace(borne_out=False, excess=np.nan, numbers=[3])):
        assert considered_of(repaired([], other), {}) == []
    table = found[1].to_json()
    assert table.pop("closure_rms_deg") == {"before": pytest.approx(0.1 / DEG), "after": pytest.approx(0.2 / DEG)}
    assert table == {"id": "a", "probability": 0.4, "moments": 5}
    assert found[0].to_json() == {"id": "e", "probability": 0.6, "moments": 0, "closure_rms_deg": None}


def test_repairs_claim_what_they_found():
    found = {
        "gyro.saturation": ({"dps": 250.0}, {"dps": 1.0}),
        "data.glitches": ({"samples": [{"row": 1}, {"row": 2}]}, {"samples": None}),
    }
    p_value = {"gyro.saturation": 1e-4, "data.glitches": 1e-5}
    limit, glitches = repair_claims(repaired([verdict("data.glitches", 2, 2, 0.97)], found=found, p_value=p_value))
    assert (limit.p_value, limit.p_is_bound, limit.probability) == (1e-4, True, 0.999)
    assert limit.says == EFFECTS["gyro.saturation"].describe(np.array([250.0 * DEG]))
    assert (glitches.p_value, glitches.p_is_bound, glitches.probability) == (1e-5, False, 0.97)
    assert glitches.says == EFFECTS["data.glitches"].describe(np.array([2.0]))
    assert (limit.parameters, limit.std) == found["gyro.saturation"]
    table = limit.to_json()
    assert (table["p_value"], table["p_value_is_upper_bound"], table["probability"]) == (1e-4, True, 0.999)
    assert "against_stated" not in table


def test_named_effects_have_their_share_of_what_is_beyond_noise():
    theta, covariance = np.array([0.3, -0.2, 0.1]) * DEG, np.diag([1e-8, 2e-8, 3e-8])
    other = AppliedEffect(VIBRATION, np.ones(3) * DEG)
    fit = SimpleNamespace(
        state=SimpleNamespace(claims=[other, AppliedEffect(STEP, theta)]),
        theta_covariance=lambda number: covariance if number == 1 else np.eye(3),
    )
    named = [NamedEffect(STEP, 1e-6, 30.0, 0.95, ("gyro.bias_drift",), {"x": 0.04})]
    for beyond, share in ((120.0, 0.25), (20.0, 1.0), (0.5, 1.0), (0.0, None), (-5.0, None)):
        (claim,) = named_claims(fit, named, beyond)
        assert claim.share == share
    assert named_claims(fit, [replace(named[0], gain=-1.0)], 120.0)[0].share == 0.0
    assert (claim.p_value, claim.probability, claim.p_is_bound) == (1e-6, 0.95, False)
    assert (claim.equivalent, claim.rivals) == (("gyro.bias_drift",), {"x": 0.04})
    assert claim.parameters["dps"] == pytest.approx([0.3, -0.2, 0.1])
    assert claim.std["dps"] == pytest.approx(np.sqrt([1e-8, 2e-8, 3e-8]) / DEG)
    assert claim.says == described(STEP, theta, covariance)
    assert claim.against_stated is None
    own = replace(STEP, stated=StatedNumbers(theta, covariance))
    stated = SimpleNamespace(state=SimpleNamespace(claims=[AppliedEffect(own, theta)]), theta_covariance=lambda number: covariance)
    (claim,) = named_claims(stated, [replace(named[0], effect=own)], 10.0)
    assert claim.says == f"{described(STEP, theta, covariance)}; the numbers agree with those that its file states (p = 1)"
    assert claim.to_json()["against_stated"]["freedom"] == 3


def test_a_delay_of_all_axes_may_be_the_common_part_of_any_lag():
    gravity = TurnGravity(np.zeros(3), 0.012, 0.002, 1.0, 1.0, 0.0045, 24, 0.001)
    (claim,) = offset_claim(gravity)
    assert set(claim.equivalent) == {"gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew"}
    assert claim.parameters == {"seconds": 0.012}
    assert not claim.p_is_bound
    assert claim.says == EFFECTS["timing.gyro_accel_offset"].describe(np.array([0.012]))
    assert offset_claim(replace(gravity, offset_s=0.001)) == []
    # Two turns leave one degree of freedom, as few as there are.
    (few,) = offset_claim(replace(gravity, turns=2, sigma_s=1e-9, offset_s=0.012))
    assert few.p_value == pytest.approx(2 / np.pi * np.arctan(1e-9 / 0.012), rel=1e-6)
