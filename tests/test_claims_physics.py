"""Claims term by term: sizes and sigmas, p-values, what stands for and against, families, and what another recording says of a size."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock, patch

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import chi2, multivariate_normal, t

from session.base.texts import measured, probability, significant
from session.base.units import DEG, EARTH_RATE_RPS
from tinygc.effects import AppliedEffect, Movement, catalogue
from tinygc.effects.effect import StatedNumbers
from tinygc.explanation import data_repair, engine, reported
from tinygc.explanation.checked import (
    OUTCOMES,
    STRONG,
    Checked,
    CheckedEffect,
    _odds_of,
    _of_recording,
    _Prediction,
    _weighed_by,
    headings,
    named_in,
    outcome_of,
    size_of,
)
from tinygc.explanation.claims import (
    AgainstStated,
    Claim,
    Considered,
    _against_stated,
    claim_of,
    described,
    named_claims,
    offset_claim,
    p_entry,
    readable,
)
from tinygc.explanation.data_repair import _claim
from tinygc.explanation.families import SLOW_ZERO, alternatives, slow_zero
from tinygc.explanation.result import MOST_LISTED, rejected_words
from tinygc.explanation.search import NamedEffect
from tinygc.inference.choose import ONE_SIDED, Standing, Statement, agreement, standing_of, upper_limit
from tinygc.inference.decide import KINDS
from tinygc.noise.turn_gravity import NUMBERS, TurnGravity
from tinygc.reporting.checked_text import checked_page
from tinygc.reporting.terminal import Group, as_text
from tinygc.verdict.acceptance import CandidateFit

EFFECTS = catalogue()
STEP, SKEW, VIBRATION = (EFFECTS[name] for name in ("gyro.bias_step", "timing.axis_skew", "gyro.vibration_rectification"))
ASYMMETRY, EARTH, DRIFT = (EFFECTS[name] for name in ("gyro.scale_asymmetry", "earth.rotation", "gyro.bias_drift"))


# Numbers and p-values as text.


def test_a_claim_is_as_uncertain_as_what_it_follows():
    """The energy of vibration is known to a tenth; an axis of an asymmetry follows nothing."""
    theta, covariance = np.array([3.0, -4.0, 0.0]), np.diag([1.0, 4.0, 9.0])
    for effect, more in ((VIBRATION, [0.09, 0.16, 0.0]), (ASYMMETRY, np.zeros(3))):
        claim = claim_of(AppliedEffect(effect, theta), covariance, 0.01)
        assert claim.theta == pytest.approx(theta)
        assert claim.covariance == pytest.approx(covariance + np.diag(more))


@pytest.mark.parametrize("source", ["estimated", "none"])
def test_what_every_report_states_beyond_the_linear_model_is_per_g_and_between_both_senses(source):
    """Twice the half by which a scale differs; without a latitude, the diagonal of the g-sensitivity may be the Earth's vertical rate."""
    k, half = np.arange(1.0, 10.0) * 1e-3 * DEG, np.array([100e-6, -50e-6, 0.0])
    claims = [AppliedEffect(EFFECTS["gyro.g_sensitivity"], k), AppliedEffect(ASYMMETRY, half)]
    sigma = [np.full(9, 1e-3 * DEG), np.array([20e-6, 30e-6, 1.0])]
    fit = SimpleNamespace(
        state=SimpleNamespace(claims=claims), theta_covariance=lambda number: np.diag(sigma[number] ** 2) / 4, widened=4.0
    )
    twin = SimpleNamespace(start=lambda: SimpleNamespace(claims=()), problem=SimpleNamespace(earth=SimpleNamespace(source=source)))
    with patch.object(reported, "refit", return_value=fit):
        facts = reported.beyond_linear(twin, None)
    assert [fact.name for fact in facts[:2]] == ["g-sensitivity x per g on x", "g-sensitivity x per g on y"]
    assert [fact.value for fact in facts] == pytest.approx([*np.arange(1.0, 10.0) * 1e-3, 200.0, -100.0, 0.0])
    earth = (source == "none") * EARTH_RATE_RPS / DEG / np.sqrt(3) * np.eye(3).ravel()
    assert [fact.sigma for fact in facts] == pytest.approx([*np.hypot(1e-3, earth), 40.0, 60.0, 2e6])
    assert [bool(fact.note) for fact in facts] == [*(earth > 0), False, False, False]
    assert [fact.observed for fact in facts] == [True] * 11 + [False]


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (-0.155034, 0.00628, "-0.1550 ± 0.0063"),
        (9.5, 0.999, "9.5 ± 1.0"),
        (12345.0, 123.0, "12340 ± 120"),
        (1.23456789, None, "1.2346"),
        (1.23456789, 0.0, "1.2346"),
        (1.23456789, np.inf, "1.2346"),
        (np.nan, 1.0, "–"),
        (1.0, None, "1"),
        (1234567.8, None, "1234600"),
        (-0.0000123456, None, "-0.000012346"),
        (1.23456789, 1.2e-7, "1.2346 ± 0.00000012"),
        (-0.0001, 0.02, "0.000 ± 0.020"),
    ],
)
def test_a_number_has_two_digits_of_its_sigma(value, std, text):
    assert measured(value, std) == text


