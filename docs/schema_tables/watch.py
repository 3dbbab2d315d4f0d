"""docs/formats/watch.md: the lines that ``watch`` writes, one for each event."""

from __future__ import annotations

from .shapes import COUNT, FLAG, NUMBER, SIZE, TEXT, VECTOR, maybe, words

_START = {
    "rate_hz?": SIZE,
    "window_s?": SIZE,
    "false_alarm_every_s?": SIZE,
    "zero_sigma_dps?": VECTOR,
    "window_sigma_dps?": VECTOR,
    "gravity_sigma_mg?": SIZE,
    "assumed?": [TEXT],
}
_ALARM = {
    "channel?": words("zero x", "zero y", "zero z", "gravity", "closure"),
    "channels?": [words("zero x", "zero y", "zero z", "gravity", "closure")],
    "sign?": words(1, -1),
    "kind?": words("step", "ramp", "step or ramp"),
    "began_s?": SIZE,
    "size_dps?": NUMBER,
    "size_mg?": NUMBER,
    "sigma_dps?": SIZE,
    "sigma_mg?": SIZE,
    "cost_deg?": SIZE,
    "zero_cost_deg?": SIZE,
    "advice?": TEXT,
}
_TURN = dict.fromkeys(("tilt_deg?", "sigma_deg?", "chi_square?", "seconds?", "angle_deg?"), SIZE)
_END = dict.fromkeys(("rests?", "short_rests?", "turns?", "alarms?"), COUNT) | {
    "rested_s?": SIZE,
    "counts?": {"<kind>": COUNT},
    "held?": maybe(FLAG),
}
TABLES = {
    "tinygc-watch/1": {
        "event": words("start", "rest", "turn", "alarm", "remark", "end"),
        "t_s": SIZE,
        "words": TEXT,
        **_START,
        "windows?": COUNT,
        "zero_dps?": VECTOR,
        "gravity_mg?": NUMBER,
        **_ALARM,
        **_TURN,
        "what?": TEXT,
        "count?": COUNT,
        **_END,
    },
}
