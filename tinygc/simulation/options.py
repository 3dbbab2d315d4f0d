"""Options of a simulated session, and the unit drawn from them."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field, fields
from math import isfinite
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.units import DEG, MG
from session.log.registers import DEFAULT

if TYPE_CHECKING:
    import numpy as np

    from session.log.registers import RegisterUnits


# Options of a simulated session.  Sources: docs/sensor.md, docs/formats.md.

#: nominal output data rate, Hz -> bandwidth (-3 dB) of the gyro's LPF2, Hz, always on (docs/sensor.md, LSM6DSO Table 18;
#: the two highest rates are from memory, unchecked).  The chip has no 62.5 Hz, unlike slow boards and other sensors; its
#: bandwidth is that of 104 Hz in proportion, and likewise filters out much of a hand's faster movement
GYRO_LPF2_HZ = {62.5: 20.0, 104: 33.0, 208: 66.8, 416: 135.9, 833: 295.5, 1667: 1108.1, 3333: 1320.7, 6667: 1441.8}
#: room for the stills at both ends and some turning between them
SHORTEST_CLOSURE_STILLS = 10
#: memory limit: a day of turns at 208 Hz
MOST_SEGMENTS = 2000
MOST_SAMPLES = 20_000_000
#: limits beyond any sensor and any hand; larger values would overflow
LARGEST = {
    "gyro_noise_dps_rthz": 100.0,
    "accel_noise_ug_rthz": 1e6,
    "bias_instability_dph": 1000.0,  # limit of session.toml
    "gyro_bias_dps": 1e4,
    "accel_bias_mg": 1e4,
    "accel_calibration_error_mg": 1e4,
    "vigour": 1000.0,
}
#: still_s: limit of session.toml
SMALLEST = {"vigour": 1e-3, "still_s": 0.1, "turn_s": 0.01}
LONGEST_LEVER_M = 10.0


def choice(default: Any, meaning: str) -> Any:
    """Define a field whose meaning, with its unit, the command line shows."""
    return field(default=default, metadata={"help": meaning})


@dataclass(frozen=True)
class SimulationOptions:
    """Options of one simulated session.  Errors of the unit are drawn from ``seed`` with the sizes given here (1 sigma).

    Every purpose (unit, motion, noise, …) has its own random stream, so a change of noise leaves the motion unchanged.
    """

    segments: int = choice(40, "turns in the log; the stills are one more")
    closure_s: float = choice(58.0, "s, whole length of the closure run with its two stills; 0: none")
    seed: int = choice(0, "of every random draw")

    # Sensor
    odr_hz: float = choice(208.0, "Hz, nominal: 62.5, 104, 208, 416, 833, 1667, 3333 or 6667")
    odr_error: float | None = choice(None, "fraction, rounded to the chip's steps of 0.15 %; None: drawn, 2 %")
    sensor: str = choice(DEFAULT, "whose registers it has (calibrate.py sensors); its noise stays what the other options say")
    gyro_fs_dps: float = choice(500.0, "dps, full scale")
    accel_fs_g: float = choice(4.0, "g, full scale")
    gyro_noise_dps_rthz: float = choice(0.005, "dps/sqrt(Hz), white, one-sided density")
    accel_noise_ug_rthz: float = choice(60.0, "ug/sqrt(Hz), white, one-sided density")
    bias_instability_dph: float = choice(3.0, "deg/h, flicker; the floor of the Allan deviation is 0.664 of it; 0: none")
    temperature_start_c: float = choice(25.0, "degC at the first sample")
    warm_up_c: float = choice(1.5, "degC, how far self-heating goes in the end")

    # Linear errors of the unit, 1 sigma
    gyro_scale_error: float = choice(0.01, "fraction")
    gyro_misalignment: float = choice(0.005, "rad, cross-axis terms")
    gyro_bias_dps: float = choice(1.0, "dps; draws beyond 2 dps are cut to 2")
    accel_scale_error: float = choice(0.01, "fraction; session.toml's pre-calibration undoes it")
    accel_misalignment: float = choice(0.005, "rad; session.toml's pre-calibration undoes it")
    accel_bias_mg: float = choice(15.0, "mg; session.toml's pre-calibration undoes it")
    accel_calibration_error_mg: float = choice(0.0, "mg, bias that has crept in since the pre-calibration")

    # Bench
    latitude_deg: float = choice(31.03, "deg, north positive")
    gravity_mps2: float = choice(9.7946, "m/s^2")
    heading_deg: float | None = choice(None, "deg from true north to the table's index direction; None: drawn")
    with_heading: bool = choice(False, "whether session.toml tells the heading")
    lever_m: tuple[float, float, float] = choice((0.02, -0.015, 0.01), "m, from the crossing of the gimbals to the sensor, in b")
    vigour: float = choice(1.0, "scales angles and rates of the turns; never beyond 0.85 of full scale")
    still_s: float = choice(1.0, "s, still that the protocol asks for on each side of a turn")
    turn_s: float = choice(3.0, "s, usual length of a turn")
    stop_sigma_deg: float = choice(0.0, "deg, a stop's repeatability: turns about one gimbal go into turns.csv; 0: none")
    unit_seed: int = choice(-1, "seed of the unit's errors, for several sessions of one unit; -1: that of the rest")

    @property
    def unit_drawn_from(self) -> int:
        """The seed from which the unit is drawn."""
        return self.seed if self.unit_seed < 0 else self.unit_seed

    def __post_init__(self) -> None:
        for option in fields(self):
            value = getattr(self, option.name)
            numbers = value if isinstance(value, tuple) else (value,)
            fine = all(isfinite(number) for number in numbers if isinstance(number, float))
            self._require(fine, option.name, "finite numbers" if isinstance(value, tuple) else "a finite number")
        self._require(self.closure_s >= 0, "closure_s", "0 or more")
        for name, most in LARGEST.items():
            self._require(0 <= getattr(self, name) <= most, name, f"0 to {most:g}")
        for name in ("gyro_scale_error", "gyro_misalignment", "accel_scale_error", "accel_misalignment"):
            self._require(0 <= getattr(self, name) <= 0.1, name, "0 to 0.1 (larger ones may be no invertible matrix)")
        from session.log.logfile import MOST_SIGMA_DEG  # imported here: `--help` need not wait for its NumPy

        self._require(0 <= self.stop_sigma_deg <= MOST_SIGMA_DEG, "stop_sigma_deg", f"0 to {MOST_SIGMA_DEG:g}")
        for name, least in SMALLEST.items():
            self._require(getattr(self, name) >= least, name, f"{least:g} or more")
        self._require(1 <= self.segments <= MOST_SEGMENTS, "segments", f"1 to {MOST_SEGMENTS}")
        self._require(self.seed >= 0, "seed", "0 or more")
        self._require(self.unit_seed >= -1, "unit_seed", "-1, 0 or more")
        self._require(self.odr_hz in GYRO_LPF2_HZ, "odr_hz", "one of " + ", ".join(map(str, GYRO_LPF2_HZ)))
        self._require(abs(self.odr_error or 0) <= 0.19, "odr_error", "within 0.19: the chip's register ends there")
        self._require(abs(self.latitude_deg) <= 90, "latitude_deg", "-90 to 90")
        self._require(9.7 <= self.gravity_mps2 <= 9.9, "gravity_mps2", "9.7 to 9.9")
        self._require(abs(self.heading_deg or 0) <= 360, "heading_deg", "-360 to 360")
        fine = len(self.lever_m) == 3 and all(abs(length) <= LONGEST_LEVER_M for length in self.lever_m)
        self._require(fine, "lever_m", f"three numbers within {LONGEST_LEVER_M:g}")
        for name, settled_c in (
            ("temperature_start_c", self.temperature_start_c),
            ("warm_up_c", self.temperature_start_c + self.warm_up_c),
        ):
            self._require(-40 <= settled_c <= 105, name, "within the sensor's range, -40 to 105 degC in all")
        shortest = SHORTEST_CLOSURE_STILLS * self.still_s
        self._require(self.closure_s == 0 or shortest <= self.closure_s, "closure_s", f"0, or {shortest:g} and more")
        for name, length_s in (
            ("closure_s", self.closure_s),
            ("still_s", self.segments * 2 * self.still_s),
            ("turn_s", self.segments * self.turn_s),
        ):
            self._require(length_s * self.odr_hz <= MOST_SAMPLES, name, f"less: a session has at most {MOST_SAMPLES:.0e} samples")
        units = self.register_units
        self._require(units.gyro_rps > 0 and units.accel_mps2 > 0, "sensor", "one that `calibrate.py sensors` lists")

    @property
    def register_units(self) -> RegisterUnits:
        """Scaling of the sensor's registers."""
        from session.log.registers import RegisterUnits

        return RegisterUnits(self.sensor, self.gyro_fs_dps, self.accel_fs_g)

    def _require(self, fine: bool, name: str, expected: str) -> None:
        if not fine:
            raise CalibrationError(f"{flag(name)} is {getattr(self, name)!r}, expected {expected}")


