"""docs/formats/simulation.md: what ``simulate`` and ``challenge`` write."""

from __future__ import annotations

from .shapes import (
    COUNT,
    FLAG,
    INTERVAL,
    MATRIX,
    NULL,
    NUMBER,
    PARAMETERS,
    SIZE,
    TEXT,
    VECTOR,
    WHOLE,
    depth,
    either,
    maybe,
    other,
    when,
)

OPTIONS = {
    "segments": COUNT,
    "closure_s": SIZE,
    "seed": COUNT,
    "odr_hz": SIZE,
    "odr_error": maybe(NUMBER),
    "sensor": TEXT,
    **dict.fromkeys(("gyro_fs_dps", "accel_fs_g", "gyro_noise_dps_rthz", "accel_noise_ug_rthz", "bias_instability_dph"), SIZE),
    "temperature_start_c": NUMBER,
    "warm_up_c": NUMBER,
    **dict.fromkeys(("gyro_scale_error", "gyro_misalignment", "gyro_bias_dps"), SIZE),
    **dict.fromkeys(("accel_scale_error", "accel_misalignment", "accel_bias_mg", "accel_calibration_error_mg"), SIZE),
    "latitude_deg": NUMBER,
    "gravity_mps2": SIZE,
    "heading_deg": maybe(NUMBER),
    "with_heading": FLAG,
    "lever_m": VECTOR,
    "vigour": SIZE,
    "still_s": SIZE,
    "turn_s": SIZE,
    "stop_sigma_deg": SIZE,
    "unit_seed": WHOLE,
}
#: which the simulation of the checkout, data/session1, does not have
_LATER = ("sensor", "stop_sigma_deg")
_ARRAY = {
    "units": COUNT,
    **dict.fromkeys(("mounting_deg", "position_mm", "clock_offset_ms", "clock_rate"), SIZE),
    "synchronous": FLAG,
    **dict.fromkeys(("jerk_deg", "knock_deg", "false_reading_dps", "reference_error_mg"), SIZE),
}
_HIDDEN = {"<id>": PARAMETERS}
_TRUTH = {
    "effects": _HIDDEN,
    "E": MATRIX,
    "B_dps": VECTOR,
    "heading_deg": NUMBER,
    "lever_m": VECTOR,
    "odr_hz": SIZE,
    "accel_shift_mg": VECTOR,
    "gyro_noise_dps_rthz": SIZE,
    "accel_noise_ug_rthz": SIZE,
    "bias_instability_dph": SIZE,
    "turns_s": [INTERVAL],
    "closure_s": maybe(INTERVAL),
    "options": {f"{name}?" if name in _LATER else name: shape for name, shape in OPTIONS.items()},
}
_REST = {
    "rest": {
        "cycles": SIZE,
        "cycle_s": SIZE,
        "cold_c": NUMBER,
        "warm_c": NUMBER,
        "zero_dps": VECTOR,
        "slope_dps_per_c": either(NUMBER, VECTOR),
        "bend_dps_per_c2": either(NUMBER, VECTOR),
        "lag_s": NUMBER,
        "hysteresis_dps": NUMBER,
        "random_walk_dps_rts": SIZE,
        "noise_per_c": NUMBER,
        "knocks": COUNT,
        "knock_s": [NUMBER],
    }
}

TABLES = {
    "tinygc-simulate/1": {
        "folder": TEXT,
        "options": {"array?": _ARRAY, "<option>": depth(either(NUMBER, NULL, FLAG, TEXT), 1)},
        "effects?": _HIDDEN,
    },
    "tinygc-truth/1": when("rest", _REST, _TRUTH),
    "tinygc-array-truth/1": {
        "array": _ARRAY,
        "units": [
            {
                "number": COUNT,
                "mounting_rotvec_deg": VECTOR,
                "position_m": VECTOR,
                "clock_offset_s": NUMBER,
                "clock_rate": NUMBER,
                "session": other("tinygc-truth/1"),
            }
        ],
        "jerks_s": [NUMBER],
    },
}
