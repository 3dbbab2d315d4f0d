"""The page in a real browser, fed by a hand that does what the coach says: no script errors, nothing from elsewhere, everything inside,
wide and narrow, light and dark; the arrow goes as the hand does; keys and pedals; and a connection that was cut off."""

import json

import numpy as np
import pytest
from browser import Browser, browser_path
from coached_hand import CoachedHand
from processes import until

from session.bench.messages import Stage
from session.bench.page.server import PageServer

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(browser_path() is None, reason="no Chromium here: the page is not looked at in a browser"),
]
SPILLED = """[...document.querySelectorAll('main *')].filter(e => {
  const box = e.getBoundingClientRect(), own = getComputedStyle(e);
  return box.width && (box.right > innerWidth + 1 || box.left < -1 || (own.display !== 'inline' && e.scrollWidth > e.clientWidth + 2));
}).map(e => `${e.tagName} ${e.id} ${e.className} ${e.textContent.slice(0, 40)}`)"""
COLOURS = """['board', 'sphere', 'rates'].filter(id => document.getElementById(id).clientWidth).map(id => {
  const c = document.getElementById(id);
  return new Set(new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer)).size })"""
#: whether anything is drawn in the outermost pixels of a picture: it would be cut
CUT = """['board', 'sphere', 'rates'].filter(id => document.getElementById(id).clientWidth).filter(id => {
  const c = document.getElementById(id), g = c.getContext('2d'), w = c.width, h = c.height;
  return [[0, 0, w, 1], [0, h - 1, w, 1], [0, 0, 1, h], [w - 1, 0, 1, h]].some(box => g.getImageData(...box).data.some(part => part)) })"""
#: what is read from two metres
FAR = ("do", "why", "left", "count", "stage")
#: a laptop, a telephone upright and on its side, a screen on the wall, a tablet
SIZES = [(1280, 900), (390, 844), (844, 390), (1920, 1080), (768, 1024)]
MOMENTS = [
    lambda guide: guide.stage is Stage.HOLD_STILL and (guide.instruction.part or 0) > 0.6,
    lambda guide: guide.accepted == 2 and guide.stage is Stage.TURN and not guide.turn.moving,
    lambda guide: guide.accepted == 2 and guide.turning and guide.turn.path_rad > 0.7,
    lambda guide: guide.accepted == 3 and guide.stage is Stage.HOLD_STILL and guide.instruction.part > 0.3,
    lambda guide: guide.stage is Stage.DONE,
]


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(browser_path(), tmp_path_factory.mktemp("profile")) as running:
        yield running


@pytest.fixture
def server():
    running = PageServer()
    running.start()
    yield running
    running.close()


def awaited(browser, expression):
    answer = browser.ask("Runtime.evaluate", {"expression": expression, "awaitPromise": True, "returnByValue": True})
    assert "exceptionDetails" not in answer, answer
    return answer["result"].get("value")


def shown(browser, true):
    until(lambda: browser.evaluate(true), lambda: awaited(browser, "new Promise(r => setTimeout(r, 20))"), true)


def complaints(browser, server):
    """But of what these tests do themselves: read the pictures' pixels."""
    return [line for line in browser.complaints() if not line.startswith((f"fetched {server.address}", "Canvas2D: Multiple readback"))]


def sent(server, event):
    """What was published last."""
    return json.loads(server._last[event].split(b"data: ", 1)[1])


def look(browser, size, dark):
    """Another window, without loading the page again."""
    width, height = size
    browser.ask("Emulation.setDeviceMetricsOverride", {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600})
    media = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}, {"name": "prefers-reduced-motion", "value": "reduce"}]
    browser.ask("Emulation.setEmulatedMedia", {"features": media})
    awaited(browser, "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")


def asked(guide):
    """What the page says to do: of several rotations the one that comes now."""
    now, advice = guide.instruction, guide.requested
    if guide.stage is not Stage.TURN or advice is None or len(advice.movements) < 2 or now.do != advice.words:
        return now.do
    first = np.degrees(abs(advice.movements[0].angle_rad))
    number = int(np.degrees(guide.turn.path_rad) > 0.85 * first)
    return f"{number + 1} of 2: {advice.movements[number].words}"


