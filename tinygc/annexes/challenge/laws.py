"""Gyroscope error laws outside the catalogue, by family, and random laws from a wide grammar."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import bilinear, lfilter
from scipy.spatial.transform import Rotation

from session.io.units import DEG, G
from tinygc.annexes.challenge.rate_effects import Concealment, Maker, Scene, Shaking, shaking

# Common parts of the laws: adding to the rate, a first-order lag, the other axes.

#: s: averaging time of the vibration's mean square
ENERGY_S = 0.25
#: added(t (N,), rate (N, 3), force (N, 3), temp (N,)) -> (N, 3) rad/s, SI
Added = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def adding(name: str, truth: dict, added: Added) -> Concealment:
    """A law that adds to the rate; truth: its parameters, SI."""
    return Concealment(name, truth, distort=lambda t, rate, force, temp: rate + added(t, rate, force, temp))


def lagged(t: np.ndarray, values: np.ndarray, tau_s: float) -> np.ndarray:
    """y' = (x - y) / tau, starting from y = x at the first time; values (N, …) at even times t (N,) s."""
    keeps = np.exp(-(t[1] - t[0]) / tau_s)
    return values[0] + lfilter([1 - keeps], [1, -keeps], values - values[0], axis=0)


def slope(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Time derivative of values (N, …) at even times t (N,) s."""
    return np.gradient(values, t[1] - t[0], axis=0)


def next_axis(values: np.ndarray) -> np.ndarray:
    """The axes in the order y, z, x, (N, 3)."""
    return np.roll(values, -1, axis=1)


def previous_axis(values: np.ndarray) -> np.ndarray:
    """The axes in the order z, x, y, (N, 3)."""
    return np.roll(values, 1, axis=1)


def size_of(vectors: np.ndarray) -> np.ndarray:
    """Norms (N, 1) of vectors (N, 3)."""
    return np.linalg.norm(vectors, axis=1, keepdims=True)


def energy(t: np.ndarray, shaken: Shaking) -> np.ndarray:
    """Running mean square of the vibration itself, mean of the axes, (N,) g²."""
    squares = np.mean((shaken.disturb(t, np.zeros((len(t), 3))) / G) ** 2, axis=1)
    return uniform_filter1d(squares, max(1, round(ENERGY_S / (t[1] - t[0]))), mode="nearest")


# The part of an added rate outside a linear calibration (a bias and a 3x3 of the rate).


def beyond_linear(rate: np.ndarray, added: np.ndarray) -> np.ndarray:
    """Residual (N, 3) of ``added`` (N, 3) after regression on a constant and the rate (N, 3), or further columns, axis by axis."""
    known = np.column_stack([np.ones(len(rate)), rate])
    # Normal equations, as there are a few columns of similar size and hundreds of thousands of rows.
    scale = np.abs(known).max(axis=0)
    known = known / np.where(scale > 0, scale, 1.0)
    return added - known @ np.linalg.lstsq(known.T @ known, known.T @ added, rcond=1e-12)[0]


def rms(values: np.ndarray) -> float:
    """Root mean square of all numbers."""
    return float(np.sqrt(np.mean(np.square(values))))


# Signals at each moment, scaled to about one, as leaves of a drawn law.

#: typical sizes of a hand movement: rad/s, rad/s², degC of warm-up, rad turned in a session, g²
RATE, ACCELERATION, WARM_C, TURNED, VIBRATION = 100 * DEG, 300 * DEG, 10.0, 8000 * DEG, 0.16


@dataclass(frozen=True, eq=False)
class Signals:
    """At even times: t (N,) s; share (N,) of the session; rate, force (N, 3) and warm (N,) degC since the start, SI; vibration (N,) g²."""

    t: np.ndarray
    share: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    warm: np.ndarray
    vibration: np.ndarray


#: values (N, 3), or (N, 1) where they are the same for all axes
Curve = Callable[[Signals], np.ndarray]


LEAVES: dict[str, Curve] = {
    "w": lambda s: s.rate / RATE,
    "w_next": lambda s: next_axis(s.rate) / RATE,
    "w_prev": lambda s: previous_axis(s.rate) / RATE,
    "|w|": lambda s: size_of(s.rate) / RATE,
    "f": lambda s: s.force / G,
    "f_next": lambda s: next_axis(s.force) / G,
    "f_prev": lambda s: previous_axis(s.force) / G,
    "a": lambda s: slope(s.t, s.rate) / ACCELERATION,
    "a_next": lambda s: next_axis(slope(s.t, s.rate)) / ACCELERATION,
    "|a|": lambda s: size_of(slope(s.t, s.rate)) / ACCELERATION,
    "T": lambda s: s.warm[:, None] / WARM_C,
    "t": lambda s: s.share[:, None],
    "turned": lambda s: np.cumsum(size_of(s.rate), axis=0) * (s.t[1] - s.t[0]) / TURNED,  # angle so far, in either sense
    "angle": lambda s: np.cumsum(s.rate, axis=0) * (s.t[1] - s.t[0]),  # integral of the rate about each axis, rad
    "v": lambda s: s.vibration[:, None] / VIBRATION,
}
#: weights of the draw; rate and force vary most in a hand movement
WEIGHTS = {"w": 4, "w_next": 2, "w_prev": 2, "|w|": 3, "f": 3, "f_next": 2, "f_prev": 2, "a": 1, "a_next": 1, "|a|": 1, "T": 3, "t": 2}
WEIGHTS |= {"turned": 1, "angle": 1, "v": 1}


# A vector fixed in the world in body coordinates, from gravity's attitude at the start and the true rate from there on.

UP = np.array([0.0, 0.0, 1.0])


def attitudes(t: np.ndarray, rate: np.ndarray, force: np.ndarray) -> Rotation:
    """R_wb at each of the even times t (N,) s, from rates (N, 3) rad/s and the specific force (N, 3) of a body that rests at first.

    World w: z up, x where the yaw of the start is zero.  The Earth's rotation counts as the body's: within 1° in four minutes.
    Source: trapezoidal increments; at 1600 Hz and 400 dps a turn closes within 1e-5 rad.
    """
    first, _ = Rotation.align_vectors(UP[None], force[:1] / np.linalg.norm(force[0]))
    steps = Rotation.from_rotvec((rate[1:] + rate[:-1]) / 2 * (t[1] - t[0])).as_quat()
    return Rotation.from_quat(running_products(np.vstack([first.as_quat(), steps])))


def seen_by_body(vector_w: np.ndarray, t: np.ndarray, rate: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Body coordinates (N, 3) of a vector (3,) that is fixed in the world."""
    return attitudes(t, rate, force).inv().apply(vector_w)


def running_products(q: np.ndarray) -> np.ndarray:
    """q[0] q[1] … q[i] for each i; quaternions (N, 4), scalar last.  All blocks are multiplied in parallel, then chained."""
    count = len(q)
    width = int(np.ceil(np.sqrt(count)))
    blocks = np.tile([0.0, 0.0, 0.0, 1.0], (width, width, 1))
    blocks.reshape(-1, 4)[:count] = q
    for i in range(1, width):
        blocks[:, i] = product(blocks[:, i - 1], blocks[:, i])
    before = np.tile([0.0, 0.0, 0.0, 1.0], (width, 1, 1))
    for i in range(1, width):
        before[i] = product(before[i - 1], blocks[i - 1, -1])
    return product(before, blocks).reshape(-1, 4)[:count]


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Hamilton's product of quaternions (…, 4), scalar last."""
    u, a, v, b = p[..., :3], p[..., 3:], q[..., :3], q[..., 3:]
    vector = a * v + b * u + np.cross(u, v)
    return np.concatenate([vector, a * b - np.sum(u * v, axis=-1, keepdims=True)], axis=-1)


# Laws that are no smooth function: two-level noise, and an output in coarse steps.

# Strong sizes, SI
#: rad/s between its levels, and mean dwell time in each: one trap in an oxide, Kirton & Uren 1989
TELEGRAPH, STAYS_S = 0.2 * DEG, (4.0, 15.0)
STEP = 1.5 * DEG  #: rad/s: nine bits over ±500 dps


def telegraph(scene: Scene) -> Concealment:
    """Random telegraph noise: the zero jumps between two levels at moments of a Poisson process."""
    size, stays_s = scene.signed(TELEGRAPH), scene.rng.uniform(*STAYS_S)
    stays = scene.rng.exponential(stays_s, 20 + int(4 * scene.plan.log_s / stays_s))
    at_s = np.cumsum(stays)[: np.searchsorted(np.cumsum(stays), scene.plan.log_s)]
    return adding(
        "law.telegraph",
        {"rps": size.tolist(), "at_s": at_s.tolist()},
        lambda t, rate, force, temp: (np.searchsorted(at_s, t) % 2)[:, None] * size,
    )


def quantised(scene: Scene) -> Concealment:
    """The element's output has coarse steps."""
    step = np.abs(scene.signed(STEP))
    return adding("law.quantised", {"rps": step.tolist()}, lambda t, rate, force, temp: step * np.rint(rate / step) - rate)


# The vibrating element and its control loops: errors of the rate itself.

# Strong sizes, SI
#: share of the response through a soft suspension, its frequency, Hz, and quality: a board on rubber feet, a die on soft glue
SHARE, SUSPENSION_HZ, QUALITY = 0.15, (5.0, 12.0), (1.5, 5.0)
#: share of the sensitivity, where |omega| is the full scale: the Coriolis force of the other axes takes energy out of the drive
DROOP = 0.03
#: share of the sensitivity, at full scale: the drive's gain control (Acar & Shkel, MEMS Vibratory Gyroscopes, 2009) with a slow loop
RECOVERY, GAIN_S = 0.15, (0.3, 3.0)
DEAD_ZONE = 0.3 * DEG
ROOT = 0.012  #: share of the sensitivity, at full scale
LIMIT = 4.0  #: full scales, where the output saturates, L tanh(omega / L), at strength 1


def resonance(scene: Scene) -> Concealment:
    """Part of the rate has a second-order response y'' + (w0/Q) y' + w0² y = w0² omega."""
    share = scene.signed(SHARE)
    frequency = 2 * np.pi * scene.rng.uniform(*SUSPENSION_HZ, 3)
    quality = scene.rng.uniform(*QUALITY, 3)

    def added(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        change = np.empty_like(rate)
        for axis, (w0, q) in enumerate(zip(frequency, quality, strict=True)):
            b, a = bilinear([w0**2], [1.0, w0 / q, w0**2], fs=1 / (t[1] - t[0]))
            change[:, axis] = lfilter(b, a, rate[:, axis] - rate[0, axis]) + rate[0, axis] - rate[:, axis]
        return share * change

    told = {"share": share.tolist(), "hz": (frequency / (2 * np.pi)).tolist(), "quality": quality.tolist()}
    return adding("law.resonance", told, added)


def drive_droop(scene: Scene) -> Concealment:
    """The sensitivity of all axes falls with |omega|."""
    size, full_scale = scene.signed(DROOP), scene.options.gyro_fs_dps * DEG
    return adding("law.drive_droop", {"at_fs": size.tolist()}, lambda t, rate, force, temp: -size * rate * size_of(rate) / full_scale)


def drive_recovery(scene: Scene) -> Concealment:
    """The sensitivity follows |omega|² with the delay of a slow gain control."""
    size, tau_s, full_scale = scene.signed(RECOVERY), scene.rng.uniform(*GAIN_S), scene.options.gyro_fs_dps * DEG
    return adding(
        "law.drive_recovery",
        {"at_fs": size.tolist(), "tau_s": tau_s},
        lambda t, rate, force, temp: -size * rate * lagged(t, size_of(rate / full_scale) ** 2, tau_s),
    )


def dead_zone(scene: Scene) -> Concealment:
    """The output does not change around zero rate."""
    width = np.abs(scene.signed(DEAD_ZONE))
    return adding("law.dead_zone", {"rps": width.tolist()}, lambda t, rate, force, temp: -np.clip(rate, -width, width))


def root_scale(scene: Scene) -> Concealment:
    """The sensitivity changes with the square root of the rate."""
    size, full_scale = scene.signed(ROOT), scene.options.gyro_fs_dps * DEG
    return adding("law.root_scale", {"at_fs": size.tolist()}, lambda t, rate, force, temp: size * rate * np.sqrt(np.abs(rate) / full_scale))


def soft_limit(scene: Scene) -> Concealment:
    """The output saturates, L tanh(omega / L): at these rates nearly the catalogue's cubic effect, which is as good an answer."""
    limit = LIMIT * scene.options.gyro_fs_dps * DEG / np.sqrt(np.abs(scene.signed(1.0)))
    return adding("law.soft_limit", {"rps": limit.tolist()}, lambda t, rate, force, temp: limit * np.tanh(rate / limit) - rate)


# The Earth's field, fixed in the world, changes the zero: drive coils, pick-off loops, steel in the package.

# Strong sizes, SI
#: rad/s per field, rms of the nine: a ring that is driven and sensed by a magnet's field is sensitive to any other field, too
ZERO = 0.08 * DEG
#: share of the field's rotation that appears as rate, rms of the nine: a pick-off loop in a rotating field
INDUCTION = 1.5e-3


def magnetic_zero(scene: Scene) -> Concealment:
    """zero = M b: b the field's direction in the body."""
    matrix = scene.strength * ZERO * scene.rng.standard_normal((3, 3))
    field, told = _field(scene)
    return adding(
        "law.magnetic_zero",
        {"matrix_rps": matrix.tolist()} | told,
        lambda t, rate, force, temp: seen_by_body(field, t, rate, force) @ matrix.T,
    )


def magnetic_induction(scene: Scene) -> Concealment:
    """zero = M (b x omega), the rate at which the field's direction b changes in the body."""
    matrix = scene.strength * INDUCTION * scene.rng.standard_normal((3, 3))
    field, told = _field(scene)
    return adding(
        "law.magnetic_induction",
        {"matrix": matrix.tolist()} | told,
        lambda t, rate, force, temp: np.cross(seen_by_body(field, t, rate, force), rate) @ matrix.T,
    )


def _field(scene: Scene) -> tuple[np.ndarray, dict]:
    """Its direction (3,) in the world, z up, and dip and heading.  Dip of a dipole along the Earth's axis: tan I = 2 tan latitude."""
    dip = np.arctan(2 * np.tan(scene.options.latitude_deg * DEG))
    heading = scene.rng.uniform(0, 2 * np.pi)
    field = np.array([np.cos(dip) * np.cos(heading), np.cos(dip) * np.sin(heading), -np.sin(dip)])
    return field, {"dip_rad": float(dip), "heading_rad": float(heading)}


# The zero has a memory: of the last turn, an overload, the attitude.

# Strong sizes, SI
#: rad/s per recent rad turned: charges on the electrodes and glue under shear drift back within seconds
REMNANT, FORGETS_S = 0.08 * DEG, (5.0, 20.0)
#: rad/s to either side, and the rate that reverses it: friction between the die and its glue
HYSTERESIS, TURNS_OVER = 0.12 * DEG, (15 * DEG, 40 * DEG)
#: rad/s, after |omega| exceeded a limit; the loops wind up and need seconds
OVERLOAD, BEYOND, UNWINDS_S = 0.6 * DEG, (90 * DEG, 150 * DEG), (1.0, 4.0)
#: rad/s per g, rms of the nine: a die on viscoelastic glue leans for tens of seconds
CREEP, LEANS_S = 0.15 * DEG, (5.0, 25.0)


def last_turn(scene: Scene) -> Concealment:
    """The zero keeps a remnant m of the angle turned, m' = omega - m / tau; the body rests at first."""
    size, tau_s = scene.signed(REMNANT), scene.rng.uniform(*FORGETS_S)
    return adding(
        "law.last_turn",
        {"rps_per_rad": size.tolist(), "tau_s": tau_s},
        lambda t, rate, force, temp: size * tau_s * lagged(t, rate, tau_s),
    )


def turn_hysteresis(scene: Scene) -> Concealment:
    """The zero is displaced to the side of the last turn faster than a threshold; it is centred before the first."""
    size, threshold = scene.signed(HYSTERESIS), scene.rng.uniform(*TURNS_OVER)

    def added(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        return size * last_sign(rate, threshold)

    return adding("law.turn_hysteresis", {"rps": size.tolist(), "threshold_rps": threshold}, added)


def last_sign(values: np.ndarray, threshold: float) -> np.ndarray:
    """For each column of values (N, K): the sign when it was last beyond the threshold, 0 before."""
    beyond = np.abs(values) > threshold
    rows = np.maximum.accumulate(np.where(beyond, np.arange(len(values))[:, None], -1), axis=0)
    return np.where(rows >= 0, np.take_along_axis(np.sign(values), np.maximum(rows, 0), axis=0), 0.0)


def overload(scene: Scene) -> Concealment:
    """The zero is displaced while |omega| exceeds a limit, and for some seconds after."""
    size, limit, tau_s = scene.signed(OVERLOAD), scene.rng.uniform(*BEYOND), scene.rng.uniform(*UNWINDS_S)
    return adding(
        "law.overload",
        {"rps": size.tolist(), "limit_rps": limit, "tau_s": tau_s},
        lambda t, rate, force, temp: size * lagged(t, (size_of(rate) > limit).astype(float), tau_s),
    )


def gravity_creep(scene: Scene) -> Concealment:
    """The zero follows the specific force slowly, through a matrix."""
    matrix, tau_s = scene.strength * CREEP * scene.rng.standard_normal((3, 3)), scene.rng.uniform(*LEANS_S)
    return adding(
        "law.gravity_creep",
        {"matrix_rps_per_g": matrix.tolist(), "tau_s": tau_s},
        lambda t, rate, force, temp: lagged(t, force / G, tau_s) @ matrix.T,
    )


# The package warms up: strain, and the temperature dependence of other sensitivities.

# Strong sizes, SI; a session warms up by 10 degC with a time constant of 150 s
#: rad/s per degC/s: a warm-up's zero is off by some 0.2 dps at first, as in data sheets' curves of the first minutes
TEMPERATURE_RATE = 4.0 * DEG
#: rad/s per degC of strain that has not yet relaxed in the glue
STRAIN, LETS_GO_S = 0.15 * DEG, (15.0, 60.0)
CURVE = 0.01 * DEG  #: rad/s per degC², around the middle of the warm-up
WARM_GRAVITY = 0.02 * DEG  #: rad/s per g and degC
WARM_SQUARE = 0.5 * DEG  #: rad/s per degC, where the rate is at full scale


def temperature_rate(scene: Scene) -> Concealment:
    """The zero follows dT/dt.  While T is one exponential this equals the catalogue's zero over T, which is as good an answer."""
    size = scene.signed(TEMPERATURE_RATE)
    return adding(
        "law.temperature_rate", {"rps_per_cps": size.tolist()}, lambda t, rate, force, temp: np.outer(slope(t, np.asarray(temp)), size)
    )


def package_strain(scene: Scene) -> Concealment:
    """The zero follows a strain e that dT/dt feeds and the glue relaxes: e' = dT/dt - e / tau."""
    size, tau_s = scene.signed(STRAIN), scene.rng.uniform(*LETS_GO_S)
    return adding(
        "law.package_strain",
        {"rps_per_c": size.tolist(), "tau_s": tau_s},
        lambda t, rate, force, temp: np.outer(temp - lagged(t, temp, tau_s), size),
    )


def temperature_curve(scene: Scene) -> Concealment:
    """The zero has a turning point in the middle of the session's temperatures."""
    size, middle_c = scene.signed(CURVE), scene.options.temperature_start_c + scene.options.warm_up_c / 2
    return adding(
        "law.temperature_curve",
        {"rps_per_c2": size.tolist(), "middle_c": middle_c},
        lambda t, rate, force, temp: np.outer((temp - middle_c) ** 2, size),
    )


def warm_gravity(scene: Scene) -> Concealment:
    """The sensitivity to the force along an axis grows with the temperature since the start."""
    size, start_c = scene.signed(WARM_GRAVITY), scene.options.temperature_start_c
    return adding(
        "law.warm_gravity",
        {"rps_per_g_c": size.tolist()},
        lambda t, rate, force, temp: size * force / G * (temp - start_c)[:, None],
    )


def warm_square(scene: Scene) -> Concealment:
    """The rate added by the square of the rate grows with the temperature since the start."""
    size, start_c, full_scale = scene.signed(WARM_SQUARE), scene.options.temperature_start_c, scene.options.gyro_fs_dps * DEG
    return adding(
        "law.warm_square",
        {"rps_per_c_at_fs": size.tolist()},
        lambda t, rate, force, temp: size * (rate / full_scale) ** 2 * (temp - start_c)[:, None],
    )


# Products: of rates about several axes, of forces, of rate and force, of rate and vibration.

# Strong sizes, SI
#: share of full scale, where both rates are at full scale: unequal inertias of the element, as anisoinertia of a spinning gyro (IEEE 1431)
RATE_PRODUCT = 0.02
RATE_SQUARES = 0.012  #: the same, of the squares about the two other axes: centrifugal softening of the sense mode
CROSS_CUBE = 0.05  #: the same, of the next axis' rate cubed
RECTIFIED_S = 1e-3  #: s: the size of the angular acceleration leaks through an unsymmetric demodulator
ANISOELASTIC = 0.25 * DEG  #: rad/s per g²: unequal springs of a large element
FORCE_SCALE = 0.006  #: share of the sensitivity, per g: a pendulous mass detunes the modes
VIBRATION_SCALE = 0.04  #: share of the sensitivity, per g² of vibration


def rate_product(scene: Scene) -> Concealment:
    """Simultaneous rates about two axes add to the third."""
    size, full_scale = scene.signed(RATE_PRODUCT), scene.options.gyro_fs_dps * DEG
    return adding(
        "law.rate_product",
        {"at_fs": size.tolist()},
        lambda t, rate, force, temp: size * next_axis(rate) * previous_axis(rate) / full_scale,
    )


def rate_squares(scene: Scene) -> Concealment:
    """The squares of the rates about the two other axes, together, add to an axis."""
    size, full_scale = scene.signed(RATE_SQUARES), scene.options.gyro_fs_dps * DEG
    return adding(
        "law.rate_squares",
        {"at_fs": size.tolist()},
        lambda t, rate, force, temp: size * (next_axis(rate) ** 2 + previous_axis(rate) ** 2) / full_scale,
    )


def cross_cube(scene: Scene) -> Concealment:
    """An axis' sensitivity to the next axis grows with the square of the rate about that one."""
    size, full_scale = scene.signed(CROSS_CUBE), scene.options.gyro_fs_dps * DEG
    return adding("law.cross_cube", {"at_fs": size.tolist()}, lambda t, rate, force, temp: size * next_axis(rate) ** 3 / full_scale**2)


def rectified_acceleration(scene: Scene) -> Concealment:
    """The zero follows the size of the angular acceleration, in either sense."""
    size = scene.signed(RECTIFIED_S)
    return adding("law.rectified_acceleration", {"s": size.tolist()}, lambda t, rate, force, temp: size * size_of(slope(t, rate)))


def anisoelastic(scene: Scene) -> Concealment:
    """The zero follows the product of the two other axes' forces."""
    size = scene.signed(ANISOELASTIC)
    return adding(
        "law.anisoelastic",
        {"rps_per_g2": size.tolist()},
        lambda t, rate, force, temp: size * next_axis(force) * previous_axis(force) / G**2,
    )


def force_scale(scene: Scene) -> Concealment:
    """The sensitivity of an axis follows the force along it."""
    size = scene.signed(FORCE_SCALE)
    return adding("law.force_scale", {"per_g": size.tolist()}, lambda t, rate, force, temp: size * rate * force / G)


def vibration_scale(scene: Scene) -> Concealment:
    """Half of the turns are vibrated; the sensitivity follows the vibration's mean square."""
    size = scene.signed(VIBRATION_SCALE)
    shaken = shaking(scene)
    return Concealment(
        "law.vibration_scale",
        {"per_g2": size.tolist()},
        distort=lambda t, rate, force, temp: rate * (1 + np.outer(energy(t, shaken), size)),
        disturb=shaken.disturb,
    )


# The supply sags and the sensor follows: a periodic load, a regulator after switch-on.

# Strong sizes, SI
#: rad/s: a zero that follows the supply by 1 dps per V, and a radio or a heater that pulls 0.2 V on a thin cable
SAG = 0.2 * DEG
PERIOD_S, DUTY = (8.0, 30.0), (0.25, 0.6)
SUPPLY_RECOVERY, RECOVERY_S = 0.5 * DEG, (15.0, 60.0)  #: rad/s at switch-on, and its time constant
RATIOMETRIC = 0.01  #: share of the sensitivity: 30 mV of 3 V


def switched_load(scene: Scene) -> Concealment:
    """A load is on for a share of each period, and the zero jumps with it."""
    size, (on, told) = scene.signed(SAG), _clock(scene)
    return adding("law.switched_load", {"rps": size.tolist()} | told, lambda t, rate, force, temp: np.outer(on(t), size))


def ratiometric_scale(scene: Scene) -> Concealment:
    """The sensitivity follows the supply under the same load."""
    size, (on, told) = scene.signed(RATIOMETRIC), _clock(scene)
    return adding("law.ratiometric_scale", {"share": size.tolist()} | told, lambda t, rate, force, temp: on(t)[:, None] * size * rate)


def sag_recovery(scene: Scene) -> Concealment:
    """The zero is off after switch-on and recovers exponentially."""
    size, tau_s = scene.signed(SUPPLY_RECOVERY), scene.rng.uniform(*RECOVERY_S)
    return adding(
        "law.sag_recovery",
        {"rps": size.tolist(), "tau_s": tau_s},
        lambda t, rate, force, temp: np.outer(np.exp(-np.maximum(t, 0) / tau_s), size),
    )


def _clock(scene: Scene) -> tuple[Callable[[np.ndarray], np.ndarray], dict]:
    """A function that is true where the load is on at times t (N,) s, and its parameters."""
    period_s, duty, phase = scene.rng.uniform(*PERIOD_S), scene.rng.uniform(*DUTY), scene.rng.uniform()
    return lambda t: ((t / period_s + phase) % 1 < duty).astype(float), {"period_s": period_s, "duty": duty, "phase": phase}


# A random law from a grammar wider than any search: trees of products, ratios, bends and lags over all signals.

#: rad/s rms beyond a linear calibration, strong
SIZES = (0.05 * DEG, 0.3 * DEG)
#: least share of its own rms beyond a linear calibration
LEAST_BEYOND = 0.2
PLAIN = ("f", "T", "t", "a")
FACTORS = ((1, 2, 3), (0.35, 0.45, 0.2))
BENT = 0.55  #: share of the factors with a bend
AXES = {"all": 0.6, "one": 0.25, "two": 0.15}
LAGS_S = (0.2, 20.0)
#: bends map sizes of about one to sizes of about one
BENDS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "tanh(2 {})": lambda x: np.tanh(2 * x),
    "tanh(8 {})": lambda x: np.tanh(8 * x),
    "log(1 + |{}|)": lambda x: np.log1p(np.abs(x)),
    "exp(-|{}|)": lambda x: np.exp(-np.abs(x)),
    "exp({})": lambda x: np.exp(np.clip(x, -3, 2)),
    "sqrt(|{}|)": lambda x: np.sqrt(np.abs(x)),
    "|{}|": np.abs,
    "({})²": np.square,
    "{0} |{0}|": lambda x: x * np.abs(x),
    "max({}, 0)": lambda x: np.maximum(x, 0),
    "sin(3 {})": lambda x: np.sin(3 * x),
    "1/(1 + ({})²)": lambda x: 1 / (1 + x**2),
}
JOINS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "({} + {})": np.add,
    "({} - {})": np.subtract,
    "{}/(1 + |{}|)": lambda x, y: x / (1 + np.abs(y)),
    "max({}, {})": np.maximum,
}
JOINED = 0.25  #: share of the factors that join two signals


def draw_expression(rng: np.random.Generator) -> tuple[str, Curve]:
    """Text and curve of a random expression: drawn until enough of it on a trial movement is outside a linear calibration and a zero that
    follows force, temperature, time or angular acceleration, which every catalogue has."""
    trial = _trial_movement()
    plain = np.hstack([trial.rate, *(LEAVES[name](trial) for name in PLAIN)])
    while True:
        text, curve = _product(rng)
        values = np.broadcast_to(curve(trial), trial.rate.shape)
        if np.isfinite(values).all() and rms(values) > 0 and rms(beyond_linear(plain, values)) > LEAST_BEYOND * rms(values):
            return text, curve


def random_law(scene: Scene) -> Concealment:
    """An expression on all, two or one of the axes, scaled to a drawn rms beyond a linear calibration on the session's own movement."""
    rng, options, log_s = scene.rng, scene.options, scene.plan.log_s
    text, curve = draw_expression(rng)
    pattern = str(rng.choice(list(AXES), p=list(AXES.values())))
    on = np.zeros(3)
    on[rng.permutation(3)[: {"all": 3, "two": 2, "one": 1}[pattern]]] = 1.0
    shares = on * rng.uniform(0.5, 1.5, 3) * rng.choice((-1.0, 1.0), 3)
    size = scene.strength * float(rng.uniform(*SIZES))
    shaken = shaking(scene) if "v" in _words(text) else None

    def distort(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        vibration = np.zeros(len(t)) if shaken is None else energy(t, shaken)
        signals = Signals(t, np.clip(t / log_s, 0, 1), rate, force, temp - options.temperature_start_c, vibration)
        added = curve(signals) * shares
        inside = (t >= 0) & (t < log_s)
        beyond = rms(beyond_linear(rate[inside], added[inside]))
        return rate + added * size / max(beyond, LEAST_BEYOND / 4 * rms(added[inside]))

    told = {"expression": text, "shares": shares.tolist(), "rps_rms": size}
    return Concealment("law.random", told, distort=distort, disturb=None if shaken is None else shaken.disturb)


def _words(text: str) -> set[str]:
    return set("".join(c if c.isalnum() or c == "_" else " " for c in text).split())


def _product(rng: np.random.Generator) -> tuple[str, Curve]:
    """One, two or three factors, and sometimes a lag of the product."""
    factors = [_factor(rng) for _ in range(int(rng.choice(FACTORS[0], p=FACTORS[1])))]
    text = " × ".join(each for each, _ in factors)

    def curve(s: Signals) -> np.ndarray:
        value = factors[0][1](s)
        for _, factor in factors[1:]:
            value = value * factor(s)
        return value

    return (text, curve) if rng.uniform() > 0.15 else _lag(text, curve, rng)


def _factor(rng: np.random.Generator) -> tuple[str, Curve]:
    text, curve = _leaf(rng)
    if rng.uniform() < JOINED:
        other, second = _leaf(rng)
        joint = str(rng.choice(list(JOINS)))
        text, curve = joint.format(text, other), _joined(JOINS[joint], curve, second)
    if rng.uniform() < BENT:
        bend = str(rng.choice(list(BENDS)))
        text, curve = bend.format(text), _bent(BENDS[bend], curve)
    return (text, curve) if rng.uniform() > 0.15 else _lag(text, curve, rng)


def _leaf(rng: np.random.Generator) -> tuple[str, Curve]:
    weights = np.array(list(WEIGHTS.values()), dtype=float)
    name = str(rng.choice(list(WEIGHTS), p=weights / weights.sum()))
    return name, LEAVES[name]


def _lag(text: str, curve: Curve, rng: np.random.Generator) -> tuple[str, Curve]:
    tau_s = float(np.exp(rng.uniform(*np.log(LAGS_S))))
    return f"lag[{tau_s:.3g} s]({text})", lambda s: lagged(s.t, curve(s), tau_s)


def _bent(bend: Callable[[np.ndarray], np.ndarray], curve: Curve) -> Curve:
    return lambda s: bend(curve(s))


def _joined(join: Callable[[np.ndarray, np.ndarray], np.ndarray], first: Curve, second: Curve) -> Curve:
    return lambda s: join(first(s), second(s))


def _trial_movement() -> Signals:
    """A minute of smooth turns between stills, the same for all expressions, to test for nonlinearity only."""
    rng, t = np.random.default_rng(0), np.arange(0, 60, 0.02)
    bell = np.maximum(np.sin(2 * np.pi * t / 6), 0)[:, None] ** 2
    rate = bell * np.repeat(rng.normal(0, 130 * DEG, (10, 3)), len(t) // 10, axis=0)
    up = np.repeat(rng.normal(size=(10, 3)), len(t) // 10, axis=0)
    force = G * up / np.linalg.norm(up, axis=1, keepdims=True)
    return Signals(t, t / 60, rate, force, -10 * np.expm1(-t / 40), 0.16 * (bell[:, 0] > 0.2) * (np.arange(len(t)) % 600 < 300))


# All laws by id.

#: physical laws written by hand
_BY_HAND = (
    *(magnetic_zero, magnetic_induction, switched_load, ratiometric_scale, sag_recovery, resonance, drive_droop),
    *(drive_recovery, dead_zone, root_scale, soft_limit, last_turn, turn_hysteresis, overload, gravity_creep),
    *(temperature_rate, package_strain, temperature_curve, warm_gravity, warm_square, rate_product, rate_squares, cross_cube),
    *(rectified_acceleration, anisoelastic, force_scale, vibration_scale, telegraph, quantised),
)
BY_HAND: dict[str, Maker] = {f"law.{law.__name__}": law for law in _BY_HAND}
LAWS: dict[str, Maker] = {**BY_HAND, "law.random": random_law}
