"""Write a simulated session as a folder (docs/formats.md, ``tinygc-session/1``), with its truth."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import MOST_TOML, folder_whole, read_bytes, refuse_unfinished, write_new
from session.base.names import has_recorded_name
from session.base.texts import comment
from session.base.units import DEG, MG
from session.log.config import Accelerometer, Config, Protocol, Sensor, Site
from session.log.logfile import NAME as KNOWN_TURNS
from session.log.logfile import KnownTurn
from session.log.written import toml_text, turns_text
from tinygc.simulation.movement import MovementPlan, gimbal_angles, table_to_body
from tinygc.simulation.options import SimulatedUnit, SimulationOptions, in_python
from tinygc.simulation.sensor import Distort, RegisterLog
from tinygc.simulation.simulator import Simulation, simulate_session

# ``turns.csv`` of a simulated session: turns about one gimbal against a stop of given repeatability.

#: the stop's own random stream, after those of ``simulator.py``
STREAM = 6
#: digits of a turn axis, as a user may have measured it
AXIS_DIGITS = 4
#: smallest useful turn
LEAST_RAD = 10 * DEG


def stopped_turns(plan: MovementPlan, options: SimulationOptions) -> tuple[KnownTurn, ...]:
    """Turns of a plan about one gimbal alone; each stated angle has an error of the stop's repeatability, drawn from the seed."""
    if options.stop_sigma_deg == 0:
        return ()
    rng = np.random.default_rng(options.seed).spawn(STREAM + 1)[STREAM]
    found = []
    for number, (start_s, stop_s) in enumerate(plan.turns):
        strokes = [stroke for stroke in plan.strokes if start_s - 1e-9 <= stroke.start_s < stop_s]
        error = rng.normal() * options.stop_sigma_deg * DEG  # drawn for every turn, used or not, which keeps the errors of the others
        change = sum(stroke.change_rad for stroke in strokes)
        if len({stroke.gimbal for stroke in strokes}) != 1 or abs(change) < LEAST_RAD:
            continue
        before = gimbal_angles(plan.start_rad, plan.strokes, np.array([start_s]))[0][:, 0]
        # Axis (3,) of a gimbal in the body, at angles (3,) rad, outer middle inner; it depends on the gimbals inside it alone.
        gimbal = strokes[0].gimbal
        within = np.where(np.arange(3) > gimbal, before, 0.0)
        axis = np.round(table_to_body(within[:, None], np.eye(3)[2 - gimbal])[0], AXIS_DIGITS)
        words = ";".join(f"{x:g}" for x in axis)
        angle_deg = round((change + error) / DEG, 6)
        found.append(KnownTurn(number, None, axis / np.linalg.norm(axis), words, angle_deg * DEG, options.stop_sigma_deg * DEG))
    return tuple(found)


# Write a simulated session as a folder (docs/formats.md, ``tinygc-session/1``), with its truth.

HEADER = "t_us,gx,gy,gz,ax,ay,az,temp"
TRUTH_SCHEMA = "tinygc-truth/1"
GZIP_LEVEL = 4  #: level 6 takes four times as long for six percent
GZIP_BITS = 16 + zlib.MAX_WBITS  #: gzip's header and checksum
ROWS = 1 << 14  #: that are text at a time
LOG, CLOSURE, CONFIG, TRUTH = "log0001.csv.gz", "closure0001.csv.gz", "session.toml", "truth.json"
REST = "rest0001.csv.gz"
#: files of a simulation, of a rest log and of an array too
FILES = re.compile(r"session\.toml|truth\.json|turns\.csv|(log|closure|rest)0001(\.unit\d+)?\.csv\.gz")
#: first words in the session.toml of a simulation
SIMULATED = "# SIMULATED"


def write_session(
    options: SimulationOptions,
    folder: Path,
    force: bool = False,
    distort: Distort | None = None,
) -> Path:
    """Simulate a session and write its folder; returns the folder.

    distort as for ``simulate_session``.  The same arguments
    give the same bytes.  Raises FormatError if the folder is not empty: ``force`` replaces an earlier simulation, nothing else.
    """
    check_folder(folder, force)
    return write_simulation(simulate_session(options, distort), folder, force, concealed=distort is not None)


def write_simulation(
    simulation: Simulation,
    folder: Path,
    force: bool = False,
    effects: Mapping[str, object] | None = None,
    concealed: bool | None = None,
) -> Path:
    """Write the folder of a simulated session, and its truth; concealed: whether session.toml states that an effect is hidden (by
    default, if effects are given).  Raises FormatError as ``write_session`` does."""
    check_folder(folder, force)
    truth = json.dumps(truth_table(simulation, effects or {}), indent=1) + "\n"
    head = head_of(simulation.options, bool(effects) if concealed is None else concealed)
    write_files(simulation, folder, config_of(simulation.options, simulation.unit), head, truth)
    return folder


