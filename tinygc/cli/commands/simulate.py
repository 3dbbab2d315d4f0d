"""``simulate``: write a simulated session that the other commands treat like a recorded one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from session.base import features
from session.base.errors import CalibrationError
from session.base.options import changed, folder_written, given, option, part
from session.base.texts import command_line
from tinygc.cli.arguments import effect_parameters
from tinygc.cli.options import Command, Force, UsesEffects
from tinygc.cli.results import output, write_json
from tinygc.simulation.options import SimulationOptions


@dataclass(frozen=True)
class Options(SimulationOptions, Command, UsesEffects, Force):
    """Options of ``simulate``."""

    out: Path = option(..., "folder to write", metavar="DIR", read=folder_written)
    effect: tuple[Any, ...] = option(
        (),
        "an effect that the gyroscope hides, its parameters by their names and in their units; may be given for several",
        metavar="ID=JSON",
        read=effect_parameters,
        repeated=True,
    )


def run(args: Options) -> int:
    """Write a simulated session that the other commands treat like a recorded one."""
    from tinygc.library.simulations import simulate
    from tinygc.simulation.write import check_folder

    options = part(args, SimulationOptions)
    chosen = changed(options)
    # The parameters of each injected effect, by id.  Raises CalibrationError for a repeated effect, and where nothing is turned.
    effects = dict(args.effect)
    if len(effects) < len(args.effect):
        twice = next(name for name in effects if sum(name == other for other, _ in args.effect) > 1)
        raise CalibrationError(f"--effect {twice} is given twice; give it once")
    if effects and (others := [flag for each in args.of_features for flag in given(each)]):
        raise CalibrationError(f"--effect hides an effect in a session of turns; leave out {', '.join(others)}")
    if (code := features.first("simulation", args, options, chosen)) is not None:
        return code
    check_folder(args.out, args.force)  # before the work
    folder = simulate(options, effects=effects).save(args.out, force=args.force)
    hides = f", hides {', '.join(effects)}" if effects else ""
    output(args).print(f"{folder}: {options.segments} turns simulated{hides}; the truth is in truth.json")
    output(args).print(f"next: {command_line('fit', folder)}")
    more = {"effects": effects} if effects else {}
    write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen} | more)
    return 0
