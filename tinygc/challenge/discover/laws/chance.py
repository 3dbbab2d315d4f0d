"""What is no smooth law of anything: two-level noise, and an output in coarse steps."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from tinygc.challenge.concealment import Concealment, Maker, Scene
from tinygc.challenge.discover.laws.shapes import adding

# Strong sizes, SI
#: rad/s between its levels, and mean stay in each: one trap in an oxide, Kirton & Uren 1989
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
    """The element's output comes in coarse steps."""
    step = np.abs(scene.signed(STEP))
    return adding("law.quantised", {"rps": step.tolist()}, lambda t, rate, force, temp: step * np.rint(rate / step) - rate)


CHANCE: dict[str, Maker] = {"law.telegraph": telegraph, "law.quantised": quantised}
