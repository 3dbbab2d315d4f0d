"""docs/formats/commands.md: what the other commands write with ``--json``."""

from __future__ import annotations

from .fit import ACCELEROMETER, DEFAULTS
from .shapes import (
    CONFORMITY,
    COUNT,
    FLAG,
    HASH,
    NUMBER,
    SHARE,
    SIZE,
    TEXT,
    VECTOR,
    Shape,
    array,
    maybe,
    named,
    of,
    other,
    when,
    words,
)

#: of model files
KINDS = (
    "linear",
    "tinygc",
    "tinygc_denoised",
    "physics",
    "tinygc_physics",
    "thermal",
)
LEVELS = ("ok", "note", "warning", "error")
FINDING = named("finding", of("session.detect.findings:Finding"))
VERSIONS = {name: maybe(TEXT) for name in ("TinyGC", "commit", "Python", "numpy", "scipy")} | {"torch?": TEXT}

_RMS = {"raw_bias_removed": SIZE, "least_squares": SIZE}
_CLOSURE = {
    "turns": COUNT,
    "scale": maybe(VECTOR),
    "holdout_tilt_rms_deg": maybe(_RMS),
    "runs": [{"file": TEXT, "rmse_deg": _RMS}],
    "why": TEXT,
}
_REPAIR = {
    "session": TEXT,
    "version": TEXT,
    "sha256": {"<file>": HASH},
    "changes": [
        {
            "finding": TEXT,
            "cause": TEXT,
            "files": [TEXT],
            "columns": words("gyro", "accel", "time", ""),
            "factor": NUMBER,
            "axes": maybe(array(words(-1, 0, 1), 3, 3)),
            "settings": {f"{name}?": SIZE for name in ("odr_hz", "gyro_fs_dps", "accel_fs_g", "gyro_mdps_per_lsb", "accel_mg_per_lsb")},
        }
    ],
    "closure?": {"before": named("closure", _CLOSURE), "after": named("closure", _CLOSURE)},
    "findings?": [FINDING],
}
_REPORT = {
    "session": TEXT,
    "made": TEXT,
    "passed": maybe(FLAG),
    "answer": words("pass", "doubtful pass", "no limit", "not decided", "fail"),
    "rule": TEXT,
    "limit_deg": maybe(SIZE),
    "doubts": [TEXT],
    "conformity": [CONFORMITY],
    "certificate?": {"number": maybe(TEXT), "draft": [TEXT], "missing": [TEXT]},
    "calibration": words("least_squares", "physics"),
    "effects": [TEXT],
    "verdict": maybe(TEXT),
    "closure": {
        "holdout_tilt_rms_deg": SIZE,
        "floor_rms_deg": SIZE,
        "p_value": SHARE,
        "degrees_of_freedom": COUNT,
        "runs": [{"file": TEXT, "roll_deg": NUMBER, "pitch_deg": NUMBER, "yaw_deg": NUMBER, "rmse_deg": SIZE, "p_value": maybe(SHARE)}],
    },
    "parameters": [
        {
            "parameter": TEXT,
            "component": TEXT,
            "unit": TEXT,
            "value": maybe(NUMBER),
            "expanded_uncertainty": maybe(SIZE),
            "coverage_factor": NUMBER,
            "by_one_effect": maybe(SIZE),
            "at_most": maybe(SIZE),
        }
    ],
    "accelerometer": ACCELEROMETER,
    "inputs": {"<file>": HASH},
    "versions": VERSIONS,
    "defaults?": DEFAULTS,
}


def _each(result: Shape) -> dict:
    return {"sessions": [{"folder": TEXT, "exit_code": COUNT, "error": maybe(TEXT), "result": maybe(result)}]}


