"""Lots of simulated units, known exactly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from session.io.results import write_whole
from session.io.units import DEG
from tinygc.annexes.lots.lot import NAMES, Lot
from tinygc.annexes.lots.report import lot_table
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session, unit_of
from tinygc.simulation.write import write_simulation

MODEL = "ASM330LHH"
MEAN = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
#: of units that were trimmed: 50 ppm, 50 µrad, 20 mdps between them
SIGMA = np.array([5e-5] * 9 + [0.02 * DEG] * 3)


def lot(sigma: np.ndarray = SIGMA, **changes) -> Lot:
    """Normal about no correction, one sigma (12,) between units; the accelerometer's numbers are not told."""

    whole = [np.pad(part, (0, len(NAMES) - 12), constant_values=np.nan) for part in (MEAN, np.zeros(12), sigma, np.zeros(12))]
    return replace(Lot(MODEL, 500, 500, *whole), **changes)


def write_lot(path: Path, made: Lot) -> None:
    write_whole(path, lot_table(made))


def session_of_unit(folder: Path, vector: np.ndarray, segments: int, seed: int = 3) -> Path:
    """A unit with these 12 numbers, turned by hand."""
    options = SimulationOptions(segments=segments, closure_s=0.0, seed=seed, odr_hz=104.0)
    unit = replace(unit_of(options), E=vector[:9].reshape(3, 3), B=vector[9:])
    return write_simulation(simulate_session(options, unit=unit), folder)
