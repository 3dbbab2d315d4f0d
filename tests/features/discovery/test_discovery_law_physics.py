"""Forms of the grammar: units, columns, bits, words, laws of physics among them; the file and the C of a law; what is not observed."""

import re
from dataclasses import replace

import numpy as np
import pytest
from discovery_answers import LAWS, law_of, some_movement
from numpy.testing import assert_allclose

from session.base.units import DEG
from tinygc.effects import StageC, load_folder, signals, using, without_vibration
from tinygc.effects.catalogue import short_movement
from tinygc.effects.testing import check
from tinygc.features.discovery import engine
from tinygc.features.discovery.effect_file import FULL_SCALE, Where, written
from tinygc.features.discovery.engine import MOST_LACKING, not_observed, observed, share_lacking
from tinygc.features.discovery.enumeration import bits, enumerated
from tinygc.features.discovery.form import PATTERNS, Factor, LawForm
from tinygc.features.discovery.law_effect import as_effect, columns_of, device_of
from tinygc.features.discovery.quantities import largest_of
from tinygc.features.discovery.words import (
    LONGEST,
    combination,
    equation,
    in_words,
    regime,
    splits,
    what,
)
from tinygc.noise.twin import READ

RATE = Factor("rate")


@pytest.fixture(scope="module")
def movement():
    return some_movement(6)


# Units.


@pytest.mark.parametrize(
    ("form", "unit"),
    [
        (LawForm((Factor("force"), Factor("temperature"))), "dps/(g·°C)"),
        (LawForm((Factor("temperature_rate"),)), "dps·s/°C"),
        (LawForm((Factor("rest", "root"), Factor("sense"))), "dps/√s"),
        (LawForm((Factor("rest", "decay", 3.0), Factor("sense"))), "dps"),
        (LawForm((Factor("jerk"), Factor("vibration"))), "dps·s²/g²"),
        (LawForm((Factor("turned", "root_cube"),)), "dps/rad^1.5"),
    ],
)
def test_a_coefficient_has_the_unit_that_its_factors_leave(form, unit):
    assert form.coefficient_unit == unit


# Columns.


def _expected(form, movement):
    """(N, 3, P), pattern by pattern, beside ``terms``."""
    values = [factor.values(movement).reshape(len(movement.rate), 3 if factor.vector else 1, factor.each) for factor in form.factors]
    values = [np.broadcast_to(value, (len(value), 3, value.shape[2])) for value in values]

    def product(axes):
        found = np.ones((len(movement.rate), 1))
        for value, axis in zip(values, axes, strict=True):
            found = (found[:, :, None] * value[:, axis][:, None, :]).reshape(len(found), -1)
        return found

    blocks, n = [], len(form.factors)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        axes = {
            "each": [[i] * n],
            "full": [[a] * n for a in range(3)],
            "cross": [[j] * n, [k] * n],
            "next": [[j, k][:n]],
            "last": [[k, j][:n]],
            "leant": [[i, a][:n] for a in range(3)],
        }[form.pattern]
        blocks.append(np.concatenate([product(each) for each in axes], axis=1))
    return np.stack([np.concatenate([block * (axis == own) for own, block in enumerate(blocks)], axis=1) for axis in range(3)], axis=1)


def test_columns_are_those_of_the_pattern_and_their_sum_is_the_effect(movement):
    arrays = ("t_s", "rate", "force_g", "temp_c", "vibration_g2")
    movement = replace(movement, **{name: getattr(movement, name)[:600] for name in arrays})
    level, wave, late = Factor("level"), Factor("time", "wave", 7.0), Factor("rate", "size", None, 0.5)
    forms = [LawForm((Factor("rate", "cube"), Factor("force")), pattern) for pattern in PATTERNS]
    forms += [LawForm((level,), "full"), LawForm((late, wave)), LawForm((late, Factor("temperature")), "cross"), LawForm((wave,))]
    forms += [
        LawForm((Factor("rate", "play", 0.1),), "full"),
        LawForm((Factor("world"),)),
        LawForm((Factor("jerk"), Factor("vibration", "root"))),
    ]
    for form in forms:
        columns = _expected(form, movement)
        assert_allclose(columns_of(form, movement), columns, rtol=1e-12, atol=1e-15)
        effect, theta = as_effect(form), np.random.default_rng(2).standard_normal(form.size)
        assert_allclose(effect.distort(movement, theta), movement.rate + columns @ theta, atol=1e-11)
        assert effect.parameter.unit == form.coefficient_unit


