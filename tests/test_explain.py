"""Explaining a mismatch from end to end: small simulated sessions with something concealed in them, or nothing."""

import copy
import gzip
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from session.common.errors import DataError
from session.common.units import DEG, G
from session.log.folder import read_session
from tinygc.effects import catalogue
from tinygc.explanation.verdict.explain import explain_session
from tinygc.explanation.verdict.measured import SMALLEST_P
from tinygc.explanation.verdict.result import SCHEMA, save, to_json
from tinygc.problem.build import build_problem
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

G_SENSITIVITY = [[0.05, -0.03, 0.02], [0.04, 0.06, -0.05], [-0.07, 0.02, 0.03]]
LAG_S = [0.005, 0.012, 0.022]
ASYMMETRY = [0.003, -0.004, 0.0035]


def g_sensitive(t_s, rate, force, temp_c):
    return rate + force / G @ (np.array(G_SENSITIVITY) * DEG).T


def warm(t_s, rate, force, temp_c):
    return rate + np.outer(temp_c - 25, [0.02, -0.03, 0.015]) * DEG


def asymmetric(t_s, rate, force, temp_c):
    return rate + np.abs(rate) * ASYMMETRY


def lagging(t_s, rate, force, temp_c):
    share = 1 - np.exp(-(t_s[1] - t_s[0]) / np.array(LAG_S))
    return np.stack([lfilter([k], [1, k - 1], rate[:, i], zi=[rate[0, i] * (1 - k)])[0] for i, k in enumerate(share)], axis=-1)


def stepping(t_s, rate, force, temp_c):
    return rate + (t_s >= 60)[:, None] * np.array([0.1, -0.15, 0.05]) * DEG


def weakly_skewed(t_s, rate, force, temp_c):
    return np.stack([np.interp(t_s - late, t_s, rate[:, i]) for i, late in enumerate((0.0, 0.0008, 0.0012))], axis=-1)


def late_gyro(t_s, rate, force, temp_c):
    return np.stack([np.interp(t_s - 0.015, t_s, axis) for axis in rate.T], axis=-1)


def both(t_s, rate, force, temp_c):
    """What the element feels of asymmetry comes first, then the zero."""
    return asymmetric(t_s, rate, force, temp_c) + g_sensitive(t_s, rate, force, temp_c) - rate


def oscillating(t_s, rate, force, temp_c):
    """In no catalogue: a zero that goes up and down every 30 s."""
    return rate + np.outer(np.sin(2 * np.pi * t_s / 30), [0.08, 0.05, -0.065]) * DEG


def rewritten(folder: Path, change) -> None:
    """Registers (N, 8) of the log, changed."""
    path = folder / "log0001.csv.gz"
    lines = gzip.decompress(path.read_bytes()).decode().splitlines()
    head = [line for line in lines if not line[0].isdigit()]
    table = change(np.array([[int(word) for word in line.split(",")] for line in lines if line[0].isdigit()]))
    rows = [",".join(map(str, row)) for row in table.tolist()]
    path.write_bytes(gzip.compress("\n".join([*head, *rows, ""]).encode()))


def clipped(table: np.ndarray) -> np.ndarray:
    """The output stops at 180 dps, 10286 registers of 17.5 mdps."""
    table[:, 1:4] = np.clip(table[:, 1:4], -10286, 10286)
    return table


FALSE_ROWS = [700, 1900, 3300, 5000, 6400, 7700, 9100, 10500, 11900]


def glitched(table: np.ndarray) -> np.ndarray:
    for row in FALSE_ROWS:
        table[row : row + 3, 1:4] += [2600, -1900, 2300]
    return table


def without_latitude(folder: Path) -> None:
    path = folder / "session.toml"
    path.write_text(re.sub(r"latitude_deg = .*\n", "", path.read_text()))


