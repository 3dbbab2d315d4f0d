"""``calibrate.py apply``: the command that writes a log anew."""

import gzip
import json
import os
import sys

import numpy as np
import processes
import pytest
from conftest import DEG, ROOT, SESSION_TOML, broad, write_session
from models_in_use import LINEAR, MODELS, RATE_HZ, SAMPLES, physics, smoothing

import calibrate
from session.io import numeric
from session.io.config import Sensor
from session.io.logfile import read_log
from tinygc import models
from tinygc.models.denoiser import DenoisedNet

RNG = np.random.default_rng(6)


@pytest.fixture
def folder(tmp_path):
    made = write_session(tmp_path / "session", SAMPLES)
    for name, model in MODELS.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(models.to_dict(model)))
    return made


def run(tmp_path, *arguments):
    return calibrate.main(["apply", *map(str, arguments), "--quiet"])


def read(path):
    return read_log(path, Sensor("", "", RATE_HZ, 500, 4)).samples


@pytest.mark.parametrize("name", MODELS)
def test_apply_writes_the_calibrated_log(name, folder, tmp_path, monkeypatch):
    from session.io import lines

    monkeypatch.setattr(lines.Lines.take, "__defaults__", (4000,))
    assert run(tmp_path, tmp_path / f"{name}.json", folder / "log0001.csv", "-o", tmp_path / "out.csv") == 0
    made, logged = read(tmp_path / "out.csv"), read(folder / "log0001.csv")
    model = MODELS[name]
    expected = model.calibrate(logged) if not model.rates_only else model(logged.gyro)
    np.testing.assert_array_equal(made.t_ns, logged.t_ns)
    np.testing.assert_allclose(made.gyro, expected, rtol=0, atol=1e-6 if not model.rates_only else 6e-10)
    np.testing.assert_allclose(made.accel, logged.accel, rtol=0, atol=6e-7)
    np.testing.assert_allclose(made.temp_c, logged.temp_c, atol=6e-5)


def test_apply_takes_the_pre_calibration_beside_the_log(folder, tmp_path):
    """The g-sensitivity acts on the force that the fit saw."""
    path = tmp_path / "g.json"
    model = physics("gyro.g_sensitivity", rng=RNG)
    path.write_text(json.dumps(models.to_dict(model)))
    (folder / "session.toml").write_text(SESSION_TOML + "[accelerometer]\nbias_mps2 = [0.5, -0.4, 0.3]\n")
    assert run(tmp_path, path, folder / "log0001.csv", "-o", tmp_path / "out.csv") == 0
    logged = read(folder / "log0001.csv")
    expected = model.calibrate(logged.with_accel(logged.accel - [0.5, -0.4, 0.3]))
    np.testing.assert_allclose(read(tmp_path / "out.csv").gyro, expected, atol=6e-10)


