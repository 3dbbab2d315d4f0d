"""Many sessions in one table, and a lot of sensors as the prior of one unit."""

from session.base.features import Feature

FEATURE = Feature(
    commands={"fleet": "fleet_command", "lot": "command"},
    public={"fleet": "library", "lot": "library"},
    serves={"prior of a fit": "fit"},
)
