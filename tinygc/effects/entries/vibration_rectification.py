"""The gyro's zero-rate offset moves with vibration energy (vibration rectification error)."""

from session.base.units import DEG
from tinygc.effects import AHEAD, Effect, Parameter, axis_of, diagonal, largest
from tinygc.effects.effect import ENERGY_LAW

EFFECT = Effect(
    id="gyro.vibration_rectification",
    equation="ω += k v², v² the mean square of the vibration that the accelerometer passes, in g²",
    parameter=Parameter("dps_per_g2", (3,), "dps/g²", DEG, plausible=20 * DEG),
    observable_in=("turn",),
    columns=lambda movement: diagonal(movement.vibration_g2),
    describe=lambda theta: (
        f"vibration moves the gyro's zero by {abs(largest(theta)) / DEG:.2f} dps per g² on {axis_of(theta)}: "
        "damp the table, or mount the sensor softly (g² as the accelerometer passes it; the element feels more)"
    ),
    discriminating_motion="repeat the same turns with and without the vibration",
    inputs=("vibration",),
    conditions=("vibration", "g²"),
    picture=ENERGY_LAW,
    device=AHEAD,
    # Uncertainty of the energy that the accelerometer passes: a hand's movement adds to it, and vibration attributed to the hand is
    # missing (benchmarks/vibration.py).  Energy above its low-pass is no error of this coefficient, which is per g² measured.
    known_to=0.1,
)
