"""After a shock the zero is off, and comes back: the moment is searched for, and told in minutes."""

from dataclasses import replace

import numpy as np

from session.base.units import DEG
from tinygc.effects import BYGONE, Effect, Movement, Parameter, Scan, axis_of, largest, per_axis

RECOVERS_S = 25.0
MINUTE_S = 60.0


def _grid(movements) -> np.ndarray:
    """Every two seconds of the session."""
    return np.arange(2.0, movements[0].duration_s - 2.0, 2.0)


def _at(shock_s: float) -> Effect:
    def basis(movement: Movement) -> np.ndarray:
        since = movement.t_s - shock_s
        return np.where(since >= 0, np.exp(-np.maximum(since, 0) / RECOVERS_S), 0.0)[:, None]

    def describe(theta: np.ndarray) -> str:
        return (
            f"a shock at {shock_s / MINUTE_S:.2f} min moves the zero of {axis_of(theta)} by {abs(largest(theta)) / DEG:.3f} dps for a while"
        )

    return replace(EFFECT, columns=per_axis(basis), basis=basis, describe=describe)


EFFECT = Effect(
    id="gyro.shock_recovery",
    equation="ω += b exp(−(t − t₀) / 25 s) from the shock t₀ on",
    parameter=Parameter("dps", (3,), "dps", DEG, plausible=5 * DEG),
    observable_in=("still", "turn"),
    columns=lambda movement: _at(movement.duration_s / 2).columns(movement),
    describe=lambda theta: "a shock moves the zero for a while, 1 time",
    discriminating_motion="leave the table still for a minute",
    inputs=("time",),
    conditions=("time", "s"),
    scan=Scan("shock_min", "min", make=_at, si=MINUTE_S, grid=_grid),
    device=BYGONE,
)
