"""Python interface of ``fleet`` and ``lot``: many sessions in one table, and the statistics of a lot of sensors."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from session.base.errors import CalibrationError
from tinygc.features.fleet.fleet_page import save as save_fleet_page
from tinygc.features.fleet.fleet_row import FleetOptions
from tinygc.features.fleet.fleet_run import Cluster, Processes, Tally, run_fleet, session_folders
from tinygc.features.fleet.fleet_summary import Summary, lot_if_any, lot_of_table, summarise, to_check
from tinygc.features.fleet.fleet_table import open_table, read_table
from tinygc.features.fleet.page import lot_sections
from tinygc.features.fleet.page import save as save_lot_page
from tinygc.features.fleet.report import LotReport, save, to_json
from tinygc.features.fleet.rest_noise import noise_section, unit_noises
from tinygc.features.fleet.text import fleet_page, lot_page
from tinygc.library.records import Shown
from tinygc.noise.figures import NoiseFigures
from tinygc.reporting.terminal import Group

#: in the output folder of a fleet
TABLE, PAGE, LOT = "fleet.sqlite", "fleet.html", "lot.json"


@dataclass(frozen=True, eq=False, repr=False)
class Fleet(Shown):
    """Result of ``tinygc.fleet``: folder of the table and the page; counts of this run, None where nothing was to be computed; summary of
    the whole table; the lot, None where its sensors are of several models or too few; offered: recordings of one unit, to be checked
    against each other."""

    out: Path
    tally: Tally | None
    result: Summary
    lot: LotReport | None
    offered: list[tuple[str, list[str]]]

    def __repr__(self) -> str:
        return f"<Fleet of {self.result.sessions} sessions in {self.out}>"

    @property
    def files(self) -> list[Path]:
        """The table, the page, and the lot's file where there is a lot."""
        return [self.out / TABLE, self.out / PAGE, *([self.out / LOT] if self.lot else [])]

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        return fleet_page(self.result, self.tally)

    def to_json(self) -> dict:
        """``tinygc-fleet/1`` (docs/formats.md)."""
        names = ("done", "failed", "reused")
        now = dict.fromkeys(names, 0) if self.tally is None else {name: getattr(self.tally, name) for name in names}
        return {"schema": "tinygc-fleet/1", "run": now, **self.result.to_json()}


def compute(
    folders: Iterable[Path],
    out: Path,
    options: FleetOptions,
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
    retry: bool = False,
    progress: Callable[[Tally], None] = lambda tally: None,
) -> Tally:
    """Compute the sessions that the table in ``out`` lacks, in processes (one for each core) or on the cluster of a scheduler."""
    with open_table(out) as table:
        executor = Cluster(scheduler) if scheduler else Processes(jobs or cores())
        try:
            return run_fleet(folders, table, executor, options, retry=retry, progress=progress)
        finally:
            executor.close()


def cores() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def summed_up(out: Path, tally: Tally | None, limit_deg: float | None) -> Fleet:
    """Sum up the table in ``out``, and write its page, and the lot's file where there is a lot."""
    with read_table(out) as table:
        summary, offered, lot = summarise(table, limit_deg), to_check(table), lot_if_any(table)
        noise = noise_section(unit_noises(table))
    save_fleet_page(summary, out / PAGE, [*(lot_sections(lot) if lot else ()), *([] if noise is None else [noise])])
    if lot:
        save(lot, out / LOT)
    return Fleet(out, tally, summary, lot, offered)


def fleet(
    folders: Iterable[Path],
    out: Path,
    options: FleetOptions,
    *,
    jobs: int | None,
    scheduler: str | None,
    retry: bool,
    limit_deg: float | None,
    progress: Callable[[Tally], None],
) -> Fleet:
    """Compute the session folders in these, and sum them up; without a folder, sum up the table that is there.

    Raises CalibrationError where there is no session folder in them, and the errors of the table.
    """
    places = list(folders)
    tally = None
    if places:
        tally = compute(session_folders(places), out, options, jobs=jobs, scheduler=scheduler, retry=retry, progress=progress)
        if not tally.folders:
            raise no_session(places)
    return summed_up(out, tally, limit_deg)


def no_session(places: Iterable[Path]) -> CalibrationError:
    """Return the error of places without a session folder."""
    return CalibrationError(f"{', '.join(map(str, places))}: no session folder there; one holds session.toml and log*.csv")


@dataclass(frozen=True, eq=False, repr=False)
class LotStatistics(Shown):
    """Result of ``tinygc.lot``; ``result`` holds all numbers; noise: at rest of the units whose figures are known."""

    result: LotReport
    noise: Sequence[NoiseFigures] = ()

    def __repr__(self) -> str:
        return f"<LotStatistics: {len(self.result.outliers)} outliers>"

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        return lot_page(self.result)

    def to_json(self) -> dict:
        """``tinygc-lot/3`` (docs/formats.md)."""
        return to_json(self.result)

    def save(self, path: Path | str) -> Path:
        """Write the lot's file, for ``tinygc.fit(…, lot=path)``; returns the path."""
        save(self.result, path)
        return Path(path)

    def save_page(self, path: Path | str) -> Path:
        """Write a page; returns the path."""
        noise = noise_section(self.noise)
        return save_lot_page(self.result, Path(path), [] if noise is None else [noise])


def lot(table: Path, *, model: str | None) -> LotStatistics:
    """Compute the statistics of a fleet's table: the folder of ``fleet``, or its fleet.sqlite."""
    folder = table.parent if table.name == TABLE else table
    with read_table(folder) as opened:
        return LotStatistics(lot_of_table(opened, model), unit_noises(opened))
