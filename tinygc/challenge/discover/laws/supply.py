"""The supply sags, and what it feeds follows: a load by a clock, a regulator after switch-on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from session.common.units import DEG
from tinygc.challenge.concealment import Concealment, Maker, Scene
from tinygc.challenge.discover.laws.shapes import adding

# Strong sizes, SI
#: rad/s: a zero that follows the supply by 1 dps per V, and a radio or a heater that pulls 0.2 V on a thin cable
SAG = 0.2 * DEG
PERIOD_S, DUTY = (8.0, 30.0), (0.25, 0.6)
RECOVERY, RECOVERY_S = 0.5 * DEG, (15.0, 60.0)  #: rad/s at switch-on, and its time constant
RATIOMETRIC = 0.01  #: of the sensitivity: 30 mV of 3 V


def switched_load(scene: Scene) -> Concealment:
    """A load is on for a share of each period: the zero jumps to and fro."""
    size, (on, told) = scene.signed(SAG), _clock(scene)
    return adding("law.switched_load", {"rps": size.tolist()} | told, lambda t, rate, force, temp: np.outer(on(t), size))


def ratiometric_scale(scene: Scene) -> Concealment:
    """The same load, and it is the sensitivity that follows the supply."""
    size, (on, told) = scene.signed(RATIOMETRIC), _clock(scene)
    return adding("law.ratiometric_scale", {"share": size.tolist()} | told, lambda t, rate, force, temp: on(t)[:, None] * size * rate)


def sag_recovery(scene: Scene) -> Concealment:
    """The zero is off after switch-on and recovers exponentially."""
    size, tau_s = scene.signed(RECOVERY), scene.rng.uniform(*RECOVERY_S)
    return adding(
        "law.sag_recovery",
        {"rps": size.tolist(), "tau_s": tau_s},
        lambda t, rate, force, temp: np.outer(np.exp(-np.maximum(t, 0) / tau_s), size),
    )


def _clock(scene: Scene) -> tuple[Callable[[np.ndarray], np.ndarray], dict]:
    """Whether the load is on at times t (N,) s, and its parameters."""
    period_s, duty, phase = scene.rng.uniform(*PERIOD_S), scene.rng.uniform(*DUTY), scene.rng.uniform()
    return lambda t: ((t / period_s + phase) % 1 < duty).astype(float), {"period_s": period_s, "duty": duty, "phase": phase}


SUPPLY: dict[str, Maker] = {
    "law.switched_load": switched_load,
    "law.ratiometric_scale": ratiometric_scale,
    "law.sag_recovery": sag_recovery,
}
