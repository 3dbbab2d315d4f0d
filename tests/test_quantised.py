"""A register whose steps hide the gyro's noise is said as quantisation, not as a table that vibrates."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import Table, session_of
from looks import look, of

import calibrate
from session.detect.first_look import check_session
from session.io.registers import accel_mps2_per_lsb, gyro_rps_per_lsb
from session.io.units import MG
from tinygc import read_session


def recorded(gyro_fs_dps, odr_hz, mdps=5.0, bias_dps=(0.56, -0.28, 0.42)):
    samples = Table().tumble(15).samples(odr_hz=odr_hz, gyro_mdps=mdps, registers=False, bias_dps=bias_dps)
    gyro, accel = gyro_rps_per_lsb(gyro_fs_dps), accel_mps2_per_lsb(4)
    samples = replace(samples, gyro=np.rint(samples.gyro / gyro) * gyro, accel=np.rint(samples.accel / accel) * accel)
    return session_of(samples, odr_hz=odr_hz, gyro_fs_dps=gyro_fs_dps)


@pytest.mark.parametrize(("gyro_fs_dps", "odr_hz", "step"), [(4000, 26.0, "140"), (4000, 12.5, "140"), (2000, 26.0, "70")])
def test_steps_above_the_noise_are_quantisation(gyro_fs_dps, odr_hz, step):
    findings = check_session(recorded(gyro_fs_dps, odr_hz))
    finding = of(findings, "quantisation")
    assert finding.level == "error"
    assert f"moves in steps of {step} mdps" in finding.says
    assert "the steps are larger than its noise" in finding.says
    assert "choose a smaller full scale" in finding.do
    assert not [each for each in findings if "vibrat" in each.do + each.says]


def test_the_first_error_that_fit_says_is_quantisation(tmp_path, capsys):
    samples = recorded(4000, 26.0).logs[0].samples
    values = np.column_stack([samples.gyro * 180 / np.pi, samples.accel / 9.80665])
    rows = [f"{t}," + ",".join(map(repr, map(float, row))) for t, row in zip(samples.t_ns, values, strict=True)]
    (tmp_path / "log0001.csv").write_text("t_ns,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + "\n".join(rows) + "\n")
    (tmp_path / "session.toml").write_text('schema = "tinygc-session/1"\n[sensor]\nodr_hz = 26\ngyro_fs_dps = 4000\naccel_fs_g = 4\n')
    assert calibrate.main(["fit", str(tmp_path), "--quiet"]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("calibrate:")]
    assert "quantisation" in line
    assert "vibrat" not in line


@pytest.mark.parametrize(("step_mg", "axes", "coarse"), [(31.2, "x, y, z", [1, 1, 1]), (7.8, "y", [0, 1, 0])])
def test_an_accelerometer_that_repeats_one_reading_in_each_still_is_said_before_anything_is_fitted(step_mg, axes, coarse):
    """Noise of 60 ug/rtHz is 0.6 mg at 208 Hz: steps of half of it leave its scatter, steps of ten times hide it."""
    session = recorded(500, 208.0)
    samples, step = session.logs[0].samples, step_mg * MG
    rounded = np.where(coarse, np.rint(samples.accel / step) * step, samples.accel)
    finding = of(check_session(session_of(replace(samples, accel=rounded), odr_hz=208.0, gyro_fs_dps=500)), "quantisation")
    assert finding.level == "error"
    assert finding.says.startswith(f"the accelerometer ({axes}) moves in steps of {step_mg:g} mg")
    fine = replace(samples, accel=np.rint(samples.accel / (0.3 * MG)) * 0.3 * MG)
    assert "quantisation" not in {each.what for each in check_session(session_of(fine, odr_hz=208.0, gyro_fs_dps=500))}


@pytest.mark.parametrize("axes", [[True, True, True], [True, False, False]])
def test_a_gyro_that_never_moves_is_stuck_or_quantised_and_nothing_vibrates(good, axes):
    gyro = np.where(axes, 0.01, good.logs[0].samples.gyro)
    findings = look(good, gyro=gyro)
    assert "quantisation" in of(findings, "gyro stuck").do
    assert "stills" not in {each.what for each in findings}
    assert not [each for each in findings if "vibrat" in each.do + each.says]


@pytest.mark.parametrize(("gyro_fs_dps", "odr_hz"), [(500, 26.0), (2000, 104.0), (4000, 208.0)])
def test_steps_below_the_noise_are_not(gyro_fs_dps, odr_hz):
    assert "quantisation" not in {each.what for each in check_session(recorded(gyro_fs_dps, odr_hz))}


def test_a_table_that_does_vibrate_is_still_asked_for(good):
    samples = good.logs[0].samples
    shaken = samples.gyro + 0.3 * np.random.default_rng(1).normal(size=samples.gyro.shape) * (1 + np.sin(3 * samples.t_s))[:, None]
    findings = look(good, gyro=shaken)
    assert "quantisation" not in {each.what for each in findings}


@pytest.mark.broad
def test_no_real_recording_is_quantised(shared):
    found = [shared / name for name in ("xsens", "mikov/imu0", "mikov/imu2", "mikov/imu4") if (shared / name / "session.toml").exists()]
    if not found:
        pytest.skip("no recordings in ../shared")
    for folder in found:
        assert "quantisation" not in {each.what for each in check_session(read_session(folder))}
