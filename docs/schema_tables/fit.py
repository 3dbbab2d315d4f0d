"""docs/formats/fit.md: what ``fit`` writes."""

from __future__ import annotations

from .shapes import (
    CONFORMITY,
    COUNT,
    FLAG,
    HASH,
    INTERVAL,
    MATRIX,
    NULL,
    NUMBER,
    PARAMETERS,
    SHARE,
    SIZE,
    TEXT,
    VECTOR,
    WHOLE,
    array,
    depth,
    either,
    maybe,
    named,
    when,
    words,
)

_ANGLES = {"tilt_rms_deg": SIZE, "roll_rms_deg": SIZE, "pitch_rms_deg": SIZE, "yaw_rms_deg": maybe(SIZE)}
ANGLES, UNKNOWN_ANGLES = named("angles", _ANGLES), dict.fromkeys(_ANGLES, NULL)
RUN = {"roll_deg": NUMBER, "pitch_deg": NUMBER, "yaw_deg": NUMBER, "rmse_deg": SIZE}
GOODNESS = {"chi_square": SIZE, "freedom": COUNT, "p_value": SHARE}
INSTABILITY = {
    "gyro_bias_instability_dph": maybe(SIZE),
    "gyro_bias_instability_sigma_dph": maybe(SIZE),
    "gyro_bias_instability_source": maybe(TEXT),
}
_COMPARED = named("noise_compared", {"ratio": SIZE, "low": SIZE, "high": SIZE, "p_value": SHARE, "contradicted": FLAG})
AT_REST = {"at_rest?": {"file": TEXT, "sha256": HASH, "white": [_COMPARED], "drift": maybe(_COMPARED)}}
COMPONENT = named("component", {"name": TEXT, "size": SIZE, "sigma": maybe(SIZE), "unit": TEXT, "description": TEXT})
ACCELEROMETER = {
    "mode": words("given", "fit", "prior"),
    "equation": TEXT,
    "matrix": MATRIX,
    "bias_mps2": VECTOR,
    **dict.fromkeys(("scale_correction_ppm", "nonorthogonality_mrad", "bias_mg"), array(maybe(NUMBER), 3)),
    "sigma": {name: maybe(array(maybe(SIZE), 3)) for name in ("scale_correction_ppm", "nonorthogonality_mrad", "bias_mg")},
    "any_session": maybe(
        {
            "sigma": {name: array(maybe(SIZE), 3) for name in ("scale_correction_ppm", "nonorthogonality_mrad", "bias_mg")},
            "source": TEXT,
        }
    ),
    "unobserved": [TEXT],
    "p_value": maybe(SHARE),
    "gravity_spread_before_mg": maybe(SIZE),
    "gravity_spread_mg": maybe(SIZE),
    "zero_drift": maybe({"mg_per_1000s": VECTOR, "sigma": VECTOR, "p_value": SHARE, "significant": FLAG}),
}
TESTED = {
    "answer": words("pass", "doubtful pass", "no limit", "not decided", "fail"),
    "headline": TEXT,
    "tests": [{"name": words("turns", "run", "noise", "effect", "gravity"), "p_value": maybe(SHARE), "contradicts": FLAG, "says": TEXT}],
}
ALIGNMENT = {
    "offset_s": maybe(NUMBER),
    "offset_std_s": maybe(SIZE),
    "offset_used_s": NUMBER,
    "gyro_to_truth_deg": maybe(VECTOR),
    "gyro_to_truth_std_deg": maybe(VECTOR),
    "mounting": MATRIX,
    "frame": TEXT,
    "sense": TEXT,
    "order": TEXT,
    "up": maybe(VECTOR),
    "source": dict.fromkeys(("offset", "frame", "sense", "order", "mounting"), words("given", "found", "assumed")),
}
LOT = {
    "file": TEXT,
    "hash": HASH,
    "units": COUNT,
    "used": words("yes", "no", "partly"),
    "belongs_probability": SHARE,
    "distance": SIZE,
    "freedom": COUNT,
    "p_value": SHARE,
    "off": maybe({"parameter": TEXT, "sigmas": NUMBER}),
    "share": array(NUMBER, 12),
}
DEFAULTS = {"file": TEXT, "limits": {"closure_deg": SIZE}}
DENOISED = {"noise_reduction": VECTOR, "delay_s": NUMBER, "delay_samples": WHOLE, "loss": TEXT}

