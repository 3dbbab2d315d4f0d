"""``export``: write a calibration in another program's format."""

from __future__ import annotations

import argparse

from tinygc.cli.arguments import filled, folder_written, path_read
from tinygc.cli.results import complain, write_files
from tinygc.deploy import FORMATS, format_named

SUMMARY = "write the calibration for other programs"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder that was fitted, or an array's model file")
    command.add_argument("--to", required=True, type=format_named, choices=FORMATS, metavar="FORMAT", help=f"one of {', '.join(FORMATS)}")
    command.add_argument("--model", type=filled, metavar="NAME", help="method of the fit, or a model file (least_squares)")
    command.add_argument("--out", type=folder_written, metavar="DIR", help="where the files go (export/ in the session folder)")
    command.add_argument("--anyway", action="store_true", help="export a model that closes held-out segments worse than raw rates, too")


def run(args: argparse.Namespace) -> int:
    """Write a calibration in another program's format."""
    from session.io.annexes import need
    from session.io.errors import CalibrationError
    from session.io.names import is_array
    from tinygc.deploy.exports import exporter
    from tinygc.deploy.exports._context import read_context
    from tinygc.models.files import is_array_model

    if is_array_model(args.folder):
        return need("commands on arrays").export(args)
    if args.model is None and is_array(args.folder):
        raise CalibrationError(f"{args.folder}: an array; give its model, {args.folder / 'fit' / 'model_array.json'}, which its fit writes")
    said = []

    def say(line: str) -> None:
        said.append(line)
        complain(line)

    model, context = read_context(args.folder, args.model, say, anyway=args.anyway)
    write_files(args, args.out or args.folder / "export", exporter(args.to).export(model, context), said)
    return 0
