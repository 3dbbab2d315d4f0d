"""An accelerometer that nobody has calibrated, in a guided session: it is fitted as stills come in, and the coach reckons with it."""

import numpy as np
import pytest
from coached_hand import guide_of, play, said, simulated
from conftest import GRAVITY, Table, config

from session.bench.guide import Guide
from session.bench.live import stream_problem
from session.bench.messages import Kind, Stage
from session.bench.progress import LiveAccelerometerFit
from session.detect.accelerometer import PARAMETERS, UPPER
from session.detect.stills import Noise, Still
from session.io.config import Accelerometer
from session.io.units import MG, G
from tinygc.attitude import rotation
from tinygc.planning import turns
from tinygc.planning.coach import Coach

RAW = Accelerometer(np.array([[1.011, 0.004, -0.003], [0, 0.992, 0.005], [0, 0, 1.006]]), np.array([0.2, -0.15, 0.1]))


def read_by(accelerometer: Accelerometer, force: np.ndarray) -> np.ndarray:
    """What an accelerometer reads that its calibration brings to force."""
    return force @ np.linalg.inv(accelerometer.matrix).T + accelerometer.bias_mps2


def raw_guide(segments=40) -> Guide:
    guide = Guide(config().protocol, segments)
    guide.begin(config().sensor, LiveAccelerometerFit(GRAVITY))
    return guide


@pytest.fixture(scope="module")
def led():
    """A raw accelerometer of 30 mg, 1 %, 5 mrad: the guide, its changes, and what the coach said after each segment."""
    samples, guide, coach = simulated(24, seed=3, accel_bias_mg=30.0), raw_guide(24), Coach()
    changes, said_by_coach = [], []
    for first in range(0, len(samples), 50):
        new = guide.feed(samples.between(first, first + 50))
        changes += new
        if any(change.accepted for change in new):
            advice = coach(guide.taken.progress)
            said_by_coach.append((advice, coach.sigma))
    return guide, changes, said_by_coach


@pytest.mark.broad
def test_it_is_fitted_as_stills_come_in_and_said_once(led):
    guide, changes, _ = led
    assert guide.accepted == 24
    (known,) = [text for text in said(changes, Kind.STAGE) if "the accelerometer is known" in text]
    assert "attitudes; gravity's spread" in known
    before, after = guide.taken.own.spread_mg
    assert before > 20
    assert after < 0.1


def test_a_zero_of_half_a_g_gets_through():
    """An MPU-9250's z: level it reads 0.5 or 1.5 g, which a calibrated accelerometer must not, and an uncalibrated one may."""
    off = Accelerometer(np.eye(3), np.array([0.0, 0.0, 0.5 * G]), "none")
    samples = Table().tumble(12, seed=3).samples(seed=3)
    samples = samples.with_accel(read_by(off, samples.accel))
    refused = guide_of(12)
    play(refused, samples.between(0, 600))
    assert refused.stage is Stage.CHECK_STREAM
    guide = raw_guide(12)
    changes = play(guide, samples)
    assert guide.accepted == 12
    assert not said(changes, Kind.WARNING)
    found = guide.taken.own.accelerometer
    np.testing.assert_allclose(found.bias_mps2, off.bias_mps2, atol=0.5 * MG)
    # What lies up is told by the force as it is, not as it reads: known from the stills, all earlier ones are seen aright.
    true = guide_of(12)
    play(true, Table().tumble(12, seed=3).samples(seed=3))
    assert guide.taken.coverage.stills == true.taken.coverage.stills


def test_a_wrong_full_scale_is_still_said():
    samples = Table().tumble(12, seed=3).samples(seed=3)
    half = samples.with_accel(samples.accel / 2)
    changes = play(raw_guide(12), half)
    (warning,) = said(changes, Kind.WARNING)
    assert "gravity reads 0.50 g in all attitudes: is the accelerometer's full scale right?" in warning
    fifth = samples.with_accel(samples.accel / 5).between(0, 300)
    assert "0.3 to 2.5 g expected" in stream_problem(fifth, 208, 4, calibrated=False)


def forces(count, seed):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    return GRAVITY * direction / np.linalg.norm(direction, axis=1, keepdims=True)


def test_its_columns_are_the_derivatives():
    """Of the length, and of the end attitude that a turn predicts less the one that gravity shows: by differences."""
    own, step = turns.OwnAccelerometer(RAW, 0.0), 1e-6
    first, last = forces(2, 5)[:, None]
    q_first = rotation.from_gravity(first)
    q_last = rotation.from_gravity(last)
    turn = rotation.multiply(rotation.conjugate(q_first), q_last)[0]
    (lengths,) = own.length_rows(first)
    (tilts,) = own.tilt_rows(first, last, q_first, q_last)
    measured = read_by(RAW, np.concatenate([first, last]))
    for k in range(PARAMETERS):
        matrix, bias = RAW.matrix.copy(), RAW.bias_mps2.copy()
        if k < 6:
            matrix[UPPER[0][k], UPPER[1][k]] += step
        else:
            bias[k - 6] += step
        moved = Accelerometer(matrix, bias).correct(measured)
        assert (np.linalg.norm(moved[0]) - GRAVITY) / step == pytest.approx(lengths[k], abs=1e-5)
        predicted = rotation.multiply(rotation.from_gravity(moved[0]), turn)
        error = rotation.multiply(predicted, rotation.conjugate(rotation.from_gravity(moved[1])))
        np.testing.assert_allclose(2 * error[1:3] / error[0] / step, tilts[:, k], atol=1e-4)


def test_each_still_tells_by_its_white_noise_and_what_the_accelerometer_wanders():
    """Of 2 and 8 s: half the mean square density by the seconds, and the square of the rest."""
    noise, force = Noise(np.full(3, 1e-4), np.array([1e-3, 2e-3, 3e-3])), forces(2, 1)
    stills = tuple(
        Still(0, 1, 0.0, seconds, *[np.zeros(3)] * 2, row, *[np.zeros(3)] * 2, 25.0)
        for seconds, row in zip((2.0, 8.0), read_by(RAW, force), strict=True)
    )
    known = turns.OwnAccelerometer(RAW, 4e-4)
    rows, variance = known.length_rows(force), np.mean([1e-6, 4e-6, 9e-6]) / 2 / np.array([2.0, 8.0]) + 1.6e-7
    expected = np.einsum("sp,s,sq->pq", rows, 1 / variance, rows)
    np.testing.assert_allclose(turns.length_information(known, stills, noise), expected, rtol=1e-9, atol=1e-9)