# All forms, each once.


def test_forms_have_bits_of_a_code_and_names_and_words_of_their_own(movement):
    some = {"force", "temperature", "sense", "rest"}
    forms = enumerated({name: size if name in some else 0.0 for name, size in largest_of([movement]).items()})
    assert len(set(forms)) == len(forms) > 1000
    assert {factor.quantity for form in forms for factor in form.factors} == some
    assert np.sum(2.0 ** -np.array([bits(form) for form in forms])) < 1
    plain, product = LawForm((Factor("rate", "square"),)), LawForm((Factor("rate", "square"), Factor("vibration", "root")))
    late = LawForm((Factor("rate", "square", None, 5.0),))
    assert bits(LawForm((Factor("force"),))) < bits(plain) < bits(late) < bits(product)
    assert bits(late) == bits(late.with_constants((7.0,)))
    shapes = {form.shape: form for form in forms}
    assert {PHYSICS[law][1].shape for law in ("remnant of the last turn", "hysteresis")} < set(shapes)
    names = {what(form) for form in shapes}
    assert len(names) == len(shapes)
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", name) and len(name) <= LONGEST for name in names)
    for form in shapes.values():
        said, sentence = equation(form), in_words(form)
        assert said.startswith("ω_i += ")
        assert not re.search(r"[{}\n]|None|nan", said + sentence)
        assert re.fullmatch(r"The error of e.*\.", sentence)
        assert splits(form)
        variable, unit = regime(form)
        assert READ[variable][1] == unit


def test_what_is_equal_by_algebra_is_one_form(movement):
    """The forms of a kind have the same columns, but for their order; those of two kinds have not."""
    force = Factor("force")
    kinds = [
        [(("rate", "square"),), (("rate", "size"), ("rate", "size")), (("rate", "signed_square"), ("rate", "sign"))],
        [(("rate", "cube"),), (("rate", "square"), "rate"), (("rate", "sign"), ("rate", "size_cube"))],
        [(("rate_size", "root_cube"),), (("rate_size", "root"), "rate_size")],
        [(("rate", "root"),), (("rate", "signed_root"), ("rate", "sign"))],
    ]
    found = [[LawForm(tuple(Factor(*np.atleast_1d(each)) for each in form)) for form in kind] for kind in kinds]
    found.append([LawForm((force, RATE), "next"), LawForm((RATE, force), "last")])
    found += [[LawForm((force, RATE), "last")], [LawForm((force, RATE), "leant")], [LawForm((RATE, force), "leant")]]
    found += [[LawForm((Factor("force", "sign", None, lag_s), Factor("force", "sign")))] for lag_s in (0.5, 1.5)]
    assert [len({form.canonical for form in kind}) for kind in found] == [1] * len(found)
    assert len({kind[0].canonical for kind in found}) == len(found)
    for first, *others in found:
        for other in others:
            assert_allclose(columns_of(other, movement), columns_of(first, movement), atol=1e-12)


def test_what_a_calibration_spans_is_no_form(movement):
    some = {name: size if name in ("rate", "sense", "temperature") else 0.0 for name, size in largest_of([movement]).items()}
    forms = enumerated(some)
    for factors in ((RATE,), (Factor("sense"),) * 2):
        assert not {LawForm(factors, pattern) for pattern in ("each", "full")} & set(forms)
    assert LawForm((RATE, Factor("temperature"))) in forms
    assert not [form for form in forms if form.factors[0] == RATE and form.factors[-1].function == "above_point"]
    assert len({form.canonical for form in forms}) == len(forms)


_turning = signals.moving_rate


def _force(m):
    return without_vibration(m.force_g, m.dt_s)


C = np.array([1.2, -0.7, 0.9])
TURNED = Factor("turned", "wave", 2 * np.pi / 3)
#: the law on paper of a movement m, and its form
PHYSICS = {
    "rectification": (
        lambda m: C * np.roll(_turning(m), -1, axis=1) * np.roll(_turning(m), 1, axis=1),
        LawForm((RATE, RATE), "next"),
    ),
    "scale factor": (lambda m: _turning(m) * (_force(m) @ np.outer(C, [1, -2, 3])), LawForm((RATE, Factor("force")), "leant")),
    "remnant of the last turn": (
        lambda m: C * signals.last_sense(m) * np.exp(-signals.seconds_at_rest(m) / 2.2)[:, None],
        LawForm((Factor("rest", "decay", 2.2), Factor("sense"))),
    ),
    "heat of turning": (
        lambda m: signals.lagged(np.sum(_turning(m) ** 2, axis=1), 24.0, m.t_s)[:, None] * C,
        LawForm((Factor("rate_size", "square", None, 24.0),)),
    ),
    "hysteresis": (lambda m: signals.play(m.temp_c - m.first_temp_c, 2.7)[:, None] * C, LawForm((Factor("temperature", "play", 2.7),))),
    "periodic load": (lambda m: np.sin(2 * np.pi * m.t_s / 7.3 + 0.4)[:, None] * C, LawForm((Factor("time", "wave", 7.3),))),
    "ripple of a driven table": (lambda m: C * np.cos(3 * signals.angle_turned(m) - 0.6), LawForm((TURNED,))),
}


