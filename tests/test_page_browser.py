"""The page in a real browser, fed by a simulated session: no script errors, nothing from elsewhere, everything inside, wide and narrow."""

import os
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, browser_path
from conftest import Table
from guided_streams import guide_of

from session.guide.messages import Advice, Movement
from session.page.server import PageServer
from session.page.view import PageView
from tinygc.plan.coach import Coach

pytestmark = pytest.mark.skipif(browser_path() is None, reason="no Chromium here: the page is not looked at in a browser")
SPILLED = "[...document.querySelectorAll('main *')].filter(e => e.getBoundingClientRect().right > innerWidth + 1).map(e => e.id)"
DRAWN = """['board', 'sphere'].map(id => { const c = document.getElementById(id);
  return new Set(new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer)).size })"""
#: its address as the browser takes it: what ``open`` wants is a file
FIRST = Advice("turn 90° about the board's x axis (level) until y is up", "it helps", movements=(Movement((1.0, 0.0, 0.0), np.pi / 2),))


class Silent:
    """A screen that says nothing."""

    def change(self, change) -> None: ...

    def show(self, guide) -> None: ...


class Address:
    """Stands for a file where ``Browser.open`` is given one."""

    def __init__(self, text: str):
        self.text = text

    def resolve(self):
        return self

    def as_uri(self) -> str:
        return self.text


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(browser_path(), tmp_path_factory.mktemp("profile")) as running:
        yield running


def moment(server: PageServer, seconds: float):
    """A session, followed to a moment of it."""
    table = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).turn(90, (0, 1, 0), 3).rest(2.5).turn(240, (0, 0.6, 0.8), 3).rest(3)
    samples, guide, coach = table.samples(), guide_of(), Coach()
    page = PageView(Silent(), server)
    for first in range(0, int(seconds * 208), 8):
        part = samples.between(first, first + 8)
        for change in guide.feed(part):
            page.change(change)
            if change.accepted:
                guide.advise(coach(guide.taken.progress))
        page._sent_s = 0.0  # here nobody waits 40 ms between two portions
        page.watch(guide, part)
        page.show(guide)
    return guide


def shown(browser: Browser, true: str) -> None:
    for _ in range(400):
        if browser.evaluate(true):
            return
        browser.ask("Runtime.evaluate", {"expression": "new Promise(r => setTimeout(r, 25))", "awaitPromise": True})
    raise AssertionError(f"not so after 10 s: {true}; {browser.complaints()}")


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("seconds", [2.2, 14.0, 15.8])
def test_the_page_shows_the_session_without_an_error(browser, width, dark, seconds):
    server = PageServer()
    server.start()
    try:
        guide = moment(server, seconds)
        browser.open(Address(server.address), width, dark=dark)
        shown(browser, f"document.getElementById('count').textContent.startsWith('{guide.accepted} of')")
        assert browser.evaluate("document.getElementById('do').textContent") == guide.instruction.do
        shown(browser, f"{DRAWN}.every(colours => colours > 20)")
        fetched = [line for line in browser.complaints() if not line.startswith(f"fetched {server.address}")]
        assert fetched == []
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
        assert browser.evaluate(SPILLED) == []
        letters = browser.evaluate("parseFloat(getComputedStyle(document.getElementById('do')).fontSize)")
        assert letters >= (50 if width == 1280 else 28)  # CSS px; 50 are 13 mm, read from two metres
        background = browser.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (background == "rgb(255, 255, 255)") is not dark
        if folder := os.environ.get("TINYGC_SCREENSHOTS"):
            picture = browser.ask("Page.captureScreenshot", {"captureBeyondViewport": True})["data"]
            name = f"page-{seconds:g}-{width}-{'dark' if dark else 'light'}.png"
            Path(folder, name).write_bytes(__import__("base64").b64decode(picture))
    finally:
        browser.evaluate("events_closed = true")
        server.close()