def test_a_number_has_no_exponent_and_five_digits_at_most():
    values = (0.0, 5e-7, 2e-6, -0.25, 12345.0, 123456.0, -0.99996, np.inf)
    assert [significant(value) for value in values] == ["0", "0.000000500", "0.00000200", "-0.250", "12345", "123460", "-1.00", "–"]


def test_a_p_value_that_underflows_is_a_bound():
    assert p_entry("p", 0.02) == {"p": 0.02}
    assert p_entry("p", 0.02, bound=True) == {"p": 0.02, "p_is_upper_bound": True}
    assert p_entry("p", 1e-300) == {"p": 1e-300}
    assert p_entry("p", 0.0) == {"p": 1e-300, "p_is_upper_bound": True}
    texts = [probability(p) for p in (0.0123, 0.001, 0.00099, 1e-99, 1.0)]
    assert [*texts, probability(0.0123, True)] == ["p = 0.012", "p = 0.0010", "p < 0.001", "p < 0.001", "p = 1.0", "p < 0.012"]


# Parameters, their sigmas, and the sentence.


def test_parameters_are_in_their_units_with_what_the_effect_is_known_to():
    """Vibration rectification is known to a tenth of itself besides; a negative variance is none; what all of a skew have in common, whose
    first axis has zero by convention, is in no sigma."""
    theta = np.array([0.2, -0.1, 0.0]) * DEG
    found, values, std = readable(AppliedEffect(VIBRATION, theta), np.diag([(0.01 * DEG) ** 2, (0.002 * DEG) ** 2, -1e-12]))
    assert found is theta
    assert values == {"dps_per_g2": pytest.approx([0.2, -0.1, 0.0])}
    assert std == {"dps_per_g2": pytest.approx([np.hypot(0.01, 0.02), np.hypot(0.002, 0.01), 0.0])}
    skew = np.array([0.0, 0.001, 0.004])
    _, _, std = readable(AppliedEffect(SKEW, skew), np.ones((3, 3)) + np.diag([1.0, 4.0, 9.0]) * 1e-8)
    assert std["seconds"] == pytest.approx(np.sqrt([0.0, 5e-8, 10e-8]))
    assert "z 4.0 ms after the first" in described(SKEW, skew, np.ones((3, 3)) + 1e-8 * np.eye(3))


def test_an_axis_is_said_from_three_sigmas_on_or_as_the_surest():
    theta = np.array([0.1, 0.2, 0.3]) * DEG
    for sigmas, said in (((3.01, 3.01, 2.99), [1, 1, 0]), ((2.5, 2.9, 2.8), [0, 1, 0]), ((9.0, 3.1, 2.9), [1, 1, 0])):
        sigma = theta / sigmas
        assert "0.200 dps on y" in DRIFT.describe(theta * said)
        assert described(DRIFT, theta, np.diag(sigma**2)) == DRIFT.describe(theta * said)
    for name in ("earth.rotation", "gyro.bandwidth"):  # what follows from all parameters in common is left alone
        theta = np.array([0.3, 0.01, -0.8]) * EFFECTS[name].parameter.plausible
        assert described(EFFECTS[name], theta, np.diag((10 * theta) ** 2)) == EFFECTS[name].describe(theta)


