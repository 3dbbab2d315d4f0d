"""The JSON of an explanation: its keys, and where it says that the mismatch lives."""

import json
import re

import pytest
from conftest import broad
from explained_sessions import FALSE_ROWS, make_explained, make_session
from formats_page import strangers

from tinygc.effects import catalogue
from tinygc.explanation.claims import SMALLEST_P
from tinygc.explanation.engine import explain_session
from tinygc.explanation.result import SCHEMA, to_json

session = pytest.fixture(make_session, scope="module", name="session")
explained = pytest.fixture(make_explained, scope="module", name="explained")


EVERY = ["nothing", "g_sensitivity", "thermal_bias", "bias_step", "saturation", "glitches", "both", "oscillating", "weakly skewed", "earth"]
EACH = [broad(name) if name in ("nothing", "thermal_bias") else pytest.param(name, marks=pytest.mark.slow) for name in EVERY]


@pytest.mark.parametrize("name", EACH)
def test_the_json_is_as_formats_has_it(explained, name):
    explanation, result = explained(name)
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    assert result["schema"] == SCHEMA == "tinygc-explain/2"
    assert strangers(result) == []
    assert result["session"] == explanation.session.name
    assert result["verdict"] in ("no_mismatch", "explained", "ambiguous", "partly_explained", "unexplained")
    mismatch = result["mismatch"]
    assert 0 < mismatch["p_value"] <= 1
    assert ("p_value_is_upper_bound" in mismatch) == (mismatch["p_value"] == SMALLEST_P)
    assert mismatch["closure_rms_deg"] > 0
    assert mismatch["expected_rms_deg"] > 0
    where = mismatch["where"]
    assert set(where["phases"]) <= {"still", "turn", "reference", "timing"}
    assert set(where["axes"]) <= set("xyz")
    assert set(where["segments"]) <= {segment.number for segment in explanation.problem.segments}
    if where["conditions"] is not None:
        assert where["conditions"]["from"] <= where["conditions"]["to"]
    duration = sum(log.samples.duration_s for log in explanation.problem.logs)
    assert len(where["segment_seconds"]) == len(where["segments"])
    for start, stop in [*where["segment_seconds"], *([where["seconds"]] if where["seconds"] else [])]:
        assert 0 <= start < stop <= duration + 0.01
    for effect in result["effects"] + result["findings"]:
        assert 0.1 <= effect.get("share", 1) <= 1
        assert set(effect["std"]) <= set(effect["parameters"])
        assert 0 < effect["p_value"] <= 1
        assert all(name in catalogue() or name.startswith("unknown.") for name in effect["equivalent"])
        assert re.search(r"\d", effect["description"])
    for effect in result["effects"]:
        assert effect["id"] in catalogue()
    held = result["fit"]["holdout_closure_rms_deg"]
    assert all(value > 0 for value in held.values())


@pytest.mark.slow
def test_verdict_and_effects_agree(explained):
    for name in EVERY:
        _, result = explained(name)
        assert (result["verdict"] in ("no_mismatch", "unexplained")) == (result["effects"] == [])
        assert (result["verdict"] == "ambiguous") == any(effect["equivalent"] for effect in result["effects"])
        assert (result["verdict"] in ("no_mismatch", "explained")) == (result["next"] is None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "phases", "variable"),
    [
        ("g_sensitivity", {"still", "turn"}, "attitude"),
        ("thermal_bias", {"still", "turn"}, "temperature"),
        ("scale_asymmetry", {"turn"}, "rate"),
        ("bias_step", {"still", "turn"}, "time"),
        ("bandwidth", {"turn"}, "angular acceleration"),
    ],
)
def test_it_says_where_the_mismatch_lives(explained, name, phases, variable):
    _, result = explained(name)
    where = result["mismatch"]["where"]
    assert set(where["phases"]) == phases
    assert where["axes"] == ["x", "y", "z"]
    assert where["conditions"]["variable"] == variable
    assert where["segments"]


@pytest.mark.slow
def test_temperature_and_time_of_the_regime_are_those_of_the_effect(explained):
    """Warm: the upper half of the rise.  Step: from its time to the end."""
    _, result = explained("thermal_bias")
    conditions = result["mismatch"]["where"]["conditions"]
    assert conditions["units"] == "°C"
    assert 27 < conditions["from"] < conditions["to"] < 33.5
    explanation, result = explained("bias_step")
    conditions = result["mismatch"]["where"]["conditions"]
    assert conditions["from"] == pytest.approx(result["effects"][0]["parameters"]["at_s"], abs=0.1)
    assert conditions["to"] == pytest.approx(explanation.twin.movements[0].t_s[-1], abs=0.1)


@pytest.mark.slow
def test_gravity_along_an_axis_is_in_g_and_has_the_axis_of_the_strongest_column(explained):
    _, result = explained("g_sensitivity")  # its columns are 0.095, 0.070 and 0.062 dps per g long
    conditions = result["mismatch"]["where"]["conditions"]
    assert (conditions["variable"], conditions["axis"], conditions["units"]) == ("attitude", "x", "g")
    _, result = explained("earth")
    assert result["mismatch"]["where"]["conditions"]["units"] == "g"


@pytest.mark.slow
def test_a_ceiling_lives_at_its_level(explained):
    _, result = explained("saturation")
    conditions = result["mismatch"]["where"]["conditions"]
    assert (conditions["variable"], conditions["units"]) == ("rate", "dps")
    assert 0.97 * 180 < conditions["from"] <= 180.1
    assert conditions["to"] == pytest.approx(180, abs=0.1)


@pytest.mark.slow
def test_the_seconds_are_those_of_the_effect(explained):
    """Step: from its time to the end.  False readings: from the first to the last.  A worst segment's are its own."""
    explanation, result = explained("bias_step")
    start, stop = result["mismatch"]["where"]["seconds"]
    assert start == pytest.approx(60, abs=2)
    assert stop == pytest.approx(explanation.twin.movements[0].t_s[-1], abs=0.1)
    explanation, result = explained("glitches")
    t_s = explanation.problem.logs[0].samples.t_s
    place = result["mismatch"]["where"]
    assert place["seconds"] == pytest.approx([t_s[FALSE_ROWS[0]], t_s[FALSE_ROWS[-1]]], abs=1e-3)
    for number, (start, stop) in list(zip(place["segments"], place["segment_seconds"], strict=True))[:3]:
        assert any(start < t_s[row] < stop for row in FALSE_ROWS), number


@pytest.mark.slow
def test_the_same_seed_gives_the_same_json(session, explained):
    _, result = explained("g_sensitivity")
    assert to_json(explain_session(session("g_sensitivity"))) == result
