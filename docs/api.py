"""Check the API reference: python docs/api.py; write its pages: python docs/api.py FOLDER.

pdoc reads each module of ``tinygc`` and ``session``, and makes a page of its docstrings and type hints.  Every warning is an error: what
pdoc says, a public name without a docstring, a reference to what is not there.  Exit code 1, and one line each.
"""

from __future__ import annotations

import functools
import pkgutil
import re
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pdoc.doc import Doc, Module

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("tinygc", "session", "calibrate")
#: what stands between double backticks and names code: dotted, or a path
REFERENCE = re.compile(r"``([A-Za-z_]\w*(?:[./]\w+)+)``")


def main(arguments: list[str]) -> int:
    """Check, write the pages where a folder is given, and say what is wrong."""
    folder = Path(arguments[0]) if arguments else None
    problems = check(folder)
    for problem in problems:
        print(problem, file=sys.stderr)
    if problems:
        print(f"api: {len(problems)} problems", file=sys.stderr)
        return 1
    print(f"api: {folder / 'index.html'}" if folder else "api: nothing is wrong")
    return 0


def check(folder: Path | None) -> list[str]:
    """A line for each thing that is wrong; folder: where the pages are written."""
    import pdoc
    import pdoc.render

    sys.path.insert(0, str(ROOT))
    pdoc.render.configure(docformat="markdown", show_source=False)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if folder:
            pdoc.pdoc(*PACKAGES, output_directory=folder)
        modules = list(_modules())
        names = [name for module in modules for name in _names(module)]
        for name in names:
            getattr(name, "signature", None), getattr(name, "annotation", None)  # read where they are asked for, and warned of
    found = [f"{Path(each.filename).name}: {str(each.message).strip()}" for each in said]
    exempt, every = not_documented_yet(), {f"{name.modulename}.{name.qualname}".rstrip(".") for name in names}
    known = functools.partial(is_known, every)
    for module in modules:
        path = module.source_file.relative_to(ROOT).as_posix() if module.source_file else ""
        if not any(fnmatch(path, pattern) for pattern in exempt):
            found += problems_of(module, known)
    return found


def not_documented_yet() -> list[str]:
    """Patterns of files that ruff lets off its D rules in pyproject.toml: the one list of them."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return [pattern for pattern, rules in settings["tool"]["ruff"]["lint"]["per-file-ignores"].items() if "D" in rules]


def problems_of(module: Module, known: Callable[[str], bool]) -> list[str]:
    """Public names without a docstring, and references that lead nowhere."""
    found = []
    for name in _names(module):
        # A field's meaning stands in its class's docstring; one whose default is a function is a field as well.
        field = name.kind == "variable" or name.name in getattr(
            getattr(module.obj, name.qualname.split(".")[0], None), "__annotations__", ()
        )
        if not field and not name.docstring:
            found.append(f"{name.fullname}: no docstring")
        found += [f"{name.fullname}: ``{word}`` is not there" for word in REFERENCE.findall(name.docstring) if not known(word)]
    return found


def is_known(every: set[str], word: str) -> bool:
    """Whether a reference leads somewhere; ``every``: dotted names of all that is public.

    Judged are paths into the packages, Python files, full names, and names whose last part or first part is a class.  What else is
    dotted is a key of a file or a variable's field: ``goodness.excess``.
    """
    if "/" in word:
        return word.split("/")[0] not in PACKAGES or (ROOT / word).exists()
    if word.endswith(".py"):
        return any(ROOT.rglob(word))
    first, *_, last = parts = word.split(".")
    if first in PACKAGES and last != "toml":
        return word in every or _leads_somewhere(word)
    if first[0].isupper() or (last[:1].isupper() and not last.isupper()):
        return any(name.endswith("." + ".".join(parts)) for name in every)
    return True


def _leads_somewhere(word: str) -> bool:
    """Whether a dotted name is a module, or a name that a package gives when it is asked for (``tinygc.fit``)."""
    try:
        pkgutil.resolve_name(word)
    except (ImportError, AttributeError):
        return False
    return True


def _modules() -> Iterator[Module]:
    import pdoc.extract
    from pdoc.doc import Module

    for name in pdoc.extract.walk_specs(PACKAGES):
        yield Module(pdoc.extract.load_module(name))


def _names(module: Module) -> Iterator[Doc[Any]]:
    """The module, its public names, and those of its classes; what it only imports is another module's."""
    yield module
    for member in module.own_members:
        if member.name.startswith("_") or member.modulename != module.modulename or member.kind == "module":
            continue
        yield member
        for inner in getattr(member, "own_members", ()):
            if not inner.name.startswith("_"):
                yield inner


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
