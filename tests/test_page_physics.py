"""What a person sees and asks for at the table: the page's picture and its server, the screen, the lines, the keys."""

from __future__ import annotations

import contextlib
import http.client
import io
import json
import os
import pty
import re
import socket
import sys
from email.message import Message
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from coached_hand import Kept, Silent, guide_of, play
from conftest import DEG, Table
from processes import PATIENCE_S, until
from rich.console import Console

from session.base.errors import CalibrationError
from session.base.rotation import conjugate, exp, multiply
from session.bench.messages import Advice, GuideMessage, Kind, RequestedTurn, Stage
from session.bench.operator import LONGEST_NOTE, Keyboard, TypingLine
from session.bench.page import server as page_server
from session.bench.page.server import PageServer
from session.bench.page.state import Attitude, PageView, rotated
from session.bench.screen import view
from session.log.samples import Samples

# The picture.


def watched(guide, samples, advice=None, portion=20):
    """A stream through the guide and the page, as the recording does it; all states."""
    server, states = Kept(), []
    page = PageView(Silent(), server)
    for first in range(0, len(samples), portion):
        part = samples.between(first, first + portion)
        for change in guide.feed(part):
            page.change(change)
            if change.accepted and advice:
                guide.advise(advice)
        page.watch(guide, part)
        page.show(guide)
        states.append(server.last["state"])
    return page, server, states


def angle_deg(a, b):
    a, b = np.array(a), np.array(b)
    return float(2 * min(np.linalg.norm(a - b), np.linalg.norm(a + b)) / DEG)


TURNED = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5)


def test_in_mid_turn_the_gyro_carries_it_at_any_portion():
    samples = Table().rest(3).turn(270, (0.6, 0.0, 0.8), 3).samples()
    found = []
    for portion in (3, 208):
        attitude = Attitude()
        for first in range(0, len(samples), portion):
            part = samples.between(first, first + portion)
            at_s = (part.t_ns[-1] - samples.t_ns[0]) * 1e-9
            if at_s > 1.5:
                attitude.zero_rps = samples.gyro[:400].mean(axis=0)
            attitude.feed(part, resting=at_s < 2.5)
        found.append(attitude.q)
    assert angle_deg(found[0], found[1]) < 0.05
    up = rotated(conjugate(found[0]), np.array([0.0, 0.0, 1.0]))
    last = samples.accel[-1] / np.linalg.norm(samples.accel[-1])
    assert np.arccos(min(1.0, up @ last)) < 0.6 * DEG  # no lever arm: at the turn's end it reads gravity again


def test_the_state_says_what_the_guide_says():
    guide = guide_of(3, 104.0)
    true = Table().tumble(3, 2.5, 2.0).samples(104.0)
    samples = Samples(true.t_ns, 1.01 * true.gyro, true.accel, true.temp_c)
    advice = Advice(
        "turn about x",
        "it helps",
        movements=(RequestedTurn((1.0, 0.0, 0.0), np.pi / 2),),
        sigmas=(("scale of x", 3.25), ("bias of x", 0.5)),
    )
    _, server, states = watched(guide, samples, advice)
    last = states[-1]
    assert last["stage"] == "done"
    assert last["accepted"] == last["wanted"] == 3
    assert last["do"] == guide.instruction.do
    assert last["sigmas"] == [{"name": "scale of x", "of_target": 3.25}, {"name": "bias of x", "of_target": 0.5}]
    assert len(last["up"]) == len(guide.taken.stills)
    np.testing.assert_allclose(np.linalg.norm(last["up"], axis=1), 1, atol=2e-3)
    assert {state["stage"] for state in states} >= {"check stream", "hold still", "turn", "done"}
    held = [state["part"] for state in states if state["stage"] == "hold still"]
    assert max(held) > 0.8
    assert [each["kind"] for each in last["messages"]].count("accepted") == 3
    assert server.last["pose"]["full_scale_dps"] == 500


def test_the_ghost_is_the_attitude_behind_the_coachs_turns():
    guide = guide_of()
    advice = Advice("do", "why", movements=(RequestedTurn((1.0, 0.0, 0.0), np.pi / 2), RequestedTurn((0.0, 0.0, 1.0), -np.pi)))
    page, _, states = watched(guide, TURNED.samples(), advice)
    target = states[-1]["target"]
    expected = multiply(multiply(page._still, exp(np.array([np.pi / 2, 0.0, 0.0]))), exp(np.array([0.0, 0.0, -np.pi])))
    assert angle_deg(target["q"], expected) < 0.05
    assert [turn["angle_deg"] for turn in target["turns"]] == [90.0, -180.0]
    assert all(state["target"] is None for state in states if state["stage"] != "turn")