#: name -> what is concealed, options of the simulation, what is done to the folder afterwards
SESSIONS = {
    "nothing": (None, {}, None),
    "nothing else": (None, {"seed": 6}, None),
    "g_sensitivity": (g_sensitive, {}, None),
    "thermal_bias": (warm, {"warm_up_c": 8.0}, None),
    "scale_asymmetry": (asymmetric, {}, None),
    "bandwidth": (lagging, {}, None),
    "bias_step": (stepping, {"segments": 32}, None),
    "accelerometer": (None, {"accel_calibration_error_mg": 6.0}, None),
    "gyro_accel_offset": (late_gyro, {}, None),
    "earth": (None, {"segments": 40, "latitude_deg": 60.0}, without_latitude),
    "saturation": (None, {"segments": 40}, lambda folder: rewritten(folder, clipped)),
    "glitches": (None, {}, lambda folder: rewritten(folder, glitched)),
    "both": (both, {}, None),
    "oscillating": (oscillating, {}, None),
    "weakly skewed": (weakly_skewed, {}, None),
}


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """``session(name)``: the folder of one of ``SESSIONS``, made once.  Read only: copy to write."""
    made = {}

    def make(name: str) -> Path:
        if name not in made:
            distort, options, change = SESSIONS[name]
            chosen = SimulationOptions(**{"segments": 24, "closure_s": 0.0, "seed": 5, "odr_hz": 104.0, **options})
            made[name] = write_session(chosen, tmp_path_factory.mktemp("explain") / name.replace(" ", "_"), distort=distort)
            if change:
                change(made[name])
        return made[name]

    return make


@pytest.fixture(scope="module")
def explained(session):
    """``explained(name)``: the explanation and its JSON."""
    made = {}

    def make(name: str):
        if name not in made:
            explanation = explain_session(session(name))
            made[name] = explanation, to_json(explanation)
        return made[name][0], copy.deepcopy(made[name][1])

    return make


def effect_of(result: dict, name: str) -> dict:
    (effect,) = [effect for effect in result["effects"] if effect["id"] == name]
    return effect


def pulls(effect: dict, name: str, truth) -> np.ndarray:
    """(found - true) / std, flat."""
    return (np.ravel(effect["parameters"][name]) - np.ravel(truth)) / np.ravel(effect["std"][name])


def named(result: dict) -> list[str]:
    return sorted(effect["id"] for effect in result["effects"])


# Nothing


@pytest.mark.parametrize("name", ["nothing", "nothing else"])
def test_nothing_concealed_is_no_mismatch(explained, name):
    _, result = explained(name)
    assert result["verdict"] == "no_mismatch"
    assert result["effects"] == []
    assert result["mismatch"]["p_value"] > 0.05
    assert result["fit"]["holdout_closure_rms_deg"]["before"] == result["fit"]["holdout_closure_rms_deg"]["after"]
    assert result["fit"]["excess_removed"] is None
    nowhere = {"phases": [], "axes": [], "segments": [], "segment_seconds": [], "seconds": None, "regime": None}
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
def test_one_strong_effect_is_named_with_its_parameters(explained, name, effect, parameter, truth):
    _, result = explained(name)
    assert named(result) == [effect]
    assert result["verdict"] == "explained"
    assert np.abs(pulls(effect_of(result, effect), parameter, truth)).max() < 4
    assert effect_of(result, effect)["equivalent"] == []
    held = result["fit"]["holdout_closure_rms_deg"]
    assert held["before"] > 5 * held["floor"]
    assert held["after"] < 1.6 * held["floor"]
    assert result["fit"]["excess_removed"] > 0.98
    assert result["mismatch"]["p_value"] < 1e-6
    assert result["next"] is None


def test_a_steps_time_is_found_within_the_still_or_turn_it_is_in(explained):
    _, result = explained("bias_step")
    assert effect_of(result, "gyro.bias_step")["parameters"]["at_s"] == pytest.approx(60, abs=2)


