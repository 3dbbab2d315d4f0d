"""The gyro's zero-rate offset jumps once, at a time that is scanned for."""

from dataclasses import replace

import numpy as np

from session.base.units import DEG
from tinygc.effects import BYGONE, Effect, Movement, Parameter, Scan, axis_of, largest, per_axis


def _at(at_s: float) -> Effect:
    """The step at a given time of the session."""

    def basis(movement: Movement) -> np.ndarray:
        return (movement.t_s >= at_s)[:, None].astype(float)

    def describe(theta: np.ndarray) -> str:
        return (
            f"the gyro's zero-rate offset jumps by {abs(largest(theta)) / DEG:.3f} dps on {axis_of(theta)} at {at_s:.0f} s: "
            "look for a shock, a supply change or a change of mode then"
        )

    return replace(EFFECT, columns=per_axis(basis), basis=basis, describe=describe)


def _halfway(movement: Movement) -> np.ndarray:
    return (movement.t_s >= movement.duration_s / 2)[:, None].astype(float)


EFFECT = Effect(
    id="gyro.bias_step",
    equation="ω += b from the time of the step on",
    parameter=Parameter("dps", (3,), "dps", DEG, plausible=5 * DEG),
    observable_in=("still", "turn"),
    columns=per_axis(_halfway),
    basis=_halfway,
    describe=lambda theta: "the gyro's zero-rate offset jumps",
    discriminating_motion="leave the table still for a minute: a step shows as one edge",
    inputs=("time",),
    conditions=("time", "s"),
    scan=Scan("at_s", "s", make=_at),
    device=BYGONE,
)
