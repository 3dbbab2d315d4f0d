"""``rates record``: steps of known rates, which a machine turns."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.options import numbers, option
from session.base.texts import command_line
from tinygc.cli.commands.record import EPILOG as EPILOG
from tinygc.cli.commands.record import run as run
from tinygc.cli.recording import Recording
from tinygc.features.tables.record_command import Machine, opened

if TYPE_CHECKING:
    from session.bench.guide import Guide
    from session.log.config import Protocol


@dataclass(frozen=True)
class Options(Recording, Machine):
    """Options of ``rates record``."""

    NAME = "rates record"
    TURNS = False

    rates: tuple[float, ...] = option(..., "of the steps", unit="dps", above=0, most=1e5, metavar="DPS,DPS", read=numbers)
    dwell: float = option(10.0, "of a rate", unit="s", least=0, most=3600)
    axis: str | None = option(None, "the axis that turns (the innermost one)")

    @contextlib.contextmanager
    def machine(self, folder: Path, port: str) -> Iterator[Any]:
        """Yield the table, its plan confirmed."""
        with opened(self, folder, port) as machine:
            machine.confirmed_rates(self.rates, self.dwell, self.axis, self.yes, self.quiet)
            yield machine

    def guide(self, machine: Any, protocol: Protocol) -> Guide:
        """Return the guide of the steps."""
        guide: Guide = machine.guide(protocol)
        return guide

    def next(self, folder: Path) -> tuple[str, ...]:
        """Return the commands to go on with."""
        return (command_line("rates", folder),)
