"""The equation that no catalogue has."""

from session.base.features import Feature

FEATURE = Feature(
    serves={
        "search beyond the catalogue": "points",
        "report section": "report_section",
        "earlier results of a report": "report_section:searched",
    },
)
