"""The calibration that is verified: its model, what it says of its own uncertainty, and the sensor that it was made for."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import FormatError
from session.base.names import CLOCKS, is_session, refuse_special
from session.base.texts import command_line, printable
from session.base.units import DEG, DEG_PER_HOUR, MG, G
from session.detect.accelerometer import PARAMETERS as ACCELEROMETER_PARAMETERS
from session.log.config import Accelerometer
from session.log.folder import Session, hash_of_log
from tinygc import models
from tinygc.closure.joint import GIVEN_SIGMA_MG
from tinygc.estimation.accelerometer import JOINT_NAMES
from tinygc.fitting.fit_file import read_fit
from tinygc.models.linear import BIAS, MATRIX, PARAMETERS, LinearModel
from tinygc.models.model import Model, accelerometer_of
from tinygc.models.physics import PhysicsModel
from tinygc.noise.components import STILL_RATE, WANDER
from tinygc.planning.proposals import TARGETS

#: accelerometer's nine parameters, then the gyroscope's twelve, as in a joint covariance
COUNT = len(JOINT_NAMES)
ACCELEROMETER, GYROSCOPE = slice(0, ACCELEROMETER_PARAMETERS), slice(ACCELEROMETER_PARAMETERS, COUNT)
#: m/s^2 of each number of a given accelerometer calibration, at zero g and at one g
GIVEN_MPS2 = GIVEN_SIGMA_MG * MG
#: components of the noise that rates at rest show
AT_REST = {WANDER: DEG_PER_HOUR, STILL_RATE: DEG}
_IN_FIT = "model_least_squares.json"


@dataclass(frozen=True, eq=False)
class OldCalibration:
    """A stored calibration.

    path; model; table: what its file holds; accelerometer that its references came from, None where the file has none; covariance (21, 21)
    of the accelerometer's correction and of the linear model, SI; own_lengths: whether the accelerometer was given: then its error
    is in gravity's length, and E has taken up what it does to the turns; lacks: what the file does not say, a sentence each; goodness:
    chi-square and degrees of freedom of the fit's own closure, None where no fit.json lies beside it; noise: of that file, by name of
    ``AT_REST``: mean square of the size, (rad/s)^2, given its estimate and sigma, and the degrees of freedom of that variance.
    """

    path: Path
    model: Model
    table: dict[str, Any]
    accelerometer: Accelerometer | None
    covariance: np.ndarray
    own_lengths: bool
    lacks: tuple[str, ...]
    goodness: tuple[float, int] | None = None
    noise: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def linear(self) -> LinearModel:
        """The linear calibration of what ``readings`` returns: of another kind of model, no correction, since it is applied there."""
        return self.model if isinstance(self.model, LinearModel) else LinearModel(np.eye(3), np.zeros(3))

    @property
    def bias(self) -> np.ndarray:
        """(3,) rad/s: its B; of a model without one, zero, so that a new one is a correction."""
        return self.model.linear.B if isinstance(self.model, PhysicsModel) else self.linear.B

    @property
    def name(self) -> str:
        """Its session, or its file."""
        return printable(str(self.table.get("session") or self.path.name))

    @property
    def sensor(self) -> dict[str, Any]:
        """``sensor`` of the file."""
        found = self.table.get("sensor")
        return found if isinstance(found, dict) else {}

    def clocks_apart(self, session: Session) -> str:
        """That the model goes by another clock than the session can go by; empty where both go by the same."""
        if self.table.get("clock", CLOCKS[0]) == CLOCKS[0] or (session.config.sensor.clock_ratio is not None and session.reference is None):
            return ""
        why = "no sensor.clock_ratio says how far that is off" if session.reference is None else f"its {session.reference.title}s do"
        return f"the model goes by the computer's clock (--clock arrivals), today's recording by the board's: {why}"

    def readings(self, session: Session) -> Session:
        """The session by this calibration's clock and with its accelerometer, and, for a model that is not linear, with calibrated rates as
        readings."""
        if not self.clocks_apart(session):
            session = session.on_clock(self.table.get("clock", CLOCKS[0]))
        # How far the board's clock is off is in both alike: only what its measurement leaves open may differ.
        config = replace(session.config, sensor=replace(session.config.sensor, clock_ratio=None))
        if self.accelerometer is not None:
            config = replace(config, accelerometer=replace(self.accelerometer, source="given", own_stills=False))
        found = replace(session, config=config)
        if isinstance(self.model, LinearModel):
            return found
        model = self.model.at_end()
        logs = tuple(replace(log, samples=replace(log.samples, gyro=model.calibrate(found.calibrated(log)))) for log in found.logs)
        return replace(found, logs=logs)


def read_old(where: Path) -> OldCalibration:
    """Read a model file, or that of a fitted session folder.  Raises FormatError for anything else."""
    path = where / "fit" / _IN_FIT if where.is_dir() else where
    if where.is_dir() and not path.exists():
        if is_session(where):
            refuse_special(where)
        raise FormatError(f"{path}: not found; run `{command_line('fit', where)}` first, or give a model file")
    model, table = models.load_with_table(path)
    with_bias_moved(model, np.zeros(3))  # fail early for a model whose bias cannot be changed
    covariance, given, lacks = _covariance(model, table)
    accelerometer = accelerometer_of(table, str(path))
    if accelerometer is None:
        lacks.append(
            "the model file has no accelerometer calibration: today's is taken, E must be in its frame, and gravity's length is not asked"
        )
    return OldCalibration(path, model, table, accelerometer, covariance, given, tuple(lacks), *_of_fit(path.parent / "fit.json"))


def with_bias_moved(model: Model, change: np.ndarray) -> Model:
    """The model with its calibrated rate increased by ``change`` (3,) rad/s.  Raises CalibrationError for a kind without a bias."""
    if isinstance(model, PhysicsModel):
        return replace(model, linear=model.linear.with_bias_moved(change))
    return model.with_bias_moved(change)


def _covariance(model: Model, table: dict) -> tuple[np.ndarray, bool, list[str]]:
    """Return the covariance (21, 21); whether the accelerometer was given; and what is lacking."""
    found, lacks = np.zeros((COUNT, COUNT)), list[str]()
    stated = np.asarray(table.get("covariance") or np.zeros((0, 0)), dtype=float)
    joint = table.get("joint_covariance")
    if isinstance(model, LinearModel) and joint is not None and np.shape(joint["matrix"]) == (COUNT, COUNT):
        return np.asarray(joint["matrix"], dtype=float), False, lacks
    found[ACCELEROMETER, ACCELEROMETER] = np.diag(np.r_[np.full(6, GIVEN_MPS2 / G), np.full(3, GIVEN_MPS2)] ** 2)
    if stated.shape[0] >= PARAMETERS and isinstance(model, LinearModel | PhysicsModel):
        own = stated[:PARAMETERS, :PARAMETERS]
        shared = np.asarray(table.get("accelerometer_covariance") or np.zeros((PARAMETERS, PARAMETERS)), dtype=float)
        if isinstance(model, LinearModel) and shared.shape == own.shape:
            # The nearest covariance: rounding may leave a difference of two with eigenvalues below zero
            matrix = own - shared
            size, axes = np.linalg.eigh((matrix + matrix.T) / 2)
            own = (axes * np.maximum(size, 0.0)) @ axes.T  # that error is in today's references as well
        if isinstance(model, PhysicsModel):
            own = _of_calibrated(model.linear) @ own @ _of_calibrated(model.linear).T
            lacks.append("of the model's covariance, that of E and B is taken; that of its effects is not")
        found[GYROSCOPE, GYROSCOPE] = own
    else:
        found[GYROSCOPE, GYROSCOPE] = np.diag(TARGETS**2)
        lacks.append("the model file has no covariance: that of a usual session of 40 turns is assumed, 50 ppm and 0.002 dps; fit it again")
    return found, True, lacks


def _of_calibrated(linear: LinearModel) -> np.ndarray:
    """(12, 12): what a change of a linear model's vector is to a correction of its calibrated rates, omega' = E' omega + B'."""
    inverse = np.linalg.inv(linear.E)
    slope = np.zeros((PARAMETERS, PARAMETERS))
    slope[MATRIX, MATRIX] = np.kron(np.eye(3), inverse.T)
    # dE m + dB with m = E^-1 (omega - B): dE E^-1 omega + dB - dE E^-1 B.
    slope[BIAS, BIAS] = np.eye(3)
    slope[BIAS, MATRIX] = -np.kron(np.eye(3), inverse @ linear.B)
    return slope


def _variance_and_freedom(size: float, sigma: float) -> tuple[float, float]:
    """Mean square of a normal size with this mean and sigma; degrees of freedom of a variance of the same relative spread, 2 mean^2 / var.

    mean = size^2 + sigma^2, var = 4 size^2 sigma^2 + 2 sigma^4.  A size that was not seen, of 0, has one.
    """
    mean, spread = size**2 + sigma**2, 4 * size**2 * sigma**2 + 2 * sigma**4
    return mean, 2 * mean**2 / spread if spread > 0 else float("inf")


def _of_fit(path: Path) -> tuple[tuple[float, int] | None, dict[str, tuple[float, float]]]:
    """Chi-square and degrees of freedom of ``goodness`` in fit.json, None where there is none; ``OldCalibration.noise``."""
    table = read_fit(path) if path.is_file() else {}
    goodness: tuple[float, int] | None = None
    found: dict[str, tuple[float, float]] = {}
    with contextlib.suppress(KeyError, TypeError, ValueError):
        goodness = float(table["goodness"]["chi_square"]), int(table["goodness"]["freedom"])
    with contextlib.suppress(KeyError, TypeError, ValueError):
        for component in table["noise"]["components"]:
            if (name := component["name"]) in AT_REST:
                variance, freedom = _variance_and_freedom(float(component["size"]), float(component["sigma"] or 0.0))
                found[name] = AT_REST[name] ** 2 * variance, freedom
    return goodness, found


def facts(old: OldCalibration, session: Session) -> tuple[list[str], bool]:
    """What the settings say, a sentence each: another range, rate or model of sensor; and whether the serial number is another one."""
    said, sensor = [], session.config.sensor
    for key, unit, words in (
        ("gyro_fs_dps", "dps", "full scale of the gyroscope"),
        ("accel_fs_g", "g", "full scale of the accelerometer"),
        ("odr_hz", "Hz", "data rate"),
    ):
        then, now = old.sensor.get(key), getattr(sensor, key)
        if then is not None and np.isfinite(now) and abs(then / now - 1) > 0.01:
            said.append(f"{words}: {then:g} {unit} in the model, {now:g} {unit} today")
    for key in ("model", "serial"):
        then, now = old.sensor.get(key), getattr(sensor, key)
        if then and now and now != "unknown" and then != now:
            said.append(f"{key} of the sensor: {printable(str(then))} in the model, {printable(now)} today")
    then, now = old.sensor.get("serial"), sensor.serial
    return said, bool(then and now and then != now)


def is_its_own(old: OldCalibration, session: Session) -> bool:
    """Whether the calibration was fitted to a log of this very session."""
    known = old.table.get("sha256")
    known = {value for name, value in known.items() if name != "session.toml"} if isinstance(known, dict) else set()
    return bool(known & {hash_of_log(log) for log in session.logs})
