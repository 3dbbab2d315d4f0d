"""What a notebook calls of annexes: arrays, fleets and lots; the numbers of their commands; one line where an annex was removed."""

import json

import numpy as np
import pytest

import calibrate
import tinygc
from session.annexes.arrays.recording import read_array
from session.io import annexes
from tinygc import CalibrationError, SimulationOptions
from tinygc.annexes.arrays.options import ArrayOptions
from tinygc.annexes.arrays.simulation import simulate_array, write_array


def command(out, *words, code=0) -> dict:
    """The JSON of a command."""
    assert calibrate.main([*map(str, words), "--quiet", "--json", str(out)]) == code
    return json.loads(out.read_text())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An array of two units."""
    options = SimulationOptions(segments=12, closure_s=0, odr_hz=62.5, seed=3)
    return write_array(simulate_array(options, ArrayOptions(units=2)), tmp_path_factory.mktemp("array") / "array")


@pytest.fixture(scope="module")
def fitted(folder):
    return tinygc.array(folder).fit(bias="ends")


def test_an_array_gives_the_commands_numbers(folder, fitted, tmp_path):
    theirs = command(tmp_path / "a.json", "fit", folder, "--bias", "ends", "--out", tmp_path / "fit")
    assert json.loads(json.dumps(fitted.to_json())) == theirs
    saved = fitted.save(tmp_path / "mine")
    model = saved / "model_array.json"
    assert model.read_bytes() == (tmp_path / "fit" / "model_array.json").read_bytes()
    applied = command(tmp_path / "b.json", "apply", model, folder, "-o", tmp_path / "theirs.csv")
    done = tinygc.array(folder).apply(model, tmp_path / "mine.csv")
    assert (tmp_path / "mine.csv").read_bytes() == (tmp_path / "theirs.csv").read_bytes()
    assert json.loads(json.dumps(done.to_json())) | {"out": applied["out"]} == applied
    assert tinygc.apply(model, folder, tmp_path / "again.csv").rows == done.rows
    for source in (model, folder):
        with pytest.raises(CalibrationError, match="an array, and an export holds one sensor"):
            tinygc.export(source, "c")


def test_an_array_of_sessions_in_memory_is_that_of_its_folder(folder, fitted):
    """The same units, whose arrays were never a file."""
    units = []
    for number, unit in enumerate(read_array(folder).units):
        samples, sensor = unit.logs[0].samples, unit.config.sensor
        units.append(
            tinygc.Session.from_arrays(
                samples.t_ns * 1e-9,
                samples.gyro,
                samples.accel,
                samples.temp_c,
                name=f"unit{number}",
                model=sensor.model,
                gyro_fs_dps=sensor.gyro_fs_dps,
                accel_fs_g=sensor.accel_fs_g,
                accelerometer=unit.config.accelerometer,
                site=unit.config.site,
                protocol=unit.config.protocol,
            )
        )
    found = tinygc.array(units)
    assert repr(found) == "<Array array: units 0, 1>"
    assert not [finding for finding in found.check() if finding.level == "error"]
    for mine, theirs in zip(found.fit(bias="ends").result.units, fitted.result.units, strict=True):
        np.testing.assert_allclose(mine.model.vector, theirs.model.vector, rtol=1e-6, atol=1e-9)
    with pytest.raises(CalibrationError, match="an array of 1 unit; expected two sessions or more"):
        tinygc.array(units[:1])
    with pytest.raises(CalibrationError, match=r"name is '\.\./etc', expected one word"):
        tinygc.array(units, name="../etc")


@pytest.mark.parametrize(
    ("call", "service"),
    [
        (lambda: tinygc.array("x"), "recordings of arrays"),
        (lambda: tinygc.fleet("x", "y"), "lots and fleets"),
        (lambda: tinygc.lot("x"), "lots and fleets"),
    ],
)
def test_a_removed_annex_is_one_line(call, service, monkeypatch):
    monkeypatch.setitem(annexes.SERVICES, service, annexes.SERVICES[service].replace(".annexes.", ".annexes.removed_"))
    with pytest.raises(CalibrationError, match=f"{service}: served by the annex removed_.*, which is not there") as caught:
        call()
    assert "\n" not in str(caught.value)