def test_apply_reads_foreign_logs_and_packed_ones_and_writes_dps(folder, tmp_path):
    rows = [
        f"{t},{','.join(repr(float(v)) for v in (*g, *a))}"
        for t, g, a in zip(SAMPLES.t_ns // 1000, SAMPLES.gyro, SAMPLES.accel, strict=True)
    ]
    head = ",".join([f"gyro_rad[{i}]" for i in range(3)] + [f"accelerometer_m_s2[{i}]" for i in range(3)])
    packed = tmp_path / "px4.csv.gz"
    packed.write_bytes(gzip.compress(("timestamp," + head + "\n" + "\n".join(rows)).encode()))
    assert run(tmp_path, tmp_path / "linear.json", packed, "-o", tmp_path / "out.csv.gz", "--unit", "dps") == 0
    with gzip.open(tmp_path / "out.csv.gz", "rt") as file:
        assert file.readline() == "t_ns,gx_dps,gy_dps,gz_dps,ax_mps2,ay_mps2,az_mps2,gyro_calibrated\n"
    np.testing.assert_allclose(read(tmp_path / "out.csv.gz").gyro, LINEAR(SAMPLES.gyro), atol=6e-8 * DEG)


def test_a_log_that_is_calibrated_by_its_comment_is_known(folder, tmp_path):
    header, rows = (folder / "log0001.csv").read_text().split("\n", 1)
    (tmp_path / "old.csv").write_text(f"{header}\n# calibrated=gyro,accel\n{rows}")
    assert run(tmp_path, tmp_path / "linear.json", tmp_path / "old.csv", "-o", tmp_path / "out.csv", "--session", folder) == 2


def test_a_folder_stands_for_the_model_that_its_fit_recommends(folder, tmp_path, capsys):
    fit = folder / "fit"
    fit.mkdir()
    for name, model in MODELS.items():
        (fit / f"model_{name}.json").write_text(json.dumps(models.to_dict(model)))

    def applied(use):
        (fit / "fit.json").write_text(json.dumps({"schema": "tinygc-fit/2", "session": "s", "methods": {}, "use": use}))
        return run(tmp_path, folder, folder / "log0001.csv", "-o", tmp_path / "out.csv", "--force")

    assert applied({"method": "net", "model": "model_net.json", "why": "it is the best"}) == 0
    np.testing.assert_allclose(read(tmp_path / "out.csv").gyro, MODELS["net"](read(folder / "log0001.csv").gyro), atol=6e-10)
    for use, words in (
        ({"method": None, "model": None, "why": "nothing closes"}, "nothing closes"),
        ({"model": "model_x.json"}, "model_x.json"),
    ):
        assert applied(use) == 2
        assert words in capsys.readouterr().err
    assert run(tmp_path, tmp_path, folder / "log0001.csv", "-o", tmp_path / "none.csv") == 2
    assert "without a fit" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["none.json", "session/log0001.csv", "-o", "out.csv"], "none.json"),
        (["linear.json", "none.csv", "-o", "out.csv"], "none.csv"),
        (["linear.json", "session", "-o", "out.csv"], "session"),
        (["session/log0001.csv", "session/log0001.csv", "-o", "out.csv"], "broken JSON"),
        (["linear.json", "linear.json", "-o", "out.csv"], "no header"),
        (["linear.json", "session/log0001.csv", "-o", "session/log0001.csv", "--force"], "that this command reads"),
        (["linear.json", "session/log0001.csv", "-o", "net.json"], "exists"),
        (["linear.json", "session/log0001.csv", "-o", "."], "folder"),
        (["linear.json", "session/log0001.csv", "-o", "no/such/out.csv"], "out.csv"),
        (["physics.json", "rates.csv", "-o", "out.csv"], "lacks the accelerometer"),
        (["linear.json", "torn.csv", "-o", "out.csv"], "line 300"),
    ],
)
def test_bad_input_gets_one_line_and_leaves_no_output(arguments, words, folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    logged = (folder / "log0001.csv").read_text()
    (tmp_path / "rates.csv").write_text("Time,G_x [mdps],G_y [mdps],G_z [mdps]\n" + "".join(f"{i / 100},1,2,3\n" for i in range(500)))
    torn = logged.split("\n")
    torn[299] = "1,2"
    (tmp_path / "torn.csv").write_text("\n".join(torn))
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    more = ["--gyro-fs", "500", "--accel-fs", "4"] if "torn.csv" in arguments else []
    assert calibrate.main(["apply", *arguments, *more]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("applying")]
    assert len(said) == 1
    assert words in said[0]
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def piped(tmp_path, data, *arguments):
    """The command with bytes on its standard input."""
    command = [sys.executable, ROOT / "calibrate.py", "apply", *arguments]
    return processes.run(command, input=data, capture_output=True, cwd=tmp_path)


@pytest.mark.parametrize("packed", [False, broad(True)])
def test_a_stream_goes_in_and_comes_out(packed, folder, tmp_path):
    """Standard input can be read but once, and has no name that says gzip."""
    assert run(tmp_path, tmp_path / "denoised.json", folder / "log0001.csv", "-o", tmp_path / "out.csv") == 0
    data = (folder / "log0001.csv").read_bytes()
    options = ("--gyro-fs", "500", "--accel-fs", "4")
    done = piped(tmp_path, gzip.compress(data) if packed else data, "denoised.json", "-", "-o", "-", *options)
    assert (done.returncode, done.stdout) == (0, (tmp_path / "out.csv").read_bytes())
    assert b"samples, calibrated" in done.stderr


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_is_written_to_and_not_put_away(folder, tmp_path):
    """What stands where the output goes and is no file (a pipe, /dev/null) stays what it is."""
    os.mkfifo(tmp_path / "out.pipe")
    with (tmp_path / "read").open("wb") as file, processes.started(["cat", tmp_path / "out.pipe"], stdout=file) as reader:
        assert run(tmp_path, tmp_path / "linear.json", folder / "log0001.csv", "-o", tmp_path / "out.pipe", "--force") == 0
        reader.wait()
    assert (tmp_path / "out.pipe").is_fifo()
    assert (tmp_path / "read").read_bytes().count(b"\n") == len(SAMPLES) + 1  # the header
    assert [path.name for path in tmp_path.glob(".*partial")] == []


def test_another_rate_than_the_denoisers_is_said(folder, tmp_path, capsys):
    (tmp_path / "fast.json").write_text(json.dumps(models.to_dict(DenoisedNet(LINEAR, smoothing(RNG), 416.0))))
    command = ["apply", str(tmp_path / "fast.json"), str(folder / "log0001.csv"), "-o", str(tmp_path / "out.csv")]
    assert calibrate.main(command) == 0
    said = capsys.readouterr().out
    assert "made for 416" in said
    assert "ms late" in said


@pytest.mark.broad
def test_memory_does_not_grow_with_the_log(tmp_path):
    """Four times the rows, the same peak of Python's own allocations within a few pieces."""
    import tracemalloc

    from session.io.dialects import Answers
    from tinygc.deploy.apply import apply_model

    (tmp_path / "model.json").write_text(json.dumps(models.to_dict(MODELS["denoised"])))
    peaks = []
    for rows in (40_000, 160_000):
        t_us, registers = np.arange(rows) * 9600, RNG.integers(-20_000, 20_000, (7, rows))
        log = tmp_path / f"{rows}.csv"
        log.write_bytes(b"t_us,gx,gy,gz,ax,ay,az,temp\n" + numeric.decimal_rows([t_us, *registers], [0] * 8))
        tracemalloc.start()
        apply_model(tmp_path / "model.json", log, tmp_path / f"{rows}.out.csv", Answers(gyro_fs_dps=500, accel_fs_g=4))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
