"""A gyroscope alone, by turns of known angle."""

from session.base.features import Feature

FEATURE = Feature(
    public={"fit_turns": "library", "TurnFit": "library"},
    serves={"fit of a folder": "command:fit", "import of logs": "points:import_logs"},
)
