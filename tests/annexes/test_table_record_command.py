"""``record --table`` as a command: what is refused before anything moves, and what its last lines say."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from tinygc.cli.arguments import parser
from tinygc.cli.commands import record


@pytest.mark.parametrize(
    "given",
    [
        ["--table", "t.toml", "--home", "--stop-at-target", "--segments", "12", "--closure", "30", "--table-port", "p"],
        ["--stop-at-target", "--lot", "lot.json"],
        ["--rest", "2", "--stop-at-target", "--known-to", "10"],
        ["--table", "t.toml", "--rates", "10,20", "--dwell", "5", "--axis", "inner"],
    ],
)
def test_the_printed_command_goes_on_with_what_was_asked(given):
    """Without --stop-at-target a machine would go on to the last of its segments."""
    words = ["record", "--out", "s", "--port", "p", *given]
    args = parser(words).parse_args(words)
    again = shlex.split(record._again(args, Path("s"), "p"))
    again = again[again.index("record") :]
    assert vars(parser(again).parse_args(again)) == vars(args) | {"resume": True}
