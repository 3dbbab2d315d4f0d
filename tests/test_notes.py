"""``[notes]`` of session.toml: read, added to without touching what else is there, and shown in the report."""

import tomllib
from datetime import UTC, date, datetime
from types import SimpleNamespace

import pytest
from conftest import SESSION_TOML

from session.bench.events import Info
from session.bench.session_file import SessionFile, toml_text
from session.io.config import LeftOut, read_config
from session.io.errors import FormatError
from session.io.folder import add_exclude, add_notes
from session.io.toml import value_text
from tinygc.reporting.html.markup import render

NOTES = """
[notes]  # of the bench
operator = "Mara"   # she turned

"room temperature" = 21.5
date = 2026-11-22

[site2]
x = 1
"""


def file_of(tmp_path, text):
    path = tmp_path / "session.toml"
    path.write_bytes(text.encode())
    return path


def test_notes_of_every_kind_are_read(tmp_path):
    text = SESSION_TOML + '[notes]\na = "b"\nn = 3\nx = 2.5\nwhen = 2026-11-22\nat = 2026-11-22T10:00:00Z\nok = true\n'
    config = read_config(file_of(tmp_path, text))
    assert config.notes == {
        "a": "b",
        "n": 3,
        "x": 2.5,
        "when": date(2026, 11, 22),
        "at": datetime(2026, 11, 22, 10, tzinfo=UTC),
        "ok": True,
    }
    assert config.unknown == ()


@pytest.mark.parametrize("row", ["a = [1]", "a = {b = 1}"])
def test_what_is_no_note_is_refused(tmp_path, row):
    with pytest.raises(FormatError, match=r"notes.a is .*, expected text, a number or a date"):
        read_config(file_of(tmp_path, SESSION_TOML + f"[notes]\n{row}\n"))


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("text", [SESSION_TOML, SESSION_TOML.rstrip("\n"), SESSION_TOML + NOTES, "\ufeff" + SESSION_TOML])
def test_what_is_added_leaves_every_line_as_it_was(tmp_path, text, end):
    text = text.replace("\n", end)
    path = file_of(tmp_path, text)
    add_notes(path, {"place": "cellar", 'q"1"': 'say "hi"\\ 😀'})
    add_exclude(path, LeftOut("log0001.csv", 12.5))
    add_notes(path, {"later": "x"})
    with path.open(encoding="utf-8", newline="") as file:
        now = file.read()
    before, after = text.splitlines(), iter(now.splitlines())
    assert all(line in after for line in before), "a line was lost, changed or moved"
    config = read_config(path)
    assert list(config.notes)[-3:] == ["place", 'q"1"', "later"]
    assert config.notes['q"1"'] == 'say "hi"\\ 😀'
    assert config.exclude == (LeftOut("log0001.csv", 12.5),)
    assert not list(tmp_path.glob(".*"))


def test_a_note_is_never_lost(tmp_path):
    path = file_of(tmp_path, SESSION_TOML + NOTES)
    before = path.read_bytes()
    add_notes(path, {"operator": "Mara"})
    assert path.read_bytes() == before
    with pytest.raises(FormatError, match=r'notes.operator is "Mara" already'):
        add_notes(path, {"operator": "Tom", "new": "y"})
    assert path.read_bytes() == before
    with pytest.raises(FormatError, match=r"notes.operator is 'Mara' already"):
        SessionFile(tmp_path, None, None, None, None, None, {"operator": "Tom"})


def test_a_form_that_cannot_be_added_to_is_left_alone(tmp_path):
    path = file_of(tmp_path, 'notes = {a = "b"}\n' + SESSION_TOML)
    before = path.read_bytes()
    with pytest.raises(FormatError, match=r"no place to add to; put what you want to note below \[notes\] by hand"):
        add_notes(path, {"c": "d"})
    assert path.read_bytes() == before


def test_a_header_within_a_text_is_no_header(tmp_path):
    path = file_of(tmp_path, SESSION_TOML + '[other]\ntext = """\n[notes]\n"""\n')
    add_notes(path, {"c": "d"})
    assert read_config(path).notes == {"c": "d"}
    assert tomllib.loads(path.read_text())["other"]["text"] == "[notes]\n"


@pytest.mark.parametrize("text", ["\x7f", "\x00\x1f", "\ud83d", "a\nb", "é😀"])
def test_any_text_is_toml(text):
    assert tomllib.loads(f"a = {value_text(text)}")["a"] == (text if text != "\ud83d" else r"\ud83d")


def test_a_recording_writes_its_notes_once_it_knows_the_board(tmp_path):
    file = SessionFile(tmp_path, None, None, None, None, None, {"operator": "Mara"})
    when = datetime(2026, 11, 22, 8, 40, 12, tzinfo=UTC)
    file.note("before", when)
    assert not (tmp_path / "session.toml").exists()
    file.configure(Info(500.0, 4.0, 208.0, "7"))
    for text in ("first", "second"):
        file.note(text, when)
    assert read_config(tmp_path / "session.toml").notes == {
        "operator": "Mara",
        "2026-11-22T08:40:12Z": "before",
        "2026-11-22T08:40:12Z (2)": "first",
        "2026-11-22T08:40:12Z (3)": "second",
    }
    resumed = SessionFile(tmp_path, None, None, None, None, None, {"place": "cellar"})
    resumed.configure(Info(500.0, 4.0, 208.0, "7"))
    notes = read_config(tmp_path / "session.toml").notes
    assert len(notes) == 5
    assert notes["place"] == "cellar"


def test_like_lends_no_notes_and_a_rewrite_keeps_them(tmp_path):
    (tmp_path / "a").mkdir()
    path = file_of(tmp_path / "a", SESSION_TOML + '[notes]\noperator = "Mara"\n[[exclude]]\nlog = "log0001.csv"\nat_s = 3\n')
    config = read_config(path)
    file_of(tmp_path, toml_text(config))
    again = read_config(tmp_path / "session.toml")
    assert (again.notes, again.exclude) == (config.notes, config.exclude)
    SessionFile(tmp_path / "b", tmp_path / "a", None, None, None).configure(Info(500.0, 4.0, 208.0, "7"))
    lent = read_config(tmp_path / "b" / "session.toml")
    assert (lent.notes, lent.exclude) == ({}, ())


def test_the_report_shows_them_escaped():
    config = SimpleNamespace(notes={"<b>who</b>": "<script>", "warm": True, "cold": False}, exclude=(LeftOut("<i>.csv", 3.0),))
    html = render("notes.html", config=config)
    assert "<script>" not in html
    assert "&lt;script&gt;" in html
    assert "&lt;b&gt;who&lt;/b&gt;" in html
    assert "&lt;i&gt;.csv" in html
    assert "<dt>warm</dt><dd>yes</dd>" in html
    assert "<dt>cold</dt><dd>no</dd>" in html
