"""The gyro's zero-rate offset moves with specific force (IEEE 528: acceleration-sensitive drift rate)."""

from session.base.units import DEG, G
from tinygc.effects import Effect, MatrixC, Parameter, axis_of, full, largest

EFFECT = Effect(
    id="gyro.g_sensitivity",
    equation="ω += K f, f the specific force in g",
    parameter=Parameter("matrix_dps_per_g", (3, 3), "dps/g", DEG, plausible=1 * DEG),
    observable_in=("still", "turn"),
    columns=lambda movement: full(movement.force_g),
    basis=lambda movement: movement.force_g,
    describe=lambda theta: (
        f"the gyro's zero-rate offset "
        f"moves {abs(largest(theta)) / DEG:.3f} dps per g (most on {axis_of(theta)}): keep gravity's direction in the model"
    ),
    discriminating_motion="hold stills in at least six attitudes, each axis up and down",
    inputs=("force",),
    conditions=("attitude", "g"),
    device=MatrixC("G_SENSITIVITY", "r -= K f (gyro.g_sensitivity)", lambda theta, known: theta.reshape(3, 3) / G),
    linear_in="force",
)
