"""The command line: each line of the input is an argument.  Nothing is run."""

from __future__ import annotations

import argparse
import contextlib
import io
from functools import cache
from pathlib import Path

from fuzz_targets.rules import LONGEST_MESSAGE
from tinygc.cli.arguments import parser
from tinygc.cli.commands import COMMANDS

OPTIONS = (
    *("--json", "--seed", "--quiet", "--effects", "--methods", "--bias", "--limit", "--strict", "--to", "--model", "--out"),
    *(
        "--odr",
        "--gyro-fs",
        "--accel-fs",
        "--sensor",
        "--note",
        "--header",
        "--columns",
        "--gyro-axes",
        "--bias-dps",
        "--closure",
        "--help",
    ),
    *("--force", "--add", "--serial", "--segments", "--exclude", "--physics", "--as-in-paper", "--version", "--resume", "--like"),
)


def seeds() -> list[bytes]:
    """A line for each command, and options with values."""
    found = [f"{name}\ndata/session1".encode() for name in COMMANDS]
    found += [f"{name}\n{option}\n1".encode() for name in COMMANDS for option in ("--seed", "--json")]
    return [
        *found,
        b"fit\nD\n--methods\nleast_squares,pso\n--still-rates",
        b"record\n--note\na=b\n--odr\n208",
        b"simulate\nD\n--bias-dps\n1,2,3",
    ]


def run(data: bytes, folder: Path) -> None:
    """Accepted, or one line on standard error and exit code 2; help and version are 0."""
    said, out = io.StringIO(), io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
        code = _exit_code(data.decode("utf-8", errors="surrogateescape").split("\n"))
    text = said.getvalue()
    if code == 2:
        assert text.count("\n") == 1, f"not one line: {text[:300]!r}"
        assert text.endswith("\n")
        assert text[:-1].isprintable(), f"control characters: {text[:300]!r}"
        assert len(text) <= LONGEST_MESSAGE + 4 * len(data), f"{len(text)} characters"
    else:
        assert not text
        assert code is None or (code == 0 and out.getvalue()), f"exit code {code}"


@cache
def _parser() -> argparse.ArgumentParser:
    return parser()


def _exit_code(words: list[str]) -> object:
    """None where they are accepted."""
    try:
        _parser().parse_args(words)
    except SystemExit as stopped:
        return stopped.code
    return None
