"""First looks at sessions, and what they say of one thing."""

from dataclasses import replace

from session.detect.first_look import first_look
from session.detect.stills import find_stills

G = 9.80665


def look(session, **changes):
    """First look at the session's log with some of its samples' fields, or the whole log, changed."""
    log = changes.pop("log", session.logs[0])
    log = replace(log, samples=replace(log.samples, **changes))
    session = replace(session, logs=(log,))
    stills, noise = find_stills(session.calibrated(log), session.config.protocol.still_s)
    return first_look(session, log, stills, noise)


def of(findings, what):
    (finding,) = [finding for finding in findings if finding.what == what]
    return finding


def serious(findings):
    return {(finding.what, finding.level) for finding in findings if finding.level in ("warning", "error")}


def with_sensor(session, **changes):
    return replace(session, config=replace(session.config, sensor=replace(session.config.sensor, **changes)))
