"""``lot``: statistics of a lot from a fleet's table, and the lot's file for ``fit --lot``."""

from __future__ import annotations

import argparse

from session.base.options import file_written, path_read
from tinygc.cli.results import output, verdict, write_json

SUMMARY = "statistics of a lot of sensors: mean, spread, drift, units that do not belong"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    command.add_argument("table", type=path_read, metavar="FLEET", help="the folder that fleet wrote, or its fleet.sqlite")
    command.add_argument("--out", type=file_written, metavar="FILE", help="write the lot's file, for fit --lot")
    command.add_argument("--html", type=file_written, metavar="FILE", help="write a page")
    command.add_argument("--model", metavar="NAME", help="of a table with several models of sensors, this one")
    command.add_argument("--strict", action="store_true", help="exit 1 if the lot drifts, or a unit does not belong")


def run(args: argparse.Namespace) -> int:
    """Print and write the statistics of a lot."""
    from tinygc.features.fleet.library import lot
    from tinygc.features.fleet.text import headline

    found = lot(args.table, model=args.model)
    report = found.result
    output(args).print(found.page)
    verdict(args, headline(report))
    if args.out is not None:
        found.save(args.out)
    if args.html is not None:
        found.save_page(args.html)
    write_json(args.json, found.to_json())
    return 1 if args.strict and (report.estimate.drifts or report.outliers) else 0