# Against what a file states.


def test_numbers_are_held_against_those_that_the_file_states():
    """A scanned shape counts in SI: a step at 12 s here, and stated at 10 ± 1 s, where both recordings err by as much."""
    stated = StatedNumbers(np.array([0.1, 0.0, -0.1]), np.diag([1e-4, 1e-4, 4e-4]))
    theta, covariance = np.array([0.13, 0.02, -0.05]), np.diag([3e-4, 0.0, 0.0])
    found = _against_stated(AppliedEffect(replace(STEP, stated=stated), theta), covariance)
    assert found.chi_square == pytest.approx(0.03**2 / 4e-4 + 0.02**2 / 1e-4 + 0.05**2 / 4e-4)
    assert found.to_json() == {"chi_square": found.chi_square, "freedom": 3, "p_value": pytest.approx(chi2.sf(found.chi_square, 3))}
    assert _against_stated(AppliedEffect(STEP, theta), covariance) is None
    at = replace(STEP, stated=StatedNumbers(np.zeros(3), np.eye(3), (10.0, 1.0)), shape={"at_s": 12.0})
    found = _against_stated(AppliedEffect(at, np.zeros(3)), np.eye(3))
    assert (found.chi_square, found.freedom) == (pytest.approx(2.0), 4)
    minutes = replace(at, shape={"at_s": 0.25}, scan=replace(STEP.scan, si=60.0))
    assert _against_stated(AppliedEffect(minutes, np.zeros(3)), np.eye(3)).chi_square == pytest.approx(5.0**2 / 2)
    bar = chi2.isf(1e-3, 3)
    assert AgainstStated(bar * 0.999, 3).words.startswith("the numbers agree with those that its file states (p = 0.0010)")
    assert "the law as stated is contradicted" in AgainstStated(bar * 1.001, 3).words


# What was considered, what repairs claim, and what is named.


def tried(name, events, accepted, probability):
    events, accepted = list(range(events)), list(range(accepted))
    return SimpleNamespace(id=name, events=events, accepted=accepted, probability=probability, before_rad=0.1, tried_rad=0.2)


def considered(verdicts=(), clipping=None):
    """What a repair with these trials rejects."""
    problem = SimpleNamespace(session=SimpleNamespace(reference=None))
    with (
        patch.object(data_repair, "find_clipping", lambda problem: clipping),
        patch.object(data_repair, "tried_events", lambda problem, clipping, progress: (verdicts, ())),
        patch.object(data_repair, "_with_accepted", lambda problem, verdicts, found: problem),
        patch.object(data_repair, "without_creeping", lambda problem, found: problem),
    ):
        return data_repair.repair(problem).considered


def test_what_repairs_reject_is_considered():
    clipping = SimpleNamespace(confirmed=False, excess=2.0, numbers=[3, 4, 5])
    found = considered([tried("a", 5, 0, 0.4), tried("b", 5, 2, 0.9), tried("c", 4, 4, 0.99)], clipping)
    assert found == [
        Considered("a", 0.4, 5, (0.1, 0.2)),
        Considered("b", 0.0, 3, (0.1, 0.2)),
        Considered("gyro.saturation", 0.0, 3),
    ]
    assert considered([], SimpleNamespace(numbers=[3], confirmed=False, excess=np.nan)) == []
    closure = {"before": pytest.approx(0.1 / DEG), "after": pytest.approx(0.2 / DEG)}
    assert found[0].to_json() == {"id": "a", "probability": 0.4, "moments": 5, "closure_rms_deg": closure}
    assert Considered("e", 0.6).to_json() == {"id": "e", "probability": 0.6, "moments": 0, "closure_rms_deg": None}


