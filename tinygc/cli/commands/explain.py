"""``explain``: explain differences between recording and simulation."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from session.base import features
from session.base.errors import CalibrationError
from session.base.options import folder_written, path_read
from session.base.texts import command_line
from tinygc.cli.options import add_clock_argument, session_of
from tinygc.cli.results import complain, inside, output, print_commands, try_destinations, verdict, write_json

SUMMARY = "say why the recording differs from the simulation, and prove it"
USES_EFFECTS = True
#: recordings of the unit that are offered for a check; each takes as long as the first
MOST_OFFERED = 3


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder")
    add_clock_argument(command)
    command.add_argument("--no-earth", action="store_true", help="leave the Earth's rotation in the rates")
    search = "search for the equation that no catalogue has, write it as an effect file, and prove it (docs/discover.md); takes longer"
    command.add_argument("--discover", action="store_true", help=search)
    on = "other recordings of the unit, or a folder of them: each effect is checked there with the size that it has here"
    command.add_argument("--check-on", type=path_read, nargs="+", metavar="DIR", default=[], help=on)
    noise = (
        "noise figures of the unit, measured at rest: the prior of its bias drift (fit/noise.json in the session folder, if it is there)"
    )
    command.add_argument("--noise", type=path_read, metavar="FILE", help=noise)
    command.add_argument("--no-pictures", action="store_true", help="write no picture")
    command.add_argument("--out", type=folder_written, metavar="DIR", help="where the result goes (explain/ in the session folder)")
    command.add_argument("--strict", action="store_true", help="exit 1 if there is a mismatch")


def run(args: argparse.Namespace) -> int:
    """Explain differences between recording and simulation."""
    if (code := features.first("explanation of a folder", args)) is not None:
        return code
    from tinygc.library.explanations import explain
    from tinygc.reporting.terminal import progress_bar

    try_destinations(args.out or inside(args.folder, "explain"), args.json)
    if args.discover:
        _try_effects((args.out or args.folder / "explain") / "effects")
    with progress_bar(args.quiet) as progress:
        why = explain(
            session_of(args),
            seed=args.seed,
            use_earth=not args.no_earth,
            discover=args.discover,
            check_on=args.check_on,
            noise=args.noise,
            progress=progress,
        )
    folder = why.save(args.out, pictures=_with_pictures(args))
    output(args).print(why.page)
    output(args).print(f"written: {folder}", soft_wrap=True)
    for line in why.said_of_files:
        output(args).print(line, soft_wrap=True)
    if why.discovery is not None and why.discovery.laws:
        print_commands(args, "use it in another session:", command_line("explain", "OTHER", "--effects", folder / "effects"))
    from session.log.siblings import others_beside

    if why.effects and not args.check_on and (others := others_beside(args.folder)):
        names = [os.path.relpath(other) for other in others[:MOST_OFFERED]]
        print_commands(args, "does it hold in this unit's other recordings?", command_line("explain", args.folder, "--check-on", *names))
    verdict(args, why.verdict_line)
    write_json(args.json, why.to_json())
    return 1 if args.strict and why.verdict != "no_mismatch" else 0


def _try_effects(folder: Path) -> None:
    """Fail before the search if the laws' files cannot be written."""
    if os.path.lexists(folder) and not folder.is_dir():
        raise CalibrationError(f"{folder}: that is no folder, and the laws that are found go into one; move it away, or give --out another")
    if folder.is_dir() and not os.access(folder, os.W_OK | os.X_OK):
        raise CalibrationError(f"{folder}: nothing can be written there, and the laws that are found go there; give --out another folder")


def _with_pictures(args: argparse.Namespace) -> bool:
    """Whether pictures are wanted and can be drawn; reports where they cannot."""
    from tinygc.reporting.pictures.canvas import has_matplotlib

    if not args.no_pictures and not has_matplotlib():
        complain("no picture: that needs matplotlib (python -m pip install 'tinygc[plot]')")
        return False
    return not args.no_pictures
