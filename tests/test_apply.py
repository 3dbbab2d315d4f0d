"""``calibrate.py apply``: the command that writes a log anew: its rates, its specific force, and that nobody calibrates a log twice."""

import gzip
import json
import os
import sys

import numpy as np
import processes
import pytest
from conftest import ROOT, SESSION_TOML, write_session
from models_in_use import LINEAR, MODELS, RATE_HZ, SAMPLES, physics
from scipy.spatial.transform import Rotation

import calibrate
import tinygc
from session.base.errors import DataError, FormatError
from session.log.config import Accelerometer, Sensor
from session.log.folder import sha256_of
from session.log.logfile import read_log
from tinygc import CalibrationError, models, read_session
from tinygc.models.denoiser import DenoisedNet
from tinygc.models.model import accelerometer_table, sensor_table

TURN = Rotation.from_rotvec([4e-3, -2e-3, 3e-3]).as_matrix()
UPPER = np.array([[1.01, 0.002, -0.004], [0, 0.99, 0.003], [0, 0, 1.005]])
OWN = Accelerometer(TURN @ UPPER, np.array([0.3, -0.2, 0.1]), "prior")
OTHER = Accelerometer(UPPER @ np.diag([1.002, 0.999, 1.0]), np.array([0.25, -0.2, 0.12]))
#: OTHER, whose frame is the sensor's own, in OWN's body frame
TURNED = Accelerometer(TURN @ OTHER.matrix, OTHER.bias_mps2)


@pytest.fixture
def folder(tmp_path):
    return write_session(tmp_path / "session", SAMPLES)


def toml(accelerometer):
    return SESSION_TOML + f"[accelerometer]\nmatrix = {accelerometer.matrix.tolist()}\nbias_mps2 = {accelerometer.bias_mps2.tolist()}\n"


def model_file(path, model=LINEAR, own=None, **more):
    """own: an accelerometer's calibration, or what stands in its place."""
    beside = {} if own is None else {"accelerometer": accelerometer_table(own) if isinstance(own, Accelerometer) else own}
    path.write_text(json.dumps(models.to_dict(model, **beside, **more)))
    return path


def applied(*arguments):
    return calibrate.main(["apply", *map(str, arguments), "--force", "--quiet"])


def read(path):
    return read_log(path, Sensor("", "", RATE_HZ, 500, 4)).samples


def numbers(log):
    """The rows below a header, read as a program reads a CSV that is told nothing: ValueError for what is no number, a comment among it."""
    header, *rows = [line.split(",") for line in log.read_text().splitlines()]
    assert all(len(row) == len(header) for row in rows)
    return [[float(cell) for cell in row] for row in rows]


@pytest.mark.parametrize("name", MODELS)
def test_apply_writes_the_calibrated_log(name, folder, tmp_path):
    """With the pre-calibration beside the log, on which the fit was based; other programs find a header and numbers below it."""
    model, out = MODELS[name], tmp_path / "out.csv"
    (folder / "session.toml").write_text(toml(OTHER))
    assert applied(model_file(tmp_path / "m.json", model), folder / "log0001.csv", "-o", out) == 0
    made, logged = read(out), read(folder / "log0001.csv")
    logged = logged.with_accel(OTHER.correct(logged.accel))
    expected = model.calibrate(logged) if not model.rates_only else model(logged.gyro)
    np.testing.assert_array_equal(made.t_ns, logged.t_ns)
    np.testing.assert_allclose(made.gyro, expected, rtol=0, atol=1e-6 if not model.rates_only else 6e-10)
    np.testing.assert_allclose(made.accel, logged.accel, rtol=0, atol=6e-7)
    np.testing.assert_allclose(made.temp_c, logged.temp_c, atol=6e-5)
    table = numbers(out)
    assert (len(table), {len(row) for row in table}) == (len(SAMPLES), {10})


