"""``session.toml``: what was recorded, with what, and where (docs/formats.md)."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date, time
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np

from session.base import features
from session.base.errors import FormatError
from session.base.numeric import UPPER
from session.base.records import DERIVED, Key, Record, record_of
from session.base.results import Array, Keys, MapOf, Mismatch, Number, Shape, Text, require, shown, unknown_keys
from session.base.toml import Note, read_toml
from session.base.units import BEYOND, STANDARD_GRAVITY_MPS2
from session.log.registers import DEFAULT, RegisterUnits, profile_of
from session.log.requirements import Requirements, RequirementsShape
from session.log.sensors import CLOCK_WITHIN, Profile

# ``session.toml``: what was recorded, with what, where (docs/formats.md, ``tinygc-session/1``).

SCHEMA = "tinygc-session/1"
#: normal gravity is 9.780 at the equator and 9.832 at the poles (WGS 84), and less by 0.003 for each km of height
GRAVITY_OVER_EARTH_MPS2 = 0.02
#: where attitudes come from, if not from what a feature serves
REFERENCES = ("gravity", "table")
#: keys of a sensor whose registers are not this tool's to know
OWN_UNITS = ("gyro_mdps_per_lsb", "accel_mg_per_lsb", "temp_lsb_per_c", "temp_at_zero_c")


#: serial numbers of a firmware that knows none
NO_SERIAL = ("", "0")
#: TOML's own bound of whole numbers, which Python does not hold it to
LARGEST = 2**63
DO = "correct it there"
NEAREST_WITHIN = 0.1  #: relative tolerance of the nearest nominal rate: beyond it ``check`` reports another rate
DIVIDED_WITHIN = 0.05  #: the same where a divider gives many rates

PerLsb = Annotated[float | None, Number(1e-6, 1e5)]


@dataclass(frozen=True)
class Sensor:
    """The chip as session.toml names it: model, serial number, nominal data rate, full scales, and what is known of its noise.

    accel_fs_g is NaN of a gyroscope alone; None: not known, or as the model has it where it is known.
    """

    #: sensor, in any spelling ([known ones](../sensors.md))
    model: Annotated[str, Key(absent=DEFAULT)]
    #: serial number
    serial: Annotated[str, Key(absent="")]
    #: data rate, Hz, nominal or as the board states it
    odr_hz: Annotated[float, Number(0.1, 50000)]
    #: full scale of the gyroscope, dps
    gyro_fs_dps: Annotated[float, Number(1, 1e5)]
    #: full scale of the accelerometer, g; not needed for `"turns"`
    accel_fs_g: Annotated[float, Number(0.1, 1000)]
    #: bias instability, °/h; else [figures at rest](../explain.md#noise-that-was-measured-at-rest), the model's, or the recording's
    gyro_bias_instability_dph: Annotated[float | None, Number(0, 1000)] = None
    #: one sigma of the bias between power-ups and days, dps
    gyro_bias_repeatability_dps: Annotated[float | None, Number(0, 1000)] = None
    #: white noise, mdps/√Hz, that `check` compares with; else the model's
    gyro_noise_mdps_rthz: Annotated[float | None, Number(1e-3, 1000)] = None
    #: one count of the gyroscope's registers; else the model's at its full scale
    gyro_mdps_per_lsb: PerLsb = None
    #: the same of the accelerometer
    accel_mg_per_lsb: PerLsb = None
    #: counts per °C; else the model's, or the temperature is not read
    temp_lsb_per_c: Annotated[float | None, Number(1e-3, 1e5)] = None
    #: °C at register 0, with `temp_lsb_per_c`; else 0
    temp_at_zero_c: Annotated[float | None, Number(-300, 300)] = None
    #: relative uncertainty of `odr_hz` where samples are counted at it; 0: measured; else the model's tolerance over √3
    odr_sigma: Annotated[float | None, Number(0, 0.5)] = None
    #: uncertainty of the logs' clock, ppm, in the scale of all axes; 0: known; else not included
    clock_sigma_ppm: Annotated[float | None, Number(0, 1e5)] = None
    #: uncertainty of a rate that `import` counted along coarse stamps, ppm
    even_sigma_ppm: Annotated[float | None, Number(0, 1e5)] = None
    #: board's seconds per computer's second ([why](../boards.md#clocks)); its difference from 1 is a sigma of the scale, until `--clock
    #: arrivals` divides by it
    clock_ratio: Annotated[float | None, Number(0.5, 2.0)] = None

    @cached_property
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
    def nominal_hz(self) -> float:
        """The model's nominal data rate nearest to ``odr_hz``; that one if none is near, or the model's rates are not known."""
        nearest = None if self.profile is None or not self.odr_hz > 0 else self.profile.nearest_hz(self.odr_hz)  # a board may send anything
        if self.profile is None or nearest is None:
            return self.odr_hz
        return nearest if abs(nearest / self.odr_hz - 1) < (DIVIDED_WITHIN if self.profile.divided else NEAREST_WITHIN) else self.odr_hz

    @property
    def nominal_rate(self) -> NominalRate | None:
        """What ``odr_hz`` is worth where samples were counted at it; None where session.toml states that it was measured.

        Without ``odr_sigma`` it may be anywhere within the model's tolerance, a rectangular distribution (GUM 4.3.7).
        """
        if self.odr_sigma is not None:
            return NominalRate(self.odr_hz, self.odr_sigma, "sensor.odr_sigma") if self.odr_sigma else None
        own = None if self.profile is None else self.profile.clock_within
        within = CLOCK_WITHIN if own is None else own
        return NominalRate(self.odr_hz, within.value / np.sqrt(3), f"within {100 * within.value:g} %, {within.source}")

    @property
    def clock_sigma(self) -> float | None:
        """Relative, one sigma of the stamps as far as it is known: a ratio that was measured is in them; None: nothing is."""
        ratio = None if self.clock_ratio is None else (self.clock_ratio - 1) * 1e6
        known = [ppm for ppm in (self.clock_sigma_ppm, self.even_sigma_ppm, ratio) if ppm is not None]
        return float(np.linalg.norm(known)) * 1e-6 if known else None

    @property
    def clock_words(self) -> str:
        """How far the board's clock was measured to be off; empty where it was not, or its stamps were put right."""
        return "" if self.clock_ratio is None else clock_words(self.clock_ratio, self.clock_sigma_ppm)

    @property
    def own_units(self) -> dict[str, float | None]:
        """What session.toml itself states of its registers, by the names of its keys."""
        return {name: getattr(self, name) for name in OWN_UNITS}


