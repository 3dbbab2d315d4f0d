"""What a page shows of a command is what the command prints: docs/make_outputs.py runs them all."""

import importlib.util

import pytest
from conftest import ROOT

_spec = importlib.util.spec_from_file_location("make_outputs", ROOT / "docs" / "make_outputs.py")
make_outputs = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(make_outputs)


def _marks(path):
    return [pytest.mark.broad] if make_outputs.SLOW in path.read_text(encoding="utf-8") else []


PAGES = [pytest.param(path, id=path.relative_to(ROOT).as_posix(), marks=_marks(path)) for path in make_outputs.pages()]


@pytest.mark.parametrize("page", PAGES)
def test_the_page_shows_what_is_printed(page):
    text = page.read_text(encoding="utf-8")
    assert make_outputs.made(text).splitlines() == text.splitlines(), f"python docs/make_outputs.py {page.relative_to(ROOT)}"


def test_lines_are_run_chosen_and_refused():
    """A hidden command, chosen lines, a refusal, and a block that stays."""
    seen = "<!-- run: seq 5 > five -->\n<!-- lines 1-2, 4-4 -->\n\n```\n$ cat five\nold\n```\n\n"
    refused = "```\n$ python calibrate.py apply none none.csv -o out.csv\n```\n"
    made = make_outputs.made(f"{seen}{refused}<!-- not run: no board -->\n```\n$ false\nkept\n```\n")
    assert "$ cat five\n1\n2\n…\n4\n…\n```" in made
    assert "-o out.csv\ncalibrate: none" in made
    assert made.endswith("$ false\nkept\n```\n")
