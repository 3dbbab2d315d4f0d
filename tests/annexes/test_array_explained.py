"""What is whose in an array: a false reading is in one unit, a knock in all; an effect in one unit is that unit's own physics."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from formats_page import strangers

import calibrate
from session.annexes.arrays.recording import read_array
from tinygc import SimulationOptions
from tinygc.annexes.arrays.explanation import (
    ALIKE,
    FALSE_READING,
    KNOCK,
    OWN,
    SOME,
    ArrayExplanation,
    _traits,
    explain_array,
)
from tinygc.annexes.arrays.joint import OWN_P
from tinygc.annexes.arrays.options import ArrayOptions
from tinygc.annexes.arrays.simulation import simulate_array, write_array


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
    assert (trait["scope"], trait["units"]) == (OWN, [2])
    for unit in written["units"]:
        assert not strangers(json.loads((out / unit["explained"]).read_text(encoding="utf-8")))


@pytest.mark.slow
def test_an_effect_in_one_unit_is_that_units_own_physics(tmp_path):
    """Unit 1's bias follows gravity: it is named there, and in no other; the others stay as they are."""
    matrix = np.array([[0.06, 0.0, 0.02], [0.0, -0.05, 0.0], [0.03, 0.0, 0.04]]) * DEG / 9.80665

    def follows_gravity(t_s, rate, force, temp_c):
        return rate + force @ matrix.T

    options = SimulationOptions(segments=16, closure_s=0, odr_hz=104, seed=8)
    made = simulate_array(options, ArrayOptions(units=3), distort={1: follows_gravity})
    found = explain_array(read_array(write_array(made, tmp_path / "array")))
    assert isinstance(found, ArrayExplanation)
    (trait,) = (trait for trait in found.traits if trait.id == "gyro.g_sensitivity")
    assert trait.whose == OWN
    assert trait.units == (1,)
    assert "unit 1 alone" in trait.words
    own = [unit.own_rad[0] for unit in found.fit.units]
    assert own[1] > 3 * max(own[0], own[2])
    assert found.verdict in ("own", "common_and_own")
    assert np.flatnonzero(found.fit.split.own_p < OWN_P).tolist() == [1]
    assert found.fit.split.common < own[1] / 3


@pytest.mark.parametrize(
    ("p_value", "own_p", "verdict"),
    [
        (0.011, 0.011, "no_mismatch"),
        (0.009, 0.011, "common"),
        (0.011, 0.009, "own"),
        (0.009, 0.009, "common_and_own"),
    ],
)
def test_a_part_is_stated_below_one_in_a_hundred(p_value, own_p, verdict):
    split = SimpleNamespace(p_value=p_value, own_p=np.array([1.0, own_p]))
    fit = SimpleNamespace(split=split, joint=SimpleNamespace(events=()))
    assert ArrayExplanation(fit, {}, {}, (), ()).verdict == verdict


def test_nothing_is_in_all_units_where_one_could_not_be_explained():
    claim = SimpleNamespace(effect=SimpleNamespace(id="gyro.thermal_bias", kind="gyro"), says="a", equivalent=("unknown.warm_up",))
    explained = {number: SimpleNamespace(claimed=[claim]) for number in (0, 1)}
    (whole,), (part,) = _traits(explained, ()), _traits(explained, (3,))
    assert whole.whose == ALIKE
    assert part.whose == SOME
    assert part.words.startswith("gyro.thermal_bias or unknown.warm_up in units 0, 1")
    assert part.words.endswith("; unit 3 could not be explained, and may have it too")


def test_options_of_one_session_are_refused_in_a_line(hit, capsys):
    _, folder = hit
    assert calibrate.main(["explain", str(folder), "--lot", "lot.json", "--quiet"]) == 2
    assert "--lot: of no use with" in capsys.readouterr().err
    assert calibrate.main(["compare", str(folder), str(folder), "--quiet"]) == 2
    assert "an array of 3 units" in capsys.readouterr().err
    assert calibrate.main(["export", str(folder), "--to", "json", "--quiet"]) == 2
    assert "model_array.json" in capsys.readouterr().err