@pytest.mark.parametrize(
    ("own", "beside", "named", "expected", "source"),
    [
        (OWN, None, False, OWN, "model"),
        (OWN, OTHER, False, OWN, "model"),
        (OWN, OTHER, True, TURNED, "session"),
        (OWN, OTHER, "fitted with it", OWN, "model"),  # the fit sharpened what stands there
        (None, OTHER, False, OTHER, "session"),
        (None, None, True, Accelerometer(), "none"),
        (Accelerometer(source="none"), None, False, Accelerometer(), "none"),
    ],
)
def test_whose_calibration_the_specific_force_has(own, beside, named, expected, source, folder, tmp_path):
    (folder / "session.toml").write_text(SESSION_TOML if beside is None else toml(beside))
    hashes = {"sha256": {"session.toml": sha256_of(folder / "session.toml")}} if named == "fitted with it" else {}
    path, out = model_file(tmp_path / "m.json", LINEAR, own, **hashes), tmp_path / "out.csv"
    assert applied(path, folder / "log0001.csv", "-o", out, *(["--session", folder] if named else []), "--json", tmp_path / "a.json") == 0
    np.testing.assert_allclose(read(out).accel, expected.correct(read(folder / "log0001.csv").accel), rtol=0, atol=6e-7)
    assert json.loads((tmp_path / "a.json").read_text())["accelerometer"] == source


def test_in_python_the_model_calibrates_force_as_apply_does(tmp_path):
    model = tinygc.load(model_file(tmp_path / "m.json", LINEAR, OWN))
    np.testing.assert_allclose(model.force(SAMPLES.accel), OWN.correct(SAMPLES.accel), rtol=0, atol=1e-12)
    np.testing.assert_allclose(model.force(SAMPLES.accel[3]), OWN.correct(SAMPLES.accel)[3], rtol=0, atol=1e-12)
    for wrong in ([1.0, 2.0], np.zeros((2, 2, 3)), [np.nan, 0, 0], "x"):
        with pytest.raises(CalibrationError):
            model.force(wrong)
    with pytest.raises(CalibrationError, match="no calibration of the accelerometer"):
        tinygc.load(model_file(tmp_path / "n.json")).force(SAMPLES.accel)


def test_what_apply_wrote_is_read_again_and_calibrated_once(folder, tmp_path, capsys):
    path, again = model_file(tmp_path / "m.json", LINEAR, OWN), tmp_path / "again"
    again.mkdir()
    assert applied(path, folder / "log0001.csv", "-o", again / "log0001.csv") == 0
    scales = ("--gyro-fs", "500", "--accel-fs", "4")
    assert calibrate.main(["import", str(again / "log0001.csv"), "--out", str(tmp_path / "copy"), *scales]) == 0
    for place in (again, tmp_path / "copy"):
        (place / "session.toml").write_text(toml(OTHER))
        session = read_session(place)
        force = OWN.correct(read(folder / "log0001.csv").accel)
        np.testing.assert_allclose(session.calibrated(session.logs[0]).accel, force, rtol=0, atol=6e-7)
    assert "calibrated already" in read_session(again).logs[0].notes[-1]
    header, rows = (folder / "log0001.csv").read_text().split("\n", 1)
    (tmp_path / "old.csv").write_text(f"{header}\n# calibrated=gyro,accel\n{rows}")  # as files of earlier versions say it
    capsys.readouterr()
    for log in (again / "log0001.csv", tmp_path / "old.csv"):
        assert applied(path, log, "-o", tmp_path / "twice.csv") == 2
        assert capsys.readouterr().err.count("\n") == 1
        assert not (tmp_path / "twice.csv").exists()
    assert applied(path, folder / "log0001.csv", "-o", folder / "log0002.csv") == 0
    with pytest.raises(DataError, match=r"log0002\.csv has calibrated specific force, log0001\.csv has not"):
        read_session(folder)


