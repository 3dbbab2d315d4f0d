"""The page's server: one connection per browser, only for who knows its address, and the commands that a browser may send."""

from __future__ import annotations

import contextlib
import hmac
import ipaddress
import json
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, Protocol, cast

from session.bench.operator import LONGEST_NOTE, OperatorCommand
from session.io.errors import CalibrationError

# What one browser has yet to be sent: of each kind of event the newest alone, so that a slow one costs nothing.


class LatestEvents:
    """Filled by the recording, which never waits for it; emptied by the thread of one browser."""

    def __init__(self) -> None:
        self._there = threading.Condition()
        self._waiting: dict[str, bytes] = {}
        self._closed = False

    def put(self, event: str, data: bytes) -> None:
        """What is older of the same kind is not sent any more."""
        with self._there:
            self._waiting[event] = data
            self._there.notify()

    def close(self) -> None:
        """Nothing comes any more; what waits is still sent."""
        with self._there:
            self._closed = True
            self._there.notify()

    def take(self, timeout_s: float) -> dict[str, bytes] | None:
        """All that waits; empty after so long without any; None at the end."""
        with self._there:
            if not self._waiting and not self._closed:
                self._there.wait(timeout_s)
            taken, self._waiting = self._waiting, {}
            return None if self._closed and not taken else taken


# What a person may ask for from the page: the keys of the terminal, and the report at the end.  Nothing else is understood.

LONGEST = 4 * LONGEST_NOTE + 16  #: bytes of a request
MOST = 8  #: that wait; a recording takes them ten times a second, and refuses more than it can keep
WORDS = {"pause": OperatorCommand.PAUSE, "drop": OperatorCommand.DROP, "here": OperatorCommand.HERE}
REPORT_WISH = "report"


