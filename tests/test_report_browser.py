"""The report in a real browser: nothing is fetched, nothing fails, every picture is drawn and can be read, wide and narrow."""

import shutil
from itertools import pairwise

import numpy as np
import processes
import pytest
from browser import Browser, browser_path
from html_pages import WHOLE, report_of

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(browser_path() is None, reason="no Chromium here: the report is not looked at in a browser"),
]

#: what is seen of each picture: its size on the page, its own letters' size, and whether they stay inside it
PICTURES = """[...document.querySelectorAll('figure div > svg')].filter(s => s.getClientRects().length).map(s => {
  const box = s.getBoundingClientRect(), scale = box.width / s.viewBox.baseVal.width, texts = [...s.querySelectorAll('text')];
  return {about: s.getAttribute('aria-label'), width: box.width, height: box.height,
    shapes: s.querySelectorAll('path, circle, rect').length,
    letters: Math.min(99, ...texts.map(t => parseFloat(getComputedStyle(t).fontSize) * scale)),
    outside: texts.filter(t => { const b = t.getBoundingClientRect();
      return b.left < box.left - 3 || b.right > box.right + 3 || b.top < box.top - 3 || b.bottom > box.bottom + 3;
    }).map(t => t.textContent)}})"""
#: elements that reach beyond the page's right edge, but for those that scroll by themselves
SPILLED = """[...document.querySelectorAll('main *')].filter(e => !e.closest('.scroll, pre, svg')
  && e.getBoundingClientRect().right > innerWidth + 1).map(e => e.tagName + ' ' + e.className)"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(browser_path(), tmp_path_factory.mktemp("profile")) as running:
        yield running


@pytest.fixture(scope="module")
def page(simulated, tmp_path_factory):
    return report_of(simulated(), tmp_path_factory.mktemp("report") / "report.html", *WHOLE)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_every_picture_is_drawn_and_can_be_read(browser, page, width, dark):
    browser.open(page, width, dark=dark)
    assert browser.complaints() == []
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    assert browser.evaluate(SPILLED) == []
    pictures = browser.evaluate(PICTURES)
    assert len(pictures) >= 10
    for picture in pictures:
        assert picture["width"] > 250, picture
        assert picture["height"] > 80, picture
        assert picture["shapes"] > 5, picture
        assert picture["letters"] >= 10, picture
        assert picture["outside"] == [], picture
    background = browser.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(255, 255, 255)") is not dark


def test_headings_go_down_one_level_at_a_time_and_every_link_leads_somewhere(browser, page):
    browser.open(page, 1280)
    levels = browser.evaluate("[...document.querySelectorAll('h1,h2,h3')].map(h => +h.tagName[1])")
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    links = browser.evaluate("[...document.querySelectorAll('a[href^=\"#\"]')].map(a => !!document.getElementById(a.hash.slice(1)))")
    assert links
    assert all(links)


#: of a sheet of A4 within the margins of the style sheet, CSS pixels
SHEET = (180 / 25.4 * 96, (297 - 38) / 25.4 * 96)
UNCUT = """[...document.querySelectorAll('.scroll, .made')].map(e => [getComputedStyle(e).breakInside, e.offsetHeight])"""


def test_on_paper_the_first_page_is_the_report_and_no_table_is_cut(browser, page):
    browser.open(page, round(SHEET[0]))
    browser.ask("Emulation.setEmulatedMedia", {"media": "print"})
    tables = browser.evaluate(UNCUT)
    assert len(tables) > 8
    assert {each for each, _ in tables} == {"avoid"}
    assert max(height for _, height in tables) < SHEET[1]
    first = browser.evaluate("[...document.querySelectorAll('#answer, .errors')].map(e => e.getBoundingClientRect().bottom)")
    assert 0.6 * SHEET[1] < max(first) < SHEET[1]
    browser.ask("Emulation.setEmulatedMedia", {"media": ""})


def test_a_pdf_is_made_by_one_command_and_no_page_is_mostly_empty(simulated, tmp_path):
    page = report_of(simulated(), tmp_path / "r.html", *WHOLE, "--pdf")
    assert page.with_suffix(".pdf").read_bytes().startswith(b"%PDF")
    if shutil.which("pdftoppm") is None:
        pytest.skip("not installed: pdftoppm")
    processes.run(["pdftoppm", "-r", "20", "-gray", page.with_suffix(".pdf"), tmp_path / "p"], check=True)
    sheets = sorted(tmp_path.glob("p-*.pgm"))
    assert 5 <= len(sheets) <= 20
    for sheet in sheets:
        data = sheet.read_bytes()
        width, height = map(int, data.split(maxsplit=4)[1:3])
        rows = np.flatnonzero((np.frombuffer(data[-width * height :], np.uint8).reshape(height, width) < 200).any(axis=1))
        body = rows[(rows > 0.08 * height) & (rows < 0.92 * height)]  # without the lines on every sheet
        assert body.max() > 0.55 * height, sheet.name