def test_a_folder_stands_for_the_model_that_its_fit_recommends(folder, tmp_path, capsys):
    fit = folder / "fit"
    fit.mkdir()
    model_file(fit / "model_net.json", MODELS["net"])

    def uses(use):
        (fit / "fit.json").write_text(json.dumps({"schema": "tinygc-fit/2", "session": "s", "methods": {}, "use": use}))
        return applied(folder, folder / "log0001.csv", "-o", tmp_path / "out.csv")

    assert uses({"method": "net", "model": "model_net.json", "why": "it is the best"}) == 0
    np.testing.assert_allclose(read(tmp_path / "out.csv").gyro, MODELS["net"](read(folder / "log0001.csv").gyro), atol=6e-10)
    for use, words in (({"method": None, "model": None, "why": "nothing closes"}, "nothing closes"), ({"model": "m_x.json"}, "m_x.json")):
        assert uses(use) == 2
        assert words in capsys.readouterr().err
    assert applied(tmp_path, folder / "log0001.csv", "-o", tmp_path / "none.csv") == 2
    assert "without a fit" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["session/log0001.csv", "session/log0001.csv", "-o", "out.csv"], "broken JSON"),
        (["model.json", "session/log0001.csv", "-o", "session/log0001.csv", "--force"], "that this command reads"),
        (["model.json", "session/log0001.csv", "-o", "torn.csv"], "exists"),
        (["model.json", "rates.csv", "-o", "out.csv"], "misses the accelerometer"),
        (["model.json", "torn.csv", "-o", "out.csv", "--session", "session"], "line 300"),
        (["model.json", "blank.txt", "-o", "out.csv"], "these are options of `"),
        (["model.json", "torn.csv", "session", "-o", "out.csv"], "session: no file, among a recording's logs"),
        (["model.json", ".", "-o", "out.csv"], ".: a folder without log*.csv; give a log"),
        (["model.json", "two", "-o", "out.csv"], "two: give one of its logs: log0001.csv, log0002.csv"),
        (["model.json", "phone.csv", "-o", "out.csv"], "phone.csv: no accelerometer; give its file as well"),
        *(([f"bad{n}.json", "session/log0001.csv", "-o", "out.csv"], "accelerometer") for n in range(2)),
    ],
)
def test_bad_input_gets_one_line_and_leaves_no_output(arguments, words, folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, header in (("rates.csv", "t_s,gx_dps,gy_dps,gz_dps"), ("phone.csv", "Time,G_x [mdps],G_y [mdps],G_z [mdps]")):
        (tmp_path / name).write_text(f"{header}\n" + "".join(f"{i / 100},1,2,3\n" for i in range(500)))
    torn = (folder / "log0001.csv").read_text().split("\n")
    torn[299] = "1,2"
    (tmp_path / "torn.csv").write_text("\n".join(torn))
    (tmp_path / "blank.txt").write_text("".join(f"0,0,{1 + i % 2 / 1000},1,2,3\n" for i in range(500)))
    (tmp_path / "two").mkdir()
    for name in ("log0001.csv", "log0002.csv"):
        (tmp_path / "two" / name).write_text("\n".join(torn))
    model_file(tmp_path / "model.json", physics("gyro.g_sensitivity"))
    flat = {"matrix": np.zeros((3, 3)).tolist(), "bias_mps2": [0, 0, 0]}
    for n, entry in enumerate((flat, 3)):
        with pytest.raises(FormatError, match="accelerometer"):
            tinygc.load(model_file(tmp_path / f"bad{n}.json", LINEAR, entry))
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert calibrate.main(["apply", *arguments]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("applying")]
    assert len(said) == 1
    assert words in said[0]
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_a_packed_stream_goes_in_and_comes_out(folder, tmp_path):
    """Standard input can be read but once, and has no name that says gzip; the model has full scales and the accelerometer."""
    sensor = sensor_table(Sensor("", "", RATE_HZ, 500, 4))
    path = model_file(tmp_path / "m.json", MODELS["denoised"], OWN, sensor=sensor)
    assert applied(path, folder / "log0001.csv", "-o", tmp_path / "out.csv") == 0
    data = (folder / "log0001.csv").read_bytes()
    command = [sys.executable, ROOT / "calibrate.py", "apply", path, "-", "-o", "-"]
    done = processes.run(command, input=gzip.compress(data), capture_output=True)
    assert (done.returncode, done.stdout) == (0, (tmp_path / "out.csv").read_bytes())
    assert b"samples, calibrated" in done.stderr
    assert b"sharpened by stills and turns" in done.stderr


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_is_written_to_and_not_put_away_and_another_rate_than_the_denoisers_is_said(folder, tmp_path, capsys):
    """What stands where the output goes and is no file (a pipe, /dev/null) stays what it is."""
    os.mkfifo(tmp_path / "out.pipe")
    model = model_file(tmp_path / "fast.json", DenoisedNet(LINEAR, MODELS["denoised"].denoiser, 416.0))
    with (tmp_path / "read").open("wb") as file, processes.started(["cat", tmp_path / "out.pipe"], stdout=file) as reader:
        assert calibrate.main(["apply", str(model), str(folder / "log0001.csv"), "-o", str(tmp_path / "out.pipe"), "--force"]) == 0
        reader.wait()
    said = capsys.readouterr().out
    assert "made for 416" in said
    assert "ms late" in said
    assert (tmp_path / "out.pipe").is_fifo()
    assert (tmp_path / "read").read_bytes().count(b"\n") == len(SAMPLES) + 1  # the header
    assert [path.name for path in tmp_path.glob(".*partial")] == []
