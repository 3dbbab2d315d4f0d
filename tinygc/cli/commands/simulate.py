"""``simulate``: a session that the rest of the tool cannot tell from a recorded one."""

from __future__ import annotations

import argparse
from pathlib import Path

from tinygc.cli.commands._results import output, write_json

SUMMARY = "write a simulated session"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    command.add_argument("--force", action="store_true", help="replace an earlier simulation there")
    _add_simulation_options(command)


def run(args: argparse.Namespace) -> int:
    """A session that the rest of the tool cannot tell from a recorded one."""
    from tinygc.library.simulate import simulate
    from tinygc.simulation.options import SimulationOptions
    from tinygc.simulation.write import check_folder

    chosen = {name: value for name, value in vars(args).items() if name in SimulationOptions.__dataclass_fields__ and value is not None}
    options = SimulationOptions(**chosen)
    check_folder(args.out, args.force)  # before the work
    folder = simulate(options).save(args.out, force=args.force)
    output(args).print(f"{folder}: simulated; the truth is in truth.json, which no command reads", soft_wrap=True)
    write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen})
    return 0


def _add_simulation_options(command: argparse.ArgumentParser) -> None:
    """One flag for each field of ``SimulationOptions``; its comments say what they mean."""
    from tinygc.simulation.options import SimulationOptions, flag

    for name, field in SimulationOptions.__dataclass_fields__.items():
        if name == "seed":
            continue
        help_text = field.metadata["help"].replace("%", "%%") + ("" if field.default in (None, False) else f" ({field.default})")
        if isinstance(field.default, bool):
            command.add_argument(flag(name), dest=name, action="store_true", default=None, help=help_text)
        elif isinstance(field.default, tuple):
            command.add_argument(flag(name), dest=name, type=float, nargs=len(field.default), default=None, help=help_text)
        else:
            kind = type(field.default) if isinstance(field.default, (int, str)) else float
            metavar = "NAME" if kind is str else kind.__name__.upper()
            command.add_argument(flag(name), dest=name, type=kind, default=None, metavar=metavar, help=help_text)
