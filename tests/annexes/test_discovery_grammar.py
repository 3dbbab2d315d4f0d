"""What a form of the grammar of errors is: its units, its words, the columns that it adds, and the quantities that it is of."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tinygc.annexes.discovery.equivalence import as_effect, columns_of, some_movement
from tinygc.annexes.discovery.form import PATTERNS, Factor, LawForm, UnitError, text_of, unit_of
from tinygc.annexes.discovery.quantities import QUANTITIES, largest_of
from tinygc.annexes.discovery.words import equation, in_words
from tinygc.effects import signals

FRESH = 6


@pytest.fixture(scope="module")
def movement():
    return some_movement(FRESH)


# Units


@pytest.mark.parametrize(
    ("form", "unit"),
    [
        (LawForm((Factor("force"), Factor("temperature"))), "dps/(g·°C)"),
        (LawForm((Factor("temperature_rate"),)), "dps·s/°C"),
        (LawForm((Factor("force", "square"),), "full"), "dps/g²"),
        (LawForm((Factor("rest", "root"), Factor("sense"))), "dps/√s"),
        (LawForm((Factor("rest", "decay", 3.0), Factor("sense"))), "dps"),
        (LawForm((Factor("jerk"), Factor("vibration"))), "dps·s²/g²"),
        (LawForm((Factor("vibration", "root"), Factor("rate"))), "dps/g"),
        (LawForm((Factor("turned", "root_cube"),)), "dps/rad^1.5"),
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
    ],
)
def test_what_has_no_proper_unit_cannot_be_built(made, says):
    with pytest.raises(UnitError, match=re.escape(says)):
        made()


def test_a_pattern_that_the_factors_cannot_have_is_refused():
    with pytest.raises(ValueError, match=r"vibration \(scalar\) has no pattern 'full'"):
        LawForm((Factor("vibration"),), "full")
    with pytest.raises(ValueError, match="has no pattern 'next'"):
        LawForm((Factor("rate"), Factor("vibration")), "next")


# Words


def test_words_are_those_of_a_person():
    form = LawForm((Factor("sense"), Factor("rest", "decay", 12.0)))
    assert equation(form) == "ω_i += c_i s_i exp(−t_r / 12 s), s the sense of the last turn, t_r since the last turn"
    assert equation(LawForm((Factor("rate", "signed_root"),))) == "ω_i += c_i sign(u_i)√|u_i|, u = ω / FS"
    assert equation(LawForm((Factor("rate"), Factor("force")), "leant")) == "ω_i += u_i Σ_j C_ij f_j, u = ω / FS, f in g"
    assert "90°" in equation(LawForm((Factor("turned", "wave", np.pi / 2),)))
    assert "20 % " not in in_words(form)
    assert in_words(LawForm((Factor("vibration", "root"), Factor("rate")))).startswith(
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
    forms = [LawForm((Factor("rate", "cube"), Factor("force")), pattern) for pattern in PATTERNS]
    forms += [LawForm((level,), "full"), LawForm((late, wave)), LawForm((late, Factor("temperature")), "cross"), LawForm((wave,))]
    for form in forms:
        np.testing.assert_allclose(columns_of(form, movement), _expected(form, movement), rtol=1e-12, atol=1e-15)


def test_a_form_is_an_effect_that_reads_no_more_than_it_declares(movement):
    rng = np.random.default_rng(3)
    for form in (
        LawForm((Factor("rate", "play", 0.1),), "full"),
        LawForm((Factor("temperature", "itself", None, 5.0), Factor("rate"))),
        LawForm((Factor("world"),)),
        LawForm((Factor("jerk"), Factor("vibration", "root"))),
    ):
        effect = as_effect(form)
        added = effect.distort(movement, rng.standard_normal(form.size) * 1e-3) - movement.rate
        assert np.abs(added).max() > 0
        assert effect.parameter.unit == form.coefficient_unit


# Quantities


def test_quantities_that_a_recording_lacks_are_zero(movement):
    nan = np.full(len(movement.t_s), np.nan)
    cold, quiet = replace(movement, temp_c=nan), replace(movement, vibration_g2=np.full(len(nan), 1e-8))
    assert largest_of([movement, cold])["temperature"] == largest_of([movement, cold])["temperature_rate"] == 0
    assert largest_of([quiet])["vibration"] == 0
    found = largest_of([movement])
    assert all(found[name] > 0 for name in QUANTITIES)
    np.testing.assert_allclose(found["rate"], np.abs(movement.rate).max() / movement.fs_rps)
    row = replace(movement, **{name: getattr(movement, name)[:1] for name in ("t_s", "rate", "force_g", "temp_c", "vibration_g2")})
    assert not any(largest_of([row]).values())


def test_play_is_that_of_a_gear():
    values = np.cumsum(np.random.default_rng(2).standard_normal((500, 2)), axis=0)
    state = np.zeros(2)
    for value, found in zip(values, signals.play(values, 1.5), strict=True):
        state = np.clip(state, value - 1.5, value + 1.5)
        np.testing.assert_allclose(found, state, rtol=0, atol=1e-12)
