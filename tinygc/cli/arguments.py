"""The command line's arguments.  Imports nothing heavy: --help is instant."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable, Sequence
from typing import NoReturn

from session.common.texts import printable
from tinygc.cli.commands import COMMANDS
from tinygc.cli.paths import Paths, file_written, path_read
from tinygc.methods.registry import CHOSEN

METHODS = ",".join(CHOSEN)

LONGEST_S = 1e9
MOST = 10**9  #: of anything that is counted
LARGEST_SEED = 2**63 - 1  #: that every random generator takes
FASTEST_DPS = 1e5  #: the largest full scale that session.toml may have
SHORTEST_CLOSURE_S, LONGEST_CLOSURE_S = 5.0, 3600.0
EFFECTS_HELP = "folder with further effects, a Python file each, which is run; may be given several times"

BEGIN = """To begin: calibrate.py fit data/session1 calibrates the session that comes with the tool.  At the bench: record, then check, fit,
explain and report, each with the session's folder.  calibrate.py COMMAND --help says what a command takes."""


class _Parser(argparse.ArgumentParser):
    """Bad usage is said in one line, like every other error."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"calibrate: {printable(message)}; see --help\n")


def parser(words: Sequence[str] = ()) -> argparse.ArgumentParser:
    """The whole command line: every command of ``tinygc.cli.commands``; for words that begin with one, that one, which is all they ask."""
    whole = _Parser(prog="calibrate.py", description="Calibrate a MEMS gyroscope on a hand-turned table.", epilog=BEGIN)
    whole.add_argument("--version", action="version", version=_version())
    commands = whole.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name in words[:1] if words and words[0] in COMMANDS else COMMANDS:
        module = importlib.import_module(f"tinygc.cli.commands.{name}")
        summary = module.SUMMARY
        command = commands.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
        command.set_defaults(run=module.run)
        command.add_argument("--json", type=file_written, metavar="FILE", help="write the result as JSON (- for standard output)")
        command.add_argument("--seed", type=count(0, LARGEST_SEED), default=0, help="of every random draw (%(default)s)")
        command.add_argument("--quiet", action="store_true", help="print nothing but errors, and the verdict where one was asked for")
        if getattr(module, "USES_EFFECTS", False):
            command.add_argument("--effects", type=path_read, action="append", default=[], metavar="DIR", help=EFFECTS_HELP)
        if takes := getattr(module, "DEFAULTS", {}):
            own = f"take nothing from one's own defaults ({', '.join(takes.values())})"
            command.add_argument("--no-defaults", action="store_true", help=own)
            command.set_defaults(takes_defaults=lambda args, known, takes=takes: takes)
        module.add_arguments(command)
        command.set_defaults(paths=Paths.of(command))
    return whole


def filled(text: str) -> str:
    """Any text that is not empty."""
    if not text.strip():
        raise argparse.ArgumentTypeError("an empty name")
    return text


def methods(text: str) -> list[str]:
    """Names of methods, with commas."""
    known, chosen = METHODS.split(","), [name.strip() for name in text.split(",") if name.strip()]
    for name in chosen:
        if name not in known:
            raise argparse.ArgumentTypeError(f"{name!r} is no method; choose among {METHODS}")
    if not chosen:
        raise argparse.ArgumentTypeError(f"name at least one of {METHODS}")
    return list(dict.fromkeys(chosen))


def conditions(text: str) -> tuple[str, ...]:
    """What a net is told beside the rate, with commas."""
    known, chosen = ("temperature", "force"), tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not chosen or not set(chosen) <= set(known):
        raise argparse.ArgumentTypeError(f"{text!r}: choose among {','.join(known)}")
    return chosen


def count(least: int, most: int = MOST) -> Callable[[str], int]:
    """A parser of whole numbers of at least so many, and no more than anything can use."""

    def parse(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"{value} is less than {least}")
        if value > most:
            raise argparse.ArgumentTypeError(f"{text} is more than {most}")
        return value

    parse.__name__ = "whole number"
    return parse


def segment_numbers(text: str) -> list[int]:
    """Numbers of segments, with commas."""
    words = [word.strip() for word in text.split(",")]
    if not all(word.isascii() and word.isdigit() and len(word) < 10 for word in words):
        raise argparse.ArgumentTypeError(f"{text!r} is no list of segment numbers such as 3,17")
    return list(map(int, words))


def positive(text: str) -> float:
    """A number above zero."""
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is no positive number")
    return value


positive.__name__ = "number"  # argparse says "invalid number value"


def within(low: float, high: float, what: str = "number", unit: str = "") -> Callable[[str], float]:
    """A parser of numbers of that range; what they are, and their unit, for the complaint."""

    def parse(text: str) -> float:
        value = float(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is no {what} from {low:g} to {high:g}{unit}")
        return value

    parse.__name__ = "number"
    return parse


#: what session.toml may say of a sensor (docs/formats.md)
data_rate, gyro_full_scale, accel_full_scale = within(0.1, 50_000), within(1, FASTEST_DPS), within(0.1, 1000)
#: a time that a program can wait for and a counter can hold: up to 30 years; how long a closure run turns
seconds, closure_seconds = within(0, LONGEST_S, "time", " s"), within(SHORTEST_CLOSURE_S, LONGEST_CLOSURE_S, "time", " s")


def note(text: str) -> tuple[str, str]:
    """``KEY=TEXT``."""
    key, sign, value = text.partition("=")
    if not sign or not key.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"{text!r} is no KEY=TEXT such as operator=Mara")
    return " ".join(key.split()), " ".join(value.split())


def effect_parameters(text: str) -> tuple[str, dict]:
    """``ID=JSON``, an effect's parameters by their names."""
    from session.common.errors import FormatError
    from session.files.results import read_json_text

    name, sign, value = text.partition("=")
    example = """such as 'gyro.thermal_bias={"dps_per_c": [0.01, 0, -0.02]}'"""
    if not sign:
        raise argparse.ArgumentTypeError(
            f"{text[:80]!r} is an effect without its parameters; give ID=JSON {example}, with the names and units of docs/formats.md"
        )
    try:
        parameters = read_json_text(value, name)
    except FormatError as error:
        raise argparse.ArgumentTypeError(f"{error}; expected ID=JSON {example}") from None
    if not name.strip() or not isinstance(parameters, dict):
        raise argparse.ArgumentTypeError(f"{text[:80]!r} is no ID=JSON {example}")
    return name.strip(), parameters


def stream_header(text: str) -> str:
    """A text stream's header line."""
    from session.stream.form import parse_header

    if parse_header(text.encode()) is None:
        expected = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c (or _rps, _mps2), or registers t_us,gx,gy,gz,ax,ay,az,temp"
        raise argparse.ArgumentTypeError(f"{text!r} is no header; expected {expected}")
    return text


def three(text: str) -> list[float]:
    """Three rates in dps, with commas, that a gyroscope can read."""
    values = [float(word) for word in text.split(",")]
    if len(values) != 3 or not all(abs(value) <= FASTEST_DPS for value in values):
        raise argparse.ArgumentTypeError(f"{text!r} is no triple of numbers within ±{FASTEST_DPS:g}, such as 0.5,-0.3,0.6")
    return values


three.__name__ = "three numbers"


def _version() -> str:
    from session.common.version import VERSION

    return f"TinyGC {VERSION}"
