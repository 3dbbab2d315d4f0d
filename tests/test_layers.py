"""Who imports whom: the plan of the house, as each folder's ``__init__.py`` states it, and nothing beside it.

A folder of ``session`` or ``tinygc`` says what lives in it, and ends its docstring with a line ``May import: a, b, c.``: folders of the
same package, ``session`` as a whole for those of ``tinygc``, or ``nothing``.  Imports count wherever they stand, in a function too.
"""

import ast
import sys
from collections.abc import Iterable
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import processes
import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("session", "tinygc")
#: stands for the modules that lie right in a folder, beside its sub-folders
OWN = "*"
#: parts that a folder lists by name and that use its tools: one thing in two folders, for the length of the list
OWN_PARTS = {"tinygc.cli.commands", "tinygc.reporting.pictures.panels", "tinygc.reporting.html.sections"}
FOLDERS = sorted((package, path.parent.name) for package in PACKAGES for path in (ROOT / package).glob("*/__init__.py"))


def module_of(path: Path, root: Path = ROOT) -> str:
    """``tinygc/estimation/fit.py`` → ``tinygc.estimation.fit``; a package's own file has the package's name."""
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(text: str, known: frozenset[str]) -> set[str]:
    """Modules among the known that a file names: of ``from a import b``, ``a.b`` if that is a module, else ``a``."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports say the whole name"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add(whole if whole in known else node.module)
    return found & known


@cache
def graph() -> dict[str, set[str]]:
    """Every module of both packages and what it imports of them."""
    files = {module_of(path): path for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    known = frozenset(files)
    return {module: imports_of(path.read_text(encoding="utf-8"), known) - {module} for module, path in files.items()}


def folder_of(module: str, seen_from: str) -> str:
    """A module's folder; ``session`` as a whole, seen from ``tinygc``; empty for a package's own file."""
    package, *rest = module.split(".")
    return package if package != seen_from else rest[0] if rest else ""


def stated(package: str, folder: str) -> list[str]:
    """What the folder says that it may import."""
    text = ast.get_docstring(ast.parse((ROOT / package / folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    lines = [line.strip() for line in text.splitlines()]
    begins = [number for number, line in enumerate(lines) if line.startswith("May import: ")]
    assert len(begins) == 1, f"{package}/{folder}/__init__.py: its docstring ends with one line 'May import: …'"
    said = " ".join(lines[begins[0] :]).removeprefix("May import: ")
    assert said.endswith("."), said
    return [] if said == "nothing." else said.removesuffix(".").split(", ")


def circle(edges: dict[str, set[str]]) -> list[str]:
    """One circle of the graph, or nothing."""
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        return error.args[1]
    return []


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_lies_beside_the_folders(package):
    loose = sorted(path.name for path in (ROOT / package).glob("*.py"))
    assert loose == ["__init__.py"]
    for path in (ROOT / package).iterdir():
        assert not path.is_dir() or path.name == "__pycache__" or (path / "__init__.py").exists(), f"{path.name} does not say what it is"


@pytest.mark.parametrize(("package", "folder"), FOLDERS)
def test_a_folder_imports_what_it_says_and_says_what_it_imports(package, folder):
    mine = [module for module in graph() if module.startswith(f"{package}.{folder}.") or module == f"{package}.{folder}"]
    named = {folder_of(other, package): (module, other) for module in mine for other in graph()[module]}
    for other in ("", folder):
        named.pop(other, None)
    may = stated(package, folder)
    assert not {other: named[other] for other in set(named) - set(may)}, f"{package}/{folder} imports what it does not name"
    known = {name for each, name in FOLDERS if each == package} | set(PACKAGES)
    assert set(may) <= known, f"{package}/{folder} names what there is not"
    assert len(set(may)) == len(may)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_folder_stands_above_one_that_stands_above_it(package):
    """By what they say: so no import runs up, and a drawing of the layers has an order."""
    assert circle({folder: set(stated(package, folder)) - {"session"} for each, folder in FOLDERS if each == package}) == []


def sub_folders(folder: str, modules: Iterable[str]) -> set[str]:
    """Names of the packages with modules right below a package."""
    below = [module.removeprefix(f"{folder}.").split(".") for module in modules if module.startswith(f"{folder}.")]
    return {parts[0] for parts in below if len(parts) > 1}


def units(folder: str, imports: dict[str, set[str]]) -> dict[str, set[str]]:
    """Of one folder: each sub-folder as a whole, and ``OWN``, the modules that lie right in it; what each imports of the others."""
    subs = sub_folders(folder, imports)

    def unit(module: str) -> str:
        name = module.removeprefix(f"{folder}.").split(".")[0]
        return name if name in subs else OWN

    inside = {module for module in imports if module == folder or module.startswith(f"{folder}.")}
    edges: dict[str, set[str]] = {name: set() for name in (*subs, OWN)}
    for module in inside:
        edges[unit(module)] |= {unit(other) for other in imports[module] & inside}
    return {name: others - {name} for name, others in edges.items()}


def without_own_parts(folder: str, edges: dict[str, set[str]]) -> dict[str, set[str]]:
    """The graph of ``units`` less what an ``OWN_PARTS`` sub-folder takes from the modules that list it."""
    return {name: others - {OWN} if f"{folder}.{name}" in OWN_PARTS else others for name, others in edges.items()}


PARENTS = sorted(
    module_of(path) for package in PACKAGES for path in (ROOT / package).glob("*/**/__init__.py") if any(path.parent.glob("*/__init__.py"))
)


@pytest.mark.parametrize("folder", PARENTS)
def test_no_sub_folder_stands_above_a_sibling_that_stands_above_it(folder):
    """Neither another sub-folder nor the modules right beside it: two levels down there is an order, too."""
    assert circle(without_own_parts(folder, units(folder, graph()))) == []


@pytest.mark.parametrize("whole", sorted(OWN_PARTS))
def test_a_folder_is_let_off_only_where_it_needs_to_be(whole):
    folder, _, name = whole.rpartition(".")
    edges = units(folder, graph())
    assert name in edges[OWN]
    assert OWN in edges[name]


def test_no_two_modules_import_each_other():
    assert circle(graph()) == []


#: modules that are found by a name in a string, not by an import, and run up: the proof of effects is part of their layer's face
BY_NAME_ABOVE = {"tinygc.effects.testing": {"tinygc.annexes.challenge.proofs"}}


def test_no_string_names_a_module_above():
    """What is imported by its name counts as an import."""
    order = list(TopologicalSorter({f: set(stated("tinygc", f)) - {"session"} for p, f in FOLDERS if p == "tinygc"}).static_order())
    known, above = set(graph()), {}
    for module in sorted(known):
        package, *rest = module.split(".")
        if package == "session" or not rest:
            continue
        path = ROOT / (module.replace(".", "/") + ".py")
        tree = ast.parse((path if path.exists() else path.with_suffix("") / "__init__.py").read_text(encoding="utf-8"))
        texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
        named = {text for text in texts & known if text.startswith("tinygc.") and order.index(text.split(".")[1]) > order.index(rest[0])}
        if named:
            above[module] = named
    assert above == BY_NAME_ABOVE


def test_the_bench_side_names_neither_the_estimators_nor_torch():
    """Not even inside a function."""
    for path in (ROOT / "session").rglob("*.py"):
        named = {
            name.split(".")[0]
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, (ast.Import, ast.ImportFrom))
            for name in ([alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""])
        }
        assert not named & {"torch", "tinygc"}, path


@pytest.mark.parametrize("folder", sorted(OWN_PARTS))
def test_a_part_of_a_list_does_not_ask_the_list_for_another(folder):
    """The list imports every part, so the part would wait for itself; what two parts share is named by its own file."""
    parts = [path for path in (ROOT / folder.replace(".", "/")).glob("*.py") if path.name != "__init__.py"]
    nodes = [(path.name, node) for path in parts for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
    assert len(parts) > 5
    assert [name for name, node in nodes if isinstance(node, ast.ImportFrom) and node.module == folder] == []


def test_recording_never_loads_the_estimators():
    modules = sorted(module for module in graph() if module.split(".")[0] == "session")
    code = f"import sys, {', '.join(modules)}; print(sorted({{'torch', 'tinygc'}} & set(sys.modules)))"
    assert processes.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


# The rules themselves


def test_an_import_is_seen_wherever_it_stands():
    known = frozenset({"tinygc", "tinygc.fitting", "tinygc.estimation.fit", "session.log"})
    text = "import tinygc.estimation.fit\ndef f():\n    from tinygc import fitting\n    from session.log import Session\nimport numpy\n"
    assert imports_of(text, known) == {"tinygc.estimation.fit", "tinygc.fitting", "session.log"}


def test_a_circle_is_seen():
    assert circle({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}})) == {"a", "b", "c"}


def test_a_circle_of_sub_folders_is_seen():
    """Also one that goes through the modules beside them, and one that no two modules close."""
    imports = {"p": set(), "p.a": set(), "p.b": set(), "p.a.x": {"p.b.x"}, "p.b.x": set(), "p.b.y": {"p.top"}, "p.top": set()}
    assert sub_folders("p", imports) == {"a", "b"}
    assert units("p", imports) == {"a": {"b"}, "b": {OWN}, OWN: set()}
    assert circle(units("p", imports)) == []
    assert set(circle(units("p", imports | {"p.b.y": {"p.a"}}))) == {"a", "b"}
    assert set(circle(units("p", imports | {"p.other": {"p.a.x"}}))) == {"a", "b", OWN}


def test_every_sub_folder_is_looked_at():
    packages = {module_of(path) for package in PACKAGES for path in (ROOT / package).glob("*/*/**/__init__.py")}
    with_code = {module_of(path.parent / "__init__.py") for package in PACKAGES for path in (ROOT / package).glob("*/*/**/*.py")}
    looked_at = {f"{parent}.{name}" for parent in PARENTS for name in sub_folders(parent, graph())}
    assert with_code <= packages, "a folder does not say what it is"
    assert with_code == looked_at
    assert len(looked_at) > 15


def test_every_folder_is_looked_at():
    assert {"common", "files", "sensor", "dialects", "log", "detect", "checks", "stream", "recording", "replay", "guide", "public"} <= {
        folder for package, folder in FOLDERS if package == "session"
    }
    assert len(graph()) > 200
    assert folder_of("session.io.folder", "tinygc") == "session"
    assert folder_of("tinygc", "tinygc") == ""
    assert folder_of("tinygc.estimation.fit", "tinygc") == "fitting"
