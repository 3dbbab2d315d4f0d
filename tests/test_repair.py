"""``check --repair``: what check has found is undone in a copy, which holds what the recording that was never spoilt holds."""

import gzip
import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, SESSION_TOML, Table, write_session
from formats_page import strangers

from session.base.errors import CalibrationError, FitError
from session.detect.findings import Correction
from session.detect.repair import _columns, repair
from tinygc import read_session
from tinygc.closure.build import build_problem

G = 9.80665
PHYSICAL = SESSION_TOML.replace("ASM330LHH", "unknown").replace("208.0", "52.0")
NAMES = "t_ns,gx_dps,gy_dps,gz_dps,ax_mps2,ay_mps2,az_mps2"
SAMPLES = Table().tumble(8, rest_s=1.5, seed=5).samples(odr_hz=52.0)
X_Y = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]])


def written(folder, samples=SAMPLES, toml=PHYSICAL, header=NAMES, time=1, gyro=1 / DEG, accel=1.0):
    """A session folder in physical units: t_ns over ``time``; rates and forces times numbers or matrices."""
    folder.mkdir()
    rates, forces = (values @ np.diag([1.0] * 3).dot(factor) for values, factor in ((samples.gyro, gyro), (samples.accel, accel)))
    lines = [",".join(map(repr, [int(t // time), *w, *f])) for t, w, f in zip(samples.t_ns, rates.tolist(), forces.tolist(), strict=True)]
    (folder / "log0001.csv").write_text("\n".join([header, *lines]) + "\n")
    (folder / "session.toml").write_text(toml)
    return folder


def registers(folder, old, new):
    return write_session(folder, SAMPLES, toml=PHYSICAL.replace("unknown", "ASM330LHH").replace(old, new))


#: how it is spoilt; the log's first line where that alone is changed, None where all rows are, "" where no byte of it is
SPOILT = {
    "full scale": (lambda folder: registers(folder, "gyro_fs_dps = 500", "gyro_fs_dps = 250"), ""),
    "x and y exchanged": (lambda folder: written(folder, gyro=X_Y / DEG), NAMES.replace("gx_dps,gy", "gy_dps,gx")),
    "g as m/s2": (lambda folder: written(folder, accel=1 / G), NAMES.replace("mps2", "g")),
    "time and rates": (lambda folder: written(folder, time=1000, gyro=0.5 / DEG), None),
}


@pytest.mark.parametrize("name", SPOILT)
def test_what_was_spoilt_is_undone(name, tmp_path):
    spoil, header = SPOILT[name]
    spoilt = spoil(tmp_path / "spoilt")
    before = {path.name: path.read_bytes() for path in spoilt.iterdir()}
    done = repair(spoilt, tmp_path / "copy")
    assert not [finding.line for finding in done.findings if finding.level == "error"]
    assert {path.name: path.read_bytes() for path in spoilt.iterdir()} == before
    session = read_session(tmp_path / "copy")
    samples = session.logs[0].samples
    np.testing.assert_allclose(samples.t_ns, SAMPLES.t_ns, atol=1000)
    np.testing.assert_allclose(samples.gyro, SAMPLES.gyro, atol=1e-9)
    np.testing.assert_allclose(samples.accel, SAMPLES.accel, atol=1e-6)
    assert "repaired" in session.config.notes
    table = json.loads((tmp_path / "copy" / "repaired.json").read_text())
    assert strangers(table) == []
    assert table["sha256"] == {file: hashlib.sha256(data).hexdigest() for file, data in before.items()}
    now = (tmp_path / "copy" / "log0001.csv").read_bytes()
    assert (now == before["log0001.csv"]) == (header == "")
    if header:  # numbers stay as they are written
        assert now.decode().split("\n", 1) == [header, before["log0001.csv"].decode().split("\n", 1)[1]]


def counted(folder, samples=SAMPLES, **how):
    spoilt = written(folder, samples, **how)
    log = spoilt / "log0001.csv"
    log.write_text("# stamps=counted\n" + log.read_text())
    return spoilt


def flat(folder):
    """z never turns and two signs are wrong: two orders fit."""
    table, rng = Table().rest(1.5), np.random.default_rng(5)
    for _ in range(12):
        table.turn(rng.uniform(90, 200), rng.normal(size=3) * [1, 1, 0], 3.0).rest(1.5)
    return written(folder, table.samples(odr_hz=52.0), gyro=np.diag([-1, -1, 1]) / DEG)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (written, "nothing to repair: check finds no error"),
        (lambda folder: written(folder, gyro=0.63 / DEG), "no cause is determined: log0001.csv: gyro scale: gravity requires"),
        (flat, r"no cause is determined: log0001\.csv: axes: not as logged: .* 2 orders fit alike"),
        (
            lambda folder: counted(folder, gyro=0.5 / DEG),
            r"2 causes explain gyro scale alike: 1: the rates .* 2: the samples were counted at",
        ),
    ],
)
def test_what_check_does_not_know_is_not_repaired(tmp_path, spoil, says):
    with pytest.raises(CalibrationError, match=says):
        repair(spoil(tmp_path / "spoilt"), tmp_path / "new" / "copy")
    assert [path.name for path in tmp_path.iterdir()] == ["spoilt"]


def test_samples_counted_at_another_rate_of_the_sensor_are_put_on_its_clock(tmp_path):
    truth = Table().tumble(8, rest_s=1.5, seed=5).samples(odr_hz=125.0)
    toml = PHYSICAL.replace("unknown", "MPU-9250").replace("52.0", "100.0")
    (change,) = repair(counted(tmp_path / "spoilt", replace(truth, t_ns=truth.t_ns * 5 // 4), toml=toml), tmp_path / "copy").changes
    assert change.cause.description == "the samples were counted at 100 Hz, and came at 125"
    session = read_session(tmp_path / "copy")
    assert session.config.sensor.odr_hz == 125
    np.testing.assert_array_equal(session.logs[0].samples.t_ns, truth.t_ns)


def test_several_causes_that_explain_alike_are_listed_and_one_can_be_chosen(tmp_path, run):
    """Two signs of the gyroscope are one sign of the accelerometer, to gravity; no file is written over."""
    spoilt = written(tmp_path / "spoilt", gyro=np.diag([-1, -1, 1]) / DEG)
    code, _, err = run("check", spoilt, "--repair", tmp_path / "copy")
    assert code == 2
    assert "2 causes explain axes alike: 1: the gyro's x and y have the wrong sign; 2: the accelerometer's z has the wrong sign" in err
    assert run("check", spoilt, "--repair", tmp_path / "copy", "--cause", 3)[0] == run("check", spoilt, "--cause", 1)[0] == 2
    assert not (tmp_path / "copy").exists()
    assert run("check", spoilt, "--repair", tmp_path / "copy", "--cause", 1, "--json", tmp_path / "x.json")[0] == 0
    done = json.loads((tmp_path / "x.json").read_text())
    assert done.items() >= json.loads((tmp_path / "copy" / "repaired.json").read_text()).items()
    assert done["closure"]["before"]["scale"] is None  # gravity and rates do not agree
    assert strangers(done) == []
    np.testing.assert_allclose(read_session(tmp_path / "copy").logs[0].samples.gyro, SAMPLES.gyro, atol=1e-12)
    code, _, err = run("check", spoilt, "--repair", tmp_path / "copy")
    assert (code, "exists; give --repair a new folder" in err) == (2, True)


def test_closure_runs_packed_logs_comments_and_settings_follow_and_nothing_else_is_touched(tmp_path):
    """What could not be examined by itself is of the same logger; a log's own comment agrees with the setting."""
    toml = '# mine\nsensor.odr_hz = 52.0\nsensor.model = "unknown"\nsensor.gyro_fs_dps = 250 # sic\nsensor.accel_fs_g = 4\n'
    toml = 'schema = "tinygc-session/1"\n' + toml + '[notes]\nrepaired = "by hand"\n'
    spoilt = written(tmp_path / "spoilt", gyro=0.5 / DEG)
    (spoilt / "session.toml").write_bytes(toml.replace("\n", "\r\n").encode())
    text = "# gyro_fs_dps=250 serial=42\n" + (spoilt / "log0001.csv").read_text()
    (spoilt / "log0001.csv").unlink()
    (spoilt / "log0001.csv.gz").write_bytes(gzip.compress(text.encode()))
    run = Table().rest(2).turn(180, (0, 0, 1)).turn(-180, (0, 0, 1)).rest(2).samples(odr_hz=52.0)
    written(tmp_path / "run", run, gyro=0.5 / DEG)
    (tmp_path / "run" / "log0001.csv").rename(spoilt / "closure0001.csv")
    (spoilt / "notes.txt").write_text("not read by any command")
    done = repair(spoilt, tmp_path / "copy")
    assert done.changes[0].files == ("log0001.csv.gz", "closure0001.csv")
    assert {path.name for path in (tmp_path / "copy").iterdir()} == {"closure0001.csv", "log0001.csv.gz", "repaired.json", "session.toml"}
    session = read_session(tmp_path / "copy")
    assert session.logs[0].comments["gyro_fs_dps"] == "500"
    np.testing.assert_allclose(session.closures[0].samples.gyro, run.gyro, rtol=1e-12)
    expected = toml.replace("250", "500").splitlines()
    assert (tmp_path / "copy" / "session.toml").read_text().splitlines()[: len(expected)] == expected
    assert session.config.notes["repaired2"].startswith("the rates are 0.5 times the true ones")


def test_a_register_at_its_lowest_end_turns_into_the_highest_which_is_one_less():
    names, write = _columns(["gx", "gy", "gz"], Correction("", "gyro", axes=((-1, 0, 0), (0, 1, 0), (0, 0, 1))), [])
    assert (names, [write([x, "5", "6"])[0] for x in ("-32768", "-32767", "-32766")]) == (["gx", "gy", "gz"], ["32767", "32767", "32766"])


def test_an_axis_that_turns_against_itself_is_an_error_of_the_fit(tmp_path):
    """What a first look that was passed over leaves: least squares would call it a misalignment of 3141 mrad."""
    samples = Table().tumble(8, rest_s=1.5, seed=5).samples(odr_hz=52.0)
    session = read_session(written(tmp_path / "mirrored", samples, gyro=np.diag([1, 1, -1]) / DEG))
    with pytest.raises(FitError, match=r"the turns require rates of z times -\d\.\d+, expected about 1: gyro z has"):
        build_problem(session)