def test_the_page_follows_a_session_without_an_error_and_all_of_it_is_seen(browser, server):
    hand = CoachedHand(server, segments=4)
    browser.open(server.address, *SIZES[0], still=True)
    for moment in MOMENTS:
        guide = hand.until(moment)
        if guide.stage is Stage.DONE:
            server.publish("end", {"words": "The files are closed.", "command": "calibrate.py report data/session2", "report": "offered"})
        said = asked(guide).replace("'", "\\'")
        shown(browser, f"document.getElementById('do').textContent === '{said}'")
        shown(browser, f"document.getElementById('count').textContent.startsWith('{guide.accepted} of')")
        for size in SIZES:
            for dark in (False, True):
                look(browser, size, dark)
                where = f"{guide.stage}, {size}, {'dark' if dark else 'light'}"
                assert browser.evaluate(SPILLED) == [], where
                assert browser.evaluate("document.documentElement.scrollWidth") <= size[0], where
                assert browser.evaluate(CUT) == [], where
                assert min(browser.evaluate(COLOURS)) > 20, where
                letters = {
                    name: browser.evaluate(f"parseFloat(getComputedStyle(document.getElementById('{name}')).fontSize)") for name in FAR
                }
                assert letters["do"] >= (40 if size[0] in (1280, 1920) else 25), where  # CSS px; 40 are 10.6 mm, read from two metres
                assert size[0] != 1920 or min(letters.values()) >= 40, letters
                background = browser.evaluate("getComputedStyle(document.body).backgroundColor")
                assert (background == "rgb(255, 255, 255)") is not dark, where
            if size[0] in (1280, 844, 1920):  # nobody scrolls with a table in their hands
                assert browser.evaluate("document.documentElement.scrollHeight") <= size[1], guide.stage
    assert browser.evaluate("document.getElementById('make').offsetWidth") > 0
    assert complaints(browser, server) == []


ARROW = """Promise.all([import('./path.js'), import('./turning.js')]).then(([path, turning]) => {
  const goal = path.goalOf(%s, %s), arc = path.arcOf(goal.turn, turning.seen);
  const letters = q => [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map(letter => turning.rotated(q, letter));
  return { goal, points: arc.points, from: letters(goal.turn.from), to: letters(goal.q), half: path.turnedBy(goal.turn, 0.5),
    seen: [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map(axis => turning.seen(axis)) };
})"""


def test_the_arrow_goes_as_the_hand_goes_in_a_right_handed_picture(browser, server):
    """Against the simulated board's own attitude: no line of the page's arithmetic is used for what is expected."""
    hand = CoachedHand(server, segments=4)
    browser.open(server.address, 1280, 900)
    hand.until(lambda guide: guide.accepted == 2 and guide.stage is Stage.TURN and not guide.turn.moving)
    turns = sent(server, "state")["target"]["turns"]
    began = hand.attitude
    drawn = awaited(browser, ARROW % (turns, 0))
    right, up, near = np.array(drawn["seen"]).T  # rows: what each axis of the frame with z up becomes
    np.testing.assert_allclose([right @ up, right @ near, up @ near], 0, atol=1e-12)
    np.testing.assert_allclose(np.cross(right, up), near, atol=1e-12)  # no mirror: an arrow's sense is that of a hand
    assert up[2] > 0.8
    points, axis = np.array(drawn["points"]), np.array(turns[0]["axis"])
    angle = turns[0]["angle_deg"]
    np.testing.assert_allclose(points @ axis, 0, atol=1e-3)
    step = np.cross(points[0], points[1]) @ axis
    assert np.sign(step) == np.sign(angle)  # counter-clockwise about the axis where the angle is positive
    starts, ends = np.array(drawn["from"]), np.array(drawn["to"])
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    letter = int(np.argmax(starts @ unit[0]))
    square = [v - (v @ axis) * axis for v in (starts[letter], ends[letter])]
    assert starts[letter] @ unit[0] > 0.4  # it begins beside a letter of the board, and ends beside the same one of the ghost
    np.testing.assert_allclose([v / np.linalg.norm(v) for v in square], [unit[0], unit[-1]], atol=2e-3)
    whole = np.deg2rad(abs(angle))
    hand.until(lambda guide: guide.turn.path_rad > whole / 2)
    turned = np.linalg.norm((hand.attitude * began.inv()).as_rotvec())
    q, half = sent(server, "pose")["q"], drawn["half"]
    part = turned / whole
    assert 0.3 < part < 0.8
    assert 2 * np.arccos(min(1.0, abs(np.dot(q, half)))) < abs(part - 0.5) * whole + 0.1


def test_keys_and_pedals_ask_and_a_note_is_typed(browser, server):
    hand = CoachedHand(server, segments=4)
    server.wishes.begin()
    browser.open(server.address, 1280, 900)
    hand.until(lambda guide: guide.accepted == 1)
    shown(browser, "document.getElementById('count').textContent.startsWith('1 of')")

    def press(key, text=""):
        browser.ask("Input.dispatchKeyEvent", {"type": "keyDown", "key": key, "text": text} if text else {"type": "keyDown", "key": key})
        browser.ask("Input.dispatchKeyEvent", {"type": "keyUp", "key": key})

    got = []

    def heard(*expected):
        got.extend(server.wishes())
        return got == list(expected)

    assert browser.evaluate("document.getElementById('sound').ariaPressed") == "false"
    press("PageDown")
    press("PageDown")  # a foot that rests on the pedal
    until(lambda: heard(("pause", "")))
    press("PageUp")
    until(lambda: heard(("pause", ""), ("drop", "")))
    press("Enter", "\r")  # there is no mark to stand on now
    press("n", "n")
    browser.ask("Input.insertText", {"text": "p is for pause"})
    press("Enter", "\r")
    until(lambda: heard(("pause", ""), ("drop", ""), ("note", "p is for pause")))
    shown(browser, "document.getElementById('text').value === ''")
    assert browser.evaluate("document.getElementById('sound').ariaPressed") == "true"  # the first key turned it on
    server.publish("end", {"words": "The files are closed.", "command": "", "report": "offered"})
    shown(browser, "!document.getElementById('end').hidden")
    press(" ", " ")
    until(server.wishes.report.is_set)
    server.publish("end", {"words": "made", "command": "", "report": "ready"})
    shown(browser, "document.getElementById('open').offsetWidth > 0")
    assert heard(*got)


