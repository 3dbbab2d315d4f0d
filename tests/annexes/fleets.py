"""Fleets for the tests: a few short sessions, an executor without processes, and what a table holds."""

from __future__ import annotations

import sqlite3
from collections import deque
from pathlib import Path

from tinygc.annexes.lots.fleet_row import FleetOptions
from tinygc.annexes.lots.fleet_run import Finished, Tally, run_fleet, session_folders
from tinygc.annexes.lots.fleet_session import Job, compute
from tinygc.annexes.lots.fleet_table import NAME, open_table
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

QUICK, FIT = FleetOptions(steps=("check",)), FleetOptions(steps=("check", "fit"))


def made(where: Path, count: int = 4, segments: int = 8) -> Path:
    """A folder with so many sessions, each of a unit of its own."""
    for seed in range(count):
        write_session(SimulationOptions(segments=segments, closure_s=0.0, odr_hz=104.0, seed=seed), where / f"unit{seed}")
    return where


class Here:
    """Computes in this very process; ``computed``: what it was given."""

    capacity = 1

    def __init__(self) -> None:
        self.computed: list[Job] = []
        self._queue: deque[Job] = deque()

    def submit(self, job: Job) -> None:
        self._queue.append(job)

    def finished(self) -> list[Finished]:
        job = self._queue.popleft()
        self.computed.append(job)
        return [Finished(job, compute(job))]

    def close(self) -> None:
        pass


def ran(place: Path, out: Path, options: FleetOptions = QUICK, executor=None, **how) -> tuple[Tally, list[str]]:
    """The tally of a run, and the names of the folders that were computed for it."""
    executor = executor or Here()
    with open_table(out) as table:
        tally = run_fleet(session_folders([place]), table, executor, options, **how)
    return tally, [Path(job.folder).name for job in getattr(executor, "computed", ())]


def asked(out: Path, sql: str) -> list[tuple]:
    """Of the table."""
    connection = sqlite3.connect(out / NAME)
    try:
        return connection.execute(sql).fetchall()
    finally:
        connection.close()


def content(out: Path) -> dict[str, list[tuple]]:
    """All that is compared: results and folders, whoever computed them, in whatever order."""
    return {name: asked(out, f"SELECT * FROM {name} ORDER BY 1") for name in ("results", "folders")}
