"""Who computes: what ``run.py`` asks of processes and clusters alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tinygc.fleet.compute import Job, Outcome


@dataclass(frozen=True)
class Finished:
    """Of a job: its outcome; or None where the process that computed it ended, and died says how."""

    job: Job
    outcome: Outcome | None
    died: str = ""


class Executor(Protocol):
    """Takes ``capacity`` jobs at a time."""

    @property
    def capacity(self) -> int:
        """How many jobs may be under way, so that nobody waits for work."""

    def submit(self, job: Job) -> None:
        """Begin a job, or queue it."""

    def finished(self) -> list[Finished]:
        """Wait until at least one of them has come to an end."""

    def close(self) -> None:
        """Stop whatever is under way."""
