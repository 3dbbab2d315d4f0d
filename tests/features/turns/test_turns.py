"""Folders of a gyroscope alone, written, imported and read again; refused in one line, and what each command says of them."""

import gzip
import json

import numpy as np
import pytest
from conftest import ROOT
from formats_page import strangers
from processes import refused
from turntables import Turned
from written_texts import lines

import calibrate
import tinygc
from session.base.errors import DataError, FormatError
from tinygc.features.turns.folder import GyroLog, read_turn_session, write_turn_session

TURNED = Turned(((0, 180, 90.0), (0, -180, 90.0), (2, 90, 90.0), (2, 90, 90.0)), noise=0.002, bias=(0.01, 0.0, -0.02))


def written(path, turned=TURNED, name="log0001", **more):
    return write_turn_session(path, [GyroLog(name, *turned.arrays())], turned.known(f"{name}.csv.gz"), **more)


def test_what_is_written_is_read_again_to_the_last_bit(tmp_path):
    out = written(tmp_path / "s", serial="A7", model="BMI160", notes={"by": "Mara"})
    session = read_turn_session(out)
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
    backward, other = GyroLog("log1", t_ns[::-1], gyro), GyroLog("log1", t_ns, gyro)
    with pytest.raises(DataError, match="row 1, counted from 0, goes backward"):
        write_turn_session(tmp_path / "bad", [backward], TURNED.known("log1.csv.gz"))
    with pytest.raises(FormatError, match=r"log is 'log2.csv.gz', expected one of log1"):
        write_turn_session(tmp_path / "bad", [other], TURNED.known("log2.csv.gz"))
    assert not (tmp_path / "bad").exists()


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


