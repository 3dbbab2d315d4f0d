"""Effects that change the rate, implemented independently on the simulation's fine grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import bilinear, lfilter

from session.base.units import DEG, G
from tinygc.simulation.movement import MovementPlan
from tinygc.simulation.sensor import Distort, Disturb, RegisterLog

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


@dataclass(frozen=True, eq=False)
class Scene:
    """Inputs of a concealment's draw: rng; strength, a factor of the strong size; its full scale, first temperature, length."""

    rng: np.random.Generator
    strength: float
    gyro_fs_dps: float
    temperature_start_c: float
    log_s: float

    def signed(self, size: float, shape: tuple[int, ...] = (3,)) -> np.ndarray:
        """Values of either sign, 0.5 to 1.5 times strength times size."""
        return self.strength * size * self.rng.uniform(0.5, 1.5, shape) * self.rng.choice((-1.0, 1.0), shape)


Maker = Callable[[Scene], Concealment]


# Effects of the catalogue that change the rate, concealed on the simulation's fine grid.
#
# Strong sizes are those of a poor sensor or a careless set-up; each parameter is 0.5 to 1.5 times as large, of either sign.
# In a lambda w, f and c are rate, force and temperature.

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
TAU_S = (5e-3, 25e-3)  #: s
SKEW_S = 17e-3  #: s, of the latest axis
OFFSET_S = 15e-3  #: s


def g_sensitivity(scene: Scene) -> Concealment:
    """The bias follows the specific force: a matrix (3, 3) rad/s per g."""
    matrix = scene.strength * G_SENSITIVITY * scene.rng.standard_normal((3, 3))
    return Concealment("gyro.g_sensitivity", {"matrix_dps_per_g": (matrix / DEG).tolist()}, lambda t, w, f, c: w + f @ (matrix / G).T)


def g2_sensitivity(scene: Scene) -> Concealment:
    """The bias of each axis follows the square of the force along it, rad/s per g^2."""
    k = scene.signed(G2_SENSITIVITY)
    return Concealment("gyro.g2_sensitivity", {"dps_per_g2": (k / DEG).tolist()}, lambda t, w, f, c: w + k * np.square(f / G))


def angular_acceleration(scene: Scene) -> Concealment:
    """Angular acceleration adds to the rate by a matrix (3, 3) s."""
    cross = scene.strength * CROSS * scene.rng.standard_normal((3, 3))

    def distort(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        half = (t[1] - t[0]) / 2
        edges = np.stack([np.interp(t + shift, t, axis) for shift in (half, -half) for axis in rate.T], axis=-1)
        return rate + (edges[:, :3] - edges[:, 3:]) / (2 * half) @ cross.T

    return Concealment("gyro.angular_acceleration", {"cross": cross.tolist()}, distort)


def scale_nonlinearity(scene: Scene) -> Concealment:
    """The scale factor grows with the square of the rate: a fraction at full scale."""
    cubic, fs_rps = scene.signed(CUBIC_AT_FS), scene.gyro_fs_dps * DEG
    return Concealment("gyro.scale_nonlinearity", {"cubic_at_fs": cubic.tolist()}, lambda t, w, f, c: w * (1 + cubic * (w / fs_rps) ** 2))


def scale_asymmetry(scene: Scene) -> Concealment:
    """Positive and negative rates have scale factors that differ by twice a fraction."""
    k = scene.signed(HALF_DIFFERENCE)
    return Concealment("gyro.scale_asymmetry", {"half_difference": k.tolist()}, lambda t, w, f, c: w * np.where(w > 0, 1 + k, 1 - k))


def thermal_bias(scene: Scene) -> Concealment:
    """The bias follows the temperature, rad/s per degC since the start."""
    k, start_c = scene.signed(THERMAL_BIAS), scene.temperature_start_c
    return Concealment("gyro.thermal_bias", {"dps_per_c": (k / DEG).tolist()}, lambda t, w, f, c: w + np.outer(c - start_c, k))


def thermal_scale(scene: Scene) -> Concealment:
    """The scale factor follows the temperature, per degC since the start."""
    k, start_c = scene.signed(THERMAL_SCALE), scene.temperature_start_c
    return Concealment("gyro.thermal_scale", {"per_c": k.tolist()}, lambda t, w, f, c: w * (1 + np.outer(c - start_c, k)))


def bias_drift(scene: Scene) -> Concealment:
    """The bias grows steadily, by a total in rad/s over the log."""
    drift, log_s = scene.signed(DRIFT), scene.log_s
    return Concealment("gyro.bias_drift", {"dps_over_log": (drift / DEG).tolist()}, lambda t, w, f, c: w + np.outer(t / log_s, drift))


def bias_step(scene: Scene) -> Concealment:
    """The bias jumps once, rad/s, somewhere in the middle of the log."""
    step, at_s = scene.signed(STEP), scene.log_s * scene.rng.uniform(0.2, 0.8)
    return Concealment(
        "gyro.bias_step", {"at_s": at_s, "dps": (step / DEG).tolist()}, lambda t, w, f, c: w + np.heaviside(t - at_s, 1.0)[:, None] * step
    )


def bandwidth(scene: Scene) -> Concealment:
    """Each axis is a first-order low-pass with a time constant of its own, s."""
    tau_s = scene.strength * scene.rng.uniform(*TAU_S, 3)

    def distort(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        slow = np.empty_like(rate)
        for axis, tau in enumerate(tau_s):
            b, a = bilinear([1.0], [tau, 1.0], fs=1 / (t[1] - t[0]))
            slow[:, axis] = rate[0, axis] + lfilter(b, a, rate[:, axis] - rate[0, axis])
        return slow

    return Concealment("gyro.bandwidth", {"tau_s": tau_s.tolist()}, distort)


def axis_skew(scene: Scene) -> Concealment:
    """The axes are read one after the other, in any order."""
    seconds = scene.strength * SKEW_S * scene.rng.permutation([0.0, scene.rng.uniform(0.3, 0.7), 1.0])
    return Concealment("timing.axis_skew", {"seconds": seconds.tolist()}, _late(seconds))


def gyro_accel_offset(scene: Scene) -> Concealment:
    """All axes of the gyroscope lag the accelerometer by the same seconds."""
    seconds = float(scene.signed(OFFSET_S, ()))
    return Concealment("timing.gyro_accel_offset", {"seconds": seconds}, _late(np.full(3, seconds)))


def _late(seconds: np.ndarray) -> Distort:
    """A delay of the rate by seconds (3,)."""
    return lambda t, w, f, c: np.stack([np.interp(t - s, t, w[:, axis]) for axis, s in enumerate(seconds)], axis=-1)


_GYRO: list[Maker] = [g_sensitivity, g2_sensitivity, angular_acceleration, scale_nonlinearity, scale_asymmetry]
_GYRO += [thermal_bias, thermal_scale, bias_drift, bias_step, bandwidth]
RATE_EFFECTS = {f"gyro.{maker.__name__}": maker for maker in _GYRO}
RATE_EFFECTS |= {"timing.axis_skew": axis_skew, "timing.gyro_accel_offset": gyro_accel_offset}
