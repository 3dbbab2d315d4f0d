"""The eight real units of ../shared/mimu as an array's model, without a joint fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.public.mimu import experiments
from session.io.config import Sensor
from session.io.units import DEG
from tinygc.annexes.arrays.clocks import UnitPlace
from tinygc.annexes.arrays.extrinsics import nearest_rotation
from tinygc.annexes.arrays.fusion import END, build_array_model
from tinygc.annexes.arrays.model import ArrayModel, FusedUnit
from tinygc.models.linear import LinearModel

RATE_HZ, FULL_SCALE_DPS, LSB_PER_DPS = 62.5, 2000.0, 16.4
#: s at the beginning of each recording in which the board lies still
FIRST_REST_S = 20.0


def recordings(source: Path) -> dict[int, np.ndarray]:
    """Of each experiment, what the units read: (T, 8, 3) rad/s."""
    return {number: registers[:, :, 3:] / LSB_PER_DPS * DEG for number, (_, registers) in experiments(source)}


def aligned(raw: np.ndarray) -> ArrayModel:
    """Each unit's E and mounting by least squares against the mean of all, its bias and noise from the first rest.

    Relative only: what all units have in common (the mean's own scale and axes) a joint fit finds, and no figure here depends on it.
    """
    rest = slice(0, round(FIRST_REST_S * RATE_HZ))
    zero = raw[rest].mean(axis=0)
    moved = raw - zero
    whole = (np.abs(raw) < END * FULL_SCALE_DPS * DEG).all(axis=(1, 2))
    units = raw.shape[1]
    first = [np.linalg.lstsq(moved[whole, i], moved[whole, 0], rcond=None)[0].T for i in range(units)]
    mean = np.mean([moved[:, i] @ first[i].T for i in range(units)], axis=0)
    matrices = [np.linalg.lstsq(moved[whole, i], mean[whole], rcond=None)[0].T for i in range(units)]
    back = nearest_rotation(matrices[0]).T
    found = []
    for i, matrix in enumerate(matrices):
        mounting = nearest_rotation(back @ matrix)
        E = mounting.T @ back @ matrix
        density = np.diff(raw[rest, i], axis=0).std(axis=0) / np.sqrt(RATE_HZ)  # of white noise: sqrt(2) sigma in a difference
        sensor = Sensor("MPU-9150", f"mimu-{i}", RATE_HZ, FULL_SCALE_DPS, 16.0)
        found.append(FusedUnit(UnitPlace(i, mounting=mounting), LinearModel(E, -E @ zero[i]), density, sensor=sensor))
    return build_array_model(found, RATE_HZ)
