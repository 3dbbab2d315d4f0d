"""``view`` in a real browser: nothing spills; zoom by wheel, drag, button and key; a click leaves out and takes back, an edge is dragged;
a refit changes the closure."""

import pytest
from browser import Browser, browser_path
from processes import until

from session.bench.page.server import PageServer
from session.log.config import read_config
from tinygc import read_session, simulate
from tinygc.cli.commands.view import Viewer
from tinygc.reporting.view.content import Recording
from tinygc.reporting.view.page import FOLDER

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(browser_path() is None, reason="no Chromium here: the page is not looked at in a browser"),
]
WIDTHS = (390, 1280, 1920)
SPILLED = """[...document.querySelectorAll('main *')].filter(e => {
  const box = e.getBoundingClientRect();
  return box.width && (box.right > document.documentElement.clientWidth + 1 || box.left < -1);
}).map(e => `${e.tagName} ${e.id} ${e.textContent.slice(0, 40)}`)"""
COLOURS = """(() => { const c = document.getElementById('plot'), g = c.getContext('2d');
  return new Set(new Uint32Array(g.getImageData(0, 0, c.width, c.height).data.buffer)).size })()"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(browser_path(), tmp_path_factory.mktemp("profile")) as running:
        yield running


@pytest.fixture
def viewer(tmp_path):
    folder = simulate(segments=16, closure_s=0.0, odr_hz=62.5, seed=2).save(tmp_path / "s")
    server = PageServer(folder=FOLDER)
    server.start()
    running = Viewer(Recording(read_session(folder)), server)
    running.address = server.address
    running.start()
    yield running
    server.close()


def awaited(browser, expression):
    answer = browser.ask("Runtime.evaluate", {"expression": expression, "awaitPromise": True, "returnByValue": True})
    assert "exceptionDetails" not in answer, answer
    return answer["result"].get("value")


def shown(browser, true):
    until(lambda: browser.evaluate(true), lambda: awaited(browser, "new Promise(r => setTimeout(r, 20))"), true)


def opened(browser, viewer, width, dark=False):
    browser.open(viewer.address, width, 900, dark=dark)
    shown(browser, "content?.closure && !document.getElementById('doing').textContent")
    awaited(browser, "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")


def mouse(browser, kind, x, y, **more):
    browser.ask("Input.dispatchMouseEvent", {"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1, **more})


def point(browser, t, row):
    """Of a time of the session, s, in a row: ``strip``, or the number of a panel; in the window's pixels."""
    edges = "frame.strip" if row == "strip" else f"frame.panels[{row}]"
    place = (
        f"(() => {{ const b = plot.getBoundingClientRect(), e = {edges}; return [b.left + x_of({t}), b.top + (e.top + e.bottom) / 2] }})()"
    )
    return browser.evaluate(place)


def click(browser, t, row):
    x, y = point(browser, t, row)
    mouse(browser, "mousePressed", x, y)
    mouse(browser, "mouseReleased", x, y)


def dragged(browser, row, start, stop):
    (x, y), (to, _) = point(browser, start, row), point(browser, stop, row)
    mouse(browser, "mousePressed", x, y)
    for share in (0.3, 0.7, 1.0):
        mouse(browser, "mouseMoved", x + share * (to - x), y, buttons=1)
    mouse(browser, "mouseReleased", to, y)


def key(browser, name):
    browser.ask("Input.dispatchKeyEvent", {"type": "keyDown", "key": name, "text": name if len(name) == 1 else ""})
    browser.ask("Input.dispatchKeyEvent", {"type": "keyUp", "key": name})


def test_all_of_it_is_seen_and_zoom_works(browser, viewer):
    for width in WIDTHS:
        for dark in (True, False):
            opened(browser, viewer, width, dark)
            assert browser.evaluate(COLOURS) > 30
            assert browser.evaluate(SPILLED) == []
            assert browser.evaluate("document.documentElement.scrollWidth") <= width
            assert (browser.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)") is not dark
    length = browser.evaluate("content.length_s")
    x, y = point(browser, 40.0, 0)
    mouse(browser, "mouseWheel", x, y, deltaX=0, deltaY=-400)
    shown(browser, f"seen.to - seen.from < {length / 2}")
    assert browser.evaluate("t_of(x_of(40))") == pytest.approx(40)
    assert abs(browser.evaluate(f"x_of(40) + plot.getBoundingClientRect().left - {x}")) < 1  # what is under the pointer stays there
    key(browser, "0")
    shown(browser, f"seen.to - seen.from === {length}")
    dragged(browser, 1, 30.0, 70.0)
    shown(browser, "Math.abs(seen.from - 30) < 2 && Math.abs(seen.to - 70) < 2")
    shown(browser, "source.fine && source.fine.from < seen.from && seen.to < source.fine.to")  # detail was fetched
    browser.evaluate("document.querySelector('[data-key=\"+\"]').click()")
    shown(browser, "seen.to - seen.from < 22")
    browser.evaluate("plot.focus()")
    before = browser.evaluate("seen.from")
    key(browser, "ArrowRight")
    shown(browser, f"seen.from > {before}")
    for _ in range(8):
        key(browser, "+")
    shown(
        browser,
        "seen.to - seen.from < 0.2 && source.fine.pieces[0].high === undefined && curvesOf(seen.from, seen.to, 900)[0].high === null",
    )
    address = viewer.address
    assert [each for each in browser.complaints() if not each.startswith((f"fetched {address}", "Canvas2D: Multiple readback"))] == []


