"""The command line's arguments.  Imports nothing heavy: --help is instant."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from session.errors import printable

METHODS = "raw,raw_bias_removed,least_squares,pso,tinygc"  # as in tinygc.methods, which imports too much for --help


class _Parser(argparse.ArgumentParser):
    """Bad usage is said in one line, like every other error."""

    def error(self, message: str):
        self.exit(2, f"calibrate: {printable(message)}; see --help\n")


def parser(runs: dict[str, Callable]) -> argparse.ArgumentParser:
    """The whole command line; ``runs`` gives each command's function by its name."""
    whole = _Parser(prog="calibrate.py", description="Calibrate a MEMS gyroscope on a hand-turned table.")
    whole.add_argument("--version", action="version", version=_version())
    commands = whole.add_subparsers(title="commands", required=True, metavar="COMMAND")

    command = _command(commands, "check", runs["check"], "a first look at a session: units, scales, rates, gaps, axes, stills")
    command.add_argument("folder", type=Path, help="session folder")
    command.add_argument("--strict", action="store_true", help="exit 1 on warnings")

    limit = "exit 1 if the best method's held-out tilt, or the best method's RMSE in any closure run, is above this"
    command = _command(commands, "fit", runs["fit"], "fit the calibration, compare the methods, print the closure errors")
    command.add_argument("folder", type=Path, help="session folder")
    command.add_argument("--methods", type=_methods, default=METHODS.split(","), metavar="A,B", help=f"among {METHODS} (all)")
    command.add_argument("--folds", type=_count(2), default=5, help="folds of the held-out closure (%(default)s)")
    command.add_argument("--still-rates", action="store_true", help="use the mean rate in each still as data, too")
    command.add_argument("--integrator", choices=("exact", "first-order"), default="exact", help="first-order: the paper's")
    command.add_argument("--optimizer", choices=("second-order", "adamw"), default="second-order", help="of TinyGC-Net; adamw: the paper's")
    command.add_argument("--epochs", type=_count(1), default=2000, help="of adamw (%(default)s)")
    command.add_argument("--physics", metavar="auto|IDS", help="fit what explain names as well (auto), or effects by id, with commas")
    command.add_argument("--no-earth", action="store_true", help="leave the Earth's rotation in the rates")
    command.add_argument("--exclude", type=_numbers, action="extend", default=[], metavar="N,N", help="numbers of segments to leave out")
    command.add_argument("--out", type=Path, metavar="DIR", help="where the models go (fit/ in the session folder)")
    command.add_argument("--limit", type=_positive, metavar="DEG", help=limit)

    command = _command(commands, "explain", runs["explain"], "say why the recording differs from the simulation, and prove it")
    command.add_argument("folder", type=Path, help="session folder")
    command.add_argument("--no-earth", action="store_true", help="leave the Earth's rotation in the rates")
    command.add_argument("--no-pictures", action="store_true", help="write no picture")
    command.add_argument("--out", type=Path, metavar="DIR", help="where the result goes (explain/ in the session folder)")
    command.add_argument("--strict", action="store_true", help="exit 1 if there is a mismatch")

    command = _command(commands, "plan", runs["plan"], "say which movements to record next")
    command.add_argument("folder", type=Path, help="session folder")
    command.add_argument("--count", type=_count(1), default=5, help="movements at most (%(default)s)")

    command = _command(commands, "challenge", runs["challenge"], "examine explain on simulated sessions that hide something, blind")
    command.add_argument("--cases", type=_count(1), default=40, metavar="N", help="sessions (%(default)s)")
    command.add_argument("--out", type=Path, metavar="DIR", help="new folder for the truth and what was said (a temporary one)")
    command.add_argument("--keep", action="store_true", help="keep the sessions, too")

    command = _command(commands, "simulate", runs["simulate"], "write a simulated session")
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    command.add_argument("--force", action="store_true", help="replace an earlier simulation there")
    _add_simulation_options(command)
    return whole


def _command(commands, name: str, run, summary: str) -> argparse.ArgumentParser:
    command = commands.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
    command.set_defaults(run=run)
    command.add_argument("--json", type=Path, metavar="FILE", help="write the result as JSON (- for standard output)")
    command.add_argument("--seed", type=_count(0), default=0, help="of every random draw (%(default)s)")
    command.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return command


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
            kind = int if isinstance(field.default, int) else float
            command.add_argument(flag(name), dest=name, type=kind, default=None, metavar=kind.__name__.upper(), help=help_text)


def _methods(text: str) -> list[str]:
    known, chosen = METHODS.split(","), [name.strip() for name in text.split(",") if name.strip()]
    for name in chosen:
        if name not in known:
            raise argparse.ArgumentTypeError(f"{name!r} is no method; choose among {METHODS}")
    if not chosen:
        raise argparse.ArgumentTypeError(f"name at least one of {METHODS}")
    return list(dict.fromkeys(chosen))


def _count(least: int):
    def parse(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"{value} is less than {least}")
        return value

    parse.__name__ = "whole number"
    return parse


def _numbers(text: str) -> list[int]:
    """Numbers of segments, with commas."""
    words = [word.strip() for word in text.split(",")]
    if not all(word.isascii() and word.isdigit() and len(word) < 10 for word in words):
        raise argparse.ArgumentTypeError(f"{text!r} is no list of segment numbers such as 3,17")
    return list(map(int, words))


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is no positive number")
    return value


_positive.__name__ = "number"  # argparse says "invalid number value"


def _version() -> str:
    from tinygc import __version__

    return f"TinyGC {__version__}"
