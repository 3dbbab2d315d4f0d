"""Options declared once: the command line, the check, the keywords and the documentation of one small record, to the letter."""

from __future__ import annotations

import argparse
import importlib
import inspect
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from session.base.errors import CalibrationError
from session.base.options import (
    OptionError,
    Record,
    add_arguments,
    argument,
    declared,
    documented,
    file_written,
    from_arguments,
    given,
    keywords,
    option,
    part,
    path_read,
)
from tinygc.cli.commands import command_module, commands


@documented
@dataclass(frozen=True)
class Search(Record):
    """Options of a search.

    Examples
    --------
    >>> Search().folds
    5

    """

    folds: int = option(5, "folds of it", least=2, most=9)
    bias: str = option("auto", "where it is from", choices=("auto", "ends"))
    words: tuple[str, ...] = option(("raw",), "methods", some=("raw", "least_squares"))
    earth: bool = option(True, "subtract it", off="leave it in")
    seed: int = option(0, "of the draws", cli=False)
    limit_deg: float | None = option(None, "at most this", unit="deg", above=0, flags=("--limit",), default_key="limits.closure_deg")
    noise: float = option(0.5, "white", unit="dps/sqrt(Hz)", least=0)
    exclude: tuple[int, ...] = option((), "segments to leave out")
    lever_m: tuple[float, float, float] = option((0.0, 0.0, 0.1), "to the sensor", unit="m")


@dataclass(frozen=True)
class Command(Search):
    """With what the command line alone has."""

    folder: Path = argument("session folder")
    more: tuple[Path, ...] = argument("further ones", ())
    out: Path | None = option(None, "write it", read=file_written, alone=Path(), flags=("-o", "--out"))
    history: tuple[Path, ...] = option((), "a session", repeated=True, group="priors")
    strict: bool = option(False, "exit 1")


@dataclass(frozen=True)
class Rest(Record):
    """Whose flags begin with a word."""

    PREFIX = "rest-"
    cycles: float = option(0.0, "of the temperature")


@dataclass(frozen=True)
class Board(Record):
    """Whose folder may be left out."""

    folder: Path | None = argument("session folder", None)


def parsed(*words: str, kind=Command):
    parser = argparse.ArgumentParser(exit_on_error=False)
    add_arguments(parser, kind)
    return from_arguments(kind, parser.parse_args(words))


def test_an_argument_that_is_left_out_has_its_default():
    assert parsed(kind=Board).folder is None
    assert parsed(".", kind=Board).folder == Path()


def test_the_command_line_gives_the_record_that_python_makes():
    words = "--folds 3 --bias ends --words least_squares,raw --no-earth --limit 0.5 --exclude 3,17 --exclude 3 --lever-m -1 0 2"
    own = ["s", "t", "u", "-o", "x.json", "--history", "a", "--history", "b", "--strict"]
    found = parsed(*words.split(), *own)
    assert found == Command(
        folds=3,
        bias="ends",
        words=("least_squares", "raw"),
        earth=False,
        limit_deg=0.5,
        exclude=(3, 17),
        lever_m=(-1.0, 0.0, 2.0),
        folder=Path("s"),
        more=(Path("t"), Path("u")),
        out=Path("x.json"),
        history=(Path("a"), Path("b")),
        strict=True,
    )
    assert (parsed("s"), parsed("s", "--out").out) == (Command(folder=Path("s")), Path())
    assert part(found, Search, folds=4) == Search(4, "ends", ("least_squares", "raw"), False, 0, 0.5, 0.5, (3, 17), (-1.0, 0.0, 2.0))
    assert given(found, ("folds", "words")) == [
        "--out",
        "--history",
        "--strict",
        "--bias",
        "--no-earth",
        "--limit",
        "--exclude",
        "--lever-m",
    ]
    assert (given(parsed("s")), parsed("--rest-cycles", "2", kind=Rest).cycles) == ([], 2.0)


