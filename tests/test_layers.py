"""Who imports whom: the floors of ARCHITECTURE.md, held against every import, and nothing beside them.

A room is a folder of ``session`` or ``tinygc``.  Its floor follows from the imports: one above the highest room that it imports.  A feature
imports the core; nothing imports a feature.  Imports count wherever they stand, in a function, too.
"""

import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("session", "tinygc")
PAGE = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")


def module_of(path):
    """``tinygc/closure/build.py`` → ``tinygc.closure.build``; a package's own file has the package's name."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_of(path): path.read_text(encoding="utf-8") for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
IMPORT = re.compile(r"^ *(?:from ([.\w]+) )?import (\([^)]*\)|[^#\n]*)", re.M)


def imports_of(text, known):
    """Modules among the known that a file names: of ``from a import b``, ``a.b`` if that is a module, else ``a``."""
    found = set()
    for source, names in IMPORT.findall(text):
        assert not source.startswith("."), "imports state the whole name"
        for name in re.findall(r"([\w.]+)(?: as \w+)?", re.sub(r"#.*", "", names)):
            found.add(name if not source else whole if (whole := f"{source}.{name}") in known else source)
    return found & known


@cache
def graph():
    """Every module of both packages and what it imports of them."""
    return {module: imports_of(text, set(FILES)) - {module} for module, text in FILES.items()}


def room_of(module):
    """``tinygc.closure``; of an feature ``tinygc.features.fleet``."""
    parts = module.split(".")
    return ".".join(parts[: 3 if parts[1:2] == ["features"] else 2])


@cache
def rooms():
    """Every room of the core and the other rooms that it imports, features among them."""
    found: dict[str, set[str]] = {room_of(module): set() for module in FILES if module.count(".") and "features" not in room_of(module)}
    for module, others in graph().items():
        if room_of(module) in found:
            found[room_of(module)] |= {room_of(other) for other in others if other.count(".")} - {room_of(module)}
    return found


def floors():
    """The floor of each room: the ground floor, 1, imports no room."""
    found: dict[str, int] = {}
    for room in TopologicalSorter(rooms()).static_order():
        found[room] = 1 + max((found[other] for other in rooms().get(room, ())), default=0)
    return found


def circle(edges):
    """One circle of the graph, or nothing."""
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_the_page_lists_every_room_on_its_floor_from_the_top_down():
    listed = [(room, int(floor)) for floor, room in re.findall(r"^\| (\d+) \| `([\w.]+)` \|", PAGE, re.M)]
    assert dict(listed) == floors()
    assert [floor for _, floor in listed] == sorted((floor for _, floor in listed), reverse=True)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_lies_beside_the_rooms(package):
    assert set(path.name for path in (ROOT / package).glob("*.py")) == {"__init__.py"}
    for path in (ROOT / package).rglob("*"):
        assert not path.is_dir() or not any(path.glob("*.py")) or (path / "__init__.py").exists(), f"{path} does not say what it is"


def test_the_core_imports_no_feature_and_no_two_rooms_import_each_other():
    assert {(room, other) for room, others in rooms().items() for other in others if "features" in other} == set()
    assert circle(rooms()) == []


def test_a_feature_imports_the_core_and_no_other_feature():
    edges = {(room_of(module), room_of(other)) for module, others in graph().items() for other in others}
    assert {(room, other) for room, other in edges if "features." in room and "features." in other and room != other} == set()


def test_no_two_modules_import_each_other():
    assert circle(graph()) == []


def test_no_string_of_the_core_names_a_module_of_a_feature():
    """Names in strings would be imports by another road."""
    named = {module for module, text in FILES.items() if re.search(r"""(["'])tinygc\.features\.[\w.]+\1""", text)}
    assert {module for module in named if "features." not in module} == set()


def test_no_test_of_the_core_needs_a_feature_to_be_collected():
    """What it wants of one is asked for where it is used, through ``feature`` of tests/feature.py or ``pytest.importorskip``."""
    texts = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "tests").glob("*.py")}
    assert [name for name, text in texts.items() if re.search(r"^(from|import) tinygc\.features\b", text, re.M)] == []


def test_the_bench_side_names_neither_the_estimators_nor_torch():
    for module, text in FILES.items():
        assert module.split(".")[0] != "session" or not re.search(r"^ *(from|import) (torch|tinygc)\b", text, re.M), module


def test_nothing_but_import_knows_how_another_programs_log_is_read():
    """The command and its function, and what a feature makes of such a log."""
    theirs = {room_of(module) for module, others in graph().items() if any(room_of(other) == "session.replay" for other in others)}
    assert theirs - {"session.replay"} <= {"tinygc.cli", "tinygc.library", "tinygc.features.arrays", "tinygc.features.turns"}
