"""``noise record``: a rest log, and how long it has to be for the noise."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from session.base.options import option
from session.base.texts import command_line
from tinygc.cli.commands.record import EPILOG as EPILOG
from tinygc.cli.commands.record import run as run
from tinygc.cli.recording import Recording

if TYPE_CHECKING:
    from session.bench.guide import Guide
    from session.log.config import Protocol


@dataclass(frozen=True)
class Options(Recording):
    """Options of ``noise record``."""

    NAME = "noise record"
    TURNS = False

    hours: float | None = option(None, "how long (until it is stopped)", unit="h", above=0, most=1000)
    known_to: float = option(20.0, "how well N, and B or K, are to be known, in per cent", least=1, most=100, metavar="PERCENT")
    stop_at_target: bool = option(False, "stop as soon as they are known so well")

    def guide(self, protocol: Protocol) -> Guide:
        """Return the guide of a rest."""
        from session.bench.rest_guide import RestGuide
        from tinygc.features.noise.live import LiveNoise

        seconds = None if self.hours is None else self.hours * 3600
        return RestGuide(protocol, seconds, LiveNoise(self.known_to / 100), self.stop_at_target)

    def next(self, folder: Path) -> tuple[str, ...]:
        """Return the commands to go on with."""
        return (command_line("noise", folder),)
