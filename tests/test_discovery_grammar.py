"""The grammar of errors: units, every form once, bits, words, and laws of physics that are forms of it."""

import re

import numpy as np
import pytest

from tinygc.discovery.grammar.as_effect import as_effect, columns_of
from tinygc.discovery.grammar.bits import bits
from tinygc.discovery.grammar.enumeration import enumerated
from tinygc.discovery.grammar.form import PATTERNS, Factor, Form
from tinygc.discovery.grammar.functions import FUNCTIONS
from tinygc.discovery.grammar.grids import constant_at, places
from tinygc.discovery.grammar.largest import largest_of
from tinygc.discovery.grammar.quantities import QUANTITIES
from tinygc.discovery.grammar.same import projections, told_apart
from tinygc.discovery.grammar.some_movement import some_movement
from tinygc.discovery.grammar.units import UnitError, text_of, unit_of
from tinygc.discovery.grammar.vocabulary import offered
from tinygc.discovery.grammar.words import LONGEST, equation, in_words, regime, splits, what
from tinygc.effects import signals, without_vibration
from tinygc.explanation.twin.variable import READ

FRESH = 6
#: of the added rate, beside what a calibration holds: what the issue asks of a law that is found
ENOUGH = 0.99


@pytest.fixture(scope="module")
def movement():
    return some_movement(FRESH)


@pytest.fixture(scope="module")
def forms(movement):
    return enumerated(largest_of([movement]))


# Units


@pytest.mark.parametrize(
    ("form", "unit"),
    [
        (Form((Factor("force"), Factor("temperature"))), "dps/(g·°C)"),
        (Form((Factor("temperature_rate"),)), "dps·s/°C"),
        (Form((Factor("force", "square"),), "full"), "dps/g²"),
        (Form((Factor("rest", "root"), Factor("sense"))), "dps/√s"),
        (Form((Factor("rest", "decay", 3.0), Factor("sense"))), "dps"),
        (Form((Factor("jerk"), Factor("vibration"))), "dps·s²/g²"),
        (Form((Factor("vibration", "root"), Factor("rate"))), "dps/g"),
        (Form((Factor("turned", "root_cube"),)), "dps/rad^1.5"),
    ],
)
def test_a_coefficient_has_the_unit_that_its_factors_leave(form, unit):
    assert form.coefficient_unit == unit


def test_units_of_text_and_back():
    assert unit_of("°C/s") == {"°C": 1, "s": -1}
    assert text_of(unit_of("°C/s"), "dps") == "dps·s/°C"
    with pytest.raises(UnitError, match="no unit of a quantity"):
        unit_of("furlong")


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (lambda: Factor("temperature_rate", "decay"), "no proper unit without its scale, a positive number of °C/s"),
        (lambda: Factor("rate", "beyond", -0.1), "without its threshold"),
        (lambda: Factor("rate", "square", 2.0), "takes no constant"),
        (lambda: Factor("rate", lag_s=0.0), "positive number of seconds"),
        (lambda: Factor("colour"), "'colour' is no quantity"),
        (lambda: Factor("rate", "sinh"), "'sinh' is no function"),
        (lambda: Factor.measured("rest", "decay", 20.0, "g"), "rest is in s: decay takes a scale in that unit, got 20.0 g"),
    ],
)
def test_what_has_no_proper_unit_cannot_be_built(made, says):
    with pytest.raises(UnitError, match=re.escape(says)):
        made()


def test_a_pattern_that_the_factors_cannot_have_is_refused():
    with pytest.raises(ValueError, match=r"vibration \(scalar\) has no pattern 'full'"):
        Form((Factor("vibration"),), "full")
    with pytest.raises(ValueError, match="has no pattern 'next'"):
        Form((Factor("rate"), Factor("vibration")), "next")
    assert Factor.measured("temperature", "beyond", 5.0, "°C").constant == 5.0


# Each form once


def test_forms_are_many_and_none_is_another_on_any_movement(movement, forms):
    assert 10_000 <= len(forms) <= 100_000
    assert len(set(forms)) == len(forms)
    # On a movement that the enumeration has not seen.  A short one may miss what another would show, never the other way round.
    assert len(told_apart(forms, movement)) == len(forms)


def test_identities_are_one_form(movement):
    same = [
        Form((Factor("rate", "square"),)),
        Form((Factor("rate", "size"), Factor("rate", "size"))),
        Form((Factor("rate", "signed_square"), Factor("rate", "sign"))),
    ]
    assert told_apart(same, movement) == same[:1]
    # A bias and a matrix hold the rest: what is held within a limit is what is not beyond it.
    limited = [Form((Factor("rate", function, 0.2),)) for function in ("dead_zone", "within")]
    assert told_apart(limited, movement) == limited[:1]
    assert told_apart([Form((Factor("rate"),), "full"), Form((Factor("sense"), Factor("sense")))], movement) == []


