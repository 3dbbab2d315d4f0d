"""The axes are sampled at different instants: axis i shows the rate of ``seconds_i`` ago."""

from dataclasses import replace

import numpy as np

from tinygc.effects import AHEAD, Convention, Effect, Movement, Parameter, Reach, axis_of, diagonal, largest
from tinygc.effects.effect import LAG_LAW

#: the influence of a sample on a cubic spline decays by a factor of 3.7 with each one between
SPLINE_SAMPLES = 48


def _shifted(rate: np.ndarray, movement: Movement, seconds: np.ndarray) -> np.ndarray:
    """Each axis read ``seconds`` later, by a cubic spline; the ends hold their value."""
    from scipy.interpolate import CubicSpline  # late: most commands ask the catalogue for columns alone

    t = movement.t_s
    columns = [CubicSpline(t, rate[:, axis])(np.clip(t + shift, t[0], t[-1])) for axis, shift in enumerate(seconds)]
    return np.stack(columns, axis=-1)


_BODY = Effect(
    id="timing.axis_skew",
    equation="ω_i(t) is read at t + s_i",
    parameter=Parameter("seconds", (3,), "s", plausible=0.05),
    observable_in=("turn",),
    columns=lambda movement: diagonal(-movement.acceleration),
    exact_correct=lambda measured, movement, theta: _shifted(measured, movement, theta),
    exact_distort=lambda movement, theta: _shifted(movement.rate, movement, -theta),
    describe=lambda theta: (
        f"the axes are sampled apart, {axis_of(theta)} {1e3 * abs(largest(theta)):.1f} ms after the first: "
        "read all axes in one burst, or shift them back"
    ),
    discriminating_motion=(
        "shake the table about each axis at several speeds: a delay keeps the shape of fast movements, a lag rounds it off"
    ),
    reach=lambda theta: Reach.around(samples=SPLINE_SAMPLES, seconds=float(np.abs(theta).max())),
    conditions=("angular acceleration", "rad/s²"),
    picture=LAG_LAW,
    gauge_convention=Convention(
        settle=lambda theta: theta - theta.min(),  # counted from the earliest axis
        slope=lambda theta: np.eye(3) - np.eye(3)[int(np.argmin(theta))],
        delays=(0, 1, 2),
    ),
    device=AHEAD,
)
# Whether the elements or their readings are late is not known beforehand: with a misalignment of 5 %, it is a twentieth of the effect.
EFFECT = replace(_BODY, of_readings=_BODY.moved_to_readings("reading i of t is taken at t + s_i"))
