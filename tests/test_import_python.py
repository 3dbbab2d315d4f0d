"""``tinygc.import_log`` and ``tinygc.read_log``: the same log as the command reads, and answers that are checked."""

import numpy as np
import pytest
from dialect_logs import ACCEL, GYRO, SAMPLES, T_US, rows

import tinygc

TOLD = {"gyro_unit": "dps", "accel_unit": "g"}
HEAD = "time_ms,accX,accY,accZ,gyroX,gyroY,gyroZ\n"
USUAL = HEAD + rows(T_US / 1e3, *ACCEL["g"].T, *GYRO["dps"].T)


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "sketch.csv"
    path.write_text(USUAL)
    return path


# The same session


def test_samples_that_were_counted_stay_so(tmp_path):
    """A nominal rate is in the sigmas of E and B: some thousand times those of the noise."""
    session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session
    samples = session.logs[0].samples
    path = tmp_path / "counted.csv"
    path.write_text("gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2\n" + rows(*samples.gyro[:].T, *samples.accel[:].T))
    columns = ",".join(f"{kind}{axis}_{unit}={kind}{axis}_{unit}" for kind, unit in (("g", "rps"), ("a", "mps2")) for axis in "xyz")
    told = {"odr_hz": 104.0, "gyro_fs_dps": 500.0, "accel_fs_g": 4.0, "sensor": "ASM330LHH", "columns": columns}
    read, made = tinygc.read_log(path, **told), tinygc.import_log(path, tmp_path / "s", **told)
    assert (read.counted, read.sensor, read.odr_hz) == (True, "ASM330LHH", 104.0)
    ours, theirs = read.session(), made.session
    assert ours.config.sensor == theirs.config.sensor
    assert ours.nominal_rate == theirs.nominal_rate
    fits = [tinygc.fit(each, methods=("least_squares",)) for each in (ours, theirs)]
    sigmas = [np.array([each.sigma for each in fit.parameters.values()]) for fit in fits]
    np.testing.assert_allclose(sigmas[0], sigmas[1], rtol=1e-6)
    assert sigmas[0].max() > 1e-3


def test_a_log_that_is_calibrated_stays_so(tmp_path, log):
    log.write_text("# calibrated=gyro\n" + USUAL)
    (made,), (read,) = tinygc.import_log(log, tmp_path / "s", **TOLD).session.logs, tinygc.read_log(log, **TOLD).session().logs
    assert read.comments == made.comments
    assert read.comments["calibrated"] == "gyro"


def test_what_import_refuses_is_refused(tmp_path, log):
    with pytest.raises(tinygc.CalibrationError, match="no sensor has less than"):
        tinygc.read_log(log, **TOLD, time_unit="ns")
    log.write_text("# gyro_fs_dps=nan\n" + USUAL)
    with pytest.raises(tinygc.CalibrationError, match="gyro_fs_dps") as refused:
        tinygc.read_log(log, **TOLD)
    assert "read-log-" not in str(refused.value)


def test_rows_that_repeat_a_stamp_are_left_out(tmp_path, log):
    head, *body = USUAL.splitlines()
    log.write_text("\n".join([head, *body[:500], body[499], *body[500:]]) + "\n")
    read, made = tinygc.read_log(log, **TOLD), tinygc.import_log(log, tmp_path / "s", **TOLD)
    assert len(read.t_s) == len(SAMPLES) == len(made.session.logs[0].samples)
    np.testing.assert_allclose(read.gyro_rps, SAMPLES.gyro, atol=1e-10)


# Answers


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"gyro_fs_dps": "500"}, "gyro_fs_dps is '500', expected a number above 0"),
        ({"odr_hz": "105"}, "odr_hz is '105', expected a number above 0"),
        ({"odr_hz": 0}, "odr_hz is 0, expected a number above 0"),
        ({"gyro_fs_dps": float("nan")}, "gyro_fs_dps is nan, expected a number above 0"),
        ({"gyro_unit": 5}, "gyro_unit is 5, expected text, as 'dps'"),
        ({"columns": 5}, "columns is 5, expected a list of words"),
        ({"columns": [5]}, r"columns is \[5\], expected a list of words"),
        ({"where": 5}, "where is 5, expected text, as 'id=0'"),
        ({"lines": (1, 5)}, r"lines is \(1, 5\), expected text, as '1-2991'"),
        ({"like": 5}, "like is 5, expected text"),
    ],
)
def test_an_answer_of_another_kind_is_refused_in_one_line(told, said, log, tmp_path):
    for call in (lambda **all_: tinygc.read_log(log, **all_), lambda **all_: tinygc.import_log(log, tmp_path / "s", **all_)):
        with pytest.raises(tinygc.CalibrationError, match=said) as refused:
            call(**(TOLD | told))
        assert "\n" not in str(refused.value)
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("told", "said"), [({"add": "foo"}, "add"), ({"serial": 5}, "serial is 5, expected text"), ({"turns": 5}, "a path")]
)
def test_an_argument_of_another_kind_is_refused_in_one_line(told, said, log, tmp_path):
    with pytest.raises(tinygc.CalibrationError, match=said):
        tinygc.import_log(log, tmp_path / "s", **TOLD, **told)
    with pytest.raises(tinygc.CalibrationError, match="from_arrays: no option 'foo'"):
        tinygc.read_log(log, **TOLD).session(foo=1)
