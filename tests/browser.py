"""A headless Chromium, spoken to over its own pipe (Chrome DevTools Protocol): no driver, no further package."""

import contextlib
import json
import os
import shutil

from processes import DEVNULL, PATIENCE_S, started

__all__ = ["Browser", "browser_path"]


def browser_path():
    """The first Chromium on the search path."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge", "microsoft-edge")
    return next(filter(None, map(shutil.which, names)), None)


class Browser:
    """One process; ``open`` shows a file in a window of a given size.  Use it as a context."""

    def __init__(self, path, profile):
        import fcntl  # which not every system has

        command_end, self._write = os.pipe()
        self._read, answer_end = os.pipe()
        # The browser reads from 3 and writes to 4.  Out of their way: any of these may be 3 or 4.
        high = [fcntl.fcntl(end, fcntl.F_DUPFD, 20) for end in (command_end, answer_end)]
        arguments = ["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", f"--user-data-dir={profile}"]
        self._running = contextlib.ExitStack()
        command = ["bash", "-c", f'exec "$@" 3<&{high[0]} 4>&{high[1]}', "bash", path, *arguments, "--remote-debugging-pipe", "about:blank"]
        self._running.enter_context(started(command, 4 * PATIENCE_S, stdout=DEVNULL, stderr=DEVNULL, pass_fds=high))
        for end in (command_end, answer_end, *high):
            os.close(end)
        self._buffer, self._number, self.events = b"", 0, []
        try:
            self._begin()
        except BaseException:
            self.__exit__()
            raise

    def _begin(self):
        target = self._ask("Target.createTarget", {"url": "about:blank"}, None)["targetId"]
        self._session = self._ask("Target.attachToTarget", {"targetId": target, "flatten": True}, None)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._running.close()
        os.close(self._write)
        os.close(self._read)

    def open(self, path, width, height=900, dark=False, still=False):
        """Show a file, or an address; ``events`` then has all that happened since.  still: as for a person who wants no motion."""
        self._load("about:blank")  # so that what the last page still asks for is none of this one's
        self.events = []
        self.ask("Emulation.setDeviceMetricsOverride", {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600})
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        motion = {"name": "prefers-reduced-motion", "value": "reduce" if still else "no-preference"}
        self.ask("Emulation.setEmulatedMedia", {"features": [scheme, motion]})
        self._load(path if isinstance(path, str) else path.resolve().as_uri())

    def _load(self, url):
        before = len(self.events)
        self.ask("Page.navigate", {"url": url})
        while not any(event["method"] == "Page.loadEventFired" for event in self.events[before:]):
            self._receive()

    def evaluate(self, expression):
        """The value of a JavaScript expression in the page."""
        answer = self.ask("Runtime.evaluate", {"expression": expression, "returnByValue": True})
        if "exceptionDetails" in answer:
            raise AssertionError(answer["exceptionDetails"])
        return answer["result"].get("value")

    def complaints(self):
        """Script errors, refused resources, failed requests, and anything that was fetched beside the file itself."""
        said = [json.dumps(e["params"]) for e in self.events if e["method"] == "Runtime.exceptionThrown"]
        said += [e["params"]["entry"]["text"] for e in self.events if e["method"] == "Log.entryAdded"]
        urls = [e["params"]["request"]["url"] for e in self.events if e["method"] == "Network.requestWillBeSent"]
        return said + [f"fetched {url}" for url in urls[1:] if not url.startswith("data:")]

    def ask(self, method, parameters=None):
        """One command to the page, and its answer."""
        return self._ask(method, parameters or {}, self._session)

    def _ask(self, method, parameters, session):
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters} | ({"sessionId": session} if session else {})
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise AssertionError(f"{method}: {answer['error']}")
                return answer["result"]

    def _receive(self):
        while b"\0" not in self._buffer:
            data = os.read(self._read, 1 << 20)
            if not data:
                raise EOFError("the browser has ended, or was killed since it did not answer")
            self._buffer += data
        line, self._buffer = self._buffer.split(b"\0", 1)
        message = json.loads(line)
        if "method" in message:
            self.events.append(message)
        return message