HOST_CLOCK = 3e-5  #: relative, one sigma of a computer's own clock, a quartz that nothing steers; one that the network steers is better


def clock_words(ratio: float, sigma_ppm: float | None) -> str:
    """``the board's clock runs 4500 ± 12 ppm fast by the computer's``."""
    off_ppm, digits = (ratio - 1) * 1e6, 1 if sigma_ppm and sigma_ppm < 10 else 0
    sigma = "" if sigma_ppm is None else f" ± {sigma_ppm:.{digits}f}"
    return f"the board's clock runs {abs(off_ppm):.{digits}f}{sigma} ppm {'fast' if off_ppm > 0 else 'slow'} by the computer's"


@dataclass(frozen=True)
class NominalRate:
    """A data rate that stands for a clock: samples were counted at ``hz``, and nothing measured it; or the clock that stamped them.

    sigma: its relative standard uncertainty; source: where that is from.  A true rate of hz (1 + e) makes every time too long by the
    factor 1 + e, and every rate that closes the turns too small by it: E and B scale together.
    """

    hz: float
    sigma: float
    source: str

    @property
    def words(self) -> str:
        """The rate, that it is nominal, and how far it may be off."""
        return f"{self.hz:g} Hz, nominal, not measured: ± {100 * self.sigma:.2g} % ({self.source})"

    @property
    def doubt(self) -> str:
        """Why a calibration is not decided where its clock is this rate."""
        return f"{self.hz:g} Hz is not measured, so all scales are known to ± {100 * self.sigma:.2g} %"

    def covariance(self, rates: np.ndarray) -> np.ndarray:
        """(P, P) of parameters (P,) that are rates per unit or rates, and so scale with the clock: d rates / d e = -rates."""
        return self.sigma**2 * np.outer(rates, rates)


