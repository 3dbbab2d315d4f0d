"""``fit`` over temperature: folders of rest logs, and sessions at several temperatures."""

from __future__ import annotations

import argparse
from pathlib import Path

from session.io.errors import CalibrationError
from tinygc.cli.arguments import count, path_read
from tinygc.cli.options import given
from tinygc.cli.results import Done, output, try_destinations

HIGHEST_ORDER = 20  #: beyond it powers of a temperature are one and the same in float64


def add_temperature_arguments(command: argparse.ArgumentParser) -> None:
    """What asks for it, and how far it goes."""
    command.add_argument(
        "more", type=path_read, nargs="*", metavar="folder", help="further folders; with --temperature, of the same sensor"
    )
    command.add_argument("--temperature", action="store_true", help="one model over temperature, of all folders and their rests")
    command.add_argument(
        "--temperature-order", type=count(0, HIGHEST_ORDER), metavar="N", help="highest power of the temperature that is tried (5)"
    )


def has_only_rests(folder: Path) -> bool:
    """Whether a folder holds rest logs and no log in which anything was turned."""
    return folder.is_dir() and any(folder.glob("rest*.csv*")) and not any(folder.glob("log*.csv*"))


def fit_temperature(args: argparse.Namespace) -> Done:
    """The model, the tables, the files."""
    from tinygc.annexes.temperature.library import fit_temperature
    from tinygc.annexes.temperature.output import MODEL, save_thermal, temperature_report, to_json
    from tinygc.cli.console import progress_bar

    idle = [
        *given(args, ()),
        *(["--limit"] if args.limit is not None and args.defaults is None else []),
        *(["--model"] if args.model else []),
    ]
    if idle:
        raise CalibrationError(
            f"{', '.join(idle)}: of no use over temperature, where each session is fitted by least squares; "
            f"leave {'it' if len(idle) == 1 else 'them'} out"
        )
    try_destinations(args, "fit")
    most = {} if args.temperature_order is None else {"most_order": args.temperature_order}
    with progress_bar(args.quiet) as progress:
        result = fit_temperature([args.folder, *args.more], progress=progress, **most)
    folder = save_thermal(result, args.out or args.folder / "fit")
    output(args).print(temperature_report(result))
    output(args).print(f"model: {folder / MODEL}", soft_wrap=True)
    return Done(0, to_json(result), f"a model over temperature: {MODEL}")
