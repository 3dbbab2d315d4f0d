"""A gyroscope alone, by turns of known angle."""

from session.base.features import Feature

FEATURE = Feature(
    public={"fit_turns": "library", "TurnFit": "library"},
    serves={
        "kind of folder": "points:kind_of_folder",
        "further reference": "names:TURNS",
        "fit of a folder": "command:fit",
        "options of import": "options:ImportOptions",
        "import of logs": "points:import_logs",
    },
)
