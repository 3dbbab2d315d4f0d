"""Logs of a board that had no sensor (docs/boards.md): made up, or played to it."""

from __future__ import annotations

from session.checks.findings import Finding
from session.common.sources import SENSOR_NAME, STANDIN_NAME
from session.log.logfile import Log

#: as the board's comment in a log says who gave the samples
SOURCE = "source"


def check_standin(logs: tuple[Log, ...]) -> list[Finding]:
    """A warning for each log or closure run without a sensor; an error where others are of one: together they calibrate nothing."""
    found = [log for log in logs if log.comments.get(SOURCE) == STANDIN_NAME]
    real = next((log.path.name for log in logs if log.comments.get(SOURCE) == SENSOR_NAME), None)
    says = "the board had no sensor: these samples are made up, or were played to it"
    if real is None:
        return [Finding("warning", log.path.name, "sensor", says, "look at the board's wiring, and record again") for log in found]
    return [Finding("error", log.path.name, "sensor", f"{says}; {real} is a sensor's", "take it out of the folder") for log in found]
