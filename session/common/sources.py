"""Who gave a board's samples, as its frames, the logs' comments and session.toml call it."""

from __future__ import annotations

STANDIN_NAME, SENSOR_NAME = "stand-in", "sensor"
