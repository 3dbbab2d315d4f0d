"""All forms of the grammar: each once, with bits and words of its own, and laws of physics among them."""

import re
from itertools import combinations

import numpy as np
import pytest

from tinygc.annexes.discovery.enumeration import bits, enumerated
from tinygc.annexes.discovery.equivalence import FactorValues, distinct_forms, some_movement, span_projections
from tinygc.annexes.discovery.form import PATTERNS, Factor, LawForm
from tinygc.annexes.discovery.quantities import QUANTITIES, largest_of
from tinygc.annexes.discovery.words import LONGEST, equation, in_words, regime, splits, what
from tinygc.effects import signals, without_vibration
from tinygc.noise.twin import READ

#: of movements that the enumeration has not seen
FRESH, FRESHER = 6, 8
#: of the added rate, beside what a calibration holds: what the issue asks of a law that is found
ENOUGH = 0.99
#: rows of the movement between two at which a law is compared with all forms, and with one
FAR, NEAR = 20, 6


@pytest.fixture(scope="module")
def movement():
    return some_movement(FRESH)


@pytest.fixture(scope="module")
def values(movement):
    return FactorValues(movement)


@pytest.fixture(scope="module")
def forms(movement):
    return enumerated(largest_of([movement]))


# Each form once


#: what a search promises to try (docs/discover.md): functions of quantities as they are, and such as are looked at behind a lag
PROMISED = {
    "rate": "itself size root square signed_square cube dead_zone beyond signed_beyond wave sign latch",
    "force": "itself size root square cube dead_zone beyond wave sign",
    "temperature": "itself size root square cube dead_zone beyond wave decay",
    "time": "itself root square cube beyond decay wave clock",
    "rest": "itself root square cube beyond decay",
    "acceleration": "itself size root square cube dead_zone beyond sign",
    "acceleration_size": "itself root square cube beyond",
    "jerk": "itself size root square cube dead_zone beyond sign",
    "vibration": "itself root square cube beyond",
    "turned": "itself size root square cube wave",
    "sense": "itself",
}
PROMISED_LATE = ("rate", "rate_size", "force", "acceleration", "acceleration_size", "temperature", "vibration", "sense")


@pytest.mark.broad
def test_what_a_search_promises_is_a_form_or_is_held(forms):
    own = [form.factors[0] for form in forms if len(form.factors) == 1]
    said = {(factor.quantity, factor.function) for factor in own if factor.lag_s is None}
    promised = {(quantity, function) for quantity, functions in PROMISED.items() for function in functions.split()}
    # A calibration holds the rate as it is; with what is held within a limit a dead zone of the rate is said, too.
    assert promised - said == {("rate", "itself"), ("rate", "dead_zone")}
    assert ("rate", "within") in said
    assert set(PROMISED_LATE) <= {factor.quantity for factor in own if factor.lag_s is not None}
    patterns = {("vector" if any(factor.vector for factor in form.factors) else "scalar", form.pattern) for form in forms}
    assert patterns == {("scalar", "each"), *(("vector", pattern) for pattern in PATTERNS)}


@pytest.mark.broad
def test_products_are_of_any_two_quantities(forms):
    pairs = {frozenset(factor.quantity for factor in form.factors) for form in forms if len(form.factors) == 2}
    # Two fields of the world would be one field of twice the frequency, with nine numbers for each axis.
    several = set(QUANTITIES) - {"world"}
    assert pairs >= {frozenset(pair) for pair in combinations(several, 2)}


@pytest.mark.broad
def test_identities_are_one_form(movement):
    same = [
        LawForm((Factor("rate", "square"),)),
        LawForm((Factor("rate", "size"), Factor("rate", "size"))),
        LawForm((Factor("rate", "signed_square"), Factor("rate", "sign"))),
    ]
    assert distinct_forms(same, [movement]) == same[:1]
    # A bias and a matrix hold the rest: what is held within a limit is what is not beyond it.
    limited = [LawForm((Factor("rate", function, 0.2),)) for function in ("dead_zone", "within")]
    assert distinct_forms(limited, [movement]) == limited[:1]
    assert distinct_forms([LawForm((Factor("rate"),), "full"), LawForm((Factor("sense"), Factor("sense")))], [movement]) == []


@pytest.mark.broad
def test_what_a_recording_has_not_is_not_asked(movement):
    largest = largest_of([movement]) | dict.fromkeys(set(QUANTITIES) - {"force", "temperature"}, 0.0)
    assert {factor.quantity for form in enumerated(largest) for factor in form.factors} == {"force", "temperature"}


# Bits


def test_bits_are_those_of_a_code(forms):
    lengths = np.array([bits(form) for form in forms])
    assert np.sum(2.0**-lengths) < 1
    plain, product = LawForm((Factor("rate", "square"),)), LawForm((Factor("rate", "square"), Factor("vibration", "root")))
    late = LawForm((Factor("rate", "square", None, 5.0),))
    assert bits(LawForm((Factor("force"),))) < bits(plain) < bits(late) < bits(product)
    assert bits(late) == bits(late.with_constants((7.0,)))