def test_what_a_calibration_holds_is_no_form(forms):
    assert not any(form.factors == (Factor("rate"),) for form in forms)


def test_what_a_recording_has_not_is_not_asked(movement):
    largest = largest_of([movement]) | {"temperature": 0.0, "vibration": 0.0}
    asked = {factor.quantity for form in enumerated(largest) for factor in form.factors}
    assert asked == set(QUANTITIES) - {"temperature", "vibration"}


def test_constants_are_those_of_the_recording(movement):
    largest = largest_of([movement])
    wide = enumerated(largest | {"vibration": 10 * largest["vibration"]})
    for one, other in zip(enumerated(largest), wide, strict=True):
        if one.factors[0].function == "beyond" and one.factors[0].quantity == "vibration" and len(one.factors) == 1:
            np.testing.assert_allclose(10 * one.factors[0].constant, other.factors[0].constant, rtol=1e-3)


# Bits


def test_bits_are_those_of_a_code(forms):
    lengths = np.array([bits(form) for form in forms])
    assert np.sum(2.0**-lengths) < 1
    plain, product = Form((Factor("rate", "square"),)), Form((Factor("rate", "square"), Factor("vibration", "root")))
    late = Form((Factor("rate", "square", None, 5.0),))
    assert bits(Form((Factor("force"),))) < bits(plain) < bits(late) < bits(product)
    assert bits(late) == bits(late.with_constants((7.0,)))


# Words


def test_every_form_has_words(forms):
    shapes = {form.shape: form for form in forms}
    names = {what(form): form.shape for form in shapes.values()}
    assert len(names) == len(shapes)
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", name) and len(name) <= LONGEST for name in names)
    for form in shapes.values():
        said, sentence = equation(form), in_words(form)
        assert said.startswith("ω_i += ")
        assert not re.search(r"[{}\n]|None|nan", said + sentence)
        assert sentence.startswith("The error of e")
        assert sentence.endswith(".")
        assert splits(form)
        variable, unit = regime(form)
        assert READ[variable][1] == unit


def test_words_are_those_of_a_person():
    form = Form((Factor("sense"), Factor("rest", "decay", 12.0)))
    assert equation(form) == "ω_i += c_i s_i exp(−t_r / 12 s), s the sense of the last turn, t_r since the last turn"
    assert equation(Form((Factor("rate", "signed_root"),))) == "ω_i += c_i sign(u_i)√|u_i|, u = ω / FS"
    assert equation(Form((Factor("rate"), Factor("force")), "leant")) == "ω_i += u_i Σ_j C_ij f_j, u = ω / FS, f in g"
    assert "90°" in equation(Form((Factor("turned", "wave", np.pi / 2),)))
    assert "20 % " not in in_words(form)
    assert in_words(Form((Factor("vibration", "root"), Factor("rate")))).startswith(
        "The error of each axis is proportional to the square root"
    )


# What a form adds


def _expected(form, movement):
    """(N, 3, P), pattern by pattern, beside ``terms``."""
    values = [factor.values(movement).reshape(len(movement.rate), 3 if factor.vector else 1, factor.each) for factor in form.factors]
    values = [np.broadcast_to(value, (len(value), 3, value.shape[2])) for value in values]

    def product(axes):
        found = np.ones((len(movement.rate), 1))
        for value, axis in zip(values, axes, strict=True):
            found = (found[:, :, None] * value[:, axis][:, None, :]).reshape(len(found), -1)
        return found

    blocks = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        n = len(form.factors)
        axes = {
            "each": [[i] * n],
            "full": [[a] * n for a in range(3)],
            "cross": [[j] * n, [k] * n],
            "next": [[j, k][:n]],
            "last": [[k, j][:n]],
            "leant": [[i, a][:n] for a in range(3)],
        }[form.pattern]
        blocks.append(np.concatenate([product(each) for each in axes], axis=1))
    found = np.zeros((len(movement.rate), 3, sum(block.shape[1] for block in blocks)))
    first = 0
    for axis, block in enumerate(blocks):
        found[:, axis, first : first + block.shape[1]] = block
        first += block.shape[1]
    return found


