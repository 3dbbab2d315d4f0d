"""The stills of a session's logs and closure runs, each looked for once, whoever asks for them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from session.detect.stills import Noise, Still, find_stills
from session.detect.unused_rests import UnusedRest, unused_rests
from session.log.folder import Session
from session.log.logfile import Log
from session.log.samples import Samples

#: calibrations whose matrices differ by less find the same stills: a scatter moves by 1 %, and ends a still at 2.4 times the noise's
NEARLY = 0.01


@dataclass(frozen=True, eq=False)
class LogStills:
    """One log: samples with the accelerometer's pre-calibration applied, stills in them, their noise (None where nothing is still);
    still_s: how long a still should be, s."""

    samples: Samples
    stills: list[Still]
    noise: Noise | None
    still_s: float = 1.0

    @cached_property
    def unused(self) -> list[UnusedRest]:
        """Rests that are no reference, with their reasons; looked for when they are first asked for."""
        return unused_rests(self.samples, self.stills, self.still_s)


class SessionStills:
    """Made once where a session is read, and handed on: to the first look, the problem, the closure runs."""

    def __init__(self, session: Session, known: SessionStills | None = None):
        """known: of the same session before some of its logs were mended; the others are not looked at again."""
        self._session = session
        self._found: list[tuple[Log, LogStills]] = [] if known is None else list(known._found)

    def under(self, session: Session) -> SessionStills:
        """Of the same logs under another calibration of the accelerometer: the same stills where it is nearly the one before, else to be
        looked for anew, since the scatter of each axis decides what is still."""
        return self.recalibrated(session) if abs(self._change(session) - np.eye(3)).max() < NEARLY else SessionStills(session)

    def recalibrated(self, session: Session) -> SessionStills:
        """The same stills of the same logs under another calibration: their means and the scatter of independent axes follow it."""
        other = SessionStills(session)
        before, after = self._session.config.accelerometer, session.config.accelerometer
        squares = self._change(session) ** 2

        def scatter(sigma: np.ndarray) -> np.ndarray:
            return np.asarray(np.sqrt(squares @ sigma**2))

        for log, found in self._found:
            stills = [
                replace(still, accel_mean=after.correct(before.measured(still.accel_mean)), accel_std=scatter(still.accel_std))
                for still in found.stills
            ]
            noise = found.noise and replace(found.noise, accel=scatter(found.noise.accel))
            again = LogStills(session.calibrated(log), stills, noise, found.still_s)
            if "unused" in found.__dict__:
                again.__dict__["unused"] = found.unused
            other._found.append((log, again))
        return other

    def _change(self, session: Session) -> np.ndarray:
        """(3, 3): what the other calibration makes of a specific force under this one, but for an offset."""
        return np.asarray(session.config.accelerometer.matrix @ np.linalg.inv(self._session.config.accelerometer.matrix))

    def samples(self) -> list[Samples]:
        """Of each log that was looked at."""
        return [found.samples for _, found in self._found]

    def of(self, log: Log) -> LogStills:
        """What is found in a log or closure run of the session: looked for when it is first asked for."""
        for looked_at, found in self._found:
            if looked_at is log:
                return found
        samples, still_s = self._session.calibrated(log), self._session.config.protocol.still_s
        found = LogStills(samples, *find_stills(samples, still_s), still_s)
        self._found.append((log, found))
        return found
