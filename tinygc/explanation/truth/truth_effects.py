"""What can be wrong with a truth file; beside the catalogue, which is of sensors on a table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.common.units import DEG
from tinygc.effects import Effect, Movement, Parameter, catalogue, largest


def _nothing(movement: Movement) -> np.ndarray:
    """These bend the reference, not the rate."""
    return np.zeros((*movement.rate.shape, 1))


OFFSET = Effect(
    id="timing.truth_offset",
    equation="the truth's attitude at t is the one that the gyro's clock has at t + seconds",
    parameter=Parameter("seconds", (), "s", plausible=0.1),
    seen_in=("timing",),
    kind="truth",
    columns=_nothing,
    says=lambda theta: (
        f"the truth's stamps are {1e3 * abs(theta[0]):.2f} ms {'early' if theta[0] > 0 else 'late'} beside the gyro's: shift one of them "
        f"(truth.offset_s = {theta[0]:.6f}); a delay that all axes of the gyro share looks the same"
    ),
    splits="turn fast and stop: the truth must stop with the gyro",
)
FRAME = Effect(
    id="reference.truth_frame",
    equation="the truth's body frame is the sensor's, turned by a constant rotation",
    parameter=Parameter("rotation_deg", (3,), "deg", DEG, plausible=10 * DEG),
    seen_in=("reference",),
    kind="truth",
    columns=_nothing,
    says=lambda theta: (
        f"the truth's body frame is turned by {np.linalg.norm(theta) / DEG:.1f} deg against the sensor's, "
        f"most about {'xyz'[int(np.argmax(np.abs(theta)))]} ({largest(theta) / DEG:+.1f} deg): "
        "gyro and accelerometer ask for the same rotation"
    ),
    splits="mount the sensor in the truth's body another way: a frame's error goes with the body, a gyro's misalignment with the gyro",
)


MOUNTED = replace(
    FRAME,
    says=lambda theta: (
        f"the truth's body is turned by {np.linalg.norm(theta) / DEG:.1f} deg against the sensor's axes, more than a gyro's misalignment: "
        "it is taken off, and what is common to the gyro's axes of misalignment with it"
    ),
)


def common_delays() -> tuple[str, ...]:
    """Ids of effects that can delay all axes alike: what they share cannot be told from a clock that nobody has given."""
    return tuple(name for name, effect in catalogue().items() if effect.gauge is not None and effect.gauge.delays)


def wander(knots_s: np.ndarray) -> Effect:
    """A bias that wanders slowly: straight between knots, three numbers each beyond the first."""

    def columns(movement: Movement) -> np.ndarray:
        hats = [np.interp(movement.t_s, knots_s, hat) for hat in np.eye(len(knots_s))[1:]]
        return np.concatenate([hat[:, None, None] * np.eye(3) for hat in hats], axis=2)

    def says(theta: np.ndarray) -> str:
        at = np.concatenate([np.zeros((1, 3)), theta.reshape(-1, 3)])
        span = np.ptp(at, axis=0)
        return (
            f"the gyro's zero-rate offset wanders by {span.max() / DEG:.3f} dps (most on {'xyz'[int(np.argmax(span))]}) while the run lasts"
        )

    return Effect(
        id="unknown.slow_bias",
        equation="ω += b(t), slow; straight between knots",
        parameter=Parameter("dps_at_knots", (len(knots_s) - 1, 3), "dps", DEG, plausible=DEG),
        seen_in=("turn",),
        columns=columns,
        says=says,
        inputs=("time",),
        splits="record temperature, and the supply; repeat after a long warm-up",
        shape={"knots_s": [round(float(knot), 1) for knot in knots_s]},
    )


def wrong_moments(count: int) -> Effect:
    """So many wrong moments; the parameter is when, s of the session."""
    return Effect(
        id="reference.truth_jump",
        equation="single attitudes of the truth are wrong: the segment before misses by what the segment after makes good",
        parameter=Parameter("at_s", (count,), "s"),
        seen_in=("reference",),
        kind="register",
        columns=_nothing,
        says=lambda theta: f"{len(theta)} moments of truth are wrong by more than chance allows: leave them out",
        splits="look at the truth's own residuals there",
    )
