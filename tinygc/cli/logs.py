"""Logs in the place of session folders: each becomes a session next to it; a terminal is asked for what it does not state."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

from session.base.errors import CalibrationError
from session.base.options import READERS, flag, part
from session.replay.options import Answers

R = TypeVar("R")


def of_session(args: R) -> tuple[R, str]:
    """The options of a command with the session folder of the logs that they name, and how these were read, in one line; of folders the
    options as they are, and nothing.  Several logs are one recording's, as a telephone's."""
    options: Any = args
    paths = (options.folder, *getattr(options, "more", ()))
    answers = part(args, Answers) if isinstance(args, Answers) else Answers()
    if not any(path.is_file() for path in paths):
        if answers != Answers():
            raise CalibrationError(f"{options.folder}: a folder states its units itself; leave the options of a log out")
        return args, ""
    if folders := [path for path in paths if not path.is_file()]:
        raise CalibrationError(f"{folders[0]}: {'a folder' if folders[0].exists() else 'not found'}, among logs; give logs or folders")
    folder, read_as = _session(paths, answers, options.quiet)
    return replace(options, folder=folder, **({"more": ()} if options.__dict__.get("more") else {})), read_as


def _session(paths: Sequence[Path], answers: Answers, quiet: bool) -> tuple[Path, str]:
    from session.base.questions import QuestionsError
    from session.replay.importing import session_next_to

    try:
        return session_next_to(paths, answers)
    except QuestionsError as requested:
        known = {flag(Answers, each.name): each for each in fields(Answers)}
        wanted = {question: known.get(question.option.split()[0]) for question in requested.questions}
        if quiet or not (sys.stdin and sys.stdin.isatty() and sys.stderr.isatty()) or None in wanted.values():
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
