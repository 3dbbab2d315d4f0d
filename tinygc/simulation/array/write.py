"""A simulated array as the folder that recorded ones have (docs/arrays.md), and its truth beside it."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from session.common.errors import FormatError
from session.common.texts import comment
from session.common.units import DEG
from session.files.reading import MOST_TOML, read_bytes
from session.files.writing import naming, result_folder
from session.log.config import SCHEMA
from session.log.toml_text import line
from tinygc.simulation.array.simulate import SimulatedArray
from tinygc.simulation.options import command_line
from tinygc.simulation.simulate import Recording, Simulation
from tinygc.simulation.unit import BIAS_DIGITS, MATRIX_DIGITS
from tinygc.simulation.write import CONFIG, SIMULATED, TRUTH, names_in, packed_log, truth_table

TRUTH_SCHEMA = "tinygc-array-truth/1"


def write_array(array: SimulatedArray, folder: Path, force: bool = False) -> Path:
    """``log0001.unit0.csv.gz`` and so on; returns the folder.  FormatError where it holds something: ``force`` replaces an earlier
    simulation of an array, nothing else."""
    check_array_folder(folder, force)
    with result_folder(folder), naming(folder):
        for path in folder.glob("*.unit*.csv.gz"):
            path.unlink()
        (folder / CONFIG).write_text(array_config_text(array), encoding="utf-8")
        for number, unit in enumerate(array.units):
            _write_log(folder / f"log0001.unit{number}.csv.gz", number, unit, unit.log)
            if unit.closure is not None:
                _write_log(folder / f"closure0001.unit{number}.csv.gz", number, unit, unit.closure)
        (folder / TRUTH).write_text(json.dumps(array_truth(array), indent=1) + "\n", encoding="utf-8")
    return folder


def check_array_folder(folder: Path, force: bool) -> None:
    """FormatError where a simulated array may not be written there."""
    present = names_in(folder, force)
    if not present:
        return
    mine = {name for name in present if name in (CONFIG, TRUTH, "fit", "explain") or (".unit" in name and name.endswith(".csv.gz"))}
    config = folder / CONFIG
    made = TRUTH in present and CONFIG in present and not config.is_symlink()
    made = made and read_bytes(config, MOST_TOML).startswith(SIMULATED.encode())
    if not made or present - mine:
        what = min(present - mine, default=CONFIG)
        raise FormatError(f"{folder}: holds {what} beside or instead of a simulated array and is not replaced; give a new folder")


def _write_log(path: Path, number: int, unit: Simulation, recording: Recording) -> None:
    ranges = f"gyro_fs_dps={unit.options.gyro_fs_dps:g} accel_fs_g={unit.options.accel_fs_g:g}"
    said = f"# {ranges} odr_hz={unit.unit.odr_hz:.4f} serial={_serial(unit, number)}"
    path.write_bytes(packed_log(said, np.column_stack([recording.t_us, recording.gyro, recording.accel, recording.temp])))


def _serial(unit: Simulation, number: int) -> str:
    return f"SIM-{unit.options.unit_drawn_from}-{number}"


def array_config_text(array: SimulatedArray) -> str:
    """session.toml of the array."""
    options = array.options
    units = []
    for number, each in enumerate(array.units):
        matrix = ", ".join("[" + ", ".join(f"{x:.{MATRIX_DIGITS}f}" for x in row) + "]" for row in each.unit.accel_matrix)
        bias = ", ".join(f"{x:.{BIAS_DIGITS}f}" for x in each.unit.accel_bias)
        units.append(f"""
[[array.unit]]
number = {number}
sensor.serial = "{_serial(each, number)}"
accelerometer.matrix = [{matrix}]
accelerometer.bias_mps2 = [{bias}]
""")
    chosen = " ".join(f"{name}={value!r}" for name, value in asdict(array.array).items())
    return f"""\
{SIMULATED}, not recorded: {comment(command_line(options))} --units {array.array.units}
# {comment(chosen)}
schema = "{SCHEMA}"

[sensor]
{line("model", options.sensor)}odr_hz = {float(options.odr_hz)!r}
gyro_fs_dps = {options.gyro_fs_dps:g}
accel_fs_g = {options.accel_fs_g:g}

[site]
latitude_deg = {float(options.latitude_deg)!r}
gravity_mps2 = {float(options.gravity_mps2)!r}

[protocol]
still_s = {float(options.still_s)!r}
segment_s = {float(2 * options.still_s + options.turn_s)!r}
reference = "gravity"
{"".join(units)}"""


def array_truth(array: SimulatedArray) -> dict:
    """``tinygc-array-truth/1``: what was drawn."""
    return {
        "schema": TRUTH_SCHEMA,
        "array": asdict(array.array),
        "units": [
            {
                "number": number,
                "mounting_rotvec_deg": (Rotation.from_matrix(truth.mounting).as_rotvec() / DEG).tolist(),
                "position_m": truth.position_m.tolist(),
                "clock_offset_s": truth.offset_s,
                "clock_rate": truth.rate,
                "session": truth_table(unit, {}),
            }
            for number, (unit, truth) in enumerate(zip(array.units, array.truths, strict=True))
        ],
        "jerks_s": [float(at) for jerks in array.jerks for at in jerks.at_s],
    }