def test_help_says_unit_bounds_and_default_from_the_field():
    parser = argparse.ArgumentParser(prog="p", add_help=False)
    add_arguments(parser, Command)
    lines = [
        " ".join(line.split()) for line in parser.format_help().split("\n\n", 1)[1].replace("\n                        ", " ").split("\n")
    ]
    assert [line for line in lines if line] == [
        "positional arguments:",
        "folder session folder",
        "more further ones",
        "options:",
        "-o [FILE], --out [FILE] write it",
        "--strict exit 1",
        "--folds N folds of it (5)",
        "--bias auto|ends where it is from (auto)",
        "--words A,B methods",
        "--no-earth leave it in",
        "--limit DEG at most this",
        "--noise X dps/sqrt(Hz), white (0.5)",
        "--exclude N,N segments to leave out",
        "--lever-m M M M to the sensor",
        "priors:",
        "--history DIR a session",
    ]


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("folds", 1, "folds is 1, expected a whole number from 2 to 9"),
        ("folds", True, "folds is True, expected a whole number from 2 to 9"),
        ("folds", 2.5, "folds is 2.5, expected a whole number from 2 to 9"),
        ("bias", "magic", "bias is 'magic', expected one of auto, ends"),
        ("words", "resnet", "words is 'resnet', expected some of raw, least_squares"),
        ("words", (), "words is (), expected some of raw, least_squares"),
        ("earth", 1, "earth is 1, expected True or False"),
        ("limit_deg", 0, "limit_deg is 0, expected a number above 0 deg"),
        ("noise", float("nan"), "noise is nan, expected a number of 0 or more dps/sqrt(Hz)"),
        ("noise", None, "noise is None, expected a number of 0 or more dps/sqrt(Hz)"),
        ("exclude", ("3",), "exclude is ('3',), expected a list of whole numbers"),
        ("lever_m", (1.0, 2.0), "lever_m is (1.0, 2.0), expected three numbers m"),
    ],
)
def test_a_value_outside_of_what_is_declared_is_one_line(name, value, says):
    with pytest.raises(OptionError, match=f"^{re.escape(says)}$"):
        Search(**{name: value})


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("s --folds 1", "--folds is 1, expected a whole number from 2 to 9; see --help"),
        ("s --limit 0", "--limit is 0.0, expected a number above 0 deg; see --help"),
        ("s --folds x", "argument --folds: invalid whole number value: 'x'"),
        (
            "s --words least-squares",
            "argument --words: 'least-squares' is no choice, expected some of raw,least_squares; is 'least_squares' meant?",
        ),
        ("s --exclude 3,,4", "argument --exclude: '3,,4' is no list of segment numbers such as 3,17"),
        ("s --history=", "argument --history: an empty name; give a file or folder (. for this one)"),
    ],
)
def test_on_the_command_line_the_flag_is_named_as_it_is_typed(words, says):
    with pytest.raises((CalibrationError, argparse.ArgumentError), match=f"^{re.escape(says)}$"):
        parsed(*words.split())


def test_a_text_is_a_path_one_value_a_list_and_numpys_numbers_are_numbers():
    found = Command(folder="s", history="a", words="raw", folds=np.int64(3), noise=np.float32(1.5))
    assert (found.folder, found.history, found.words, found.folds, float(found.noise)) == (Path("s"), (Path("a"),), ("raw",), 3, 1.5)


ENTRIES = """folds : int, default 5
    Folds of it; a whole number from 2 to 9.
bias : {'auto', 'ends'}, default 'auto'
    Where it is from.
words : tuple of str, default ('raw',)
    Methods.
earth : bool, default True
    Subtract it.
seed : int, default 0
    Of the draws.
limit_deg : float, optional
    At most this; a number above 0 deg.
noise : float, default 0.5
    White; a number of 0 or more dps/sqrt(Hz).
exclude : tuple of int, optional
    Segments to leave out.
lever_m : tuple of float, default (0.0, 0.0, 0.1)
    M, to the sensor.
"""


def test_a_function_has_the_fields_as_keywords_and_in_its_docstring():
    def search(session, seed=3, **choices):
        """Search.

        Parameters
        ----------
        session : Session
            The recording.

        Returns
        -------
        None
        """

    keywords(search, Search)
    names = ["session", "seed", "folds", "bias", "words", "earth", "limit_deg", "noise", "exclude", "lever_m"]
    assert list(inspect.signature(search).parameters) == names
    assert (inspect.signature(search).parameters["folds"].default, inspect.signature(search).parameters["seed"].default) == (5, 3)
    entries = ENTRIES.replace("seed : int, default 0\n    Of the draws.\n", "")
    before = "Search.\n\nParameters\n----------\nsession : Session\n    The recording.\n"
    assert search.__doc__ == f"{before}{entries}\nReturns\n-------\nNone\n"
    assert Search.__doc__.startswith(f"Options of a search.\n\nParameters\n----------\n{ENTRIES}\nExamples\n--------\n")


@pytest.mark.parametrize("name", ["commands.md", "library.md"])
def test_the_pages_have_the_tables_as_they_are_made(name, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    make_options = importlib.import_module("make_options")
    page = (ROOT / "docs" / name).read_text(encoding="utf-8")
    assert page == make_options.made(page, make_options.PAGES[name]()), "python docs/make_options.py"


def test_every_command_says_of_every_option_what_it_means():
    """And a path is read or written by what its type, or its parser, says."""
    for name in commands():
        for each, rule in declared(getattr(command_module(name), "Options", Search)):
            assert rule.help, f"{name}: {each.name}"
            assert "Path" not in str(each.type) or rule.read is None or rule.read.__name__ == path_read.__name__, f"{name}: {each.name}"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["fit", "s", "--accelerometer", "alone", "--methods", "pso"], "--methods: of no use with --accelerometer alone; leave it out"),
        (["fit", "s", "--accelerometer", "alone", "--bias", "ends", "--strict"], "--bias, --strict: of no use with"),
        (["check", "s", "--plan", "--strict", "--all"], "--strict, --all: of no use with --plan; leave them out"),
        (["check", "s", "--repair", "r", "--plan"], "--plan: of no use with --repair"),
        (["record", "--port", "list", "--out", "x", "--odr", "3"], "--out, --odr: of no use with --port list"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(words, says, run):
    code, _, err = run(*words)
    assert (code, says in err) == (2, True), err


def test_a_folder_behind_an_option_that_may_stand_alone_is_no_value_of_it(run):
    code, _, err = run("check", "--plan", "s1")
    assert (code, "'s1' is no whole number; put it before the option" in err) == (2, True), err
