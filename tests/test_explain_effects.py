"""Explaining a mismatch from end to end: what is concealed in a small simulated session is named, and nothing else is."""

import json
import re

import numpy as np
import pytest
from conftest import broad
from explained_sessions import ASYMMETRY, FALSE_ROWS, G_SENSITIVITY, LAG_S, SESSIONS, effect_of, make_explained, make_session, named, pulls

from session.io.units import DEG, G
from tinygc import SimulationOptions
from tinygc.closure.prepared import prepare
from tinygc.effects import catalogue
from tinygc.explanation.decision import FitClosure, tilt_rms
from tinygc.explanation.engine import explain_session
from tinygc.explanation.result import to_json
from tinygc.simulation.write import write_session

session = pytest.fixture(make_session, scope="module", name="session")
explained = pytest.fixture(make_explained, scope="module", name="explained")


# Nothing


@pytest.mark.parametrize("name", ["nothing", broad("nothing else")])
def test_nothing_concealed_is_no_mismatch(explained, name):
    _, result = explained(name)
    assert result["verdict"] == "no_mismatch"
    assert result["effects"] == []
    assert result["mismatch"]["p_value"] > 0.05
    assert result["fit"]["holdout_closure_rms_deg"]["before"] == result["fit"]["holdout_closure_rms_deg"]["after"]
    assert result["fit"]["excess_removed"] is None
    nowhere = {"phases": [], "axes": [], "segments": [], "segment_seconds": [], "seconds": None, "conditions": None}
    assert result["mismatch"]["where"] == nowhere
    assert result["next"] is None
    assert result["fit"]["holdout_closure_rms_deg"]["before"] < 1.6 * result["fit"]["holdout_closure_rms_deg"]["floor"]


# One effect


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "effect", "parameter", "truth"),
    [
        ("g_sensitivity", "gyro.g_sensitivity", "matrix_dps_per_g", G_SENSITIVITY),
        ("thermal_bias", "gyro.thermal_bias", "dps_per_c", [0.02, -0.03, 0.015]),
        ("scale_asymmetry", "gyro.scale_asymmetry", "half_difference", ASYMMETRY),
        ("bandwidth", "gyro.bandwidth", "tau_s", LAG_S),
        ("bias_step", "gyro.bias_step", "dps", [0.1, -0.15, 0.05]),
    ],
)
def test_one_strong_effect_is_named_with_its_parameters(explained, name, effect, parameter, truth, tmp_path):
    _, result = explained(name)
    assert named(result) == [effect]
    assert result["verdict"] == "explained"
    assert np.abs(pulls(effect_of(result, effect), parameter, truth)).max() < 4
    assert effect_of(result, effect)["equivalent"] == []
    held = result["fit"]["holdout_closure_rms_deg"]
    options = SimulationOptions(**{"segments": 24, "closure_s": 0.0, "seed": 5, "odr_hz": 104.0, **SESSIONS[name][1]})
    clean = FitClosure.of(prepare(write_session(options, tmp_path / "clean")).problem).held_out
    assert held["after"] < 1.6 * np.degrees(tilt_rms(clean))  # what fit states of the same session without the effect
    if effect in ("gyro.thermal_bias", "gyro.bias_step"):  # fit takes the bias from the stills then, and closes without the effect, too
        assert held["after"] < held["before"]
    else:
        assert held["before"] > 5 * held["floor"]
        assert result["fit"]["excess_removed"] > 0.98
    assert result["mismatch"]["p_value"] < 1e-6
    assert result["next"] is None


@pytest.mark.slow
def test_a_crept_accelerometer_is_named(session, explained):
    _, result = explained("accelerometer")
    assert named(result) == ["reference.accelerometer"]
    assert result["verdict"] == "explained"
    crept = json.loads((session("accelerometer") / "truth.json").read_text())["accel_shift_mg"]
    assert np.abs(pulls(effect_of(result, "reference.accelerometer"), "bias_mg", crept)).max() < 4
    assert "reference" in result["mismatch"]["where"]["phases"]


@pytest.mark.slow
def test_a_late_gyro_is_named_though_it_closes(explained):
    _, result = explained("gyro_accel_offset")
    assert named(result) == ["timing.gyro_accel_offset"]
    assert result["verdict"] == "ambiguous"  # a low-pass that all axes share does the same
    assert np.abs(pulls(effect_of(result, "timing.gyro_accel_offset"), "seconds", 0.015)).max() < 4
    held = result["fit"]["holdout_closure_rms_deg"]
    assert held["before"] < 1.6 * held["floor"]
    assert held["after"] == held["before"]  # what does not move the closure is not credited with what the rates of the stills do for it
    assert result["fit"]["excess_removed"] is None
    assert result["mismatch"]["p_value"] < 1e-6


@pytest.mark.slow
def test_the_earth_is_named_where_no_latitude_was_given(explained):
    _, result = explained("earth")
    assert named(result) == ["earth.rotation"]
    assert result["verdict"] == "explained"
    assert np.abs(pulls(effect_of(result, "earth.rotation"), "latitude_deg", 60.0)).max() < 4


