"""The package warms up: strain, and what temperature does to other sensitivities."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG, G
from tinygc.challenge.concealment import Concealment, Maker, Scene
from tinygc.challenge.discover.laws.shapes import adding, lagged, slope

# Strong sizes, SI; a session warms up by 10 degC with a time constant of 150 s
#: rad/s per degC/s: a warm-up's zero is off by some 0.2 dps at first, as in data sheets' curves of the first minutes
TEMPERATURE_RATE = 4.0 * DEG
#: rad/s per degC of strain that the glue has not yet let go
STRAIN, LETS_GO_S = 0.15 * DEG, (15.0, 60.0)
CURVE = 0.01 * DEG  #: rad/s per degC², around the middle of the warm-up
WARM_GRAVITY = 0.02 * DEG  #: rad/s per g and degC
WARM_SQUARE = 0.5 * DEG  #: rad/s per degC, where the rate is at full scale


def temperature_rate(scene: Scene) -> Concealment:
    """The zero follows dT/dt.  While T is one exponential this is the catalogue's zero over T, which is as good a name."""
    size = scene.signed(TEMPERATURE_RATE)
    return adding(
        "law.temperature_rate", {"rps_per_cps": size.tolist()}, lambda t, rate, force, temp: np.outer(slope(t, np.asarray(temp)), size)
    )


def package_strain(scene: Scene) -> Concealment:
    """The zero follows a strain e that dT/dt feeds and the glue lets go: e' = dT/dt - e / tau."""
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
    """What the square of the rate adds grows with the temperature since the start."""
    size, start_c, full_scale = scene.signed(WARM_SQUARE), scene.options.temperature_start_c, scene.options.gyro_fs_dps * DEG
    return adding(
        "law.warm_square",
        {"rps_per_c_at_fs": size.tolist()},
        lambda t, rate, force, temp: size * (rate / full_scale) ** 2 * (temp - start_c)[:, None],
    )


PACKAGE: dict[str, Maker] = {
    "law.temperature_rate": temperature_rate,
    "law.package_strain": package_strain,
    "law.temperature_curve": temperature_curve,
    "law.warm_gravity": warm_gravity,
    "law.warm_square": warm_square,
}
