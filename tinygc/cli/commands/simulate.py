"""``simulate``: write a simulated session that the other commands treat like a recorded one."""

from __future__ import annotations

import argparse

from session.base import features
from session.base.options import folder_written
from tinygc.cli.arguments import add_field_arguments, effect_parameters, given_fields
from tinygc.cli.results import output, write_json

SUMMARY = "write a simulated session"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    from tinygc.simulation.options import SimulationOptions, flag

    command.add_argument("--out", type=folder_written, required=True, metavar="DIR", help="folder to write")
    hidden = "an effect that the gyroscope hides, its parameters by their names and in their units; may be given for several"
    command.add_argument("--effect", type=effect_parameters, action="append", default=[], metavar="ID=JSON", help=hidden)
    fields = {name: field for name, field in SimulationOptions.__dataclass_fields__.items() if name != "seed"}  # every command has --seed
    add_field_arguments(command, {flag(name): (name, field) for name, field in fields.items()})


def run(args: argparse.Namespace) -> int:
    """Write a simulated session that the other commands treat like a recorded one."""
    from tinygc.library.simulations import simulate
    from tinygc.simulation.options import SimulationOptions
    from tinygc.simulation.write import check_folder

    chosen = given_fields(args, SimulationOptions)
    options = SimulationOptions(**chosen)
    if not (getattr(args, "units", None) or 0) > 1:
        check_folder(args.out, args.force)  # before the work
    # The parameters of each injected effect, by id. Raises CalibrationError for a repeated effect, and where nothing is turned.
    from session.base.errors import CalibrationError

    effects = dict(args.effect)
    if len(effects) < len(args.effect):
        twice = next(name for name in effects if sum(name == other for other, _ in args.effect) > 1)
        raise CalibrationError(f"--effect {twice} is given twice; give it once")
    if effects and (getattr(args, "rest_cycles", None) or getattr(args, "units", None)):
        raise CalibrationError("--effect hides an effect in a session of turns; leave out --rest-cycles and the options of an array")
    if (code := features.first("simulation", args, options, chosen)) is not None:
        return code
    folder = simulate(options, effects=effects).save(args.out, force=args.force)
    hides = f", hides {', '.join(effects)}" if effects else ""
    output(args).print(f"{folder}: simulated{hides}; the truth is in truth.json, which no command reads", soft_wrap=True)
    more = {"effects": effects} if effects else {}
    write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen} | more)
    return 0