_SEGMENTS = {
    "found": COUNT,
    "used": COUNT,
    "rejected": [{"segment": COUNT, "why": TEXT}],
    "notes": [{"segment": COUNT, "note": TEXT}],
}
_NOISE = {"gyro_dps_rthz": VECTOR, "accel_g_rthz": VECTOR, **INSTABILITY, "closure_floor_rms_deg": SIZE}
_FIT = {
    "session": TEXT,
    "stills": COUNT,
    "nominal_rate": maybe({"hz": SIZE, "sigma": SIZE, "source": TEXT}),
    "segments": _SEGMENTS
    | {
        "variance_inflation": [
            {"segment": COUNT, "cause": words("gap", "clipped", "impact"), "sigma_deg": maybe(SIZE), "description": TEXT}
        ]
    },
    "rests_not_used": [
        {
            "log": TEXT,
            "at_s": NUMBER,
            "duration_s": SIZE,
            "cause": words("creeps", "turns", "knocked", "too short"),
            "why": TEXT,
        }
    ],
    "noise": _NOISE | AT_REST | {"closure_all_rms_deg": maybe(SIZE), "components": [COMPONENT], "closure_floor_repaired_rms_deg?": SIZE},
    "accelerometer": ACCELEROMETER | {"effects": [{"id": TEXT, "equation": TEXT, "parameters": PARAMETERS, "std": PARAMETERS}]},
    "goodness": GOODNESS,
    "bias_any_session": maybe({"spread_dps": VECTOR, "degrees_of_freedom": [maybe(COUNT)], "sigma_dps": VECTOR, "source": TEXT}),
    "systematic": maybe(
        {
            "parameters": array(TEXT, 12),
            "sigma": array(SIZE, 12),
            "effects": array(maybe(TEXT), 12),
            "suspected": [{"id": TEXT, "log_odds": NUMBER}],
        }
    ),
    "sources": [{"source": TEXT, "type": words("A", "B"), "degrees_of_freedom": maybe(SIZE), "variance": array(NUMBER, 12)}],
    "bias_from": {
        "requested": words("auto", "ends", "stills"),
        "used": words("ends", "stills"),
        "ends_holdout_tilt_rms_deg": maybe(SIZE),
        "stills_holdout_tilt_rms_deg": maybe(SIZE),
        "p_value": maybe(SHARE),
    },
    "lot?": LOT,
    "known_turns": [
        {
            "turn": COUNT,
            "log": maybe(TEXT),
            "segment": maybe(COUNT),
            "axis": VECTOR,
            "angle_deg": NUMBER,
            "sigma_deg": SIZE,
            "gyro_deg": maybe(NUMBER),
            "used": FLAG,
            "why_not": maybe(TEXT),
            "error_deg": maybe(NUMBER),
            "holdout_error_deg": maybe(NUMBER),
        }
    ],
    "truth": maybe(ALIGNMENT),
    "unobserved": [TEXT],
    "earth": {
        "source": words("none", "given", "estimated", "unknown"),
        "heading_deg": maybe(NUMBER),
        "heading_sigma_deg": maybe(SIZE),
    },
    "methods": {"<method>": {"parameters": COUNT, "seconds": SIZE, "train": ANGLES, "holdout": ANGLES, "denoiser?": DENOISED}},
    "not_run": [{"method": TEXT, "why": TEXT}],
    "use": {"method": maybe(TEXT), "model": maybe(TEXT), "best": TEXT, "p_value": maybe(SHARE), "why": TEXT},
    "against_raw": {"method": words("raw", "raw_bias_removed"), "tilt_rms_deg": SIZE, "worse": [TEXT], "passed": FLAG},
    "verdict": TESTED
    | {
        "rule": TEXT,
        "limit_deg": maybe(SIZE),
        "limit_from": maybe(TEXT),
        "reasons": [{"met": maybe(FLAG), "reason": TEXT}],
        "doubts": [TEXT],
        "undecided": [TEXT],
        "conformity": [CONFORMITY],
    },
    "closure_runs": [
        {"file": TEXT, "duration_s": SIZE, "floor_rmse_deg": SIZE, "earth": TEXT, "lost_at_s?": [NUMBER], "<method>": RUN},
    ],
    "still_rates": {"used": FLAG, "other_choice_holdout": ANGLES},
    "options": {
        "seed": COUNT,
        "folds": COUNT,
        "as_in_paper": FLAG,
        "bias_per_log": FLAG,
        "bias": words("auto", "ends", "stills"),
        "accelerometer": words("auto", "given", "fit", "prior"),
        "clock": words("board", "arrivals"),
    },
    "version": TEXT,
    "defaults?": DEFAULTS,
}
#: of a stored calibration whose bias is taken anew: nothing is fitted
_REBIASED = {
    "session": TEXT,
    "stills": COUNT,
    "segments": _SEGMENTS,
    "noise": _NOISE,
    "methods": {"<method>": {"parameters": COUNT, "seconds": SIZE, "train": UNKNOWN_ANGLES, "holdout": ANGLES}},
    "bias": {
        "model": TEXT,
        "source": words("start", "gravity", "given"),
        "fitted_here": maybe(FLAG),
        "remarks": [TEXT],
        "change_dps": {"start?": VECTOR, "gravity": VECTOR, "given?": VECTOR},
        "sigma_dps": {"start?": VECTOR, "gravity": VECTOR, "given?": NULL},
    },
    "closure_runs": [{"file": TEXT, "duration_s": SIZE, "<method>": RUN}],
    "version": TEXT,
    "defaults?": DEFAULTS,
}