def test_repairs_claim_what_they_found():
    limit = _claim("gyro.saturation", 250.0 * DEG, {"dps": 250.0}, {"dps": 1.0}, 1e-4, is_bound=True)
    assert (limit.p_value, limit.p_is_bound, limit.probability) == (1e-4, True, 0.999)
    assert limit.description == EFFECTS["gyro.saturation"].describe(np.array([250.0 * DEG]))
    glitches = _claim("data.glitches", 2, {"at": [1, 2]}, {}, 1e-5, 0.97)
    assert (glitches.p_value, glitches.p_is_bound, glitches.probability) == (1e-5, False, 0.97)
    assert glitches.description == EFFECTS["data.glitches"].describe(np.array([2.0]))
    table = limit.to_json()
    assert (table["p_value"], table["p_value_is_upper_bound"], "against_stated" in table) == (1e-4, True, False)


def test_named_effects_have_their_share_of_what_is_beyond_noise():
    theta, covariance = np.array([0.3, -0.2, 0.1]) * DEG, np.diag([1e-8, 2e-8, 3e-8])
    other = AppliedEffect(VIBRATION, np.ones(3) * DEG)

    def fit(effect):
        state = SimpleNamespace(claims=[other, AppliedEffect(effect, theta)])
        return SimpleNamespace(state=state, theta_covariance=lambda number: covariance if number == 1 else np.eye(3))

    named = NamedEffect(STEP, 1e-6, 30.0, 0.95, ("gyro.bias_drift",), {"x": 0.04})
    for beyond, share in ((120.0, 0.25), (20.0, 1.0), (0.5, 1.0), (0.0, None), (-5.0, None)):
        (claim,) = named_claims(fit(STEP), [named], beyond)
        assert claim.share == share
    assert named_claims(fit(STEP), [replace(named, gain=-1.0)], 120.0)[0].share == 0.0
    assert (claim.p_value, claim.probability, claim.p_is_bound, claim.against_stated) == (1e-6, 0.95, False, None)
    assert (claim.equivalent, claim.rivals) == (("gyro.bias_drift",), {"x": 0.04})
    assert claim.parameters["dps"] == pytest.approx([0.3, -0.2, 0.1])
    assert claim.std["dps"] == pytest.approx(np.sqrt([1e-8, 2e-8, 3e-8]) / DEG)
    assert claim.description == described(STEP, theta, covariance)
    own = replace(STEP, stated=StatedNumbers(theta, covariance))
    (claim,) = named_claims(fit(own), [replace(named, effect=own)], 10.0)
    assert claim.description == f"{described(STEP, theta, covariance)}; the numbers agree with those that its file states (p = 1.0)"
    assert claim.to_json()["against_stated"]["freedom"] == 3


def test_a_delay_of_all_axes_may_be_the_common_part_of_any_lag():
    """Two turns leave one degree of freedom, as few as there are.  Student's likelihood pays for a scale and for the odds of any effect."""
    gravity = TurnGravity(np.zeros(3), 0.012, 0.002, 1.0, 1.0, 0.0045, 24, 0.001)
    (claim,) = offset_claim(gravity)
    assert set(claim.equivalent) == {"gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew"}
    assert (claim.parameters, claim.p_is_bound) == ({"seconds": 0.012}, False)
    assert claim.description == EFFECTS["timing.gyro_accel_offset"].describe(np.array([0.012]))
    assert offset_claim(replace(gravity, offset_s=0.001)) == []
    (unsure,) = offset_claim(replace(gravity, offset_s=0.009))
    freedom = 24 - NUMBERS
    gain = freedom * np.log1p(4.5**2 / freedom)
    assert unsure.probability == pytest.approx(expit((gain - 2 * np.log(10 * 30) - 1) / 2))
    assert unsure.p_value == pytest.approx(2 * t.sf(4.5, freedom))
    (few,) = offset_claim(replace(gravity, turns=2, sigma_s=1e-9, offset_s=0.012))
    assert few.p_value == pytest.approx(2 / np.pi * np.arctan(1e-9 / 0.012), rel=1e-6)


