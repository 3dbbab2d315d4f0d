"""What a guided session asks for before its closure run: the table is set onto its index mark, and rests there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.stroke import GimbalTurn, Stroke
from tinygc.simulation.table_movement import PEAK_RPS, Plan, not_faster, stroke

#: of the closure run, and of still_s: a rest on the mark, before the run and in it; longer than any that is asked for there
REST_PART, REST_STILLS, REST_MORE_S = 0.11, 4.0, 1.5


def onto_the_mark(options: SimulationOptions, plan: Plan) -> Plan:
    """A plan with a closure run, before which all gimbals are turned to their zeros, and rest."""
    if plan.closure is None:
        return plan
    rng = np.random.default_rng([options.seed, 99])
    angles = plan.start_rad.copy()
    before: list[GimbalTurn] = [each for each in plan.strokes if each.start_s < plan.log_s]
    for each in before:
        angles[each.gimbal] += each.change_rad
    begin_s, rest_s = plan.log_s, max(REST_PART * options.closure_s, REST_STILLS * options.still_s) + REST_MORE_S
    back = [-((angle + np.pi) % (2 * np.pi) - np.pi) for angle in angles]
    way = [stroke(gimbal, begin_s, options.turn_s, float(change), rng) for gimbal, change in enumerate(back)]
    if len(slower := not_faster(way, PEAK_RPS)) and slower is not way:  # a slower hand takes longer; it still arrives
        seconds = options.turn_s * float(way[0].change_rad / slower[0].change_rad)
        way = [replace(each, duration_s=seconds) for each in way]
    later_s = max(each.duration_s for each in way) + rest_s
    run = [_later(each, later_s) for each in plan.strokes if each.start_s >= plan.log_s]
    log_s, closure = plan.log_s + later_s, (plan.closure[0] + later_s, plan.closure[1] + later_s)
    turns = (*plan.turns, (begin_s, begin_s + later_s - rest_s))
    return Plan(plan.start_rad, (*before, *way, *run), turns, log_s, closure, plan.duration_s + later_s)


def _later(each: GimbalTurn, seconds: float) -> Stroke:
    assert isinstance(each, Stroke)  # a hand's plan holds no others
    return replace(each, start_s=each.start_s + seconds)