def _axis(unit: str) -> dict:
    swing = named(f"hysteresis_{unit}", maybe({f"largest_{unit}": NUMBER, f"std_{unit}": SIZE, "at_c": NUMBER, f"rms_{unit}": SIZE}))
    return {
        "axis": words("x", "y", "z"),
        "order": COUNT,
        f"terms_{unit}": [maybe(NUMBER)],
        f"terms_std_{unit}": [maybe(SIZE)],
        "lag_s": maybe(NUMBER),
        "lag_std_s": maybe(SIZE),
        "p_value": SHARE,
        "held_out_by": words("sweeps", "stretches"),
        f"held_out_{unit}": SIZE,
        f"held_out_constant_{unit}": maybe(SIZE),
        f"left_{unit}": SIZE,
        f"turn_on_{unit}": maybe(SIZE),
        f"line_{unit}": maybe(NUMBER),
        f"line_std_{unit}": maybe(SIZE),
        "line_or_walk": FLAG,
        "hysteresis": {"before": swing, "after": swing},
    }


_TEMPERATURE = {
    "session": TEXT,
    "version": TEXT,
    "reference_c": NUMBER,
    "range_c": INTERVAL,
    "remaining_dps": either(NULL, array(maybe(SIZE), 3)),
    "model": {
        "E_per_c": array(NUMBER, None, 3, 3),
        "zero_dps_per_c": array(NUMBER, None, 3),
        "lag_s": VECTOR,
        "parameters": [{"name": TEXT, "value": NUMBER, "std": SIZE}],
    },
    "rests?": [
        {
            "file": TEXT,
            "samples": COUNT,
            "duration_s": SIZE,
            "rate_hz": maybe(SIZE),
            "left_out_s": SIZE,
            "temperature_c": array(maybe(NUMBER), 2),
        }
    ],
    "sweeps?": {"up": COUNT, "down": COUNT},
    "gyro?": [_axis("dps")],
    "accel?": [_axis("mg")],
    "noise?": [
        {
            "axis": words("x", "y", "z"),
            "angle_random_walk_deg_rth": maybe(SIZE),
            "angle_random_walk_std_deg_rth": maybe(SIZE),
            "bias_instability_dph": maybe(SIZE),
            "bias_instability_std_dph": maybe(SIZE),
            "bias_instability_at_most_dph": maybe(SIZE),
            "rms_per_c": maybe(NUMBER),
            "rms_std_per_c": maybe(SIZE),
            "rms_at_c": [maybe(NUMBER)],
            "rms_dps": [maybe(SIZE)],
        }
    ],
    "sessions?": [
        {
            "name": TEXT,
            "temperature_c": array(maybe(NUMBER), 3),
            "segments": COUNT,
            "E": MATRIX,
            "zero_dps": array(maybe(NUMBER), 3),
            "zero_std_dps": array(maybe(SIZE), 3),
        }
    ],
    "E_goodness?": {"chi_square": SIZE, "freedom": COUNT, "p_value": maybe(SHARE), "variance_inflation": SIZE},
    "E_constant_p_value?": maybe(SHARE),
    "turn_on_dps?": maybe(SIZE),
}

