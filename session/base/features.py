"""Features: folders that add to the core, and that the core knows by what they serve alone.

A feature is a folder with a ``feature.py``, which declares one ``FEATURE``.  The features of the tool are found by their folders; those of
other people by the entry points of the group ``tinygc.features`` (``mine = "my_package.feature:FEATURE"``).  Remove a folder, and nothing
in the core has to change: what it served is unknown then, as any command, option or kind of model that never was.

The core asks at a *point*, whose name is what the core needs there; ``POINTS`` lists them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

from session.base.errors import CalibrationError

Record = TypeVar("Record")

#: where the core asks -> what it asks for: the arguments of a function and its answer, or what a module has
POINTS = {
    "options of COMMAND": "record of options: further ones of a command of the core",
    "kind of folder": "function(folder) -> what it is and what takes it, one sentence; None of a session, and of what cannot be read",
    "line of a list": "function(folder) -> fields of ListedSession (tinygc/fitting/listing.py) of such a folder, or None",
    "reference": "class: what a session is compared with, other than gravity and dials; ``REFERENCE`` states what it has",
    "section of session.toml": "frozen dataclass of records.py: what a section holds, whose name is its class variable section",
    "fit of a folder": "function(args) -> Done | None: fits a folder that is no session of one sensor",
    "explanation of a folder": "function(args) -> exit code | None: explains such a folder",
    "check of a recording": "function(session or folder, clock, further) -> list of Finding | None: checks what is no session",
    "use of a model": "function(model, log, out, unit, session, further, progress) -> applied | None: ``apply`` of its model",
    "import of logs": "function(paths, out, answers, columns, serial, add, further) -> Imported | None: makes another folder of logs",
    "simulation": "function(args, options, chosen) -> exit code | None: simulates something else than a session",
    "options of a fit": "record of options: further fields of FitOptions, and options of the commands that fit",
    "fitted sessions of a table": "function(path) -> records of folder, model, serial, recorded, values, covariance; None of no such table",
    "zero over temperature": "module: knots_of(rest logs), part_of(knots, means) -> part and its columns, None without any",
    "spread of a production lot": "function(file, sensor) -> sigmas of a unit between sessions, in words of what, degrees of freedom",
    "prior of a fit": "function(options, sensor) -> prior | None, a GivenPrior of tinygc/fitting/fit.py",
    "table under a virtual board": "function(args, options) -> table | None: what turns a virtual board",
    "search beyond the catalogue": "function(explanation, further, seed, progress) -> what was found, or None",
    "report beyond the catalogue": "function(explanation, what was found) -> Why",
    "explanation of what turned": "function(explanation, seed) -> what a machine that turned it shows | None: rows, to_json(), panels",
    "proof of an effect": "function(effect, ...) -> report",
    "after a report": "function(args of report) -> function(report) -> keys of its JSON, or None: what is written next to it",
    "earlier results of a report": "function(folder, logs) -> what an earlier command left in the folder for the report, or None",
    "report section": "module: section(evidence) -> Section | None, as in tinygc/reporting/html/sections; BEHIND, the section before it",
}
#: what a further reference has -> what that is.  The session holds what it read next to the logs as ``Session.reference``, and calls it
REFERENCE = {
    "word": "of protocol.reference in session.toml; the argument of its arrays",
    "accelerometer": "whether its logs have specific force; without, it has a folder of another kind, and nothing that follows",
    "title": "what it is, in words",
    "body": "whose axes its attitudes are of, in words",
    "sigma_deg": "one sigma of each of its angles",
    "paths": "(paths of the logs) -> paths of its files; FormatError where one is missing",
    "read": "(its paths, config) -> the reference",
    "of_arrays": "(name of the session, its arrays, number of logs, config) -> the reference",
    "arrays": "path of each file, and its arrays, each with the type that it is hashed as",
    "save": "(folder, config): its files",
    "examined": "(session) -> the session with the reference as the recording shows it, findings",
    "reported": "names of those findings that ``fit`` repeats even as a note",
    "check": "(session, log) -> findings on the log by the reference",
    "problem": "(session, its stills, further arguments of ``build_problem``) -> the problem of a fit",
    "attitudes": "(number of a log, its samples) -> rows (K,) at which its attitude is known, q_nb (K, 4)",
    "rests": "(samples of a log) -> samples, a slice, and mean rate (3,) of each of its rests",
    "twin": "(problem) -> Twin of it: its rows, and its own errors, which compete with the sensor's",
    "components": "(twin, sizes of its channels) -> variance components of the reference's errors",
    "repaired": "(problem) -> RepairedProblem: without what of the reference is wrong",
    "shown": "(repaired, twin, first, fit, noise) -> what else it shows: all_claims(claims), rows of words, brief lines, to_json(), panels",
    "table": "``truth`` of fit.json",
    "words": "the same in a line for the terminal, or nothing",
}
GROUP = "tinygc.features"


@dataclass(frozen=True)
class Feature:
    """What a feature adds.  A value names a module of its folder, or ``module:attribute``; it is imported when it is used.

    commands: name -> module with ``Options`` (a record) and ``run(options)``, its summary, and its group in ``--help``; public: name in
    ``tinygc`` -> module that has it; kinds: kind of model -> module with ``to_table`` and ``from_table``; exports: kind of model ->
    module with ``stage`` and ``CARRIED`` (tinygc/deploy/__init__.py); serves: point -> what serves it there.
    """

    commands: Mapping[str, tuple[str, str, str]] = field(default_factory=dict)
    public: Mapping[str, str] = field(default_factory=dict)
    kinds: Mapping[str, str] = field(default_factory=dict)
    exports: Mapping[str, str] = field(default_factory=dict)
    serves: Mapping[str, str | tuple[str, ...]] = field(default_factory=dict)


#: folders that hold features, and the packages that these are
_PLACES: dict[str, str] = {}


def look_in(folder: str, package: str) -> None:
    """Find features in the folders of this one."""
    _PLACES[folder] = package
    known.cache_clear()


@cache
def known() -> dict[str, Feature]:
    """Return package -> feature: of the folders first, then of other people's packages."""
    names = [f"{package}.{path.parent.name}" for folder, package in _PLACES.items() for path in sorted(Path(folder).glob("*/feature.py"))]
    found = {name: import_module(f"{name}.feature").FEATURE for name in names}
    if any(map(_has_features, sys.path)):
        from importlib.metadata import entry_points

        for entry in entry_points(group=GROUP):
            package, _, module = entry.module.rpartition(".")
            found[package] = _load(package, f"{module}:{entry.attr}")
            if not isinstance(found[package], Feature):
                raise CalibrationError(f"installed feature {entry.value}: is no Feature; correct or uninstall its package")
    return found


