"""Noise at rest of one sensor: lines, slope, and what gyro and accelerometer share, each of a known size."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from looks import look, of

from session.detect.rest_noise import Share, coherent_share, lines_of, rest_spectrum, slope_of, spectra
from session.detect.stills import find_stills

RATE_HZ, LENGTH, COUNT = 50.0, 200, 60


def noise(seed=0, count=COUNT):
    return np.random.default_rng(seed).standard_normal((count, LENGTH, 3))


def flat(x):
    return np.mean(np.abs(x) ** 2, axis=0)


def shared(x, y):
    x, y = spectra(x), spectra(y)
    return coherent_share(x, y, flat(x))


def test_independent_noise_has_no_share_beyond_its_sigma():
    drawn = [shared(noise(2 * k), noise(2 * k + 1)) for k in range(40)]
    pulls = np.array([share.value / share.sigma for share in drawn])
    assert abs(pulls.mean()) < 3 / np.sqrt(40)
    assert pulls.std() == pytest.approx(1.0, abs=0.34)  # three sigmas of 40
    assert all(share.upper < 0.03 for share in drawn)


@pytest.mark.parametrize("own", [0.5, 1.0, 3.0])
def test_a_shared_part_is_found_at_its_share_of_the_power(own):
    """Both feel one noise u: of x = u + own, u holds 1 / (1 + own^2); y has u alone."""
    u = noise(5)
    found = shared(u + own * noise(6), u)
    assert found.value == pytest.approx(1 / (1 + own**2), abs=4 * found.sigma + 0.01)
    assert found.p_value < 1e-6


def test_a_share_has_a_one_sided_p_value_and_limit():
    share = Share(0.02, 0.01)
    assert share.p_value == pytest.approx(0.02275, abs=1e-5)
    assert share.upper == pytest.approx(0.03645, abs=1e-5)
    assert Share(-0.02, 0.01).upper == pytest.approx(0.01645, abs=1e-5)


def test_a_line_is_found_at_its_frequency_with_its_share():
    t = np.arange(LENGTH) / RATE_HZ
    x = noise(1)
    x[:, :, 1] += np.sqrt(2) * np.sin(2 * np.pi * 12.5 * t + 0.3)  # as much power as the noise
    hz = np.fft.rfftfreq(LENGTH, 1 / RATE_HZ)
    spectrum = spectra(x)
    lines = lines_of(spectrum, hz, flat(spectrum))
    assert lines[1].hz == (12.5,)
    assert lines[1].share == pytest.approx(0.5, abs=0.03)
    assert not lines[0].hz
    assert lines[2].share == 0.0


def test_white_noise_has_lines_in_one_log_of_a_hundred():
    hz = np.fft.rfftfreq(LENGTH, 1 / RATE_HZ)
    logs = [spectra(noise(k, 32)) for k in range(100)]
    false = sum(any(axis.hz for axis in lines_of(x, hz, flat(x))) for x in logs)
    assert false <= 5  # 1 expected; the background is an estimate


def test_the_slope_of_white_noise_is_zero_and_of_integrated_noise_minus_two():
    hz = np.fft.rfftfreq(LENGTH, 1 / RATE_HZ)
    slope, sigma = slope_of(spectra(noise(3)), hz)
    assert abs(slope) < 3 * sigma
    walk, _ = slope_of(spectra(np.cumsum(noise(3), axis=1)), hz)
    assert walk == pytest.approx(-2, abs=0.2)


@pytest.fixture(scope="module")
def samples():
    return Table().tumble(14, seed=5, rest_s=6.0).samples(gyro_mdps=25.0, odr_hz=104)


def test_white_noise_of_a_noisy_gyro_is_not_called_vibration(samples):
    finding = of(look(session_of(samples)), "gyro noise")
    assert "no line, white" in finding.says
    assert "less than" in finding.says
    assert finding.do == "no vibration shows: this unit's noise, its filter, or wrong units"


def test_a_table_that_shakes_gyro_and_accelerometer_alike_vibrates(samples):
    shake = np.random.default_rng(0).standard_normal(len(samples.gyro))[:, None]
    shaken = samples.with_accel(np.asarray(samples.accel) + 0.05 * shake)
    shaken = replace(shaken, gyro=np.asarray(samples.gyro) + 0.6 * DEG * shake)
    finding = of(look(session_of(shaken)), "gyro noise")
    assert "vibrate" in finding.do
    assert "together" in finding.do


def test_lines_that_the_accelerometer_does_not_follow_are_not_called_a_vibrating_table(samples):
    line = np.sin(2 * np.pi * 3.0 * samples.t_s)[:, None] * [0.0, 1.0, 0.0]
    finding = of(look(session_of(replace(samples, gyro=np.asarray(samples.gyro) + 0.6 * DEG * line))), "gyro noise")
    assert "(3 Hz)" in finding.says
    assert "of y" in finding.says
    assert "does not follow: interference" in finding.do


def test_stills_too_short_say_so(samples):
    stills, _ = find_stills(samples)
    short = replace(stills[0], stop=stills[0].start + round(4.5 * 104))  # nine sections of 0.5 s
    assert rest_spectrum(samples, [short]) is None
    assert rest_spectrum(samples, stills[:1]) is not None
