"""What the README and its pages point to is there, one list leads to every page, and what they tell a reader to run does run."""

import argparse
import ctypes
import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import processes
import pytest

import tinygc
from session.base.errors import CalibrationError
from tinygc.cli.arguments import joined, parser
from tinygc.cli.commands import commands as all_commands
from tinygc.deploy import FORMATS
from tinygc.effects import catalogue
from tinygc.models.linear import LinearModel

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
FOLDERS = (ROOT, ROOT / "benchmarks", ROOT / "data", ROOT / "tests")
PAGES = sorted([*(path for folder in FOLDERS for path in folder.glob("*.md")), *DOCS.rglob("*.md")])
LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]+))?\)")
INDEX = DOCS / "index.md"
README_LINES = 80
#: the two commands that a reader runs first; each installs what it needs
SET_UP = """```
python -m pip install -e . -c constraints.txt && python calibrate.py fit data/session1
python -m pip install -e '.[test]' -c constraints.txt && python -m pytest
```
"""
#: endings of what is written in a programming language
CODE = (".py", ".c", ".h", ".ino")
COMMAND = re.compile(r"(?:calibrate(?:\.py)? |`)((?:noise|table|rates) record|\w+)((?: [^\n`|;#]*)?)")
NAMED = ("commands", "explain", "exports")
each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())


def without_code(text):
    """Its lines keep their numbers."""
    return re.sub(r"^```.*?^```", lambda block: "\n" * block[0].count("\n"), text, flags=re.S | re.M)


def anchors(text):
    """Of the headings, as Git hosts make them."""
    heads = re.findall(r"^#+ (.+)$", without_code(text), flags=re.M)
    heads = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head) for head in heads]
    return {re.sub(r"[^\w\- ]", "", head.strip().lower()).replace(" ", "-") for head in heads}


def linked_pages(text, folder):
    """Pages that a text links to, in order, each once."""
    targets = [(folder / target).resolve() for target, _ in LINK.findall(without_code(text)) if target.endswith(".md")]
    return list(dict.fromkeys(targets))


def blocks(path, language):
    return re.findall(rf"```{language}\n(.*?)```", path.read_text(encoding="utf-8"), re.S)


def alike(listed, there, page):
    """A page lists what is there, and nothing else."""
    wrong = {f"{each} is not there" for each in listed - there} | {f"{each} is not listed" for each in there - listed}
    assert not wrong, "\n".join([f"edit {page}:", *sorted(wrong)])


@each_page
def test_every_link_inside_the_project_leads_somewhere(page):
    name, broken = page.relative_to(ROOT), []
    for number, line in enumerate(without_code(page.read_text(encoding="utf-8")).split("\n"), start=1):
        for target, anchor in LINK.findall(line):
            path = (page.parent / target).resolve() if target else page
            if not path.exists():
                broken.append(f"{name}:{number}: {target} is not there")
            elif not path.is_relative_to(ROOT):
                broken.append(f"{name}:{number}: {target} is outside the project")
            elif anchor and anchor not in anchors(path.read_text(encoding="utf-8")):
                broken.append(f"{name}:{number}: {target} has no heading #{anchor}")
    assert not broken, "\n".join(broken)


def test_every_page_that_the_code_names_is_there():
    """By its name: a comment, a docstring or a message that leads nowhere is worse than none."""
    there = {path.name for path in PAGES}
    code = [path for part in ("session", "tinygc", "firmware", "benchmarks") for path in (ROOT / part).rglob("*") if path.suffix in CODE]
    named = {(path.name, name) for path in code for name in re.findall(r"[\w-]+\.md\b", path.read_text(encoding="utf-8"))}
    assert len(named) > 50
    assert {pair for pair in named if pair[1] not in there} == set()


def test_the_readme_is_short_and_begins_with_the_two_commands():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert text.count("\n") <= README_LINES
    assert text.index(SET_UP) < 1500


def test_one_list_leads_to_every_page():
    """formats.md lists the pages of docs/formats, and docs/index.md all others."""
    listed = {path for path in linked_pages(INDEX.read_text(encoding="utf-8"), DOCS) if path.is_relative_to(DOCS)}
    pages = set((DOCS / "formats").glob("*.md"))
    alike(listed, set(DOCS.rglob("*.md")) - pages - {INDEX}, "docs/index.md")
    assert all(line.count("](") == 1 for line in INDEX.read_text(encoding="utf-8").splitlines() if line.startswith("- "))
    rows = re.findall(r"^- \[.*", (DOCS / "formats.md").read_text(encoding="utf-8"), re.M)
    alike(set(linked_pages("\n".join(rows), DOCS)), pages, "docs/formats.md")
    assert INDEX in linked_pages((ROOT / "README.md").read_text(encoding="utf-8"), ROOT)


def test_every_helper_of_the_tests_has_its_row():
    rows = "\n".join(re.findall(r"^\| (`[^|]+)", (ROOT / "tests" / "README.md").read_text(encoding="utf-8"), re.M))
    paths = [path for place in ("*.py", "features/*/*.py") for path in (ROOT / "tests").glob(place) if not path.name.startswith("test_")]
    alike({name.split("/")[-1] for name in re.findall(r"`([\w/]+\.py)`", rows)}, {path.name for path in paths}, "tests/README.md")


