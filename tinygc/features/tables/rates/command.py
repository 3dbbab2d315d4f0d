"""``rates``: scale, nonlinearity and clipping of a sensor on a rate table, of points in a CSV."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import argument, folder_written, option, values
from tinygc.cli.options import Command, Pictures
from tinygc.cli.results import keep, output, try_destinations
from tinygc.features.tables.feature import Columns


@dataclass(frozen=True)
class Options(Columns, Pictures, Command):
    """Options of ``rates``."""

    source: Path = argument("a CSV of rates and mean outputs", metavar="FILE")
    verbose: bool = option(False, "print all numbers of several sensors, and what other laws leave")
    out: Path | None = option(None, "where rates.json, rates.html and rates.svg go", metavar="DIR", read=folder_written)


def run(args: Options) -> int:
    """Choose the law of each sensor, print it with the terms of IEEE 1431, and write rates.json, rates.html and rates.svg."""
    from tinygc.features.tables.rates.library import FILE, PAGE, PICTURE, estimate_rates
    from tinygc.reporting.terminal import progress_bar

    try_destinations(args.out, args.json)
    with progress_bar(args.quiet) as progress:
        found = estimate_rates(args.source, progress=progress, **values(args, Columns))
    output(args).print(found.screen(args.verbose))
    keep(args, found, args.out, FILE, PAGE, PICTURE)
    return 0
