"""An array's fit as ``tinygc-array-fit/1`` (docs/formats.md), and each unit's model as ``tinygc-model/1``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from session.common.errors import CalibrationError
from session.common.units import DEG, DEG_PER_HOUR, NS, G
from session.common.version import VERSION
from session.files.results import write_whole
from session.files.writing import result_folder
from session.log.hashes import input_hashes
from tinygc import models
from tinygc.array.fit import ArrayFit, UnitFit
from tinygc.array.fused.build_model import save_array_model
from tinygc.array.joint.events import ArrayEvent
from tinygc.array.joint.split import Split
from tinygc.array.places.place import UnitPlace
from tinygc.fitting.figures import run_figures
from tinygc.models.accelerometer import accelerometer_table, sensor_table
from tinygc.models.linear import BIAS, MATRIX, PARAMETERS, LinearModel

SCHEMA = "tinygc-array-fit/1"
NAME = "array.json"
#: all units as one gyroscope
FUSED = "model_array.json"
MODEL = "model_least_squares.json"


def array_to_json(fit: ArrayFit) -> dict:
    """The whole result, JSON-ready; angles in degrees, times in seconds of the array's clock from its first sample."""
    begins = begins_s(fit)
    return {
        "schema": SCHEMA,
        "array": fit.array.name,
        "units": [_unit(unit, float(p)) for unit, p in zip(fit.units, fit.split.own_p, strict=True)],
        "left_out": [{"number": unit.number, "why": unit.why} for unit in fit.left_out],
        "turns_used": [len(rows) for rows in fit.same.turns],
        "bias_from": {"used": fit.bias, "p_value": fit.bias_p},
        "sample_ages": [{"number": each.number, "beat_hz": each.beat_hz, "period_s": each.period_s} for each in fit.ages],
        "split": split_to_json(fit.split),
        "turns": [
            {
                "at_s": float(fit.same.time_s[turn.first, 1]) - begins,
                "common_deg": float(np.linalg.norm(turn.common_rad)) / DEG,
                "common_sigma_deg": float(np.linalg.norm(turn.sigma_rad)) / DEG,
                "own_deg": [None if np.isnan(size) else size / DEG for size in turn.own_rad],
            }
            for turn in fit.split.turns
        ],
        "events": [event_to_json(event, fit) for event in fit.joint.events],
        "version": VERSION,
    }


def begins_s(fit: ArrayFit) -> float:
    """s of the array's clock at its first sample."""
    return float(fit.array.units[0].logs[0].samples.t_ns[0]) * NS


def place_to_json(place: UnitPlace) -> dict:
    """``clock``, ``mounting``, ``position`` of a unit; null where it is not known."""
    known = place.position_m is not None and place.position_covariance is not None
    return {
        "clock": {
            "offset_s": place.clock.offset_s,
            "offset_sigma_s": place.clock.offset_sigma_s,
            "rate_ppm": place.clock.rate * 1e6,
            "rate_sigma_ppm": place.clock.rate_sigma * 1e6,
            "about_s": place.clock.about_s,
        },
        "mounting": {
            "rotvec_deg": (Rotation.from_matrix(place.mounting).as_rotvec() / DEG).tolist(),
            "sigma_deg": (np.sqrt(np.diag(place.mounting_covariance)) / DEG).tolist(),
            "matrix": place.mounting.tolist(),
        },
        "position": {
            "metres": place.position_m.tolist() if known else None,  # type: ignore[union-attr]
            "sigma_m": np.sqrt(np.diag(place.position_covariance)).tolist() if known else None,  # type: ignore[arg-type]
        },
    }