# Words


@pytest.mark.broad
def test_every_form_has_words(forms):
    shapes = {form.shape: form for form in forms}
    names = {what(form) for form in shapes}
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


# Laws of physics


def _correlation(forms, values, law, every):
    """(F,) of what each form at its best adds with the law (N, 3), beside what a calibration holds; in one row of so many."""
    rows = np.arange(0, len(law), every)
    held = np.linalg.qr(values.calibration[rows])[0]
    taken, whole = np.zeros(len(forms)), 0.0
    for axis in range(3):
        left = law[rows, axis] - held @ (held.T @ law[rows, axis])
        taken += np.sum(span_projections(forms, values, rows, axis, left) ** 2, axis=1)
        whole += left @ left
    return np.sqrt(taken / whole)


def _sharpened(form, values, law, scanned=25):
    """(correlation, form) at the best constants, one after the other."""
    best = _correlation([form], values, law, NEAR)[0], form
    reach = 1.06 if {factor.function for factor in form.factors} & {"wave", "clock", "saw"} else 2.0  # to the next place of the grid
    for spread in (reach, reach ** (3 / scanned)):
        for number in range(len(form.constants)):
            trials = []
            for factor in np.geomspace(1 / spread, spread, scanned):
                constants = np.array(best[1].constants)
                constants[number] *= factor
                trials.append(best[1].with_constants(constants))
            found = _correlation(trials, values, law, NEAR)
            best = max(best, (found.max(), trials[int(np.argmax(found))]), key=lambda each: each[0])
    return best


class World:
    """What a person who writes a law on paper calls the movement."""

    def __init__(self, m):
        rng = np.random.default_rng(4)
        self.m, self.w, self.t, self.full_scale = m, signals.moving_rate(m), m.t_s, m.fs_rps
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
    "scale factor that follows the force": (lambda o: o.w * (o.f @ o.matrix.T), "rate force"),
    "soft limit": (lambda o: o.c * o.w / (1 + np.abs(o.w) / (0.7 * o.full_scale)), "rate"),
    "hard limit": (lambda o: o.c * np.clip(o.w, -0.27 * o.full_scale, 0.27 * o.full_scale), "rate"),
    "remnant of the last turn": (lambda o: o.c * o.sense * np.exp(-o.rest / 2.2)[:, None], "sense rest"),
    "viscoelastic creep": (lambda o: o.c * o.after(o.w, 0.8), "rate"),
    "heat of turning": (lambda o: o.to_all(o.after(o.speed**2, 24.0)), "rate_size"),
    "scale factor that heat of turning moves": (lambda o: o.c * o.w * o.after(o.speed**2, 11.0)[:, None], "rate rate_size"),
    "supply that settles": (lambda o: o.to_all(np.exp(-o.t / 4.1)), "time"),
    "periodic load": (lambda o: o.to_all(np.sin(2 * np.pi * o.t / 7.3 + 0.4)), "time"),
    "loops that wind up": (lambda o: o.to_all(o.after((o.speed > 0.9).astype(float), 2.1)), "rate_size"),
    "friction of the die in its glue": (lambda o: o.c * signals.latched(o.w, 0.4), "rate"),
    "resonance far above the hand": (lambda o: o.c * np.gradient(o.m.acceleration, o.t, axis=0), "jerk"),
    "thermal hysteresis": (lambda o: o.to_all(signals.play(o.warm, 2.7)), "temperature"),
    "friction": (lambda o: o.c * np.sign(o.w) * np.exp(-np.abs(o.w) / (0.1 * o.full_scale)), "rate"),
    "ripple of a driven table": (lambda o: o.c * np.cos(3 * signals.angle_turned(o.m) - 0.6), "turned"),
    "load that is switched to a clock": (lambda o: o.to_all(np.where(np.sin(2 * np.pi * o.t / 19.0 + 1) > 0, 1.0, 0.0)), "time"),
    "rate that is rounded": (lambda o: np.round(o.w / 0.7) * 0.7, "rate"),
}


#: of what has corners in time: the first three harmonics of a square wave have so much of it
ENOUGH_OF = {"load that is switched to a clock": 0.96}


@pytest.mark.broad
@pytest.mark.parametrize("name", LAWS)
def test_a_law_of_physics_is_a_form(name, movement, values, forms, record_property):
    law, quantities = LAWS[name]
    added = law(World(movement))
    own = [form for form in forms if {factor.quantity for factor in form.factors} == set(quantities.split())]
    found = _correlation(own, values, added, FAR)
    first = {own[number].shape: own[number] for number in np.argsort(-found)[:4][::-1]}
    sharp = (_sharpened(form, values, added) for form in reversed(first.values()))
    best = next((each for each in sharp if each[0] > ENOUGH_OF.get(name, ENOUGH)), None)
    record_property("form", best and equation(best[1]))
    assert best, [equation(form) for form in first.values()]
