"""Simulated sessions on a virtual table, offline: from a list of moves to the files of a session that a machine turned.

A table at rest makes its moves one after the other, with a rest before, between and behind.  Its word is asked at a steady pace: each
answer has the time of the last sample before it, as in ``table.csv``, and says the motor's angle ``latency_s`` earlier.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from session.annexes.machines.angles import NAME as ANGLES
from session.annexes.machines.angles import header, row
from session.annexes.machines.description import NAME as TABLE
from session.annexes.machines.description import SCHEMA, Axis, Description
from session.annexes.machines.kinematics import attitudes, roll_pitch_yaw
from session.annexes.machines.mechanics import AxisTrack, TableErrors
from session.io.files import naming, result_folder
from session.io.folder import ATTITUDES
from session.io.toml import line
from session.io.units import DEG
from session.io.written import attitudes_text
from tinygc.annexes.machines.sensor_on_table import SensorOnTable
from tinygc.simulation.options import SimulatedUnit, SimulationOptions
from tinygc.simulation.simulator import Distort, RegisterLog, Simulation, plan_of, unit_of
from tinygc.simulation.write import CONFIG, check_folder, config_text, packed_log

LOG = "log0001.csv.gz"
#: s behind the last move of an axis, until its rest counts
SETTLED_S = 0.05


@dataclass(frozen=True)
class Move:
    """Axes to angles, together: angles_rad (K,) of all axes, those that stay included; rate_rps: at most that fast."""

    angles_rad: tuple[float, ...]
    rate_rps: float


@dataclass(frozen=True)
class LostSteps:
    """A motor that falls behind: rad of one axis, lost evenly over ``span_s`` in the middle of the move of that number."""

    move: int
    axis: int
    lost_rad: float
    span_s: float = 0.1


@dataclass(frozen=True, eq=False)
class TableSession:
    """A simulated session of a table, in memory.

    log: registers; begin_s: of each rest (Q,); rest_angles (Q, K) rad, as said there; polls: times (N,) s, said angles (N, K) rad and
    whether anything moved (N,); table; unit and options of the sensor.
    """

    table: Description
    options: SimulationOptions
    unit: SimulatedUnit
    log: RegisterLog
    begin_s: np.ndarray
    rest_angles: np.ndarray
    poll_s: np.ndarray
    said: np.ndarray
    moving: np.ndarray

    def save(self, folder: Path, force: bool = False) -> Path:
        """Write session.toml, the log, table.toml, table.csv and attitudes.csv; FormatError as ``write_session`` raises it."""
        check_folder(folder, force)
        config = config_text(Simulation(self.options, plan_of(self.options), self.unit, self.log, None), concealed=False)
        with result_folder(folder), naming(folder):
            (folder / CONFIG).write_text(config, encoding="utf-8")
            said = f"# gyro_fs_dps={self.options.gyro_fs_dps:g} accel_fs_g={self.options.accel_fs_g:g} odr_hz={self.unit.odr_hz:.4f}"
            log = self.log
            (folder / LOG).write_bytes(packed_log(said, log.t_us, log.gyro, log.accel, log.temp))
            (folder / TABLE).write_text(description_text(self.table), encoding="utf-8")
            (folder / ANGLES).write_text("\n".join(self.angle_lines()) + "\n", encoding="utf-8")
            dials = roll_pitch_yaw(attitudes(self.table, self.rest_angles))
            (folder / ATTITUDES).write_text(attitudes_text(dials), encoding="utf-8")
        return folder

    def angle_lines(self) -> list[str]:
        """Lines of ``table.csv``."""
        at = np.searchsorted(self.log.t_us, self.poll_s * 1e6, side="right") - 1
        answers = zip(self.log.t_us[at].tolist(), self.poll_s.tolist(), self.moving.tolist(), self.said, strict=True)
        return [header(self.table), *(row(LOG, t_us, t_s, moving, angles) for t_us, t_s, moving, angles in answers)]


@dataclass(eq=False)
class _Slipping:
    """The track of a stage whose motor loses steps: what ``SensorOnTable`` turns by."""

    motor: AxisTrack
    lost: list[tuple[float, float, float]] = field(default_factory=list)  #: begin s, span s, rad

    def said_and_sense(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angle, sense = self.motor.said_and_sense(t_s)
        return angle - sum(rad * np.clip((t_s - begin) / span, 0, 1) for begin, span, rad in self.lost), sense


def simulate_on_table(
    table: Description,
    moves: Sequence[Move],
    options: SimulationOptions,
    errors: TableErrors | None = None,
    *,
    lost: Sequence[LostSteps] = (),
    unit: SimulatedUnit | None = None,
    distort: Distort | None = None,
    poll_hz: float = 50.0,
    start_rad: Sequence[float] | None = None,
) -> TableSession:
    """Simulate a session of these moves; the same arguments give the same registers and answers.

    errors: of the table, none by default; lost: steps that motors lose; unit: of the sensor, drawn from the options' seed by default;
    distort: hidden physics of the gyroscope; start_rad (K,): where the axes stand at first, 0 by default.
    """
    unit, errors = unit or unit_of(options), errors or TableErrors.none(table)
    angles = np.zeros(len(table.axes)) if start_rad is None else np.array(start_rad, dtype=float)
    tracks = [AxisTrack(float(angle), of.backlash) for angle, of in zip(angles, errors.axes, strict=True)]
    slipping = [_Slipping(track) for track in tracks]
    t_s, begin_s, rests = options.still_s, [0.0], [angles]
    for number, move in enumerate(moves):
        began = t_s
        for axis, (track, goal, of) in enumerate(zip(tracks, move.angles_rad, table.axes, strict=True)):
            track.turn_to(began, goal, move.rate_rps, of.acceleration_rps2)
            t_s = max(t_s, track.busy_until_s)
            for slip in lost:
                if (slip.move, slip.axis) == (number, axis):
                    middle = (began + track.busy_until_s) / 2
                    slipping[axis].lost.append((middle - slip.span_s / 2, slip.span_s, slip.lost_rad))
        begin_s.append(t_s + SETTLED_S)
        rests.append(np.array(move.angles_rad))
        t_s += SETTLED_S + options.still_s
    sensor = SensorOnTable(table, errors, options, unit, distort)
    log = sensor.take(slipping, int(np.ceil(t_s * unit.odr_hz)))  # type: ignore[arg-type]
    polls = np.arange(0.5, t_s * poll_hz - 0.5)
    # A computer asks when it gets to it.
    poll_s = (polls + np.random.default_rng(options.seed).spawn(5)[4].uniform(-0.25, 0.25, len(polls))) / poll_hz
    said = np.stack([track.said_and_sense(poll_s - errors.latency_s)[0] for track in tracks], axis=-1)
    moving = np.zeros(len(poll_s), dtype=bool)
    moving[1:] = (np.diff(said, axis=0) != 0).any(axis=1)
    return TableSession(table, options, unit, log, np.array(begin_s), np.array(rests), poll_s, said, moving)


def fixed_moves(table: Description, count: int, rate_rps: float, seed: int = 0, step_rad: float = 30 * DEG) -> list[Move]:
    """``count`` moves of one axis each, in turn, by multiples of a step within the axis' limits (a turn either way where it has none)."""
    rng, angles, found = np.random.default_rng(seed), np.zeros(len(table.axes)), []
    for number in range(count):
        axis = number % len(table.axes)
        of = table.axes[axis]
        least, most = (-np.pi, np.pi) if of.least_rad is None or of.most_rad is None else (of.least_rad, of.most_rad)
        goals = step_rad * np.arange(np.ceil(least / step_rad - 1e-9), np.floor(most / step_rad + 1e-9) + 1)
        goals = goals[np.abs(goals - angles[axis]) > 1.9 * step_rad]
        angles = angles.copy()
        angles[axis] = rng.choice(goals)
        found.append(Move(tuple(angles.tolist()), rate_rps * float(rng.choice([0.5, 1.0]))))
    return found


def description_text(table: Description) -> str:
    """A description as the text of ``table.toml``."""
    mounting = ", ".join("[" + ", ".join(f"{x:.9f}" for x in each) + "]" for each in table.mounting)
    said = f'schema = "{SCHEMA}"\n{line("name", table.name)}{line("make", table.make)}mounting = [{mounting}]\n'
    return said + "".join(_axis_text(axis) for axis in table.axes)


def _axis_text(axis: Axis) -> str:
    direction = ", ".join(f"{x:.12g}" for x in axis.direction)
    limits: Mapping[str, float | None] = {"least_deg": axis.least_rad, "most_deg": axis.most_rad}
    numbers = {
        "fastest_dps": axis.fastest_rps,
        "acceleration_dps2": axis.acceleration_rps2,
        "sigma_deg": axis.sigma_rad,
        "backlash_deg": axis.backlash_rad,
    } | {name: value for name, value in limits.items() if value is not None}
    rows = "".join(f"{name} = {float(value) / DEG:.12g}\n" for name, value in numbers.items())
    return f'\n[[axis]]\nname = "{axis.name}"\ndirection = [{direction}]\n{rows}'
