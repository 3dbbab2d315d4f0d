"""Who imports whom: the floors of ARCHITECTURE.md, held against every import, and nothing beside them.

A room is a folder of ``session`` or ``tinygc``.  The page lists the floors from the ground up, and on each floor its rooms from left to
right: a room imports rooms below it, or left of it on its own floor.  An annex imports the core and the annexes that the page names for
it; the core imports no annex.  Imports count wherever they stand, in a function, too.
"""

import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("session", "tinygc")
PAGE = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
#: where names of annexes' modules stand as strings
REGISTRIES = {"session.io.annexes"}


def module_of(path: Path) -> str:
    """``tinygc/closure/build.py`` → ``tinygc.closure.build``; a package's own file has the package's name."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_of(path): path.read_text(encoding="utf-8") for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
IMPORT = re.compile(r"^ *(?:from ([.\w]+) )?import (\([^)]*\)|[^#\n]*)", re.M)


def imports_of(text: str, known: set[str]) -> set[str]:
    """Modules among the known that a file names: of ``from a import b``, ``a.b`` if that is a module, else ``a``."""
    found = set()
    for source, names in IMPORT.findall(text):
        assert not source.startswith("."), "imports state the whole name"
        for name in re.findall(r"([\w.]+)(?: as \w+)?", re.sub(r"#.*", "", names)):
            found.add(name if not source else whole if (whole := f"{source}.{name}") in known else source)
    return found & known


@cache
def graph() -> dict[str, set[str]]:
    """Every module of both packages and what it imports of them."""
    return {module: imports_of(text, set(FILES)) - {module} for module, text in FILES.items()}


def room_of(module: str) -> str:
    """``tinygc.closure``; of an annex ``tinygc.annexes.lots``."""
    parts = module.split(".")
    return ".".join(parts[: 3 if parts[1:2] == ["annexes"] else 2])


def floors() -> list[list[str]]:
    """The rooms of the page's table, a list for each floor, from the ground up."""
    rows = re.findall(r"^\| (\d) \| (.+?) \|", PAGE, re.M)
    assert [int(number) for number, _ in rows] == sorted(range(1, len(rows) + 1), reverse=True)
    return [re.findall(r"`([\w.]+)`", rooms) for _, rooms in reversed(rows)]


def annexes() -> dict[str, set[str]]:
    """Each annex of the page, and the annexes that it may import."""
    rows = re.findall(r"^\| `((?:session|tinygc)\.annexes\.\w+)` \| .+? \| (.+?) \|$", PAGE, re.M)
    return {name: set(re.findall(r"`([\w.]+)`", others)) for name, others in rows}


def circle(edges: dict[str, set[str]]) -> list[str]:
    """One circle of the graph, or nothing."""
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_the_page_lists_every_room_and_every_annex_once():
    listed = [room for floor in floors() for room in floor]
    rooms = {room_of(module) for module in FILES if module.count(".")}
    assert sorted(listed) == sorted(room for room in rooms if "annexes" not in room)
    assert set(annexes()) == {room for room in rooms if room.count(".") == 2}
    assert len(floors()) <= 8
    assert len(listed) <= 17


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_lies_beside_the_rooms(package):
    assert set(path.name for path in (ROOT / package).glob("*.py")) == {"__init__.py"}
    for path in (ROOT / package).rglob("*"):
        assert not path.is_dir() or not any(path.glob("*.py")) or (path / "__init__.py").exists(), f"{path} does not say what it is"


def test_no_import_runs_up_and_none_runs_from_the_core_into_an_annex():
    order = {room: number for number, room in enumerate(room for floor in floors() for room in floor)}
    wrong = {
        (module, other)
        for module, others in graph().items()
        for other in others
        if room_of(module) in order and other not in PACKAGES and order.get(room_of(other), 99) > order[room_of(module)]
    }
    assert wrong == set()


def test_an_annex_imports_the_core_and_the_annexes_that_the_page_names():
    may = annexes()
    wrong = {
        (module, other)
        for module, others in graph().items()
        for other in others
        if room_of(module) in may and "annexes." in other and room_of(other) not in may[room_of(module)] | {room_of(module)}
    }
    assert wrong == set()
    assert circle(may) == []


def test_no_two_modules_import_each_other():
    assert circle(graph()) == []


def test_only_the_registry_names_modules_of_annexes():
    """Names in strings would be imports by another road."""
    named = {module for module, text in FILES.items() if re.search(r"""(["'])(?:session|tinygc)\.annexes\.[\w.]+\1""", text)}
    assert {module for module in named if "annexes." not in module} <= REGISTRIES


def test_the_bench_side_names_neither_the_estimators_nor_torch():
    for module, text in FILES.items():
        assert module.split(".")[0] != "session" or not re.search(r"^ *(from|import) (torch|tinygc)\b", text, re.M), module


#: known to every test: what users import, and the ground that all rooms stand on
COMMON = {"session", "tinygc", "tinygc.effects", "tinygc.models.linear"} | {
    f"session.io.{name}" for name in ("units", "errors", "config", "samples", "folder")
}
FACE = 8
#: rooms of which the tests still know more: these numbers only fall
WIDER = {
    "session.io": 59,
    "tinygc.estimation": 51,
    "tinygc.noise": 43,
    "tinygc.closure": 40,
    "session.detect": 39,
    "session.bench": 32,
    "session.annexes.machines": 26,
    "tinygc.reporting": 20,
    "tinygc.simulation": 12,
    "tinygc.annexes.lots": 15,
    "tinygc.explanation": 15,
    "tinygc.cli": 14,
    "tinygc.deploy": 13,
    "tinygc.effects": 10,
    "tinygc.models": 10,
    "tinygc.annexes.machines": 10,
}


def names_from(text: str) -> dict[str, set[tuple[str, str]]]:
    """Names that a test imports, by the room that they are of; a name is (module, name)."""
    found: dict[str, set[tuple[str, str]]] = {}
    for source, names in IMPORT.findall(text):
        if source.split(".")[0] in PACKAGES and source not in COMMON:
            each = {(source, name) for name in re.findall(r"(\w+)(?: as \w+)?", re.sub(r"#.*", "", names))}
            found[room_of(source)] = found.get(room_of(source), set()) | each
    return found


def test_tests_know_a_room_by_its_face_and_its_exact_tests_one_room_inside():
    """tests/README.md; the room of a file of exact tests is the one of which it knows most."""
    known: dict[str, set[tuple[str, str]]] = {}
    for path in (ROOT / "tests").rglob("*.py"):
        names = names_from(path.read_text(encoding="utf-8"))
        if path.stem.endswith("_physics") and names:
            del names[max(names, key=lambda room: len(names[room]))]
        for room, each in names.items():
            known[room] = known.get(room, set()) | each
    assert {room: len(each) for room, each in known.items() if len(each) > WIDER.get(room, FACE)} == {}
