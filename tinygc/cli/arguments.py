"""Arguments and paths of the command line.  Imports nothing heavy, so that --help is instant."""

from __future__ import annotations

import argparse
import itertools
import math
import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import Any, NoReturn

from session.base import features
from session.base.errors import CalibrationError, FormatError
from session.base.files import KB, is_stream, open_file, refuse_link
from session.base.names import has_recorded_name, is_session
from session.base.options import add_arguments, file_written, folder_written, from_arguments, log_written, meant, path_read
from session.base.texts import printable, program
from tinygc.cli.commands import command_module, commands
from tinygc.cli.defaults import take_defaults

# Path arguments: each is declared as read or written, and an output never replaces an input or a recorded file.
#
# A command only declares ``type=path_read``, ``file_written`` or ``folder_written``.  ``refuse_overwriting`` then checks every output
# against every input, and against the files of every session, before the command begins.

#: stands for standard input or output
STANDARD = "-"
#: names of standard output
STANDARD_OUTPUT = (STANDARD, "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1")
#: value of an option that writes a file and is given without one: the command names the file in its folder (compared by identity)
OWN_PLACE = Path()
#: how the results begin that a file option writes: JSON, a page, a certificate in XML, a fleet's table, a session.toml
RESULT = re.compile(
    rb"""\s*\{.{0,4000}?"schema":\s*"tinygc-|<!DOCTYPE html>.*TinyGC|<\?xml.*>TinyGC<|folder,key,|(?:\#[^\n]*+\n|\s)*+schema = "tinygc-""",
    re.DOTALL,
)
#: bytes that are looked at of what stands there
BEGINNING = 64 * KB
#: files in an input folder that are not recorded, but that other commands read
DERIVED = ("fit/*.json", "explain/explain.json", "*.py")
#: command -> the one of these files that it writes itself, with the content of its JSON
OWN = {"fit": "fit.json", "explain": "explain.json", "noise": "noise.json", "rates": "rates.json"}


def is_standard_output(path: Path | None) -> bool:
    """Whether the path is standard output."""
    return str(path) in STANDARD_OUTPUT


@dataclass(frozen=True)
class Paths:
    """name: of the command; the destinations of its arguments that hold outputs, with the option as written."""

    command: str
    files: dict[str, str]
    logs: dict[str, str]
    folders: dict[str, str]

    @classmethod
    def of(cls, command: argparse.ArgumentParser) -> Paths:
        """Return the paths of a command's parser."""
        of_kind = {
            kind: {action.dest: (action.option_strings or [action.dest])[-1] for action in command._actions if action.type is kind}
            for kind in (file_written, log_written, folder_written)
        }
        return cls(command.prog.split()[-1], of_kind[file_written], of_kind[log_written], of_kind[folder_written])


def options_of(args: argparse.Namespace) -> Any:
    """The options of a command with the user's defaults, checked; its outputs replace nothing that is read or recorded."""
    if args.kind is None:
        take_defaults(args)
        refuse_overwriting(args)
        args.of_several = False
        return args
    options = take_defaults(from_arguments(args.kind, args))
    refuse_overwriting(argparse.Namespace(**vars(options), paths=args.paths))
    return options