def _unit(unit: UnitFit, own_p: float) -> dict:
    return {
        "number": unit.number,
        "serial": unit.session.config.sensor.serial,
        **place_to_json(unit.place),
        "closure": {
            "alone_rms_deg": unit.closure_rad / DEG,
            "floor_rms_deg": unit.floor_rad / DEG,
            "own_rms_deg": unit.own_rad[0] / DEG,
            "own_sigma_deg": _or_none(unit.own_rad[1] / DEG),
            "own_p_value": own_p,
            "minus_mean_rms_deg": _or_none(unit.minus_mean_rad / DEG),
        },
        "noise": {
            "gyro_dps_rthz": (unit.noise.gyro / DEG).tolist(),
            "accel_g_rthz": (unit.noise.accel / G).tolist(),
            "bias_instability_dph": unit.instability.rps / DEG_PER_HOUR,
        },
        "E": unit.model.E.tolist(),
        "B_dps": (unit.model.B / DEG).tolist(),
        "E_sigma": unit.sigma[MATRIX].reshape(3, 3).tolist(),
        "B_sigma_dps": (unit.sigma[BIAS] / DEG).tolist(),
        "E_sigma_alone": unit.sigma_alone[MATRIX].reshape(3, 3).tolist(),
        "B_sigma_alone_dps": (unit.sigma_alone[BIAS] / DEG).tolist(),
        "unobserved": list(unit.unobserved),
        "closure_runs": [
            {"file": run.file, "duration_s": run.duration_s, "rmse_deg": run_figures(error)["rmse_deg"]} for run, error in unit.runs
        ],
        "model": f"unit{unit.number}/{MODEL}",
    }


def split_to_json(split: Split) -> dict:
    """``split``: tilt, rms a turn, that all units miss by in common, and what of it goes as fast motion is predicted to."""
    return {
        "common_rms_deg": split.common / DEG,
        "common_p_value": split.p_value,
        "equal_in_all_turns_deg": {"size": split.turn[0] / DEG, "sigma": _or_none(split.turn[1] / DEG)},
        "undersampled_deg": {
            "size": split.fast[0] / DEG,
            "sigma": _or_none(split.fast[1] / DEG),
            "predicted": split.predicted / DEG,
        },
        "level_acceleration_mg": {"size": 1e3 * split.level_mps2[0] / G, "sigma": _or_none(1e3 * split.level_mps2[1] / G)},
        "is_fast_motion": split.is_fast_motion,
        "minus_mean_rms_deg": _or_none(split.minus_mean_rad / DEG),
        "says": split.words,
    }


def event_to_json(event: ArrayEvent, fit: ArrayFit) -> dict:
    """One of ``events``: turns in degrees, stills in mg; unit null: of all."""
    turn = "turn" in event.what
    return {
        "what": event.what,
        "unit": None if event.unit is None else fit.units[event.unit].number,
        "rival": None if event.rival is None else fit.units[event.rival].number,
        "at_s": float(fit.same.time_s[event.first, 1 if turn else 0]) - begins_s(fit),
        "size": event.size / DEG if turn else 1e3 * event.size / G,
        "unit_of_size": "deg" if turn else "mg",
        "p_value": event.p_value,
    }


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def unit_model(unit: UnitFit) -> LinearModel:
    """The unit's model for its own log: in seconds of its own clock, which the array's may outrun."""
    pace = 1 + unit.place.clock.rate
    return LinearModel(unit.model.E * pace, unit.model.B * pace)


def unit_table(fit: ArrayFit, unit: UnitFit) -> dict:
    """``tinygc-model/1`` of one unit, for its own log and clock, as a fit of a single session writes it."""
    pace = 1 + unit.place.clock.rate
    return models.to_dict(
        unit_model(unit),
        method="least_squares",
        session=fit.array.name,
        sha256=input_hashes(unit.session),
        version=VERSION,
        sensor=sensor_table(unit.session.config.sensor),
        accelerometer=accelerometer_table(unit.accelerometer),
        covariance=(unit.covariance[:PARAMETERS, :PARAMETERS] * pace**2).tolist(),
        unobserved=list(unit.unobserved),
    )


def save_array(fit: ArrayFit, folder: Path | None = None) -> Path:
    """``array.json``, ``model_array.json``, and of each unit ``unit3/model_least_squares.json``, into a folder; returns it.

    Without one it is ``fit`` in the array's.  CalibrationError where the array was never a folder and none is given.
    """
    if folder is None and not fit.array.folder.is_dir():
        raise CalibrationError(f"{fit.array.name}: made of arrays, it has no folder of its own; give one to save to")
    folder = folder or fit.array.folder / "fit"
    with result_folder(folder):
        for unit in fit.units:
            with result_folder(folder / f"unit{unit.number}"):
                write_whole(folder / f"unit{unit.number}" / MODEL, unit_table(fit, unit))
        save_array_model(fit.fused, folder / FUSED)
        write_whole(folder / NAME, array_to_json(fit))
    return folder
