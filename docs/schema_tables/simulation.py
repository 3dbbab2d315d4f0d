"""docs/formats/simulation.md: what ``simulate`` and ``challenge`` write."""

from __future__ import annotations

from .explain import VERDICT
from .shapes import (
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
    depth,
    either,
    maybe,
    other,
    when,
    words,
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

_SOURCE = words("stated", "model", "nothing")
_SEALED = {
    "effects": _HIDDEN,
    "strength": maybe(NUMBER),
    "strengths": {"<id>": maybe(NUMBER)},
    "odr_hz": SIZE,
    "bias_instability_dph": SIZE,
    "instability_source": _SOURCE,
    "options": {"<option>": depth(either(NUMBER, NULL, FLAG, TEXT), 1)},
}
_SCORE = {
    "name": TEXT,
    "kind": words("nothing", "one", "two", "three", "four", "outside", "beside"),
    "truth": [TEXT],
    "strength": maybe(NUMBER),
    "verdict": TEXT,
    "claimed": [TEXT],
    "exact": FLAG,
    "found": [TEXT],
    "wrong": [TEXT],
    "missed": [TEXT],
    "sigmas": [maybe(NUMBER)],
    "right": [FLAG],
    "removed": maybe(NUMBER),
    "statements": [{"id": TEXT, "probability": SHARE, "claimed": FLAG, "right": FLAG}],
    "odr_hz": SIZE,
    "instability_dph": SIZE,
    "instability_source": _SOURCE,
}
_KIND = dict.fromkeys(("sessions", "named_exactly", "named_with_equivalents", "wrongly_named", "missed"), COUNT)
_CHALLENGE = {
    "seed": COUNT,
    "sha256": HASH,
    "sessions": {"<case>": {"truth": _SEALED, "verdict": TEXT, "named": {"<id>": [TEXT]}, "score": _SCORE}},
    "totals": {
        **dict.fromkeys(("sessions", "refused", "nulls", "false_alarms", "hidden", "named_exactly"), COUNT),
        **dict.fromkeys(("named_with_equivalents", "wrongly_named", "missed"), COUNT),
        **dict.fromkeys(("outsiders", "outsiders_seen", "outsiders_wrongly_named", "outsiders_undecided"), COUNT),
        "kinds": [{"kind": TEXT, **_KIND}],
        "groups": [
            {"by": TEXT, "group": TEXT, **dict.fromkeys(("sessions", "wrongly_named", "nulls", "false_alarms"), COUNT)},
        ],
        "reliability": [
            {"low": SHARE, "high": SHARE, "number": COUNT, "share_right": maybe(SHARE), "mean_stated": maybe(SHARE)},
        ],
        "ece": maybe(SHARE),
        "ece_claimed": maybe(SHARE),
        "error_median_sigmas": maybe(SIZE),
        "share_within_3_sigmas": maybe(SHARE),
        "share_within_3_sigmas_or_tenth": maybe(SHARE),
        "excess_removed_median": maybe(NUMBER),
    },
}

#: a drawn law has its expression among its parameters
_LAWS = {"<id>": {"<parameter>": depth(either(NUMBER, TEXT), 3)}}
_LAW_SCORE = {
    "name": TEXT,
    "kind": words("law", "beside", "catalogue", "nothing"),
    "hidden": [TEXT],
    "law": maybe(TEXT),
    "strength": maybe(NUMBER),
    "expression": maybe(TEXT),
    "outcome": words("found", "catalogue_equal", "ambiguous", "wrong", "missed", "silent", "invented"),
    "equations": [TEXT],
    "named": [TEXT],
    "misnamed": FLAG,
    "correlation": maybe(NUMBER),
    "listed": maybe(NUMBER),
    "removed": maybe(NUMBER),
    "p_value": maybe(SHARE),
    "chance_p": maybe(SHARE),
    "seconds": SIZE,
    "why": maybe(TEXT),
}
_WITH_LAW = dict.fromkeys(("sessions", "found", "catalogue_equal", "ambiguous", "wrong", "missed"), COUNT)
_WITHOUT = dict.fromkeys(("sessions", "silent", "ambiguous", "invented"), COUNT)
_DISCOVER = {
    "seed": COUNT,
    "sha256": HASH,
    "sessions": {"<case>": {"truth": _SEALED | {"effects": _LAWS}, "verdict": TEXT, "score": _LAW_SCORE}},
    "totals": {
        **dict.fromkeys(("sessions", "far", "misnamed", "ambiguous_with_equal"), COUNT),
        "with_law": _WITH_LAW,
        "strengths": [{"strength": NUMBER, **_WITH_LAW}],
        "nothing": _WITHOUT,
        "catalogue": _WITHOUT,
        **dict.fromkeys(("removed_median", "removed_least"), maybe(NUMBER)),
        **dict.fromkeys(("seconds_median", "seconds_most"), maybe(SIZE)),
    },
}
_POWER = {
    "session": TEXT,
    "seed": COUNT,
    "sha256": HASH,
    "verdict": VERDICT,
    "own": [TEXT],
    "effects": [
        {
            "id": TEXT,
            "unit": TEXT,
            "detection_limit": maybe(SIZE),
            "detected_from": maybe(SIZE),
            "ratio": maybe(SIZE),
            "agrees": maybe(FLAG),
            "tried": [{"size": SIZE, "found": FLAG, "named": [TEXT], "wrong": [TEXT], "lost": [TEXT]}],
        }
    ],
    "agreement": {
        **dict.fromkeys(("predicted", "detected", "agree", "disagree", "not_decided"), COUNT),
        "median_ratio": maybe(SIZE),
    },
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
    "tinygc-challenge/2": _CHALLENGE,
    "tinygc-discover-challenge/2": _DISCOVER,
    "tinygc-power/2": _POWER,
}
