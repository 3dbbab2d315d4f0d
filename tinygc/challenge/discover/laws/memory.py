"""The zero remembers: the last turn, an overload, how it lay."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG, G
from tinygc.challenge.concealment import Concealment, Maker, Scene
from tinygc.challenge.discover.laws.shapes import adding, lagged, size_of

# Strong sizes, SI
#: rad/s per rad turned a moment ago: charges on the electrodes and glue under shear drift back within seconds
REMNANT, FORGETS_S = 0.08 * DEG, (5.0, 20.0)
#: rad/s to either side, and the rate that turns it over: friction between the die and its glue
HYSTERESIS, TURNS_OVER = 0.12 * DEG, (15 * DEG, 40 * DEG)
#: rad/s, after |omega| went beyond; the loops wind up and need seconds
OVERLOAD, BEYOND, UNWINDS_S = 0.6 * DEG, (90 * DEG, 150 * DEG), (1.0, 4.0)
#: rad/s per g, rms of the nine: a die on viscoelastic glue leans for tens of seconds
CREEP, LEANS_S = 0.15 * DEG, (5.0, 25.0)


def last_turn(scene: Scene) -> Concealment:
    """The zero keeps a remnant m of what was turned, m' = omega - m / tau; the body rests at first."""
    size, tau_s = scene.signed(REMNANT), scene.rng.uniform(*FORGETS_S)
    return adding(
        "law.last_turn",
        {"rps_per_rad": size.tolist(), "tau_s": tau_s},
        lambda t, rate, force, temp: size * tau_s * lagged(t, rate, tau_s),
    )


def turn_hysteresis(scene: Scene) -> Concealment:
    """The zero lies to the side of the last turn that was faster than a threshold; in the middle before the first."""
    size, threshold = scene.signed(HYSTERESIS), scene.rng.uniform(*TURNS_OVER)

    def added(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        return size * last_sign(rate, threshold)

    return adding("law.turn_hysteresis", {"rps": size.tolist(), "threshold_rps": threshold}, added)


def last_sign(values: np.ndarray, threshold: float) -> np.ndarray:
    """Of each column of values (N, K): the sign when it was last beyond the threshold, 0 before."""
    beyond = np.abs(values) > threshold
    rows = np.maximum.accumulate(np.where(beyond, np.arange(len(values))[:, None], -1), axis=0)
    return np.where(rows >= 0, np.take_along_axis(np.sign(values), np.maximum(rows, 0), axis=0), 0.0)


def overload(scene: Scene) -> Concealment:
    """While |omega| is beyond a limit, and some seconds more, the zero is displaced."""
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


MEMORY: dict[str, Maker] = {
    "law.last_turn": last_turn,
    "law.turn_hysteresis": turn_hysteresis,
    "law.overload": overload,
    "law.gravity_creep": gravity_creep,
}
