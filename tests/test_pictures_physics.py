"""Pictures that show the cause: what each turn asks for by itself lies on the law that was put in, and what is left lies about zero."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from known_effects import movement
from matplotlib.figure import Figure

from session.base.units import DEG
from tinygc.effects import catalogue
from tinygc.effects.effect import TURNS
from tinygc.features.challenge.proofs import _explanation_of, _inject, fitted
from tinygc.noise.twin import Variable
from tinygc.reporting.html.sections.explanation import section
from tinygc.reporting.pictures.panels import in_turns
from tinygc.reporting.pictures.values import _per_turn, at_constant, per_parameter, variable_for

FS, FIRST_C = 500.0, 25.0  #: dps, degC


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """An explanation of a session with a scale that grows with the square of the rate, its only claim, and the true theta (3,)."""
    folder = tmp_path_factory.mktemp("law") / "session"
    injected = _inject(catalogue()["gyro.scale_nonlinearity"], folder, 0.03, seed=4)
    e = _explanation_of(fitted(injected, folder))
    return e, e.claimed[0], injected.theta


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.broad
def test_each_turn_is_on_the_law_that_was_put_in_and_the_report_draws_it(known):
    """The fit's own error moves all turns of an axis alike.  A law that is a tenth larger is too far off, on one axis at least."""
    e, claim, truth = known
    for axis in range(3):
        of = _per_turn(e, claim, "scale", axis, variable_for(e, claim))
        assert len(of.x) >= 6
        assert rms((of.before - truth[axis] * (of.x / FS) ** 2) / of.sigma) < 2.0
        assert 0.6 < rms(of.after / of.sigma) < 1.4  # the bars are the noise
        assert rms(of.before / of.sigma) > 10
        turns = per_parameter(e, claim, axis)
        weight = turns.law / turns.sigma**2
        slope, sigma = weight @ turns.before / (weight @ turns.law), (weight @ turns.law) ** -0.5
        assert slope == pytest.approx(1.0, abs=4 * sigma + 0.02)
    for picture, words in (("", "The scale error of each turn along its rate"), (TURNS, "What each turn misses against what")):
        drawn = replace(claim, effect=replace(claim.effect, picture=picture)) if picture else claim
        found = section(SimpleNamespace(explanation=replace(e, claimed=[drawn])))
        assert words in found.html
        assert "nan" not in found.html.lower().replace("nano", "")


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
    share = name in ("gyro.scale_nonlinearity", "gyro.scale_asymmetry", "gyro.thermal_scale")
    found = at_constant(catalogue()[name], np.array([0.0, 1e-3, 0.0]), like, variable, 1, np.array([at]), per_rate=share)
    assert found == pytest.approx([1e-3 * one], rel=1e-9)


def test_the_closure_over_the_data_rate_leads_to_the_native_one():
    """Made-up: motion that closes by 0.4° at 100 Hz, and by the square of the interval."""
    rates = 100.0 / np.arange(1, 5)
    axes = Figure().subplots()
    in_turns.draw(axes, in_turns.DataRates(rates, 0.4 * (rates / 100) ** -2.0, -2.0, 0.4, floor_deg=0.02))
    assert axes.get_xscale() == axes.get_yscale() == "log"
    (line,), (thinned,) = ([each.get_xydata() for each in axes.lines if word in str(each.get_label())] for word in ("motion", "left out"))
    assert sorted(thinned[:, 0]) == pytest.approx(sorted(rates[1:]))
    on = np.exp(np.interp(np.log([*thinned[:, 0], 100.0]), np.log(line[:, 0]), np.log(line[:, 1])))
    assert on == pytest.approx([*thinned[:, 1], 0.4])
