"""docs/formats/noise.md: what ``noise`` writes of a sensor at rest."""

from __future__ import annotations

from .shapes import COUNT, FLAG, NUMBER, SHARE, SIZE, TEXT, VECTOR, array, maybe, named, words

_TERM = {"value": SIZE, "sigma": maybe(SIZE), "unit": TEXT, "probability": SHARE, "at_most": maybe(SIZE)}
_AXIS = {
    "terms": {**dict.fromkeys("QN", _TERM), "G": _TERM | {"tau_s": maybe(SIZE), "tau_sigma_s": maybe(SIZE)}, **dict.fromkeys("BKR", _TERM)},
    "lines": [{"hz": SIZE, "rms": SIZE}],
    "p_value": maybe(SHARE),
    "excess": SIZE,
    "from_s": SIZE,
}
_SENSOR = named("noise_of_a_sensor", dict.fromkeys("xyz", _AXIS))
_ROWS = array(maybe(SIZE), None, 3)
_CURVE = {"tau_s": array(NUMBER, None), "deviation": _ROWS, "low": _ROWS, "high": _ROWS}
KIND, AXIS = words("gyro", "accel"), words("x", "y", "z")
TABLES = {
    "tinygc-noise/1": {
        "version?": TEXT,
        "sensor": TEXT,
        "serial": TEXT,
        "logs": [TEXT],
        "rate_hz": SIZE,
        "rate_known?": FLAG,
        "duration_s": SIZE,
        "samples": COUNT,
        "gyro": _SENSOR,
        "accel": maybe(_SENSOR),
        "inflations": [
            {"motion": TEXT, "white": VECTOR, "walk": VECTOR, "parts": {"<cause>": VECTOR}, "source": TEXT}
            | dict.fromkeys(("white_sigma?", "at_most?", "white_density?", "walk_density?"), maybe(VECTOR))
        ],
        "left_out_s?": SIZE,
        "remarks?": [TEXT],
        "kalibr?": {
            f"{sensor}_{figure}": maybe(SIZE) for sensor in ("gyroscope", "accelerometer") for figure in ("noise_density", "random_walk")
        },
        "open_terms?": [{"sensor": KIND, "axis": AXIS, "term": words("N", "B", "K"), "known_after_s": maybe(SIZE)}],
        "data_sheet?": [
            {
                "sensor": KIND,
                "term": words("N", "B"),
                "unit": TEXT,
                "value": maybe(SIZE),
                "at_most": maybe(SIZE),
                "sheet": SIZE,
                "source": TEXT,
                "verdict": words("within", "above", "below", "open", "not judged"),
            }
        ],
        "allan?": {"gyro?": _CURVE, "accel?": _CURVE},
    }
}
