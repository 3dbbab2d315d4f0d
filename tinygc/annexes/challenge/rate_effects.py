"""Effects that change the rate, implemented independently on the simulation's fine grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy.signal import bilinear, butter, lfilter, sosfiltfilt, sosfreqz

from session.io.units import DEG, G
from tinygc.simulation.movement import MovementPlan
from tinygc.simulation.simulator import ACCEL_BANDWIDTH_ODR, Distort, Disturb, RegisterLog, oversampling

# One hidden effect of a simulated session, by its action.


@dataclass(frozen=True, eq=False)
class Concealment:
    """id; truth, its parameters by the names and units of docs/formats.md; and its actions, each None where it has none.

    distort: of the true rate; disturb: of the force that the accelerometer feels; movement: plan -> plan;
    spoil: of the recorded log, (recording) -> (recording, further truth); without_latitude: whether session.toml omits the latitude.
    """

    id: str
    truth: dict = field(default_factory=dict)
    distort: Distort | None = None
    disturb: Disturb | None = None
    movement: Callable[[MovementPlan], MovementPlan] | None = None
    spoil: Callable[[RegisterLog], tuple[RegisterLog, dict]] | None = None
    without_latitude: bool = False


class Place(Protocol):
    """Properties of sensor and site that a concealment may use: of a simulated session its options, of a recording its data."""

    @property
    def gyro_fs_dps(self) -> float:
        """Full scale, dps."""

    @property
    def odr_hz(self) -> float:
        """Data rate."""

    @property
    def temperature_start_c(self) -> float:
        """Temperature at the first sample, degC."""

    @property
    def latitude_deg(self) -> float:
        """Latitude, north positive."""


class Course(Protocol):
    """Properties of the movement that a concealment may use."""

    @property
    def turns(self) -> tuple[tuple[float, float], ...]:
        """(start, stop) of each, s of the session."""

    @property
    def log_s(self) -> float:
        """Length of the session, s."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Inputs of a concealment's draw: rng; strength, a factor of the strong size; the session's sensor and site, and its movement."""

    rng: np.random.Generator
    strength: float
    options: Place
    plan: Course

    def signed(self, size: float, shape: tuple[int, ...] = (3,)) -> np.ndarray:
        """Values of either sign, 0.5 to 1.5 times strength times size."""
        return self.strength * size * self.rng.uniform(0.5, 1.5, shape) * self.rng.choice((-1.0, 1.0), shape)


Maker = Callable[[Scene], Concealment]


# Effects of the catalogue that change the rate, concealed on the simulation's fine grid.
#
# Strong sizes are those of a poor sensor or a careless set-up; each parameter is 0.5 to 1.5 times as large, of either sign.

# Strong sizes, SI
G_SENSITIVITY = 0.06 * DEG  #: rad/s per g, rms of the nine
G2_SENSITIVITY = 0.1 * DEG  #: rad/s per g^2
CROSS = 1.5e-3  #: s, rms of the nine
CUBIC_AT_FS = 0.02  #: fraction of full scale, at full scale
HALF_DIFFERENCE = 0.003  #: fraction
THERMAL_BIAS = 0.02 * DEG  #: rad/s per degC; the session warms up by 10 degC
THERMAL_SCALE = 8e-4  #: per degC
DRIFT = 0.25 * DEG  #: rad/s over the log
STEP = 0.15 * DEG  #: rad/s
RECTIFICATION = 1.5 * DEG  #: rad/s per g^2
VIBRATION_G, VIBRATION_HZ, VIBRATED_TURNS = 0.4, (20.0, 45.0), 0.5  #: rms in g of each axis, band, share of the turns
TAU_S = (5e-3, 25e-3)  #: s
SKEW_S = 17e-3  #: s, of the latest axis
OFFSET_S = 15e-3  #: s


def g_sensitivity(scene: Scene) -> Concealment:
    """The bias follows the specific force: a matrix (3, 3) rad/s per g."""
    matrix = scene.strength * G_SENSITIVITY * scene.rng.standard_normal((3, 3))
    return Concealment(
        "gyro.g_sensitivity",
        {"matrix_dps_per_g": (matrix / DEG).tolist()},
        distort=lambda t, rate, force, temp: rate + force @ (matrix / G).T,
    )


