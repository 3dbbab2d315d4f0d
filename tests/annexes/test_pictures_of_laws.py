"""Pictures that show the cause: what each turn asks for by itself lies on the law that was put in, and what is left lies about zero."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from known_effects import movement
from matplotlib.figure import Figure

from session.io.units import DEG
from tinygc.annexes.challenge.proofs import explanation_of, fitted, inject
from tinygc.effects import Effect, catalogue
from tinygc.effects.effect import TURNS
from tinygc.noise.twin import Variable
from tinygc.reporting.html.sections.explanation import section
from tinygc.reporting.pictures.panels import in_turns
from tinygc.reporting.pictures.values import at_constant, per_parameter, per_turn, strongest, variable_for

pytestmark = pytest.mark.broad

FS = 500.0  #: dps
FIRST_C = 25.0
#: effect -> its size, what it makes of the scale (fraction) at x by the standard's formula, with the parameter k of the axis
SCALES = {
    "gyro.scale_nonlinearity": (0.03, lambda k, x: k * (x / FS) ** 2),
    "gyro.scale_asymmetry": (0.003, lambda k, x: k * np.sign(x)),
    "gyro.thermal_scale": (8e-4, lambda k, x: k * (x - FIRST_C)),
}


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """``known(effect, size)``: an explanation of a session with the effect in it, its only claim, and the true theta (P,)."""

    @cache
    def make(effect: Effect, size: float):
        folder = tmp_path_factory.mktemp("law") / "session"
        injected = inject(effect, folder, size, seed=4)
        e = explanation_of(fitted(injected, folder))
        return e, e.claimed[0], injected.theta

    return lambda effect, size: make(catalogue()[effect] if isinstance(effect, str) else effect, size)


def slope(of) -> tuple[float, float]:
    """Of the straight line through zero, and its sigma."""
    weight = 1 / of.sigma**2
    power = np.sum(weight * of.x**2)
    return np.sum(weight * of.x * of.before) / power, 1 / np.sqrt(power)


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_scale_error_of_each_turn_is_on_the_law_that_was_put_in(known):
    name = "gyro.scale_nonlinearity"
    size, law = SCALES[name]
    e, claim, truth = known(name, size)
    for axis in range(3):
        of = per_turn(e, claim, "scale", axis, variable_for(e, claim))
        assert len(of.x) >= 6
        off = (of.before - law(truth[axis], of.x)) / of.sigma
        # The fit's own error moves all turns of an axis alike.  A law that is a tenth larger is too far off, on one axis at least.
        assert rms(off) < 2.0
        assert 0.6 < rms(of.after / of.sigma) < 1.4  # the bars are the noise
        assert rms(of.before / of.sigma) > 10


def test_any_effect_in_turns_is_on_the_line_of_slope_one(known):
    e, claim, _ = known("gyro.scale_nonlinearity", SCALES["gyro.scale_nonlinearity"][0])
    for entry in strongest(e, claim):
        of = per_parameter(e, claim, entry)
        one = replace(of, x=of.law)
        found, sigma = slope(one)
        assert found == pytest.approx(1.0, abs=4 * sigma + 0.02)
        assert rms(of.after / of.sigma) < 1.7
    panels = Figure().subplots(1, 2)
    in_turns.against_prediction(e, claim, panels[0], taken_off=False)
    in_turns.against_prediction(e, claim, panels[1], taken_off=True)
    (law,) = [line.get_xydata() for line in panels[0].lines if str(line.get_label()).startswith("slope 1")]
    assert law[:, 0] == pytest.approx(law[:, 1])
    assert panels[0].get_ylim() == pytest.approx(panels[1].get_ylim(), rel=0.1)


@pytest.mark.parametrize(
    ("name", "variable", "at", "one"),
    [
        ("gyro.scale_nonlinearity", Variable("rate"), 250.0, 0.25),
        ("gyro.scale_asymmetry", Variable("rate"), -30.0, -1.0),
        ("gyro.thermal_scale", Variable("temperature"), FIRST_C + 3, 3.0),
        ("gyro.vibration_rectification", Variable("vibration"), 0.2, 0.2),
        ("gyro.thermal_bias", Variable("temperature"), FIRST_C + 3, 3.0),
        ("gyro.g2_sensitivity", Variable("attitude", 1), -0.5, 0.25),
        ("gyro.bias_drift", Variable("time"), 30.0, 0.5),
    ],
)
def test_a_law_at_a_constant_movement_is_its_equation(name, variable, at, one):
    like = replace(movement(), first_temp_c=FIRST_C, fs_rps=FS * DEG, duration_s=60.0)
    share = name in SCALES
    small = np.array([0.0, 1e-3, 0.0])
    found = at_constant(catalogue()[name], small, like, variable, 1, np.array([at]), per_rate=share)
    assert found == pytest.approx([1e-3 * one], rel=1e-9)


def test_the_closure_over_the_data_rate_leads_to_the_native_one():
    """Made-up: motion that closes by 0.4° at 100 Hz, and by the square of the interval."""
    rates = 100.0 / np.arange(1, 5)
    data = in_turns.DataRates(rates, 0.4 * (rates / 100) ** -2.0, -2.0, 0.4, floor_deg=0.02)
    axes = Figure().subplots()
    in_turns.draw(axes, data)
    assert axes.get_xscale() == axes.get_yscale() == "log"
    (line,) = [each.get_xydata() for each in axes.lines if "motion" in str(each.get_label())]
    (thinned,) = [each.get_xydata() for each in axes.lines if "left out" in str(each.get_label())]
    assert sorted(thinned[:, 0]) == pytest.approx(sorted(rates[1:]))
    on = np.exp(np.interp(np.log(thinned[:, 0]), np.log(line[:, 0]), np.log(line[:, 1])))
    assert on == pytest.approx(thinned[:, 1])
    assert np.exp(np.interp(np.log(100.0), np.log(line[:, 0]), np.log(line[:, 1]))) == pytest.approx(0.4)
    assert [text.get_text() for text in axes.texts] == ["every sample", "every 2nd sample", "every 3rd sample", "every 4th sample"]


@pytest.mark.parametrize(
    ("picture", "words"), [(None, "The scale error of each turn along its rate"), (TURNS, "What each turn misses against what")]
)
def test_the_report_draws_the_same_law(known, picture, words):
    e, claim, _ = known("gyro.scale_nonlinearity", SCALES["gyro.scale_nonlinearity"][0])
    if picture:
        e = replace(e, claimed=[replace(claim, effect=replace(claim.effect, picture=picture))])
    found = section(SimpleNamespace(explanation=e))
    assert words in found.html
    assert "nan" not in found.html.lower().replace("nano", "")
    assert "The line is the law" in found.html
