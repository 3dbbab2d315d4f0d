"""``fleet``: check, fit and explain hundreds to hundreds of thousands of sessions, each once."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.options import argument, file_written, folder_written, option, part
from session.base.texts import command_line, significant
from tinygc.cli.arguments import STANDARD
from tinygc.cli.options import Command, Force, UsesEffects
from tinygc.cli.results import complain, output, print_commands, verdict, write_json
from tinygc.features.fleet.work import LotOf, Run

if TYPE_CHECKING:
    from tinygc.features.fleet.fleet_run import FleetRun


# Progress of a fleet: done, failed, reused, rate and time left; a bar on a terminal, else a line now and then.

#: s between two updates, on a terminal and elsewhere
OFTEN_S, SELDOM_S = 0.2, 30.0


@contextmanager
def metered(quiet: bool, folders: Callable[[], Iterable[Any]] | None) -> Iterator[Callable[[FleetRun], None]]:
    """Yield what shows each new tally, at most once per interval.  The folders are counted in a thread, so that the first does not wait."""
    from tinygc.reporting.terminal import progress_bar

    every_s = OFTEN_S if sys.stderr.isatty() else SELDOM_S
    began = last = time.monotonic()
    found, counted, ended = 0, False, False

    def count() -> None:
        nonlocal found, counted
        with suppress(Exception):  # the run meets the same error and reports it
            for _ in folders():  # type: ignore[misc]
                found += 1
                if ended:
                    return
            counted = True

    def update(tally: FleetRun) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < every_s:
            return
        last = now
        # 812 done, 1 failed, 90 reused, 7.2/s, 20 min left; the rate counts computed sessions only
        rate = (tally.done + tally.failed) / (now - began) if now > began else 0.0
        text = f"{tally.done} done, {tally.failed} failed, {tally.reused} reused, {significant(rate)}/s"
        if counted and rate > 0:
            left_s = max(found - tally.folders, 0) / rate
            size, unit = (1, "s") if left_s < 100 else (60, "min") if left_s < 6000 else (3600, "h")
            text += f", {significant(left_s / size, 2)} {unit} left"
        show(text, tally.folders, max(found, tally.folders, 1))

    with progress_bar(quiet) as show:
        if folders is not None and not quiet:
            threading.Thread(target=count, daemon=True).start()
        try:
            yield update
        finally:
            ended = True


# ``fleet``: check, fit and explain hundreds to hundreds of thousands of sessions, each once, into one table.


@dataclass(frozen=True)
class Options(Run, LotOf, Command, UsesEffects, Force):
    """Options of ``fleet``."""

    folders: tuple[Path, ...] = argument("where session folders lie, at any depth", (), metavar="DIR")
    listed: Path | None = option(None, "a list of session folders, one a line (- for standard input)", flags=("--from",))
    out: Path = option(..., "where fleet.sqlite and fleet.html go; without DIR, renewed", metavar="OUT", read=folder_written)
    lot: bool = option(
        False,
        "print how the lot of OUT spreads, drifts and repeats, and which units do not belong, and write lot.json, for fit --lot, and "
        "lot.html",
    )
    csv: Path | None = option(None, "write the table as CSV, too (- for standard output)", read=file_written)
    strict: bool = option(False, "exit 1 if a session failed; with --lot, if the lot drifts, or a unit does not belong")


def run(args: Options) -> int:
    """Compute the missing sessions, then print a summary of the table."""
    from tinygc.features.fleet.library import LOT, PAGE, summed_up

    if args.model is not None and not args.lot:
        raise CalibrationError("--model goes with --lot; add it, or leave --model out")
    computes = bool(args.folders) or args.listed is not None
    if args.lot:
        of_run = ("listed", *(each.name for each in fields(Run) if each.name != "limit_deg")) if computes else ()
        args.refuse_with("--lot", "lot", "out", "model", "strict", "force", *of_run)
    tally = _computed(args) if computes else None
    if args.lot:
        return _lot(args)
    found = summed_up(args.out, tally, args.limit_deg)
    summary, page = found.result, args.out / PAGE
    _write_csv(args)
    output(args).print(found.page)
    output(args).print(f"written: {', '.join(map(str, found.files))}")
    if found.lot is None and (args.out / LOT).exists():
        complain(f"{LOT}: not renewed (several models, or too few units); --lot writes it")
    commands = [command_line("explain", first, "--check-on", *others) for first, others in found.offered]
    if commands:
        print_commands(args, "next: check these effects in the units' other sessions", *commands)
    write_json(args.json, found.to_json())
    if args.limit_deg is not None and summary.missed:
        complain(f"FAIL with --limit {args.limit_deg:g} deg: {summary.missed} of {summary.fitted} fitted sessions")
    if args.strict and summary.all_failed:
        complain(f"failed: {summary.all_failed} of {summary.sessions + summary.unreadable} sessions, listed in {page}")
    return 1 if (args.limit_deg is not None and summary.missed) or (args.strict and summary.all_failed) else 0


def _lot(args: Options) -> int:
    """Print and write the statistics of the lot."""
    from tinygc.features.fleet.library import LOT, LOT_PAGE, lot
    from tinygc.features.fleet.report import headline

    found = lot(args.out, model=args.model)
    output(args).print(found.page)
    verdict(args, headline(found))
    files = [found.save(args.out / LOT), found.save_page(args.out / LOT_PAGE)]
    output(args).print(f"written: {', '.join(map(str, files))}")
    write_json(args.json, found.to_json())
    return 1 if args.strict and (found.drifts or found.outliers) else 0


def _computed(args: Options):  # type: ignore[no-untyped-def]  # a FleetRun: its module is heavy
    """Run the fleet; raises CalibrationError where there is no session at all."""
    from tinygc.features.fleet.library import compute, no_session

    count = None if str(args.listed) == STANDARD else lambda: _folders(args)  # a pipe can be read only once
    with metered(args.quiet, count) as meter:
        tally = compute(_folders(args), args.out, part(args, Run), args.effects, meter)
    if not tally.folders:
        raise no_session([*args.folders, *([args.listed] if args.listed else [])])
    return tally


def _folders(args: Options) -> Iterator[Path]:
    """Yield the sessions of the folders, then those of the list."""
    from session.base.files import open_file
    from tinygc.features.fleet.fleet_run import listed_folders, session_folders

    yield from session_folders(args.folders)
    if args.listed is None:
        return
    if str(args.listed) == STANDARD:
        yield from listed_folders(sys.stdin)
        return
    with open_file(args.listed) as file:
        yield from listed_folders(os.fsdecode(line) for line in file)


def _write_csv(args: Options) -> None:
    from session.base.results import whole
    from tinygc.cli.results import standard_output
    from tinygc.features.fleet.fleet_summary import write_csv
    from tinygc.features.fleet.fleet_table import read_table

    if args.csv is None:
        return
    with read_table(args.out) as table:
        if str(args.csv) == STANDARD:
            with standard_output():
                write_csv(table, sys.stdout)
            return
        with whole(args.csv) as binary:
            file = TextIOWrapper(binary, encoding="utf-8", newline="")
            write_csv(table, file)
            file.detach()
