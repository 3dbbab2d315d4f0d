"""The Allan deviation against its own theory: white noise, a ramp, pieces, and what cannot be seen."""

import numpy as np
import pytest

from session.io.units import DEG_PER_HOUR
from tinygc.closure.floor import FLICKER_FLOOR, allan_curve, angle_random_walk, bias_instability

PERIOD_S, WALK = 0.01, 6e-5


def white(samples, seed=0):
    """Rates whose angle walks by WALK rad/sqrt(s)."""
    return np.random.default_rng(seed).standard_normal((samples, 3)) * WALK / np.sqrt(PERIOD_S)


def flicker(samples, instability_rps, seed):
    """Rates with the one-sided density B^2 / (pi f), shaped in the spectrum."""
    f = np.fft.rfftfreq(samples, PERIOD_S)
    shape = np.r_[0, np.sqrt(instability_rps**2 / (np.pi * f[1:]) / 2 * samples / PERIOD_S)]
    rng = np.random.default_rng(seed)
    draw = rng.standard_normal((3, len(f))) + 1j * rng.standard_normal((3, len(f)))
    return np.fft.irfft(shape * draw / np.sqrt(2), samples).T


@pytest.mark.slow
def test_white_noise_has_its_random_walk_and_slope():
    curve = allan_curve([white(200_000)], PERIOD_S)
    at = curve.freedom > 300
    assert curve.deviation[at] * np.sqrt(curve.tau_s[at, None]) == pytest.approx(WALK, rel=0.12)
    for axis in range(3):
        walk = angle_random_walk(curve, axis)
        assert walk.observed
        assert abs(walk.value - WALK) < 3 * walk.sigma
        assert 0.015 * WALK < walk.sigma < 0.025 * WALK


def test_stated_freedom_is_the_scatter_of_the_estimate():
    curves = [allan_curve([white(800, seed), white(1200, 999 + seed)], PERIOD_S) for seed in range(60)]
    ratio = np.array([curve.deviation**2 for curve in curves]) * curves[0].tau_s[:, None] / WALK**2
    expected = 2 / curves[0].freedom
    for k in range(0, len(expected), 4):
        assert ratio[:, k].var() == pytest.approx(expected[k], rel=0.45)


def test_pieces_do_not_mix_their_means():
    pieces = [white(400, i) for i in range(40)]
    moved = [piece + np.random.default_rng(i).normal(size=3) for i, piece in enumerate(pieces)]
    assert allan_curve(moved, PERIOD_S).deviation == pytest.approx(allan_curve(pieces, PERIOD_S).deviation, rel=1e-9)


def test_a_ramp_is_tau_over_root_two():
    slope = 1e-3
    curve = allan_curve([slope * PERIOD_S * np.arange(4000)[:, None] * np.ones(3)], PERIOD_S)
    assert curve.deviation[:, 0] == pytest.approx(slope * curve.tau_s / np.sqrt(2), rel=1e-6)


def test_bias_instability_is_read_where_the_curve_is_flat():
    instability = 10 * DEG_PER_HOUR
    curve = allan_curve([white(400_000) + flicker(400_000, instability, 3)], PERIOD_S)
    for axis in range(3):
        found = bias_instability(curve, axis)
        assert found.observed
        assert found.value == pytest.approx(instability, rel=0.25)


def test_short_stills_give_only_an_upper_limit():
    curve = allan_curve([white(230, i) for i in range(41)], PERIOD_S)
    for axis in range(3):
        found = bias_instability(curve, axis)
        assert not found.observed
        assert 0 < found.at_most < WALK / np.sqrt(0.5) / FLICKER_FLOOR


def test_what_is_too_short_is_refused():
    with pytest.raises(ValueError, match="four samples"):
        allan_curve([white(3)], PERIOD_S)