def test_columns_are_those_of_the_pattern(movement):
    level, wave, late = Factor("level"), Factor("time", "wave", 7.0), Factor("rate", "size", None, 0.5)
    forms = [Form((Factor("rate", "cube"), Factor("force")), pattern) for pattern in PATTERNS]
    forms += [Form((level,), "full"), Form((late, wave)), Form((late, Factor("temperature")), "cross"), Form((wave,))]
    for form in forms:
        np.testing.assert_allclose(columns_of(form, movement), _expected(form, movement), rtol=1e-12, atol=1e-15)


def test_a_form_is_an_effect_that_reads_no_more_than_it_declares(movement):
    rng = np.random.default_rng(3)
    for form in (
        Form((Factor("rate", "play", 0.1),), "full"),
        Form((Factor("temperature", "itself", None, 5.0), Factor("rate"))),
        Form((Factor("world"),)),
        Form((Factor("jerk"), Factor("vibration", "root"))),
    ):
        effect = as_effect(form)
        added = effect.distort(movement, rng.standard_normal(form.size) * 1e-3) - movement.rate
        assert np.abs(added).max() > 0
        assert effect.parameter.unit == form.coefficient_unit


def test_constants_go_round(forms):
    for form in forms[::97]:
        assert form.with_constants(form.constants) == form
        assert form.with_constants(2 * np.array(form.constants)).shape == form.shape


# Quantities


def test_quantities_that_a_recording_lacks_are_zero(movement):
    from dataclasses import replace

    nan = np.full(len(movement.t_s), np.nan)
    cold, quiet = replace(movement, temp_c=nan), replace(movement, vibration_g2=np.full(len(nan), 1e-8))
    assert largest_of([movement, cold])["temperature"] == largest_of([movement, cold])["temperature_rate"] == 0
    assert largest_of([quiet])["vibration"] == 0
    found = largest_of([movement])
    assert all(found[name] > 0 for name in QUANTITIES)
    np.testing.assert_allclose(found["rate"], np.abs(movement.rate).max() / movement.fs_rps)


def test_play_is_that_of_a_gear():
    values = np.cumsum(np.random.default_rng(2).standard_normal((500, 2)), axis=0)
    state = np.zeros(2)
    for value, found in zip(values, signals.play(values, 1.5), strict=True):
        state = np.clip(state, value - 1.5, value + 1.5)
        np.testing.assert_allclose(found, state, rtol=0, atol=1e-12)


# Laws of physics


def _correlation(forms, movement, law):
    """(F,) of what each form at its best adds with the law, beside what a calibration holds."""
    rows = np.arange(0, len(movement.rate), 3)
    held = np.linalg.qr(np.concatenate([movement.rate[rows], np.ones((len(rows), 1))], axis=1))[0]
    taken, whole = np.zeros(len(forms)), 0.0
    for axis in range(3):
        left = law[rows, axis] - held @ (held.T @ law[rows, axis])
        taken += np.sum(projections(forms, movement, rows, axis, left) ** 2, axis=1)
        whole += left @ left
    return np.sqrt(taken / whole)


def _sharpened(form, movement, law, reach=2.0, scanned=25):
    """(correlation, form) at the best constants, one after the other."""
    best = _correlation([form], movement, law)[0], form
    for spread in (reach, reach ** (3 / scanned)):
        for number in range(len(form.constants)):
            for factor in np.geomspace(1 / spread, spread, scanned):
                values = np.array(best[1].constants)
                values[number] *= factor
                trial = best[1].with_constants(values)
                best = max(best, (_correlation([trial], movement, law)[0], trial), key=lambda found: found[0])
    return best


class World:
    """What a person who writes a law on paper calls the movement."""

    def __init__(self, m):
        rng = np.random.default_rng(4)
        self.m, self.w, self.t, self.v2, self.full_scale = m, m.rate, m.t_s, m.vibration_g2, m.fs_rps
        self.f, self.warm = without_vibration(m.force_g, m.dt_s), m.temp_c - m.first_temp_c
        self.c, self.matrix = rng.uniform(0.5, 1.5, 3) * (1, -1, 1), rng.standard_normal((3, 3))
        self.speed, self.rest, self.sense = np.linalg.norm(m.rate, axis=1), signals.seconds_at_rest(m), signals.last_sense(m)

    def to_all(self, scalar):
        return scalar[:, None] * self.c

    def after(self, values, tau_s):
        return signals.lagged(values, tau_s, self.t)


def _next(values):
    return np.roll(values, -1, axis=1)


def _last(values):
    return np.roll(values, 1, axis=1)


