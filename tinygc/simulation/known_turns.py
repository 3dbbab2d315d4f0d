"""``turns.csv`` of a simulated session: turns about one gimbal, as a stop of a given repeatability would have them."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from session.log.known_turns import COLUMNS, KnownTurn
from tinygc.simulation.motion import table_to_body
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.stroke import gimbal_angles
from tinygc.simulation.table_movement import Plan

#: the stop's own random stream, after those of ``simulate.py``
STREAM = 6
#: of the axis, as a person may have measured it
AXIS_DIGITS = 4
#: turns smaller than this are of no use to anybody
LEAST_RAD = 10 * DEG


def stopped_turns(plan: Plan, options: SimulationOptions) -> tuple[KnownTurn, ...]:
    """The turns of a plan about one gimbal alone; each stated angle errs by the stop's repeatability, drawn from the seed."""
    if options.stop_sigma_deg == 0:
        return ()
    rng = np.random.default_rng(options.seed).spawn(STREAM + 1)[STREAM]
    found = []
    for number, (start_s, stop_s) in enumerate(plan.turns):
        strokes = [stroke for stroke in plan.strokes if start_s - 1e-9 <= stroke.start_s < stop_s]
        error = rng.normal() * options.stop_sigma_deg * DEG  # drawn for every turn: the others keep theirs
        change = sum(stroke.change_rad for stroke in strokes)
        if len({stroke.gimbal for stroke in strokes}) != 1 or abs(change) < LEAST_RAD:
            continue
        before = gimbal_angles(plan.start_rad, plan.strokes, np.array([start_s]))[0][:, 0]
        axis = np.round(_axis(strokes[0].gimbal, before), AXIS_DIGITS)
        words = ";".join(f"{x:g}" for x in axis)
        angle_deg = round((change + error) / DEG, 6)
        found.append(KnownTurn(number, None, axis / np.linalg.norm(axis), words, angle_deg * DEG, options.stop_sigma_deg * DEG))
    return tuple(found)


def turns_text(turns: tuple[KnownTurn, ...]) -> str:
    """The file."""
    rows = [f"{turn.turn},{turn.words},{turn.angle_rad / DEG:.6f},{turn.sigma_rad / DEG:g}" for turn in turns]
    return "\n".join([",".join(COLUMNS), *rows]) + "\n"


def _axis(gimbal: int, angles: np.ndarray) -> np.ndarray:
    """(3,) of a gimbal in the body, at angles (3,) rad, outer middle inner: those further in carry it along."""
    within = np.where(np.arange(3) > gimbal, angles, 0.0)
    return table_to_body(within[:, None], np.eye(3)[2 - gimbal])[0]
