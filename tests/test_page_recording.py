"""``record --view`` end to end: who looks on, hangs, goes or asks costs no sample; the page behind the end, and its report."""

import contextlib
import http.client
import json
import signal
import socket
import threading
from urllib.parse import urlsplit

import pytest
from conftest import broad
from processes import CALIBRATE, PATIENCE_S, PIPE, heard, started, until
from recording_wires import virtual_boards

from session.bench.page import server as handler
from session.bench.page.server import PageServer
from tinygc.cli import recording as _page_end


def events(address: str) -> tuple[socket.socket, dict]:
    """A browser: its connection, and the newest of each event."""
    parts, newest = urlsplit(address), {}
    made = socket.create_connection((parts.hostname, parts.port), timeout=PATIENCE_S)
    made.sendall(f"GET {parts.path}events HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode())

    def read() -> None:
        name = ""
        with contextlib.suppress(OSError), made.makefile("rb") as lines:
            for line in lines:
                if line.startswith(b"event: "):
                    name = line[7:].strip().decode()
                elif line.startswith(b"data: ") and line.endswith(b"\n"):
                    newest[name] = json.loads(line[6:])

    threading.Thread(target=read, daemon=True).start()
    return made, newest


def leave(looking: socket.socket) -> None:
    looking.shutdown(socket.SHUT_RDWR)  # its reader comes to its end
    looking.close()


def wish(address: str, word: str) -> int:
    parts = urlsplit(address)
    with contextlib.closing(http.client.HTTPConnection(parts.hostname, parts.port, timeout=PATIENCE_S)) as connection:
        connection.request("POST", f"{parts.path}wish", word)
        return connection.getresponse().status


@pytest.mark.broad
def test_a_recording_with_a_page_loses_nothing_whoever_looks_on(tmp_path):
    """One that reads, one that hangs, one that goes; a pause from the page; and the page stays behind the end while it is looked at."""
    with virtual_boards(tmp_path) as board:
        port = board("--rate", 416, "--segments", 3, "--speed", 8, "--frames")
        words = ["--port", port, "--out", tmp_path / "s", "--like", tmp_path / "bench.toml", "--segments", 1, "--no-coach", "--view"]
        with started([*CALIBRATE, "record", *words, "--json", tmp_path / "told"], stdout=PIPE, stderr=PIPE, text=True) as recording:
            address = heard(recording.stderr, lambda line: line.startswith("look at"))[-1].split()[-1]
            threading.Thread(target=recording.stderr.read, daemon=True).start()
            looking, newest = events(address)
            hanging = socket.create_connection(looking.getpeername())
            hanging.sendall(b"GET /")
            leave(events(address)[0])
            until(lambda: "pose" in newest)
            assert wish(address, "pause") == 200
            until(lambda: newest["state"]["stage"] == "paused")
            assert wish(address, "pause") == 200
            until(lambda: newest["state"]["stage"] != "paused")
            until(lambda: newest.get("end"))
            told = json.loads((tmp_path / "told").read_text())
            assert newest["end"]["report"] == "offered"
            assert str(tmp_path / "s") in newest["end"]["command"]
            assert newest["state"]["stage"] == "done"
            assert recording.poll() is None
            recording.send_signal(signal.SIGINT)
            assert recording.wait(60) == 0  # what was recorded is complete
            leave(looking)
            hanging.close()
    assert told["done"]
    assert told["lost"] == told["crc_errors"] == told["garbage_bytes"] == 0
    assert newest["pose"]["full_scale_dps"] == 500


@pytest.mark.parametrize(
    ("script", "report", "words"),
    [
        ("open(sys.argv[2] + '/report.html', 'w').write('<p>it closes</p>')", "ready", "report.html"),
        broad("open(sys.argv[2] + '/report.html', 'w').write('<p>it fails</p>'); sys.exit(1)", "ready", "report.html"),
        ("print('calibrate: no segment', file=sys.stderr); sys.exit(2)", "failed", "calibrate: no segment"),
    ],
)
def test_the_report_is_made_when_it_is_asked_for_and_served(tmp_path, monkeypatch, script, report, words):
    made = tmp_path / "calibrate.py"
    made.write_text(f"import sys\nassert sys.argv[1] == 'report'\n{script}\n")
    monkeypatch.setattr(_page_end, "CALIBRATE", made)
    monkeypatch.setattr(_page_end, "LOOK_EVERY_S", 0.01)
    monkeypatch.setattr(_page_end, "GONE_S", 0.2)
    monkeypatch.setattr(handler, "ALIVE_S", 0.05)
    monkeypatch.setattr(PageServer, "look_every_s", 0.01)
    server = PageServer()
    server.start()
    looking, newest = events(server.address)
    until(lambda: server.clients)
    staying = threading.Thread(target=_page_end.stay, args=(server, tmp_path, lambda: False))
    staying.start()
    until(lambda: newest.get("end", {}).get("report") == "offered")
    assert wish(server.address, "report") == 200
    until(lambda: newest["end"]["report"] == report)
    assert words in newest["end"]["words"]
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=PATIENCE_S)) as connection:
        connection.request("GET", f"/{server.token}/report.html")
        assert connection.getresponse().status == (200 if report == "ready" else 404)
    leave(looking)
    staying.join(30)
    assert not staying.is_alive()
    server.close()
