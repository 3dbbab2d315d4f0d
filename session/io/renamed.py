"""Modules, fields and functions that users of 0.1.0 wrote: they work on until 0.3, with one line that states the new name.

Only names that pages of 0.1.0 showed to users are kept.  ``install`` adds a finder behind Python's own, so that nothing is slower.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, TypeVar, cast

T = TypeVar("T")

#: old name -> new name
RENAMED = {
    "session.common.errors": "session.io.errors",
    "session.common.units": "session.io.units",
    "session.log.array_reading": "session.annexes.arrays.recording",
    "tinygc.array.ages.ages": "tinygc.annexes.arrays.latency",
    "tinygc.array.fused.model_files": "tinygc.annexes.arrays.model",
    "tinygc.array.places.places": "tinygc.annexes.arrays.extrinsics",
    "tinygc.deploy.array.live": "tinygc.annexes.arrays.voting",
    "tinygc.deploy.exports._linear": "tinygc.deploy.exports._text",
    "tinygc.deploy.exports._remarks": "tinygc.deploy.exports._text",
    "tinygc.effects.columns": "tinygc.effects.movement",
    "tinygc.effects.conditions": "tinygc.effects.movement",
    "tinygc.effects.parameter": "tinygc.effects.effect",
    "tinygc.effects.picture": "tinygc.effects.effect",
    "tinygc.effects.reach": "tinygc.effects.movement",
    "tinygc.fleet.results": "tinygc.annexes.lots.fleet_summary",
    "tinygc.lot.report": "tinygc.annexes.lots.report",
}
#: packages that are gone, and that Python asks for on the way to an old name
_PARENTS = {name.rsplit(".", count)[0] for name in RENAMED for count in range(1, name.count("."))}
#: those of them whose name is a function now -> its module
_FUNCTIONS = {f"tinygc.{name}": "tinygc.library.many" for name in ("array", "fleet", "lot")}


#: schema of a result, without its number 1 of version 0.1.0 -> the keys that have another name in number 2, at any depth
RENAMED_KEYS: dict[str, dict[str, str]] = {
    "tinygc-explain": {
        "says": "description",
        "do": "advice",
        "regime": "conditions",
        "seen_from": "detection_limits",
        "splits": "discriminating_motion",
        "beside": "catalogue_effects",
    },
    "tinygc-lot": {"says": "description", "seen": "observed", "seen_sigma": "observed_sigma"},
    "tinygc-fit": {
        "says": "description",
        "widened": "variance_inflation",
        "closure_floor_mended_rms_deg": "closure_floor_repaired_rms_deg",
        "asked": "requested",
    },
}


def with_new_keys(table: Any) -> Any:
    """Return a result as the current schema has it; unchanged what is no result of 0.1.0 with renamed keys."""
    schema, _, number = str(table.get("schema") if isinstance(table, dict) else "").partition("/")
    if schema not in RENAMED_KEYS or number != "1":
        return table
    return {**_renamed_keys(table, RENAMED_KEYS[schema]), "schema": f"{schema}/2"}


def _renamed_keys(value: Any, names: dict[str, str]) -> Any:
    if isinstance(value, dict):
        return {names.get(key, key): _renamed_keys(inner, names) for key, inner in value.items()}
    return [_renamed_keys(inner, names) for inner in value] if isinstance(value, list) else value


_announced: set[str] = set()


def announce(old: str, new: str) -> None:
    """State the new name on standard error, once in a process."""
    if old not in _announced:
        _announced.add(old)
        print(f"{old} is now {new}; the old name goes with version 0.3", file=sys.stderr)


def renamed_fields(**names: str) -> Callable[[type[T]], type[T]]:
    """Class decorator: a dataclass whose old field names (old=new) still work as keywords, as attributes and in ``replace``."""

    def decorate(cls: type[T]) -> type[T]:
        init: Any = cls.__init__

        @wraps(init)
        def renaming(self: T, *args: Any, **values: Any) -> None:
            for old in values.keys() & names.keys():
                announce(f"{cls.__name__}.{old}", names[old])
                values[names[old]] = values.pop(old)
            init(self, *args, **values)

        def attribute(self: T, name: str) -> Any:
            if name not in names:
                raise AttributeError(f"{cls.__name__} has no attribute {name!r}", name=name, obj=self)
            announce(f"{cls.__name__}.{name}", names[name])
            return getattr(self, names[name])

        open_class: Any = cls
        open_class.__init__, open_class.__getattr__ = renaming, attribute
        return cls

    return decorate


class _GonePackage(ModuleType):
    """A package that is gone and whose name is a function now: what asks for an old module in it must not hide the function."""

    def __call__(self, *args: Any, **values: Any) -> Any:
        return getattr(import_module(_FUNCTIONS[self.__name__]), self.__name__.rpartition(".")[2])(*args, **values)


class _Finder:
    # Python asks a finder and a loader for these three methods; their abstract classes take longer to import than all else here.
    def find_spec(self, name: str, path: object = None, target: ModuleType | None = None) -> ModuleSpec | None:
        return ModuleSpec(name, cast(Any, self), is_package=name in _PARENTS) if name in RENAMED or name in _PARENTS else None

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return _GonePackage(spec.name) if spec.name in _FUNCTIONS else None

    def exec_module(self, module: ModuleType) -> None:
        name = module.__name__
        if name in RENAMED:
            announce(name, RENAMED[name])
            sys.modules[name] = import_module(RENAMED[name])  # the import system takes the module that stands here


def install() -> None:
    """Let old names lead to the new modules, behind every other finder."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
