"""docs/formats/lots.md: lots and fleets.  The table of a fleet is SQLite."""

from __future__ import annotations

from .commands import LEVELS
from .explain import VERDICT
from .shapes import COUNT, NUMBER, SIZE, TEXT, array, maybe

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

TABLES = {"tinygc-fleet/1": _FLEET}
