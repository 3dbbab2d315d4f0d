"""Truth files: attitudes from elsewhere as the reference of a recording."""

from session.base.features import Feature

FEATURE = Feature(serves={"reference": "points:TruthFiles", "section of session.toml": "reading:TruthGiven"})
