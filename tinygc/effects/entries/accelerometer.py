"""The accelerometer's pre-calibration is no longer valid.  This changes the reference, not the rate.

Usually the bias has changed; scale and nonorthogonality may have, too: model selection compares three parameters and nine.
"""

from dataclasses import replace

import numpy as np

from session.base.numeric import UPPER
from session.base.rotation import identities
from session.base.units import MG, G
from tinygc.effects import Effect, Movement, Parameter, Parts, axis_of, largest, nothing
from tinygc.effects.effect import GRAVITY_LENGTH

#: indices in the upper triangle row by row, after the bias
SCALES, SHEARS = (3, 6, 8), (4, 5, 7)
#: projection without the common scale of all axes, which is gravity's length and not known as accurately
OBSERVED = np.eye(9)
OBSERVED[np.ix_(SCALES, SCALES)] -= 1 / 3


def _nine(movement: Movement) -> np.ndarray:
    """A bias, and an upper triangle: length determines the sensor's axes up to a rotation, which the body frame absorbs."""
    columns = np.zeros((len(movement.force_g), 3, 9))
    columns[:, :, :3] = np.eye(3)
    rows, of = UPPER
    columns[:, rows, np.arange(3, 9)] = movement.force_g[:, of]
    return columns @ OBSERVED


def _description(theta: np.ndarray) -> str:
    found = [f"by {abs(largest(theta[:3])) / MG:.1f} mg on {axis_of(theta[:3])}"]
    if len(theta) > 3:
        scale, shear = (np.abs((OBSERVED @ theta)[list(which)]).max() / G for which in (SCALES, SHEARS))
        found += [f"by {scale * 1e6:.0f} ppm of scale", f"by {shear * 1e3:.1f} mrad of nonorthogonality"]
    where = " and ".join([", ".join(found[:-1]), found[-1]] if len(found) > 1 else found)
    return f"the accelerometer is off {where}: calibrate the accelerometer again first"


_BIAS = Effect(
    id="reference.accelerometer",
    equation="f = f measured - b: the reference's attitudes and the length of gravity move with attitude",
    parameter=Parameter("bias_mg", (3,), "mg", MG, plausible=100 * MG),
    observable_in=("reference",),
    kind="force",
    columns=nothing(3),
    bends=lambda movement: identities(len(movement.force_g)),
    describe=_description,
    discriminating_motion="hold each axis of the accelerometer up and down: gravity's length must not change",
    conditions=("attitude", "g"),
    picture=GRAVITY_LENGTH,
)
EFFECT = replace(
    _BIAS,
    wider=replace(
        _BIAS,
        equation="f = f measured - b - S f measured, S upper triangular, of trace 0: bias, scale against the axes' mean, nonorthogonality",
        parameter=Parameter("errors_mg", (9,), "mg", MG, plausible=100 * MG),
        derived=Parts((("bias_mg", MG, (0, 1, 2)), ("scale_ppm", 1e-6 * G, SCALES), ("nonorthogonality_mrad", 1e-3 * G, SHEARS)), OBSERVED),
        columns=nothing(9),
        bends=_nine,
    ),
)
