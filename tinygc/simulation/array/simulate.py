"""An array's units, each simulated as a session of its own is, under one motion of the body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from session.common.units import DEG, MG
from tinygc.simulation import motion as table
from tinygc.simulation.array.jerks import Jerks, jerks_in_turns, knock_in
from tinygc.simulation.array.options import ArrayOptions
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulate import Distort, Recording, Simulation, plan_of, simulate_session, unit_of
from tinygc.simulation.table_movement import Plan

#: where in a turn the false readings are, and how many
FALSE_AT, FALSE_ROWS, FALSE_TURN = 0.5, 3, 1


@dataclass(frozen=True, eq=False)
class UnitTruth:
    """Of one unit: mounting (3, 3), from its axes to the first unit's; position_m (3,) from the first unit, in the first one's axes; its
    clock: ``t_array = t_unit + offset_s + rate t_unit``."""

    mounting: np.ndarray
    position_m: np.ndarray
    offset_s: float
    rate: float


@dataclass(frozen=True, eq=False)
class SimulatedArray:
    """units: each unit's session, stamps by its own clock; truths of their places; jerks and knocks that all have felt."""

    options: SimulationOptions
    array: ArrayOptions
    plan: Plan
    units: tuple[Simulation, ...]
    truths: tuple[UnitTruth, ...]
    jerks: tuple[Jerks, ...]


def simulate_array(options: SimulationOptions, array: ArrayOptions, distort: Mapping[int, Distort] | None = None) -> SimulatedArray:
    """The same arguments give the same registers.  distort: by unit, what it alone conceals, in its own axes."""
    plan, rng = plan_of(options), np.random.default_rng([options.seed, 16])
    place_rng, jerk_rng, table_rng = rng.spawn(3)
    truths = tuple(_placed(array, number, place_rng) for number in range(array.units))
    jerks = []
    if array.jerk_deg:
        jerks.append(jerks_in_turns(plan, array.jerk_deg * DEG, options.odr_hz, jerk_rng))
    if array.knock_deg:
        jerks.append(knock_in(plan, len(plan.turns) // 2, array.knock_deg * DEG, options.odr_hz, jerk_rng))
    level = table_rng.normal(size=(len(plan.turns) + 1, 2)) * array.reference_error_mg * MG
    heading_deg = unit_of(options).heading_deg
    units = []
    for number, truth in enumerate(truths):
        seed = int(np.random.SeedSequence([options.unit_drawn_from, number]).generate_state(1)[0])
        x, y, z = (float(length) for length in np.array(options.lever_m) + truth.position_m)
        own = replace(options, seed=seed, unit_seed=seed, lever_m=(x, y, z), heading_deg=heading_deg)
        if array.synchronous and options.odr_error is None:
            own = replace(own, odr_error=0.0)
        simulation = _unit(own, plan, truth, jerks, level, None if distort is None else distort.get(number))
        simulation = replace(simulation, log=_by_clock(simulation.log, truth))
        if simulation.closure is not None:
            simulation = replace(simulation, closure=_by_clock(simulation.closure, truth))
        if array.false_reading_dps and number == array.units - 1:
            simulation = replace(simulation, log=_falsified(simulation, array.false_reading_dps))
        units.append(simulation)
    return SimulatedArray(options, array, plan, tuple(units), truths, tuple(jerks))


def _placed(array: ArrayOptions, number: int, rng: np.random.Generator) -> UnitTruth:
    """Drawn whatever the options say, so that one does not change the others' draws."""
    mounting, position, offset, rate = rng.normal(size=3), rng.normal(size=3), rng.normal(), rng.normal()
    if number == 0:
        return UnitTruth(np.eye(3), np.zeros(3), 0.0, 0.0)
    clock = not array.synchronous
    return UnitTruth(
        Rotation.from_rotvec(mounting * array.mounting_deg * DEG).as_matrix(),
        position * array.position_mm * 1e-3,
        clock * offset * array.clock_offset_ms * 1e-3,
        clock * rate * array.clock_rate,
    )


def _unit(
    options: SimulationOptions, plan: Plan, truth: UnitTruth, jerks: list[Jerks], level_mps2: np.ndarray, distort: Distort | None
) -> Simulation:
    lever = np.array(options.lever_m)
    ends = np.array([(start + stop) / 2 for start, stop in plan.turns])

    def turned(t_s: np.ndarray, rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray) -> np.ndarray:
        for jerk in jerks:
            rate = jerk.rate(t_s, rate)
        rate = rate @ truth.mounting
        return rate if distort is None else distort(t_s, rate, felt(t_s, force), temp_c)

    def felt(t_s: np.ndarray, force: np.ndarray) -> np.ndarray:
        if level_mps2.any():
            level = np.column_stack([level_mps2[np.searchsorted(ends, t_s)], np.zeros(len(t_s))])
            force = force + _in_body(plan, t_s, level)
        for jerk in jerks:
            force = jerk.force(t_s, force, lever)
        return force @ truth.mounting

    return simulate_session(options, turned, plan=plan, disturb=felt)


def _in_body(plan: Plan, t_s: np.ndarray, vectors_t: np.ndarray) -> np.ndarray:
    angles = table.move(plan, t_s).angles
    basis = [table.table_to_body(angles, axis) for axis in np.eye(3)]
    return np.asarray(sum(part[:, None] * axis for part, axis in zip(vectors_t.T, basis, strict=True)))


def _by_clock(recording: Recording, truth: UnitTruth) -> Recording:
    """Stamps as the unit's own clock gives them, whole microseconds."""
    t_us = (recording.t_us - truth.offset_s * 1e6) / (1 + truth.rate)
    return replace(recording, t_us=np.rint(t_us).astype(np.int64))


def _falsified(simulation: Simulation, dps: float) -> Recording:
    """With readings that no body has made, about x."""
    start, stop = simulation.plan.turns[min(FALSE_TURN, len(simulation.plan.turns) - 1)]
    row = round((start + FALSE_AT * (stop - start)) * simulation.unit.odr_hz)
    gyro = simulation.log.gyro.copy()
    more = round(dps * DEG / simulation.options.register_units.gyro_rps)
    gyro[row : row + FALSE_ROWS, 0] = np.clip(gyro[row : row + FALSE_ROWS, 0].astype(int) + more, -32767, 32767)
    return replace(simulation.log, gyro=gyro)
