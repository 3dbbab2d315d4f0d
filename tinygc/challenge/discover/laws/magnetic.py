"""The Earth's field, fixed in the world, reaches a zero: drive coils, pick-off loops, steel in the package."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from tinygc.challenge.concealment import Concealment, Maker, Scene
from tinygc.challenge.discover.laws.attitude import seen_by_body
from tinygc.challenge.discover.laws.shapes import adding

# Strong sizes, SI
#: rad/s per field, rms of the nine: a ring that is driven and read by a magnet's field feels any other field, too
ZERO = 0.08 * DEG
#: share of the field's turn that comes out as rate, rms of the nine: a pick-off loop in a field that turns against it
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


MAGNETIC: dict[str, Maker] = {"law.magnetic_zero": magnetic_zero, "law.magnetic_induction": magnetic_induction}
