"""The gyro's zero-rate offset moves with vibration energy (vibration rectification error)."""

from session.common.units import DEG
from tinygc.effects import AHEAD, Effect, Parameter, axis_of, diagonal, largest
from tinygc.effects.picture import ENERGY_LAW

EFFECT = Effect(
    id="gyro.vibration_rectification",
    equation="ω += k v², v² the mean square of the specific force's vibration in g²",
    parameter=Parameter("dps_per_g2", (3,), "dps/g²", DEG, plausible=20 * DEG),
    seen_in=("turn",),
    columns=lambda movement: diagonal(movement.vibration_g2),
    says=lambda theta: (
        f"vibration moves the gyro's zero-rate offset by {abs(largest(theta)) / DEG:.2f} dps per g² on {axis_of(theta)}: "
        "damp the table, or mount the sensor softly"
    ),
    splits="repeat the same turns with and without the vibration",
    inputs=("vibration",),
    regime=("vibration", "g²"),
    picture=ENERGY_LAW,
    device=AHEAD,
    known_to=0.1,  # the accelerometer's low-pass hides a part of the energy that is not known, and a hand's own movement adds one
)