def test_a_page_that_fails_ends_no_recording():
    """It is said once, and the screen goes on being told."""

    class Reporter(Silent):
        changes, shown = [], 0

        def change(self, change):
            self.changes.append(change.text)

        def show(self, guide):
            Reporter.shown += 1

    page = PageView(Reporter(), SimpleNamespace(publish=lambda *_: 1 / 0))
    for _ in range(3):
        page.show(guide_of())
    assert Reporter.shown == 3
    assert Reporter.changes == ["the page has failed (ZeroDivisionError: division by zero); the recording goes on without it"]


def test_the_screen_and_the_page_state_what_waiting_for_a_warm_board_would_gain():
    """Once among the messages, too; a session begins at once in any case."""
    samples = Table().rest(24).samples()
    for temp_c in (25 + 9 * (1 - np.exp(-samples.t_s / 150)), None):
        guide = guide_of()
        warming = Samples(samples.t_ns, samples.gyro, samples.accel, temp_c)
        _, server, _ = watched(guide, warming, portion=500)
        texts = [change.text for change in play(guide_of(), warming, 500) if "waiting" in change.text]
        assert [re.sub(r"\d[\d.]*", "N", text) for text in texts] == [
            "begun at once; temperature +N °C/min: waiting N min would lower the bias's drift from N to N mdps"
        ] * (temp_c is not None)
        text = " ".join(" ".join(drawn(guide)).split())
        assert (guide.wait.words if guide.wait else "temperature –") in text
        assert server.last["state"]["wait"] is None or server.last["state"]["wait"] in text
        assert (server.last["state"]["wait"] is None) == (temp_c is None)


# The server.


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr(PageServer, "look_every_s", 0.01)
    running = PageServer()
    running.start()
    yield running
    running.close()


class Answer(NamedTuple):
    """What came back."""

    status: int
    headers: Message
    text: str


def asked(server, path, method="GET", body=None, **headers):
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=PATIENCE_S)) as connection:
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return Answer(answer.status, answer.headers, answer.read().decode())


def following(server):
    """A browser that has asked for the events, and reads none of them yet."""
    made = socket.create_connection(("127.0.0.1", server.server_port), timeout=PATIENCE_S)
    made.sendall(f"GET /{server.token}/events HTTP/1.1\r\nHost: 127.0.0.1:{server.server_port}\r\n\r\n".encode())
    return made


def wished(server, body, token=None, **headers):
    return asked(server, f"/{token or server.token}/wish", "POST", body, **headers).status


def test_with_the_token_there_is_a_page_that_may_load_nothing_else(server):
    for name in ("", "page.js", "page.css"):
        answer = asked(server, f"/{server.token}/{name}")
        assert (answer.status, len(answer.text) > 500) == (200, True)
        policy = answer.headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'")
        assert "unsafe" not in policy
        assert "http" not in policy
        assert answer.headers["Referrer-Policy"] == "no-referrer"
    assert server.server_address[0] == "127.0.0.1"  # this computer alone
    assert len(server.token) >= 24


def test_nobody_else_sees_anything(server):
    port = server.server_port
    hosts = f"evil.example:{port}", "127.0.0.1", f"127.0.0.1.evil.example:{port}", f"[::1]:{port}"
    mine = f"/{server.token}/"
    for path, headers, method, status in (
        *((path, {}, "GET", 403) for path in ("/", "/page.html", "/events", "/x/", "/x/events", "//", "/%00/")),
        *((mine, {"Host": host}, "GET", 421) for host in hosts),
        *((mine + name, {}, "GET", 404) for name in ("../server.py", "..%2fserver.py", "/etc/passwd", "__init__.py")),
        (mine, {}, "PUT", 501),
    ):
        answer = asked(server, path, method, **headers)
        assert answer.status == status, (path, headers)
        assert server.token not in answer.text


def test_a_wish_is_a_key_of_the_terminal_while_a_recording_takes_it(server):
    assert wished(server, "pause") == 503
    server.wishes.begin()
    assert [wished(server, word) for word in ("pause", "note it  rained\r\nhard", "report")] == [200] * 3
    for body in ("", "PAUSE", "pause now", "note ", "rm -rf", b"\xff\xfe", "n" * 2000):
        assert wished(server, body) in (400, 413)
    assert wished(server, "pause", token="x" * 24) == 403
    assert wished(server, "pause", Origin="http://evil.example") == 421
    assert wished(server, "pause", Origin=f"http://127.0.0.1:{server.server_port}") == 200
    server.wishes.end()
    assert wished(server, "drop") == 503
    assert [text or command for command, text in server.wishes()] == ["pause", "it rained hard", "pause"]  # also behind the end
    assert server.wishes.report.is_set()
    server.wishes.begin()
    assert {server.wishes.hear(b"note %d" % number) for number in range(100)} == {200, 503}


