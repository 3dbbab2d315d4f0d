"""``export``: a calibration in another program's words."""

from __future__ import annotations

import argparse
from pathlib import Path

from tinygc.cli.arguments import filled, folder_written, path_read
from tinygc.cli.results import complain, output, write_json
from tinygc.deploy.exports import FORMATS

SUMMARY = "write the calibration for other programs"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    command.add_argument("folder", type=path_read, help="session folder that was fitted, or an array's model file")
    command.add_argument("--to", required=True, choices=FORMATS, metavar="FORMAT", help=f"one of {', '.join(FORMATS)}")
    command.add_argument("--model", type=filled, metavar="NAME", help="method of the fit, or a model file (least_squares)")
    command.add_argument("--out", type=folder_written, metavar="DIR", help="where the files go (export/ in the session folder)")
    command.add_argument("--anyway", action="store_true", help="export a model that closes held-out segments worse than raw rates, too")


def run(args: argparse.Namespace) -> int:
    """A calibration in another program's words."""
    from session.io.errors import CalibrationError
    from session.io.names import is_array
    from tinygc.annexes.arrays.model import is_array_model
    from tinygc.deploy.exports import exporter
    from tinygc.deploy.exports._context import read_context

    if is_array_model(args.folder):
        return export_an_array(args)
    if args.model is None and is_array(args.folder):
        raise CalibrationError(f"{args.folder}: an array; give its model, {args.folder / 'fit' / 'model_array.json'}, which its fit writes")
    said = []

    def say(line: str) -> None:
        said.append(line)
        complain(line)

    model, context = read_context(args.folder, args.model, say, anyway=args.anyway)
    folder = args.out or args.folder / "export"
    written(args, folder, exporter(args.to).export(model, context), said)
    return 0


def export_an_array(args: argparse.Namespace) -> int:
    """An array's model file, beside which the files go."""
    from session.io.errors import CalibrationError
    from tinygc.annexes.arrays.c_code import export_array

    if args.model is not None:
        raise CalibrationError(f"--model goes with a session folder; {args.folder} is an array's model itself")
    written(args, args.out or args.folder.parent / "export", export_array(args.folder, args.to), [])
    return 0


def written(args: argparse.Namespace, folder: Path, files: dict[str, str], said: list[str]) -> None:
    """The files, each named on the page, and what ``--json`` asks for."""
    from session.io.files import result_folder
    from session.io.results import write_text_whole

    with result_folder(folder):
        for name, text in files.items():
            write_text_whole(folder / name, text)
            output(args).print(f"written: {folder / name}", soft_wrap=True)
    write_json(args.json, {"schema": "tinygc-export/1", "format": args.to, "files": [str(folder / name) for name in files], "said": said})
