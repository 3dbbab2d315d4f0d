"""``rates``: scale, nonlinearity, clipping and bandwidth of a sensor on a rate table, of points in a CSV or of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import argument, folder_written, option
from tinygc.cli.options import Command
from tinygc.cli.results import output, try_destinations, write_json

COLUMNS = "a CSV whose header does not say it"
SUMMARY = "rate steps and sine sweeps of a rate table: the law of the output, the terms of IEEE 1431, bandwidth and delay"


@dataclass(frozen=True)
class Options(Command):
    """Options of ``rates``."""

    source: Path = argument(
        "a CSV of rates and mean outputs, of frequencies, gains and phases, or a folder with rates*.csv, table.toml and table.csv",
        metavar="FILE|DIR",
    )
    out: Path | None = option(None, "where rates.json, rates.html and rates.png go", metavar="DIR", read=folder_written)
    pictures: bool = option(True, "draw the picture", off="write no picture")
    rate_column: str = option("", "the column of the table's rate", read=str, group=COLUMNS)
    output_column: str = option("", "the column of the sensor's mean output", read=str, group=COLUMNS)
    output_unit: str = option("", "unit of the output: V, mV, LSB, dps", metavar="UNIT", read=str, group=COLUMNS)
    readings: int | None = option(None, "readings behind each mean, if the CSV has their std", least=2, group=COLUMNS)


def run(args: Options) -> int:
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
        found.save(args.out, pictures=args.pictures)
        names = [FILE, PAGE, *([PICTURE] if (args.out / PICTURE).exists() and args.pictures else [])]
        output(args).print(f"written: {', '.join(str(args.out / name) for name in names)}", soft_wrap=True, markup=False)
    elif args.json is None:
        output(args).print("nothing is written; --out DIR keeps rates.json, rates.html and rates.png", soft_wrap=True)
    write_json(args.json, found.to_json())
    return 0
