"""``session.toml``: what was recorded, with what, where, and how a truth file is to be read (docs/formats.md)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from session.io.errors import FormatError
from session.io.registers import DEFAULT, RegisterUnits, profile_of
from session.io.sensors.profile import Profile
from session.io.toml import Note, TomlReader, read_toml, said
from session.io.units import BEYOND, STANDARD_GRAVITY_MPS2

# How the attitudes of a truth file are to be read: which way they turn, which way is up, whose axes, whose clock.
#
# Any file comes to ``q_nb`` (docs/formats.md) by the same four steps, each of which can be undone:
#
#     q_nb(t + offset_s) = frame * (as written at t, its cells put in order, inverted if it takes the world to the body) * mounting

#: of a quaternion's cells under the header qw,qx,qy,qz
ORDERS = ("wxyz", "xyzw")
#: what the quaternion takes to what
SENSES = ("body_to_world", "world_to_body")
_HALF = np.sqrt(0.5)
#: (4,) of the turn that takes the file's world to one with z down; about the file's x axis, which keeps its heading, or else about y
FRAMES = {
    "ned": np.array([1.0, 0.0, 0.0, 0.0]),
    "enu": np.array([0.0, 1.0, 0.0, 0.0]),
    "y_down": np.array([_HALF, _HALF, 0.0, 0.0]),
    "y_up": np.array([_HALF, -_HALF, 0.0, 0.0]),
    "x_down": np.array([_HALF, 0.0, -_HALF, 0.0]),
    "x_up": np.array([_HALF, 0.0, _HALF, 0.0]),
}
#: other names of the same: only which way is down matters
SAME_FRAME = {"z_down": "ned", "z_up": "enu", "nwu": "enu", "nue": "y_up"}


@dataclass(frozen=True, eq=False)
class TruthGiven:
    """What ``[truth]`` of session.toml says; None: to be found out.  mounting (3, 3): from the IMU's axes to the truth's body."""

    offset_s: float | None = None
    frame: str | None = None
    sense: str | None = None
    order: str | None = None
    mounting: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class TruthReading:
    """One way to read a truth file; as it is made, the contract's own.

    order: one of ``ORDERS``; sense: one of ``SENSES``; frame: one of ``FRAMES``; mounting (3, 3): takes vectors from the IMU's axes to
    those of the truth's body; offset_s: added to the truth's stamps it gives the log's clock.
    """

    order: str = ORDERS[0]
    sense: str = SENSES[0]
    frame: str = "ned"
    mounting: np.ndarray = field(default_factory=lambda: np.eye(3))
    offset_s: float = 0.0

    @classmethod
    def of(cls, given: TruthGiven) -> TruthReading:
        """What is given, and the contract's own where nothing is."""
        told = {name: value for name, value in vars(given).items() if value is not None}
        return cls(**told)

    def read(self, q: np.ndarray) -> np.ndarray:
        """``q_nb`` (K, 4) of what is written, (K, 4)."""
        q = np.roll(q, 1, axis=1) if self.order == "xyzw" else q
        q = inverse(q) if self.sense == "world_to_body" else q
        return product(product(FRAMES[self.frame], q), quaternion(self.mounting))

    def written(self, q_nb: np.ndarray) -> np.ndarray:
        """What is written, (K, 4), where this reading gives ``q_nb`` (K, 4)."""
        q = product(product(inverse(FRAMES[self.frame]), q_nb), inverse(quaternion(self.mounting)))
        q = inverse(q) if self.sense == "world_to_body" else q
        return np.roll(q, -1, axis=1) if self.order == "xyzw" else q


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Hamilton product (..., 4) of quaternions, scalar first."""
    (pw, px, py, pz), (qw, qx, qy, qz) = np.moveaxis(p, -1, 0), np.moveaxis(q, -1, 0)
    return np.stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + qw * px + py * qz - pz * qy,
            pw * qy + qw * py + pz * qx - px * qz,
            pw * qz + qw * pz + px * qy - py * qx,
        ],
        axis=-1,
    )


def inverse(q: np.ndarray) -> np.ndarray:
    """Of unit quaternions (..., 4)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def down_of(frame: str) -> np.ndarray:
    """(3,): where down is in the file's world."""
    w, x, y, z = FRAMES[frame]
    return np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