def test_a_crept_accelerometer_is_named(session, explained):
    _, result = explained("accelerometer")
    assert named(result) == ["reference.accelerometer"]
    assert result["verdict"] == "explained"
    crept = json.loads((session("accelerometer") / "truth.json").read_text())["accel_shift_mg"]
    assert np.abs(pulls(effect_of(result, "reference.accelerometer"), "bias_mg", crept)).max() < 4
    assert "reference" in result["mismatch"]["where"]["phases"]


def test_a_late_gyro_is_named_though_it_closes(explained):
    _, result = explained("gyro_accel_offset")
    assert named(result) == ["timing.gyro_accel_offset"]
    assert result["verdict"] == "explained"
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
    stated = {name: each["size"] for name, each in result["seen_from"].items()}
    assert stated["gyro.g_sensitivity"] < 0.01
    assert result["seen_from"]["gyro.g_sensitivity"]["unit"] == "dps/g"

    def sensitive(t_s, rate, force, temp_c):
        size = 2 * stated["gyro.g_sensitivity"] * DEG / G
        return rate + size * force @ np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.7, 0.0, 0.7]])

    folder = write_session(SimulationOptions(segments=24, closure_s=0.0, seed=5, odr_hz=104.0), tmp_path / "s", distort=sensitive)
    assert named(to_json(explain_session(folder))) == ["gyro.g_sensitivity"]
    few = write_session(SimulationOptions(segments=8, closure_s=0.0, seed=5, odr_hz=104.0), tmp_path / "few")
    less = explain_session(few).seen_from
    assert all(less[name] > size for name, size in stated.items() if size is not None)


@pytest.mark.slow
def test_what_lives_in_the_turns_alone_is_not_said_to_live_in_the_stills(tmp_path):
    """Closure, still rates and gravity's length share noise; whitened together, a misfit of one leaks into the others."""

    def product(t_s, rate, force, temp_c):
        return rate + 0.02 * np.outer(rate[:, 0] * rate[:, 1] / (500 * DEG), [0, 0, 1])

    folder = write_session(SimulationOptions(segments=24, closure_s=0.0, seed=5, odr_hz=104.0), tmp_path / "s", distort=product)
    result = to_json(explain_session(folder))
    channels = {name: p["p_before"] for name, p in result["channels"].items()}
    assert channels["closure"] < 1e-50
    assert min(channels["still"], channels["length"]) > 1e-3
    assert result["mismatch"]["where"]["phases"] == ["turn"]


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


def test_two_effects_are_both_named(explained):
    _, result = explained("both")
    assert named(result) == ["gyro.g_sensitivity", "gyro.scale_asymmetry"]
    assert result["verdict"] == "explained"
    assert np.abs(pulls(effect_of(result, "gyro.g_sensitivity"), "matrix_dps_per_g", G_SENSITIVITY)).max() < 4
    assert np.abs(pulls(effect_of(result, "gyro.scale_asymmetry"), "half_difference", ASYMMETRY)).max() < 4
    held = result["fit"]["holdout_closure_rms_deg"]
    assert held["after"] < 1.6 * held["floor"]


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
    assert float(re.search(r"period of ([\d.]+) s", periodic["says"])[1]) == pytest.approx(30, rel=0.1)


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
    assert catalogue()[effect["id"]].splits in result["next"]
    held = result["fit"]["holdout_closure_rms_deg"]
    assert held["after"] < 1.6 * held["floor"]


# Boring causes


def test_a_wrong_full_scale_is_said_and_not_explained(session, run, tmp_path):
    folder = shutil.copytree(session("nothing"), tmp_path / "wrong")
    path = folder / "session.toml"
    path.write_text(path.read_text().replace("gyro_fs_dps = 500", "gyro_fs_dps = 250"))
    assert "gyro_fs_dps = 250" in path.read_text()
    with pytest.raises(DataError, match=r"250") as error:
        explain_session(folder)
    assert "500" in str(error.value)
    code, out, err = run("explain", folder, "--quiet")
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert not (folder / "explain").exists()


