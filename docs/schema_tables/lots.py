"""docs/formats/lots.md: lots and fleets.  Limits are TOML, and the table of a fleet is SQLite."""

from __future__ import annotations

from .commands import LEVELS
from .explain import VERDICT
from .shapes import COUNT, FLAG, NUMBER, SHARE, SIZE, TEXT, array, maybe, named, words

_MATRIX = array(maybe(NUMBER), 21, 21)
_INTERVAL = array(maybe(NUMBER), 2)
_ALARM = named("alarm", {"place": COUNT, "value": NUMBER, "sigmas": NUMBER})
_INDEX = named("index", {"index": maybe(NUMBER), "index_interval": _INTERVAL, "centred": maybe(NUMBER), "centred_interval": _INTERVAL})
_LOT = {
    "version": TEXT,
    "sensor": TEXT,
    "units": COUNT,
    "sessions": COUNT,
    "names": array(TEXT, 21),
    "mean": array(maybe(NUMBER), 21),
    "mean_covariance": _MATRIX,
    "spread": _MATRIX,
    "tails": maybe(SIZE),
    "repeatability": maybe(_MATRIX),
    "effects": {
        "<id>": {
            "share": SHARE,
            "p_value": SHARE,
            "units": COUNT,
            "mean": {"<component>": NUMBER},
            "spread": {"<component>": SIZE},
            "equivalent": [TEXT],
        }
    },
    "appraisers?": maybe(words("operator", "station")),
    "notes?": [TEXT],
    "drift_p_value?": maybe(SHARE),
    "drifts?": FLAG,
    "off_share?": SHARE,
    "settled?": FLAG,
    "quantities?": [
        {
            "key": TEXT,
            "unit": TEXT,
            "units": COUNT,
            "mean": NUMBER,
            "mean_sigma": SIZE,
            "spread": SIZE,
            "spread_interval": _INTERVAL,
            "noise": SIZE,
            "repeatability": maybe(SIZE),
            "repeatability_interval": maybe(_INTERVAL),
            "drift_per_1000": maybe(NUMBER),
            "drift_sigma": maybe(SIZE),
            "drift_p_value": maybe(SHARE),
            "stated_ratio": maybe(SIZE),
            "stated_p_value": maybe(SHARE),
        }
    ],
    "charts?": {
        "<quantity>": {
            "points": COUNT,
            "centre": NUMBER,
            "short_term": SIZE,
            "limit_sigmas": SIZE,
            "ewma_limit_sigmas": SIZE,
            "moving_range_limit": SIZE,
            "beyond_limit": COUNT,
            "alarms": [_ALARM],
            "ewma_beyond_limit": COUNT,
            "ewma_alarms": [_ALARM],
            "rules": [{"rule": TEXT, "found": COUNT, "by_chance": SIZE, "broken": FLAG}],
        }
    },
    "gauges?": {
        "<quantity>": {
            "ev": maybe(SIZE),
            "av": maybe(SIZE),
            "interaction": maybe(SIZE),
            "grr": maybe(SIZE),
            "pv": maybe(SIZE),
            "tv": maybe(SIZE),
            "percent_grr": maybe(SIZE),
            "percent_grr_interval": maybe(_INTERVAL),
            "percent_tolerance": maybe(SIZE),
            "ndc": maybe(SIZE),
            "ndc_interval": maybe(_INTERVAL),
            "verdict": words("acceptable", "marginal", "not acceptable", "not told"),
            "method": words("anova", "likelihood", "none"),
            "parts": COUNT,
            "sessions": COUNT,
            "why_not": maybe(TEXT),
            "anova": maybe(
                {
                    "pooled": FLAG,
                    "interaction_p_value": maybe(SHARE),
                    "rows": [
                        {"source": words("part", "appraiser", "interaction", "repeat"), "freedom": COUNT, "sum_of_squares": SIZE},
                    ],
                }
            ),
        }
    },
    "capabilities?": {
        "<quantity>": {
            "lower": maybe(NUMBER),
            "upper": maybe(NUMBER),
            "mean": NUMBER,
            "sigma": SIZE,
            "observed_sigma": SIZE,
            "within": _INDEX,
            "overall": _INDEX,
            "observed": _INDEX,
            "ppm_normal": SIZE,
            "ppm_tails": SIZE,
            "found_outside": COUNT,
            "units": COUNT,
            "false_accept_ppm": SIZE,
            "false_reject_ppm": SIZE,
            "guard_band": SIZE,
            "guarded_accept_ppm": SIZE,
            "guarded_reject_ppm": SIZE,
        }
    },
    "outliers_found?": COUNT,
    "outliers?": [
        {
            "serial": TEXT,
            "session": maybe(TEXT),
            "kind": words("unit", "session", "unit or session"),
            "p_value": SHARE,
            "reasons": [{"what": TEXT, "value": NUMBER, "sigmas": NUMBER}],
            "description": TEXT,
        }
    ],
}
_FLEET = {
    "run": {"done": COUNT, "failed": COUNT, "reused": COUNT},
    **dict.fromkeys(("folders", "sessions", "units", "done", "failed", "died", "unreadable"), COUNT),
    **dict.fromkeys(("passed", "undecided", "missed"), COUNT),
    "limit_deg": maybe(SIZE),
    "cpu_s": SIZE,
    "first_look": {f"{level}?": COUNT for level in LEVELS},
    "verdicts": {f"{verdict}?": COUNT for verdict in VERDICT.schema["enum"]},
    "effects": {"<id>": COUNT},
    "reasons": [{"step": TEXT, "reason": TEXT, "sessions": COUNT}],
    "failures": [{"folder": TEXT, "step": TEXT, "error": TEXT}],
    "distributions": [{"figure": TEXT, "sessions": COUNT, "quantiles": array(NUMBER, 5)}],
}

TABLES = {"tinygc-lot/2": _LOT, "tinygc-fleet/1": _FLEET}
