"""docs/formats/rates.md: what ``rates`` writes of a sensor on a rate table."""

from __future__ import annotations

from .shapes import COUNT, FLAG, NUMBER, SHARE, SIZE, TEXT, maybe, words

_NUMBER = {"name": TEXT, "value": maybe(NUMBER), "sigma": maybe(SIZE), "unit": TEXT, "between": maybe([NUMBER])}
_TERM = {
    "key": TEXT,
    "name": TEXT,
    "value": maybe(NUMBER),
    "sigma": maybe(SIZE),
    "at_most": maybe(SIZE),
    "unit": TEXT,
    "condition": TEXT,
}
_HELD_OUT = {"hypothesis": TEXT, "curve": TEXT, "fitted_to": TEXT, "points": COUNT, "rms": SIZE, "beyond": COUNT, "within_rms": maybe(SIZE)}
_SENSOR = {
    "sensor": TEXT,
    "unit": TEXT,
    "curves": [TEXT],
    "law": TEXT,
    "name": TEXT,
    "equation": TEXT,
    "parameters": [_NUMBER],
    "probability": SHARE,
    "p_value": SHARE,
    "rms": SIZE,
    "noise": maybe(SIZE),
    "line_rms": SIZE,
    "lack_of_fit": maybe({"p_value": SHARE, "noise": SIZE, "freedom": COUNT, "variance_inflation": SIZE}),
    "rivals": [{"name": TEXT, "probability": SHARE, "rms": SIZE}],
    "terms": [_TERM],
    "points": [{"curve": COUNT, "rate_dps": NUMBER, "output": NUMBER, "predicted": NUMBER, "limited": FLAG}],
    "held_out": [_HELD_OUT],
}
_SWEEP = {
    "name": TEXT,
    "model": words("flat", "first", "second"),
    "probability": SHARE,
    "gain": NUMBER,
    "gain_sigma": SIZE,
    "delay_s": NUMBER,
    "delay_sigma_s": SIZE,
    "latency_s": maybe(NUMBER),
    "bandwidth_hz": maybe(SIZE),
    "bandwidth_sigma_hz": maybe(SIZE),
    "bandwidth_at_least_hz": maybe(SIZE),
    "points": [dict.fromkeys(("frequency_hz", "gain", "gain_sigma"), SIZE) | {"phase_deg": NUMBER, "phase_sigma_deg": SIZE}],
}
TABLES = {
    "tinygc-rates/1": {"version": TEXT, "name": TEXT, "sensors": [_SENSOR], "sweeps": [_SWEEP], "remarks": [TEXT]},
}
