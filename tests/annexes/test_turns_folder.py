"""Folders of a gyroscope alone: written and read again, refused in one line, and what each command says of them."""

import dataclasses
import gzip
import json

import numpy as np
import pytest
from annex import annex
from formats_page import strangers
from turntables import Turned

import calibrate
import tinygc
from session.io.config import read_config
from session.io.errors import DataError, FormatError
from session.io.units import DEG

folder = annex("session.annexes.turntable.folder")

TURNED = Turned(((0, 180, 90.0), (0, -180, 90.0), (2, 90, 90.0), (2, 90, 90.0)), noise=0.002, bias=(0.01, 0.0, -0.02))


def written(path, turned=TURNED, name="log0001", **more):
    return folder.write_turn_session(path, [folder.GyroLog(name, *turned.arrays())], turned.known(f"{name}.csv.gz"), **more)


def refused(capsys, *words, said):
    """Exit code 2, and one line on standard error that says every word."""
    assert calibrate.main([*map(str, words), "--quiet"]) == 2
    out, err = capsys.readouterr()
    assert len(err.strip().splitlines()) == 1, err
    assert "Traceback" not in out + err
    assert all(word in err for word in said), err


def test_what_is_written_is_read_again_to_the_last_bit(tmp_path):
    out = written(tmp_path / "s", serial="A7", model="BMI160", notes={"by": "Mara"})
    session = folder.read_turn_session(out)
    t_ns, gyro = TURNED.arrays()
    np.testing.assert_array_equal(session.logs[0].samples.t_ns, t_ns)
    np.testing.assert_array_equal(session.logs[0].samples.gyro, gyro)
    assert np.isnan(session.logs[0].samples.accel).all()
    assert (session.config.sensor.serial, session.config.sensor.model, session.config.notes) == ("A7", "BMI160", {"by": "Mara"})
    assert [turn.angle_rad for turn in session.turns] == pytest.approx([turn.angle_rad for turn in TURNED.known()], rel=1e-9)
    again = written(tmp_path / "t", serial="A7", model="BMI160", notes={"by": "Mara"})
    assert {path.name: path.read_bytes() for path in out.iterdir()} == {path.name: path.read_bytes() for path in again.iterdir()}
    from_arrays, from_folder = tinygc.fit_turns(TURNED.session()), tinygc.fit_turns(out)
    np.testing.assert_allclose(from_arrays.estimate.scale, from_folder.estimate.scale, rtol=0, atol=1e-12)


def test_a_folder_that_is_not_empty_is_left_alone(tmp_path):
    out = written(tmp_path / "s")
    with pytest.raises(FormatError, match="is no empty folder"):
        written(out)
    t_ns, gyro = TURNED.arrays()
    backward, other = folder.GyroLog("log1", t_ns[::-1], gyro), folder.GyroLog("log1", t_ns, gyro)
    with pytest.raises(DataError, match="row 1, counted from 0, goes backward"):
        folder.write_turn_session(tmp_path / "bad", [backward], TURNED.known("log1.csv.gz"))
    with pytest.raises(FormatError, match=r"log is 'log2.csv.gz', expected one of log1"):
        folder.write_turn_session(tmp_path / "bad", [other], TURNED.known("log2.csv.gz"))
    assert not (tmp_path / "bad").exists()


@pytest.mark.parametrize(
    ("logs", "words"),
    [
        ([], "no log"),
        ([folder and folder.GyroLog("run1", np.arange(3), np.zeros((3, 3)))], "begins with log"),
        ([folder and folder.GyroLog("log/1", np.arange(3), np.zeros((3, 3)))], "begins with log"),
        ([folder and folder.GyroLog("log1", np.arange(3), np.zeros((3, 2)))], r"expected \(N,\)"),
        ([folder and folder.GyroLog("log1", np.arange(3), np.zeros((3, 3)))] * 2, "two of one name"),
    ],
)
def test_logs_that_no_folder_can_hold_are_refused(tmp_path, logs, words):
    with pytest.raises(DataError, match=words):
        folder.write_turn_session(tmp_path / "s", logs, TURNED.known())