@pytest.mark.parametrize("name", PHYSICS)
def test_a_law_of_physics_is_a_form(name, movement):
    """What it adds is its form's columns times some coefficients, to rounding."""
    law, form = PHYSICS[name]
    columns = columns_of(form, movement)
    columns, added = columns.reshape(-1, columns.shape[2]), law(movement).ravel()
    theta = np.linalg.lstsq(columns, added)[0]
    assert_allclose(columns @ theta, added, atol=1e-12 * np.abs(added).max())


# Words.


# What is written of a law.


def loaded(folder, form, dps, **where):
    """The effect of a law's file."""
    (folder / "law.py").write_text(written(law_of(form, dps), Where("here", **where)), encoding="utf-8")
    with using([]):
        return load_folder(folder)[0]


@pytest.mark.parametrize(
    "form",
    [
        LawForm((Factor("rate", "excess", 0.3), Factor("temperature", "dead_zone", 2.0))),
        LawForm((Factor("rate", "within", 0.2), Factor("rate", "dead_zone", 0.1)), "leant"),
    ],
)
def test_a_law_of_sums_and_products_has_c_that_does_what_the_law_says(form, tmp_path):
    """The C is its NumPy bit for bit, and in single precision what the effect corrects."""
    effect = loaded(tmp_path, form, np.random.default_rng(3).uniform(0.3, 1.0, form.size))
    assert isinstance(effect.device, StageC)
    report = check(effect, parts=("c",), value=None if effect.scan is None else 0.15)
    assert report.ok, str(report)


@pytest.mark.parametrize(
    ("form", "why"),
    [
        (LawForm((Factor("force"), Factor("rate"))), "samples belong that are yet to come"),
        (LawForm((Factor("rate", "beyond", 0.1),)), "a reading may belong to two rates"),
        (LawForm((Factor("rate", "root"),)), "last bits differ"),
        (LawForm((Factor("temperature", "itself", None, 2.0),)), "lag"),
        (LawForm((Factor("sense"),)), "from the beginning"),
    ],
)
def test_a_law_without_c_says_why(form, why):
    assert why in device_of(form, "law", 5).why


@pytest.mark.parametrize("name", ["dead zone", "warm rate"])
def test_a_written_law_adds_the_same_in_a_session_of_another_full_scale_that_begins_warmer(name, tmp_path):
    """Full scale and first temperature are those of the session where it was found, in every session."""
    form, dps = LAWS[name]
    effect = loaded(tmp_path, form, dps, full_scale_dps=500.0, first_temp_c=25.0)
    here = short_movement()
    there = replace(here, fs_rps=2 * here.fs_rps, first_temp_c=here.first_temp_c + 11)
    theta = np.array(dps) * DEG
    added = effect.distort(here, theta) - here.rate
    assert np.abs(added).max() > 1e-4
    assert_allclose(effect.distort(there, theta) - there.rate, added, atol=1e-15)
    assert_allclose(as_effect(form).distort(here, theta) - here.rate, added, atol=1e-12)
    assert np.abs(as_effect(form).distort(there, theta) - there.rate - added).max() > 1e-5
    assert ("T₀ = 25 °C" if "warm" in name else "ω / (500 dps)") in effect.equation


# What a recording does not observe of a law.


#: the size of the rate times the force: the same for all axes it turns the body about the vertical alone
UPRIGHT = LawForm((Factor("rate_size"), Factor("force")), "full")


TURN = np.eye(3).ravel() / np.sqrt(3)


LEAN = np.array([1.0, -1.0, 0.0])


def covariance(direction, sigma, else_sigma=0.01):
    """Of coefficients, wide along one direction."""
    along = np.outer(direction, direction)
    return else_sigma**2 * (np.eye(len(direction)) - along) + sigma**2 * along


