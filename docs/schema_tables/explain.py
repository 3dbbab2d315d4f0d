"""docs/formats/explain.md: what ``explain`` and ``check --plan`` write."""

from __future__ import annotations

from .commands import FINDING
from .fit import ALIGNMENT, AT_REST, COMPONENT, EVENT, INSTABILITY, LEFT_OUT, SPLIT, TESTED
from .shapes import (
    COUNT,
    FLAG,
    HASH,
    INTERVAL,
    NULL,
    NUMBER,
    PARAMETER,
    PARAMETERS,
    SHARE,
    SIZE,
    TEXT,
    VECTOR,
    Of,
    array,
    depth,
    either,
    maybe,
    named,
    when,
    words,
)

VERDICT = words("no_mismatch", "explained", "ambiguous", "partly_explained", "unexplained")
#: a bound that is smaller than any number is marked, and only then
_BOUND = Of({"const": True})
_STANDING = words("for", "against", "bounded", "undecided")
_CHANGE = named("change", {"before": SIZE, "after": SIZE})


def _p(name: str) -> dict:
    return {name: maybe(SHARE), f"{name}_is_upper_bound?": _BOUND}


_CLAIM = {
    "id": TEXT,
    "equation": TEXT,
    "parameters": PARAMETERS,
    "std": PARAMETERS,
    **_p("p_value"),
    "probability": SHARE,
    "rivals": {"<id>": SHARE},
    "equivalent": [TEXT],
    "description": TEXT,
}
_EFFECT = named("effect", _CLAIM | {"share?": maybe(NUMBER), "against_stated?": {"chi_square": SIZE, "freedom": COUNT, **_p("p_value")}})
_QUANTITY = either(NUMBER, [NUMBER])
_TABLE = {
    "name": TEXT,
    "verdict": words("clean", "table", "sensor", "both", "ambiguous", "suspected", "unexplained", "undecided"),
    "why_not": maybe(TEXT),
    "rests?": COUNT,
    "turns?": COUNT,
    "p_value?": SHARE,
    "left_p_value?": SHARE,
    "latency_ms?": NUMBER,
    "latency_std_ms?": SIZE,
    "noise?": {
        "repeatability_of_declared": SIZE,
        "bias_wander_dph": SIZE,
        "accelerometer_mg": SIZE,
        "gyroscope_turn_deg": SIZE,
        "word_jitter_ms": SIZE,
        "word_resolution_deg": SIZE,
        "word_wander_ms": SIZE,
        "word_wander_s": SIZE,
    },
    "effects?": [
        {
            "id": TEXT,
            "whose": words("table", "sensor"),
            "where": TEXT,
            "shape": {"axis?": TEXT, "cycles?": COUNT, "turn?": COUNT},
            "parameters": {"<parameter>": _QUANTITY},
            "std": {"<parameter>": _QUANTITY},
            "p_value": SHARE,
            "log_evidence": NUMBER,
            "equivalent": [TEXT],
            "description": TEXT,
            "movement": maybe(TEXT),
        }
    ],
    "undecided?": [{"id": TEXT, "where": TEXT, "detection_limit": SIZE, "unit": TEXT}],
    "doubts?": [TEXT],
    "suspected?": [TEXT],
    "inseparable?": [{"id": TEXT, "where": TEXT, "hidden_in": [TEXT], "movement": TEXT}],
}
_CHECKED_EFFECT = named(
    "checked_effect",
    {
        "id": TEXT,
        "outcome": words(
            "confirmed",
            "another_size",
            "not_confirmed",
            "contradicted",
            "no_power",
            "no_numbers",
            "of_one_recording",
            "of_one_unit",
        ),
        "standing": words("for", "against", "undecided"),
        "log_odds": maybe(NUMBER),
        "same_size_p": maybe(SHARE),
        "power": maybe(SHARE),
        "size_share": maybe({"value": NUMBER, "std": SIZE}),
        "there": maybe({"parameters": PARAMETERS, "std": PARAMETERS}),
        "closure_rms_deg": maybe(_CHANGE),
    },
)
_CHECKED = {"session": TEXT, "same_unit": maybe(FLAG), "error": maybe(TEXT), "effects": [_CHECKED_EFFECT]}
_COEFFICIENTS = {"<coefficient>": PARAMETER}
_LAW = {
    "id": TEXT,
    "equation": TEXT,
    "in_words": TEXT,
    "parameters": _COEFFICIENTS,
    "std": _COEFFICIENTS,
    "unit": TEXT,
    "terms": [TEXT],
    "constants": {"<constant>": {"value": NUMBER, "sigma": maybe(SIZE), "unit": TEXT}},
    "bits": SIZE,
    "chi_square": NUMBER,
    "better_by": NUMBER,
    "chance_p": SHARE,
    "held_out": [
        {
            "before_deg": SIZE,
            "after_deg": SIZE,
            "floor_deg": SIZE,
            "removed": maybe(NUMBER),
            **_p("p_value"),
            **_p("noise_p"),
            "segments": COUNT,
            "recording": maybe(TEXT),
        }
    ],
    "file": maybe(TEXT),
    "same_here": [TEXT],
    "runners_up": [{"id": maybe(TEXT), "equation": TEXT, "worse_by": NUMBER, "correlation": NUMBER, "discriminating_motion": TEXT}],
    "learnable_from": maybe(NUMBER),
    "not_observed": [{"in_words": TEXT, "direction": depth(NUMBER, 3)}],
}
_DISCOVERY = {
    "verdict": words("found", "ambiguous", "none"),
    "why": TEXT,
    "laws": [_LAW],
    "catalogue_effects": [{"id": TEXT, "parameters": PARAMETERS, "std": PARAMETERS}],
    "forms": COUNT,
    "distinct": COUNT,
    "chance": maybe(NUMBER),
    "best": maybe(NUMBER),
    "learnable": {"<follows>": {"size_dps": maybe(SIZE)}},
}
_AXES, _PHASES = [words("x", "y", "z")], [words("still", "turn", "reference", "timing")]
_PLACE = {
    "phases": _PHASES,
    "axes": _AXES,
    "segments": [COUNT],
    "conditions": maybe({"variable": TEXT, "units": TEXT, "from": NUMBER, "to": NUMBER, "axis?": TEXT}),
}
_MISMATCH = {**_p("p_value"), "closure_rms_deg": SIZE, "expected_rms_deg": SIZE, "unnamed_part": FLAG}
_HELD_OUT = {"before": SIZE, "after": SIZE, "floor": SIZE}
_CHANNEL = named("channel", {**_p("p_before"), **_p("p_after"), "rms_sigmas": {"before": maybe(SIZE), "after": maybe(SIZE)}})
_HEAD = {"session": TEXT, "verdict": VERDICT}
_EXPLAIN = _HEAD | {
    "mismatch": _MISMATCH | {"where": _PLACE | {"segment_seconds": [INTERVAL], "seconds": maybe(INTERVAL)}},
    "effects": [_EFFECT],
    "decision": maybe(TESTED),
    "findings": [_CLAIM | {"share": maybe(NUMBER)}],
    "families": [{"id": TEXT, "size_dps": SIZE, "shares": {"<id>": SHARE}, "description": TEXT}],
    "considered": [{"id": TEXT, "probability": SHARE, "moments": COUNT, "closure_rms_deg": maybe(_CHANGE)}],
    "lines_end_hz": maybe(SIZE),
    "fit": {"holdout_closure_rms_deg": _HELD_OUT, "excess_removed": maybe(NUMBER), "segments_after": COUNT},
    "channels": dict.fromkeys(("closure", "still", "length"), _CHANNEL),
    "turn_gravity": {"lever_m": VECTOR, "offset_s": NUMBER, "offset_std_s": SIZE, "rms_mg": _CHANGE},
    "noise": INSTABILITY | AT_REST | {"components": [COMPONENT]},
    "within_stills": {"slope_rms_sigmas": maybe(SIZE), "scatter_rms_sigmas": maybe(SIZE)},
    "detection_limits": {"<id>": {"size": maybe(SIZE), "unit": TEXT}},
    "warnings": [FINDING],
    "next": maybe(TEXT),
    "logs": {"<file>": HASH},
    "version": TEXT,
    "checked?": [_CHECKED],
    "discovery?": _DISCOVERY,
    "table?": _TABLE,
}
#: beside a truth file
_TRUTH = _HEAD | {
    "mismatch": _MISMATCH | {"where": _PLACE},
    "effects": [_EFFECT],
    "refused": [named("refused", _CLAIM | {"share?": maybe(NUMBER)})],
    "considered": [{"id": TEXT, "probability": SHARE}],
    "fit": {"holdout_closure_rms_deg": _HELD_OUT, "closure_rms_deg": _CHANGE},
    "noise": INSTABILITY | AT_REST | {"components": [COMPONENT]},
    "truth": {
        "wrong_moments": [{"log": COUNT, "at_s": NUMBER}],
        "outages": [
            {
                "log": COUNT,
                "from_s": NUMBER,
                "to_s": NUMBER,
                "rms_dps": SIZE,
                "times_usual": SIZE,
                "of": words("truth", "truth or gyro"),
            }
        ],
        "sigma_deg": maybe(SIZE),
        "gyro_walk_deg_rts": maybe(SIZE),
        "closure_deg_by_length_s": {"<length>": array(maybe(SIZE), 3)},
        "gyro_noise_walk_deg_rts": SIZE,
        "neighbours_correlation": {"before": maybe(NUMBER), "after": maybe(NUMBER)},
        **{f"{key}?": shape for key, shape in ALIGNMENT.items()},
    },
    "force": maybe({"bias_mg": VECTOR, "bias_turned_mg": VECTOR, "std_mg": VECTOR}),
    "rests": maybe({"seconds": SIZE, "zero_less_motion_dps": VECTOR, "vibration_g2": {"rest": SIZE, "motion": SIZE}}),
    "excess": _CHANGE,
    "next": NULL,
    "version": TEXT,
    "checked?": [_CHECKED],
}

