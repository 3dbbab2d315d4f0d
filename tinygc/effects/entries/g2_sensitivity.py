"""The gyro's zero-rate offset moves with the square of the specific force along each axis (vibration and gravity alike)."""

from session.base.units import DEG, G
from tinygc.effects import Effect, Parameter, PerAxisC, axis_of, diagonal, largest

EFFECT = Effect(
    id="gyro.g2_sensitivity",
    equation="ω_i += k_i f_i², f in g",
    parameter=Parameter("dps_per_g2", (3,), "dps/g²", DEG, plausible=1 * DEG),
    observable_in=("still", "turn"),
    columns=lambda movement: diagonal(movement.force_g**2),
    describe=lambda theta: (
        f"the gyro's zero-rate offset "
        f"moves {abs(largest(theta)) / DEG:.3f} dps per g² on {axis_of(theta)}: "
        "keep the square of the specific force in the model"
    ),
    discriminating_motion="hold each axis up, down and level: g² agrees up and down, g changes sign",
    inputs=("force",),
    conditions=("attitude", "g"),
    device=PerAxisC(
        name="G2_SENSITIVITY",
        formula="r -= k f^2 (gyro.g2_sensitivity)",
        constants=lambda theta, known: {"G2_SENSITIVITY": theta / G**2},
        numpy=lambda c, w, inputs: c["G2_SENSITIVITY"] * (inputs.force * inputs.force),
        passes=1,
    ),
)