def test_what_a_detector_proposed_is_told_before_names_and_tiny_ones_never():
    names = [Considered(f"gyro.name{number}", 0.4 - 0.05 * number) for number in range(6)]
    tiny = [Considered(f"gyro.tiny{number}", 1e-6) for number in range(20)]
    lost = Considered("timing.dropped_samples", 0.0, 28, (0.5 * DEG, 0.5 * DEG))
    false = Considered("data.glitches", 0.0, 1, (0.5 * DEG, 2 * DEG))
    nothing = SimpleNamespace(refused=[])
    said = rejected_words(SimpleNamespace(considered=[*names, *tiny, lost, false], naming=nothing))
    assert said[:3] == [
        "timing.dropped_samples (moments: 28)",
        "data.glitches (moments: 1)",
        "gyro.name0 (0.4)",
    ]
    assert (len(said), rejected_words(SimpleNamespace(considered=tiny, naming=nothing))) == (MOST_LISTED, [])


# Standings.


@pytest.mark.parametrize(
    ("standing", "known"),
    [
        (Standing.FOR, {"p_value": 0.049}),
        (Standing.UNDECIDED, {"p_value": 0.051}),
        (Standing.AGAINST, {"p_value": 1e-9, "p_claimed": 0.049}),
        (Standing.UNDECIDED, {"p_value": 0.9, "p_claimed": 0.051}),
        (Standing.BOUNDED, {"p_value": 0.5, "upper": 0.0499, "matters": 0.05}),
        (Standing.UNDECIDED, {"p_value": 0.5, "upper": 0.05, "matters": 0.05}),
        (Standing.FOR, {"p_value": 0.01, "upper": 0.01, "matters": 0.05}),  # small, and there
    ],
)
def test_absence_is_stated_only_as_a_bound(standing, known):
    assert standing_of(**known) is standing
    assert upper_limit(-2.0, 0.5) == upper_limit(2.0, 0.5) == pytest.approx(2 + 1.6449 * 0.5, abs=1e-4)
    said = {
        Standing.FOR: "common part: 0.01 ± 0.02° (chi-square, p = 0.20)",
        Standing.AGAINST: "common part: 0.01 ± 0.02°, not 0.1° (chi-square, p = 0.20)",
        Standing.BOUNDED: "common part: below 0.04° with 95 % (chi-square, p = 0.20)",
        Standing.UNDECIDED: "common part: undecided; 0.01 ± 0.02°; more than 0.04° is excluded with 95 % (chi-square, p = 0.20)",
    }
    assert Statement("common part", standing, "chi-square", 0.2, "0.01 ± 0.02°", "0.04°", "0.1°").words == said[standing]


def test_equal_sizes_are_pooled_and_tested_by_cochrans_chi_square():
    """By rows of a least-squares problem."""
    rng = np.random.default_rng(5)
    roots, values = rng.normal(size=(3, 2, 2)), rng.normal(size=(3, 2))
    rows = np.concatenate([np.linalg.inv(root) for root in roots])
    whitened = np.concatenate([np.linalg.solve(root, value) for root, value in zip(roots, values, strict=True)])
    expected, left, *_ = np.linalg.lstsq(rows, whitened, rcond=None)
    found = agreement(values, roots @ roots.transpose(0, 2, 1))
    np.testing.assert_allclose(found.pooled, expected)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(rows.T @ rows))
    assert (found.chi_square, found.freedom, found.p_value) == pytest.approx((left[0], 4, chi2.sf(left[0], 4)))
    assert agreement(np.array([[7.0]]), np.array([[[1.0]]])).p_value == 1.0


# Slow motions of the zero-rate offset.


def twin_of(thermometer=False, seconds=100):
    t = np.arange(0.0, seconds, 1.0)
    temp = np.linspace(25, 30, len(t)) if thermometer else np.full(len(t), np.nan)
    zero = np.zeros((len(t), 3))
    movements = [Movement(t, 1.0, zero, zero, temp, np.zeros(len(t)), seconds, 1.0, 25.0)]
    return SimpleNamespace(movements=movements, has_thermometer=bool(np.isfinite(temp).all()))


