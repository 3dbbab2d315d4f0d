"""``simulate``: a session that the rest of the tool cannot tell from a recorded one."""

from __future__ import annotations

import argparse
from dataclasses import Field
from typing import TYPE_CHECKING

from tinygc.cli.arguments import effect_parameters, folder_written
from tinygc.cli.results import output, write_json

if TYPE_CHECKING:
    from tinygc.annexes.arrays.simulation import ArrayOptions
    from tinygc.annexes.temperature.rest_simulation import RestOptions
    from tinygc.simulation.options import SimulationOptions

SUMMARY = "write a simulated session"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    command.add_argument("--out", type=folder_written, required=True, metavar="DIR", help="folder to write")
    command.add_argument("--force", action="store_true", help="replace an earlier simulation there")
    hidden = "an effect that the gyroscope hides, its parameters by their names and in their units; may be given for several"
    command.add_argument("--effect", type=effect_parameters, action="append", default=[], metavar="ID=JSON", help=hidden)
    _add_simulation_options(command)


def run(args: argparse.Namespace) -> int:
    """A session that the rest of the tool cannot tell from a recorded one."""
    from tinygc.annexes.arrays.simulation import ArrayOptions
    from tinygc.annexes.temperature.rest_simulation import RestOptions
    from tinygc.library.sessions import simulate
    from tinygc.simulation.options import SimulationOptions
    from tinygc.simulation.write import check_folder

    chosen = {name: value for name, value in vars(args).items() if name in SimulationOptions.__dataclass_fields__ and value is not None}
    options = SimulationOptions(**chosen)
    if not (args.units or 0) > 1:
        check_folder(args.out, args.force)  # before the work
    rest = RestOptions(**_rest_options(args))
    effects = _effects(args)
    if rest.cycles:
        return _rest(args, rest, options)
    array = {name: value for name, value in vars(args).items() if name in ArrayOptions.__dataclass_fields__ and value is not None}
    if array:
        return _array(args, ArrayOptions(**array), options, chosen)
    folder = simulate(options, effects=effects).save(args.out, force=args.force)
    hides = f", hides {', '.join(effects)}" if effects else ""
    output(args).print(f"{folder}: simulated{hides}; the truth is in truth.json, which no command reads", soft_wrap=True)
    more = {"effects": effects} if effects else {}
    write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen} | more)
    return 0


def _effects(args: argparse.Namespace) -> dict[str, dict]:
    """Parameters of each effect that is to be hidden, by id.  CalibrationError for one that is given twice, and where nothing is turned."""
    from session.io.errors import CalibrationError

    effects = dict(args.effect)
    if len(effects) < len(args.effect):
        twice = next(name for name in effects if sum(name == other for other, _ in args.effect) > 1)
        raise CalibrationError(f"--effect {twice} is given twice; give it once")
    if effects and (args.rest_cycles or args.units):
        raise CalibrationError("--effect hides an effect in a session of turns; leave out --rest-cycles and the options of an array")
    return effects


def _rest(args: argparse.Namespace, rest: RestOptions, options: SimulationOptions) -> int:
    """A rest log, in which nothing is turned."""
    from tinygc.annexes.temperature.rest_simulation import write_rest

    folder = write_rest(rest, options, args.out, args.force)
    output(args).print(f"{folder}: a rest log is simulated; the truth is in truth.json, which no command reads", soft_wrap=True)
    chosen = {f"rest_{name}": value for name, value in _rest_options(args).items()}
    write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen})
    return 0


def _array(args: argparse.Namespace, array: ArrayOptions, options: SimulationOptions, chosen: dict) -> int:
    """Several units on one body."""
    from dataclasses import asdict

    from session.io.errors import CalibrationError
    from tinygc.annexes.arrays.simulation import check_array_folder, simulate_array, write_array

    if array.units < 2:
        raise CalibrationError("options of an array, and one unit; add --units N with two or more, or leave them out")
    if args.rest_cycles or options.stop_sigma_deg:
        raise CalibrationError("--units: an array has neither rest logs nor turns of known angle; simulate them apart")
    check_array_folder(args.out, args.force)  # before the work
    folder = write_array(simulate_array(options, array), args.out, args.force)
    output(args).print(f"{folder}: {array.units} units are simulated; the truth is in truth.json, which no command reads", soft_wrap=True)
    write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen | {"array": asdict(array)}})
    return 0


def _rest_options(args: argparse.Namespace) -> dict:
    given = {name.removeprefix("rest_"): value for name, value in vars(args).items() if name.startswith("rest_") and value is not None}
    return {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}


def _add_simulation_options(command: argparse.ArgumentParser) -> None:
    """One flag for each field of ``SimulationOptions``; its comments say what they mean."""
    from tinygc.annexes.arrays.simulation import ArrayOptions
    from tinygc.annexes.temperature.rest_simulation import RestOptions, rest_flag
    from tinygc.simulation.options import SimulationOptions, flag

    _add(command, {flag(name): (name, field) for name, field in SimulationOptions.__dataclass_fields__.items() if name != "seed"})
    rest = {rest_flag(name): (f"rest_{name}", field) for name, field in RestOptions.__dataclass_fields__.items()}
    _add(command.add_argument_group("a rest log, with --rest-cycles"), rest)
    array = {flag(name): (name, field) for name, field in ArrayOptions.__dataclass_fields__.items()}
    _add(command.add_argument_group("an array, with --units"), array)


def _add(command: argparse._ActionsContainer, flags: dict[str, tuple[str, Field]]) -> None:
    for word, (name, field) in flags.items():
        help_text = field.metadata["help"].replace("%", "%%") + ("" if field.default in (None, False) else f" ({field.default})")
        if isinstance(field.default, bool):
            command.add_argument(word, dest=name, action="store_true", default=None, help=help_text)
        elif isinstance(field.default, tuple):
            command.add_argument(word, dest=name, type=float, nargs=len(field.default), default=None, help=help_text)
        else:
            kind = type(field.default) if isinstance(field.default, (int, str)) else float
            metavar = "NAME" if kind is str else kind.__name__.upper()
            command.add_argument(word, dest=name, type=kind, default=None, metavar=metavar, help=help_text)