SPLIT = {
    "common_rms_deg": SIZE,
    "common_p_value": maybe(SHARE),
    "common_upper95_deg": maybe(SIZE),
    "equal_in_all_turns_deg": {"size": SIZE, "sigma": maybe(SIZE)},
    "undersampled_deg": {"size": maybe(NUMBER), "sigma": maybe(SIZE), "predicted": maybe(SIZE)},
    "level_acceleration_mg": {"size": maybe(SIZE), "sigma": maybe(SIZE)},
    "is_fast_motion": FLAG,
    "minus_mean_rms_deg": maybe(SIZE),
    "description": TEXT,
}
EVENT = {
    "what": words("turn", "still", "common turn", "common still"),
    "unit": maybe(COUNT),
    "rival": maybe(COUNT),
    "at_s": NUMBER,
    "size": SIZE,
    "unit_of_size": words("deg", "mg"),
    "p_value": SHARE,
}
LEFT_OUT = {"number": COUNT, "why": TEXT}
_ARRAY = {
    "array": TEXT,
    "units": [
        {
            "number": COUNT,
            "serial": TEXT,
            "clock": {
                "offset_s": NUMBER,
                "offset_sigma_s": SIZE,
                "rate_ppm": NUMBER,
                "rate_sigma_ppm": SIZE,
                "about_s": NUMBER,
            },
            "mounting": {"rotvec_deg": VECTOR, "sigma_deg": VECTOR, "matrix": MATRIX},
            "position": {"metres": maybe(VECTOR), "sigma_m": maybe(VECTOR)},
            "closure": {
                "alone_rms_deg": SIZE,
                "floor_rms_deg": SIZE,
                "own_rms_deg": SIZE,
                "own_sigma_deg": maybe(SIZE),
                "own_p_value": SHARE,
                "minus_mean_rms_deg": maybe(SIZE),
            },
            "noise": {"gyro_dps_rthz": VECTOR, "accel_g_rthz": VECTOR, "bias_instability_dph": maybe(either(SIZE, VECTOR))},
            "E": MATRIX,
            "B_dps": VECTOR,
            "E_sigma": MATRIX,
            "B_sigma_dps": VECTOR,
            "E_sigma_alone": array(maybe(SIZE), 3, 3),
            "B_sigma_alone_dps": array(maybe(SIZE), 3),
            "unobserved": [TEXT],
            "closure_runs": [{"file": TEXT, "duration_s": SIZE, "rmse_deg": SIZE}],
            "model": TEXT,
        }
    ],
    "left_out": [LEFT_OUT],
    "turns_used": [COUNT],
    "bias_from": {"used": words("ends", "stills"), "p_value": maybe(SHARE)},
    "read_latency": [{"number": COUNT, "beat_hz": NUMBER, "period_s": SIZE}],
    "split": SPLIT,
    "turns": [{"at_s": NUMBER, "common_deg": maybe(SIZE), "common_sigma_deg": maybe(SIZE), "own_deg": [maybe(SIZE)]}],
    "events": [EVENT],
    "version": TEXT,
}

TABLES = {
    "tinygc-array-fit/2": _ARRAY,
    "tinygc-fit/2": when("bias", _REBIASED, _FIT),
    "tinygc-temperature/2": _TEMPERATURE,
    "tinygc-checkpoint/1": {
        "of": TEXT,
        "losses": [NUMBER],
        **dict.fromkeys(("weights", "best", "exp_avg", "exp_avg_sq"), depth(NUMBER, 3)),
    },
}
