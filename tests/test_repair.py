"""``check --repair``: what check has found is undone in a copy, which is fitted like the recording that was never spoilt."""

import gzip
import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, SESSION_TOML, Table, broad, write_session
from recorded_files import write_sundevil

import tinygc
from session.io.errors import CalibrationError, FitError
from session.replay.repair import repair
from tinygc.closure.build import build_problem

G = 9.80665
PHYSICAL = SESSION_TOML.replace("ASM330LHH", "unknown")


@pytest.fixture(scope="module")
def samples():
    return Table().tumble(14, rest_s=1.5, seed=5).samples(odr_hz=104.0)


def written(folder, samples, toml=PHYSICAL, header="t_ns,gx_dps,gy_dps,gz_dps,ax_mps2,ay_mps2,az_mps2", time=1, gyro=1 / DEG, accel=1.0):
    """A session folder in physical units: t_ns over ``time``; rates and forces times numbers or matrices."""
    folder.mkdir()
    rates, forces = (values @ np.diag([1.0] * 3).dot(factor) for values, factor in ((samples.gyro, gyro), (samples.accel, accel)))
    rows = [
        ",".join(map(repr, [int(t // time), *rate, *force]))
        for t, rate, force in zip(samples.t_ns, rates.tolist(), forces.tolist(), strict=True)
    ]
    (folder / "log0001.csv").write_text("\n".join([header, *rows]) + "\n")
    (folder / "session.toml").write_text(toml.replace("208.0", "104.0"))
    return folder


def registers(folder, samples, old="", new=""):
    return write_session(folder, samples, toml=SESSION_TOML.replace("208.0", "104.0").replace(old, new))


X_Y, MIRRORED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]]), np.diag([1, 1, -1])
SPOILT = {
    "full scale": lambda folder, s: registers(folder, s, "gyro_fs_dps = 500", "gyro_fs_dps = 250"),
    "accelerometer's full scale": lambda folder, s: registers(folder, s, "accel_fs_g = 4", "accel_fs_g = 16"),
    "data rate": lambda folder, s: registers(folder, s, "104.0", "208.0"),
    "half rates": lambda folder, s: written(folder, s, gyro=0.5 / DEG),
    "degrees as radians": lambda folder, s: written(
        folder, s, PHYSICAL.replace("= 500", "= 50000"), "t_ns,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2"
    ),
    "radians as degrees": lambda folder, s: written(folder, s, gyro=1.0),
    "x and y exchanged": lambda folder, s: written(folder, s, gyro=X_Y / DEG),
    "z mirrored": lambda folder, s: written(folder, s, gyro=MIRRORED / DEG),
    "g as m/s2": lambda folder, s: written(folder, s, accel=1 / G),
    "us as ns": lambda folder, s: written(folder, s, time=1000),
    "ms as us": lambda folder, s: written(folder, s, header="t_us,gx_dps,gy_dps,gz_dps,ax_mps2,ay_mps2,az_mps2", time=1_000_000),
    "stamps twice too fast": lambda folder, s: written(folder, s, PHYSICAL.replace("unknown", "ASM330LHH"), time=2),
    "time and rates": lambda folder, s: written(folder, s, time=1000, gyro=0.5 / DEG),
}
#: files whose bytes a declaration alone puts right
DECLARED = ("full scale", "accelerometer's full scale", "data rate")
#: where a column's name says its unit and its axis, the header alone is changed: numbers stay as they are written
HEADERS = {
    "degrees as radians": "t_ns,gx_dps,gy_dps,gz_dps,ax_mps2,ay_mps2,az_mps2",
    "x and y exchanged": "t_ns,gy_dps,gx_dps,gz_dps,ax_mps2,ay_mps2,az_mps2",
    "g as m/s2": "t_ns,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g",
    "us as ns": "t_us,gx_dps,gy_dps,gz_dps,ax_mps2,ay_mps2,az_mps2",
}
QUICK = ("full scale", "x and y exchanged", "us as ns")


@pytest.fixture(scope="module")
def right(samples, tmp_path_factory):
    return fitted(written(tmp_path_factory.mktemp("right") / "right", samples))


def fitted(folder):
    return tinygc.fit(folder, methods=("least_squares",)).parameters


@pytest.mark.parametrize("name", [name if name in QUICK else broad(name) for name in SPOILT])
def test_what_was_spoilt_is_undone_and_fitted_as_if_it_never_was(samples, right, tmp_path, name):
    spoilt = SPOILT[name](tmp_path / "spoilt", samples)
    before = {path.name: path.read_bytes() for path in spoilt.iterdir()}
    with pytest.raises(CalibrationError):
        tinygc.fit(spoilt, methods=("least_squares",))
    done = repair(spoilt, tmp_path / "copy")
    assert not [finding.line for finding in done.findings if finding.level == "error"]
    assert {path.name: path.read_bytes() for path in spoilt.iterdir()} == before
    sigmas = 3 if name == "ms as us" else 0.05  # whole ms; else what another noise of the sensor's model weighs otherwise
    for key, estimate in fitted(tmp_path / "copy").items():
        assert estimate.value == pytest.approx(right[key].value, abs=sigmas * estimate.sigma)
    table = json.loads((tmp_path / "copy" / "repaired.json").read_text())
    assert table["sha256"] == {file: hashlib.sha256(data).hexdigest() for file, data in before.items()}
    assert ((tmp_path / "copy" / "log0001.csv").read_bytes() == before["log0001.csv"]) == (name in DECLARED)
    assert "repaired" in tinygc.read_session(tmp_path / "copy").config.notes
    if name in HEADERS:
        first, rows = (tmp_path / "copy" / "log0001.csv").read_bytes().decode().split("\n", 1)
        assert (first, rows) == (HEADERS[name], before["log0001.csv"].decode().split("\n", 1)[1])


@pytest.mark.broad
def test_several_causes_that_explain_alike_are_listed_and_one_can_be_chosen(samples, right, tmp_path, run):
    """Two signs of the gyroscope are one sign of the accelerometer, to gravity."""
    spoilt = written(tmp_path / "spoilt", samples, gyro=np.diag([-1, -1, 1]) / DEG)
    code, _, err = run("check", spoilt, "--repair", tmp_path / "copy")
    assert code == 2
    assert "2 causes explain axes alike: 1: the gyro's x and y have the wrong sign; 2: the accelerometer's z has the wrong sign" in err
    assert not (tmp_path / "copy").exists()
    assert run("check", spoilt, "--repair", tmp_path / "copy", "--cause", 3)[0] == 2
    code, out, _ = run("check", spoilt, "--repair", tmp_path / "copy", "--cause", 1)
    assert code == 0
    assert "corrected: the gyro's x and y have the wrong sign (log0001.csv)" in out
    assert all(each.value == pytest.approx(right[key].value, abs=1e-9) for key, each in fitted(tmp_path / "copy").items())


@pytest.mark.broad
def test_samples_counted_at_a_wrong_rate_are_no_more_likely_than_a_wrong_full_scale(samples, tmp_path):
    spoilt = written(tmp_path / "spoilt", samples, gyro=0.5 / DEG)
    log = spoilt / "log0001.csv"
    log.write_text("# stamps=counted\n" + log.read_text())
    with pytest.raises(CalibrationError, match=r"2 causes explain gyro scale alike: 1: the rates .* 2: the samples were counted at"):
        repair(spoilt, tmp_path / "copy")


@pytest.mark.broad
def test_samples_counted_at_another_rate_of_the_sensor_are_put_on_its_clock(tmp_path):
    truth = Table().tumble(9, rest_s=1.5, seed=5).samples(odr_hz=125.0)
    counted = replace(truth, t_ns=truth.t_ns * 5 // 4)
    spoilt = written(tmp_path / "spoilt", counted, SESSION_TOML.replace("ASM330LHH", "MPU-9250").replace("208.0", "100.0"))
    log = spoilt / "log0001.csv"
    log.write_text("# stamps=counted\n" + log.read_text())
    (change,) = repair(spoilt, tmp_path / "copy").changes
    assert change.cause.says == "the samples were counted at 100 Hz, and came at 125"
    session = tinygc.read_session(tmp_path / "copy")
    assert session.config.sensor.odr_hz == 125
    np.testing.assert_array_equal(session.logs[0].samples.t_ns, truth.t_ns)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda folder, s: written(folder, s), "nothing to repair: check finds no error"),
        (
            lambda folder, s: written(folder, s, gyro=0.63 / DEG),
            "no cause is determined: log0001.csv: gyro scale: gravity requires",
        ),
        (lambda folder, s: written(folder, s, accel=np.zeros((3, 3))), "no cause is determined"),
    ],
)
def test_what_check_does_not_know_is_not_repaired(samples, tmp_path, spoil, says):
    with pytest.raises(CalibrationError) as refused:
        repair(spoil(tmp_path / "spoilt", samples), tmp_path / "new" / "copy")
    assert says in str(refused.value)
    assert [path.name for path in tmp_path.iterdir()] == ["spoilt"]


