"""The place of a machine in a guided recording: it turns the table where an operator would.

The loop of ``GuidedRecording`` calls ``step`` in each round, behind the guide and the coach.  A mover makes the turn that the guide waits
for; the guide finds stills and turns in the sensor's samples as ever.  ``wants`` asks for a decision of the recording, as the guide's does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from session.bench.events import Event
from session.bench.messages import GuideMessage

if TYPE_CHECKING:
    from session.bench.guide import Guide


@dataclass(frozen=True)
class Moment:
    """Where the recording stands.  log: name of the log that is being written, empty while there is none; t_us: device time of the last
    samples; host_ns: when they arrived, monotonic clock."""

    log: str
    t_us: int
    host_ns: int


class Mover(Protocol):
    """Turns the table.  wants: a decision for the recording, until the next ``step``."""

    wants: Event | None

    def step(self, guide: Guide, moment: Moment | None, coaching: bool) -> list[GuideMessage]:
        """Begin what the guide waits for, never wait; moment: None before the first samples; coaching: whether advice is still to come."""
        ...

    def stop(self) -> None:
        """Bring the machine to rest at once, and begin nothing before the recording goes on."""

    def close(self) -> None:
        """The recording ends: bring the machine to rest and let go of it."""
