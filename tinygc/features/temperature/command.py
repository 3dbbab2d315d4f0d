"""Commands over temperature: ``fit`` of rest logs and of sessions at several temperatures, ``simulate`` of rest logs.

Imports nothing heavy at its top, because the core's commands load it for its options.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from session.base.errors import CalibrationError
from tinygc.cli.arguments import add_field_arguments, count, given_fields
from tinygc.cli.options import given
from tinygc.cli.results import Done, output, try_destinations, write_json

if TYPE_CHECKING:
    from tinygc.simulation.options import SimulationOptions

HIGHEST_ORDER = 20  #: above it powers of a temperature are indistinguishable in float64


def add_fit_arguments(command: argparse.ArgumentParser) -> None:
    """Add the options of ``fit``."""
    command.add_argument("--temperature", action="store_true", help="one model over temperature, of all folders and their rests")
    command.add_argument(
        "--temperature-order", type=count(0, HIGHEST_ORDER), metavar="N", help="highest power of the temperature that is tried (5)"
    )


def fit(args: argparse.Namespace) -> Done | None:
    """Fit one model to all folders; None where it is not asked for, and the first folder is none of rest logs."""
    if not args.temperature and not _has_only_rests(args.folder):
        if rests := [folder for folder in args.more if _has_only_rests(folder)]:
            raise CalibrationError(f"{rests[0]}: holds rest logs alone; add --temperature to join them with the sessions in one model")
        return None
    from tinygc.features.temperature.library import fit_temperature
    from tinygc.features.temperature.output import MODEL, save_thermal, temperature_report, to_json
    from tinygc.reporting.terminal import progress_bar

    limit = ["--limit"] if args.limit is not None and args.defaults is None else []
    if idle := [*given(args, ()), *limit, *(["--model"] if args.model else [])]:
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


def _has_only_rests(folder: Path) -> bool:
    """Whether a folder holds rest logs and no log with turns."""
    return folder.is_dir() and any(folder.glob("rest*.csv*")) and not any(folder.glob("log*.csv*"))


def add_simulate_arguments(command: argparse.ArgumentParser) -> None:
    """Add the options of ``simulate``: a flag for each field of ``RestOptions``."""
    from tinygc.features.temperature.options import RestOptions, rest_flag

    flags = {rest_flag(name): (f"rest_{name}", field) for name, field in RestOptions.__dataclass_fields__.items()}
    add_field_arguments(command.add_argument_group("a rest log, with --rest-cycles"), flags)


def simulate(args: argparse.Namespace, options: SimulationOptions, chosen: dict) -> int | None:
    """Simulate a rest log, in which nothing is turned, and return the exit code; None where none is requested."""
    from tinygc.features.temperature.options import RestOptions

    fields = given_fields(args, RestOptions, "rest_")
    rest = RestOptions(**fields)
    if not rest.cycles:
        return None
    from tinygc.features.temperature.rest_simulation import write_rest

    folder = write_rest(rest, options, args.out, args.force)
    output(args).print(f"{folder}: a rest log is simulated; the truth is in truth.json, which no command reads", soft_wrap=True)
    chosen = {f"rest_{name}": value for name, value in fields.items()}
    write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen})
    return 0