#: name -> (the law on paper, quantities that it is of)
LAWS = {
    "kinematic rectification": (lambda o: o.c * _next(o.w) * _last(o.w), "rate"),
    "rectified rate of every axis": (lambda o: o.w**2 @ o.matrix.T, "rate"),
    "anisoelasticity": (lambda o: o.c * _next(o.f) * _last(o.f), "force"),
    "scale factor that follows the force": (lambda o: o.w * (o.f @ o.matrix.T), "rate force"),
    "nonlinearity that follows temperature": (lambda o: o.c * o.warm[:, None] * o.w * np.abs(o.w), "rate temperature"),
    "scale factor under vibration": (lambda o: o.c * o.v2[:, None] * o.w, "rate vibration"),
    "soft limit": (lambda o: o.c * o.w / (1 + np.abs(o.w) / (0.7 * o.full_scale)), "rate"),
    "hard limit": (lambda o: o.c * np.clip(o.w, -0.27 * o.full_scale, 0.27 * o.full_scale), "rate"),
    "remnant of the last turn": (lambda o: o.c * o.sense * np.exp(-o.rest / 2.2)[:, None], "sense rest"),
    "viscoelastic creep": (lambda o: o.c * o.after(o.w, 0.8), "rate"),
    "heat of turning": (lambda o: o.to_all(o.after(o.speed**2, 24.0)), "rate_size"),
    "scale factor that heat of turning moves": (lambda o: o.c * o.w * o.after(o.speed**2, 11.0)[:, None], "rate rate_size"),
    "supply that settles": (lambda o: o.to_all(np.exp(-o.t / 4.1)), "time"),
    "supply that settles, on the scale factor": (lambda o: o.c * o.w * np.exp(-o.t / 21.0)[:, None], "rate time"),
    "periodic load": (lambda o: o.to_all(np.sin(2 * np.pi * o.t / 7.3 + 0.4)), "time"),
    "magnetic field": (lambda o: signals.world_directions(o.m) @ (0.2, 0.1, -0.43), "world"),
    "resonance far above the hand": (lambda o: o.c * np.gradient(o.m.acceleration, o.t, axis=0), "jerk"),
    "strain of the package": (lambda o: o.to_all(signals.temperature_rate(o.m)), "temperature_rate"),
    "thermal hysteresis": (lambda o: o.to_all(signals.play(o.warm, 2.7)), "temperature"),
    "friction": (lambda o: o.c * np.sign(o.w) * np.exp(-np.abs(o.w) / (0.1 * o.full_scale)), "rate"),
    "rate that is rounded": (lambda o: np.round(o.w / 0.7) * 0.7, "rate"),
}


@pytest.mark.parametrize("name", LAWS)
def test_a_law_of_physics_is_a_form(name, movement, forms, record_property):
    law, quantities = LAWS[name]
    added = law(World(movement))
    own = [form for form in forms if {factor.quantity for factor in form.factors} <= set(quantities.split())]
    found = _correlation(own, movement, added) - 1e-4 * np.array([form.size for form in own])
    first = {own[number].shape: own[number] for number in np.argsort(-found)[:4][::-1]}
    best = max((_sharpened(form, movement, added) for form in first.values()), key=lambda each: each[0] - 1e-4 * each[1].size)
    record_property("form", equation(best[1]))
    assert best[0] > ENOUGH, equation(best[1])


def test_what_is_no_law_is_no_form(movement, forms):
    noise = np.random.default_rng(8).standard_normal(movement.rate.shape)
    assert _correlation(forms[::7], movement, noise).max() < 0.5


@pytest.mark.parametrize(
    ("quantity", "function"),
    [("rate", "dead_zone"), ("rate", "beyond"), ("rate", "soft"), ("rate", "band"), ("time", "decay"), ("time", "wave"), ("rate", None)],
)
def test_a_constant_between_two_places_is_found_from_the_nearer(quantity, function, movement):
    largest = largest_of([movement])[quantity]
    if function is None:  # a lag
        grid = np.array(sorted({lag_s for _, _, lag_s in offered(quantity, few=False) if lag_s is not None}))
        made = [Form((Factor(quantity, "size", None, lag_s),)) for lag_s in grid]
    else:
        grid = np.array(sorted(constant_at(quantity, function, place, largest) for place in places(quantity, function)))
        made = [Form((Factor(quantity, function, constant),)) for constant in grid]
    for at in (len(grid) // 3, len(grid) // 2, 2 * len(grid) // 3):
        true = made[0].with_constants((np.sqrt(grid[at] * grid[at + 1]),))
        law = columns_of(true, movement) @ np.linspace(1, 2, true.size)
        found = _correlation(made, movement, law)
        assert _sharpened(made[int(np.argmax(found))], movement, law)[0] > 0.98


def test_every_function_is_offered():
    offers = {function for name in QUANTITIES for few in (False, True) for function, _, _ in offered(name, few)}
    assert offers == set(FUNCTIONS)