BAR = engine.SIGNIFICANT**0.5


@pytest.mark.parametrize(
    ("spread", "sigmas", "open_"),
    [(0.99 * engine.OPEN, 0.0, 0), (1.01 * engine.OPEN, 0.0, 1), (2.0, 0.99 * BAR, 1), (2.0, 1.01 * BAR, 0)],
)
def test_a_combination_known_to_worse_than_half_of_the_law_is_not_observed_unless_it_is_significant(spread, sigmas, open_):
    direction, sigma = np.ones(3) / np.sqrt(3), spread * (np.sqrt(np.mean(LEAN**2)) if spread < 1 else 1.0)
    assert len(not_observed(LEAN + sigmas * sigma * direction, covariance(direction, sigma))) == open_


def test_what_is_not_observed_is_found_and_set_to_zero():
    theta = np.outer([1.0, -0.8, 0.9], [0, 0, 1.0]).ravel()
    seen = theta - TURN * (TURN @ theta)
    stated = seen + 0.8 * TURN  # and sigma 0.5: a draw
    (found,) = directions = not_observed(stated, covariance(TURN, 0.5))
    assert abs(found @ TURN) == pytest.approx(1)
    assert observed(directions) @ stated == pytest.approx(seen)
    assert combination(UPRIGHT, -TURN) == "0.58 (x ← x) + 0.58 (y ← y) + 0.58 (z ← z)"


def test_the_last_combination_stays_whatever_is_known_of_it():
    assert len(not_observed(np.array([0.1, 0.1, 0.1]), np.diag([4.0, 5.0, 6.0]))) == 2


def test_a_file_does_not_apply_what_was_not_observed_and_holds_the_numbers_that_another_recording_must_agree_with(tmp_path):
    theta = np.outer([1.0, -0.8, 0.9], [0, 0, 1.0]).ravel()
    law = law_of(UPRIGHT, theta - TURN * (TURN @ theta), unobserved=TURN[None], covariance=1e-8 * np.diag(np.arange(1.0, 10.0)))
    (tmp_path / "turned.py").write_text(written(law, Where("here", full_scale_dps=500.0)), encoding="utf-8")
    with using([]):
        effect = load_folder(tmp_path)[0]
    movement = effect.shown(some_movement(3))
    columns = effect.columns(movement)
    assert np.abs(columns @ TURN).max() < 1e-3 * np.abs(columns).max()
    whole = as_effect(UPRIGHT).columns(some_movement(3)) @ law.theta
    assert_allclose(columns @ law.theta, whole * FULL_SCALE / movement.fs_rps, atol=1e-3 * np.abs(whole).max())
    assert effect.partly_observed
    assert effect.gauge_convention.settle(TURN) == pytest.approx(0, abs=1e-3)
    assert "not observed" in effect.device.why
    assert effect.stated.theta == pytest.approx(law.theta, rel=1e-5)
    assert effect.stated.covariance == pytest.approx(law.covariance, rel=1e-5, abs=1e-20)
    assert effect.stated.against(law.theta, law.covariance)[0] == pytest.approx(0, abs=1e-3)
    away = law.theta + 20 * np.sqrt(law.covariance[0, 0]) * np.eye(9)[1]
    assert effect.stated.against(away, law.covariance)[0] == pytest.approx(20**2 / 4, rel=1e-3)


def test_numbers_and_thresholds_must_be_known_well_enough_for_the_stated_rate():
    """One number for each axis, known to a share: the rate of a draw lacks the mean square of that share; coefficients may follow it."""
    form, theta, at = LawForm((Factor("rate", "square"),)), np.array([1.0, -1.0, 1.0]), (np.eye(3), [some_movement(3)])
    lacks = [share_lacking(form, theta, sigma**2 * np.eye(3), None, *at) > MOST_LACKING for sigma in (0.05, 0.4)]
    assert lacks == [False, True]
    form = LawForm((Factor("rate", "signed_beyond", 0.2),))
    sharp, wide, follows = (np.array([[size**2]]) for size in (0.001, 0.5, 0.1))
    assert share_lacking(form, theta, 1e-8 * np.eye(3), (sharp, np.zeros((3, 1))), *at) == 0
    assert share_lacking(form, theta, 1e-8 * np.eye(3), (wide, np.zeros((3, 1))), *at) > 0.5
    assert share_lacking(form, theta, 1e-8 * np.eye(3), (follows, np.full((3, 1), 50.0)), *at) > 0.5