def quaternion(matrix: np.ndarray) -> np.ndarray:
    """(4,) scalar first, of a rotation matrix (3, 3): the strongest of its four squares, so that nothing is divided by little."""
    m = matrix
    squares = np.array(
        [
            [1 + m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], 1 - m[0, 0] + m[1, 1] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1 - m[0, 0] - m[1, 1] + m[2, 2]],
        ]
    )
    row = squares[int(np.argmax(np.diag(squares)))]
    q = row / np.linalg.norm(row)
    return q if q[0] >= 0 else -q


#: where each part of a reading is from
GIVEN, FOUND, ASSUMED = "given", "found", "assumed"


@dataclass(frozen=True, eq=False)
class TruthAlignment:
    """How a session's truth files are read, and what the recording says of it.

    reading: as they are read; source: of each of its parts, ``given``, ``found`` in the recording, or ``assumed`` (the contract's own).
    offset_s, offset_sigma_s: of the truth's clock, as the recording shows it, whatever is given or used; nan where it does not.  turned,
    turned_sigma (3,) rad: likewise the rotation from the gyro's axes to the truth's body.  up (3,): the mean specific force in the
    file's world over its mean length, where there is one, else None; explained: share of the truth's rotations that the gyro explains.
    """

    reading: TruthReading
    source: dict[str, str]
    offset_s: float
    offset_sigma_s: float
    turned: np.ndarray
    turned_sigma: np.ndarray
    up: np.ndarray | None
    explained: float


# ``session.toml``: what was recorded, with what, where (docs/formats.md, ``tinygc-session/1``).

SCHEMA = "tinygc-session/1"
#: normal gravity is 9.780 at the equator and 9.832 at the poles (WGS 84), and less by 0.003 for each km of height
GRAVITY_OVER_EARTH_MPS2 = 0.02
REFERENCES = ("gravity", "table", "truth")
#: keys of a sensor whose registers are not this tool's to know
OWN_UNITS = ("gyro_mdps_per_lsb", "accel_mg_per_lsb", "temp_lsb_per_c", "temp_at_zero_c")


#: of a field that no key of session.toml gives
NOT_IN_TOML = {"toml": False}


@dataclass(frozen=True)
class Sensor:
    """The chip as session.toml names it: model, serial number, nominal data rate, full scales, and what is known of its noise."""

    model: str
    serial: str
    odr_hz: float  #: nominal; the stamps say the true one
    gyro_fs_dps: float
    accel_fs_g: float
    gyro_bias_instability_dph: float | None = None  #: None: typical of the model where it is known, else estimated from the recording
    gyro_noise_mdps_rthz: float | None = None  #: one-sided; None: typical of the model where it is known, else there is no yardstick
    gyro_mdps_per_lsb: float | None = None  #: of registers, here and below; None: the model's at its full scale
    accel_mg_per_lsb: float | None = None
    temp_lsb_per_c: float | None = None
    temp_at_zero_c: float | None = None

    @property
    def profile(self) -> Profile | None:
        """What is known of the model; None where it is none that this tool knows."""
        return profile_of(self.model)

    def typical(self, figure: str) -> tuple[str, float] | None:
        """Name of the known sensor and its typical figure, of those that its source was read for; None where there is none."""
        value = None if self.profile is None else self.profile.yardstick(figure)
        return None if value is None or self.profile is None else (self.profile.name, value)

    @property
    def register_units(self) -> RegisterUnits:
        """What its registers mean; asking it raises FormatError where that is not known."""
        return RegisterUnits(self.model or DEFAULT, self.gyro_fs_dps, self.accel_fs_g, **self.own_units)

    @property
    def own_units(self) -> dict[str, float | None]:
        """What session.toml itself says of its registers, by the names of its keys."""
        return {name: getattr(self, name) for name in OWN_UNITS}


@dataclass(frozen=True)
class BoardGiven:
    """What the board said of itself when it was recorded, as session.toml keeps it; empty, or None, where it said nothing.

    source: sensor, or stand-in where there was none; registers: CTRL1_XL to CTRL10_C as hexadecimal digits.
    """

    source: str = ""
    firmware: str = ""
    who_am_i: float | None = None
    freq_fine: float | None = None
    registers: str = ""
    odr_hz: float | None = None  #: nominal