def flag(name: str) -> str:
    """Command-line flag of an option: its name, except the short ``--closure`` for closure_s."""
    return "--closure" if name == "closure_s" else "--" + name.replace("_", "-")


def command_line(options: SimulationOptions) -> str:
    """Command that reproduces this session: segments, closure and seed, and all options that differ from the default."""
    words = ["calibrate.py simulate"]
    for option in fields(options):
        value = getattr(options, option.name)
        if value == option.default and option.name not in ("segments", "closure_s", "seed"):
            continue
        if isinstance(value, bool):
            words.append(flag(option.name))
        elif isinstance(value, tuple):
            words.append(" ".join([flag(option.name), *map(repr, value)]))
        elif isinstance(value, str):
            words.append(f"{flag(option.name)} {shlex.quote(value)}")
        else:
            words.append(f"{flag(option.name)} {value!r}".removesuffix(".0"))
    return " ".join(words)


# One unit of the sensor on one bench: the errors that a calibration estimates, drawn once.

FREQ_FINE_STEP = 0.0015  #: of the nominal rate, per LSB of INTERNAL_FREQ_FINE (int8)
ODR_SPREAD = 0.02  #: 1 sigma over observed units
LARGEST_BIAS_DPS = 2.0
#: Digits in session.toml.  The simulation uses the rounded numbers, so that the file is exact.
MATRIX_DIGITS, BIAS_DIGITS, HEADING_DIGITS = 8, 7, 4


