"""docs/formats/lots.md: lots and fleets.  The table of a fleet is SQLite."""

from __future__ import annotations

from .commands import LEVELS
from .explain import VERDICT
from .shapes import COUNT, FLAG, NUMBER, SHARE, SIZE, TEXT, array, maybe

_SIGMAS = array(maybe(SIZE), 21)
_LOT = {
    "version": TEXT,
    "sensor": TEXT,
    "units": COUNT,
    "sessions": COUNT,
    "names": array(TEXT, 21),
    "mean": array(maybe(NUMBER), 21),
    "mean_sigma": _SIGMAS,
    "spread": _SIGMAS,
    "repeatability": _SIGMAS,
    "notes?": [TEXT],
    "drift_p_value?": maybe(SHARE),
    "drifts?": FLAG,
    "quantities?": [
        {
            "key": TEXT,
            "unit": TEXT,
            "units": COUNT,
            "mean": NUMBER,
            "mean_sigma": SIZE,
            "spread": SIZE,
            "repeatability": maybe(SIZE),
            "drift_per_1000": maybe(NUMBER),
            "drift_sigma": maybe(SIZE),
            "drift_p_value": maybe(SHARE),
        }
    ],
    "outliers_found?": COUNT,
    "outliers?": [
        {
            "serial": TEXT,
            "session": TEXT,
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

TABLES = {"tinygc-lot/3": _LOT, "tinygc-fleet/1": _FLEET}
