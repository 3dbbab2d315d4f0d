"""``fit`` over temperature from the command line: what it prints, writes and refuses, and what the other commands make of it."""

import json
import shutil

import numpy as np
import pytest

from tinygc import SimulationOptions
from tinygc.annexes.temperature.options import RestOptions
from tinygc.annexes.temperature.rest_simulation import write_rest


@pytest.fixture(scope="module")
def rests(tmp_path_factory):
    """A folder of one rest log, fitted by nobody yet; read only."""
    options = RestOptions(cycles=2.0, cycle_s=900.0, cold_c=5.0, warm_c=55.0, lag_s=25.0, slope_dps_per_c=0.034)
    return write_rest(options, SimulationOptions(odr_hz=62.5, seed=3), tmp_path_factory.mktemp("rest") / "rests")


@pytest.fixture(scope="module")
def fitted(rests, tmp_path_factory):
    import calibrate

    folder = tmp_path_factory.mktemp("fitted") / "rests"
    shutil.copytree(rests, folder)
    assert calibrate.main(["fit", str(folder), "--quiet", "--json", str(folder.parent / "x.json")]) == 0
    return folder, json.loads((folder.parent / "x.json").read_text())


def test_the_numbers_are_the_truths(fitted):
    _, table = fitted
    for axis, sign in zip(table["gyro"], (1, -1, 1), strict=True):
        assert axis["terms_dps"][1] == pytest.approx(sign * 0.034, abs=4 * axis["terms_std_dps"][1])
        assert axis["lag_s"] == pytest.approx(25, abs=4 * axis["lag_std_s"])
        assert axis["held_out_dps"] < 0.05 * axis["held_out_constant_dps"]
        assert axis["p_value"] < 1e-6
    assert table["remaining_dps"] == [axis["held_out_dps"] for axis in table["gyro"]]


def test_applied_to_its_own_log_nothing_is_left(fitted, tmp_path, run):
    folder, _ = fitted
    out = tmp_path / "out.csv"
    code, _, err = run("apply", folder / "fit" / "model_thermal.json", folder / "rest0001.csv.gz", "-o", out, "--unit", "dps")
    assert code == 0, err
    rates = np.loadtxt(out, delimiter=",", skiprows=1, usecols=(1, 2, 3))
    means = rates[: len(rates) // 4000 * 4000].reshape(-1, 4000, 3).mean(axis=1)
    assert np.abs(means).max() < 0.01


def test_the_picture_is_drawn(fitted):
    pytest.importorskip("matplotlib")
    folder, _ = fitted
    assert (folder / "fit" / "temperature.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.parametrize("name", ["px4", "ardupilot", "json", "c"])
def test_export_takes_the_only_model_that_there_is(fitted, tmp_path, run, name):
    folder, _ = fitted
    code, _, err = run("export", folder, "--to", name, "--out", tmp_path / "export")
    assert code == 0, err
    assert any((tmp_path / "export").iterdir())


def test_the_order_can_be_held_down(rests, tmp_path, run):
    code, _, _ = run("fit", rests, "--temperature-order", 1, "--out", tmp_path / "fit", "--json", tmp_path / "x.json")
    assert code == 0
    assert {axis["order"] for axis in json.loads((tmp_path / "x.json").read_text())["gyro"]} == {1}


def test_several_folders_ask_for_temperature(folder, rests, run):
    code, _, err = run("fit", folder, rests)
    assert code == 2
    assert "add --temperature" in err


def test_options_that_nothing_heeds_are_refused(rests, run):
    for words in (("--methods", "pso"), ("--limit", 0.1), ("--no-earth",)):
        code, _, err = run("fit", rests, *words)
        assert code == 2
        assert f"{words[0]}: of no use over temperature" in err


def test_sensors_are_not_mixed(folder, rests, tmp_path, run):
    other = tmp_path / "other"
    shutil.copytree(rests, other)
    text = (other / "session.toml").read_text()
    (other / "session.toml").write_text(text.replace('serial = "SIM-3"', 'serial = "SIM-4"'))
    code, _, err = run("fit", folder, other, "--temperature")
    assert code == 2
    assert "sensor.serial is 'SIM-4'" in err


def test_one_recording_is_not_two(folder, rests, tmp_path, run):
    """As the same folder, as a copy of it, and a rest log as a copy."""
    shutil.copytree(folder, tmp_path / "copy")
    shutil.copytree(rests, tmp_path / "rests")
    for one, other, name in ((folder, folder, "log"), (folder, tmp_path / "copy", "log"), (rests, tmp_path / "rests", "rest")):
        code, _, err = run("fit", one, other, "--temperature", "--out", tmp_path / "fit")
        assert code == 2
        assert f"{one / name}0001.csv" in err
        assert f"{other / name}0001.csv" in err
        assert "are the same recording" in " ".join(err.split())
        assert not (tmp_path / "fit").exists()


def test_a_folder_with_nothing_says_what_it_lacks(rests, tmp_path, run):
    shutil.copy(rests / "session.toml", tmp_path)
    code, _, err = run("fit", tmp_path, "--temperature")
    assert code == 2
    assert "neither a rest log nor a log" in err


def test_simulate_says_what_no_chamber_does(tmp_path, run):
    code, _, err = run("simulate", "--out", tmp_path / "s", "--rest-cycles", 1, "--rest-warm-c", 200)
    assert code == 2
    assert "--rest-cold-c" in err
    assert not (tmp_path / "s").exists()
