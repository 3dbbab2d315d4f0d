"""Options of a simulated session, and the unit drawn from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from session.base.options import Record, changed, documented, option
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


@documented
@dataclass(frozen=True)
class SimulationOptions(Record):
    """Options of one simulated session.  Errors of the unit are drawn from ``seed`` with the sizes given here (1 sigma).

    Every purpose (unit, motion, noise, …) has its own random stream, so a change of noise leaves the motion unchanged.
    """

    segments: int = option(40, "turns in the log; the stills are one more", least=1, most=MOST_SEGMENTS)
    closure_s: float = option(58.0, "whole length of the closure run with its two stills; 0: none", unit="s", least=0, flags=("--closure",))
    seed: int = option(0, "of every random draw", least=0)

    # Sensor
    odr_hz: float = option(208.0, "nominal: 62.5, 104, 208, 416, 833, 1667, 3333 or 6667", unit="Hz", choices=tuple(GYRO_LPF2_HZ))
    odr_error: float | None = option(
        None, "fraction, rounded to the chip's steps of 0.15 %; None: drawn, 2 %", least=-0.19, most=0.19, cli=False, rare=True
    )
    sensor: str = option(DEFAULT, "whose registers it has (calibrate.py sensors)")
    gyro_fs_dps: float = option(500.0, "full scale", unit="dps", rare=True)
    accel_fs_g: float = option(4.0, "full scale", unit="g", rare=True)
    gyro_noise_dps_rthz: float = option(0.005, "white, one-sided density", unit="dps/sqrt(Hz)", least=0, most=100, cli=False)
    accel_noise_ug_rthz: float = option(60.0, "white, one-sided density", unit="ug/sqrt(Hz)", least=0, most=1e6, cli=False)
    bias_instability_dph: float = option(
        3.0, "flicker; the floor of the Allan deviation is 0.664 of it; 0: none", unit="deg/h", least=0, most=1000, cli=False
    )
    temperature_start_c: float = option(25.0, "at the first sample", unit="degC", cli=False)
    warm_up_c: float = option(1.5, "how far self-heating goes in the end", unit="degC", cli=False)

    # Linear errors of the unit, 1 sigma
    gyro_scale_error: float = option(0.01, "fraction", least=0, most=0.1, cli=False)
    gyro_misalignment: float = option(0.005, "cross-axis terms", unit="rad", least=0, most=0.1, cli=False)
    gyro_bias_dps: float = option(1.0, "draws beyond 2 dps are cut to 2", unit="dps", least=0, most=1e4, cli=False)
    accel_scale_error: float = option(0.01, "fraction, corrected by session.toml's pre-calibration", least=0, most=0.1, cli=False)
    accel_misalignment: float = option(0.005, "corrected by session.toml's pre-calibration", unit="rad", least=0, most=0.1, cli=False)
    accel_bias_mg: float = option(15.0, "corrected by session.toml's pre-calibration", unit="mg", least=0, most=1e4, cli=False)
    accel_calibration_error_mg: float = option(
        0.0, "bias that has crept in since the pre-calibration", unit="mg", least=0, most=1e4, cli=False
    )

    # Bench
    latitude_deg: float = option(31.03, "north positive", unit="deg", least=-90, most=90, cli=False)
    gravity_mps2: float = option(9.7946, "local gravity", unit="m/s^2", least=9.7, most=9.9, cli=False)
    heading_deg: float | None = option(
        None, "from true north to the table's index direction; None: drawn", unit="deg", least=-360, most=360
    )
    with_heading: bool = option(False, "whether session.toml has the heading", rare=True)
    lever_m: tuple[float, float, float] = option(
        (0.02, -0.015, 0.01), "from the crossing of the gimbals to the sensor, in b", unit="m", least=-10, most=10
    )
    vigour: float = option(1.0, "scales angles and rates of the turns; never beyond 0.85 of full scale", least=1e-3, most=1000, rare=True)
    still_s: float = option(1.0, "still that the protocol asks for on each side of a turn", unit="s", least=0.1, cli=False)
    turn_s: float = option(3.0, "usual length of a turn", unit="s", least=0.01, rare=True)
    stop_sigma_deg: float = option(0.0, "a stop's repeatability: turns about one gimbal go into turns.csv; 0: none", unit="deg", rare=True)
    unit_seed: int = option(-1, "seed of the unit's errors, for several sessions of one unit; -1: that of the rest", least=-1, rare=True)

    @property
    def unit_drawn_from(self) -> int:
        """The seed from which the unit is drawn."""
        return self.seed if self.unit_seed < 0 else self.unit_seed

    def __post_init__(self) -> None:
        """Check each field, and what they decide together: temperatures, the closure run, the number of samples, the sensor."""
        super().__post_init__()
        from session.log.logfile import MOST_SIGMA_DEG  # imported here: `--help` need not wait for its NumPy

        self.expect(0 <= self.stop_sigma_deg <= MOST_SIGMA_DEG, "stop_sigma_deg", f"0 to {MOST_SIGMA_DEG:g}")
        for name, settled_c in (
            ("temperature_start_c", self.temperature_start_c),
            ("warm_up_c", self.temperature_start_c + self.warm_up_c),
        ):
            self.expect(-40 <= settled_c <= 105, name, "within the sensor's range, -40 to 105 degC in all")
        shortest = SHORTEST_CLOSURE_STILLS * self.still_s
        self.expect(self.closure_s == 0 or shortest <= self.closure_s, "closure_s", f"0, or {shortest:g} and more")
        for name, length_s in (
            ("closure_s", self.closure_s),
            ("still_s", self.segments * 2 * self.still_s),
            ("turn_s", self.segments * self.turn_s),
        ):
            self.expect(length_s * self.odr_hz <= MOST_SAMPLES, name, f"less: a session has at most {MOST_SAMPLES} samples")
        units = self.register_units
        self.expect(units.gyro_rps > 0 and units.accel_mps2 > 0, "sensor", "one that `calibrate.py sensors` lists")

    @property
    def register_units(self) -> RegisterUnits:
        """Scaling of the sensor's registers."""
        from session.log.registers import RegisterUnits

        return RegisterUnits(self.sensor, self.gyro_fs_dps, self.accel_fs_g)


def in_python(options: SimulationOptions) -> str:
    """The call that reproduces this session: segments, closure and seed, and all options that differ from the default."""
    given = {name: getattr(options, name) for name in ("segments", "closure_s", "seed")} | changed(options)
    return f"tinygc.simulate({', '.join(f'{name}={value!r}' for name, value in given.items())})"


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
    bias that is not in session.toml; odr_hz the true rate; heading_deg from true north to the table's index direction.
    """

    E: np.ndarray
    B: np.ndarray
    accel_matrix: np.ndarray
    accel_bias: np.ndarray
    accel_shift: np.ndarray
    odr_hz: float
    heading_deg: float

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