@pytest.mark.slow
def test_a_latitude_of_the_wrong_sign_is_said(session, tmp_path):
    folder = shutil.copytree(session("nothing"), tmp_path / "south")
    path = folder / "session.toml"
    latitude = read_session(folder).config.site.latitude_deg
    path.write_text(path.read_text().replace(f"latitude_deg = {latitude:g}", f"latitude_deg = {-latitude:g}"))
    result = to_json(explain_session(folder))
    (finding,) = result["findings"]
    assert finding["id"] == "unknown.world_direction"
    seen, given = map(float, re.search(r"about (-?\d+) deg, session.toml says (-?[\d.]+)", finding["says"]).groups())
    assert seen == pytest.approx(latitude, abs=15)
    assert given == -latitude
    assert "site.latitude_deg" in result["next"]


def test_a_heading_that_the_stills_contradict_is_a_warning(session, tmp_path):
    folder = shutil.copytree(session("nothing"), tmp_path / "turned")
    path = folder / "session.toml"
    seen = build_problem(read_session(folder)).earth.heading_rad / DEG
    path.write_text(path.read_text().replace("[site]\n", f"[site]\nheading_deg = {seen + 90:.1f}\n", 1))
    result = to_json(explain_session(folder))
    (warning,) = [warning for warning in result["warnings"] if warning["what"] == "heading"]
    assert f"heading_deg = {float(f'{seen + 90:.1f}'):g}" in warning["says"]
    assert "which was used" in warning["says"]
    assert result["verdict"] == "no_mismatch"


# The JSON


KEYS = {
    "schema": str,
    "session": str,
    "verdict": str,
    "mismatch": dict,
    "effects": list,
    "fit": dict,
    "next": (str, type(None)),
}
#: said beyond what docs/formats.md asks for
MORE = {"findings", "logs", "warnings", "seen_from", "within_stills", "channels", "turn_gravity", "noise", "version"}
#: beside a p-value that underflows
BOUND = {"p_value_is_upper_bound"}
EVERY = ["nothing", "g_sensitivity", "thermal_bias", "bias_step", "saturation", "glitches", "both", "oscillating", "weakly skewed", "earth"]


@pytest.mark.parametrize("name", EVERY)
def test_the_json_is_as_formats_has_it(explained, name):
    explanation, result = explained(name)
    assert set(result) == {*KEYS, *MORE}
    assert all(isinstance(result[key], kind) for key, kind in KEYS.items())
    assert result["schema"] == SCHEMA == "tinygc-explain/1"
    assert result["session"] == explanation.session.name
    assert result["verdict"] in ("no_mismatch", "explained", "ambiguous", "partly_explained", "unexplained")
    mismatch = result["mismatch"]
    assert set(mismatch) - BOUND == {"p_value", "closure_rms_deg", "expected_rms_deg", "where"}
    assert 0 < mismatch["p_value"] <= 1
    assert ("p_value_is_upper_bound" in mismatch) == (mismatch["p_value"] == SMALLEST_P)
    assert mismatch["closure_rms_deg"] > 0
    assert mismatch["expected_rms_deg"] > 0
    where = mismatch["where"]
    assert set(where) == {"phases", "axes", "segments", "regime", "segment_seconds", "seconds"}
    assert set(where["phases"]) <= {"still", "turn", "reference", "timing"}
    assert set(where["axes"]) <= set("xyz")
    assert set(where["segments"]) <= {segment.number for segment in explanation.problem.segments}
    if where["regime"] is not None:
        assert set(where["regime"]) - {"axis"} == {"variable", "units", "from", "to"}
        assert where["regime"]["from"] <= where["regime"]["to"]
    duration = sum(log.samples.duration_s for log in explanation.problem.logs)
    assert len(where["segment_seconds"]) == len(where["segments"])
    for start, stop in [*where["segment_seconds"], *([where["seconds"]] if where["seconds"] else [])]:
        assert 0 <= start < stop <= duration + 0.01
    for effect in result["effects"] + result["findings"]:
        found_only = {"share"} if effect["id"].startswith("unknown.") else set()
        assert set(effect) - BOUND == {"id", "equation", "parameters", "std", "p_value", "equivalent", "says"} | found_only
        assert 0.1 <= effect.get("share", 1) <= 1
        assert set(effect["std"]) <= set(effect["parameters"])
        assert 0 < effect["p_value"] <= 1
        assert all(name in catalogue() or name.startswith("unknown.") for name in effect["equivalent"])
        assert re.search(r"\d", effect["says"])
    for effect in result["effects"]:
        assert effect["id"] in catalogue()
    held = result["fit"]["holdout_closure_rms_deg"]
    assert set(held) == {"before", "after", "floor"}
    assert all(value > 0 for value in held.values())