def test_fit_writes_a_model_that_apply_takes(tmp_path, capsys):
    out = written(tmp_path / "s")
    assert calibrate.main(["fit", str(out), "--quiet", "--json", str(tmp_path / "fit.json")]) == 0
    table = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))
    assert table == json.loads((out / "fit" / "turns.json").read_text(encoding="utf-8"))
    assert not strangers(table)
    model = json.loads((out / "fit" / "model_turns.json").read_text(encoding="utf-8"))
    assert not strangers(model)
    assert model["unobserved"] == ["E_xy", "E_xz", "E_yx", "E_yy", "E_yz", "E_zx", "E_zy"]
    assert "accel_fs_g" not in model["sensor"]
    assert calibrate.main(["apply", str(out), str(out / "log0001.csv.gz"), "-o", str(tmp_path / "a.csv"), "--quiet"]) == 0
    rows = np.loadtxt(tmp_path / "a.csv", delimiter=",", skiprows=1)
    found = tinygc.fit_turns(out)
    np.testing.assert_allclose(rows[:, 1:4], found.model(TURNED.arrays()[1]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(rows[:100, 1:4].mean(axis=0), 0, atol=0.001)
    assert tinygc.load(out / "fit" / "model_turns.json")(np.zeros((2, 3)))[0] == pytest.approx(found.model.B, rel=1e-12)
    capsys.readouterr()


@pytest.mark.parametrize(
    "header", ["t_us,gx_dps,gy_dps,gz_dps", "t_us,gx,gy,gz", "t_us,gx_dps,gy_dps,gz_dps,temp_c", "gz_dps,gy_dps,gx_dps,t_us"]
)
def test_logs_of_any_standard_header_without_an_accelerometer(tmp_path, header):
    out = written(tmp_path / "s", model="MPU-9250", gyro_fs_dps=500)
    t_ns, gyro = TURNED.arrays()
    names = header.split(",")
    unit = 1 / (500 / 32768 * DEG) if "gx" in names else 1 / DEG
    places = {"t_us": t_ns // 1000, "temp_c": np.full(len(t_ns), 25)}
    places |= {name: np.round(gyro[:, "xyz".index(name[1])] * unit, 0 if "gx" in names else 6) for name in names if name[0] == "g"}
    lines = [",".join(f"{places[name][i]:.15g}" for name in names) for i in range(len(t_ns))]
    (out / "log0001.csv.gz").write_bytes(gzip.compress("\n".join([header, *lines, ""]).encode()))
    for scale in tinygc.fit_turns(out).scales:
        assert abs(scale.value) < 0.003


def test_a_log_with_an_accelerometer_serves_as_well_and_it_is_not_read(tmp_path):
    out = written(tmp_path / "s")
    t_ns, gyro = TURNED.arrays()
    lines = [f"{t},{','.join(map(repr, row))},0.0,0.0,0.0" for t, row in zip(t_ns.tolist(), gyro.tolist(), strict=True)]
    text = "t_ns,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2\n" + "\n".join(lines) + "\n"
    before = tinygc.fit_turns(out).estimate.scale
    (out / "log0001.csv.gz").write_bytes(gzip.compress(text.encode()))
    np.testing.assert_array_equal(tinygc.fit_turns(out).estimate.scale, before)


def test_a_counter_of_32_bits_may_wrap_while_it_turns(tmp_path):
    out = written(tmp_path / "s")
    t_ns, gyro = TURNED.arrays()
    stamps = (t_ns // 1000 + 2**32 - 2_500_000) % 2**32
    assert np.abs(gyro[np.argmin(np.diff(stamps)), 0]) > 1
    lines = [f"{t},{','.join(map(repr, row))}" for t, row in zip(stamps.tolist(), gyro.tolist(), strict=True)]
    before = tinygc.fit_turns(out).estimate.scale
    (out / "log0001.csv.gz").write_bytes(gzip.compress(("t_us,gx_rps,gy_rps,gz_rps\n" + "\n".join(lines) + "\n").encode()))
    np.testing.assert_allclose(tinygc.fit_turns(out).estimate.scale, before, rtol=0, atol=1e-12)


@pytest.mark.parametrize("command", ["check", "explain", "report", "plan", "accelerometer"])
def test_other_commands_say_what_the_folder_is_and_what_serves_it(tmp_path, capsys, command):
    out = written(tmp_path / "s")
    assert calibrate.main([command, str(out), "--quiet"]) in (1, 2)
    printed = "".join(capsys.readouterr())
    assert "a gyroscope alone" in printed.replace("\n", " ")
    assert "Traceback" not in printed


def test_python_says_it_too(tmp_path):
    out = written(tmp_path / "s")
    for function in (tinygc.read_session, tinygc.fit, tinygc.explain):
        with pytest.raises(FormatError, match=r"a gyroscope alone.*tinygc\.fit_turns"):
            function(out)
    (finding,) = tinygc.check(out)
    assert (finding.level, finding.what) == ("error", "reading")
    assert "a gyroscope alone" in finding.says


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("turns.csv", None, "turns.csv: not found"),
        ("turns.csv", lambda text: text.replace(",x,", ",0;0.7;0.7,"), "a turn is about x, y or z"),
        ("turns.csv", lambda text: text.replace("180", "999999"), "angle_deg is '999999'"),
        ("session.toml", lambda text: text.replace("gyro_fs_dps", "gyro_fs"), "sensor.gyro_fs_dps is missing"),
        ("session.toml", lambda text: text.replace("[sensor]", "[[sensor]]"), "sensor is"),
        ("session.toml", lambda text: text.replace('"turns"', '"gravity"'), "sensor.accel_fs_g is missing"),
        ("log0001.csv.gz", lambda text: text.replace("gx_rps", "wx"), "the gyroscope columns are gy_rps, gz_rps"),
        ("log0001.csv.gz", lambda text: text.replace("t_ns", "t_ns,ax_g", 1), "the accelerometer columns are ax_g"),
        ("log0001.csv.gz", lambda text: text.splitlines()[0] + "\n", "a header but no samples"),
        ("log0001.csv.gz", lambda text: "\n".join(text.splitlines()[:30]), "none of 4 stated turns can be used"),
        ("log0001.csv.gz", lambda text: text.replace("t_ns,", "t_ns;").replace(",", ";", 3), "separated by semicolons"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, capsys, name, change, words):
    out = written(tmp_path / "s")
    path = out / name
    if change is None:
        path.unlink()
    else:
        unpack, pack = (gzip.decompress, gzip.compress) if name.endswith(".gz") else (bytes, bytes)
        path.write_bytes(pack(change(unpack(path.read_bytes()).decode()).encode()))
    refused(capsys, "fit", out, said=[words])


def test_options_of_other_fits_are_refused(tmp_path, capsys):
    out = written(tmp_path / "s")
    refused(capsys, "fit", out, "--methods", "raw", said=["--methods: of no use for a gyroscope alone"])
    refused(capsys, "fit", out, "--limit", "1", said=["--limit"])
    refused(capsys, "fit", out, "--strict", said=["--strict"])


def test_several_folders_are_fitted_one_by_one(tmp_path, capsys):
    one, two = written(tmp_path / "a"), written(tmp_path / "b", dataclasses.replace(TURNED, seed=1))
    assert calibrate.main(["fit", str(one), str(two), "--quiet"]) == 0
    assert capsys.readouterr().out.count("a gyroscope alone, 4 of 4 turns") == 2
    assert (two / "fit" / "model_turns.json").is_file()


def test_a_session_of_another_reference_is_not_for_fit_turns(tmp_path):
    session = tinygc.simulate(segments=4, closure_s=0.0, odr_hz=104.0, seed=1).session
    with pytest.raises(tinygc.FitError, match=r"tinygc\.fit takes it"):
        tinygc.fit_turns(session)
    with pytest.raises(tinygc.CalibrationError, match="session is of type int"):
        tinygc.fit_turns(3)


def test_the_full_scale_of_an_accelerometer_is_optional_for_a_gyroscope_alone_only(tmp_path):
    out = written(tmp_path / "s")
    assert np.isnan(read_config(out / "session.toml").sensor.accel_fs_g)
    toml = (out / "session.toml").read_text()
    (out / "session.toml").write_text(toml.replace("[protocol]", "accel_fs_g = 4\n\n[protocol]"))
    assert read_config(out / "session.toml").sensor.accel_fs_g == 4