def test_a_counter_of_32_bits_may_wrap_while_it_turns(tmp_path):
    out = written(tmp_path / "s")
    t_ns, gyro = TURNED.arrays()
    stamps = (t_ns // 1000 + 2**32 - 2_500_000) % 2**32
    assert np.abs(gyro[np.argmin(np.diff(stamps)), 0]) > 1
    text = "t_us,gx_rps,gy_rps,gz_rps\n" + lines(stamps, *gyro.T, digits=17)
    before = tinygc.fit_turns(out).estimate.scale
    (out / "log0001.csv.gz").write_bytes(gzip.compress(text.encode()))
    np.testing.assert_allclose(tinygc.fit_turns(out).estimate.scale, before, rtol=0, atol=1e-12)


@pytest.mark.parametrize("command", ["check", "explain"])
def test_other_commands_say_what_the_folder_is_and_what_serves_it(tmp_path, capsys, command):
    out = written(tmp_path / "s")
    assert calibrate.main([command, str(out), "--quiet"]) in (1, 2)
    printed = "".join(capsys.readouterr())
    assert "a gyroscope alone" in printed.replace("\n", " ")
    assert "Traceback" not in printed


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("turns.csv", None, "turns.csv: not found"),
        ("turns.csv", lambda text: text.replace(",x,", ",0;0.7;0.7,"), "a turn is about x, y or z"),
        ("session.toml", lambda text: text.replace("gyro_fs_dps", "gyro_fs"), "sensor.gyro_fs_dps is missing"),
        ("session.toml", lambda text: text.replace('"turns"', '"gravity"'), "sensor.accel_fs_g is missing"),
        ("log0001.csv.gz", lambda text: text.replace("gx_rps", "wx"), "the gyroscope columns are gy_rps, gz_rps"),
        ("log0001.csv.gz", lambda text: text.replace("t_ns", "t_ns,ax_g", 1), "the accelerometer columns are ax_g"),
        ("log0001.csv.gz", lambda text: "\n".join(text.splitlines()[:30]), "none of 4 stated turns can be used"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, run, name, change, words):
    out = written(tmp_path / "s")
    path = out / name
    if change is None:
        path.unlink()
    else:
        unpack, pack = (gzip.decompress, gzip.compress) if name.endswith(".gz") else (bytes, bytes)
        path.write_bytes(pack(change(unpack(path.read_bytes()).decode()).encode()))
    refused(run("fit", out, "--quiet"), words)


# Imported.


PHONES = ROOT.parent / "shared" / "wild" / "phones"


GAIN = 0.004


WITH_GAIN = Turned(((2, 360, 90.0), (2, -360, 90.0), (2, 360, 90.0)), plus=(0, 0, GAIN), minus=(0, 0, GAIN), noise=0.002, stop_deg=0.02)


def phone(path, repeated=0):
    t_ns, gyro = WITH_GAIN.arrays()
    text = lines(t_ns * 1e-9, *gyro.T, digits=6).splitlines()
    path.write_text("\n".join(["time,wx,wy,wz", *text, *(text[-repeated:] if repeated else [])]) + "\n")
    return path


def turns_file(path, *logs):
    rows = [f"{i},{'xyz'[axis]},{angle},0.02,{log}" for log in logs for i, (axis, angle, _) in enumerate(WITH_GAIN.plan)]
    path.write_text("\n".join(["turn,axis,angle_deg,sigma_deg,log", *rows]) + "\n")
    return path


def test_logs_keep_the_names_that_the_file_of_turns_has(tmp_path, run):
    """Two telephones' files; rows that stand twice at their ends are left out."""
    paths = [phone(tmp_path / name, repeated=60) for name in ("Z_90_1.csv", "Z_90_2.csv")]
    turns = turns_file(tmp_path / "turns.csv", "Z_90_1.csv", "Z_90_2.csv")
    assert run("import", *paths, "--turns", turns, "--out", tmp_path / "s")[0] == 0
    found = tinygc.fit_turns(tmp_path / "s")
    assert [angle.log for angle in found.angles] == ["log0001_Z_90_1.csv.gz"] * 3 + ["log0002_Z_90_2.csv.gz"] * 3
    assert [scale.sense for scale in found.scales] == [1, -1]
    for scale in found.scales:
        assert scale.value == pytest.approx(GAIN, abs=4 * scale.sigma)
        assert scale.sigma < 3e-4


def test_registers_and_logs_without_turns_are_refused_in_one_line(tmp_path, run):
    path = phone(tmp_path / "a.csv")
    code, _, said = run("import", path, "--out", tmp_path / "s")
    assert code == 2
    assert "--turns FILE" in said
    turns = turns_file(tmp_path / "turns.csv", "b.csv")
    code, _, said = run("import", path, "--turns", turns, "--out", tmp_path / "s")
    assert (code, said.count("\n")) == (2, 1)
    assert "log is 'b.csv', expected one of a.csv" in said
    raw = tmp_path / "raw.csv"
    raw.write_text("t_us,gx,gy,gz\n" + lines(np.arange(0, 10**6, 10**4), *np.ones((3, 100), dtype=int)))
    code, _, said = run("import", raw, "--turns", turns_file(tmp_path / "t2.csv", "raw.csv"), "--out", tmp_path / "s")
    assert (code, said.count("\n")) == (2, 1)
    assert "give what one count is" in said
    assert not (tmp_path / "s").exists()


@pytest.mark.skipif(not PHONES.exists(), reason="the public recordings are not beside the project")
def test_a_real_telephone_reads_as_the_public_set_does(tmp_path, run):
    """Six turns of 1800° about each axis: the scales that are published of them, and one sense only."""
    paths = sorted((PHONES / "IphoneSE3G" / "Rotation" / "10" / "1800").glob("*.csv"))
    rows = [f"0,{path.name.split('_')[1][0].lower()},1800,0.26,{path.name}" for path in paths]
    (tmp_path / "turns.csv").write_text("\n".join(["turn,axis,angle_deg,sigma_deg,log", *rows]) + "\n")
    assert run("import", *paths, "--turns", tmp_path / "turns.csv", "--out", tmp_path / "s")[0] == 0
    found = tinygc.fit_turns(tmp_path / "s")
    assert [(scale.axis, scale.sense, scale.turns) for scale in found.scales] == [(0, 1, 6), (1, 1, 6), (2, 1, 6)]
    for scale, published in zip(found.scales, (-0.002, 0.009, 0.003), strict=True):
        assert abs(scale.value - published) < 0.001
    assert found.asymmetry == {}
