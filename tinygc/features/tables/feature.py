"""Machines that turn the table: makes, limits, sessions that they turn, rate steps, and the table's own errors."""

from session.base.features import Feature

FEATURE = Feature(
    commands={
        "table": "command",
        "table record": "record_command",
        "rates": "rates.command",
        "rates record": "rates.record_command",
    },
    public={"estimate_rates": "rates.library"},
    serves={
        "options of board": "options:TableOptions",
        "table under a virtual board": "board:table_under",
        "explanation of what turned": "points:explained",
    },
)
