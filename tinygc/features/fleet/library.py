"""Python interface of ``fleet`` and ``lot``: many sessions in one table, and the statistics of a lot of sensors."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.base.files import result_folder
from session.base.options import values
from session.base.results import write_text_whole
from tinygc.features.fleet.fleet_row import FleetOptions
from tinygc.features.fleet.fleet_run import FleetRun, Processes, run_fleet, session_folders
from tinygc.features.fleet.fleet_summary import Summary, fleet_facts, fleet_html, summarise, to_check
from tinygc.features.fleet.fleet_table import open_table, read_table
from tinygc.features.fleet.report import LotReport, lot_chapter, lot_if_any, lot_of_table, noise_chapters, unit_noises
from tinygc.features.fleet.work import LotOf, Run
from tinygc.library.arguments import public
from tinygc.library.records import Shown
from tinygc.reporting.facts import screen
from tinygc.reporting.terminal import Group

#: in the output folder of a fleet
TABLE, PAGE, LOT, LOT_PAGE = "fleet.sqlite", "fleet.html", "lot.json", "lot.html"


@dataclass(frozen=True, eq=False, repr=False)
class Fleet(Shown):
    """Result of ``tinygc.fleet``: folder of the table and the page; counts of this run, None where nothing was to be computed; summary of
    the whole table; the lot, None where its sensors are of several models or too few; offered: recordings of one unit, to be checked
    against each other."""

    out: Path
    tally: FleetRun | None
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
        return screen(fleet_facts(self.result, self.tally))

    def to_json(self) -> dict:
        """``tinygc-fleet/1`` (docs/formats.md)."""
        names = ("done", "failed", "reused")
        now = dict.fromkeys(names, 0) if self.tally is None else {name: getattr(self.tally, name) for name in names}
        return {"schema": "tinygc-fleet/1", "run": now, **self.result.to_json()}


def compute(
    folders: Iterable[Path],
    out: Path,
    options: Run,
    effects: Iterable[Path | str],  # a worker may have another working directory
    progress: Callable[[FleetRun], None],
) -> FleetRun:
    """Compute the sessions that are not in the table in ``out``, in processes (one for each core)."""
    with open_table(out) as table:
        executor = Processes(options.jobs or cores())
        try:
            how = FleetOptions(**values(options, Run), effects=tuple(map(os.path.abspath, effects)))
            return run_fleet(folders, table, executor, how, retry=options.retry, progress=progress)
        finally:
            executor.close()


def cores() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def summed_up(out: Path, tally: FleetRun | None, limit_deg: float | None) -> Fleet:
    """Sum up the table in ``out``, and write its page, and the lot's file where there is a lot."""
    with read_table(out) as table:
        summary, offered, lot = summarise(table, limit_deg), to_check(table), lot_if_any(table)
        noise = noise_chapters(unit_noises(table))
    with result_folder(out):
        write_text_whole(out / PAGE, fleet_html(summary, [*([lot_chapter(lot)] if lot else []), *noise]))
    if lot:
        lot.save(out / LOT)
    return Fleet(out, tally, summary, lot, offered)


def no_session(places: Iterable[Path]) -> CalibrationError:
    """Return the error of places without a session folder."""
    return CalibrationError(f"{', '.join(map(str, places))}: no session folder there; one holds session.toml and log*.csv")


@public(Run)
def fleet(
    folders: Path | str | Sequence[Path | str],
    out: Path | str,
    *,
    effects: Sequence[Path | str] = (),
    progress: Callable[[Any], None] | None = None,
    **choices: Any,
) -> Fleet:
    """Check, fit and explain many sessions, each once, into one table and one page.

    Processes import the main module: a script calls this under ``if __name__ == "__main__":``.

    Parameters
    ----------
    folders : str, Path or sequence of them
        Where session folders lie, at any depth; none to sum up the table that is there.
    out : str or Path
        Folder of the table (fleet.sqlite), the page, and the lot's file.
    effects : sequence of str or Path, optional
        Folders with further effects.
    progress : callable, optional
        Called with the counts so far: ``done``, ``failed``, ``reused``.

    Returns
    -------
    Fleet
        ``result`` (counts, distributions, failures), ``lot``, ``files``, ``summary()``, ``to_json()``.

    Raises
    ------
    CalibrationError
        For folders without a session; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> found = tinygc.fleet("data", "fleet", steps=("check", "fit"))  # doctest: +SKIP
    >>> found.result.passed  # doctest: +SKIP

    """
    places = [Path(each) for each in ([folders] if isinstance(folders, str | os.PathLike) else folders)]
    options, tally, folder = Run(**choices), None, Path(out)
    if places:
        tally = compute(session_folders(places), folder, options, effects, progress or (lambda tally: None))
        if not tally.folders:
            raise no_session(places)
    return summed_up(folder, tally, options.limit_deg)


@public(LotOf)
def lot(table: Path | str, **choices: Any) -> LotReport:
    """Compute the statistics of a lot of sensors: mean, spread, drift, units that do not belong.

    Parameters
    ----------
    table : str or Path
        The folder that ``fleet`` wrote, or its fleet.sqlite.

    Returns
    -------
    LotReport
        ``quantities``, ``outliers``, ``drifts``, ``summary()``, ``to_json()``; ``save(path)`` writes the lot's file for
        ``fit(…, lot=path)``, ``save_page(path)`` a page.

    Raises
    ------
    CalibrationError
        For a table that cannot be read, or has fewer than two fitted units.

    Examples
    --------
    >>> import tinygc
    >>> tinygc.lot("fleet").save("lot.json")  # doctest: +SKIP

    """
    folder = Path(table).parent if Path(table).name == TABLE else Path(table)
    with read_table(folder) as opened:
        return replace(lot_of_table(opened, LotOf(**choices).model), noise=unit_noises(opened))