@dataclass(frozen=True)
class BoardGiven:
    """The board's own description at recording time; empty, or None, where it stated nothing.

    source: sensor, or stand-in where there was none; registers: CTRL1_XL to CTRL10_C as hexadecimal digits.
    """

    #: `sensor`, or `stand-in` where there was none. `record` and `import` write this section; nothing computes with it
    source: str = ""
    #: its version
    firmware: str = ""
    #: its `WHO_AM_I`; 107 (0x6B) is an ASM330LHH or a sibling
    who_am_i: Annotated[float | None, Number(0, 255)] = None
    #: its `INTERNAL_FREQ_FINE`
    freq_fine: Annotated[float | None, Number(-128, 127)] = None
    #: `CTRL1_XL` to `CTRL10_C`, hexadecimal
    registers: str = ""
    #: nominal data rate set, Hz
    odr_hz: Annotated[float | None, Number(0.1, 50000)] = None


def _matrix_fault(matrix: np.ndarray) -> str:
    """Of determinant 0.1 to 10."""
    determinant = float(np.linalg.det(matrix))
    expected = "expected a 3x3 matrix close to the identity"
    if determinant <= -0.1:
        return f"is of determinant {determinant:.3g}: it mirrors the axes; {expected}; wrong signs are corrected where the log is written"
    what = "singular" if determinant < 0.1 else f"of determinant {determinant:g}"
    return "" if 0.1 <= determinant <= 10 else f"is {what}; {expected}"


@dataclass(frozen=True, eq=False)
class Accelerometer:
    """The accelerometer's pre-calibration, ``f = matrix @ (measured - bias)``: matrix (3, 3), bias (3,) m/s^2.

    source: ``given``; ``prior``, where the recording has sharpened a given one; ``stills``, where the recording alone gave it; ``none``,
    where it is not calibrated.  sigma_mg: of each number at one g, where it is stated.  own_stills: whether it was estimated from this
    recording's stills, so that it is no independent prior.
    """

    #: pre-calibration: f = matrix (measured − bias), m/s²
    matrix: Annotated[np.ndarray, Array((3, 3), Number(-100, 100), _matrix_fault)] = field(default_factory=lambda: np.eye(3))
    #: its bias, m/s². Without both, the accelerometer is [calibrated by the session's stills](../accelerometer.md)
    bias_mps2: Annotated[np.ndarray, Array((3,), Number(-BEYOND["accel"], BEYOND["accel"]))] = field(default_factory=lambda: np.zeros(3))
    source: Annotated[str, DERIVED] = "given"
    #: one sigma of each of its numbers, mg at one g; 0.1 if not stated
    sigma_mg: Annotated[float | None, Number(1e-3, 1000)] = None
    #: true: estimated from this recording's stills (`fit --accelerometer alone`), so no prior
    own_stills: bool | None = None

    def correct(self, measured: np.ndarray) -> np.ndarray:
        """Specific force (N, 3) m/s^2 from what was measured."""
        return (measured - self.bias_mps2) @ self.matrix.T

    @property
    def frame(self) -> np.ndarray:
        """(3, 3): Q of matrix = Q U, a turn of the body frame against the sensor's own triad; U upper triangular, its diagonal positive."""
        turn, upper = np.linalg.qr(self.matrix)
        return turn * np.sign(np.diag(upper))

    @property
    def triad(self) -> np.ndarray:
        """(9,): the upper triangle of U less that of no correction, row by row, then the bias."""
        return np.concatenate([(self.frame.T @ self.matrix - np.eye(3))[UPPER], self.bias_mps2])

    def is_as(self, other: Accelerometer) -> bool:
        """Whether both correct alike."""
        return np.array_equal(self.matrix, other.matrix) and np.array_equal(self.bias_mps2, other.bias_mps2)

    def measured(self, force: np.ndarray) -> np.ndarray:
        """What was measured (N, 3) m/s^2 where ``correct`` gives this force."""
        return np.linalg.solve(self.matrix, force.T).T + self.bias_mps2


@dataclass(frozen=True)
class Site:
    """Where the table stands: what the Earth's rotation and gravity are there."""

    #: north positive; without it the Earth's rotation stays in the rates
    latitude_deg: Annotated[float | None, Number(-90, 90)] = None
    #: local gravity; without it the common scale of the accelerometer is known to 0.2 %
    gravity_mps2: Annotated[float | None, Number(9.7, 9.9)] = None
    #: direction of the sensor's x axis in the first still, east of true north
    heading_deg: Annotated[float | None, Number(-360, 360)] = None

    @property
    def expected_gravity_mps2(self) -> float:
        """Gravity as it is given, else standard gravity, m/s^2."""
        return STANDARD_GRAVITY_MPS2 if self.gravity_mps2 is None else self.gravity_mps2

    @property
    def gravity_sigma_mps2(self) -> float:
        """How far gravity may be from what is expected, one sigma: where it is given, not at all; else as over the Earth, m/s^2."""
        return GRAVITY_OVER_EARTH_MPS2 if self.gravity_mps2 is None else 0.0


