"""``rates``: scale, nonlinearity, clipping and bandwidth of a sensor on a rate table, of points in a CSV or of a recording."""

from __future__ import annotations

import argparse

from session.base.options import folder_written, path_read
from tinygc.cli.arguments import count
from tinygc.cli.results import output, try_destinations, write_json

SUMMARY = "rate steps and sine sweeps of a rate table: the law of the output, the terms of IEEE 1431, bandwidth and delay"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    what = "a CSV of rates and mean outputs, of frequencies, gains and phases, or a folder with rates*.csv, table.toml and table.csv"
    command.add_argument("source", type=path_read, metavar="FILE|DIR", help=what)
    command.add_argument("--out", type=folder_written, metavar="DIR", help="where rates.json, rates.html and rates.png go")
    command.add_argument("--no-pictures", action="store_true", help="write no picture")
    table = command.add_argument_group("a CSV whose header does not say it")
    table.add_argument("--rate-column", default="", metavar="NAME", help="the column of the table's rate")
    table.add_argument("--output-column", default="", metavar="NAME", help="the column of the sensor's mean output")
    table.add_argument("--output-unit", default="", metavar="UNIT", help="unit of the output: V, mV, LSB, dps")
    table.add_argument("--readings", type=count(2), metavar="N", help="readings behind each mean, if the CSV has their std")


def run(args: argparse.Namespace) -> int:
    """Choose the law of each sensor, print it with the terms of IEEE 1431, and write rates.json, rates.html and rates.png."""
    from tinygc.features.tables.rates.library import FILE, PAGE, PICTURE, rates_of
    from tinygc.features.tables.rates.points import Columns
    from tinygc.reporting.terminal import progress_bar

    try_destinations(args.out, args.json)
    columns = Columns(args.rate_column, args.output_column, args.output_unit, args.readings)
    with progress_bar(args.quiet) as progress:
        found = rates_of(args.source, columns, progress)
    output(args).print(found.page)
    if args.out is not None:
        found.save(args.out, pictures=not args.no_pictures)
        names = [FILE, PAGE, *([PICTURE] if (args.out / PICTURE).exists() and not args.no_pictures else [])]
        output(args).print(f"written: {', '.join(str(args.out / name) for name in names)}", soft_wrap=True, markup=False)
    elif args.json is None:
        output(args).print("nothing is written; --out DIR keeps rates.json, rates.html and rates.png", soft_wrap=True)
    write_json(args.json, found.to_json())
    return 0
