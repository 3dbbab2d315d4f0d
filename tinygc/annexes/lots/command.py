"""``lot``: statistics of a lot from a fleet's table, and the lot's file for ``fit --lot``."""

from __future__ import annotations

import argparse

from tinygc.cli.arguments import file_written, path_read
from tinygc.cli.results import output, verdict, write_json

SUMMARY = "statistics of a lot of sensors: spread, drift, repeatability, outliers"
#: the table in the output folder of ``fleet``
TABLE = "fleet.sqlite"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    command.add_argument("table", type=path_read, metavar="FLEET", help="the folder that fleet wrote, or its fleet.sqlite")
    command.add_argument("--out", type=file_written, metavar="FILE", help="write the lot's file, for fit --lot")
    command.add_argument("--html", type=file_written, metavar="FILE", help="write a page with control charts")
    command.add_argument("--limits", type=path_read, metavar="FILE", help="limits of its numbers, TOML (docs/lots.md): capability")
    command.add_argument("--model", metavar="NAME", help="of a table with several models of sensors, this one")
    command.add_argument("--strict", action="store_true", help="exit 1 if the lot drifts, or a unit or session does not belong")


def run(args: argparse.Namespace) -> int:
    """Print and write the statistics of a lot."""
    from tinygc.annexes.lots.capability import read_limits
    from tinygc.annexes.lots.fleet_summary import lot_of_table
    from tinygc.annexes.lots.fleet_table import read_table
    from tinygc.annexes.lots.page import save as save_page
    from tinygc.annexes.lots.report import save, to_json
    from tinygc.annexes.lots.text import headline, lot_page

    folder = args.table.parent if args.table.name == TABLE else args.table
    limits = read_limits(args.limits) if args.limits else None
    with read_table(folder) as table:
        report = lot_of_table(table, args.model, limits, args.seed)
    output(args).print(lot_page(report))
    verdict(args, headline(report))
    if args.out is not None:
        save(report, args.out)
    if args.html is not None:
        save_page(report, args.html)
    write_json(args.json, to_json(report))
    return 1 if args.strict and (report.hierarchy.drifts or report.outliers) else 0
