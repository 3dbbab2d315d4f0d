"""One connection of a browser: a file of the page, the events, the report, or a wish; whoever has not the token gets none of them."""

from __future__ import annotations

import contextlib
import hmac
import socket
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from typing import Protocol, cast

from session.page.newest import Newest
from session.page.wishes import LONGEST, Wishes

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
    wishes: Wishes
    report: Callable[[], bytes | None]
    closing: bool

    def is_own(self, host: str | None) -> bool:
        """Whether a Host header names this server by its address."""

    def joined(self) -> Newest:
        """One more looks on."""

    def left(self, client: Newest) -> None:
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