def drift(probability, name="gyro.bias_drift", dps=(0.05, -0.2, 0.1), **rivals):
    ids = {"warm": "unknown.warm_up", "step": "gyro.bias_step", "asymmetry": "gyro.scale_asymmetry"}
    effect = EFFECTS[name]
    weighed = {ids[key]: p for key, p in rivals.items()}
    return Claim(effect, {}, {}, 1e-6, "says", probability=probability, rivals=weighed, theta=np.array(dps) * DEG)


def test_a_familys_size_is_from_lowest_to_highest_and_its_members_share_its_probability():
    """The last sample is a hundredth before the end; a step goes from -0.098 just before the jump to 0.2 just after it."""
    found = slow_zero(twin_of(), [drift(0.6, warm=0.2, asymmetry=0.2)])
    assert (found.size_rps, found.axis) == (pytest.approx(0.2 * DEG * 0.99), 1)
    assert list(found.shares.items()) == [("gyro.bias_drift", pytest.approx(0.75)), ("unknown.warm_up", pytest.approx(0.25))]
    assert "moves by 0.20 dps on y over the session, most likely a steady drift or slow warm-up (0.75 among those weighed)" in found.words
    assert found.words.endswith("a warm-up within the session (0.25); temperature was not recorded")
    both = slow_zero(twin_of(), [drift(0.9), drift(0.9, "gyro.bias_step", (0.0, 0.3, 0.0))])
    assert both.size_rps == pytest.approx(0.298 * DEG)
    assert slow_zero(twin_of(), [drift(1.0, "gyro.scale_asymmetry", step=0.1)]) is None
    assert found.to_json() == {"id": "slow_zero", "size_dps": pytest.approx(0.198), "shares": found.shares, "description": found.words}


def test_a_thermometer_closes_the_question_where_one_member_has_nearly_all():
    for thermometer, chance, is_open in ((True, 0.95, False), (True, 0.94, True), (False, 0.95, True)):
        found = slow_zero(twin_of(thermometer), [drift(chance, warm=1 - chance)])
        assert found.is_open == is_open
        assert found.words.endswith("temperature was not recorded") != thermometer
    warm, step, rest = "unknown.warm_up", "gyro.bias_step", "gyro.bias_drift"
    assert alternatives({warm: 0.95, step: 0.05}, True) == "as a warm-up within the session (0.95)"
    assert alternatives({warm: 0.94, step: 0.06}, True) == "most likely a warm-up within the session (0.94), or a jump (0.06)"
    assert alternatives({warm: 0.94, step: 0.04, rest: 0.02}, True) == "most likely a warm-up within the session (0.94)"
    for name in SLOW_ZERO.keys() & EFFECTS.keys():
        assert "temperature" in EFFECTS[name].inputs or "temperature" not in EFFECTS[name].describe(np.ones(3))


# On another recording.

THETA = np.array([3e-3, -1e-3, 2e-3])
COVARIANCE = 1e-8 * np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]])


def sized(effect, theta, covariance):
    return Claim(effect, {}, {}, 0.01, "says", probability=0.99, theta=theta, covariance=covariance)


NAMED = sized(ASYMMETRY, THETA, COVARIANCE)


def test_what_a_clock_is_off_by_is_as_measured_and_a_shape_without_a_name_is_no_name():
    """A fit may hold what is left of a clock alone; of one that is not known it says nothing."""
    clock = sized(EFFECTS["timing.gyro_accel_offset"], np.array([1e-4]), np.array([[1e-9]]))
    claimed = [clock, replace(NAMED, effect=replace(ASYMMETRY, id="unknown.bias")), NAMED]
    for known, theta, variance in ((None, 1e-4, 1e-9), ((np.array([2e-3]), np.array([[4e-8]])), 2e-3, 4e-8)):
        found, other = named_in(SimpleNamespace(claimed=claimed, measured={clock.effect.id: known}))
        assert (found.effect, found.theta.item(), found.covariance.item()) == (clock.effect, theta, variance)
        assert (other.effect, other.theta, other.covariance) == (ASYMMETRY, THETA, COVARIANCE)


