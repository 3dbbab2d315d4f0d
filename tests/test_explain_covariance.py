"""The covariance of an explanation's residuals: whitened noise is white."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_twins import make_twin_of
from small_sessions import small_session

from session.io.units import DEG_PER_HOUR
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.floor import wander_covariance
from tinygc.noise.components import known_whitener
from tinygc.noise.twin import Channels, Twin
from tinygc.noise.whitening import ACCEL_INSTABILITY_MPS2, PRECALIBRATION_MPS2

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")


class Noise:
    """What the whitener's covariance claims to describe, drawn sample by sample and force by force."""

    def __init__(self, twin: Twin, seed: int):
        self.twin, self.rng = twin, np.random.default_rng(seed)
        self.state = twin.start()
        self.rates = twin.rates(self.state)
        (log,) = twin.problem.logs
        self.gyro_std = log.noise.angle_random_walk / np.sqrt(log.samples.period_s)
        (movement,) = twin.movements
        self.t_s = movement.t_s
        self.knots_s = np.arange(0, movement.t_s[-1] + 0.5, 0.5)
        self.wander = np.linalg.cholesky(wander_covariance(self.knots_s, instability_rps=3 * DEG_PER_HOUR))

    def residuals(self, noisy: bool) -> np.ndarray:
        """Stacked (n,)."""
        twin, rng = self.twin, self.rng
        rates, force, length = self.rates, twin.force, np.zeros(len(twin.stills))
        if noisy:
            bias = self.wander @ rng.standard_normal((len(self.knots_s), 3))
            wander = np.stack([np.interp(self.t_s, self.knots_s, axis) for axis in bias.T], axis=-1)
            rates = [rates[0] + self.gyro_std * rng.standard_normal(rates[0].shape) + wander]
            walk = np.array([twin.problem.logs[log].noise.velocity_random_walk for log, _ in twin.stills])
            duration = np.array([still.duration_s for _, still in twin.stills])
            down = force / np.linalg.norm(force, axis=1, keepdims=True)
            left = PRECALIBRATION_MPS2 * (rng.standard_normal(3) + down @ rng.standard_normal((3, 3)).T)
            length = ACCEL_INSTABILITY_MPS2 * rng.standard_normal(len(twin.stills))
            force = force + walk / np.sqrt(duration)[:, None] * rng.standard_normal(force.shape) + left
        tilts = rotation.from_gravity(force)
        q = np.array([closure.nearest_yaw(there, tilt) for there, tilt in zip(twin.q_tb, tilts, strict=True)])
        batch = replace(twin.batch, start=q[twin.first], end=q[twin.last])
        angles = closure.error_angles(closure.residual(closure.end_attitude(batch, twin.padded(rates)), batch.end, batch.yaw_known))
        still = np.array([rates[log][s.start : s.stop].mean(axis=0) for log, s in twin.stills])
        return Channels(angles, still, np.linalg.norm(force, axis=1) + length).stacked()


@pytest.mark.slow
def test_whitened_noise_has_unit_covariance(twin_of):
    """Monte Carlo from samples and forces; 800 draws: variances to 5 %, covariances to 3.5 % (1 sigma)."""
    twin, whiten = twin_of(segments=10)
    noise, draws = Noise(twin, 0), 800
    quiet = noise.residuals(False)
    white = np.array([whiten(noise.residuals(True) - quiet) for _ in range(draws)])
    covariance = white.T @ white / draws
    off = covariance - np.diag(np.diag(covariance))
    assert np.abs(np.diag(covariance) - 1).max() < 5 * np.sqrt(2 / draws)
    assert np.abs(off).max() < 5.5 / np.sqrt(draws)
    for part in whiten.parts.values():
        assert np.diag(covariance)[part].mean() == pytest.approx(1, abs=5 * np.sqrt(2 / draws / (part.stop - part.start)))


def test_whitening_some_rows_is_whitening_of_their_own_covariance():
    whiten = known_whitener(Twin(small_session()))
    n = whiten.parts["length"].stop
    backward = whiten(np.eye(n))
    covariance = np.linalg.inv(backward.T @ backward)
    rows = np.random.default_rng(1).random(n) < 0.7
    part = whiten.only(rows)
    forward = part(np.eye(n))
    assert forward.shape == (rows.sum(), n)
    assert not forward[:, ~rows].any()
    np.testing.assert_allclose(forward @ covariance @ forward.T, np.eye(rows.sum()), atol=1e-6)
    np.testing.assert_allclose(whiten.only(np.ones(n, dtype=bool))(np.eye(n)), backward, rtol=1e-9)
    np.testing.assert_allclose(part.sigma, np.sqrt(np.diag(covariance))[rows], rtol=1e-6)
