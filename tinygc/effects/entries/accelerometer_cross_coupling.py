"""One axis of the accelerometer reads the product of its force and another axis's (IEEE 1293: cross-coupling coefficients Kip, Kio)."""

import numpy as np

from session.base.units import MG
from tinygc.effects import Effect, Movement, Parameter, axis_of, before, behind, largest, nothing, rows
from tinygc.effects.device import OF_FORCE
from tinygc.effects.effect import GRAVITY_LAW


def _bends(movement: Movement) -> np.ndarray:
    force = movement.force_g
    return rows(np.stack([force * behind(force), force * before(force)], axis=-1))


EFFECT = Effect(
    id="accelerometer.cross_coupling",
    equation="f_i += f_i (p_i f_j + q_i f_k), j and k the next and the previous axis",
    parameter=Parameter("mg_per_g2", (3, 2), "mg/g²", MG, plausible=20 * MG),
    observable_in=("reference",),
    kind="force",
    columns=nothing(6),
    bends=_bends,
    describe=lambda theta: (
        f"the accelerometer's {axis_of(theta)} axis reads {abs(largest(theta)) / MG:.2f} mg per g² across axes: "
        "correct the product of two axes, or trust its tilt to that size"
    ),
    discriminating_motion="rest it on edges, between two axes, both ways up: the product is greatest there and zero on each face",
    conditions=("attitude", "g"),
    picture=GRAVITY_LAW,
    device=OF_FORCE,
)
