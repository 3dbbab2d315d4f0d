"""Write a simulated rest log as a session folder, and its truth beside it."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from session.common.errors import CalibrationError
from session.files.writing import naming, result_folder
from session.log.config import SCHEMA
from session.sensor.known import DEFAULT
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.rest import Chip, simulate_rest
from tinygc.simulation.rest_options import RestOptions, rest_flag
from tinygc.simulation.write import CLOSURE, CONFIG, LOG, REST, SIMULATED, TRUTH, TRUTH_SCHEMA, check_folder, packed_log


def write_rest(options: RestOptions, session: SimulationOptions, folder: Path, force: bool = False) -> Path:
    """Simulate a rest log and write its folder; returns the folder.  FormatError as of ``write_session``."""
    check_folder(folder, force)
    if session.sensor != DEFAULT:
        raise CalibrationError(
            f"--sensor is {session.sensor!r}, expected {DEFAULT}: the registers of a rest log are simulated for it alone"
        )
    chip = Chip(
        session.odr_hz,
        session.gyro_fs_dps,
        session.accel_fs_g,
        session.gyro_noise_dps_rthz,
        session.accel_noise_ug_rthz,
        session.bias_instability_dph,
    )
    made = simulate_rest(options, chip, session.seed)
    table = np.column_stack([made.t_us, made.gyro, made.accel, made.temp])
    ranges = f"gyro_fs_dps={chip.gyro_fs_dps:g} accel_fs_g={chip.accel_fs_g:g}"
    comment = f"# {ranges} odr_hz={chip.odr_hz:.4f} serial=SIM-{session.unit_drawn_from}"
    truth = {"schema": TRUTH_SCHEMA, "effects": {}, "rest": asdict(options) | {"knock_s": made.knock_s.tolist()}}
    with result_folder(folder), naming(folder):
        for stale in (LOG, CLOSURE):
            (folder / stale).unlink(missing_ok=True)
        (folder / CONFIG).write_text(_config(session, options), encoding="utf-8")
        (folder / REST).write_bytes(packed_log(comment, table))
        (folder / TRUTH).write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return folder


def _config(session: SimulationOptions, options: RestOptions) -> str:
    given = [f"{rest_flag('cycles')} {options.cycles:g}", f"--seed {session.seed}"]
    return f"""\
{SIMULATED}, not recorded: calibrate.py simulate {" ".join(given)} and what truth.json holds besides
schema = "{SCHEMA}"

[sensor]
model = "ASM330LHH"
serial = "SIM-{session.unit_drawn_from}"
odr_hz = {float(session.odr_hz)!r}
gyro_fs_dps = {session.gyro_fs_dps:g}
accel_fs_g = {session.accel_fs_g:g}

[site]
latitude_deg = {float(session.latitude_deg)!r}
gravity_mps2 = {float(session.gravity_mps2)!r}
"""