@dataclass(frozen=True, eq=False)
class Accelerometer:
    """The accelerometer's pre-calibration, ``f = matrix @ (measured - bias)``: matrix (3, 3), bias (3,) m/s^2.

    source: ``given``; ``prior``, where the recording has sharpened a given one; ``stills``, where the recording alone gave it; ``none``,
    where nobody has calibrated it.  sigma_mg: of each number at one g, where it is stated.  own_stills: whether the stills of the very
    recording gave it, so that it says nothing beside them.
    """

    matrix: np.ndarray = field(default_factory=lambda: np.eye(3))
    bias_mps2: np.ndarray = field(default_factory=lambda: np.zeros(3))
    source: str = field(default="given", metadata=NOT_IN_TOML)
    sigma_mg: float | None = None
    own_stills: bool | None = None

    def correct(self, measured: np.ndarray) -> np.ndarray:
        """Specific force (N, 3) m/s^2 from what was measured."""
        return (measured - self.bias_mps2) @ self.matrix.T

    @property
    def frame(self) -> np.ndarray:
        """(3, 3): Q of matrix = Q U, a turn of the body frame against the sensor's own triad; U upper triangular, its diagonal positive."""
        turn, upper = np.linalg.qr(self.matrix)
        return turn * np.sign(np.diag(upper))

    def measured(self, force: np.ndarray) -> np.ndarray:
        """What was measured (N, 3) m/s^2 where ``correct`` gives this force."""
        return np.linalg.solve(self.matrix, force.T).T + self.bias_mps2


@dataclass(frozen=True)
class Site:
    """Where the table stands: what the Earth's rotation and gravity are there."""

    latitude_deg: float | None = None  #: None: the Earth's rotation cannot be predicted
    gravity_mps2: float | None = None  #: None: standard gravity is expected, loosely
    heading_deg: float | None = None  #: the table's index direction, from true north

    @property
    def expected_gravity_mps2(self) -> float:
        """Gravity as it is given, else standard gravity, m/s^2."""
        return STANDARD_GRAVITY_MPS2 if self.gravity_mps2 is None else self.gravity_mps2

    @property
    def gravity_sigma_mps2(self) -> float:
        """How far gravity may be from what is expected, one sigma: where it is given, not at all; else as over the Earth, m/s^2."""
        return GRAVITY_OVER_EARTH_MPS2 if self.gravity_mps2 is None else 0.0


@dataclass(frozen=True)
class Protocol:
    """How the table was turned: s of a still and of a segment, and what the attitudes are compared with."""

    still_s: float = 1.0
    segment_s: float = 5.0
    reference: str = "gravity"
    truth_sigma_deg: float = 0.1  #: of each angle of a truth file's attitudes


@dataclass(frozen=True)
class LeftOut:
    """A turn that does not count: the one that moved at ``at_s`` seconds of the clock of the log of this name."""

    log: str
    at_s: float


@dataclass(frozen=True)
class Config:
    """unknown: keys that nothing reads, each with the known key nearest to it, or None; model_given: whether the file names the sensor;
    notes: what a person wrote beside the data, by name; exclude: turns that do not count."""

    sensor: Sensor
    accelerometer: Accelerometer
    site: Site
    protocol: Protocol
    unknown: tuple[tuple[str, str | None], ...] = ()
    model_given: bool = True
    truth: TruthGiven = field(default_factory=TruthGiven)
    notes: Mapping[str, Note] = field(default_factory=dict)
    exclude: tuple[LeftOut, ...] = ()
    board: BoardGiven = field(default_factory=BoardGiven)


def _table(table: dict, name: str) -> dict:
    """A section, empty where there is none; what is no section has been refused."""
    found = table.get(name)
    return found if isinstance(found, dict) else {}


def read_config(path: Path) -> Config:
    """Read and check ``session.toml``; FormatError names the key, what was expected and what came."""
    if not os.path.lexists(path):
        raise FormatError(f"{path}: not found; a session folder holds session.toml and log*.csv (see docs/session-folder.md)")
    table = read_toml(path)
    if table.get("schema") != SCHEMA:
        raise FormatError(f'{path}: schema is {said(table.get("schema"))}, expected "{SCHEMA}"; is this a session folder of this tool?')
    return config_of(path, table)


