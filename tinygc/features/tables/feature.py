"""Machines that turn the table: makes, limits, sessions that they turn, rate steps, and the table's own errors."""

from session.base.features import Feature

FEATURE = Feature(
    commands={
        "table": ("command", "a table that turns by itself: makes, description, where it is, home, turn, stop; a virtual one"),
        "table record": ("record_command", "record a session that a machine turns; the plan is printed, and confirmed once"),
        "rates": (
            "rates.command",
            "rate steps and sine sweeps of a rate table: the law of the output, the terms of IEEE 1431, bandwidth and delay",
        ),
        "rates record": (
            "rates.record_command",
            "record steps of known rates, in both senses, which a machine turns; their log is rates0001.csv",
        ),
    },
    public={"estimate_rates": "rates.library"},
    serves={
        "options of board": "options:TableOptions",
        "table under a virtual board": "board:table_under",
        "explanation of what turned": "points:explained",
    },
)
