"""``accelerometer``: calibrate it alone, from gravity's magnitude in the stills, and write a copy of the session with the result."""

from __future__ import annotations

import argparse

from session.base.options import folder_written, path_read
from tinygc.cli.results import output, write_json

SUMMARY = "calibrate the accelerometer alone, from the stills of a session, into a copy of it"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder; what its session.toml says of the accelerometer is not used")
    command.add_argument("--out", type=folder_written, metavar="DIR", help="the copy with [accelerometer] (FOLDER_calibrated); -: none")


def run(args: argparse.Namespace) -> int:
    """Estimate nine parameters, or as many as the attitudes determine, and write a copy with them."""
    from tinygc.library.sessions import accelerometer

    found = accelerometer(args.folder)
    out = args.out or args.folder.resolve().with_name(args.folder.resolve().name + "_calibrated")
    if str(out) != "-":
        found.save(out)
    output(args).print(found.page)
    if str(out) != "-":
        output(args).print(f"calibrated copy: {out}", soft_wrap=True)
    write_json(args.json, found.to_json())
    return 0
