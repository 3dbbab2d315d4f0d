"""``temperature``: a model over temperature of sessions and rest logs; ``simulate`` of rest logs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.options import argument, changed, folder_written, option, values
from session.base.texts import command_line
from tinygc.cli.options import Command, UsesEffects
from tinygc.cli.results import output, print_commands, try_destinations, write_json
from tinygc.features.temperature.feature import RestOptions, ThermalOptions

if TYPE_CHECKING:
    from tinygc.simulation.options import SimulationOptions


@dataclass(frozen=True)
class Options(ThermalOptions, Command, UsesEffects):
    """Options of ``temperature``."""

    folders: tuple[Path, ...] = argument("session folders, and folders of rest logs, of one sensor", metavar="DIR")
    out: Path | None = option(None, "where the model goes (fit/ in the first folder)", metavar="DIR", read=folder_written)


def run(args: Options) -> int:
    """Fit one model to all folders."""
    from tinygc.features.temperature.library import fit_temperature
    from tinygc.features.temperature.output import MODEL, save_thermal, temperature_report, to_json
    from tinygc.reporting.terminal import progress_bar

    folder = args.out or args.folders[0] / "fit"
    try_destinations(folder, args.json)
    with progress_bar(args.quiet) as progress:
        result = fit_temperature(args.folders, progress=progress, **values(args, ThermalOptions))
    save_thermal(result, folder)
    output(args).print(temperature_report(result))
    output(args).print(f"written: {folder / MODEL}")
    write_json(args.json, to_json(result))
    return 0


def simulate(args: Any, options: SimulationOptions, chosen: dict) -> int | None:
    """Simulate a rest log, in which nothing is turned, and return the exit code; None where none is requested."""
    rest: RestOptions = args.of_feature(RestOptions)
    if not rest.cycles:
        return None
    from tinygc.features.temperature.rest_simulation import write_rest

    folder = write_rest(rest, options, args.out, args.force)
    output(args).print(f"{folder}: a rest log simulated; the truth is in truth.json")
    print_commands(args, "next:", command_line("temperature", folder))
    chosen = {f"rest_{name}": value for name, value in changed(rest).items()}
    write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen})
    return 0
