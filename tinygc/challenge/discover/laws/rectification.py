"""Products: of rates about several axes, of forces, of rate and force, of rate and vibration."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG, G
from tinygc.challenge.concealment import Concealment, Maker, Scene
from tinygc.challenge.discover.laws.shapes import adding, energy, next_axis, previous_axis, size_of, slope
from tinygc.challenge.rate_effects import shaking

# Strong sizes, SI
#: of full scale, where both rates are at full scale: unequal inertias of the element, as anisoinertia of a spinning gyro (IEEE 1431)
RATE_PRODUCT = 0.02
RATE_SQUARES = 0.012  #: the same, of the squares about the two other axes: centrifugal softening of the sense mode
CROSS_CUBE = 0.05  #: the same, of the next axis' rate cubed
RECTIFIED_S = 1e-3  #: s: the size of the angular acceleration leaks through an unsymmetric demodulator
ANISOELASTIC = 0.25 * DEG  #: rad/s per g²: unequal springs of a large element
FORCE_SCALE = 0.006  #: of the sensitivity, per g: a pendulous mass detunes the modes
VIBRATION_SCALE = 0.04  #: of the sensitivity, per g² of vibration


def rate_product(scene: Scene) -> Concealment:
    """Two axes that turn together make the third read."""
    size, full_scale = scene.signed(RATE_PRODUCT), scene.options.gyro_fs_dps * DEG
    return adding(
        "law.rate_product",
        {"at_fs": size.tolist()},
        lambda t, rate, force, temp: size * next_axis(rate) * previous_axis(rate) / full_scale,
    )


def rate_squares(scene: Scene) -> Concealment:
    """The squares of the rates about the two other axes, together, make an axis read."""
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
    """The zero follows the size of the angular acceleration, whatever its sense."""
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


RECTIFICATION: dict[str, Maker] = {
    "law.rate_product": rate_product,
    "law.rate_squares": rate_squares,
    "law.cross_cube": cross_cube,
    "law.rectified_acceleration": rectified_acceleration,
    "law.anisoelastic": anisoelastic,
    "law.force_scale": force_scale,
    "law.vibration_scale": vibration_scale,
}