def test_every_command_effect_and_export_is_on_its_page():
    commands, explain, exports, readme = (
        path.read_text(encoding="utf-8") for path in (*(DOCS / f"{name}.md" for name in NAMED), ROOT / "README.md")
    )
    assert set(re.findall(r"^### (\w.*)$", commands, re.M)) >= set(all_commands())
    first = "\n".join(re.findall(r"^\| (`[^|]+)", explain.split("## The catalogue", 1)[1].split("\n## ", 1)[0], re.M))
    assert set(re.findall(r"`([a-z]+\.[a-z0-9_]+)`", first)) == set(catalogue())
    assert f"knows {len(catalogue())} effects" in readme
    assert set(re.findall(r"^\| `(\w+)` \|", exports, flags=re.M)) == set(FORMATS)


def test_options_that_a_page_names_exist():
    """Every ``--option`` after ``calibrate.py COMMAND`` (in a line, `COMMAND --option`) is one of that command."""
    (group,) = (action for action in parser()._actions if isinstance(action, argparse._SubParsersAction))
    known = {name: {flag for action in each._actions for flag in action.option_strings} for name, each in group.choices.items()}
    wrong = []
    for page in PAGES:
        for command, words in re.findall(
            r"(?:calibrate(?:\.py)? |`)((?:noise|table|rates) record|\w+)((?: [^\n`|;#]*)?)", page.read_text(encoding="utf-8")
        ):
            options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", words.split("calibrate")[0]))
            if not options <= known.get(command, options):
                wrong.append(f"{page.relative_to(ROOT)}: calibrate.py {command}{words}")
    assert not wrong, "\n".join(wrong)


def test_the_python_and_the_c_that_apply_a_model_agree(tmp_path, monkeypatch):
    """The examples of docs/apply.md, as they stand there, in a folder with the first command's model."""
    rng = np.random.default_rng(0)
    registers, model = (
        rng.integers(-20000, 20000, (200, 3)),
        LinearModel(np.eye(3) + 0.01 * rng.normal(size=(3, 3)), 0.01 * rng.normal(size=3)),
    )
    expected = model(registers * 17.5e-3 * np.pi / 180)
    fit = tmp_path / "data/session1/fit"
    fit.mkdir(parents=True)
    (fit / "model_least_squares.json").write_text(json.dumps(tinygc.models.to_dict(model)))
    monkeypatch.chdir(tmp_path)
    E, B, rows = (str(values.tolist()).replace("[", "{").replace("]", "}") for values in (model.E, model.B, registers))
    before = f"const double E[3][3] = {E}, B[3] = {B};\nconst int rows[200][3] = {rows};\n"
    path = DOCS / "apply.md"
    (python,) = (block for block in blocks(path, "python") if "tinygc.load" in block)
    exec(python, known := {"registers": registers})
    np.testing.assert_allclose(known["omega"], expected, rtol=0, atol=1e-12)
    if shutil.which("gcc") is None:
        return
    (code,) = blocks(path, "c")
    body = f"const int *g = rows[row];\n{code}\nfor (int i = 0; i < 3; i++) all[3 * row + i] = omega[i];\n"
    loop = f"double omega[3];\nfor (int row = 0; row < 200; row++) {{\n{body}}}\n"
    (tmp_path / "apply.c").write_text(f"{before}void apply(double *all) {{\n{loop}}}\n")
    command = ["gcc", "-std=c99", "-Wall", "-Werror", "-shared", "-fPIC", "-o", tmp_path / "apply.so", tmp_path / "apply.c"]
    processes.run(command, check=True)
    answered = np.zeros((200, 3))
    ctypes.CDLL(str(tmp_path / "apply.so")).apply(ctypes.c_void_p(answered.ctypes.data))
    np.testing.assert_allclose(answered, expected, rtol=0, atol=2e-6)


def test_commands_that_a_page_shows_are_understood():
    """Each line of a block that runs the tool, with its arguments; docs/make_outputs.py runs those that need no hardware."""
    wrong, count = [], 0
    for page in PAGES:
        fences = re.findall(r"^ *```(\w*)\n(.*?)^ *```$", page.read_text(encoding="utf-8"), re.S | re.M)
        lines = [line for language, body in fences if not language for line in body.splitlines()]
        for part in (part for line in lines for part in re.split(r" && |; | \| ", line) if "…" not in part):
            (*_, words) = part.partition("python calibrate.py ")
            words = shlex.split(words, comments=True)
            words = joined(words[: words.index(">")] if ">" in words else words)
            try:
                if words:
                    parser(words).parse_args(words)
            except (SystemExit, CalibrationError) as error:
                wrong.append(f"{page.relative_to(ROOT)}: {part}: {error}")
            count += bool(words)
    assert count > 50
    assert not wrong, "\n".join(wrong)
