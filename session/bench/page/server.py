"""The page's server: files, events and the report for browsers that know its address, and the commands that they may send.

It uses the standard library, and serves this computer alone unless another address is requested.  The recording never waits for it: a
browser has a thread of its own, and one that takes nothing is dropped.
"""

from __future__ import annotations

import contextlib
import hmac
import ipaddress
import json
import secrets
import socket
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any, cast

from session.base.errors import CalibrationError
from session.bench.operator import LONGEST_NOTE, BrowserCommands


class LatestEvents:
    """The events that one browser has yet to get: of each kind the newest alone, so that a slow browser costs nothing."""

    def __init__(self) -> None:
        self._there = threading.Condition()
        self._waiting: dict[str, bytes] = {}
        self._closed = False

    def put(self, event: str, data: bytes) -> None:
        """Replace an older event of the same kind."""
        with self._there:
            self._waiting[event] = data
            self._there.notify()

    def close(self) -> None:
        """No more events come; those that wait are still sent."""
        with self._there:
            self._closed = True
            self._there.notify()

    def take(self, timeout_s: float) -> dict[str, bytes] | None:
        """All waiting events; empty after so long without any; None at the end."""
        with self._there:
            if not self._waiting and not self._closed:
                self._there.wait(timeout_s)
            taken, self._waiting = self._waiting, {}
            return None if self._closed and not taken else taken


LONGEST = 4 * LONGEST_NOTE + 16  #: bytes of a request
SLOW_S = 3.0  #: a browser that takes nothing for so long, or requests nothing, is dropped
ALIVE_S = 2.0  #: the longest time between two events, so that a closed browser is noticed
SEND_BUFFER = 32768  #: bytes that the system holds for a browser: some ten states, so that a hanging one is noticed
ALIVE = b"event: alive\ndata: 0\n\n"
RETRY = b"retry: 1000\n\n"  #: ms after which a disconnected browser reconnects
HTML = "text/html; charset=utf-8"
TYPES = {
    "html": HTML,
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
PAGE, REPORT, EVENTS, WISH = "page.html", "report.html", "events", "wish"
NO_OTHER_SITE = "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; "
    + NO_OTHER_SITE,
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
#: the report contains its style and its pictures, and no script
REPORT_HEADERS = {
    **HEADERS,
    "Content-Security-Policy": f"sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; {NO_OTHER_SITE}",
}


class Handler(BaseHTTPRequestHandler):
    """One connection: a file of the page, the events, the report, or a command, for browsers with the token."""

    timeout = SLOW_S
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "tinygc", ""

    def do_GET(self) -> None:  # the name that http.server calls
        """Send a file of the page, the events, or the report."""
        server = cast(PageServer, self.server)
        name = self._requested(server)
        if name is None:
            return
        if name == EVENTS:
            self._events(server)
        elif (name or PAGE) in server.pages:
            name = name or PAGE
            self._answer(HTTPStatus.OK, TYPES[name.rpartition(".")[2]], server.pages[name])
        elif server.answer_of is not None and (found := server.answer_of(name)) is not None:
            self._answer(HTTPStatus.OK, "application/json", found)
        elif name == REPORT and server.report is not None and (report := server.report()) is not None:
            self._answer(HTTPStatus.OK, HTML, report, REPORT_HEADERS)
        else:
            self._refuse(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:  # the name that http.server calls
        """Take a command for the recording."""
        server = cast(PageServer, self.server)
        name = self._requested(server)
        if name is None:
            return
        length = self.headers.get("Content-Length", "")
        if name != WISH:
            self._refuse(HTTPStatus.NOT_FOUND)
        elif not (length.isascii() and length.isdecimal() and len(length) < 6 and int(length) <= LONGEST):
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        elif (status := server.heard(self.rfile.read(int(length)))) is HTTPStatus.OK:
            self._answer(status, "text/plain; charset=utf-8", b"")
        else:
            self._refuse(status)

    def _requested(self, server: PageServer) -> str | None:
        """The requested name; None: refused, since the host, the origin or the token is wrong."""
        if server.closing:  # a connection that was kept alive: the browser has to connect again
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

    def _events(self, server: PageServer) -> None:
        self.close_connection = True
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._head(HTTPStatus.OK, "text/event-stream; charset=utf-8", None)
        client = server.joined()
        try:
            with contextlib.suppress(OSError):  # the browser is gone, or takes nothing: a send waits SLOW_S at most
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
        """Log nothing: the terminal belongs to the screen."""


LOOPBACK = "127.0.0.1"
LAST_WORD_S = 0.5  #: for browsers to take the last event
MOST_CONNECTIONS = 24  #: a page opens six at first and keeps one


class PageServer(ThreadingHTTPServer):
    """Serves from ``start`` to ``close``.  CalibrationError where the address is not available."""

    daemon_threads = True
    look_every_s = 0.2  #: between two checks whether to end
    request_queue_size = 2 * MOST_CONNECTIONS  #: a browser requests all files of the page at once
    block_on_close = False

    def __init__(self, host: str = LOOPBACK, port: int = 0, folder: Traversable | None = None):
        """folder: of the page's files, if not those of a recording."""
        self.token = secrets.token_urlsafe(18)
        self.wishes, self.closing = BrowserCommands(), False
        self.heard = self.wishes.hear  #: takes a command
        self.answer_of: Callable[[str], bytes | None] | None = None  #: returns the JSON of a name, None of one that is not known
        self.report: Callable[[], bytes | None] | None = None  #: returns the session's report, None without one
        folder = folder or files("session.bench.page").joinpath("files")
        self.pages = {path.name: path.read_bytes() for path in folder.iterdir() if "." in path.name}
        self._clients: set[LatestEvents] = set()
        self.visited = False  #: whether any browser has ever connected
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
        """The address to open."""
        return f"http://{_own_address() if self._host.is_unspecified else self._host}:{self.server_port}/{self.token}/"

    @property
    def clients(self) -> int:
        """Number of connected browsers."""
        return len(self._clients)

    def start(self) -> None:
        """Serve in a thread of its own."""
        self._serving.start()

    def close(self) -> None:
        """Send waiting events for a moment, then stop."""
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
        """Send an event to all browsers, without waiting for any of them."""
        data = f"event: {event}\ndata: {json.dumps(content, allow_nan=False)}\n\n".encode()
        with self._changing:
            self._last[event] = data
            for client in self._clients:
                client.put(event, data)

    def joined(self) -> LatestEvents:
        """Add a browser; it gets the present state at once."""
        client = LatestEvents()
        with self._changing:
            for event, data in self._last.items():
                client.put(event, data)
            self._clients.add(client)
            self.visited = True
        return client

    def left(self, client: LatestEvents) -> None:
        """Remove a browser."""
        with self._changing:
            self._clients.discard(client)

    def is_own(self, host: str | None) -> bool:
        """Whether a Host header has this server's address: a name would allow requests from another site's page (DNS rebinding)."""
        name, _, port = (host or "").rpartition(":")
        if port != str(self.server_port):
            return False
        if name == "localhost":
            return self._host.is_loopback
        try:
            address = ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return False
        return self._host.is_unspecified or address == self._host

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve in a thread of its own, while there are not too many."""
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve, then free the place."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing: a browser that disconnects is no error, and the terminal belongs to the screen."""


def _own_address() -> str:
    """The computer's address in its network; no packet is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as never_sends:
        try:
            never_sends.connect(("192.0.2.1", 9))  # an address kept for documentation (RFC 5737)
        except OSError:
            return LOOPBACK
        return str(never_sends.getsockname()[0])