def test_a_segment_is_left_out_refitted_without_and_taken_back(browser, viewer):
    before = viewer.toml.read_bytes()
    opened(browser, viewer, WIDTHS[0])
    closure = browser.evaluate("content.closure.after_deg")
    at = browser.evaluate("(content.segments[7].from_s + content.segments[7].to_s) / 2")
    click(browser, at, "strip")
    shown(browser, "document.querySelector('#chosen h2').textContent === 'segment 7'")
    browser.evaluate("document.getElementById('toggle').click()")
    shown(
        browser,
        "content.segments[7].by_hand && content.stale && refit.classList.contains('wanted')".replace(
            "refit.", "document.getElementById('refit')."
        ),
    )
    assert len(read_config(viewer.toml).exclude) == 1
    assert browser.evaluate("document.getElementById('changed').textContent").startswith("changed by hand: 1segment 7 left out")
    browser.evaluate("document.getElementById('refit').click()")
    shown(browser, "!content.stale && content.before")
    assert browser.evaluate("content.closure.turns") == 15
    assert browser.evaluate("content.closure.after_deg") != closure
    assert browser.evaluate("content.before.after_deg") == closure
    assert " → " in browser.evaluate("document.getElementById('answer').textContent")
    assert browser.evaluate("content.segments[7].after_deg") is None
    assert browser.evaluate(SPILLED) == []
    browser.evaluate("document.querySelector('#changed li button:last-child').click()")
    shown(browser, "!content.segments[7].by_hand")
    assert viewer.toml.read_bytes() == before
    browser.evaluate("document.getElementById('refit').click()")
    shown(browser, "!content.stale && content.closure.turns === 16")
    assert browser.evaluate("content.closure.after_deg") == closure


def test_a_still_is_moved_by_its_edge_by_numbers_and_by_keys(browser, viewer):
    before = viewer.toml.read_bytes()
    opened(browser, viewer, 1280)
    still = browser.evaluate("content.stills[9]")
    browser.evaluate(f"look({still['from_s'] - 3}, {still['to_s'] + 3})")
    awaited(browser, "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")
    click(browser, (still["from_s"] + still["to_s"]) / 2, 0)
    shown(browser, "document.querySelector('#chosen h2').textContent === 'still 9'")
    dragged(browser, 0, still["from_s"], still["from_s"] + 0.5)
    shown(browser, "content.stills[9].by_hand === 'moved'")
    assert browser.evaluate("content.stills[9].from_s") == pytest.approx(still["from_s"] + 0.5, abs=0.03)
    assert browser.evaluate("content.stills[9].to_s") == pytest.approx(still["to_s"], abs=0.006)
    fields = "[...document.querySelectorAll('#chosen input')]"
    browser.evaluate(f"{fields}[0].value = {still['from_s'] + 0.25}; document.querySelector('#chosen form button').click()")
    shown(browser, f"Math.abs(content.stills[9].from_s - {still['from_s'] + 0.25}) < 0.006")
    browser.evaluate(f"{fields}[1].value = {still['to_s'] + 0.5}; document.querySelector('#chosen form button').click()")
    shown(browser, "document.getElementById('unused').textContent.includes('still 9: moves: its readings scatter ')")
    browser.evaluate(f"{fields}[1].value = {still['to_s']}; document.querySelector('#chosen form button').click()")
    shown(browser, "!content.stills[9].problem")
    browser.evaluate(f"{fields}[1].value = {still['to_s'] + 20}; document.querySelector('#chosen form button').click()")
    shown(browser, "document.getElementById('refused').textContent.includes('overlap')")
    browser.evaluate("plot.focus()")
    key(browser, "x")
    shown(browser, "content.stills[9].by_hand === 'left out'")
    assert browser.evaluate("document.getElementById('refused').textContent") == ""
    key(browser, "x")
    shown(browser, "!content.stills[9].by_hand")
    assert viewer.toml.read_bytes() == before


def test_the_written_file_shows_the_same_and_asks_nobody(browser, viewer, tmp_path):
    from tinygc.cli.commands.view import _write

    class Args:
        folder, quiet = viewer.recording.session.folder, True

    _write(Args, tmp_path / "view.html")
    for width in WIDTHS:
        browser.open(tmp_path / "view.html", width)
        shown(browser, "content?.closure")
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
        assert browser.evaluate("document.getElementById('refit').offsetWidth") == 0
        click(browser, browser.evaluate("content.segments[3].from_s + 1"), "strip")
        shown(browser, "document.querySelector('#chosen h2').textContent === 'segment 3'")
        assert browser.evaluate("document.getElementById('toggle')") is None
        assert browser.complaints() == []
