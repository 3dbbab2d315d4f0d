"""The report's part on what ``explain --discover`` found: as its folder says it, escaped, and refused in one line where it is none."""

import json
import re

import pytest
from discovery_answers import LAWS, NOTHING, found, law_of, runner_up
from html_pages import parsed

from session.io.errors import FormatError
from session.io.folder import sha256_of
from session.io.results import json_text
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.report_section import PNG, searched, section
from tinygc.annexes.discovery.result import to_json
from tinygc.reporting.html.page import document

CLIPPED = runner_up(LawForm((Factor("rate", "within", 0.1),)))


class Evidence:
    def __init__(self, folder):
        (log,) = folder.glob("log*")
        self.searched = searched(folder, {log.name: sha256_of(log)})


def explained(folder, discovery, files=(), following="turn it again"):
    """A folder as ``explain --discover`` leaves it, and the log of it."""
    (folder / "log0001.csv").write_text("t_us\n1\n", encoding="utf-8")
    (folder / "explain").mkdir()
    logs = {"log0001.csv": sha256_of(folder / "log0001.csv")}
    table = {"schema": "tinygc-explain/2", "next": following, "logs": logs, "discovery": to_json(discovery, list(files))}
    (folder / "explain" / "explain.json").write_text(json_text(table), encoding="utf-8")
    return folder


def html_of(folder) -> str:
    made = section(Evidence(folder))
    text = document("t", "", [made], "")
    parsed(text)
    return text


@pytest.mark.parametrize("name", ["dead zone", "matrix"])
def test_a_law_is_said_with_its_equation_its_evidence_its_picture_and_how_to_use_it(name, tmp_path):
    law = law_of(*LAWS[name], same=(LawForm((Factor("rate", "root"),)),), runners_up=(CLIPPED,))
    folder = explained(tmp_path, found(law), ["effects/discovered_law.py"])
    (folder / "explain" / "discover.png").write_bytes(PNG + b"and so on")
    text = html_of(folder)
    for words in (
        "An equation was found",
        "(41234 forms tried, 10987 of them distinct here)",
        "discovered.law",
        "closure 0.2100° before, 0.0131° after, floor 0.0117°; 99.5 % of the excess removed",
        "In these equations: clip(x, ±c) = x held within ±c",
        "alternative: ω_i += c_i clip(u_i, ±0.1)",
        "written as <code>explain/effects/discovered_law.py</code>",
        f"calibrate.py explain OTHER --effects {folder / 'explain' / 'effects'}",
        "<strong>Next:</strong> turn it again",
        'src="data:image/png;base64,',
    ):
        assert words in text, words
    assert ("x ← x 0.1000 ± 0.0020" in text) == (name == "matrix")


def test_no_equation_is_said_too_and_needs_no_picture(tmp_path):
    text = html_of(explained(tmp_path, NOTHING, following=""))
    assert "No equation of this grammar" in text
    assert "the best form does no more than chance does in 34 % of such searches" in text
    assert not re.search("<img|explain OTHER|Next:", text)


def test_it_is_not_there_where_nothing_was_searched_or_the_logs_are_others(tmp_path):
    folder = explained(tmp_path, NOTHING)
    place = folder / "explain" / "explain.json"
    table = json.loads(place.read_text(encoding="utf-8"))
    hashes = table["logs"]
    for others in ({}, hashes | {"log0002.csv": "0" * 64}):  # one was taken away since, or was never there
        place.write_text(json.dumps(table | {"logs": others}), encoding="utf-8")
        assert section(Evidence(folder)) is None
    place.write_text(json.dumps(table), encoding="utf-8")
    assert section(Evidence(folder)) is not None
    (folder / "log0001.csv").write_text("t_us\n2\n", encoding="utf-8")
    assert section(Evidence(folder)) is None
    del table["discovery"]
    place.write_text(json.dumps(table), encoding="utf-8")
    assert section(Evidence(folder)) is None
    place.unlink()
    assert section(Evidence(folder)) is None


def test_nothing_of_a_file_gets_through_as_markup(tmp_path):
    folder = explained(tmp_path, found(law_of(*LAWS["dead zone"])), ["effects/x.py"])
    place = folder / "explain" / "explain.json"
    table = json.loads(place.read_text(encoding="utf-8"))
    for key in ("id", "equation", "in_words", "unit", "file"):
        table["discovery"]["laws"][0][key] = "<script>alert(1)</script>"
    place.write_text(json.dumps(table), encoding="utf-8")
    (folder / "explain" / "discover.png").write_bytes(b"no picture")
    text = html_of(folder)
    assert "<script" not in text
    assert "<img" not in text


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("parameters", {"dps": [1, 2]}, "dps has shape 2, expected 3 numbers"),
        ("parameters", {"dps": [[1, 2], [3, 4]]}, "dps has shape 2 x 2, expected 3 x n numbers"),
        ("parameters", 3, "is 3, expected a table"),
        ("std", {"other": [1, 2, 3]}, "std is not of its parameters"),
        ("std", {"dps": [[1, 2]] * 3}, "std is not of its parameters"),
        ("held_out", [{}], "before_deg is missing"),
        ("equation", None, "equation is null, expected text"),
        ("runners_up", [3], "is 3, expected a table"),
    ],
)
def test_what_is_no_discovery_is_refused_in_one_line(key, value, says, tmp_path):
    folder = explained(tmp_path, found(law_of(*LAWS["dead zone"])), ["effects/x.py"])
    place = folder / "explain" / "explain.json"
    table = json.loads(place.read_text(encoding="utf-8"))
    table["discovery"]["laws"][0][key] = value
    place.write_text(json.dumps(table), encoding="utf-8")
    with pytest.raises(FormatError, match=re.escape(says)) as caught:
        Evidence(folder)
    assert "explain again, or remove it" in str(caught.value)
    assert "explain.json" in str(caught.value)