def write_files(simulation: Simulation, folder: Path, config: Config, head: str = "", truth: str = "") -> None:
    """Write the files of a recorded session: session.toml, log, closure run, turns of known angle; truth.json, if any."""
    with folder_whole(folder, earlier_in(folder)) as work:
        write_new(work / CONFIG, head + toml_text(config))
        write_log(work / LOG, simulation.options, simulation.unit.odr_hz, simulation.log)
        if turns := stopped_turns(simulation.plan, simulation.options):
            write_new(work / KNOWN_TURNS, turns_text(turns))
        if simulation.closure is not None:
            write_log(work / CLOSURE, simulation.options, simulation.unit.odr_hz, simulation.closure)
        if truth:
            write_new(work / TRUTH, truth)


def check_folder(folder: Path, force: bool) -> None:
    """Raise FormatError if a simulation may not be written there: other files are present, or a simulation and ``force`` is not set."""
    if folder.exists() and not folder.is_dir():
        raise FormatError(f"{folder}: that is a file; give a new folder")
    refuse_unfinished(folder)
    present = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    if not present:
        return
    if not force:
        raise FormatError(f"{folder}: not empty; give a new folder, or --force to replace an earlier simulation")
    if TRUTH not in present:
        raise FormatError(f"{folder}: holds no simulation ({TRUTH} is missing) and is not replaced; give a new folder")
    if strangers := [name for name in present if not _is_a_simulations(folder / name)]:
        raise FormatError(f"{folder}: holds {min(strangers)} next to a simulation and is not replaced; give a new folder")


def earlier_in(folder: Path) -> list[str]:
    """Names of the files of a simulation in a folder, which another one replaces."""
    return [path.name for path in folder.glob("*") if FILES.fullmatch(path.name)]


def _is_a_simulations(path: Path) -> bool:
    """Whether a simulation may have written the file: a linked file belongs to others, and session.toml of a simulation is marked."""
    if path.name == CONFIG and not path.is_symlink():
        return read_bytes(path, MOST_TOML).startswith(SIMULATED.encode())
    is_others = path.is_symlink() or path.stat().st_nlink > 1 or not FILES.fullmatch(path.name)
    return not (has_recorded_name(path) and is_others)


def write_log(path: Path, options: SimulationOptions, odr_hz: float, log: RegisterLog, serial: str = "") -> None:
    """Write a log as compressed text; odr_hz: its true rate; serial: of the unit, if not the options'."""
    ranges = f"gyro_fs_dps={options.gyro_fs_dps:g} accel_fs_g={options.accel_fs_g:g}"
    packer = zlib.compressobj(GZIP_LEVEL, zlib.DEFLATED, GZIP_BITS)  # it writes no time: the same seed gives the same bytes
    head = f"# {ranges} odr_hz={odr_hz:.4f} serial={serial or serial_of(options)}\n{HEADER}\n"
    packed = [packer.compress(head.encode("ascii"))]
    for first in range(0, len(log.t_us), ROWS):
        part = log.part(first, first + ROWS)
        row = ",".join(["%d"] * 8) + "\n"
        cells = np.column_stack([part.t_us, part.rows]).ravel().tolist()
        packed.append(packer.compress((row * len(part.t_us) % tuple(cells)).encode("ascii")))
    write_new(path, b"".join([*packed, packer.flush()]))


def serial_of(options: SimulationOptions) -> str:
    """Serial number of the unit of a session."""
    return f"SIM-{options.unit_drawn_from}"


def config_of(options: SimulationOptions, unit: SimulatedUnit, calibrated: bool = True) -> Config:
    """session.toml of a simulated session; calibrated: whether it holds the accelerometer's pre-calibration."""
    return Config(
        Sensor(options.sensor, serial_of(options), float(options.odr_hz), options.gyro_fs_dps, options.accel_fs_g),
        Accelerometer(unit.accel_matrix, unit.accel_bias) if calibrated else Accelerometer(source="none"),
        Site(float(options.latitude_deg), float(options.gravity_mps2), unit.heading_deg if options.with_heading else None),
        Protocol(float(options.still_s), float(2 * options.still_s + options.turn_s)),
    )


def head_of(options: SimulationOptions, concealed: bool = False) -> str:
    """First lines of session.toml: that it is simulated, and how to make it again."""
    remark = f"# Physics is concealed in it, too: {TRUTH} names it.\n" if concealed else ""
    return f"{SIMULATED}, not recorded.  To make it again: {comment(in_python(options))}\n{remark}"


def truth_table(simulation: Simulation, effects: Mapping[str, object]) -> dict:
    """Content of ``tinygc-truth/1``: drawn parameters and hidden effects."""
    options, unit, plan = simulation.options, simulation.unit, simulation.plan
    return {
        "schema": TRUTH_SCHEMA,
        "effects": dict(effects),
        "E": unit.E.tolist(),
        "B_dps": (unit.B / DEG).tolist(),
        "heading_deg": unit.heading_deg,
        "lever_m": list(options.lever_m),
        "odr_hz": unit.odr_hz,
        "accel_shift_mg": (unit.accel_shift / MG).tolist(),
        "gyro_noise_dps_rthz": options.gyro_noise_dps_rthz,
        "accel_noise_ug_rthz": options.accel_noise_ug_rthz,
        "bias_instability_dph": options.bias_instability_dph,
        "turns_s": [list(turn) for turn in plan.turns],
        "closure_s": list(plan.closure) if plan.closure else None,
        "options": asdict(options),
    }
