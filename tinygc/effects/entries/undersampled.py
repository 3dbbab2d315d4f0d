"""Motion faster than half the data rate.  A sum of readings misses it, at random in each turn: no rate is added or can be corrected.

It is estimated from thinned readings: predicted_deg is the rms over the turns at the recording's own data rate; rates_hz and closure_deg
have one value for each thinned rate, and there is the exponent in the rate (``tinygc.effects.effect.DATA_RATE``).
"""

from session.base.texts import degrees
from session.base.units import DEG
from tinygc.effects import Effect, NoC, Parameter, nothing
from tinygc.effects.effect import DATA_RATE

EFFECT = Effect(
    id="motion.undersampled",
    equation="motion faster than half the data rate turns the body by what no sum of readings holds; from every k-th it grows as k^p",
    parameter=Parameter("predicted_deg", (), "deg", DEG, plausible=DEG),
    observable_in=("turn",),
    kind="motion",
    columns=nothing(1),
    describe=lambda theta: (
        f"motion faster than half the data rate: turns miss by {degrees(float(theta[0]))} rms that no model of the sensor gives back; "
        "record faster, or filter below half the data rate before sampling"
    ),
    discriminating_motion="record the same turns at twice the data rate: this error falls by 2^p",
    conditions=("angular acceleration", "rad/s²"),
    picture=DATA_RATE,
    device=NoC("what the readings miss is in none of them"),
)
