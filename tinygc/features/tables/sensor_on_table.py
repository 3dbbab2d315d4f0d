"""What a simulated sensor on a virtual table feels, from the tracks of the table's axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.mechanics import AxisTrack, TableErrors, true_attitudes
from tinygc.simulation.movement import felt
from tinygc.simulation.options import SimulatedUnit, SimulationOptions
from tinygc.simulation.sensor import Motion, self_heating


def motion_on(
    table: Description, errors: TableErrors, tracks: Sequence[AxisTrack], options: SimulationOptions, unit: SimulatedUnit
) -> Motion:
    """Motion of a sensor at ``options.lever_m`` on the innermost stage; time counts in seconds of the tracks.

    A track has no derivatives at its corners: rates are means over a step of the grid of times, about each time.
    """

    def motion(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        step = (t_s[-1] - t_s[0]) / (len(t_s) - 1)
        edges = np.append(t_s, t_s[-1] + step) - step / 2
        said, sense = np.stack([track.said_and_sense(edges) for track in tracks], axis=-1)
        body = Rotation.from_matrix(true_attitudes(table, errors, said, sense))
        rate = (body[:-1].inv() * body[1:]).as_rotvec() / step
        middle = (body[:-1] * Rotation.from_rotvec(rate * step / 2)).inv()
        inputs = felt(options, unit.heading_deg, rate, np.gradient(rate, step, axis=0), middle.apply)
        return *inputs, self_heating(options, t_s)

    return motion
