"""Simulate an array: one motion of the body, each unit with its own extrinsics, clock, errors and noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from session.base.files import folder_whole, write_new
from session.base.records import write_whole
from session.base.texts import comment
from session.base.units import DEG, MG
from session.log.written import toml_text
from tinygc.features.arrays.clocks import UnitClock, UnitPlace
from tinygc.features.arrays.feature import ArrayOptions
from tinygc.simulation import movement
from tinygc.simulation.movement import MovementPlan
from tinygc.simulation.options import SimulationOptions, in_python
from tinygc.simulation.sensor import Distort, Motion, RegisterLog
from tinygc.simulation.simulator import Simulation, plan_of, simulate_session, unit_of
from tinygc.simulation.write import (
    CONFIG,
    SIMULATED,
    TRUTH,
    check_folder,
    config_of,
    earlier_in,
    serial_of,
    truth_table,
    write_log,
)

# Jerks: short rotations of the body in addition to the table's, about one axis each, that return; exact in rate, attitude and acceleration.

#: width (sigma) of a jerk in periods of the data rate: two thirds of its power lie above half the rate
WIDTH_PERIODS = 0.4
JERKS_A_TURN = 3
#: share of a turn's length; jerks stay away from its ends, where the body comes to rest
MARGIN = 0.15
#: widths after which a jerk has decayed
OVER = 6.0


@dataclass(frozen=True, eq=False)
class Jerks:
    """Gaussian jerks of the angle: at_s (J,), size_rad (J,), axis (3,) of unit length, fixed in the body; width_s, sigma of each."""

    at_s: np.ndarray
    size_rad: np.ndarray
    axis: np.ndarray
    width_s: float

    def angle(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (N,) rad, rad/s, rad/s^2 at times (N,) s, increasing."""
        angle, rate, acceleration = np.zeros((3, len(t_s)))
        for at, size in zip(self.at_s, self.size_rad, strict=True):
            rows = slice(*np.searchsorted(t_s, [at - OVER * self.width_s, at + OVER * self.width_s]))
            x = (t_s[rows] - at) / self.width_s
            bell = size * np.exp(-(x**2) / 2)
            angle[rows] += bell
            rate[rows] -= bell * x / self.width_s
            acceleration[rows] += bell * (x**2 - 1) / self.width_s**2
        return angle, rate, acceleration

    def rate(self, t_s: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Return the rate (N, 3) rad/s of the jerked body, in its axes, from the table's rate."""
        angle, own, _ = self.angle(t_s)
        return self._seen(rate, angle) + own[:, None] * self.axis

    def force(self, t_s: np.ndarray, force: np.ndarray, lever_m: np.ndarray) -> np.ndarray:
        """Return (N, 3) m/s^2 at a lever from the crossing of the gimbals, about which the jerk also turns."""
        angle, _, acceleration = self.angle(t_s)
        return self._seen(force, angle) + acceleration[:, None] * np.cross(self.axis, lever_m)

    def _seen(self, vectors: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Rotate vectors (N, 3) into the body turned by angle (N,), Rodrigues."""
        along = (vectors @ self.axis)[:, None] * self.axis
        across = vectors - along
        return along + across * np.cos(angle)[:, None] - np.cross(self.axis, vectors) * np.sin(angle)[:, None]


def jerks_of(at_s: np.ndarray, odr_hz: float, rng: np.random.Generator, size_rad: float, spread: bool) -> Jerks:
    """Draw jerks at these times; spread: whether size_rad is their sigma."""
    axis = rng.normal(size=3)
    size = rng.normal(size=len(at_s)) if spread else np.ones(len(at_s))
    return Jerks(at_s, size_rad * size, axis / np.linalg.norm(axis), WIDTH_PERIODS / odr_hz)


# Units of an array, each simulated like a session of its own, under one motion of the body.

#: position of the false readings in a turn, and their number
FALSE_AT, FALSE_ROWS, FALSE_TURN = 0.5, 3, 1


@dataclass(frozen=True, eq=False)
class SimulatedArray:
    """Simulated array: each unit's session, stamped by its own clock; truths of their extrinsics, by clocks about 0; jerks and knocks of
    all."""

    options: SimulationOptions
    array: ArrayOptions
    plan: MovementPlan
    units: tuple[Simulation, ...]
    truths: tuple[UnitPlace, ...]
    jerks: tuple[Jerks, ...]


def simulate_array(options: SimulationOptions, array: ArrayOptions, distort: Mapping[int, Distort] | None = None) -> SimulatedArray:
    """Simulate all units; equal arguments give equal registers.  distort: by unit, the injected errors of that unit, in its own axes."""
    plan, rng = plan_of(options), np.random.default_rng([options.seed, 16])
    place_rng, jerk_rng, table_rng = rng.spawn(3)
    truths = tuple(_placed(array, number, place_rng) for number in range(array.units))
    jerks = []
    if array.jerk_deg:
        start, stop = np.repeat(np.array(plan.turns), JERKS_A_TURN, axis=0).T
        at_s = start + (stop - start) * jerk_rng.uniform(MARGIN, 1 - MARGIN, len(start))
        jerks.append(jerks_of(at_s, options.odr_hz, jerk_rng, array.jerk_deg * DEG, True))
    if array.knock_deg:
        middle_s = np.mean(plan.turns[len(plan.turns) // 2], keepdims=True)
        jerks.append(jerks_of(middle_s, options.odr_hz, jerk_rng, array.knock_deg * DEG, False))
    level = table_rng.normal(size=(len(plan.turns) + 1, 2)) * array.reference_error_mg * MG
    heading_deg = unit_of(options).heading_deg
    units = []
    for number, truth in enumerate(truths):
        seed = int(np.random.SeedSequence([options.unit_drawn_from, number]).generate_state(1)[0])
        x, y, z = (float(length) for length in np.array(options.lever_m) + truth.position_m)
        own = replace(options, seed=seed, unit_seed=seed, lever_m=(x, y, z), heading_deg=heading_deg)
        if array.synchronous and options.odr_error is None:
            own = replace(own, odr_error=0.0)
        felt = _motion_of(movement.motion_of(own, unit_of(own), plan), plan, truth, jerks, level, np.array(own.lever_m))
        simulation = simulate_session(own, (distort or {}).get(number), plan=plan, motion=felt)
        simulation = replace(simulation, log=_by_clock(simulation.log, truth))
        if simulation.closure is not None:
            simulation = replace(simulation, closure=_by_clock(simulation.closure, truth))
        if array.false_reading_dps and number == array.units - 1:
            # Add false readings about x, which no motion has caused
            start, stop = simulation.plan.turns[min(FALSE_TURN, len(simulation.plan.turns) - 1)]
            row = round((start + FALSE_AT * (stop - start)) * simulation.unit.odr_hz)
            gyro = simulation.log.gyro.copy()
            more = round(array.false_reading_dps * DEG / simulation.options.register_units.gyro_rps)
            gyro[row : row + FALSE_ROWS, 0] = np.clip(gyro[row : row + FALSE_ROWS, 0].astype(int) + more, -32767, 32767)
            simulation = replace(simulation, log=replace(simulation.log, gyro=gyro))
        units.append(simulation)
    return SimulatedArray(options, array, plan, tuple(units), truths, tuple(jerks))


def _placed(array: ArrayOptions, number: int, rng: np.random.Generator) -> UnitPlace:
    """Draw a unit's extrinsics; the number of draws does not depend on the options, so one option does not change the others' draws."""
    mounting, position, offset, rate = rng.normal(size=3), rng.normal(size=3), rng.normal(), rng.normal()
    if number == 0:
        return UnitPlace(0, position_m=np.zeros(3))
    clock = not array.synchronous
    return UnitPlace(
        number,
        UnitClock(clock * offset * array.clock_offset_ms * 1e-3, clock * rate * array.clock_rate),
        Rotation.from_rotvec(mounting * array.mounting_deg * DEG).as_matrix(),
        position_m=position * array.position_mm * 1e-3,
    )


def _motion_of(own: Motion, plan: MovementPlan, truth: UnitPlace, jerks: list[Jerks], level_mps2: np.ndarray, lever: np.ndarray) -> Motion:
    """What a unit feels in its own axes, of what it would feel ``own`` in the first unit's without jerks and level accelerations."""
    ends = np.array([(start + stop) / 2 for start, stop in plan.turns])

    def motion(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rate, force, temp_c = own(t_s)
        if level_mps2.any():
            level = np.column_stack([level_mps2[np.searchsorted(ends, t_s)], np.zeros(len(t_s))])
            angles = movement.move(plan, t_s).angles
            basis = [movement.table_to_body(angles, axis) for axis in np.eye(3)]
            force = force + np.asarray(sum(part[:, None] * axis for part, axis in zip(level.T, basis, strict=True)))
        for jerk in jerks:
            rate, force = jerk.rate(t_s, rate), jerk.force(t_s, force, lever)
        return rate @ truth.mounting, force @ truth.mounting, temp_c

    return motion


def _by_clock(recording: RegisterLog, truth: UnitPlace) -> RegisterLog:
    """Stamp by the unit's own clock, in whole microseconds."""
    t_us = (recording.t_us - truth.clock.offset_s * 1e6) / (1 + truth.clock.rate)
    return replace(recording, t_us=np.rint(t_us).astype(np.int64))


# Folder of a simulated array, in the form of a recorded one (docs/features/arrays/arrays.md), with its truth.

TRUTH_SCHEMA = "tinygc-array-truth/1"


def write_array(array: SimulatedArray, folder: Path, force: bool = False) -> Path:
    """Write ``log0001.unit0.csv.gz`` and so on; return the folder.

    Raises FormatError for a folder that is not empty; ``force`` replaces an earlier simulation, and nothing else.
    """
    check_folder(folder, force)
    with folder_whole(folder, earlier_in(folder)) as work:
        write_new(work / CONFIG, array_config_text(array))
        for number, unit in enumerate(array.units):
            for name, log in (("log0001", unit.log), ("closure0001", unit.closure)):
                if log is not None:
                    write_log(work / f"{name}.unit{number}.csv.gz", unit.options, unit.unit.odr_hz, log, _serial(unit, number))
        write_whole(work / TRUTH, array_truth(array))
    return folder


def _serial(unit: Simulation, number: int) -> str:
    return f"{serial_of(unit.options)}-{number}"


def array_config_text(array: SimulatedArray) -> str:
    """Return the text of the array's session.toml."""
    options = array.options
    config = config_of(options, array.units[0].unit, calibrated=False)
    shared = toml_text(replace(config, site=replace(config.site, heading_deg=None))).splitlines(keepends=True)
    own = [f"""
[[array.unit]]
number = {number}
sensor.serial = "{_serial(each, number)}"
accelerometer.matrix = {each.unit.accel_matrix.tolist()}
accelerometer.bias_mps2 = {each.unit.accel_bias.tolist()}
""" for number, each in enumerate(array.units)]  # fmt: skip
    chosen = " ".join(f"{name}={value!r}" for name, value in asdict(array.array).items())
    head = f"{SIMULATED}, not recorded: {comment(in_python(options))}, {array.array.units} units\n# {comment(chosen)}\n"
    return "".join([head, *(line for line in shared if not line.startswith(("#", "serial"))), *own])


def array_truth(array: SimulatedArray) -> dict:
    """Return ``tinygc-array-truth/1``, the values that were drawn."""
    return {
        "schema": TRUTH_SCHEMA,
        "array": asdict(array.array),
        "units": [
            {
                "number": number,
                "mounting_rotvec_deg": Rotation.from_matrix(truth.mounting).as_rotvec() / DEG,
                "position_m": truth.position_m,
                "clock_offset_s": truth.clock.offset_s,
                "clock_rate": truth.clock.rate,
                "session": truth_table(unit, {}),
            }
            for number, (unit, truth) in enumerate(zip(array.units, array.truths, strict=True))
        ],
        "jerks_s": [float(at) for jerks in array.jerks for at in jerks.at_s],
    }
