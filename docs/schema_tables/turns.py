"""docs/formats/turns.md: what ``fit`` writes of a gyroscope alone."""

from __future__ import annotations

from .shapes import COUNT, FLAG, HASH, NUMBER, SHARE, SIZE, TEXT, VECTOR, array, maybe, words

AXIS, SENSE = words("x", "y", "z"), words("+", "-")
_COMPONENT = maybe({"median": maybe(SIZE), "low": maybe(SIZE), "high": maybe(SIZE), "upper": maybe(SIZE)})
_TERMS = {name: SIZE for name in ("rests", "drift", "white", "vibration", "ends", "rounding")}
_TURN = {
    "log": TEXT,
    "turn": COUNT,
    "axis": TEXT,
    "stated_deg": NUMBER,
    "stated_sigma_deg": SIZE,
    "measured_deg": maybe(NUMBER),
    "table_axis": maybe(VECTOR),
    "rate_dps": maybe(NUMBER),
    "duration_s": maybe(SIZE),
    "miss_deg": maybe(NUMBER),
    "miss_sigma_deg": maybe(SIZE),
    "lost_probability": maybe(SHARE),
    "lost_s": SIZE,
    "used": FLAG,
    "problem": maybe(TEXT),
    "gyro_sigma_deg": maybe(_TERMS),
}
TABLES = {
    "tinygc-turns/1": {
        "version": TEXT,
        "session": TEXT,
        "sha256": {"<file>": HASH},
        "scale": [
            {"axis": AXIS, "sense": SENSE, "error_ppm": NUMBER, "sigma_ppm": SIZE, "own_axis_within_ppm": SIZE, "turns": COUNT},
        ],
        "scale_covariance_ppm2": array(NUMBER, None, None),
        "asymmetry": [{"axis": AXIS, "value_ppm": NUMBER, "sigma_ppm": SIZE}],
        "bias": {"mean_dps": VECTOR, "sigma_dps": VECTOR, "wander_dps": VECTOR, "rests": COUNT},
        "play_deg": _COMPONENT,
        "repeat_ppm": _COMPONENT,
        "chi_square": {"value": SIZE, "dof": COUNT, "p": maybe(SHARE)},
        "repeats": [
            {
                "axis": AXIS,
                "sense": SENSE,
                "stated_deg": NUMBER,
                "rate_dps": NUMBER,
                "turns": COUNT,
                "mean_deg": NUMBER,
                "std_deg": SIZE,
            }
        ],
        "turns": [_TURN],
        "remarks": [TEXT],
    }
}
