"""What is whose in an array: a false reading is in one unit, a knock in all; units differ where a test of their difference says so."""

import json

import numpy as np
import pytest
from conftest import DEG
from formats_page import strangers

import calibrate
from session.annexes.arrays.recording import read_array
from session.io.units import EARTH_RATE_RPS
from tinygc import SimulationOptions
from tinygc.annexes.arrays.explanation import FALSE_READING, KNOCK, ArrayExplanation, explain_array
from tinygc.annexes.arrays.options import ArrayOptions
from tinygc.annexes.arrays.simulation import simulate_array, write_array
from tinygc.annexes.arrays.traits import COMMON, DIFFERS, READINGS
from tinygc.explanation.standing import Standing


@pytest.fixture(scope="module")
def hit(tmp_path_factory):
    """A body that is knocked in the middle turn, and a last unit that reads falsely in the second."""
    options = SimulationOptions(segments=14, closure_s=0, odr_hz=104, seed=5)
    made = simulate_array(options, ArrayOptions(units=3, knock_deg=1.0, false_reading_dps=60.0))
    return made, write_array(made, tmp_path_factory.mktemp("explained") / "array")


@pytest.mark.slow
def test_a_false_reading_is_in_one_unit_and_a_knock_in_all(hit, tmp_path, capsys):
    made, folder = hit
    out, table = tmp_path / "out", tmp_path / "x.json"
    assert calibrate.main(["explain", str(folder), "--out", str(out), "--json", str(table), "--strict"]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "unit 2 alone leaps" in said
    assert "a false reading" in said
    assert "a knock, no false reading" in said
    written = json.loads(table.read_text(encoding="utf-8"))
    assert written["schema"] == "tinygc-array-explain/2"
    assert not strangers(written)
    assert written == json.loads((out / "array.json").read_text(encoding="utf-8"))
    false = [moment for moment in written["moments"] if moment["what"] == FALSE_READING]
    knocks = [moment for moment in written["moments"] if moment["what"] == KNOCK]
    assert [moment["unit"] for moment in false] == [2]
    start, stop = made.plan.turns[1]
    assert false[0]["at_s"] == pytest.approx((start + stop) / 2, abs=0.1)
    assert false[0]["felt_by_others"] < 0.2
    start, stop = made.plan.turns[7]
    assert knocks
    assert all(moment["at_s"] == pytest.approx((start + stop) / 2, abs=0.1) for moment in knocks)
    assert [(event["what"], event["unit"]) for event in written["events"]] == [("turn", 2)]
    (trait,) = (trait for trait in written["traits"] if trait["id"] == "data.glitches")
    assert (trait["scope"], trait["units"]) == (READINGS, [2])
    assert [statement["standing"] for statement in written["statements"]]
    assert "own physics" not in said
    for unit in written["units"]:
        assert not strangers(json.loads((out / unit["explained"]).read_text(encoding="utf-8")))


MATRIX = np.array([[0.06, 0.0, 0.02], [0.0, -0.05, 0.0], [0.03, 0.0, 0.04]]) * DEG / 9.80665


def follows_gravity(t_s, rate, force, temp_c):
    return rate + force @ MATRIX.T


@pytest.mark.slow
def test_an_effect_in_one_unit_differs_between_units_and_that_unit_is_said(tmp_path):
    """Unit 1's bias follows gravity: equality is rejected, unit 1 is the odd one, and the others have a limit."""
    options = SimulationOptions(segments=16, closure_s=0, odr_hz=104, seed=8)
    made = simulate_array(options, ArrayOptions(units=3), distort={1: follows_gravity})
    found = explain_array(read_array(write_array(made, tmp_path / "array")))
    assert isinstance(found, ArrayExplanation)
    (trait,) = (trait for trait in found.traits if trait.id == "gyro.g_sensitivity")
    assert trait.scope == DIFFERS
    assert trait.units == trait.apart == (1,)
    assert "in the others" in trait.words
    np.testing.assert_allclose(trait.estimates[1].theta.reshape(3, 3), 9.80665 * MATRIX, atol=5e-3 * DEG)
    assert np.abs(trait.estimates[0].theta).max() < 5e-3 * DEG
    own = [part.size_rad for part in found.parts.own]
    assert own[1] > 3 * max(own[0], own[2])
    assert found.verdict in ("own", "common_and_own")
    assert found.parts.own[1].standing is Standing.FOR


@pytest.mark.slow
def test_the_earth_that_one_unit_names_is_one_term_of_all(tmp_path):
    """Without a latitude the Earth is an effect.  One of three units names it by itself; in the array's axes all three agree on it."""
    made = simulate_array(SimulationOptions(segments=24, closure_s=0, odr_hz=104, seed=8), ArrayOptions(units=3))
    folder = write_array(made, tmp_path / "array")
    config = folder / "session.toml"
    kept = [line for line in config.read_text(encoding="utf-8").splitlines() if not line.startswith("latitude_deg")]
    config.write_text("\n".join(kept), encoding="utf-8")
    found = explain_array(read_array(folder))
    (trait,) = (trait for trait in found.traits if trait.id == "earth.rotation")
    assert len(trait.units) == 1
    assert trait.scope == COMMON
    assert trait.statement.standing is Standing.FOR
    rates = np.array([each.theta for each in trait.estimates.values()])
    sigmas = np.array([each.sigma for each in trait.estimates.values()])
    assert np.abs((rates - rates.mean(axis=0)) / sigmas).max() < 4
    assert np.linalg.norm(rates.mean(axis=0)) == pytest.approx(EARTH_RATE_RPS, rel=0.25)


def test_options_of_one_session_are_refused_in_a_line(hit, capsys):
    _, folder = hit
    assert calibrate.main(["explain", str(folder), "--noise", "some.json", "--quiet"]) == 2
    assert "--noise: of no use with" in capsys.readouterr().err
    assert calibrate.main(["compare", str(folder), str(folder), "--quiet"]) == 2
    assert "an array of 3 units" in capsys.readouterr().err