class Reference(Shape):
    """One of ``REFERENCES``, or of those of features."""

    @property
    def one_of(self) -> tuple[str, ...]:
        """The words."""
        return (*REFERENCES, *sorted(kind.word for kind in features.each("reference")))

    @property
    def expected(self) -> str:  # type: ignore[override]
        """``one of a, b``."""
        return Text(self.one_of).expected

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if value not in REFERENCES and reference_of(value) is None:
            self.refuse(value, where)


def reference_of(word: Any) -> Any:
    """Return the further reference of this word, a class of a feature; None of gravity, dials, and of what is no reference."""
    return None if word in REFERENCES else next((kind for kind in features.each("reference") if kind.word == word), None)


@dataclass(frozen=True)
class Protocol:
    """How the table was turned: s of a still and of a segment, and what the attitudes are compared with."""

    #: intended length of a still, s
    still_s: Annotated[float, Number(0.1, 600)] = 1.0
    #: intended length of a segment, s
    segment_s: Annotated[float, Number(0.5, 3600)] = 5.0
    #: where attitudes come from; `"turns"`: only turns of `turns.csv` ([a gyroscope alone](session-folder.md#a-gyroscope-alone))
    reference: Annotated[str, Reference()] = "gravity"
    #: one sigma of each angle of a truth file, degrees
    truth_sigma_deg: Annotated[float, Number(1e-4, 10)] = 0.1
    #: one sigma of each angle of `attitudes.csv`, degrees
    dial_sigma_deg: Annotated[float, Number(1e-4, 10)] = 0.05


class NoteValue(Shape):
    """Text, a number, a date or a time, or true or false."""

    expected = "text, a number or a date"

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if not isinstance(value, str | int | float | date | time):
            self.refuse(value, where)
        if isinstance(value, int) and not -LARGEST <= value < LARGEST:
            raise Mismatch(f"{where} is {shown(value)}, expected no whole number of more than 64 bits")


@dataclass(frozen=True)
class LeftOut:
    """A turn that does not count: the one that moved at ``at_s`` seconds of the clock of the log of this name."""

    log: str
    at_s: Annotated[float, Number(-1e11, 1e11)]  # far beyond any clock


@dataclass(frozen=True)
class StillByHand:
    """A person's change of the still that was found around ``at_s`` seconds of its log's clock."""

    #: name of its log
    log: str
    #: a moment of the still as found, s of the log's clock
    at_s: Annotated[float, Number(-1e11, 1e11)]
    #: where it begins, with `to_s`; without both the still is left out
    from_s: Annotated[float | None, Number(-1e11, 1e11)] = None
    #: where it ends
    to_s: Annotated[float | None, Number(-1e11, 1e11)] = None


#: what a person changed of a log
ByHand = LeftOut | StillByHand
R = TypeVar("R", LeftOut, StillByHand)


def by_hand_words(rows: Sequence[ByHand]) -> str:
    """How much a person left out or changed, in one line; empty without any."""
    moved = sum(isinstance(row, StillByHand) and row.from_s is not None for row in rows)
    segments = sum(isinstance(row, LeftOut) for row in rows)
    counts = {"segment": segments, "still": len(rows) - segments - moved}
    parts = [f"{count} {what}{'s' * (count > 1)} left out" for what, count in counts.items() if count]
    parts += [f"the ends of {moved} still{'s' * (moved > 1)} moved"] if moved else []
    return f"{', '.join(parts)} by hand (session.toml)" if parts else ""