def config_of(path: Path, table: dict) -> Config:
    """What a parsed ``session.toml`` says; FormatError names path, key, what was expected and what came."""
    reader = TomlReader(path, table)
    sensor = Sensor(
        model=reader.text("sensor", "model", DEFAULT),
        serial=reader.text("sensor", "serial", ""),
        odr_hz=reader.number("sensor", "odr_hz", low=0.1, high=50000),
        gyro_fs_dps=reader.number("sensor", "gyro_fs_dps", low=1, high=1e5),
        accel_fs_g=reader.number("sensor", "accel_fs_g", low=0.1, high=1000),
        gyro_bias_instability_dph=reader.number("sensor", "gyro_bias_instability_dph", None, low=0, high=1000),
        gyro_noise_mdps_rthz=reader.number("sensor", "gyro_noise_mdps_rthz", None, low=1e-3, high=1000),
        gyro_mdps_per_lsb=reader.number("sensor", "gyro_mdps_per_lsb", None, low=1e-6, high=1e5),
        accel_mg_per_lsb=reader.number("sensor", "accel_mg_per_lsb", None, low=1e-6, high=1e5),
        temp_lsb_per_c=reader.number("sensor", "temp_lsb_per_c", None, low=1e-3, high=1e5),
        temp_at_zero_c=reader.number("sensor", "temp_at_zero_c", None, low=-300, high=300),
    )
    calibrated = {"matrix", "bias_mps2"} & set(_table(table, "accelerometer"))
    if not calibrated and (of_it := sorted({"sigma_mg", "own_stills"} & set(_table(table, "accelerometer")))):
        raise FormatError(f"{path}: accelerometer.{of_it[0]} is of a calibration that is not there; give matrix or bias_mps2")
    accelerometer = Accelerometer(
        reader.array("accelerometer", "matrix", (3, 3), np.eye(3), most=100.0),
        reader.array("accelerometer", "bias_mps2", (3,), np.zeros(3), most=BEYOND["accel"]),
        "given" if calibrated else "none",
        reader.number("accelerometer", "sigma_mg", None, low=1e-3, high=1000),
        reader.flag("accelerometer", "own_stills"),
    )
    determinant = float(np.linalg.det(accelerometer.matrix))
    if determinant <= -0.1:
        raise FormatError(
            f"{path}: accelerometer.matrix is of determinant {determinant:.3g}: it mirrors the axes; expected a 3x3 matrix close to the "
            "identity; wrong signs are corrected where the log is written"
        )
    if not 0.1 <= determinant <= 10:
        what = "singular" if determinant < 0.1 else f"of determinant {determinant:g}"
        raise FormatError(f"{path}: accelerometer.matrix is {what}; expected a 3x3 matrix close to the identity")
    site = Site(
        latitude_deg=reader.number("site", "latitude_deg", None, low=-90, high=90),
        gravity_mps2=reader.number("site", "gravity_mps2", None, low=9.7, high=9.9),
        heading_deg=reader.number("site", "heading_deg", None, low=-360, high=360),
    )
    protocol = Protocol(
        still_s=reader.number("protocol", "still_s", 1.0, low=0.1, high=600),
        segment_s=reader.number("protocol", "segment_s", 5.0, low=0.5, high=3600),
        reference=reader.text("protocol", "reference", "gravity"),
        truth_sigma_deg=reader.number("protocol", "truth_sigma_deg", 0.1, low=1e-4, high=10),
    )
    if protocol.reference not in REFERENCES:
        expected = '"gravity", "table" or "truth"'
        raise FormatError(f'{path}: protocol.reference is "{protocol.reference}", expected {expected}')
    truth, notes, exclude = _truth(reader), reader.notes(), tuple(LeftOut(*row) for row in reader.exclude())  # before what nobody has read
    board = BoardGiven(
        reader.text("board", "source", ""),
        reader.text("board", "firmware", ""),
        reader.number("board", "who_am_i", None, low=0, high=255),
        reader.number("board", "freq_fine", None, low=-128, high=127),
        reader.text("board", "registers", ""),
        reader.number("board", "odr_hz", None, low=0.1, high=50000),
    )
    return Config(sensor, accelerometer, site, protocol, reader.unknown(), "model" in table["sensor"], truth, notes, exclude, board)


def _truth(reader: TomlReader) -> TruthGiven:
    """``[truth]``: how the truth file is to be read, as far as it is told."""
    frame = reader.choice("truth", "frame", (*FRAMES, *SAME_FRAME))
    return TruthGiven(
        offset_s=reader.number("truth", "offset_s", None, low=-3600, high=3600),
        frame=None if frame is None else SAME_FRAME.get(frame, frame),
        sense=reader.choice("truth", "sense", SENSES),
        order=reader.choice("truth", "order", ORDERS),
        mounting=reader.rotation("truth", "mounting"),
    )