def there(share, wider=1.0):
    return sized(ASYMMETRY, share * THETA, wider * COVARIANCE)


def test_an_effect_is_predicted_with_the_uncertainty_of_its_numbers_whose_covariance_may_lack_a_direction():
    """What the noise is estimated from: the residuals that the columns leave, and a covariance J J' + own C own'."""
    rng = np.random.default_rng(8)
    r, J, own, theta, half = (rng.normal(size=shape) for shape in (6, (6, 2), (6, 3), 3, (3, 2)))
    noise = SimpleNamespace(s=None, estimated=lambda whiten, r, J, s: SimpleNamespace(value=np.column_stack([r, J @ J.T])))
    whiten = MagicMock(side_effect=lambda rows: rows)
    prediction = _Prediction(SimpleNamespace(noise=noise, whiten=whiten), r, J, own, None, 7.0)
    for given, moved, covariance in (((), r, J @ J.T), ((theta, half @ half.T), r + own @ theta, J @ J.T + own @ half @ half.T @ own.T)):
        left = np.linalg.solve(np.eye(6) + covariance, moved)  # of columns with a prior of one sigma
        np.testing.assert_allclose(prediction.value(*given) - 7.0, np.column_stack([left, covariance]), atol=1e-7)


def test_odds_and_size_there_are_those_of_the_two_normal_densities():
    estimates, covariance = np.array([[2e-3, -1e-3, 1e-3], [0.0, 1e-4, 0.0]]), 2 * COVARIANCE
    normal = multivariate_normal.logpdf
    expected = [2 * (normal(x, THETA, covariance + COVARIANCE) - normal(x, np.zeros(3), covariance)) for x in estimates]
    assert _odds_of(estimates, NAMED, covariance) == pytest.approx(expected, rel=1e-9)
    share, sigma = size_of(NAMED, there(0.7, 3))
    assert (share, sigma) == pytest.approx((0.7, 1 / np.sqrt(THETA @ np.linalg.solve(4 * COVARIANCE, THETA))))
    apart = np.array([1e-4, 0, 2e-4])
    found = _weighed_by(NAMED, replace(there(1.0), theta=THETA + apart), 0)
    assert found.same_p == pytest.approx(chi2.sf(apart @ np.linalg.solve(2 * COVARIANCE, apart), 3))
    named = replace(NAMED, theta=0.06 * THETA)
    drawn = np.random.default_rng(7).multivariate_normal(named.theta, 1.5 * COVARIANCE, 4000)
    seen = np.mean(_odds_of(drawn, named, 0.5 * COVARIANCE) >= STRONG)
    assert 0.1 < seen < 0.9
    assert _weighed_by(named, there(0.06, 0.5), 1).power == pytest.approx(seen, abs=0.053)  # three sigmas of both draws


@pytest.mark.parametrize(
    ("named", "seen", "odds", "outcome", "standing"),
    [
        (NAMED, there(0.8), None, "confirmed", Standing.FOR),
        (NAMED, there(0.35), None, "another size", Standing.FOR),  # nearer to none than to the named size, and there
        (NAMED, there(-0.35), None, "contradicted", Standing.AGAINST),
        (NAMED, there(0.0), None, "contradicted", Standing.AGAINST),
        (NAMED, there(0.0, 1e4), None, "no power", Standing.UNDECIDED),
        (NAMED, there(1.0), STRONG, "confirmed", Standing.FOR),
        (NAMED, there(1.0), STRONG - 1e-6, "not confirmed", Standing.UNDECIDED),
        (NAMED, there(0.0), -STRONG, "contradicted", Standing.AGAINST),
        (NAMED, there(0.0), -STRONG + 1e-6, "not confirmed", Standing.UNDECIDED),
        # A name with a wide sigma is worth less than none, and is not wrong for that.
        (replace(NAMED, theta=0.5 * THETA, covariance=1e6 * COVARIANCE), there(0.0), None, "not confirmed", Standing.UNDECIDED),
    ],
)
def test_odds_of_twenty_to_one_decide(named, seen, odds, outcome, standing):
    assert pytest.approx(2 * np.log(20)) == STRONG
    found = _weighed_by(named, seen, 0, odds)
    assert (found.outcome, found.standing) == (outcome, standing)
    share, sigma = found.size
    assert found.other_size == (standing is Standing.FOR and found.same_p < 0.05)
    assert (outcome == "another size") == (odds is None and found.odds < STRONG and share > ONE_SIDED * sigma)