@dataclass(frozen=True)
class Config:
    """unknown: keys that nothing reads, each with the known key nearest to it, or None; model_given: whether the file names the sensor;
    notes: the operator's notes, by name; exclude: turns that do not count; still: stills that a person changed; requirements: limits,
    None without any; sections: the records of those that features read, by their names."""

    schema: ClassVar[str] = SCHEMA
    sensor: Sensor
    accelerometer: Annotated[Accelerometer, Key(absent=Accelerometer(source="none"))]
    site: Annotated[Site, Key(absent=Site())]
    protocol: Annotated[Protocol, Key(absent=Protocol())]
    unknown: Annotated[tuple[tuple[str, str | None], ...], DERIVED] = ()
    model_given: Annotated[bool, DERIVED] = True
    notes: Annotated[Mapping[str, Note], MapOf(NoteValue())] = field(default_factory=dict)
    exclude: tuple[LeftOut, ...] = ()
    still: tuple[StillByHand, ...] = ()
    board: BoardGiven = field(default_factory=BoardGiven)
    requirements: Annotated[Requirements | None, RequirementsShape()] = None
    sections: Annotated[Mapping[str, Any], DERIVED] = field(default_factory=dict)

    def on_time(self, time: Callable[[float], float]) -> Config:
        """With the moments that a person named on another clock."""

        def timed(row: R) -> R:
            moved: dict[str, Any] = {key: time(value) for key, value in vars(row).items() if key.endswith("_s") and value is not None}
            return replace(row, **moved)

        return replace(self, exclude=tuple(map(timed, self.exclude)), still=tuple(map(timed, self.still)))

    def with_names(self, name: Callable[[str], str | None]) -> Config:
        """With other names of the logs that a person changed; without the rows of a log that has none."""

        def named(rows: tuple[R, ...]) -> tuple[R, ...]:
            return tuple(replace(row, log=new) for row in rows if (new := name(row.log)) is not None)

        return replace(self, exclude=named(self.exclude), still=named(self.still))


#: what a session.toml holds, but for the sections that features read
SHAPE: Record = record_of(Config, null=False)


def sections() -> dict[str, Record]:
    """Return the sections that features read: name -> shape."""
    return {kind.section: record_of(kind, null=False) for kind in features.each("section of session.toml")}


def read_config(path: Path) -> Config:
    """Read and check ``session.toml``; FormatError names the key, what was expected and what came."""
    if not os.path.lexists(path):
        if not path.parent.exists():
            raise FormatError(f"{path.parent}: no such folder")
        what = f"{path.parent}: a file" if path.parent.is_file() else f"{path}: not found"
        raise FormatError(f"{what}; a session folder holds session.toml and log*.csv (see docs/session-folder.md)")
    return config_of(path, read_session_toml(path))


def read_session_toml(path: Path) -> dict:
    """The parsed file of a session or an array; FormatError where it is no TOML or names another schema."""
    table = read_toml(path)
    require(table, Keys(must={"schema": SHAPE.must["schema"]}), str(path), "is this a session folder of this tool?")
    return table


def config_of(path: Path, table: dict) -> Config:
    """The record of a parsed ``session.toml``; FormatError names path, key, what was expected and what came."""
    checked: dict[str, Any] = {"sensor": {}} | table
    more = sections() if set(table) - {*SHAPE.must, *SHAPE.may} else {}
    whole = replace(SHAPE, may={**SHAPE.may, **more})
    protocol = table.get("protocol")
    kind = reference_of(protocol.get("reference", REFERENCES[0])) if isinstance(protocol, dict) else None
    if kind is not None and not kind.accelerometer and isinstance(checked["sensor"], dict):
        checked["sensor"] = {"accel_fs_g": 1} | checked["sensor"]
    require(checked, whole, str(path), DO)
    calibrated = {"matrix", "bias_mps2"} & set(table.get("accelerometer", {}))
    if not calibrated and (of_it := sorted({"sigma_mg", "own_stills"} & set(table.get("accelerometer", {})))):
        raise FormatError(f"{path}: accelerometer.{of_it[0]} is of a calibration that is not there; give matrix or bias_mps2")
    config: Config = whole.made(checked)
    return replace(
        config,
        sensor=replace(config.sensor, accel_fs_g=math.nan) if "accel_fs_g" not in table["sensor"] else config.sensor,
        accelerometer=config.accelerometer if calibrated else replace(config.accelerometer, source="none"),
        unknown=unknown_keys(table, whole),
        sections={name: each.made(table[name]) for name, each in more.items() if name in table},
        model_given="model" in table["sensor"],
        requirements=None if config.requirements is None else replace(config.requirements, source=path.name),
    )