def test_no_file_is_written_over(samples, tmp_path, run):
    spoilt = SPOILT["half rates"](tmp_path / "spoilt", samples)
    (tmp_path / "copy").mkdir()
    code, _, err = run("check", spoilt, "--repair", tmp_path / "copy")
    assert (code, "exists; give --repair a new folder" in err) == (2, True)
    assert run("check", spoilt, "--cause", 1)[0] == 2


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_a_session_toml_stays_as_it_is_written_but_for_what_was_wrong(samples, tmp_path, ends):
    toml = '# mine\nsensor.odr_hz = 104.0\nsensor.model = "unknown"\nsensor.gyro_fs_dps = 250 # sic\nsensor.accel_fs_g = 4\n'
    toml = 'schema = "tinygc-session/1"\n' + toml + '[notes]\nrepaired = "by hand"\n'
    spoilt = written(tmp_path / "spoilt", samples, gyro=0.5 / DEG)
    (spoilt / "session.toml").write_bytes(toml.replace("\n", ends).encode())
    repair(spoilt, tmp_path / "copy")
    expected = toml.replace("250", "500").splitlines()
    assert (tmp_path / "copy" / "session.toml").read_text().splitlines()[: len(expected)] == expected
    assert tinygc.read_session(tmp_path / "copy").config.notes["repaired2"].startswith("the rates are 0.5 times the true ones")


