"""The page's server: only who knows the address sees anything, and no browser, however it behaves, holds the recording up."""

import contextlib
import http.client
import json
import socket
import tomllib
from email.message import Message
from typing import NamedTuple

import pytest
from processes import PATIENCE_S, ROOT, until

from session.bench.operator import MOST, OperatorCommand
from session.bench.page import server as page_server
from session.bench.page.server import MOST_CONNECTIONS, LatestEvents, PageServer
from session.io.errors import CalibrationError


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


def asked(server, path, host=None, method="GET") -> Answer:
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=PATIENCE_S)) as connection:
        connection.request(method, path, headers={"Host": host} if host else {})
        answer = connection.getresponse()
        return Answer(answer.status, answer.headers, answer.read().decode())


def following(server) -> socket.socket:
    """A browser that has asked for the events, and reads none of them yet."""
    made = socket.create_connection(("127.0.0.1", server.server_port), timeout=PATIENCE_S)
    made.sendall(f"GET /{server.token}/events HTTP/1.1\r\nHost: 127.0.0.1:{server.server_port}\r\n\r\n".encode())
    return made


@pytest.mark.parametrize("name", ["", "page.js", "board.js", "page.css"])
def test_with_the_token_there_is_a_page_that_may_load_nothing_else(server, name):
    answer = asked(server, f"/{server.token}/{name}")
    assert answer.status == 200
    assert len(answer.text) > 500
    policy = answer.headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert "http" not in policy
    assert answer.headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize("path", ["/", "/page.html", "/events", "/x/", "/x/events", "//", "/%00/", "/events/x"])
def test_without_the_token_there_is_nothing(server, path):
    answer = asked(server, path)
    assert answer.status == 403
    assert server.token not in answer.text


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "127.0.0.1.evil.example:{port}", "[::1]:{port}"]
)
def test_another_hosts_name_is_refused_even_with_the_token(server, host):
    assert asked(server, f"/{server.token}/", host.format(port=server.server_port)).status == 421


@pytest.mark.parametrize("name", ["../server.py", "..%2fserver.py", "/etc/passwd", "server.py", "page.html/", "__init__.py"])
def test_nothing_but_the_pages_files_is_served(server, name):
    assert asked(server, f"/{server.token}/{name}").status == 404


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS"])
def test_nothing_can_be_written(server, method):
    assert asked(server, f"/{server.token}/", method=method).status == 501


def wished(server, body, path="wish", token=None, **headers) -> int:
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=PATIENCE_S)) as connection:
        connection.request("POST", f"/{token or server.token}/{path}", body, headers)
        return connection.getresponse().status


@pytest.mark.parametrize("body", ["pause", "note it rained"])
def test_a_wish_that_nobody_takes_is_refused(server, body):
    assert wished(server, body) == 503  # no recording has begun
    server.wishes.begin()
    assert wished(server, body) == 200
    server.wishes.end()
    assert wished(server, body) == 503
    assert len(server.wishes()) == 1  # what was answered with 200 is given, behind the end, too


def test_a_wish_is_a_key_of_the_terminal(server):
    server.wishes.begin()
    assert [wished(server, word) for word in ("pause", "drop", "here", "note it  rained\r\nhard", "report")] == [200] * 5
    assert server.wishes() == [
        (OperatorCommand.PAUSE, ""),
        (OperatorCommand.DROP, ""),
        (OperatorCommand.HERE, ""),
        (OperatorCommand.NOTE, "it rained hard"),
    ]
    assert server.wishes.report.is_set()
    assert server.wishes() == []


@pytest.mark.parametrize("body", ["", "p", "PAUSE", "pause now", "note ", "note \x00\n", "rm -rf", b"\xff\xfe", "n" * 2000])
def test_any_other_wish_is_none(server, body):
    server.wishes.begin()
    assert wished(server, body) in (400, 413)
    assert server.wishes() == []


def test_a_wish_needs_the_token_and_this_page(server):
    server.wishes.begin()
    assert wished(server, "pause", token="x" * 24) == 403
    assert wished(server, "pause", Origin="http://evil.example") == 421
    assert wished(server, "pause", Origin="null") == 421
    assert wished(server, "pause", Host="evil.example") == 421
    assert wished(server, "pause", path="") == 404
    assert server.wishes() == []
    assert wished(server, "pause", Origin=f"http://127.0.0.1:{server.server_port}") == 200


def test_of_many_wishes_a_few_are_kept_and_the_others_refused(server):
    server.wishes.begin()
    assert [server.wishes.hear(b"note %d" % number) for number in range(100)] == [200] * MOST + [503] * (100 - MOST)
    assert [text for _, text in server.wishes()] == [str(number) for number in range(MOST)]


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


def test_a_browser_that_goes_is_forgotten(server):
    following(server).close()

    def gone():
        server.publish("pose", {"q": [1, 0, 0, 0]})
        return server.clients == 0

    until(gone)


def test_half_a_request_is_not_waited_for_for_ever_and_too_many_are_turned_away(server, monkeypatch):
    monkeypatch.setattr(page_server.Handler, "timeout", 0.3)
    hanging = [socket.create_connection(("127.0.0.1", server.server_port), timeout=PATIENCE_S) for _ in range(MOST_CONNECTIONS + 6)]
    for each in hanging:
        each.sendall(b"GET /")
    assert sum(each.recv(1) == b"" for each in hanging) == len(hanging)
    until(lambda: asked_quietly(server) == 200)
    for each in hanging:
        each.close()


def asked_quietly(server):
    try:
        return asked(server, f"/{server.token}/").status
    except (OSError, http.client.HTTPException):
        return None


def test_of_each_kind_only_the_newest_waits():
    waiting = LatestEvents()
    for number in range(1000):
        waiting.put("state", b"%d" % number)
        waiting.put("pose", b"p%d" % number)
    assert waiting.take(0.0) == {"state": b"999", "pose": b"p999"}
    assert waiting.take(0.0) == {}
    waiting.put("state", b"last")
    waiting.close()
    assert waiting.take(0.0) == {"state": b"last"}
    assert waiting.take(0.0) is None


def test_a_port_that_is_taken_is_said_in_a_line(server):
    with pytest.raises(CalibrationError, match="leave the address out"):
        PageServer(port=server.server_port)


def test_it_listens_on_this_computer_alone(server):
    assert server.server_address[0] == "127.0.0.1"
    assert server.address.startswith("http://127.0.0.1:")


def test_an_installed_package_has_the_page():
    """setuptools takes what pyproject.toml names; every file of the page is asked for by another one, or is the page."""
    patterns = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["session"]
    packed = {path for pattern in patterns for path in (ROOT / "session").glob(pattern)}
    there = set((ROOT / "session/bench/page/files").iterdir())
    assert there <= packed
    texts = "".join(path.read_text() for path in there)
    assert {path.name for path in there if path.name not in texts} == {"page.html"}
