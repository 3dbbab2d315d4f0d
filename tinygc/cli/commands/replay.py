"""``replay``: convert the content of a card, or bytes captured from a port, to a session folder."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from tinygc.cli.arguments import folder_written, path_read, stream_header
from tinygc.cli.options import add_log_options, answers_of
from tinygc.cli.results import output, write_json

if TYPE_CHECKING:
    from session.replay.convert import Converted

SUMMARY = "make a session folder of what a logger wrote to its card, or of a recording's raw bytes"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument(
        "logs", type=path_read, nargs="+", metavar="LOG", help="the log; or the gyroscope's and the accelerometer's; or raw.bin"
    )
    command.add_argument("--out", type=folder_written, required=True, metavar="DIR", help="session folder to make")
    command.add_argument("--add", choices=("log", "closure"), help="add to the session that is there, as a further log or a closure run")
    command.add_argument("--header", type=stream_header, metavar="LINE", help="of raw.bin in text that does not hold it: t_us,gx_dps,…")
    command.add_argument("--serial", default="", metavar="TEXT", help="which one it is")
    add_log_options(command)


def run(args: argparse.Namespace) -> int:
    """Convert the content of a card to a session folder."""
    from session.replay.convert import convert, convert_raw, is_raw

    if len(args.logs) == 1 and is_raw(args.logs[0]):
        made = convert_raw(args.logs[0], args.out, args.odr, args.gyro_fs, args.accel_fs, args.sensor, args.header)
    else:
        made = convert(args.logs, args.out, answers_of(args), args.add, args.serial)
    console = output(args)
    console.print(f"{made.log}: {made.samples} samples, {' and '.join(made.dialects)}", soft_wrap=True)
    for note in made.notes:
        console.print(f"  {note}", soft_wrap=True)
    for finding in made.findings:
        if finding.level in ("error", "warning"):
            console.print(f"  {finding.level}: {finding.line}", soft_wrap=True)
    console.print("next:")
    for step in made.next:
        console.print(f"  {step}", soft_wrap=True, markup=False)
    write_json(args.json, {"schema": "tinygc-replay/2", **_table(made)})
    return 0


def _table(made: Converted) -> dict:
    return {
        "folder": str(made.folder),
        "log": made.log.name,
        "dialects": list(made.dialects),
        "samples": made.samples,
        "notes": list(made.notes),
        "findings": [finding.to_json() for finding in made.findings],
        "next": list(made.next),
    }
