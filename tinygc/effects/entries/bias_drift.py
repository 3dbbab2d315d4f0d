"""The gyro's zero-rate offset wanders with time; to first order, steadily over the session."""

from session.base.units import DEG
from tinygc.effects import BYGONE, Effect, Parameter, axis_of, diagonal, largest

EFFECT = Effect(
    id="gyro.bias_drift",
    equation="ω += d t / (length of the session)",
    parameter=Parameter("dps_over_log", (3,), "dps", DEG, plausible=5 * DEG),
    observable_in=("still", "turn"),
    columns=lambda movement: diagonal(movement.t_s / movement.duration_s),
    describe=lambda theta: (
        f"the gyro's zero drifts by {abs(largest(theta)) / DEG:.3f} dps on {axis_of(theta)} over the session: "
        "take the bias afresh before each use"
    ),
    discriminating_motion="let temperature rise and fall within one session: drift goes on, temperature's part comes back",
    inputs=("time",),
    conditions=("time", "s"),
    device=BYGONE,
)