_STATED = {"standing": _STANDING, "test": TEXT, "p_value": maybe(SHARE), "description": TEXT}
_NOISE_AT_REST = _STATED | {"correlation": NUMBER, "correlation_sigma": SIZE, "source": TEXT}
_ARRAY = {
    "array": TEXT,
    "verdict": words("common", "own", "common_and_own", "no_mismatch", "undecided"),
    "statements": [{"what": TEXT, **_STATED, "size_deg": SIZE, "upper95_deg": maybe(SIZE)}],
    "split": SPLIT,
    "units": [
        {
            "number": COUNT,
            "verdict": maybe(VERDICT),
            "error": maybe(TEXT),
            "own_rms_deg": SIZE,
            "own_sigma_deg": maybe(SIZE),
            "own_p_value": SHARE,
            "own_upper95_deg": maybe(SIZE),
            "own_standing": _STANDING,
            "explained": maybe(TEXT),
        }
    ],
    "traits": [
        {
            "id": TEXT,
            "units": [COUNT],
            "scope": words("common", "alike", "differs", "undecided", "readings"),
            "apart": [COUNT],
            "equivalent": [TEXT],
            **_STATED,
            "of_units": [TEXT],
            "by_unit": [{"number": COUNT, "named": FLAG, "value": [NUMBER], "std": [maybe(SIZE)]}],
        }
    ],
    "slow_zero": maybe(_STATED | {"shares": {"<id>": SHARE}, "by_unit": [{"number": COUNT, "size_dps": SIZE, "named": [TEXT]}]}),
    "rest_noise": {"gyro?": _NOISE_AT_REST, "accelerometer?": _NOISE_AT_REST},
    "events": [EVENT],
    "moments": [
        {
            "what": words("false reading", "knock"),
            "at_s": NUMBER,
            "unit": COUNT,
            "units": [COUNT],
            "size_dps": SIZE,
            "felt_by_others": maybe(NUMBER),
            "description": TEXT,
        }
    ],
    "left_out": [LEFT_OUT],
    "version": TEXT,
    "checked?": [{"array": TEXT, "units": [{"number": COUNT, **_CHECKED}]}],
}

TABLES = {
    "tinygc-explain/2": when("truth", _TRUTH, _EXPLAIN),
    "tinygc-array-explain/2": _ARRAY,
}
