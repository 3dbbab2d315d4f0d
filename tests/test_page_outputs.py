"""What a page shows of a command is what the command prints: docs/make_outputs.py runs them all, and the benchmarks of measured tables."""

import ast
import contextlib
import importlib.util
import re
import shlex
import shutil
from functools import cache

import pytest
from conftest import ROOT

_spec = importlib.util.spec_from_file_location("make_outputs", ROOT / "docs" / "make_outputs.py")
make_outputs = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(make_outputs)


def _marks(path):
    text = path.read_text(encoding="utf-8")
    return [pytest.mark.slow] if make_outputs.NIGHTLY in text else [pytest.mark.broad] if make_outputs.SLOW in text else []


PAGES = [pytest.param(path, id=path.relative_to(ROOT).as_posix(), marks=_marks(path)) for path in make_outputs.pages()]


@pytest.mark.parametrize("page", PAGES)
def test_the_page_shows_what_is_printed(page):
    text = page.read_text(encoding="utf-8")
    assert make_outputs.made(text).splitlines() == text.splitlines(), f"python docs/make_outputs.py {page.relative_to(ROOT)}"


MEASURED = [
    pytest.param(path, found, id=f"{path.stem}: {found[1]}")
    for path in sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
    for found in make_outputs.MEASURED.finditer(path.read_text(encoding="utf-8"))
]
#: benchmarks of seconds
QUICK = ("firmware.py", "imu_tk_method.py", "rate_steps.py real")


@cache
def constants(path):
    """Texts, and lists of texts, that a Python file holds; names of the module stand for their values."""
    tree, known, texts, lists = ast.parse(path.read_text(encoding="utf-8")), {}, set(), set()

    def value(node):
        with contextlib.suppress(NameError, TypeError, AttributeError, KeyError):
            return eval(compile(ast.Expression(node), path, "eval"), {"__builtins__": {}}, known)
        return ()

    for statement in tree.body:
        if isinstance(statement, ast.Assign):
            with contextlib.suppress(NameError, TypeError, AttributeError, KeyError):
                exec(compile(ast.Module([statement], []), path, "exec"), {"__builtins__": {}}, known)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant):
            texts.add(node.value)
        elif isinstance(node, ast.List | ast.Tuple) and isinstance(node.ctx, ast.Load):
            lists.add(tuple(map(str, value(node))))
    return texts, lists


@cache
def names_of(path):
    """What a module defines or imports at its margin."""
    tree, names = ast.parse(path.read_text(encoding="utf-8")), set()
    for node in [each for part in tree.body for each in ([part] if not isinstance(part, ast.If) else part.body)]:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.ImportFrom | ast.Import):
            names |= {each.asname or each.name for each in node.names}
        else:
            names |= {each.id for each in ast.walk(node) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)}
    return names


def test_what_benchmarks_import_of_the_product_is_there():
    """They are run too seldom for a name that moved to show."""
    gone = []
    for path in (ROOT / "benchmarks").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in ("session", "tinygc"):
                folder = ROOT / node.module.replace(".", "/")
                module = folder.with_suffix(".py") if folder.with_suffix(".py").exists() else folder / "__init__.py"
                known = names_of(module) | {each.stem for each in folder.glob("*")}
                gone += [f"{path.name}: {node.module}.{each.name}" for each in node.names if each.name not in known]
    assert gone == []


def test_the_tables_of_the_measured_page_all_stand_below_their_command():
    text = make_outputs.MEASURED.sub("", (ROOT / "docs" / "measured.md").read_text(encoding="utf-8"))
    assert re.findall(r"^\|.*", text, re.M) == []
    assert len(MEASURED) > 10


def test_a_benchmark_that_a_page_names_exists_with_its_options_and_has_a_date():
    pages = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))
    named = re.findall(r"`python (benchmarks/[^`]*)`(.{0,20})", pages)
    assert len(named) > 30
    for command, behind in named:
        script, *words = shlex.split(command)
        options = {word for word in words if re.fullmatch(r"--[\w-]+|[a-z]+", word)}
        assert options <= constants(ROOT / script)[0], command
        assert re.match(r" \(\d+ \w+ \d{4}\)", behind), command


@pytest.mark.parametrize(("page", "found"), MEASURED)
def test_a_measured_table_has_the_head_that_its_benchmark_prints(page, found):
    script = found[1].split()[0]
    lists = set().union(*(constants(path)[1] for path in [ROOT / script, *(ROOT / "benchmarks" / "paper").glob("*.py")]))
    for table in make_outputs.TABLE.finditer(found[4]):
        assert tuple(cell.strip() for cell in table[1].strip().strip("|").split("|")) in lists
        assert {line.count("|") for line in table[0].splitlines()} == {table[1].count("|")}


@pytest.mark.broad
@pytest.mark.parametrize(("page", "found"), [each for each in MEASURED if any(part in each.values[1][1] for part in QUICK)])
def test_a_quick_benchmark_prints_what_the_page_shows(page, found):
    command = found[1]
    if "firmware" in command and shutil.which("qemu-system-arm") is None:
        pytest.skip("no QEMU")
    if "firmware" not in command and not (ROOT.parent / "shared").exists():
        pytest.skip("no ../shared")
    assert make_outputs.MEASURED.search(make_outputs.measured(found[0]))[4] == found[4]


def test_lines_are_run_chosen_and_refused():
    """A hidden command, chosen lines, a refusal, and a block that stays."""
    seen = "<!-- run: seq 5 > five -->\n<!-- lines 1-2, 4-4 -->\n\n```\n$ cat five\nold\n```\n\n"
    refused = "```\n$ python calibrate.py apply none none.csv -o out.csv\n```\n"
    made = make_outputs.made(f"{seen}{refused}<!-- not run: no board -->\n```\n$ false\nkept\n```\n")
    assert "$ cat five\n1\n2\n…\n4\n…\n```" in made
    assert "-o out.csv\ncalibrate: none" in made
    assert made.endswith("$ false\nkept\n```\n")