@pytest.mark.broad
def test_closure_runs_rests_packed_logs_and_comments_follow(samples, tmp_path):
    """What could not be examined by itself is of the same logger; a log's own comment agrees with the setting."""
    spoilt = written(tmp_path / "spoilt", samples, gyro=0.5 / DEG)
    text = "# gyro_fs_dps=500 serial=42\n" + (spoilt / "log0001.csv").read_text()
    (spoilt / "log0001.csv").unlink()
    (spoilt / "log0001.csv.gz").write_bytes(gzip.compress(text.encode()))
    run = Table().rest(2).turn(180, (0, 0, 1)).turn(-180, (0, 0, 1)).rest(2).samples(odr_hz=104.0)
    written(tmp_path / "run", run, gyro=0.5 / DEG)
    (tmp_path / "run" / "log0001.csv").rename(spoilt / "closure0001.csv")
    (spoilt / "notes.txt").write_text("not read by any command")
    done = repair(spoilt, tmp_path / "copy")
    assert done.changes[0].files == ("log0001.csv.gz", "closure0001.csv")
    assert sorted(path.name for path in (tmp_path / "copy").iterdir()) == [
        "closure0001.csv",
        "log0001.csv.gz",
        "repaired.json",
        "session.toml",
    ]
    session = tinygc.read_session(tmp_path / "copy")
    assert session.logs[0].comments["gyro_fs_dps"] == "1000"
    np.testing.assert_allclose(session.closures[0].samples.gyro, run.gyro, rtol=1e-12)


@pytest.mark.parametrize(("name", "before", "after"), [broad("Long", 40, 5), broad("Short", 40, 10)])
def test_the_rockets_board_whose_authors_did_not_know_it(shared, tmp_path, run, name, before, after):
    source = shared / "wild" / "sundevil" / "rev2" / f"IMU_Rev2_Data_{name}.txt"
    if not source.exists():
        pytest.skip(f"no recording: {source} is not there")
    folder = write_sundevil(source, tmp_path / name)
    code, out, _ = run("check", folder, "--repair", tmp_path / "copy", "--json", tmp_path / "repair.json")
    assert code == 0
    assert "the rates are 0.5 times the true ones: the full scale is 500 dps, not 250" in out
    table = json.loads((tmp_path / "repair.json").read_text())
    raw = {when: table["closure"][when]["holdout_tilt_rms_deg"]["raw_bias_removed"] for when in ("before", "after")}
    assert raw["before"] > before
    assert raw["after"] < after
    assert np.allclose(table["closure"]["before"]["scale"], 2, atol=0.1)
    assert np.allclose(table["closure"]["after"]["scale"], 1, atol=0.05)


def test_a_repair_after_which_nothing_closes_is_none(samples, tmp_path):
    """z never turns and two signs are wrong: two orders fit, so there is no cause to undo, and no copy."""
    table, rng = Table().rest(1.5), np.random.default_rng(5)
    for _ in range(12):
        table.turn(rng.uniform(90, 200), rng.normal(size=3) * [1, 1, 0], 3.0).rest(1.5)
    spoilt = written(tmp_path / "spoilt", table.samples(odr_hz=104.0), gyro=np.diag([-1, -1, 1]) / DEG)
    with pytest.raises(CalibrationError, match=r"no cause is determined: log0001\.csv: axes: not as logged: .* 2 orders fit alike"):
        repair(spoilt, tmp_path / "copy")
    assert not (tmp_path / "copy").exists()


@pytest.mark.parametrize("axis", [0, 2])
def test_an_axis_that_turns_against_itself_is_an_error_of_the_fit(samples, axis, tmp_path):
    """What a first look that was passed over leaves: least squares would call it a misalignment of 3141 mrad."""
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    session = tinygc.read_session(written(tmp_path / "mirrored", samples, gyro=np.diag(signs) / DEG))
    with pytest.raises(
        FitError, match=rf"the turns require rates of {'xyz'[axis]} times -\d\.\d+, expected about 1: gyro {'xyz'[axis]} has"
    ):
        build_problem(session)