def refuse_overwriting(args: argparse.Namespace) -> None:
    """Raise CalibrationError where an output is an input, a recording's own file, or another output, before anything is changed.

    Paths are compared by their targets: through links of either kind, ``..``, ``/dev/fd`` and another case of their letters.
    """
    paths: Paths = args.paths
    for option, path in _given(args, paths.folders):
        if path.exists() and not path.is_dir():
            raise CalibrationError(f"{option} {path}: that is no folder; give {option} a folder, which is made where it is not there")
    written = [(option, path) for option, path in _given(args, {**paths.files, **paths.logs}) if str(path) != STANDARD]
    folders = [path for _, path in _given(args, paths.folders) if str(path) != STANDARD]
    read = list(_read(args, {*paths.files, *paths.logs, *paths.folders}))
    # The files that must not change, by their identity in the file system: those paths, and the inputs in folders.
    but = OWN.get(paths.command, "")
    known: dict[tuple[int, int], Path] = {}
    for path in [*read, *folders]:
        inside: Iterable[Path] = [path]
        if path.is_dir():
            derived = (found for pattern in DERIVED for found in path.glob(pattern) if found.name != but)
            inside = itertools.chain((each for each in path.iterdir() if has_recorded_name(each)), derived)
        for each in inside:
            if (identity := _identity(_status(each))) is not None:
                known.setdefault(identity, each)
    homes = {Path(os.path.realpath(folder)) for folder in folders} | {Path(os.path.realpath(path)) for path in read if path.is_dir()}
    for option, path in written:
        if path.is_dir():
            raise CalibrationError(f"{option} {path}: cannot be written (that is a folder); give {option} a file")
        _refuse_known(f"{option} {path}", _status(path), known)
        # The path with links in its folder resolved, but not the last one.
        for place in (Path(os.path.realpath(path.parent)) / path.name, Path(os.path.realpath(path))):
            there = os.path.lexists(place)
            counts = there or option not in paths.logs.values()
            if counts and has_recorded_name(place) and (place.parent in homes or is_session(place.parent)):
                what = "is a file of the recording in" if there else "has the name of a recording's file in"
                raise CalibrationError(f"{option} {path}: {what} {place.parent}, where nothing is written over; give {option} another path")
        if option in paths.files.values() and not (path.is_symlink() or is_stream(path) or _is_result(path)):
            force = getattr(args, "force", None)
            if not force:
                instead = "" if force is None else ", or --force"
                raise CalibrationError(f"{option} {path}: is there, and is no result of this tool; give {option} another path{instead}")
    for stream, said in ((1, "standard output"), (2, "standard error")):
        _refuse_known(said, _status(stream), known)
    for (one, first), (other, second) in itertools.combinations(written, 2):
        if os.path.realpath(first) == os.path.realpath(second) or _identity(_status(first)) == (_identity(_status(second)) or 0):
            raise CalibrationError(f"{one} and {other} are both {second}; give one of them another path")
    for _, path in written:
        refuse_link(path)


def _is_result(path: Path) -> bool:
    """Whether nothing is there, or what this tool may have written; an empty file holds nothing that could be lost."""
    try:
        with open_file(path) as file:
            data = file.read(BEGINNING)
    except (FormatError, OSError):
        return not path.exists()
    return not data or RESULT.match(data) is not None


def _given(args: argparse.Namespace, options: dict[str, str]) -> Iterator[tuple[str, Path]]:
    for dest, option in options.items():
        if (path := getattr(args, dest)) is not None and path is not OWN_PLACE:
            yield option, path


def _read(args: argparse.Namespace, written: set[str]) -> Iterator[Path]:
    """Yield the other arguments that exist as a file or folder; the name of a model may be a file, too."""
    for dest, value in vars(args).items():
        for each in value if isinstance(value, (list, tuple)) else [value]:
            if dest not in written and isinstance(each, (str, Path)) and str(each) not in ("", STANDARD):
                path = Path(each)
                if _status(path) is not None:
                    yield path


def _refuse_known(said: str, status: os.stat_result | None, known: dict[tuple[int, int], Path]) -> None:
    if (source := known.get(_identity(status) or (0, 0))) is not None:
        also = "" if said.endswith(f" {source}") else f" {source}"
        what = f"is{also or ' a file'} that this command reads, or that was recorded"
        raise CalibrationError(f"{said}: {what}; give another path")


def _status(path: Path | int) -> os.stat_result | None:
    try:
        return os.stat(path)
    except (OSError, ValueError):
        return None


def _identity(status: os.stat_result | None) -> tuple[int, int] | None:
    """Return the identity of a regular file; devices, pipes and terminals may be read and written at once."""
    return None if status is None or not stat.S_ISREG(status.st_mode) else (status.st_dev, status.st_ino)


# Parsers of the command line.  Imports nothing heavy, so that --help is instant.

LONGEST_S = 1e9
MOST = 10**9  #: of any count
LARGEST_SEED = 2**63 - 1  #: accepted by every random generator
FASTEST_DPS = 1e5  #: the largest full scale in session.toml
SHORTEST_CLOSURE_S, LONGEST_CLOSURE_S = 5.0, 3600.0
EFFECTS_HELP = "folder with further effects, a Python file each, which is run; may be given several times"