def g2_sensitivity(scene: Scene) -> Concealment:
    """The bias of each axis follows the square of the force along it, rad/s per g^2."""
    k = scene.signed(G2_SENSITIVITY)
    return Concealment(
        "gyro.g2_sensitivity", {"dps_per_g2": (k / DEG).tolist()}, distort=lambda t, rate, force, temp: rate + k * np.square(force / G)
    )


def angular_acceleration(scene: Scene) -> Concealment:
    """Angular acceleration adds to the rate by a matrix (3, 3) s."""
    cross = scene.strength * CROSS * scene.rng.standard_normal((3, 3))

    def distort(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        half = (t[1] - t[0]) / 2
        edges = np.stack([np.interp(t + shift, t, axis) for shift in (half, -half) for axis in rate.T], axis=-1)
        return rate + (edges[:, :3] - edges[:, 3:]) / (2 * half) @ cross.T

    return Concealment("gyro.angular_acceleration", {"cross": cross.tolist()}, distort=distort)


def scale_nonlinearity(scene: Scene) -> Concealment:
    """The scale factor grows with the square of the rate: a fraction at full scale."""
    cubic, full_scale = scene.signed(CUBIC_AT_FS), scene.options.gyro_fs_dps * DEG
    return Concealment(
        "gyro.scale_nonlinearity",
        {"cubic_at_fs": cubic.tolist()},
        distort=lambda t, rate, force, temp: rate * (1 + cubic * (rate / full_scale) ** 2),
    )


def scale_asymmetry(scene: Scene) -> Concealment:
    """Positive and negative rates have scale factors that differ by twice a fraction."""
    k = scene.signed(HALF_DIFFERENCE)
    return Concealment(
        "gyro.scale_asymmetry",
        {"half_difference": k.tolist()},
        distort=lambda t, rate, force, temp: np.where(rate > 0, (1 + k) * rate, (1 - k) * rate),
    )


def thermal_bias(scene: Scene) -> Concealment:
    """The bias follows the temperature, rad/s per degC since the start."""
    k, start_c = scene.signed(THERMAL_BIAS), scene.options.temperature_start_c
    return Concealment(
        "gyro.thermal_bias",
        {"dps_per_c": (k / DEG).tolist()},
        distort=lambda t, rate, force, temp: rate + np.outer(temp - start_c, k),
    )


def thermal_scale(scene: Scene) -> Concealment:
    """The scale factor follows the temperature, per degC since the start."""
    k, start_c = scene.signed(THERMAL_SCALE), scene.options.temperature_start_c
    return Concealment(
        "gyro.thermal_scale",
        {"per_c": k.tolist()},
        distort=lambda t, rate, force, temp: rate * (1 + np.outer(temp - start_c, k)),
    )


def bias_drift(scene: Scene) -> Concealment:
    """The bias grows steadily, by a total in rad/s over the log."""
    drift, log_s = scene.signed(DRIFT), scene.plan.log_s
    return Concealment(
        "gyro.bias_drift", {"dps_over_log": (drift / DEG).tolist()}, distort=lambda t, rate, force, temp: rate + np.outer(t / log_s, drift)
    )


def bias_step(scene: Scene) -> Concealment:
    """The bias jumps once, rad/s, somewhere in the middle of the log."""
    step, at_s = scene.signed(STEP), scene.plan.log_s * scene.rng.uniform(0.2, 0.8)
    return Concealment(
        "gyro.bias_step",
        {"at_s": at_s, "dps": (step / DEG).tolist()},
        distort=lambda t, rate, force, temp: rate + np.heaviside(t - at_s, 1.0)[:, None] * step,
    )


@dataclass(frozen=True, eq=False)
class Shaking:
    """Vibration in half of the turns.  envelope(t (N,) s) -> (N,) g, rms of each axis; disturb: the accelerometer's part of it."""

    envelope: Callable[[np.ndarray], np.ndarray]
    disturb: Disturb


def shaking(scene: Scene, band_hz: tuple[float, float] = VIBRATION_HZ) -> Shaking:
    """Draw which turns are vibrated, in a band."""
    seed = int(scene.rng.integers(2**32))
    turns = [turn for turn in scene.plan.turns if scene.rng.uniform() < VIBRATED_TURNS] or list(scene.plan.turns[:1])

    def envelope(t: np.ndarray) -> np.ndarray:
        """Envelope that rises and falls within a tenth of each turn."""
        rms = np.zeros(len(t))
        for start, stop in turns:
            first, last = np.searchsorted(t, (start, stop))
            u = np.linspace(0, 1, last - first)
            rms[first:last] = VIBRATION_G * np.clip(10 * np.minimum(u, 1 - u), 0, 1)
        return rms

    def disturb(t: np.ndarray, force: np.ndarray) -> np.ndarray:
        fine_hz = 1 / (t[1] - t[0])
        noise = np.random.default_rng(seed).standard_normal(force.shape)
        noise = sosfiltfilt(butter(2, band_hz, "bandpass", fs=fine_hz, output="sos"), noise, axis=0)
        return force + G * envelope(t)[:, None] * noise / noise.std(axis=0)

    return Shaking(envelope, disturb)


def vibration_rectification(scene: Scene, band_hz: tuple[float, float] = VIBRATION_HZ) -> Concealment:
    """Half of the turns are vibrated; the accelerometer feels the vibration, and the bias follows its mean square.

    The truth is per g² that the accelerometer passes, as the vibration above its low-pass cannot be measured.
    """
    k = scene.signed(RECTIFICATION)
    shaken = shaking(scene, band_hz)
    return Concealment(
        "gyro.vibration_rectification",
        {"dps_per_g2": (k / _passed(band_hz, scene.options.odr_hz) / DEG).tolist()},
        distort=lambda t, rate, force, temp: rate + np.outer(shaken.envelope(t) ** 2, k),
        disturb=shaken.disturb,
    )


def _passed(band_hz: tuple[float, float], odr_hz: float) -> float:
    """Share of the vibration's mean square after the accelerometer's low-pass, for vibration filtered twice to a band."""
    fine_hz = oversampling(odr_hz) * odr_hz
    f_hz, band = sosfreqz(butter(2, band_hz, "bandpass", fs=fine_hz, output="sos"), 8192, fs=fine_hz)
    _, passes = sosfreqz(butter(2, ACCEL_BANDWIDTH_ODR * odr_hz, fs=fine_hz, output="sos"), f_hz, fs=fine_hz)
    power = np.abs(band) ** 4
    return float(np.sum(power * np.abs(passes) ** 2) / np.sum(power))


def bandwidth(scene: Scene) -> Concealment:
    """Each axis is a first-order low-pass with a time constant of its own, s."""
    tau_s = scene.strength * scene.rng.uniform(*TAU_S, 3)

    def distort(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        slow = np.empty_like(rate)
        for axis, tau in enumerate(tau_s):
            b, a = bilinear([1.0], [tau, 1.0], fs=1 / (t[1] - t[0]))
            slow[:, axis] = rate[0, axis] + lfilter(b, a, rate[:, axis] - rate[0, axis])
        return slow

    return Concealment("gyro.bandwidth", {"tau_s": tau_s.tolist()}, distort=distort)


def axis_skew(scene: Scene) -> Concealment:
    """The axes are read one after the other, in any order."""
    seconds = scene.strength * SKEW_S * scene.rng.permutation([0.0, scene.rng.uniform(0.3, 0.7), 1.0])
    return Concealment("timing.axis_skew", {"seconds": seconds.tolist()}, distort=_late(seconds))


def gyro_accel_offset(scene: Scene) -> Concealment:
    """All axes of the gyroscope lag the accelerometer by the same seconds."""
    seconds = float(scene.signed(OFFSET_S, ()))
    return Concealment("timing.gyro_accel_offset", {"seconds": seconds}, distort=_late(np.full(3, seconds)))


def _late(seconds: np.ndarray) -> Distort:
    """A delay of the rate by seconds (3,)."""
    return lambda t, rate, force, temp: np.stack([np.interp(t - s, t, rate[:, axis]) for axis, s in enumerate(seconds)], axis=-1)


RATE_EFFECTS: dict[str, Maker] = {
    "gyro.g_sensitivity": g_sensitivity,
    "gyro.g2_sensitivity": g2_sensitivity,
    "gyro.angular_acceleration": angular_acceleration,
    "gyro.scale_nonlinearity": scale_nonlinearity,
    "gyro.scale_asymmetry": scale_asymmetry,
    "gyro.thermal_bias": thermal_bias,
    "gyro.thermal_scale": thermal_scale,
    "gyro.bias_drift": bias_drift,
    "gyro.bias_step": bias_step,
    "gyro.vibration_rectification": vibration_rectification,
    "gyro.bandwidth": bandwidth,
    "timing.axis_skew": axis_skew,
    "timing.gyro_accel_offset": gyro_accel_offset,
}
