"""Recorded less predicted: the terminal, the report and the JSON show one set of numbers."""

import re
from html import unescape
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import broad
from explained_sessions import make_explained, make_session

from tinygc.explanation.result import HEADING, channel_rms, residual_table
from tinygc.reporting.explanation_text import explanation_page
from tinygc.reporting.html.sections.explanation import section
from tinygc.reporting.terminal import as_text


@pytest.fixture(scope="module")
def explained(tmp_path_factory):
    return make_explained(make_session(tmp_path_factory))


def on_terminal(e) -> list[list[str]]:
    """Name and numbers of each row of the table."""
    lines = as_text(explanation_page(e)).splitlines()
    at = lines.index(HEADING)
    return [re.split(r"\s{2,}", line.strip()) for line in lines[at + 2 : at + 7]]


def in_report(e) -> list[list[str]]:
    html = section(SimpleNamespace(explanation=e)).html
    assert HEADING in unescape(html)
    body = html[html.index("<tbody>", html.index("channel</th>")) :]
    rows = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", body[: body.index("</tbody>")])]
    return [[unescape(cell) for cell in row if cell] for row in rows]


@pytest.mark.broad
@pytest.mark.parametrize("name", ["g_sensitivity", broad("nothing")])
def test_the_report_shows_what_explain_shows(explained, name):
    e, _ = explained(name)
    assert on_terminal(e) == in_report(e)
    assert len(in_report(e)[0]) == (4 if name == "g_sensitivity" else 3)


@pytest.mark.broad
def test_the_json_holds_the_numbers_of_the_page(explained):
    e, result = explained("g_sensitivity")
    for row, (name, channel) in zip(on_terminal(e), result["channels"].items(), strict=False):
        assert row[2:] == [f"{channel['rms_sigmas'][when]:.2f}" for when in ("before", "after")], name
    assert [row.after is None for row in residual_table(e)] == [False, False, False, True, True]


@pytest.mark.broad
def test_a_healthy_accelerometer_looks_healthy_before_and_after(explained):
    """Whitened together with the closure, gravity's length would seem to be mended by a name of the gyro."""
    e, _ = explained("g_sensitivity")
    part = e.whiten.parts["length"]
    together = [float(np.sqrt(np.mean(fit.r[part] ** 2))) for fit in (e.naming.first, e.naming.fit)]
    assert together[0] > 1.5 * together[1]  # what the report once showed
    before, after = channel_rms(e)["length"]
    assert before == pytest.approx(after, abs=0.02)
    assert 0.3 < before < 1.5
