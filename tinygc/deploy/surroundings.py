"""What a log alone does not say and a model needs: full scales, and which calibration of the accelerometer holds for it.

A model is fitted to references that rest on one calibration of the accelerometer, often a better one than its session.toml had: the fit
sharpens what is given, and finds what is not.  E maps into that one's body frame.  So the model's own comes first.  A session that a
person names, and that is not the model's own, speaks of another day: its calibration is taken, turned into the model's body frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.common.units import MG, G
from session.log.config import Accelerometer, Config, read_config
from session.log.hashes import sha256_of
from tinygc.models.accelerometer import KnownSensor, accelerometer_of, sensor_of


@dataclass(frozen=True)
class Surroundings:
    """sensor: full scales and what registers mean, None where nothing says them; accelerometer, None where nobody has calibrated it;
    source: ``model``, ``session`` or ``none``; says: the same for people."""

    sensor: KnownSensor
    accelerometer: Accelerometer | None
    source: str
    says: str


def surroundings(table: dict, model_path: Path, log: Path, session: Path | None) -> Surroundings:
    """Of a log that a model (its file as a table) is applied to; session: the folder that a person names, else that of the log.

    Raises FormatError for a session.toml or a model file that cannot be read.
    """
    own, sensor = accelerometer_of(table, str(model_path)), sensor_of(table, str(model_path))
    path = (session or log.parent) / "session.toml"
    config = read_config(path) if session is not None or (log.is_file() and path.exists()) else None
    if config is not None:
        there = config.sensor
        sensor = KnownSensor(there.gyro_fs_dps, there.accel_fs_g, there.model, there.own_units)
    given = None if config is None or config.accelerometer.source == "none" else config.accelerometer
    if given is not None and (own is None or (session is not None and not _is_own(table, path))):
        accelerometer, says = given, f"calibrated as {path} says"
        if own is not None:
            accelerometer, turned_rad = in_frame_of(own, given)
            says += f", in the model's body frame ({1e3 * turned_rad:.2g} mrad from its own)"
        return Surroundings(sensor, accelerometer, "session", says)
    if own is None:
        return Surroundings(sensor, None, "none", "as measured: neither the model nor a session.toml calibrates it")
    says = f"calibrated as the model's fit has it ({WORDS[own.source]})"
    if given is not None and config is not None and not _is_own(table, path):
        turned, turned_rad = in_frame_of(own, given)
        says += f"; that of {path} differs by {apart_mg(own, turned, config):.2g} mg at one g"
        says += f" and by {1e3 * turned_rad:.2g} mrad of the body frame: --session takes it"
    return Surroundings(sensor, own, "model", says)


#: source of a calibration -> what a person is told
WORDS = {"given": "as it was given", "prior": "the given one, sharpened by stills and turns", "stills": "from its own stills and turns"}


def in_frame_of(own: Accelerometer, other: Accelerometer) -> tuple[Accelerometer, float]:
    """Another calibration of the same triad, giving force in the body frame of ``own``; and the angle, rad, that it is turned by."""
    turn = own.frame @ other.frame.T
    angle = float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    return replace(other, matrix=turn @ other.matrix), angle


def apart_mg(one: Accelerometer, other: Accelerometer, config: Config) -> float:
    """mg: the greatest difference of the two forces over the directions of gravity, along the axes and back."""
    gravity = np.concatenate([np.eye(3), -np.eye(3)]) * (config.site.gravity_mps2 or G)
    measured = one.measured(gravity)
    return float(np.abs(one.correct(measured) - other.correct(measured)).max()) / MG


def _is_own(table: dict, path: Path) -> bool:
    """Whether this session.toml is the one that the model's E was fitted with."""
    stored = table.get("stored")
    hashes = (stored if isinstance(stored, dict) else table).get("sha256")
    return isinstance(hashes, dict) and hashes.get("session.toml") == sha256_of(path)
