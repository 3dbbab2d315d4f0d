"""More false readings than turns: they are false readings, and nothing that the turns miss by themselves."""

from dataclasses import replace

import numpy as np
from conftest import DEG, Table, session_of

from session.io.registers import gyro_rps_per_lsb
from tinygc.closure.build import build_problem
from tinygc.noise.components import UNDERSAMPLED, first_noise
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener

SPIKE_RPS = 8000 * gyro_rps_per_lsb(500)


def spoilt(count: int):
    """Readings with so many single ones that are off by 140 dps on one axis, anywhere; and their rows."""
    samples = Table().tumble(14, seed=31).samples(seed=2)
    rng = np.random.default_rng(count)
    rows = np.sort(rng.choice(np.arange(200, len(samples) - 200, 20), count, replace=False))
    gyro = samples.gyro.copy()
    gyro[rows, rng.integers(3, size=count)] += SPIKE_RPS * rng.choice([-1, 1], count)
    assert SPIKE_RPS > 100 * DEG
    return replace(samples, gyro=gyro), rows


def test_what_they_add_to_fewer_readings_does_not_grow_as_motion_does():
    twin = Twin(build_problem(session_of(spoilt(40)[0])))
    whiten = Whitener(twin)
    noise = first_noise(twin, whiten)
    assert not noise.missed.predicted_rad.any()
    assert UNDERSAMPLED not in {component.name for component in noise.components}
