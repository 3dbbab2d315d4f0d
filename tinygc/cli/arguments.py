"""Arguments and paths of the command line.  Imports nothing heavy, so that --help is instant."""

from __future__ import annotations

import argparse
import itertools
import math
import os
import re
import stat
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

from session.base import features
from session.base.errors import CalibrationError, FormatError
from session.base.files import KB, is_stream, open_file, refuse_link
from session.base.names import has_recorded_name, is_session
from session.base.options import (
    add_arguments,
    declared,
    file_written,
    flag,
    folder_written,
    from_arguments,
    log_written,
    meant,
)
from session.base.texts import command_line, program
from tinygc.cli.commands import command_module, commands, grouped
from tinygc.cli.defaults import take_defaults

# Path arguments: each is declared as read or written, and an output never replaces an input or a recorded file.
#
# A command only declares ``read=file_written`` or ``folder_written``.  ``refuse_overwriting`` then checks every output against every
# input, and against the files of every session, before the command begins.

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
#: of a help page
COLUMNS = 79
#: shells that can complete commands
SHELLS = ("bash", "zsh")
#: files in an input folder that are not recorded, but that other commands read
DERIVED = ("fit/*.json", "explain/explain.json", "*.py")
#: command -> the one of these files that it writes itself, with the content of its JSON
OWN = {"fit": "fit.json", "explain": "explain.json", "noise": "noise.json", "rates": "rates.json"}


def is_standard_output(path: Path | None) -> bool:
    """Whether the path is standard output."""
    return str(path) in STANDARD_OUTPUT


def options_of(args: argparse.Namespace) -> Any:
    """The options of a command with the user's defaults, checked; its outputs replace nothing that is read or recorded."""
    kind, *more = args.kinds
    options = take_defaults(from_arguments(kind, args))
    options = replace(options, of_features=tuple(from_arguments(each, args) for each in more))
    refuse_overwriting(options, args.command_name)
    return options


def _paths(options: Any, *kinds: Callable[[str], Path]) -> Iterator[tuple[str, Path]]:
    """Yield flag and path of the outputs that are given, of these kinds."""
    for record in (options, *options.of_features):
        for each, rule in declared(record):
            path = getattr(record, each.name)
            if rule.read in kinds and path is not None and path is not OWN_PLACE:
                yield flag(record, each.name), path


def refuse_overwriting(options: Any, command: str) -> None:
    """Raise CalibrationError where an output is an input, a recording's own file, or another output, before anything is changed.

    Paths are compared by their targets: through links of either kind, ``..``, ``/dev/fd`` and another case of their letters.
    """
    for option, path in _paths(options, folder_written):
        if path.exists() and not path.is_dir():
            raise CalibrationError(f"{option} {path}: that is no folder; give {option} a folder, which is made where it is not there")
    logs = {option for option, _ in _paths(options, log_written)}
    written = [(option, path) for option, path in _paths(options, file_written, log_written) if str(path) != STANDARD]
    folders = [path for _, path in _paths(options, folder_written) if str(path) != STANDARD]
    read = list(_read(options))
    # The files that must not change, by their identity in the file system: those paths, and the inputs in folders.
    but = OWN.get(command, "")
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
            counts = there or option not in logs
            if counts and has_recorded_name(place) and (place.parent in homes or is_session(place.parent)):
                what = "is a file of the recording in" if there else "has the name of a recording's file in"
                raise CalibrationError(f"{option} {path}: {what} {place.parent}, where nothing is written over; give {option} another path")
        if option not in logs and not (path.is_symlink() or is_stream(path) or _is_result(path)):
            force = getattr(options, "force", None)
            if not force:
                instead = "" if force is None else ", or --force"
                raise CalibrationError(f"{option} {path}: is there, and is no result of this tool; give {option} another path{instead}")
    for stream, label in ((1, "standard output"), (2, "standard error")):
        _refuse_known(label, _status(stream), known)
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


def _read(options: Any) -> Iterator[Path]:
    """Yield the other options that exist as a file or folder; the name of a model may be a file, too."""
    known = ((record, *declaration) for record in (options, *options.of_features) for declaration in declared(record))
    for record, each, rule in known:
        value = getattr(record, each.name)
        for one in value if isinstance(value, tuple) else [value]:
            if rule.read in (file_written, log_written, folder_written) or not isinstance(one, str | Path) or str(one) in ("", STANDARD):
                continue
            if _status(Path(one)) is not None:
                yield Path(one)


def _refuse_known(label: str, status: os.stat_result | None, known: dict[tuple[int, int], Path]) -> None:
    if (source := known.get(_identity(status) or (0, 0))) is not None:
        also = "" if label.endswith(f" {source}") else f" {source}"
        what = f"is{also or ' a file'} that this command reads, or that was recorded"
        raise CalibrationError(f"{label}: {what}; give another path")


def _status(path: Path | int) -> os.stat_result | None:
    try:
        return os.stat(path)
    except (OSError, ValueError):
        return None


def _identity(status: os.stat_result | None) -> tuple[int, int] | None:
    """Return the identity of a regular file; devices, pipes and terminals may be read and written at once."""
    return None if status is None or not stat.S_ISREG(status.st_mode) else (status.st_dev, status.st_ino)


# The parser of the command line.  Imports nothing heavy, so that --help is instant.

BEGIN = """Calibrate a MEMS gyroscope on a hand-turned table, and state how well.

Begin with:  {example}"""
END = """{program} COMMAND --help  shows the usual options of a command
--version  --completion bash|zsh
"""


