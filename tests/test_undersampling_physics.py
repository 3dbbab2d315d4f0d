"""What readings miss of motion that is faster than half their rate: the law against a fine integral, and its line of a first look."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, config
from looks import G

from session.detect.check_time import _missed_of_turns, check_undersampling
from session.detect.segments import cut_segments
from session.detect.stills import Noise, Still
from session.log.logfile import Log
from session.log.samples import Samples

#: Hz of the fine grid, and fine samples of a turn and of the rest on either side of it
FINE_HZ, TURN, REST = 2000, 5120, 2560


TURNS = 160


QUIET = Noise(np.full(3, 1e-9), np.full(3, 1e-9))


STEPS = {62.5: 32, 100.0: 20, 200.0: 10}


def motion(exponent, seed, below_hz=np.inf, dps=60.0):
    """Rates (TURNS, N, 3) rad/s on the fine grid: random, their spectrum (1 + (f / 2 Hz)²)^(-p/2), within a bell; none above a limit."""
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(TURN, 1 / FINE_HZ)
    random = rng.normal(size=(TURNS, 3, len(f))) + 1j * rng.normal(size=(TURNS, 3, len(f)))
    waves = np.fft.irfft(random * (1 + (f / 2) ** 2) ** (-exponent / 2) * (f < below_hz), axis=-1)
    t = np.arange(TURN) / FINE_HZ
    turns = waves * np.exp(-(((t - t.mean()) / 0.23) ** 2) / 2)  # 0.7 Hz wide: nothing leaks above the limit
    turns *= dps * DEG / np.abs(turns).max(axis=-1).mean()
    return np.pad(turns.transpose(0, 2, 1), ((0, 0), (REST, REST), (0, 0)))


def sampled(fine, rate_hz, mdps=0.0):
    """One log of all turns, level, and the stills between them; white noise of one-sided density."""
    gyro = fine[:, :: STEPS[rate_hz]].reshape(-1, 3)
    gyro = gyro + np.random.default_rng(1).normal(size=gyro.shape) * mdps * 1e-3 * DEG * np.sqrt(rate_hz / 2)
    t_ns = np.rint(np.arange(len(gyro)) / rate_hz * 1e9).astype(np.int64)
    down = np.array([0, 0, -G])
    edge, whole = REST // STEPS[rate_hz], fine.shape[1] // STEPS[rate_hz]
    nothing = np.zeros(3)
    stills = []
    for turn in range(TURNS + 1):
        start, stop = max(turn * whole - edge, 0), min(turn * whole + edge, len(gyro))
        stills.append(Still(start, stop, start / rate_hz, 1.0, nothing, nothing, down, nothing, nothing, 25.0))
    return Samples(t_ns, gyro, np.broadcast_to(down, gyro.shape), None), stills


def tilt_missed(fine, rate_hz):
    """rms rad of tilt over the turns: the sum of readings less the fine integral."""
    step = STEPS[rate_hz]
    error = fine[:, ::step].sum(axis=1) * step / FINE_HZ - fine.sum(axis=1) / FINE_HZ
    return float(np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1))))


def looked(samples, stills, mdps=5.0):
    """What the first look says of fast motion; the sensor's noise as it is."""
    noise = Noise(np.full(3, mdps * 1e-3 * DEG), np.full(3, 1e-9))
    made = config(gyro_fs_dps=2000.0)
    turns = [segment.stills for segment in cut_segments(samples, stills, made.sensor, made.protocol) if segment.accepted]
    return check_undersampling(Log(Path("log0001.csv"), samples, raw=False), turns, noise, made)


def test_white_noise_is_no_motion():
    """Ten times as much of it as the motion makes: its own share is taken off."""
    still = np.zeros((TURNS, TURN + 2 * REST, 3))
    samples, stills = sampled(still, 62.5, mdps=50.0)
    for noise in (50.0, 25.0):  # and twice what the stills have, as where a hand trembles
        assert all(line.level == "ok" for line in looked(samples, stills, noise))


def test_few_turns_and_turns_with_a_gap_say_nothing():
    samples, stills = sampled(motion(1.4, seed=8), 62.5, mdps=5.0)
    assert looked(samples, stills[:5]) == []
    late = samples.t_ns + np.cumsum(np.isin(np.arange(len(samples)), [still.stop + 30 for still in stills])) * 10**9
    assert looked(replace(samples, t_ns=late), stills) == []


def test_the_error_of_readings_is_predicted_from_fewer_of_them():
    """Against the fine integral: of one set of turns to 9 % (one sigma)."""
    rate_hz, ratios = 100.0, []
    for seed in range(2):
        fine = motion(1.6, seed)
        true, (samples, stills) = tilt_missed(fine, rate_hz), sampled(fine, rate_hz)
        rms_rad, exponent, _ = _missed_of_turns(samples, list(pairwise(stills)), QUIET, 5.0)
        assert exponent == pytest.approx(1.6, abs=0.2)
        ratios.append(rms_rad / true)
    assert np.mean(ratios) == pytest.approx(1, abs=0.15)
    samples, _ = sampled(fine, rate_hz, mdps=5.0)
    (line,) = looked(samples, stills)
    assert line.level == "warning"
    assert "above 50 Hz" in line.description
    assert len(f"{line.where}: {line.description}") <= 80
    assert float(line.description.split("by ")[1].split("°")[0]) == pytest.approx(true / DEG, rel=0.3)
    assert "or with a low-pass below 50 Hz" in line.do
