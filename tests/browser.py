"""A headless Chromium, spoken to over its own pipe (Chrome DevTools Protocol): no driver, no further package."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
PATIENCE_S = 30.0


def browser_path() -> str | None:
    """The first Chromium there is."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Browser:
    """One process; ``open`` shows a file in a window of a given size.  Use it as a context."""

    def __init__(self, path: str, profile: Path):
        command_end, self._write = os.pipe()
        self._read, answer_end = os.pipe()
        arguments = ["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", f"--user-data-dir={profile}"]

        def place():
            # The browser reads from 3 and writes to 4.  Copied out of the way first: either may be 3 or 4 already.
            taken, given = os.dup(command_end), os.dup(answer_end)
            taken, given = (os.dup2(fd, free) for fd, free in ((taken, 63), (given, 62)))
            os.dup2(taken, 3)
            os.dup2(given, 4)

        self._process = subprocess.Popen(
            [path, *arguments, "--remote-debugging-pipe", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            preexec_fn=place,
            close_fds=False,
        )
        os.close(command_end)
        os.close(answer_end)
        self._buffer, self._number, self.events = b"", 0, []
        target = self._ask("Target.createTarget", {"url": "about:blank"}, None)["targetId"]
        self._session = self._ask("Target.attachToTarget", {"targetId": target, "flatten": True}, None)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._write)
        os.close(self._read)

    def open(self, path: Path, width: int, height: int = 900, dark: bool = False) -> None:
        """Show a file; ``events`` then has all that happened since."""
        self.events = []
        self.ask("Emulation.setDeviceMetricsOverride", {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600})
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.ask("Emulation.setEmulatedMedia", {"features": [scheme]})
        self.ask("Page.navigate", {"url": path.resolve().as_uri()})
        stop = time.monotonic() + PATIENCE_S
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self._receive(stop)

    def evaluate(self, expression: str):
        """The value of a JavaScript expression in the page."""
        answer = self.ask("Runtime.evaluate", {"expression": expression, "returnByValue": True})
        if "exceptionDetails" in answer:
            raise AssertionError(answer["exceptionDetails"])
        return answer["result"].get("value")

    def complaints(self) -> list[str]:
        """Script errors, refused resources, failed requests, and anything that was fetched beside the file itself."""
        said = [json.dumps(e["params"]) for e in self.events if e["method"] == "Runtime.exceptionThrown"]
        said += [e["params"]["entry"]["text"] for e in self.events if e["method"] == "Log.entryAdded"]
        urls = [e["params"]["request"]["url"] for e in self.events if e["method"] == "Network.requestWillBeSent"]
        return said + [f"fetched {url}" for url in urls[1:] if not url.startswith("data:")]

    def ask(self, method: str, parameters: dict | None = None) -> dict:
        """One command to the page, and its answer."""
        return self._ask(method, parameters or {}, self._session)

    def _ask(self, method: str, parameters: dict, session: str | None) -> dict:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters} | ({"sessionId": session} if session else {})
        os.write(self._write, json.dumps(message).encode() + b"\0")
        stop = time.monotonic() + PATIENCE_S
        while True:
            answer = self._receive(stop)
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise AssertionError(f"{method}: {answer['error']}")
                return answer["result"]

    def _receive(self, stop: float) -> dict:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], max(0.0, stop - time.monotonic()))
            data = os.read(self._read, 1 << 20) if ready else b""
            if not data:
                raise TimeoutError("the browser does not answer")
            self._buffer += data
        line, self._buffer = self._buffer.split(b"\0", 1)
        message = json.loads(line)
        if "method" in message:
            self.events.append(message)
        return message
