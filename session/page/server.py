"""The page's server: standard library, this computer alone unless asked, and only for who knows the address with its token.

The recording never waits for it.  A browser has a thread of its own; one that takes nothing is dropped.
"""

from __future__ import annotations

import ipaddress
import json
import secrets
import socket
import threading
import time
from collections.abc import Callable
from http.server import ThreadingHTTPServer
from importlib.resources import files
from typing import Any

from session.common.errors import CalibrationError
from session.page.handler import Handler
from session.page.newest import Newest
from session.page.wishes import Wishes

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
        self.wishes, self.closing = Wishes(), False
        self.report: Callable[[], bytes | None] = lambda: None
        self.pages = {path.name: path.read_bytes() for path in files("session.page").joinpath("files").iterdir() if "." in path.name}
        self._clients: set[Newest] = set()
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

    def joined(self) -> Newest:
        """One more looks on; it gets the present state at once."""
        client = Newest()
        with self._changing:
            for event, data in self._last.items():
                client.put(event, data)
            self._clients.add(client)
            self.visited = True
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
