"""What the benchmarks of arrays share: eight units of one recording as an array's model, without a joint fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.common.units import DEG
from session.log.folder import read_session
from tinygc.array.agreement import END
from tinygc.array.build_model import build_array_model
from tinygc.array.model import ArrayModel, FusedUnit
from tinygc.array.mountings import nearest_rotation
from tinygc.array.place import UnitPlace
from tinygc.models.linear import LinearModel

#: s at the beginning of a mimu recording in which the board lies still on its table
FIRST_REST_S = 20.0


def recorded(folder: Path, experiment: int, count: int = 8) -> tuple[list, np.ndarray, float]:
    """Sessions of an experiment's units, their rates (T, N, 3) rad/s of the same stamps, and samples a second."""
    sessions = [read_session(folder / f"e{experiment}u{unit}") for unit in range(count)]
    samples = [session.logs[0].samples for session in sessions]
    return sessions, np.stack([each.gyro for each in samples], axis=1), 1 / samples[0].period_s


def aligned(sessions: list, raw: np.ndarray, rate_hz: float) -> ArrayModel:
    """Each unit's E and mounting by least squares against the mean of all, its bias and noise from the first rest.

    Relative only: what all units have in common (the mean's own scale and axes) a joint fit finds, and no figure here depends on it.
    """
    rest = slice(0, round(FIRST_REST_S * rate_hz))
    zero = raw[rest].mean(axis=0)
    moved = raw - zero
    whole = (np.abs(raw) < END * 2000 * DEG).all(axis=(1, 2))
    units = raw.shape[1]
    first = [np.linalg.lstsq(moved[whole, i], moved[whole, 0], rcond=None)[0].T for i in range(units)]
    mean = np.mean([moved[:, i] @ first[i].T for i in range(units)], axis=0)
    matrices = [np.linalg.lstsq(moved[whole, i], mean[whole], rcond=None)[0].T for i in range(units)]
    back = np.linalg.inv(nearest_rotation(matrices[0]))
    found = []
    for i, matrix in enumerate(matrices):
        mounting = nearest_rotation(back @ matrix)
        E = mounting.T @ back @ matrix
        density = np.diff(raw[rest, i], axis=0).std(axis=0) / np.sqrt(rate_hz)  # of white noise: sqrt(2) sigma in a difference
        place = UnitPlace(i, mounting=mounting)
        found.append(FusedUnit(place, LinearModel(E, -E @ zero[i]), density, sensor=sessions[i].config.sensor))
    return build_array_model(found, rate_hz, measured=raw)