@pytest.mark.parametrize("name", EVERY)
def test_the_json_goes_through_a_file_unchanged(explained, name):
    _, result = explained(name)
    assert json.loads(json.dumps(result, allow_nan=False)) == result


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
    assert where["regime"]["variable"] == variable
    assert where["segments"]


def test_temperature_and_time_of_the_regime_are_those_of_the_effect(explained):
    """Warm: the upper half of the rise.  Step: from its time to the end."""
    _, result = explained("thermal_bias")
    regime = result["mismatch"]["where"]["regime"]
    assert regime["units"] == "°C"
    assert 27 < regime["from"] < regime["to"] < 33.5
    explanation, result = explained("bias_step")
    regime = result["mismatch"]["where"]["regime"]
    assert regime["from"] == pytest.approx(result["effects"][0]["parameters"]["at_s"], abs=0.1)
    assert regime["to"] == pytest.approx(explanation.twin.movements[0].t_s[-1], abs=0.1)


def test_gravity_along_an_axis_is_in_g_and_has_the_axis_of_the_strongest_column(explained):
    _, result = explained("g_sensitivity")  # its columns are 0.095, 0.070 and 0.062 dps per g long
    regime = result["mismatch"]["where"]["regime"]
    assert (regime["variable"], regime["axis"], regime["units"]) == ("attitude", "x", "g")
    _, result = explained("earth")
    assert result["mismatch"]["where"]["regime"]["units"] == "g"


def test_a_ceiling_lives_at_its_level(explained):
    _, result = explained("saturation")
    regime = result["mismatch"]["where"]["regime"]
    assert (regime["variable"], regime["units"]) == ("rate", "dps")
    assert 0.97 * 180 < regime["from"] <= 180.1
    assert regime["to"] == pytest.approx(180, abs=0.1)


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


def test_the_same_seed_gives_the_same_json(session, explained):
    _, result = explained("g_sensitivity")
    assert to_json(explain_session(session("g_sensitivity"))) == result


# The command line and the picture


@pytest.mark.slow
def test_strict_fails_where_there_is_a_mismatch(session, run, tmp_path):
    target = tmp_path / "out.json"
    code, out, _ = run("explain", session("g_sensitivity"), "--strict", "--out", tmp_path / "explain", "--json", target)
    assert code == 1
    assert "gyro.g_sensitivity" in out
    assert json.loads(target.read_text())["verdict"] == "explained"
    assert json.loads((tmp_path / "explain" / "explain.json").read_text()) == json.loads(target.read_text())
    assert (tmp_path / "explain" / "explain.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_strict_passes_where_there_is_none(session, run, tmp_path):
    code, out, _ = run("explain", session("nothing"), "--strict", "--no-pictures", "--out", tmp_path / "explain")
    assert code == 0
    assert "nothing is missing" in out
    assert sorted(path.name for path in (tmp_path / "explain").iterdir()) == ["explain.json"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nothing", "saturation", "oscillating", "bandwidth"])
def test_there_is_a_picture_of_every_kind_of_verdict(explained, tmp_path, name):
    from matplotlib.image import imread

    explanation, result = explained(name)
    folder = save(explanation, tmp_path / "made")
    assert json.loads((folder / "explain.json").read_text()) == result
    picture = imread(folder / "explain.png")
    assert picture.shape[0] > 500
    assert picture.shape[1] > 800
    assert picture[..., :3].std() > 0.05  # not blank