def _has_features(folder: str) -> bool:
    """Whether a package that is installed in a folder names the group: ``importlib.metadata`` loads 30 modules to find none."""
    return any(GROUP.encode() in path.read_bytes() for path in Path(folder).glob("*-info/entry_points.txt"))


def _load(package: str, value: str) -> Any:
    """What a package has at ``module`` or ``module:attribute``; CalibrationError where that of somebody else cannot be loaded."""
    module, _, attribute = value.partition(":")
    try:
        found = import_module(f"{package}.{module}")
        return getattr(found, attribute) if attribute else found
    except Exception as error:
        if package.rpartition(".")[0] in _PLACES.values():
            raise
        what = f"installed feature {package}.{value}: cannot be loaded: {type(error).__name__}: {error}"
        raise CalibrationError(f"{what}; correct or uninstall its package") from None


def named(table: str, name: str) -> Any:
    """Return what a feature has by this name in ``commands``, ``public``, ``kinds`` or ``exports``; None where none has it."""
    for package, feature in known().items():
        if (value := getattr(feature, table).get(name)) is not None:
            return _load(package, value if isinstance(value, str) else value[0])
    return None


def names(table: str) -> dict[str, Any]:
    """Return all names of one of these tables, each with what it stands for."""
    return {name: value for feature in known().values() for name, value in getattr(feature, table).items()}


def each(point: str) -> Iterator[Any]:
    """Yield what serves a point, imported one by one."""
    for package, feature in known().items():
        values = feature.serves.get(point, ())
        for value in (values,) if isinstance(values, str) else values:
            yield _load(package, value)


def extended(point: str) -> Callable[[type[Record]], type[Record]]:
    """Decorate a frozen dataclass: it gets the fields of the dataclasses that serve the point."""

    def with_more(record: type[Record]) -> type[Record]:
        if not (more := tuple(each(point))):
            return record
        own = {"__doc__": record.__doc__, "__module__": record.__module__}
        return dataclass(frozen=True)(type(record.__name__, (*more, record), own))

    return with_more


def first(point: str, *given: Any, **more: Any) -> Any:
    """Return the first answer that is not None of the functions that serve a point; None without any."""
    return next((answer for ask in each(point) if (answer := ask(*given, **more)) is not None), None)