def test_a_page_that_was_cut_off_comes_back(browser):
    first = PageServer()
    first.start()
    CoachedHand(first, segments=4).until(lambda guide: guide.stage is Stage.HOLD_STILL)
    browser.open(first.address, 1280, 900)
    shown(browser, "document.getElementById('stage').textContent === 'hold still'")
    first.close()
    second = PageServer(port=first.server_port)
    second.token = first.token
    second.start()
    try:
        CoachedHand(second, segments=4).until(lambda guide: guide.accepted == 1)
        shown(browser, "document.getElementById('count').textContent.startsWith('1 of')")
    finally:
        second.close()


#: whether a pixel near (x, y) CSS px of the picture has the page's colour of that name
HAS = """(() => { const g = document.getElementById('rates').getContext('2d'), probe = document.createElement('canvas').getContext('2d');
  probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('--%s').trim(); probe.fillRect(0, 0, 1, 1);
  const want = probe.getImageData(0, 0, 1, 1).data, seen = g.getImageData(%s, %s, 12, 5).data;
  const near = i => [0, 1, 2].every(k => Math.abs(seen[4 * i + k] - want[k]) < 40);
  return Array.from({ length: seen.length / 4 }, (_, i) => near(i)).includes(true); })()"""


@pytest.mark.parametrize(("rates", "most"), [((100.0, -50.0, 0.0), 125.0), ((20.0, 10.0, -31.0), 31.25), ((400.0, 0.0, -200.0), 500.0)])
def test_the_rates_of_the_last_ten_seconds_are_lines_to_scale(browser, server, rates, most):
    """Ten seconds and not more; the full scale is a dashed line where the picture reaches it."""
    CoachedHand(server, segments=4).until(lambda guide: guide.stage is Stage.TURN)
    browser.open(server.address, 1280, 900, still=True)
    shown(browser, "document.getElementById('rate').textContent !== '–'")
    poses = [{"t_s": 1000 + 0.1 * k, "rate_dps": [499.0] * 3 if k < 100 else list(rates)} for k in range(210)]
    awaited(
        browser,
        f"import('./rates.js').then(page => {{ for (const pose of {json.dumps(poses)}) page.remember(pose); page.drawRates(500); }})",
    )
    width, height = (browser.evaluate(f"document.getElementById('rates').client{side}") for side in ("Width", "Height"))
    for rate, name in zip(rates, ("now", "wanted", "good"), strict=True):
        y = height / 2 - rate / most * (height / 2 - 11)
        assert browser.evaluate(HAS % (name, round(width / 2), round(y) - 2)), name
    dashed = [browser.evaluate(HAS % ("bad", 70, y - 2)) for y in (11, height - 11)]
    assert dashed == [most == 500.0] * 2


NAMES = """import('./sphere.js').then(({ drawSphere }) => {
  const boxes = [], c = document.getElementById('sphere'), proto = CanvasRenderingContext2D.prototype, before = proto.fillText;
  proto.fillText = function (text, x, y) {
    const half = this.measureText(text).width / 2, high = parseFloat(this.font.match(/[0-9.]+px/)[0]) * 0.45;
    boxes.push([text, x - half, x + half, y - high, y + high]);
    before.call(this, text, x, y);
  };
  const up = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
  drawSphere(up, [0, -1, 0]);
  proto.fillText = before;
  return [c.clientWidth, c.clientHeight, boxes];
})"""


def test_no_name_on_the_sphere_hides_another_nor_is_cut(browser, server):
    hand = CoachedHand(server, segments=2)
    browser.open(server.address, *SIZES[0])
    hand.until(lambda guide: guide.accepted == 1)
    for size in [size for size in SIZES if size != (844, 390)]:
        look(browser, size, dark=False)
        width, height, boxes = awaited(browser, NAMES)
        assert sorted(text for text, *_ in boxes) == ["+x✓", "+y✓", "+z✓", "−x✓", "−y✓", "−z✓"]
        for number, (_, left, right, top, bottom) in enumerate(boxes):
            assert left > 0, size
            assert top > 0, size
            assert right < width, size
            assert bottom < height, size
            for _, other_left, other_right, other_top, other_bottom in boxes[:number]:
                apart = (right < other_left, other_right < left, bottom < other_top, other_bottom < top)
                assert any(apart), size
