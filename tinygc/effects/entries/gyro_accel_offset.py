"""Gyroscope and accelerometer clocks differ.  Closure does not see it; gravity during the turns does."""

from tinygc.effects import Effect, Parameter, nothing
from tinygc.effects.effect import CLOCKS

EFFECT = Effect(
    id="timing.gyro_accel_offset",
    equation="the gyro shows what the accelerometer showed `seconds` before",
    parameter=Parameter("seconds", (), "s"),
    observable_in=("timing",),
    kind="register",
    columns=nothing(1),
    describe=lambda theta: (
        f"the gyro comes {1e3 * abs(theta[0]):.1f} ms {'after' if theta[0] > 0 else 'before'} the accelerometer: "
        "shift one against the other before fusing them; the closure does not mind"
    ),
    discriminating_motion="shake the table at several speeds: a delay keeps rate and centripetal force alike, a lag rounds the rate off",
    conditions=("rate", "dps"),  # gravity turns in the body as fast as the body turns
    picture=CLOCKS,
)
