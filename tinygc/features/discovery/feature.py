"""The equation that no catalogue has."""

from session.base.features import Feature

FEATURE = Feature(
    serves={
        "options of explain": "options:SearchOptions",
        "explanation of a folder": "points:before",
        "search beyond the catalogue": "points:search",
        "report beyond the catalogue": "points:report",
        "report section": "report_section",
        "earlier results of a report": "report_section:searched",
    },
)
