"""Simulate a whole session from its options: hand, table, Earth, and the sensor that feels them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tinygc.simulation.movement import MovementPlan, hand_plan, motion_of
from tinygc.simulation.options import SimulatedUnit, SimulationOptions, draw_unit
from tinygc.simulation.sensor import Distort, Disturb, Motion, RegisterLog, SensorModel, streams

RUN_UP_S = 0.2  #: time on the fine grid before the first sample: many times the slowest filter's memory
PIECE = 1 << 14  #: samples that are simulated at a time: about 40 MB on the fine grid


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated session and its truth.  closure is None without a closure run."""

    options: SimulationOptions
    plan: MovementPlan
    unit: SimulatedUnit
    log: RegisterLog
    closure: RegisterLog | None


def simulate_session(
    options: SimulationOptions,
    distort: Distort | None = None,
    *,
    plan: MovementPlan | None = None,
    disturb: Disturb | None = None,
    unit: SimulatedUnit | None = None,
    motion: Motion | None = None,
) -> Simulation:
    """Simulate a session, log and closure run without a break; the same arguments give the same registers.

    distort: hidden physics of the gyro; disturb: hidden physics of the accelerometer; plan: replaces the movement of ``plan_of``;
    unit: replaces the sensor of ``draw_unit``; motion: what the sensor feels on the plan, where it is not fixed to the table.
    Hidden physics may look at the whole movement, so with it there is a single piece.
    """
    unit, plan = unit or unit_of(options), plan or plan_of(options)
    log_count, closure_count = (int(np.ceil(seconds * unit.odr_hz)) for seconds in (plan.log_s, options.closure_s))
    count, run_up = log_count + closure_count, run_up_samples(unit.odr_hz)
    size = run_up + (PIECE if distort is None and disturb is None else count)
    felt = motion or motion_of(options, unit, plan)
    sensor = SensorModel(options, unit, felt, distort, disturb, first=-run_up, duration_s=count / unit.odr_hz)
    pieces = [sensor.take(min(size, count - first)) for first in range(-run_up, count, size)]
    whole = RegisterLog(*(np.concatenate([getattr(piece, field.name) for piece in pieces]) for field in fields(RegisterLog)))
    log, closure = whole.part(0, log_count), whole.part(log_count, count)
    return Simulation(options, plan, unit, log, closure if closure_count else None)


def unit_of(options: SimulationOptions) -> SimulatedUnit:
    """Draw the sensor for the session of these options."""
    return draw_unit(options, streams(options)[0])


def plan_of(options: SimulationOptions) -> MovementPlan:
    """Draw the movement for the session of these options."""
    return hand_plan(options, streams(options)[1])


def run_up_samples(odr_hz: float) -> int:
    """Number of samples in the run-up."""
    return int(np.ceil(RUN_UP_S * odr_hz))