class BrowserCommands:
    """Filled by the threads of browsers; call it, as the recording does, for what was asked since.  Whatever was answered with OK is
    given.  report: whether that was asked for."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[OperatorCommand, str]] = deque()
        self._changing, self._taken = threading.Lock(), False
        self.report = threading.Event()

    def begin(self) -> None:
        """A recording takes them from here on."""
        with self._changing:
            self._taken = True

    def end(self) -> None:
        """It takes none that come later."""
        with self._changing:
            self._taken = False

    def __call__(self) -> list[tuple[OperatorCommand, str]]:
        """In order, each once."""
        taken = []
        while self._waiting:
            taken.append(self._waiting.popleft())
        return taken

    def hear(self, body: bytes) -> HTTPStatus:
        """``pause``, ``drop``, ``here``, ``note TEXT`` or ``report``: BAD_REQUEST where it is none of them, SERVICE_UNAVAILABLE where
        nobody takes it."""
        try:
            word, _, text = body.decode().partition(" ")
        except UnicodeDecodeError:
            return HTTPStatus.BAD_REQUEST
        if word == "note":
            note = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())[:LONGEST_NOTE]
            return self._keep(OperatorCommand.NOTE, note) if note else HTTPStatus.BAD_REQUEST
        if text or (word not in WORDS and word != REPORT_WISH):
            return HTTPStatus.BAD_REQUEST
        if word in WORDS:
            return self._keep(WORDS[word], "")
        self.report.set()
        return HTTPStatus.OK

    def _keep(self, wish: OperatorCommand, text: str) -> HTTPStatus:
        with self._changing:
            if not self._taken or len(self._waiting) >= MOST:
                return HTTPStatus.SERVICE_UNAVAILABLE
            self._waiting.append((wish, text))
        return HTTPStatus.OK


# One connection of a browser: a file of the page, the events, the report, or a wish; whoever has not the token gets none of them.

SLOW_S = 3.0  #: a browser that takes nothing for so long, or asks nothing, is dropped
ALIVE_S = 2.0  #: between two events there is never more: a browser that has gone is noticed
SEND_BUFFER = 32768  #: bytes that the system holds for a browser: some ten states, so that one that hangs is noticed
ALIVE = b"event: alive\ndata: 0\n\n"
RETRY = b"retry: 1000\n\n"  #: ms after which a browser that was cut off asks again
HTML = "text/html; charset=utf-8"
TYPES = {
    "html": HTML,
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
PAGE, REPORT, EVENTS, WISH = "page.html", "report.html", "events", "wish"
NOBODY_ELSE = "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; "
    + NOBODY_ELSE,
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
#: the report holds its style and its pictures itself, and no script
REPORT_HEADERS = {
    **HEADERS,
    "Content-Security-Policy": f"sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; {NOBODY_ELSE}",
}


class Site(Protocol):
    """What a connection needs of its server."""

    token: str
    pages: dict[str, bytes]
    wishes: BrowserCommands
    report: Callable[[], bytes | None]
    closing: bool

    def is_own(self, host: str | None) -> bool:
        """Whether a Host header names this server by its address."""

    def joined(self) -> LatestEvents:
        """One more looks on."""

    def left(self, client: LatestEvents) -> None:
        """It has gone."""


class Handler(BaseHTTPRequestHandler):
    """One connection."""

    timeout = SLOW_S
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "tinygc", ""

    def do_GET(self) -> None:  # the name that http.server calls
        """A file of the page, the events, or the report."""
        server = cast(Site, self.server)
        name = self._asked(server)
        if name is None:
            return
        if name == EVENTS:
            self._events(server)
        elif (name or PAGE) in server.pages:
            name = name or PAGE
            self._answer(HTTPStatus.OK, TYPES[name.rpartition(".")[2]], server.pages[name])
        elif name == REPORT and (report := server.report()) is not None:
            self._answer(HTTPStatus.OK, HTML, report, REPORT_HEADERS)
        else:
            self._refuse(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:  # the name that http.server calls
        """A wish; the recording takes it when it has time."""
        server = cast(Site, self.server)
        name = self._asked(server)
        if name is None:
            return
        length = self.headers.get("Content-Length", "")
        if name != WISH:
            self._refuse(HTTPStatus.NOT_FOUND)
        elif not (length.isascii() and length.isdecimal() and len(length) < 6 and int(length) <= LONGEST):
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        elif (status := server.wishes.hear(self.rfile.read(int(length)))) is HTTPStatus.OK:
            self._answer(status, "text/plain; charset=utf-8", b"")
        else:
            self._refuse(status)

    def _asked(self, server: Site) -> str | None:
        """What is asked for of this server; None: refused, since it is asked for by another name, from another page, or without the
        token."""
        if server.closing:  # a connection that was kept alive: the browser shall look whether somebody else listens there now
            self.close_connection = True
            return None
        origin = self.headers.get("Origin")
        if not server.is_own(self.headers.get("Host")) or (origin is not None and not server.is_own(origin.removeprefix("http://"))):
            self._refuse(HTTPStatus.MISDIRECTED_REQUEST)
            return None
        _, _, path = self.path.partition("/")
        token, _, name = path.partition("/")
        if not hmac.compare_digest(token.encode("utf-8", "replace"), server.token.encode()):
            self._refuse(HTTPStatus.FORBIDDEN)
            return None
        return name

    def _events(self, server: Site) -> None:
        self.close_connection = True
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._head(HTTPStatus.OK, "text/event-stream; charset=utf-8", None)
        client = server.joined()
        try:
            with contextlib.suppress(OSError):  # it has gone, or takes nothing: a send waits SLOW_S at most
                self.wfile.write(RETRY)
                while (waiting := client.take(ALIVE_S)) is not None:
                    self.wfile.write(b"".join(waiting.values()) or ALIVE)
        finally:
            server.left(client)

    def _refuse(self, status: HTTPStatus) -> None:
        self.close_connection = True
        self._answer(status, "text/plain; charset=utf-8", f"{status.value} {status.phrase}\n".encode())

    def _answer(self, status: HTTPStatus, kind: str, body: bytes, headers: dict[str, str] = HEADERS) -> None:
        self._head(status, kind, len(body), headers)
        self.wfile.write(body)

    def _head(self, status: HTTPStatus, kind: str, length: int | None, headers: dict[str, str] = HEADERS) -> None:
        self.send_response(status)
        for name, value in {**headers, "Content-Type": kind}.items():
            self.send_header(name, value)
        if length is not None:
            self.send_header("Content-Length", str(length))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: the terminal is the screen's."""


