"""The page's server: standard library, this computer alone unless asked, and only for who knows the address with its token.

It reads nothing from the recording and sends nothing to it.  A browser has a thread of its own; one that takes nothing is dropped.
"""

from __future__ import annotations

import contextlib
import hmac
import ipaddress
import json
import secrets
import socket
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, cast

from session.common.errors import CalibrationError
from session.page.newest import Newest

LOOPBACK = "127.0.0.1"
SLOW_S = 3.0  #: a browser that takes nothing for so long, or asks nothing, is dropped
ALIVE_S = 2.0  #: between two events there is never more: a browser that has gone is noticed
MOST_CONNECTIONS = 24  #: a page takes six at first and one later
SEND_BUFFER = 32768  #: bytes that the system holds for a browser: some ten states, so that one that hangs is noticed
TYPES = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
PAGE = "page.html"
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class PageServer(ThreadingHTTPServer):
    """Serves from ``start`` to ``close``.  Raises CalibrationError where the address cannot be had."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, host: str = LOOPBACK, port: int = 0):
        self.token = secrets.token_urlsafe(18)
        self.pages = {path.name: path.read_bytes() for path in files("session.page").joinpath("files").iterdir() if "." in path.name}
        self._clients: set[Newest] = set()
        self._last: dict[str, bytes] = {}
        self._changing = threading.Lock()
        self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
        self._serving = threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.2}, name="page", daemon=True)
        try:
            super().__init__((host, port), Handler)
        except (OSError, OverflowError) as error:
            raise CalibrationError(
                f"--view {host}:{port}: cannot be listened on ({error}); leave the address out for a free port"
            ) from None

    @property
    def address(self) -> str:
        """What to open."""
        return f"http://{self.server_address[0]}:{self.server_port}/{self.token}/"

    @property
    def clients(self) -> int:
        """How many look on now."""
        return len(self._clients)

    def start(self) -> None:
        """In a thread of its own."""
        self._serving.start()

    def close(self) -> None:
        """Send what waits, then listen no more."""
        with self._changing:
            for client in self._clients:
                client.close()
        self.shutdown()
        self.server_close()

    def publish(self, event: str, content: dict[str, Any]) -> None:
        """To all who look on.  Never waits for any of them."""
        data = f"event: {event}\ndata: {json.dumps(content, allow_nan=False)}\n\n".encode()
        with self._changing:
            self._last[event] = data
            for client in self._clients:
                client.put(event, data)

    def joined(self) -> Newest:
        """One more looks on; it gets the present state at once."""
        client = Newest()
        with self._changing:
            for event, data in self._last.items():
                client.put(event, data)
            self._clients.add(client)
        return client

    def left(self, client: Newest) -> None:
        """It has gone, or was dropped."""
        with self._changing:
            self._clients.discard(client)

    def is_own(self, host: str | None) -> bool:
        """Whether a Host header names this server by its address: a name would let another site's page ask in its own name."""
        name, _, port = (host or "").rpartition(":")
        if port != str(self.server_port):
            return False
        if name == "localhost":
            return ipaddress.ip_address(self.server_address[0]).is_loopback
        try:
            asked, own = ipaddress.ip_address(name.strip("[]")), ipaddress.ip_address(self.server_address[0])
        except ValueError:
            return False
        return own.is_unspecified or asked == own

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


class Handler(BaseHTTPRequestHandler):
    """One connection."""

    timeout = SLOW_S
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "tinygc", ""

    def do_GET(self) -> None:  # the name that http.server calls
        """A file of the page, or the events."""
        server = cast(PageServer, self.server)
        if not server.is_own(self.headers.get("Host")):
            self._refuse(HTTPStatus.MISDIRECTED_REQUEST)
            return
        _, _, path = self.path.partition("/")
        token, _, name = path.partition("/")
        if not hmac.compare_digest(token.encode("utf-8", "replace"), server.token.encode()):
            self._refuse(HTTPStatus.FORBIDDEN)
        elif name == "events":
            self._events(server)
        elif (name or PAGE) in server.pages:
            name = name or PAGE
            self._answer(HTTPStatus.OK, TYPES[name.rpartition(".")[2]], server.pages[name])
        else:
            self._refuse(HTTPStatus.NOT_FOUND)

    def _events(self, server: PageServer) -> None:
        self.close_connection = True
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        self._head(HTTPStatus.OK, "text/event-stream; charset=utf-8", None)
        client = server.joined()
        try:
            with contextlib.suppress(OSError):  # it has gone, or takes nothing: a send waits SLOW_S at most
                while (waiting := client.take(ALIVE_S)) is not None:
                    self.wfile.write(b"".join(waiting.values()) or b": alive\n\n")
        finally:
            server.left(client)

    def _refuse(self, status: HTTPStatus) -> None:
        self.close_connection = True
        self._answer(status, "text/plain; charset=utf-8", f"{status.value} {status.phrase}\n".encode())

    def _answer(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self._head(status, kind, len(body))
        self.wfile.write(body)

    def _head(self, status: HTTPStatus, kind: str, length: int | None) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, "Content-Type": kind}.items():
            self.send_header(name, value)
        if length is not None:
            self.send_header("Content-Length", str(length))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the terminal is the screen's."""
