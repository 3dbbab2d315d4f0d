"""Machines that turn the table: makes, limits, sessions that they turn, rate steps, and the table's own errors."""

from session.base.features import Feature

FEATURE = Feature(
    commands={"table": "command", "rates": "rates.command"},
    public={"estimate_rates": "rates.library"},
    serves={
        "machine of a recording": "recording",
        "table under a virtual board": "board:TableUnderBoard",
        "explanation of what turned": "explanation:explain_table",
    },
)
