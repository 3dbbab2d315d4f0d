"""Why a segment is not used, in words that a report prints."""

from __future__ import annotations

#: why a segment is not used
LEFT_OUT, CLIPPED = "left out by request", "its rates stand at a ceiling"
