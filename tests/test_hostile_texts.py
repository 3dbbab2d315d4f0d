"""Texts of files, boards and people stay texts wherever they go: read back by each format's own reader, nothing is injected.

The texts, the places and the readers are those of ``hostile_texts.py``.
"""

import json
import os
import shutil
import tomllib
from pathlib import Path

import pytest
from hostile_texts import HOSTILE, LINE_ENDS, LINEAR, LONG, PAYLOADS, PLACES, context, injected
from hypothesis import given, settings
from hypothesis import strategies as st
from processes import PIPE, run

from session.base.records import json_text
from session.base.texts import comment, printable, shell_word, unicode_text
from session.base.toml import toml_line
from tinygc.deploy.exports import FORMATS, exporter

PIECES = [
    *LINE_ENDS,
    *PAYLOADS.values(),
    "*/",
    "/*",
    "//",
    "\\",
    "??/",
    "-->",
    "<b>",
    '"',
    "'",
    "#",
    "\x1b[31m",
    "[red]",
    "\udce9",
    "\u202e",
]
TEXTS = st.text(st.characters(), max_size=40) | st.lists(st.sampled_from(PIECES) | st.text(st.characters(), max_size=3), max_size=6).map(
    "".join
)


@pytest.mark.parametrize("name", PLACES)
def test_a_hostile_text_injects_nothing(name):
    texts = (*HOSTILE, *LONG) if name == "ardupilot" else HOSTILE
    assert {text: count for text in texts if (count := injected(PLACES[name], text))} == {}


@settings(max_examples=6)
@given(TEXTS)
def test_no_text_at_all_injects_anything(text):
    assert {name: count for name, place in PLACES.items() if (count := injected(place, text))} == {}


def test_the_readers_see_an_injection():
    """What would be said if nothing were escaped: the checks above can fail."""
    from hostile_texts import Place, ardupilot, c_statements, elements, lines_but_comments, terminal, toml_lines, yaml_table

    for read, wrong in (
        (lines_but_comments, "# {}\nx 1\n"),
        (ardupilot, "# {}\nx,1\n"),
        (yaml_table, "# {}\nx: 1\n"),
        (c_statements, "// {}\nint x;\n"),
        (c_statements, "/* {} */\nint x;\n"),
        (terminal, "{}\n"),
        (elements, "<p>{}</p>"),
        (toml_lines, '[sensor]\nmodel = "{}"\n'),
    ):
        assert any(injected(Place(wrong.replace("{}", "%s").__mod__, read), text) for text in (*HOSTILE, *LONG)), read
    assert injected(Place(lambda text: f"# {text}\n", ardupilot), LONG[70]) == 1


def test_exported_c_compiles_whatever_the_serial_number_says(tmp_path):
    """Every warning an error (C11 knows trigraphs); what a text would define is another thing at the end of each file."""
    if shutil.which("gcc") is None:
        pytest.skip("not installed: gcc")
    vector = "typedef union { struct { float x, y, z; } axis; } FusionVector;"
    types = f"{vector} typedef union {{ struct {{ float xx, xy, xz, yx, yy, yz, zx, zy, zz; }} element; }} FusionMatrix;\n"
    for number, text in enumerate(("".join(HOSTILE), "a\\", "a??/", "a */ int evil; /*")):
        written = exporter("c").export(LINEAR, context(f"x\n{text}"))
        (header,) = (content for name, content in exporter("xio").export(LINEAR, context(f"x\n{text}")).items() if name.endswith(".h"))
        (tmp_path / f"{number}").mkdir()
        for name, content in {**written, "xio.c": types + header}.items():
            end = "" if name.endswith(".h") else "char *evil(int, long);\n"
            (tmp_path / f"{number}" / name).write_text(content + end, encoding="utf-8")
    flags = ["-std=c11", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wno-unused-variable", "-Wno-unused-const-variable", "-fsyntax-only"]
    made = run(["gcc", *flags, *tmp_path.glob("*/*.c")], stderr=PIPE, text=True)
    assert made.returncode == 0, made.stderr[:2000]


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "c"])
def test_what_is_readable_stays_readable(name):
    assert any("Ø-12 µ" in text for text in exporter(name).export(LINEAR, context("Ø-12 µ")).values())


@settings(max_examples=25)
@given(st.text(st.characters()))
def test_json_and_toml_give_back_what_they_were_given(text):
    plain = unicode_text(text)
    plain.encode("utf-8")
    assert json.loads(json_text({text: [text]})) == {plain: [plain]}
    assert json.loads(json_text({text: [text]}, ascii_only=True).encode("ascii")) == {plain: [plain]}
    assert tomllib.loads(toml_line(text, text)) == {plain: plain}
    assert printable(text).isprintable()
    assert comment(text).isprintable()
    if text.isprintable():
        assert printable(text) == plain == text


def test_bytes_that_were_no_text_are_shown_as_bytes():
    assert printable(os.fsdecode(b"caf\xe9\n")) == r"caf\xe9\n"
    assert unicode_text("\ud800") == r"\ud800"
    assert json.loads(json_text(os.fsdecode(b"caf\xe9"))) == r"caf\xe9"


@pytest.mark.parametrize("name", [b"plain", b"two words", b"caf\xe9", b"a\n$(reboot)", b"it's", b"\x1b[31m\\", "Ø µ".encode(), b"-x", b"~"])
def test_a_command_that_is_copied_names_the_very_file(name):
    if shutil.which("bash") is None:
        pytest.skip("not installed: bash")
    word = shell_word(Path(os.fsdecode(name)))
    assert word.isprintable()
    made = run(["bash", "-c", f"printf %s {word}"], stdout=PIPE, check=True)
    assert made.stdout == name or name == b"-x"


def test_a_terminal_obeys_the_page_and_nothing_that_it_quotes():
    from io import StringIO

    from rich.text import Text

    from session.base.console import PlainConsole

    console = PlainConsole(file=StringIO(), width=80, force_terminal=True, color_system="standard")
    console.print(Text("a\x1b[2J\x9b2J\u202eb", "bold red"), "[red]c[/red]\nd", ":skull:")
    assert console.file.getvalue() == "\x1b[1;31ma\\x1b[2J\\x9b2J\\u202eb\x1b[0m [red]c[/red]\\nd :skull:\n"
