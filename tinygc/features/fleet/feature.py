"""Many sessions in one table, and a lot of sensors as the prior of one unit."""

from session.base.features import Feature

FEATURE = Feature(
    commands={"fleet": "command"},
    public={"fleet": "library", "lot": "library"},
    serves={
        "options of a fit": "options:LotOptions",
        "spread of a production lot": "points:spread",
        "prior of a fit": "points:prior",
        "fitted sessions of a table": "points:fitted_sessions",
    },
)