def test_the_report_is_served_once_it_is_there_and_may_run_nothing(server):
    assert asked(server, f"/{server.token}/report.html").status == 404
    server.report = lambda: b"<!doctype html>the report"
    answer = asked(server, f"/{server.token}/report.html")
    assert (answer.status, answer.text) == (200, "<!doctype html>the report")
    assert "script" not in answer.headers["Content-Security-Policy"]
    assert answer.headers["Content-Security-Policy"].startswith("sandbox; default-src 'none'")


def test_who_comes_gets_the_present_state_at_once_and_then_what_follows(server):
    server.publish("state", {"stage": "turn", "number": 1})
    with following(server) as client, client.makefile("rb") as lines:
        while lines.readline() != b"\r\n":
            pass
        assert [lines.readline() for _ in range(2)] == [b"retry: 1000\n", b"\n"]
        assert lines.readline() == b"event: state\n"
        assert json.loads(lines.readline().removeprefix(b"data: "))["number"] == 1
        lines.readline()
        server.publish("pose", {"q": [1, 0, 0, 0]})
        assert lines.readline() == b"event: pose\n"


def test_a_browser_that_reads_nothing_holds_nobody_up(server, monkeypatch):
    """Nobody drops it here: whoever published to it by himself would wait for ever."""
    monkeypatch.setattr(page_server.Handler, "timeout", None)
    with following(server):
        until(lambda: server.clients == 1)
        for _ in range(500):
            server.publish("state", {"text": "x" * 20_000})
        assert asked(server, f"/{server.token}/").status == 200
        assert server.clients == 1


def test_a_port_that_is_taken_is_said_in_a_line(server):
    with pytest.raises(CalibrationError, match="leave the address out"):
        PageServer(port=server.server_port)


# The terminal.


LONG = Advice(
    "turn 180° about the board's y axis (level), -x up first, until -z is up, then at once 180° about its x axis (level), "
    "-y up first, until -z is up (4 s)",
    "it helps the misalignment of z towards y (12.3 times its target)",
)


def drawn(guide, changes=(), width=80):
    console = Console(file=io.StringIO(), width=width, force_terminal=True, color_system=None, highlight=False)
    console.print(view(guide, "data/session2 · /dev/ttyACM0", changes))
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("seconds", [0.0, 0.5, 1.3, 2.5, 4.5, 6.9, 8.4, 9.0])
def test_every_state_fits_80_by_24(seconds):
    """No port, the check of the stream, a hold, before a turn, in it, a hold, what is accepted, and the end."""
    guide = guide_of(1) if seconds > 8.5 else guide_of()
    if seconds:
        play(guide, TURNED.samples().between(0, int(seconds * 208)))
        guide.advise(LONG)
    else:
        guide.waits(Stage.FIND_PORT, "/dev/ttyACM0: No such file or directory; it is tried again and again, four times a second, for ever")
    says = "turn {0} rejected: the gyro clips at 573 dps on x, y: turn slower or choose a larger one"
    lines = drawn(guide, [GuideMessage(Kind.REJECTED, says.format(i), i) for i in range(4)])
    assert len(lines) <= 22
    assert max(map(len, lines)) <= 80
    text = " ".join(line.strip("│ ") for line in lines)
    assert guide.instruction.do[:40] in text
    assert guide.instruction.why[:40] in text
    assert ("s left" in text) or seconds not in (1.3, 6.9)
    assert f"{guide.accepted} of {guide.segments} accepted" in text


@pytest.fixture
def terminal(monkeypatch):
    """The master of a pseudo-terminal that is standard input."""
    master, slave = pty.openpty()
    with os.fdopen(slave, "r", encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield master, slave
    os.close(master)


def typed(keys, master, data):
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


def test_letters_are_wishes_and_a_note_is_what_stands_before_enter():
    line = TypingLine()
    assert line.take("pDx\n") == [("pause", ""), ("drop", ""), ("here", "")]
    assert line.take("nthe  table pd") == []
    assert line.note == "the  table pd"
    assert line.words(guide_of()).startswith("note: the  table pd_")
    assert line.take("\x7f\b\rp") == [("note", "the table"), ("pause", "")]
    assert line.take("nno\x1bd") == [("drop", "")]
    assert line.take("n  \n") == []
    line.take("n" + "x" * 500)
    assert len(line.note) == LONGEST_NOTE
    guide = guide_of()
    assert "drop" in TypingLine().words(guide)
    guide.closure = SimpleNamespace()
    assert "mark" in TypingLine().words(guide)


termios = pytest.importorskip("termios", reason="a pseudo-terminal is needed, which only POSIX has")
