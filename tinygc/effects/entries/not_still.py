"""The sensor turned slowly while it was meant to be still."""

from tinygc.effects import Effect, Occurrence, Parameter, nothing
from tinygc.effects.effect import CREEPING_STILLS, IN_STILLS

EFFECT = Effect(
    id="reference.not_still",
    equation="in some stills the body turns",
    parameter=Parameter("stills", (), ""),
    observable_in=("still", "reference"),
    kind="register",
    columns=nothing(1),
    describe=lambda theta: f"{theta[0]:.0f} stills were not still: lock the table before each still; they are passed over here",
    discriminating_motion="lock the table, and record again",
    conditions=("time", "s"),
    occurs=Occurrence("stills", IN_STILLS),
    picture=CREEPING_STILLS,
)
