"""An array of simulated units under one motion: model, true rate, what each unit measures."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from session.io.config import Sensor
from session.io.units import DEG
from tinygc.annexes.arrays.clocks import UnitPlace
from tinygc.annexes.arrays.fusion import build_array_model
from tinygc.annexes.arrays.model import ArrayModel, FusedUnit
from tinygc.models.linear import LinearModel

RATE_HZ = 100.0
DENSITY = 0.01 * DEG  #: rad/s/sqrt(Hz)


def units(count: int = 8, seed: int = 1, density=DENSITY, full_scale: float = 2000) -> list[FusedUnit]:
    """Units in any mounting, each with its own E and B; density: of all, or one for each."""
    rng = np.random.default_rng(seed)
    densities = np.broadcast_to(np.asarray(density, dtype=float), (count,))
    found = []
    for i in range(count):
        mounting = np.eye(3) if i == 0 else Rotation.random(random_state=seed + i).as_matrix()
        model = LinearModel(np.eye(3) + 0.01 * rng.normal(size=(3, 3)), 0.5 * DEG * rng.normal(size=3))
        sensor = Sensor("MPU-9150", f"s{i}", RATE_HZ, full_scale, 4.0)
        place = UnitPlace(i, mounting=mounting)
        found.append(FusedUnit(place, model, np.full(3, densities[i]), np.full(3, 2e-5), np.diag([1e-8] * 9 + [1e-10] * 3), sensor, None))
    return found


def model_of(found: list[FusedUnit], **options) -> ArrayModel:
    """The model of units."""
    return build_array_model(found, RATE_HZ, **options)


def motion(samples: int, seed: int = 3) -> np.ndarray:
    """(T, 3) rad/s: a smooth hand's motion with rests."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(samples) / RATE_HZ
    phase, turn = rng.uniform(0, 2 * np.pi, 6), np.zeros((samples, 3))
    for k, hz in enumerate((0.11, 0.23, 0.41, 0.77, 1.3, 0.05)):
        turn[:, k % 3] += np.sin(2 * np.pi * hz * t_s + phase[k]) / 2
    return 200.0 * DEG * turn * (np.sin(2 * np.pi * 0.03 * t_s) > -0.3)[:, None]


def measured(model: ArrayModel, omega: np.ndarray, seed: int = 5) -> np.ndarray:
    """(T, N, 3) rad/s that the units read at true rates (T, 3) in the array's frame, each with its own white noise."""
    rng = np.random.default_rng(seed)
    clean = np.einsum("nij,tnj->tni", np.linalg.inv(model.matrices), omega[:, None] - model.offsets)
    sigma = np.stack([unit.noise_density for unit in model.units]) * np.sqrt(model.rate_hz / 2)
    return clean + sigma * rng.normal(size=clean.shape)
