"""A slower first-order response than declared, per axis: y + τ dy/dt = x, inverted with central differences."""

import numpy as np

from tinygc.effects import AHEAD, NEIGHBOURS, CommonDelay, Effect, Movement, Parameter, axis_of, diagonal, largest
from tinygc.effects.effect import LAG_LAW


def _correct(measured: np.ndarray, movement: Movement, theta: np.ndarray) -> np.ndarray:
    return measured + np.gradient(measured, movement.dt_s, axis=0) * theta


def _distort(movement: Movement, theta: np.ndarray) -> np.ndarray:
    """First-order low-pass with a linear input between samples, begun at rest."""
    from scipy.signal import lfilter  # late: most commands ask the catalogue for columns alone

    output = np.empty_like(movement.rate)
    for axis, tau in enumerate(np.maximum(theta, 0)):
        x = movement.rate[:, axis]
        if tau < 1e-9:
            output[:, axis] = x
            continue
        ratio = movement.dt_s / tau
        decay = np.exp(-ratio)
        late = (1 - decay) / ratio
        output[:, axis] = lfilter([1 - late, late - decay], [1, -decay], x, zi=[x[0] * late])[0]
    return output


EFFECT = Effect(
    id="gyro.bandwidth",
    equation="τ_i dω_i/dt + ω_i = the true rate",
    parameter=Parameter("tau_s", (3,), "s", plausible=0.05),
    observable_in=("turn",),
    columns=lambda movement: diagonal(-movement.acceleration),
    # The axes' common lag appears in the closure by its square: from zero a search may go to negative lags and not return.
    begin=0.005,
    exact_correct=_correct,
    exact_distort=_distort,
    describe=lambda theta: (
        f"the {axis_of(theta)} axis answers {1e3 * abs(largest(theta)):.1f} ms late like a first-order filter: "
        "check the low-pass setting of each axis"
    ),
    discriminating_motion="shake the table about each axis at several speeds: a lag rounds off fast movements, a delay does not",
    # The correction reads both neighbours; the forward model has a memory, which is not corrected live.
    reach=NEIGHBOURS,
    conditions=("angular acceleration", "rad/s²"),
    picture=LAG_LAW,
    gauge_convention=CommonDelay((0, 1, 2), never_negative=True),
    device=AHEAD,
)