BEGIN = """To begin: {program} fit data/session1 calibrates the session that comes with the tool.  At the bench: record, then check, fit,
explain and report, each with the session's folder.  {program} COMMAND --help says what a command takes."""


class _Parser(argparse.ArgumentParser):
    """A parser that reports wrong usage in one line, like every other error, with the nearest word that it knows."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"calibrate: {printable(message)}; see --help\n")

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Refuse a long option that is not known before what it stood for is found missing."""
        for name in [] if self._subparsers else self.unknown(args or ()):
            options = [option for option in self._option_string_actions if option.startswith("--")]
            self.error(f"{self.prog.split()[-1]} has no option {name[:80]}{meant(name, options)}")
        return super().parse_known_args(args, namespace)

    def unknown(self, words: Sequence[str]) -> list[str]:
        """Return the long options among the words that this command does not have."""
        names = [word.partition("=")[0] for word in itertools.takewhile(lambda word: word != "--", words) if word.startswith("--")]
        return [name for name in names if not any(option.startswith(name) for option in self._option_string_actions)]

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            command = isinstance(action, argparse._SubParsersAction)
            known = list(map(str, action.choices))
            near = meant(str(value), known)
            listed = "" if near and command else f", expected {', '.join(known)}"  # the commands would fill three lines
            said = f"{str(value)[:80]!r} is no {'command' if command else 'choice'}{listed}{near}"
            raise argparse.ArgumentError(None if command else action, said)


def parser(words: Sequence[str] = ()) -> argparse.ArgumentParser:
    """Return the parser of every command of ``tinygc.cli.commands``, or of the single command that ``words`` begins with."""
    whole = _Parser(
        prog=program(), description="Calibrate a MEMS gyroscope on a hand-turned table.", epilog=BEGIN.format(program=program())
    )
    from session import VERSION

    whole.add_argument("--version", action="version", version=f"TinyGC {VERSION}")
    parsers = whole.add_subparsers(title="commands", required=True, metavar="COMMAND")
    one = command_module(words[0]) if words else None
    for name, module in {words[0]: one}.items() if one is not None else ((name, command_module(name)) for name in commands()):
        assert module is not None
        summary = module.SUMMARY
        command = parsers.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
        command.set_defaults(run=module.run, kind=getattr(module, "Options", None))
        if hasattr(module, "Options"):
            command.epilog = getattr(module, "EPILOG", None)
            add_arguments(command, module.Options)
            command.set_defaults(paths=Paths.of(command))
            continue
        command.add_argument("--json", type=file_written, metavar="FILE", help="write the result as JSON (- for standard output)")
        command.add_argument("--seed", type=count(0, LARGEST_SEED), default=0, help="of every random draw (%(default)s)")
        command.add_argument("--force", action="store_true", help="write over what is there: another's file, a log, an earlier simulation")
        command.add_argument("--quiet", action="store_true", help="print nothing but errors, and the verdict where one was asked for")
        if getattr(module, "USES_EFFECTS", False):
            command.add_argument("--effects", type=path_read, action="append", default=[], metavar="DIR", help=EFFECTS_HELP)
        module.add_arguments(command)
        for add in features.each(f"options of {name}", features.beside()):
            add(command)
        if one is None or command.unknown(words) or {"-h", "--help"} & set(words):
            for add in features.each(f"options of {name}", features.installed()):
                add(command)
        command.set_defaults(paths=Paths.of(command))
    return whole


def add_field_arguments(command: argparse._ActionsContainer, flags: Mapping[str, tuple[str, Field]]) -> None:
    """Add an option for each field of a dataclass: flag -> (destination, field); help comes from the metadata; None where not given."""
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


def given_fields(args: argparse.Namespace, options: type, prefix: str = "") -> dict[str, Any]:
    """Return field -> value of the given options of a dataclass; prefix: of their destinations."""
    values = {field.name: getattr(args, prefix + field.name) for field in fields(options)}
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items() if value is not None}


def filled(text: str) -> str:
    """Parse any text that is not empty."""
    if not text.strip():
        raise argparse.ArgumentTypeError("an empty name")
    return text


