"""``fit.json`` and ``rebiased.json`` as ``export`` and ``compare`` read them again; what nobody reads is not looked at."""

from __future__ import annotations

from pathlib import Path

from session.common.errors import FormatError
from session.files.shapes import Array, Keys, ListOf, MapOf, Maybe, Number, Shape, Text, read_required, require
from tinygc.fitting.fit_json import SCHEMA
from tinygc.methods.registry import METHODS

#: dps and g per root Hz: a thousandth of what any sensor's range is
_DENSITY = Array((3,), Number(0, 1e3))
_TILT_DEG = Maybe(Number(0, 1e4))
_NOISE: dict[str, Shape] = {
    "gyro_dps_rthz": _DENSITY,
    "accel_g_rthz": _DENSITY,
    "gyro_bias_instability_dph": Maybe(Number(0, 1e9)),
    "gyro_bias_instability_source": Maybe(Text()),
    "closure_floor_rms_deg": _TILT_DEG,
}
SHAPE = Keys(
    {"schema": Text((SCHEMA,))},
    {
        "session": Text(),
        "segments": Keys(may={"used": Number(0, whole=True)}),
        "noise": Keys(may=_NOISE),
        "accelerometer": Maybe(Keys(may={"mode": Text(("given", "fit", "prior")), "unobserved": Maybe(ListOf(Text()))})),
        "goodness": Maybe(Keys({"p_value": Number(0, 1)})),
        "methods": MapOf(Keys(may={"holdout": Keys(may={"tilt_rms_deg": _TILT_DEG})})),
        "against_raw": Maybe(Keys(may={"tilt_rms_deg": _TILT_DEG})),
        "use": Maybe(Keys(may={"method": Maybe(Text())})),
    },
)

#: what a model may only leave the tool with: whether it was judged, by how many turns, and how noisy its sensor is
_JUDGED: dict[str, Shape] = {
    "session": Text(),
    "segments": Keys({"used": Number(0, whole=True)}),
    "noise": Keys({"gyro_dps_rthz": _DENSITY, "accel_g_rthz": _DENSITY}),
    "methods": MapOf(Keys({"holdout": Keys({"tilt_rms_deg": _TILT_DEG})})),
}
#: ``rebiased.json`` has the stored calibration among its methods, and no raw rates
JUDGED, REBIASED = Keys(_JUDGED | {"against_raw": Keys({"tilt_rms_deg": _TILT_DEG})}), Keys(_JUDGED)


def read_judged(path: Path, do: str, method: str, *, rebiased: bool = False) -> dict:
    """The figures of a fit whose model of that method is exported: all that says whether it may be.  A method that ``fit`` has not, of
    another program's model, need not be there.  FormatError as ``read_fit``."""
    fit = read_fit(path, do)
    require(fit, REBIASED if rebiased else JUDGED, str(path), do)
    if not rebiased and method in METHODS and method not in fit["methods"]:
        raise FormatError(f"{path}: methods.{method} is missing, expected how well that model closes held-out turns; {do}")
    return fit


def read_fit(path: Path, do: str = "fit again") -> dict:
    """The figures of a fit.  FormatError: which key is what, what was expected there, and ``do``."""
    return read_required(path, SHAPE, do)
