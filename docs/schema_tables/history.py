"""docs/formats/history.md: what ``history`` writes of one unit over its sessions."""

from __future__ import annotations

from .shapes import COUNT, FLAG, NUMBER, SHARE, SIZE, TEXT, maybe, words

_NUMBER = {
    "name": TEXT,
    "component": TEXT,
    "unit": TEXT,
    "sessions": [COUNT],
    "values": [NUMBER],
    "sigmas": [SIZE],
    "level": maybe(NUMBER),
    "level_sigma": maybe(SIZE),
    "scatter": maybe(SIZE),
    "scatter_low": maybe(SIZE),
    "scatter_high": maybe(SIZE),
    "freedom": maybe(COUNT),
    "drift": maybe(NUMBER),
    "drift_sigma": maybe(SIZE),
    "drift_at_most": maybe(SIZE),
    "drift_p": maybe(SHARE),
    "drifts": maybe(FLAG),
    "drift_or_step_after": maybe(COUNT),
    "step_at_most": maybe(SIZE),
    "per_kelvin": maybe(NUMBER),
    "per_kelvin_sigma": maybe(SIZE),
    "per_kelvin_at_most": maybe(SIZE),
    "follows_temperature": maybe(FLAG),
}
_STEP = {
    "name": TEXT,
    "component": TEXT,
    "unit": TEXT,
    "after": TEXT,
    "before": TEXT,
    "size": NUMBER,
    "sigma": SIZE,
    "p_value": SHARE,
}
_REQUIREMENT = {
    "requirement": TEXT,
    "limit_deg": maybe(SIZE),
    "seconds": maybe(SIZE),
    "answer": words("holds", "does not hold", "undecided"),
    "until": maybe(TEXT),
    "beyond": FLAG,
    "reason": TEXT,
    "years": [SIZE],
    "shares": [SHARE],
}
_UNIT = {
    "model": TEXT,
    "serial": TEXT,
    "dated": FLAG,
    "span_years": maybe(SIZE),
    "drift_per": words("year", "session"),
    "sessions": [
        {
            "session": TEXT,
            "date": maybe(TEXT),
            "date_from": maybe(words("port", "notes", "stamps", "name", "given")),
            "temperature_c": maybe(NUMBER),
        }
    ],
    "numbers": [_NUMBER],
    "steps": [_STEP],
    "accelerometer_any_session": maybe([{"name": TEXT, "component": TEXT, "unit": TEXT, "sigma": SIZE}]),
    "bias_any_session": maybe({"spread_dps": [SIZE], "degrees_of_freedom": [maybe(COUNT)], "sigma_dps": [SIZE], "source": TEXT}),
    "requirements": [_REQUIREMENT],
    "remarks": [TEXT],
}
TABLES = {"tinygc-history/1": {"version": TEXT, "units": [_UNIT], "remarks": [TEXT]}}