def test_the_earths_rate_is_turned_about_the_vertical_with_its_uncertainty():
    rate = EARTH_RATE_RPS * np.array([0.6, 0.0, -0.8])
    turned = headings(sized(EARTH, rate, EARTH_RATE_RPS**2 * np.diag([0.04, 0.01, 0.09])))
    assert len(turned) == 72
    assert turned[18].theta == pytest.approx(EARTH_RATE_RPS * np.array([0.0, 0.6, -0.8]), abs=1e-12)
    assert np.diag(turned[18].covariance) == pytest.approx(EARTH_RATE_RPS**2 * np.array([0.01, 0.04, 0.09]))


def test_what_belongs_to_one_recording_or_unit_is_not_taken_to_another_and_a_contradiction_anywhere_counts():
    of_one = ("gyro.bias_drift", "gyro.bias_step", "data.glitches", "timing.dropped_samples", "reference.not_still", "motion.undersampled")
    assert all(_of_recording(EFFECTS[name]) for name in (*of_one, "accelerometer.zero_drift"))
    lasting = ("gyro.g_sensitivity", "gyro.bandwidth", "gyro.thermal_bias", "earth.rotation", "timing.gyro_accel_offset")
    assert not any(_of_recording(EFFECTS[name]) for name in lasting)
    of = lambda *outcomes: outcome_of([CheckedEffect(NAMED, each) for each in outcomes])  # noqa: E731
    assert of("confirmed", "contradicted") == "contradicted"
    assert of("no power", "confirmed", "not confirmed") == "confirmed"
    assert set(OUTCOMES) <= KINDS.keys()
    assert "no effect to check" in as_text(Group(*checked_page([Checked(None, True)])))


def test_a_number_that_no_segment_observes_has_none_beside_physics_either():
    """The linear model's observed parameters are those of the fit with effects, on the same turns."""
    asymmetry = AppliedEffect(ASYMMETRY, np.zeros(3))
    judged = CandidateFit(np.zeros((2, 2)), [1, 2], np.r_[np.eye(3).ravel(), np.zeros(6)], 1.0, 0.5, None, [], [], [])
    judged = replace(judged, covariance=1e-8 * np.eye(15), unobserved=("E_xx",))
    proof = SimpleNamespace(
        before=np.ones((2, 2)), after=np.zeros((2, 2)), after_numbers=[1, 2], fit=SimpleNamespace(state=SimpleNamespace(claims=[asymmetry]))
    )
    fit = SimpleNamespace(runs=[], candidate_of=lambda *given: judged)
    with patch.multiple(reported, conditions=MagicMock(), model_at=MagicMock()):
        adopted = reported.adopt(fit, MagicMock(proof=proof))
    assert (adopted.name, adopted.claims) == (reported.PHYSICS, (asymmetry,))
    assert [fact.name for fact in adopted.quantities if not fact.observed] == ["scale factor error x"]


# The verdict


@pytest.mark.parametrize(
    ("failed", "unsound", "against", "expected"),
    [
        ([], [], [], "no_mismatch"),
        (["above a limit"], [], [], "no_mismatch"),
        (["worse than the raw rates"], ["worse than the raw rates"], [], "unexplained"),
        ([], ["left open"], [], "no_mismatch"),
        (["above a limit"], ["left open"], [], "no_mismatch"),
        ([], ["differs"], ["turns"], "unexplained"),
    ],
)
def test_what_fit_fails_for_but_a_limit_is_a_mismatch(failed, unsound, against, expected):
    decision = SimpleNamespace(reasons=[(True, "met"), (None, "left open"), *((False, text) for text in failed)], unsound=unsound)
    assert engine._verdict(SimpleNamespace(decision=decision, contradictions=against, claimed=[], findings=[])) == expected