@dataclass(frozen=True, eq=False)
class SimulatedUnit:
    """True errors: ``omega = E m + B`` with m as measured; ``f = accel_matrix @ (measured - accel_bias - accel_shift)``.

    E (3, 3), B (3,) rad/s; accel_matrix (3, 3), accel_bias (3,) m/s^2 as in session.toml; accel_shift (3,) m/s^2: the part of the
    bias that session.toml lacks; odr_hz the true rate; heading_deg from true north to the table's index direction.
    """

    E: np.ndarray
    B: np.ndarray
    accel_matrix: np.ndarray
    accel_bias: np.ndarray
    accel_shift: np.ndarray
    odr_hz: float
    heading_deg: float

    def measured_rate(self, rate: np.ndarray) -> np.ndarray:
        """Measured rate for a true rate (N, 3) rad/s, before noise and low-pass: ``E^-1 (omega - B)``."""
        import numpy as np

        return (rate - self.B) @ np.linalg.inv(self.E).T

    def measured_force(self, force: np.ndarray) -> np.ndarray:
        """Measured specific force for a true one (N, 3) m/s^2, before noise and low-pass."""
        import numpy as np

        return force @ np.linalg.inv(self.accel_matrix).T + self.accel_bias + self.accel_shift


def draw_unit(options: SimulationOptions, rng: np.random.Generator) -> SimulatedUnit:
    """Draw a unit.  Every quantity is drawn whatever the options, so that one option does not change the draws of the others."""
    import numpy as np

    bias_dps = np.clip(options.gyro_bias_dps * rng.standard_normal(3), -LARGEST_BIAS_DPS, LARGEST_BIAS_DPS)
    E = _near_identity(options.gyro_scale_error, options.gyro_misalignment, rng)
    accel_matrix = _near_identity(options.accel_scale_error, options.accel_misalignment, rng)
    accel_bias = options.accel_bias_mg * MG * rng.standard_normal(3)
    accel_shift = options.accel_calibration_error_mg * MG * rng.standard_normal(3)
    drawn_error, drawn_heading = ODR_SPREAD * rng.standard_normal(), rng.uniform(-180, 180)
    odr_error = drawn_error if options.odr_error is None else options.odr_error
    freq_fine = int(np.clip(np.rint(odr_error / FREQ_FINE_STEP), -128, 127))
    return SimulatedUnit(
        E=E,
        B=bias_dps * DEG,
        accel_matrix=np.round(accel_matrix, MATRIX_DIGITS),
        accel_bias=np.round(accel_bias, BIAS_DIGITS),
        accel_shift=accel_shift,
        odr_hz=options.odr_hz * (1 + FREQ_FINE_STEP * freq_fine),
        heading_deg=round(drawn_heading, HEADING_DIGITS) if options.heading_deg is None else options.heading_deg,
    )


def _near_identity(scale: float, cross: float, rng: np.random.Generator) -> np.ndarray:
    """Matrix (3, 3) with 1 + N(0, scale) on the diagonal and N(0, cross) off it."""
    import numpy as np

    return np.eye(3) + rng.standard_normal((3, 3)) * np.where(np.eye(3, dtype=bool), scale, cross)
