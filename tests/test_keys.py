"""Keys while recording: what is typed, one at a time and without an echo; none where there is no terminal; the terminal is set back."""

import os
import sys

import pytest
from processes import until

from session.bench.operator import LONGEST_NOTE, Keyboard, OperatorCommand, TypingLine

termios = pytest.importorskip("termios", reason="a pseudo-terminal is needed, which only POSIX has")
import pty  # noqa: E402


@pytest.fixture
def terminal(monkeypatch):
    """The master of a pseudo-terminal that is standard input."""
    master, slave = pty.openpty()
    with os.fdopen(slave, "r", encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield master, slave
    os.close(master)


def typed(keys: Keyboard, master: int, data: bytes) -> str:
    os.write(master, data)
    return until(keys, what="a key")


def test_keys_come_at_once_without_an_echo_and_the_terminal_is_set_back(terminal):
    master, slave = terminal
    before = termios.tcgetattr(slave)
    with Keyboard() as keys:
        assert keys.there
        assert keys() == ""
        assert typed(keys, master, b"p") == "p"  # no Enter
        assert typed(keys, master, "é\x7f".encode()) == "é\x7f"
        assert typed(keys, master, b"\x1b[A\x1bOPd\x1b[15~n") == "dn"  # arrows and function keys are no letters
        assert termios.tcgetattr(slave)[3] & termios.ISIG  # Ctrl-C stays what it is
        os.set_blocking(master, False)
        with pytest.raises(BlockingIOError):
            os.read(master, 100)
        termios.tcsetattr(slave, termios.TCSANOW, before)  # as a shell does after Ctrl-Z
        keys()
        assert typed(keys, master, b"q") == "q"
    assert termios.tcgetattr(slave) == before


def test_a_sign_that_comes_in_two_parts_is_one(terminal):
    master, _ = terminal
    with Keyboard() as keys:
        assert typed(keys, master, b"a\xc3") == "a"
        assert typed(keys, master, b"\xa9") == "é"


def test_without_a_terminal_there_are_none(monkeypatch):
    read, write = os.pipe()
    os.write(write, b"pdn")
    with os.fdopen(read) as stdin, os.fdopen(write, "w"):
        monkeypatch.setattr(sys, "stdin", stdin)
        with Keyboard() as keys:
            assert not keys.there
            assert keys() == ""
    monkeypatch.setattr(sys, "stdin", None)
    with Keyboard() as keys:
        assert not keys.there


def test_letters_are_wishes_and_a_note_is_what_stands_before_enter():
    line = TypingLine()
    assert line.take("pDx\n") == [(OperatorCommand.PAUSE, ""), (OperatorCommand.DROP, ""), (OperatorCommand.HERE, "")]
    assert line.take("nthe  table pd") == []
    assert line.note == "the  table pd"
    assert line.words(closure=False).startswith("note: the  table pd_")
    assert line.take("\x7f\b\rp") == [(OperatorCommand.NOTE, "the table"), (OperatorCommand.PAUSE, "")]
    assert line.take("nno\x1bd") == [(OperatorCommand.DROP, "")]
    assert line.take("n  \n") == []
    line.take("n" + "x" * 500)
    assert len(line.note) == LONGEST_NOTE
    assert "drop" in TypingLine().words(closure=False)
    assert "mark" in TypingLine().words(closure=True)