def count(least: int, most: int = MOST) -> Callable[[str], int]:
    """Return a parser of whole numbers from ``least`` to ``most``."""

    def parse(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"{value} is less than {least}")
        if value > most:
            raise argparse.ArgumentTypeError(f"{text} is more than {most}")
        return value

    parse.__name__ = "whole number"
    return parse


def memory(text: str) -> int:
    """Parse an amount of memory, ``3GB`` or ``700 MB``, to bytes."""
    match = re.fullmatch(r"(\d{1,6}(?:\.\d{1,3})?) ?([MG])B", text.strip(), re.IGNORECASE | re.ASCII)
    if match is None or not float(match[1]):
        raise argparse.ArgumentTypeError(f"{text!r} is no amount of memory such as 3GB or 700MB")
    return int(float(match[1]) * {"M": 10**6, "G": 10**9}[match[2].upper()])


def positive(text: str) -> float:
    """Parse a number above zero."""
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is no positive number")
    return value


positive.__name__ = "number"  # for argparse's message "invalid number value"


def within(low: float, high: float, what: str = "number", unit: str = "") -> Callable[[str], float]:
    """Return a parser of numbers in a range; what and unit: for the error message."""

    def parse(text: str) -> float:
        value = float(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is no {what} from {low:g} to {high:g}{unit}")
        return value

    parse.__name__, parse.__doc__ = "number", f"A {what} from {low:g} to {high:g}{unit}."
    return parse


#: ranges of a sensor's values in session.toml (docs/formats.md)
data_rate, gyro_full_scale, accel_full_scale = within(0.1, 50_000), within(1, FASTEST_DPS), within(0.1, 1000)
#: times: up to 30 years, which a program can wait for and a counter can hold; duration of a closure run
seconds, closure_seconds = within(0, LONGEST_S, "time", " s"), within(SHORTEST_CLOSURE_S, LONGEST_CLOSURE_S, "time", " s")


#: s of a unit of time
TIMES_S = {"min": 60.0, "s": 1.0, "h": 3600.0, "d": 86400.0}


def duration(text: str) -> float:
    """Parse a time, s: ``30d``, ``12 h``, ``90min`` or ``3600``."""
    plain = text.strip().lower()
    unit = next((name for name in TIMES_S if plain.endswith(name)), "")
    try:
        value = float(plain.removesuffix(unit)) * TIMES_S.get(unit, 1.0)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r:.40}: expected a time such as 30d, 12h, 90min or 3600s")
    return value


def note(text: str) -> tuple[str, str]:
    """Parse ``KEY=TEXT``."""
    key, sign, value = text.partition("=")
    if not sign or not key.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"{text!r} is no KEY=TEXT such as operator=Mara")
    return " ".join(key.split()), " ".join(value.split())


def effect_parameters(text: str) -> tuple[str, dict]:
    """Parse ``ID=JSON``, an effect's parameters by their names."""
    from session.base.errors import FormatError
    from session.base.results import read_json_text

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
    """Parse a text stream's header line."""
    from session.bench.events import parse_header

    if parse_header(text.encode()) is None:
        expected = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c (or _rps, _mps2), or registers t_us,gx,gy,gz,ax,ay,az,temp"
        raise argparse.ArgumentTypeError(f"{text!r} is no header; expected {expected}")
    return text


def three(text: str) -> list[float]:
    """Parse three rates in dps, separated by commas, within a gyroscope's range."""
    values = [float(word) for word in text.split(",")]
    if len(values) != 3 or not all(abs(value) <= FASTEST_DPS for value in values):
        raise argparse.ArgumentTypeError(f"{text!r} is no triple of numbers within ±{FASTEST_DPS:g}, such as 0.5,-0.3,0.6")
    return values


three.__name__ = "three numbers"


def rates_dps(text: str) -> tuple[float, ...]:
    """Parse rates such as ``50,100,200``, dps; ArgumentTypeError for one that is no rate above zero."""
    try:
        rates = tuple(float(word) for word in text.split(","))
    except ValueError:
        rates = ()
    if not rates or not all(0 < rate < 1e5 for rate in rates):
        raise argparse.ArgumentTypeError(f"{text[:40]!r}: expected rates above 0 in dps, such as 50,100,200")
    return rates
