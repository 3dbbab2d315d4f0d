"""What the README and its pages point to is there, one list leads to every page, and what they tell a reader to run does run."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import processes
import pytest
import yaml

import calibrate
import tinygc
from tinygc.cli.commands import COMMANDS
from tinygc.deploy import FORMATS
from tinygc.effects import catalogue

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
FOLDERS = (ROOT, DOCS, DOCS / "formats", DOCS / "measured", ROOT / "benchmarks", ROOT / "data")
PAGES = sorted(path for folder in FOLDERS for path in folder.glob("*.md"))
LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]+))?\)")
INDEX = DOCS / "index.md"
README_LINES = 90
#: the two commands that a reader runs first; each installs what it needs
SET_UP = """```
python -m pip install -e . -c constraints.txt && python calibrate.py fit data/session1
python -m pip install -e '.[test]' -c constraints.txt && python -m pytest
```
"""
#: endings of what is written in a programming language
CODE = (".py", ".c", ".h", ".ino")
each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())


def without_code(text: str) -> str:
    return re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)


def anchors(text: str) -> set[str]:
    """Of the headings, as Git hosts make them."""
    heads = re.findall(r"^#+ (.+)$", without_code(text), flags=re.M)
    heads = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head) for head in heads]
    return {re.sub(r"[^\w\- ]", "", head.strip().lower()).replace(" ", "-") for head in heads}


def linked_pages(text: str, folder: Path) -> list[Path]:
    """Pages that a text links to, in order, each once."""
    targets = [(folder / target).resolve() for target, _ in LINK.findall(without_code(text)) if target.endswith(".md")]
    return list(dict.fromkeys(targets))


def blocks(path: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", path.read_text(encoding="utf-8"), re.S)


@each_page
def test_every_link_inside_the_project_leads_somewhere(page):
    text = without_code(page.read_text(encoding="utf-8"))
    for target, anchor in LINK.findall(text):
        path = (page.parent / target).resolve() if target else page
        assert path.exists(), f"{page.name}: {target}"
        assert path.is_relative_to(ROOT), f"{page.name}: {target} is outside the project"
        if anchor:
            assert anchor in anchors(path.read_text(encoding="utf-8")), f"{page.name}: {target}#{anchor}"


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
    """docs/index.md lists the pages of docs, formats.md those of docs/formats, and measured.md those of docs/measured."""
    listed = linked_pages(INDEX.read_text(encoding="utf-8"), DOCS)
    assert {path for path in listed if path.parent == DOCS} == {path for path in DOCS.glob("*.md") if path != INDEX}
    assert all(line.count("](") == 1 for line in INDEX.read_text(encoding="utf-8").splitlines() if line.startswith("- "))
    for name in ("formats", "measured"):
        rows = re.findall(r"^\| \[.*", (DOCS / f"{name}.md").read_text(encoding="utf-8"), re.M)
        assert set(linked_pages("\n".join(rows), DOCS)) == set((DOCS / name).glob("*.md"))
    assert INDEX in linked_pages((ROOT / "README.md").read_text(encoding="utf-8"), ROOT)


def test_every_command_is_on_its_page():
    text = (DOCS / "commands.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^calibrate\.py (\w+)", text, re.M)) == sorted(COMMANDS)


def test_every_effect_is_on_the_page_of_explain_and_counted_in_the_readme():
    section = (DOCS / "explain.md").read_text(encoding="utf-8").split("## The catalogue", 1)[1].split("\n## ", 1)[0]
    first = "\n".join(row.split("|")[1] for row in section.splitlines() if row.startswith("| `"))
    assert set(re.findall(r"`([a-z]+\.[a-z0-9_]+)`", first)) == set(catalogue())
    assert f"knows {len(catalogue())} effects" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_every_export_is_on_its_page():
    page = (DOCS / "exports.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `(\w+)` \|", page, flags=re.M)) == set(FORMATS)


@each_page
def test_options_that_a_page_names_exist(page, capsys):
    """Every ``--option`` after ``calibrate.py COMMAND`` (in a line, `COMMAND --option`) is one of that command."""
    found = re.findall(r"(?:calibrate(?:\.py)? |`)(\w+)((?: [^\n`|;#]*)?)", page.read_text(encoding="utf-8"))
    for command, words in ((command, words) for command, words in found if command in COMMANDS):
        options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", words.split("calibrate")[0]))
        if options:
            with pytest.raises(SystemExit):
                calibrate.main([command, "--help"])
            known = set(re.findall(r"--[a-z][a-z0-9-]+", re.sub(r"-\n\s+", "-", capsys.readouterr().out)))
            assert options <= known, f"{page.name}: calibrate.py {command}{words}"


@pytest.fixture
def in_a_fitted_checkout(tmp_path, monkeypatch):
    """A working folder with data/session1/fit, as after the first command."""
    session = ROOT / "data" / "session1"
    assert calibrate.main(["fit", str(session), "--methods", "least_squares", "--quiet", "--out", str(tmp_path / "data/session1/fit")]) == 0
    monkeypatch.chdir(tmp_path)
    return tmp_path / "data/session1/fit/model_least_squares.json"


@pytest.mark.broad
def test_the_python_and_the_c_that_apply_a_model_agree(in_a_fitted_checkout, tmp_path):
    """The examples of README and docs/apply.md, as they stand there."""
    registers = np.random.default_rng(0).integers(-20000, 20000, (200, 3))
    weights = json.loads(in_a_fitted_checkout.read_text(encoding="utf-8"))["weights"]
    expected = registers * 17.5e-3 * np.pi / 180 @ np.array(weights["E"]).T + np.array(weights["B"])
    for path in (ROOT / "README.md", DOCS / "apply.md"):
        (python,) = (block for block in blocks(path, "python") if "tinygc.load" in block)
        known = {"registers": registers}
        exec(python, known)
        np.testing.assert_allclose(known["omega"], expected, rtol=0, atol=1e-12)
        (code,) = blocks(path, "c")
        if shutil.which("gcc") is None:
            continue
        E, B = (str(weights[name]).replace("[", "{").replace("]", "}") for name in "EB")
        rows = str(registers.tolist()).replace("[", "{").replace("]", "}")
        program = (
            "#include <stdio.h>\nint main(void)\n{\n"
            f"const double E[3][3] = {E}, B[3] = {B};\nconst int rows[200][3] = {rows};\ndouble omega[3];\n"
            f"for (int row = 0; row < 200; row++) {{\nconst int *g = rows[row];\n{code}\n"
            'printf("%.9g %.9g %.9g\\n", omega[0], omega[1], omega[2]);\n}\n}\n'
        )
        (tmp_path / "apply.c").write_text(program)
        processes.run(["gcc", "-std=c99", "-Wall", "-Werror", "-o", tmp_path / "apply", tmp_path / "apply.c"], check=True)
        answered = np.loadtxt(processes.run([tmp_path / "apply"], capture_output=True, text=True, check=True).stdout.split("\n"))
        np.testing.assert_allclose(answered, expected, rtol=0, atol=2e-6)


@pytest.mark.broad
def test_what_the_pages_show_of_fit_is_what_fit_prints(monkeypatch, capsys, tmp_path):
    """The lines in the README and the whole screen in the tutorial, to the digit."""
    monkeypatch.chdir(ROOT)
    assert calibrate.main(["fit", "data/session1", "--out", str(tmp_path)]) == 0
    printed = [line.rstrip() for line in capsys.readouterr().out.replace(str(tmp_path), "data/session1/fit").splitlines()]
    (shown,) = (block for block in blocks(ROOT / "README.md", "") if "PASS" in block)
    assert set(shown.splitlines()) <= set(printed)
    (screen,) = (block for block in blocks(DOCS / "tutorial.md", "") if "PASS" in block)
    assert screen.splitlines() == printed


def test_the_citation_names_the_version_and_the_paper():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["title"] == "TinyGC"
    assert citation["version"] == tinygc.__version__
    (paper,) = (reference for reference in citation["references"] if "TinyGC-Net" in reference["title"])
    assert paper["url"] in (DOCS / "references.md").read_text(encoding="utf-8")
