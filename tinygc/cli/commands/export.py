"""``export``: write a calibration in another program's format."""

from __future__ import annotations

import argparse

from session.base.options import folder_written, path_read
from tinygc.cli.arguments import filled
from tinygc.cli.results import complain, output, write_json
from tinygc.deploy import FORMATS, format_named

SUMMARY = "write the calibration for other programs"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder that was fitted, or noise.json")
    command.add_argument("--to", required=True, type=format_named, choices=FORMATS, metavar="FORMAT", help=f"one of {', '.join(FORMATS)}")
    command.add_argument("--model", type=filled, metavar="NAME", help="method of the fit, or a model file (least_squares)")
    command.add_argument("--out", type=folder_written, metavar="DIR", help="where the files go (export/ in the session folder)")
    command.add_argument("--noise", type=path_read, metavar="PATH", help="noise.json of this unit, or its folder (fit/noise.json)")
    command.add_argument("--inflation", type=filled, metavar="MOTION", help="enlarge noise densities by the factors of this kind of motion")
    command.add_argument("--anyway", action="store_true", help="export a model that closes held-out segments worse than raw rates, too")


def run(args: argparse.Namespace) -> int:
    """Write a calibration in another program's format."""
    from tinygc.library.reports import exported

    made = exported(args.folder, args.to, args.model, args.anyway, complain, args.noise, args.inflation)
    home = args.folder.parent if args.folder.is_file() else args.folder
    written = made.save(args.out or home / "export")
    for path in written:
        output(args).print(f"written: {path}", soft_wrap=True)
    write_json(args.json, made.to_json(written))
    return 0
