"""``accelerometer``: calibrate it alone, from gravity's magnitude in the stills, and write a copy of the session with the result."""

from __future__ import annotations

import argparse

from session.io.texts import command_line
from tinygc.cli.arguments import folder_written, path_read
from tinygc.cli.results import output, write_json

SUMMARY = "calibrate the accelerometer alone, from the stills of a session, into a copy of it"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder; what its session.toml says of the accelerometer is not used")
    command.add_argument("--out", type=folder_written, metavar="DIR", help="the copy with [accelerometer] (FOLDER_calibrated); -: none")


def run(args: argparse.Namespace) -> int:
    """Estimate nine parameters, or as many as the attitudes determine, and write a copy with them."""
    from dataclasses import replace

    from session.detect.accelerometer import why_not, write_calibrated_copy
    from session.detect.check_references import own_fit
    from session.io.config import Accelerometer
    from session.io.errors import SegmentError
    from session.io.folder import read_session
    from tinygc.estimation.accelerometer import of_lengths
    from tinygc.reporting.fit_text import lengths_page

    session = read_session(args.folder)
    bare = replace(session, config=replace(session.config, accelerometer=Accelerometer(source="none")))
    found = own_fit(bare)
    if found is None:
        raise SegmentError(
            f"{args.folder}: no still in which gravity is about 1 g; see `{command_line('check', args.folder)}` for its units"
        )
    if found.rung is None:
        raise SegmentError(f"{args.folder}: {why_not(found)}; rest it on all six sides and some edges")
    table = of_lengths(found)
    out = args.out or args.folder.resolve().with_name(args.folder.resolve().name + "_calibrated")
    if str(out) != "-":
        write_calibrated_copy(args.folder, out, found.accelerometer)
    output(args).print(lengths_page(session.name, found, table))
    if str(out) != "-":
        output(args).print(f"calibrated copy: {out}", soft_wrap=True)
    write_json(args.json, {"schema": "tinygc-accelerometer/1", "session": session.name, "stills": len(found.before), **table.to_json()})
    return 0