@pytest.mark.slow
def test_nothing_found_says_what_would_have_been_found(explained, tmp_path):
    """Twice the stated size is named; from a quarter as many segments, less would have been seen."""
    _, result = explained("nothing")
    stated = {name: each["size"] for name, each in result["detection_limits"].items()}
    assert stated["gyro.g_sensitivity"] < 0.01
    assert result["detection_limits"]["gyro.g_sensitivity"]["unit"] == "dps/g"

    def sensitive(t_s, rate, force, temp_c):
        size = 2 * stated["gyro.g_sensitivity"] * DEG / G
        return rate + size * force @ np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.7, 0.0, 0.7]])

    folder = write_session(SimulationOptions(segments=24, closure_s=0.0, seed=5, odr_hz=104.0), tmp_path / "s", distort=sensitive)
    assert named(to_json(explain_session(folder))) == ["gyro.g_sensitivity"]
    few = write_session(SimulationOptions(segments=8, closure_s=0.0, seed=5, odr_hz=104.0), tmp_path / "few")
    less = explain_session(few).detection_limits
    assert all(less[name] > size for name, size in stated.items() if size is not None)


@pytest.mark.slow
def test_a_ceiling_is_named_and_its_turns_are_left_out(explained):
    explanation, result = explained("saturation")
    assert named(result) == ["gyro.saturation"]
    assert result["verdict"] == "explained"
    assert effect_of(result, "gyro.saturation")["parameters"]["dps"] == pytest.approx(180, abs=0.1)
    held = result["fit"]["holdout_closure_rms_deg"]
    assert held["before"] > 50 * held["floor"]
    assert held["after"] < 1.6 * held["floor"]
    assert 7 <= result["fit"]["segments_after"] < len(explanation.problem.used)


@pytest.mark.slow
def test_false_readings_are_named_with_their_rows_and_mended(explained):
    _, result = explained("glitches")
    assert named(result) == ["data.glitches"]
    assert result["verdict"] == "explained"
    assert effect_of(result, "data.glitches")["parameters"] == {"at": FALSE_ROWS, "samples": 3}
    held = result["fit"]["holdout_closure_rms_deg"]
    assert held["before"] > 5 * held["floor"]
    assert held["after"] < 1.6 * held["floor"]


# Two, and none of the catalogue


@pytest.mark.slow
def test_two_effects_are_both_named(explained):
    _, result = explained("both")
    assert named(result) == ["gyro.g_sensitivity", "gyro.scale_asymmetry"]
    assert result["verdict"] == "explained"
    assert np.abs(pulls(effect_of(result, "gyro.g_sensitivity"), "matrix_dps_per_g", G_SENSITIVITY)).max() < 4
    assert np.abs(pulls(effect_of(result, "gyro.scale_asymmetry"), "half_difference", ASYMMETRY)).max() < 4
    held = result["fit"]["holdout_closure_rms_deg"]
    # Tilts of the 19 segments outside a fold tell E and the effects: a prediction by p numbers from n rows errs by 1 + p / (n - p - 1).
    rows, numbers = 2 * 19, 9 + 9 + 3
    expected = np.sqrt(1 + numbers / (rows - numbers - 1)) * held["floor"]
    assert 0.7 * expected < held["after"] < 1.3 * expected


@pytest.mark.slow
def test_what_is_not_in_the_catalogue_gets_no_name_from_it(explained):
    """A zero that oscillates with a period of 30 s."""
    _, result = explained("oscillating")
    assert result["verdict"] in ("unexplained", "partly_explained")
    assert named(result) == []
    assert result["mismatch"]["p_value"] < 1e-6
    assert {"still", "turn"} <= set(result["mismatch"]["where"]["phases"])
    assert result["next"]
    ids = [finding["id"] for finding in result["findings"]]
    assert "unknown.periodic" in ids
    assert all(name.startswith("unknown.") for name in ids)
    (periodic,) = [finding for finding in result["findings"] if finding["id"] == "unknown.periodic"]
    assert float(re.search(r"period of ([\d.]+) s", periodic["description"])[1]) == pytest.approx(30, rel=0.1)


@pytest.mark.slow
def test_a_weak_delay_has_lookalikes_and_a_movement_that_would_tell(explained):
    """0.8 and 1.2 ms between the axes: a delay, a lag, a sensitivity to angular acceleration, and axes that make a third read
    are the same to first order."""
    _, result = explained("weakly skewed")
    assert result["verdict"] == "ambiguous"
    (effect,) = result["effects"]
    alike = {"timing.axis_skew", "gyro.bandwidth", "gyro.angular_acceleration"}
    assert effect["id"] in alike
    assert effect["equivalent"]
    assert set(effect["equivalent"]) <= alike - {effect["id"]} | {"unknown.rate_products"}
    assert effect["id"] in result["next"]
    assert all(name in result["next"] for name in effect["equivalent"])
    assert catalogue()[effect["id"]].discriminating_motion in result["next"]
    held = result["fit"]["holdout_closure_rms_deg"]
    assert held["after"] < 1.6 * held["floor"]