# The page's server: standard library, this computer alone unless asked, and only for who knows the address with its token.
#
# The recording never waits for it.  A browser has a thread of its own; one that takes nothing is dropped.

LOOPBACK = "127.0.0.1"
LAST_WORD_S = 0.5  #: that browsers may take for what was said last
MOST_CONNECTIONS = 24  #: a page takes six at first and one later


class PageServer(ThreadingHTTPServer):
    """Serves from ``start`` to ``close``.  wishes: what was asked for on the page; report: gives the session's report, None without one.

    Raises CalibrationError where the address cannot be had.
    """

    daemon_threads = True
    look_every_s = 0.2  #: whether to end
    request_queue_size = 2 * MOST_CONNECTIONS  #: a browser asks for all files of the page at once
    block_on_close = False

    def __init__(self, host: str = LOOPBACK, port: int = 0):
        self.token = secrets.token_urlsafe(18)
        self.wishes, self.closing = BrowserCommands(), False
        self.report: Callable[[], bytes | None] = lambda: None
        self.pages = {path.name: path.read_bytes() for path in files("session.bench.page").joinpath("files").iterdir() if "." in path.name}
        self._clients: set[LatestEvents] = set()
        self.visited = False  #: whether anybody has ever looked on
        self._last: dict[str, bytes] = {}
        self._changing = threading.Lock()
        self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
        self._serving = threading.Thread(target=self.serve_forever, kwargs={"poll_interval": self.look_every_s}, name="page", daemon=True)
        try:
            super().__init__((host, port), Handler)
        except (OSError, OverflowError) as error:
            raise CalibrationError(
                f"--view {host}:{port}: cannot be listened on ({error}); leave the address out for a free port"
            ) from None
        self._host = ipaddress.ip_address(str(self.server_address[0]))

    @property
    def address(self) -> str:
        """What to open."""
        return f"http://{_own_address() if self._host.is_unspecified else self._host}:{self.server_port}/{self.token}/"

    @property
    def clients(self) -> int:
        """How many look on now."""
        return len(self._clients)

    def start(self) -> None:
        """In a thread of its own."""
        self._serving.start()

    def close(self) -> None:
        """Send what waits, for a moment, then listen no more."""
        self.closing = True
        with self._changing:
            for client in self._clients:
                client.close()
        until_s = time.monotonic() + LAST_WORD_S
        while self._clients and time.monotonic() < until_s:
            time.sleep(0.01)
        self.shutdown()
        self.server_close()

    def publish(self, event: str, content: dict[str, Any]) -> None:
        """To all who look on.  Never waits for any of them."""
        data = f"event: {event}\ndata: {json.dumps(content, allow_nan=False)}\n\n".encode()
        with self._changing:
            self._last[event] = data
            for client in self._clients:
                client.put(event, data)

    def joined(self) -> LatestEvents:
        """One more looks on; it gets the present state at once."""
        client = LatestEvents()
        with self._changing:
            for event, data in self._last.items():
                client.put(event, data)
            self._clients.add(client)
            self.visited = True
        return client

    def left(self, client: LatestEvents) -> None:
        """It has gone, or was dropped."""
        with self._changing:
            self._clients.discard(client)

    def is_own(self, host: str | None) -> bool:
        """Whether a Host header names this server by its address: a name would let another site's page ask in its own name."""
        name, _, port = (host or "").rpartition(":")
        if port != str(self.server_port):
            return False
        if name == "localhost":
            return self._host.is_loopback
        try:
            asked = ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return False
        return self._host.is_unspecified or asked == self._host

    def process_request(self, request: Any, client_address: Any) -> None:
        """In a thread of its own, while there are not too many."""
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """And give the place back."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that goes is no error, and nothing may be written into the screen of the recording."""


def _own_address() -> str:
    """The computer's, as its network knows it; no packet is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as never_sends:
        try:
            never_sends.connect(("192.0.2.1", 9))  # an address kept for documentation (RFC 5737)
        except OSError:
            return LOOPBACK
        return str(never_sends.getsockname()[0])