_CHI = {"chi_square": SIZE, "freedom": COUNT, "p_value": SHARE}
_COMPARE = {
    "sessions": [TEXT],
    "agree": FLAG,
    "verdict_on": words("E", "E and B"),
    "lasting": _CHI,
    "bias": _CHI,
    "all": _CHI,
    "moved": [
        {"session": TEXT, "name": TEXT, "component": TEXT, "unit": TEXT, "by": NUMBER, "sigmas": NUMBER, "p_value": SHARE},
    ],
    "quantities": [
        {
            "name": TEXT,
            "component": TEXT,
            "unit": TEXT,
            "values": [maybe(NUMBER)],
            "sigmas": [maybe(SIZE)],
            "sigmas_from_the_rest": [maybe(NUMBER)],
        }
    ],
    "accelerometer": {
        "modes": [words("given", "fit", "prior")],
        "chi_square": maybe(SIZE),
        "freedom": maybe(COUNT),
        "p_value": maybe(SHARE),
        "quantities": [{"name": TEXT, "component": TEXT, "unit": TEXT, "values": [maybe(NUMBER)], "sigmas": [maybe(SIZE)]}],
    },
    "notes": [TEXT],
}
_APPLY_ARRAY = {
    "out": TEXT,
    "rows": COUNT,
    "delay_s": NUMBER,
    "accelerometer": maybe(words("model", "session", "none")),
    "notes": [TEXT],
    "kind": words("array"),
    "log": TEXT,
    "clocks": words("model", "same", "found"),
    "left_out": COUNT,
    "at_end": COUNT,
    "units": [{"number": COUNT, "used_share": SHARE}],
}
_PERSONAL = {
    "file": TEXT,
    "record?": {"port?": TEXT, "like?": TEXT},
    "site?": {"latitude_deg?": NUMBER, "gravity_mps2?": NUMBER},
}
_RECORD = {
    "session": TEXT,
    "done": FLAG,
    "segments": {"wanted": COUNT, "accepted": COUNT, "rejected": COUNT, "dropped": COUNT},
    "accelerometer": maybe({"stills": COUNT, "attitudes": COUNT, "spread_mg": {"before": maybe(SIZE), "after": maybe(SIZE)}}),
    "samples": COUNT,
    **dict.fromkeys(("lost", "crc_errors", "garbage_bytes", "implausible", "resets"), COUNT),
    "odr_hz": maybe(SIZE),
    "odr_by_host_hz": maybe(SIZE),
    "clock": maybe({"ratio": SIZE, "sigma_ppm": SIZE}),
    "logs": [TEXT],
    "missing": maybe([TEXT]),
    "rest?": {"wanted_s": maybe(SIZE), "recorded_s": SIZE, "moved_s": SIZE, "known": FLAG, "remarks": [TEXT]},
    "defaults?": _PERSONAL,
}
_FIGURE = named("figure", {"value": NUMBER, "source": TEXT, "read": FLAG})
_SENSOR = {
    "name": TEXT,
    "also": [TEXT],
    "gyro_mdps_per_lsb": maybe({"<full scale>": SIZE}),
    "accel_mg_per_lsb": maybe({"<full scale>": SIZE}),
    "units_source": TEXT,
    "temp_lsb_per_c": maybe(NUMBER),
    "temp_at_zero_c": maybe(NUMBER),
    "odr_hz": [SIZE],
    "divided": [{"base_hz": SIZE, "most": COUNT}],
    "clock_within": maybe(_FIGURE),
    "works_c": maybe(array(NUMBER, 2)),
    "figures": dict.fromkeys(
        ("gyro_noise_mdps_rthz?", "accel_noise_ug_rthz?", "gyro_bias_instability_dph?", "zero_rate_dps?", "accel_zero_mg?"), _FIGURE
    ),
}

TABLES = {
    "tinygc-demo/1": {
        "folder": TEXT,
        "parameters": [{"name": TEXT, "unit": words("1", "rad/s"), "value": NUMBER, "sigma": SIZE, "truth": NUMBER}],
        "fit": other("tinygc-fit/2"),
    },
    "tinygc-check/2": {"findings": [FINDING]},
    "tinygc-repair/1": _REPAIR,
    "tinygc-report/1": _REPORT,
    "tinygc-fits/1": _each(other("tinygc-fit/2", "tinygc-temperature/2", "tinygc-array-fit/2")),
    "tinygc-reports/1": _each(other("tinygc-report/1")),
    "tinygc-list/1": {"sessions": [of("tinygc.fitting.listing:ListedSession")]},
    "tinygc-compare/2": _COMPARE,
    "tinygc-apply/1": when("log", _APPLY_ARRAY, of("tinygc.deploy.apply:Applied")),
    "tinygc-export/2": {"format": TEXT, "files": [TEXT], "remarks": [TEXT]},
    "tinygc-readers/1": {"readers": [{"name": TEXT, "example": TEXT, "needs": TEXT}]},
    "tinygc-record/1": _RECORD,
    "tinygc-board/1": {"samples": COUNT, "dropped": COUNT, "starts": COUNT, "take": maybe(COUNT)},
    "tinygc-ports/1": {
        "ports": [
            {"name": TEXT, "what": TEXT, "is_candidate": FLAG, "usb": maybe(array(maybe(COUNT), 2)), "serial_number": maybe(TEXT)},
        ]
    },
    "tinygc-sensors/1": {"sensors": [_SENSOR]},
}