class _Parser(argparse.ArgumentParser):
    """A parser that reports wrong usage in one line, like every other error, with the nearest word that it knows."""

    def format_help(self, everything: bool = False) -> str:
        """The commands by their groups; of one command its usual options, or everything."""
        if self._subparsers:
            return _overview()
        rare = [action for action in self._actions if getattr(action, "rare", False) and not everything]
        help_of, epilog = {action: action.help for action in rare}, self.epilog
        for action in rare:
            action.help = argparse.SUPPRESS
        self.epilog = epilog if everything else None
        needed = (f"{action.option_strings[-1]} {action.metavar}" for action in self._actions if action.option_strings and action.required)
        positional = [(str(each.metavar or each.dest), each.nargs) for each in self._actions if not each.option_strings]
        places = (f"[{name}]" if count in ("?", "*") else name for name, count in positional)
        self.usage = " ".join([self.prog, "[options]", *needed, *places]).replace("%", "%%")
        text = super().format_help()
        for action, words in help_of.items():
            action.help = words
        self.epilog = epilog
        return text + (f"\n--help-all shows {len(rare)} further options\n" if rare else "")

    def error(self, message: str) -> NoReturn:
        logs = "; `fit LOG LOG` takes a telephone's two" * os.path.isfile(message.removeprefix("unrecognized arguments: "))
        raise CalibrationError(f"{message}{logs}; see --help")

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Refuse a long option that is not known before what it stood for is found missing."""
        for name in [] if self._subparsers else self.unknown(args or ()):
            options = [option for option in self._option_string_actions if option.startswith("--")]
            self.error(f"{self.prog.removeprefix(program()).strip()} has no option {name[:80]}{meant(name, options)}")
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
            listed = "" if command else f", expected {', '.join(known)}"  # the commands would fill three lines
            label = f"{str(value)[:80]!r} is no {'command' if command else 'choice'}{listed}{near}"
            raise argparse.ArgumentError(None if command else action, label)


class _Formatter(argparse.HelpFormatter):
    """Help of an option next to it."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=21, width=COLUMNS)

    def _format_args(self, action: argparse.Action, default_metavar: str) -> str:
        return super()._format_args(action, default_metavar).partition(" [")[0]  # of several values the first


class _HelpAll(argparse.Action):
    """Prints all options of a command, and ends."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: object, values: Any, option_string: str | None = None) -> None:
        assert isinstance(parser, _Parser)
        sys.stdout.write(parser.format_help(everything=True))
        parser.exit()


class _Completion(argparse.Action):
    """Prints a shell's script, and ends."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: object, values: Any, option_string: str | None = None) -> None:
        from tinygc.cli.completion import script

        sys.stdout.write(script(values, parser))
        parser.exit()


def joined(words: Sequence[str]) -> list[str]:
    """Return the words of a command line with a command of two words as one."""
    two = " ".join(words[:2])
    return [two, *words[2:]] if two in commands() else list(words)


def _overview() -> str:
    """The commands by their groups, a line each; those of a laboratory by their names alone."""
    lines = [BEGIN.format(example=command_line("fit", "data/session1") if os.path.isdir("data/session1") else command_line("demo"))]
    for group, known in grouped().items():
        names = (f"{name}{' [record]' * (f'{name} record' in known)}" for name in known if " " not in name)
        rows = [", ".join(names)] if group == "lab" else [f"{name:9} {summary}" for name, summary in known.items()]
        lines += [f"{'' if number else group:9} {row}" for number, row in enumerate(rows)]
    return "\n".join([*lines, END.format(program=program())])


def parser(words: Sequence[str] = ()) -> argparse.ArgumentParser:
    """Return the parser of every command, or of the single one that ``words`` begins with; of ``--help``, with their summaries alone."""
    whole = _Parser(prog=program())
    from session import VERSION

    whole.add_argument("--version", action="version", version=f"TinyGC {VERSION}")
    whole.add_argument("--completion", action=_Completion, choices=SHELLS, help="print what makes this shell complete commands and options")
    parsers = whole.add_subparsers(title="commands", required=True, metavar="COMMAND")
    known = commands()
    for name in words[:1] if words and words[0] in known else known:
        summary = f"{known[name][0].upper()}{known[name][1:]}."
        command = parsers.add_parser(name, help=known[name], description=summary, add_help=False, formatter_class=_Formatter)
        command.add_argument("-h", "--help", action="help", help=argparse.SUPPRESS)
        if words[:1] == ["--help"]:
            continue
        command.add_argument("--help-all", action=_HelpAll, nargs=0, help=argparse.SUPPRESS)
        module: Any = command_module(name)
        command.epilog = getattr(module, "EPILOG", None)
        kinds = [module.Options, *features.each(f"options of {name}")]
        for kind in kinds:
            add_arguments(command, kind)
        command.set_defaults(run=module.run, command_name=name, kinds=kinds)
    return whole


def memory(text: str) -> int:
    """Parse an amount of memory, ``3GB`` or ``700 MB``, to bytes."""
    match = re.fullmatch(r"(\d{1,6}(?:\.\d{1,3})?) ?([MG])B", text.strip(), re.IGNORECASE | re.ASCII)
    if match is None or not float(match[1]):
        raise argparse.ArgumentTypeError(f"{text!r} is no amount of memory such as 3GB or 700MB")
    return int(float(match[1]) * {"M": 10**6, "G": 10**9}[match[2].upper()])


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
