"""Faults of hardware and firmware: each is known by its signature, said alone where it explains the rest, and seen in nothing sound."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from looks import G, with_sensor
from scipy.signal import butter, lfilter

from session.detect.signatures import _NEW_ZERO, FILTER, TRACKED, check_signatures
from session.log.registers import accel_mps2_per_lsb, gyro_rps_per_lsb

ZERO = np.array([0.56, -0.28, 0.42])


@pytest.fixture(scope="module")
def sound():
    """Fifteen turns at 104 Hz, not rounded to registers."""
    samples = Table().tumble(15).samples(odr_hz=104.0, registers=False, bias_dps=tuple(ZERO))
    return session_of(samples, odr_hz=104.0)


def found(session, **changes):
    log = session.logs[0]
    return check_signatures(replace(log, samples=replace(log.samples, **changes)), session.config.sensor)


def rates(session):
    """dps, without the zero."""
    return session.logs[0].samples.gyro / DEG - ZERO


def tracked(rate, tau_s):
    """The zero drawn to 0 while the sensor rests; it wanders."""
    drift = 0.2 * np.sin(np.arange(len(rate))[:, None] / 104 / 20 + np.arange(3))
    zero, run, out = np.zeros(3), 0, np.empty_like(rate)
    for i, read in enumerate(rate + ZERO + drift):
        run = run + 1 if np.linalg.norm(rate[i]) < 1 else 0
        zero = zero + (read - zero) / (tau_s * 104) if run > 0.3 * 104 else zero
        out[i] = read - zero
    return out


def with_band(rate, axis, width, noise):
    rate = rate.copy()
    rate[:, axis] = np.where(np.abs(rate[:, axis]) < width, 0, rate[:, axis]) + noise * np.random.default_rng(1).normal(size=len(rate))
    return rate


def high_passed(rate, axis, hz):
    rate = rate.copy()
    rate[:, axis] = lfilter(*butter(1, hz, "highpass", fs=104), rate[:, axis])
    return rate


def from_row(rate, row, change):
    return np.concatenate([rate[:row], change(rate)[row:]])


def mean_of(count):
    return lambda rate: lfilter(np.ones(count) / count, 1, rate, axis=0)


FAULTS = {
    "gate": (lambda w: np.where(np.abs(w) < [0.6, 1.0, 0.4], 0, w), "dead band", "x, y, z stand at 0 dps"),
    "gate of all": (lambda w: w * (np.linalg.norm(w, axis=1) > 0.8)[:, None], "dead band", "all others beyond 0.8"),
    "dead band": (lambda w: with_band(w, 1, 1.0, 0.02), "dead band", "y stands at"),
    "high-pass": (lambda w: high_passed(w, 2, 0.05) + ZERO, "high-pass", "the rate of z is less by the angle turned over 3.1"),
    "slow high-pass": (lambda w: high_passed(w, 0, 0.002) + ZERO, "high-pass", "a high-pass of 0.0019 Hz"),
    "tracked": (lambda w: tracked(w, 1.5), TRACKED, "at rest x, y, z are drawn to 0 with 1."),
    "new zero": (lambda w: from_row(w + ZERO, 4000, lambda w: w - ZERO), _NEW_ZERO, "the zero steps by -0.5"),
    "full scale": (lambda w: from_row(w, 3000, lambda w: 0.5 * w), "gyro range", "the rates are 0.5 times what they were"),
    "filter of one axis": (
        lambda w: from_row(w, 4000, lambda w: w * [1, 1, 0] + mean_of(4)(w) * [0, 0, 1]),
        FILTER,
        "neighbouring readings of z",
    ),
    "few values on the way": (
        lambda w: from_row(w, 5000, lambda w: -0.07 * (w > 0)),
        "few values",
        "reads 2 values only in 38% of the log, the first at 48 s",
    ),
    "few values": (lambda w: np.where(w > 0, 989.0, 0.0), "few values", "the gyro reads 2 values only, 0, 989 dps"),
}


@pytest.mark.parametrize(("spoil", "what", "says"), FAULTS.values(), ids=FAULTS)
def test_a_fault_is_known_by_its_signature(sound, spoil, what, says):
    (finding,) = found(sound, gyro=spoil(rates(sound)) * DEG)
    assert finding.what == what
    assert says in finding.description
    assert finding.do


@pytest.mark.parametrize("filtered", [mean_of(5), lambda w: lfilter(*butter(2, 10, fs=104), w, axis=0)], ids=["mean", "low-pass"])
def test_a_filter_that_changes_is_named_with_its_row(sound, filtered):
    (finding,) = found(sound, gyro=from_row(rates(sound) + ZERO, 2500, filtered) * DEG)
    assert (finding.what, finding.level) == (FILTER, "warning")
    assert int(finding.description.split()[2]) == pytest.approx(2500, abs=12)  # the filter's own length


def exchanged(registers):
    return ((registers & 0xFF) << 8 | registers >> 8 & 0xFF).astype(np.uint16).astype(np.int16)


@pytest.mark.parametrize("axes", [(True, True, True), (False, True, False)])
def test_exchanged_bytes_are_named_axis_by_axis(sound, axes):
    unit, samples = gyro_rps_per_lsb(500), sound.logs[0].samples
    gyro, accel = np.rint(samples.gyro / unit).astype(np.int64), np.rint(samples.accel / accel_mps2_per_lsb(4)) * accel_mps2_per_lsb(4)
    assert not found(sound, gyro=gyro * unit, accel=accel)
    (finding,) = found(sound, gyro=np.where(axes, exchanged(gyro), gyro) * unit, accel=accel)
    assert (finding.what, finding.level) == ("byte order", "error")
    assert finding.description.startswith(f"gyro ({'x, y, z' if all(axes) else 'y'}): ")
    left_justified = np.clip(gyro // 128, -128, 127) << 8  # eight bits
    assert not found(sound, gyro=left_justified * unit, accel=accel)


@pytest.mark.parametrize(("end", "coarser"), [(62.5, 1), (32767 * 4.375e-3, 8)])
def test_a_register_that_comes_round_is_found_without_its_sensor(sound, end, coarser):
    unknown = with_sensor(sound, model="unknown", gyro_fs_dps=500.0)
    gyro = sound.logs[0].samples.gyro / DEG * end / 70
    gyro = (gyro[::coarser] + end) % (2 * end) - end
    samples = sound.logs[0].samples.pick(slice(None, None, coarser))
    (finding,) = check_signatures(replace(unknown.logs[0], samples=replace(samples, gyro=gyro * DEG)), unknown.config.sensor)
    assert finding.what == "gyro wraps"
    assert f"comes round at ±{end:.4g} dps" in finding.description


def test_a_high_pass_that_takes_next_to_nothing_within_the_log_is_none(sound, monkeypatch):
    gyro = (high_passed(rates(sound), 0, 1e-4) + ZERO) * DEG
    assert not found(sound, gyro=gyro)
    monkeypatch.setattr("session.detect.signatures.LEAST_TAKEN", 0.0)
    assert [finding.what for finding in found(sound, gyro=gyro)] == ["high-pass"]


@pytest.mark.parametrize(("step", "zero"), [(0.5, ZERO), (1.0, 0 * ZERO)])
def test_a_coarse_register_is_no_dead_band(sound, step, zero):
    assert not found(sound, gyro=np.rint((rates(sound) + zero) / step) * step * DEG)


FIRMWARE, EITHER = "the sensor or its firmware tracks its zero", "or the mount creeps"


@pytest.mark.parametrize(
    ("tau_s", "turned", "noise_g", "says"),
    [(0.5, 1, 0, ""), (1, 0, 0, FIRMWARE), (0.5, 1, 0.005, EITHER)],
)
def test_a_mount_that_creeps_is_told_from_a_zero_that_is_tracked(sound, tau_s, turned, noise_g, says):
    samples, rows = sound.logs[0].samples, np.arange(len(sound.logs[0].samples))
    moves = np.linalg.norm(rates(sound), axis=1) > 1
    since_s = (rows - np.maximum.accumulate(np.where(moves, rows, 0)))[:, None] / 104
    creep = np.array([0.3, -0.25, 0.25]) * (since_s > 0) * np.exp(-since_s / tau_s)
    angle = np.array([0.3, -0.25, 0.25]) * tau_s * (1 - np.exp(-since_s / tau_s)) * DEG * turned
    noise = np.random.default_rng(6).normal(size=angle.shape) * noise_g * G
    findings = found(sound, gyro=(rates(sound) + creep) * DEG, accel=samples.accel + np.cross(samples.accel, angle) + noise)
    assert [each.what for each in findings] == [TRACKED] * bool(says)
    assert all(each.description.endswith(says) for each in findings)


def test_what_drifts_or_vibrates_is_none_of_them(sound):
    t_s = sound.logs[0].samples.t_s[:, None]
    rate = rates(sound) + ZERO
    assert not found(sound, gyro=(rate + np.exp(-t_s / 40)) * DEG)  # warms up
    moves = np.linalg.norm(rates(sound), axis=1) > 1
    since_s = t_s[:, 0] - np.maximum.accumulate(np.where(moves, t_s[:, 0], 0.0))
    assert not found(sound, gyro=(rates(sound) + 0.5 * np.exp(-since_s / 0.15)[:, None] * [0, 1, 0]) * DEG)  # the end of a turn
    assert not found(sound, gyro=from_row(rate, 4000, lambda w: w + 0.1 * np.sin(2 * np.pi * 17 * t_s)) * DEG)
    held = np.arange(len(rate)) // 4 * 4
    assert not found(sound, gyro=rate[held] * DEG)


def test_an_accelerometer_that_answers_two_values(sound):
    (finding,) = found(sound, accel=np.where(sound.logs[0].samples.accel > 0, G, 0.0))
    assert finding.description.startswith("the accelerometer reads 2 values only, 0, 1 g")
