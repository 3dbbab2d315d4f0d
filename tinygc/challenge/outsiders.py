"""Effects that ``explain`` has no file for: they must not be given the name of one that it has.

Each is physics that has been seen in some sensor; the truth of one holds what it takes to make it again, SI.
"""

from __future__ import annotations

import numpy as np

from session.common.units import DEG, G
from tinygc.challenge.concealment import Concealment, Maker, Scene

# Strong sizes, SI
OSCILLATION, PERIOD_S = 0.1 * DEG, (20.0, 60.0)
TELEGRAPH = 0.15 * DEG
RATE_PRODUCT = 0.02  #: of full scale, where both rates are at full scale
DEAD_ZONE = 0.3 * DEG
TEMPERATURE_CURVE = 0.01 * DEG  #: rad/s per degC^2 around the middle of a warm-up of 10 degC
FORCE_PRODUCT = 0.1 * DEG  #: rad/s per g^2
ROOT_SCALE = 0.01  #: fraction of the sensitivity, at full scale


def oscillation(scene: Scene) -> Concealment:
    """The zero swings to and fro, as a poor supply or a heater's regulator makes it."""
    size, period_s, phase = scene.signed(OSCILLATION), scene.rng.uniform(*PERIOD_S), scene.rng.uniform(0, 2 * np.pi, 3)
    return Concealment(
        "outside.oscillation",
        {"rps": size.tolist(), "period_s": period_s},
        distort=lambda t, rate, force, temp: rate + size * np.sin(2 * np.pi * t[:, None] / period_s + phase),
    )


def telegraph(scene: Scene) -> Concealment:
    """The zero jumps away and back, twice."""
    size = scene.signed(TELEGRAPH)
    at_s = scene.plan.log_s * (np.array([0.15, 0.35, 0.55, 0.75]) + scene.rng.uniform(0, 0.15, 4))
    return Concealment(
        "outside.telegraph",
        {"rps": size.tolist(), "at_s": at_s.tolist()},
        distort=lambda t, rate, force, temp: rate + (np.searchsorted(at_s, t) % 2)[:, None] * size,
    )


def rate_product(scene: Scene) -> Concealment:
    """Two axes that turn together make the third read."""
    size, full_scale = scene.signed(RATE_PRODUCT), scene.options.gyro_fs_dps * DEG
    return Concealment(
        "outside.rate_product",
        {"of_full_scale": size.tolist()},
        distort=lambda t, rate, force, temp: rate + size * np.roll(rate, -1, axis=1) * np.roll(rate, -2, axis=1) / full_scale,
    )


def dead_zone(scene: Scene) -> Concealment:
    """Around zero rate the output does not move."""
    width = np.abs(scene.signed(DEAD_ZONE))
    return Concealment(
        "outside.dead_zone",
        {"rps": width.tolist()},
        distort=lambda t, rate, force, temp: np.sign(rate) * np.maximum(np.abs(rate) - width, 0),
    )


def temperature_curve(scene: Scene) -> Concealment:
    """The zero has a turning point in the middle of the session's temperatures."""
    size, middle_c = scene.signed(TEMPERATURE_CURVE), scene.options.temperature_start_c + scene.options.warm_up_c / 2
    return Concealment(
        "outside.temperature_curve",
        {"rps_per_c2": size.tolist(), "middle_c": middle_c},
        distort=lambda t, rate, force, temp: rate + np.outer((temp - middle_c) ** 2, size),
    )


def force_product(scene: Scene) -> Concealment:
    """The zero follows the product of the two other axes' forces."""
    size = scene.signed(FORCE_PRODUCT)
    return Concealment(
        "outside.force_product",
        {"rps_per_g2": size.tolist()},
        distort=lambda t, rate, force, temp: rate + size * np.roll(force, -1, axis=1) * np.roll(force, -2, axis=1) / G**2,
    )


def root_scale(scene: Scene) -> Concealment:
    """The sensitivity moves with the square root of the rate."""
    size, full_scale = scene.signed(ROOT_SCALE), scene.options.gyro_fs_dps * DEG
    return Concealment(
        "outside.root_scale",
        {"of_sensitivity": size.tolist()},
        distort=lambda t, rate, force, temp: rate * (1 + size * np.sqrt(np.abs(rate) / full_scale)),
    )


OUTSIDERS: dict[str, Maker] = {
    "outside.oscillation": oscillation,
    "outside.telegraph": telegraph,
    "outside.rate_product": rate_product,
    "outside.dead_zone": dead_zone,
    "outside.temperature_curve": temperature_curve,
    "outside.force_product": force_product,
    "outside.root_scale": root_scale,
}
