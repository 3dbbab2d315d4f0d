"""Logs in the place of session folders: each becomes a session next to it; a terminal is asked for what it does not state."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

from session.base.errors import CalibrationError, FormatError
from session.base.files import is_stream
from session.base.options import READERS, flag, part
from session.base.texts import command_line, printable
from session.replay.options import Answers, Place

R = TypeVar("R")


def of_session(args: R) -> tuple[R, str]:
    """The options of a command with the session folder of the logs that they name, and how these were read, in one line; of folders the
    options as they are, and nothing.  Several logs are one recording's, as a telephone's."""
    options: Any = args
    paths = (options.folder, *getattr(options, "more", ()))
    answers = part(args, Answers) if isinstance(args, Answers) else Answers()
    latitude_deg = args.latitude_deg if isinstance(args, Place) else None
    if not any(path.is_file() for path in paths):
        if replace(answers, sensor=None) != Answers():
            raise CalibrationError(f"{options.folder}: a folder states its units itself; leave the options of a log out")
        for path in paths:
            _fill_in(path, latitude_deg, answers.sensor)
        return args, ""
    if folders := [path for path in paths if not path.is_file()]:
        raise CalibrationError(f"{folders[0]}: {'a folder' if folders[0].exists() else 'not found'}, among logs; give logs or folders")
    folder, read_as, made = _session(paths, answers, options.quiet)
    if made and isinstance(args, Place) and latitude_deg is None:
        latitude_deg = ask_latitude(options.quiet)
    _fill_in(folder, latitude_deg, None if made else answers.sensor)
    return replace(options, folder=folder, **({"more": ()} if options.__dict__.get("more") else {})), read_as


def log_of(paths: Sequence[Path], quiet: bool) -> tuple[Path, str]:
    """The standard log of some paths, and how these were read, in one line: one that is standard, a stream or a folder as it is, and
    nothing; of another program's, or of a telephone's two, the log of the session next to it, which is made where it is not there."""
    from session.base.names import log_paths
    from session.log.reader import Reader

    if len(paths) == 1:
        try:
            if paths[0].is_file() and not is_stream(paths[0]):
                Reader(paths[0], gyro_alone=True)
            return paths[0], ""
        except FormatError:  # by its header no standard log
            pass
    if missing := [path for path in paths if not path.is_file()]:
        raise CalibrationError(f"{missing[0]}: no file, among a recording's logs; give one log, or a telephone's two")
    from session.base.questions import QuestionsError  # late: a standard log needs no reader of others
    from session.replay.recognise import UnknownColumnsError

    try:
        folder, read_as, _ = _session(paths, Answers(), quiet)
    except (QuestionsError, UnknownColumnsError) as error:
        raise CalibrationError(f"{error}; these are options of `{command_line('fit', *paths)}`") from None
    return next(iter(log_paths(folder, "log")), folder), read_as


def _fill_in(folder: Path, latitude_deg: float | None, sensor: str | None) -> None:
    """Give a session.toml what it does not state yet; FormatError where it states another."""
    from session.log.config import read_config
    from session.log.folder import fill_in
    from session.log.registers import profile_of, require_profile

    if latitude_deg is not None:
        fill_in(folder / "session.toml", "site", "latitude_deg", latitude_deg)
    if sensor is None:
        return
    named, config = require_profile(sensor), read_config(folder / "session.toml")
    if not config.model_given or profile_of(config.sensor.model) is not named:
        fill_in(folder / "session.toml", "sensor", "model", named.name)


#: as people write it: 48.1, -33,9, 31.03° N
LATITUDE = re.compile(r"([NSns]?) *+([+-]?[\d.,]++) *+°? *+([NSns]?)")


def _at_terminal() -> bool:
    return bool(sys.stdin and sys.stdin.isatty() and sys.stderr.isatty())


def ask_latitude(quiet: bool) -> float | None:
    """What a person answers; None where there is none, or who does not know it."""
    while not quiet and _at_terminal():
        print("your latitude in degrees, for the Earth's rotation (Enter: unknown)? ", end="", file=sys.stderr, flush=True)
        if not (text := sys.stdin.readline().strip()):
            break
        try:
            north, number, also = LATITUDE.fullmatch(text).groups()  # type: ignore[union-attr]
            degrees = READERS["float"](number.replace(",", "."))
            return Place(-degrees if "s" in f"{north}{also}".lower() else degrees).latitude_deg
        except (AttributeError, ValueError, CalibrationError):
            print(f"{printable(text[:40])} is no latitude; give a number such as 48.1, or -33.9 in the south", file=sys.stderr)
    return None


def _session(paths: Sequence[Path], answers: Answers, quiet: bool) -> tuple[Path, str, bool]:
    from session.base.questions import QuestionsError
    from session.replay.importing import session_next_to

    try:
        return session_next_to(paths, answers)
    except QuestionsError as requested:
        known = {flag(Answers, each.name): each for each in fields(Answers)}
        wanted = {question: known.get(question.option.split()[0]) for question in requested.questions}
        if quiet or not _at_terminal() or None in wanted.values():
            raise
        found: dict[str, Any] = {}
        for question, each in wanted.items():
            assert each is not None
            choices = question.choices or question.option.partition(" ")[2]
            print(f"{requested.file}: what is {question.what}? ({choices}) ", end="", file=sys.stderr, flush=True)
            text = sys.stdin.readline().strip()
            if not text:
                raise
            try:
                found[each.name] = READERS[str(each.type).removesuffix(" | None")](text)
            except ValueError:
                raise CalibrationError(f"{text[:40]!r} is no answer; give {question.typed}") from None
    return _session(paths, replace(answers, **found), quiet)
