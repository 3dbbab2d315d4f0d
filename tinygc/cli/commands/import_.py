"""``import``: make a session folder of any log, or of bytes captured from a port."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from session.base.options import folder_written, path_read
from session.base.records import table_of
from tinygc.cli.arguments import memory, stream_header
from tinygc.cli.options import add_log_options, answers_of
from tinygc.cli.results import output, write_json

if TYPE_CHECKING:
    pass

SUMMARY = "make a session folder of any log: a logger's, a telephone's, a robot's, a flight controller's, or a port's raw bytes"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument(
        "logs", type=path_read, nargs="*", metavar="LOG", help="the log; or the gyroscope's and the accelerometer's; or raw.bin"
    )
    command.add_argument("--out", type=folder_written, metavar="DIR", help="session folder to make (named as the log, beside it)")
    command.add_argument("--add", choices=("log", "closure"), help="add to the session that is there, as a further log or a closure run")
    command.add_argument("--list", action="store_true", help="list what is read, each with an example line")
    command.add_argument("--header", type=stream_header, metavar="LINE", help="of raw.bin in text that does not hold it: t_us,gx_dps,…")
    command.add_argument("--serial", default="", metavar="TEXT", help="which one it is")
    command.add_argument("--array-by", metavar="NAME", help="of several sensors' rows: an array, of each value in this column a unit")
    command.add_argument("--turns", type=path_read, metavar="FILE", help="of a gyroscope alone: turns.csv, the known angles of its turns")
    what = "count the samples along their stamps, which scatter or are rounded: at one rate, on straight lines between gaps"
    command.add_argument("--even", action="store_true", help=what)
    what = "memory that reading may take, such as 3GB (1GB, or 20 times what the files take on the disk)"
    command.add_argument("--most-memory", type=memory, metavar="SIZE", help=what)
    add_log_options(command)


def run(args: argparse.Namespace) -> int:
    """Convert a log to a session folder."""
    from session.base.errors import FormatError
    from session.detect.check_samples import HELD
    from session.replay.importing import import_log, known_logs

    console = output(args)
    if args.list:
        readers = [{"name": name, "example": example, "needs": needs} for name, example, needs in known_logs()]
        for each in readers:
            console.print(each["name"] + (f" ({each['needs']})" if each["needs"] else ""), soft_wrap=True, markup=False, highlight=False)
            console.print(f"    {each['example']}", soft_wrap=True, markup=False, highlight=False)
        write_json(args.json, {"schema": "tinygc-readers/1", "readers": readers})
        return 0
    if not args.logs:
        raise FormatError("import: no log; give its file, or --list for what is read")
    made = import_log(
        args.logs,
        args.out,
        replace(answers_of(args, len(args.logs)), even=args.even),
        add=args.add,
        serial=args.serial,
        columns=args.columns if args.columns and len(args.columns) > 1 else (),
        header=args.header,
        array_by=args.array_by,
        turns=args.turns,
        most_memory=args.most_memory,
    )
    console.print(f"{made.log}: {made.samples} samples, {' and '.join(made.dialects)}", soft_wrap=True)
    for line in made.took:
        console.print(f"  {line}", soft_wrap=True, markup=False)
    for note in made.notes:
        console.print(f"  {note}", soft_wrap=True)
    for finding in made.findings:
        if finding.level in ("error", "warning") or finding.what == HELD:  # how fast each sensor is
            console.print(f"  {finding.level}: {finding.line}", soft_wrap=True)
    console.print("next:")
    for step in made.next:
        console.print(f"  {step}", soft_wrap=True, markup=False)
    write_json(args.json, table_of(made))
    return 0
