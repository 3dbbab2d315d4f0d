"""The catalogue: the effects of this package, of installed packages, and of the folders that the user named; from nowhere else.

A session folder and a model file only name ids: reading them executes nothing.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import ModuleType

from tinygc.effects.effect import Effect
from tinygc.effects.errors import EffectError
from tinygc.effects.folders import effects_in
from tinygc.effects.trial import tried

ENTRIES, GROUP = "tinygc.effects.entries", "tinygc.effects"
#: how the ids begin of effects that ``explain --discover`` writes
FOUND = "discovered."
#: folder -> its effects by id, each with the file that defines it
_folders: dict[Path, dict[str, tuple[Effect, Path]]] = {}


def catalogue() -> dict[str, Effect]:
    """All effects by id, in the order of their ids.  EffectError for an installed effect that is broken."""
    whole = dict(_installed())
    for effects in _folders.values():
        whole |= {name: effect for name, (effect, _) in effects.items()}
    return dict(sorted(whole.items()))


def effect_of(name: str) -> Effect:
    """The effect with that id.  EffectError, with what to do, where this machine has none."""
    known = catalogue()
    if name not in known and name.startswith(FOUND):
        raise EffectError(
            f"effect {name[:60]!r} was found in a recording, and stands in no catalogue; explain --discover wrote its file: name that "
            "recording's folder of them with --effects DIR/explain/effects (tinygc.effects.load_folder in Python)"
        )
    if name not in known:
        raise EffectError(
            f"effect {name[:60]!r} is not on this machine; name the folder that holds its file with --effects DIR "
            "(tinygc.effects.load_folder in Python), or install the package that has it"
        )
    return known[name]


def load_folder(path: Path | str) -> list[Effect]:
    """Add the effects of a folder, one file each, to the catalogue; loading it again takes its files as they are now.

    Files whose names begin with an underscore are no effects; effects may import them (``from ._name import …``).
    Raises EffectError, which names the file, for a folder or file that cannot be read, an effect of the wrong type, and an id that is
    another effect's.
    """
    folder = Path(path).resolve()
    before = _folders.pop(folder, None)
    try:
        found = effects_in(Path(path), folder)
        others = {name: str(file) for effects in _folders.values() for name, (_, file) in effects.items()}
        for effect, file in found:
            taken = others.get(effect.id) or ("an effect of TinyGC or of an installed package" if effect.id in _installed() else None)
            if taken is not None:
                raise EffectError(f"{file}: its id {effect.id!r} is already that of {taken}; give it an id of its own")
            others[effect.id] = str(file)
    except EffectError:
        if before is not None:
            _folders[folder] = before
        raise
    _folders[folder] = {effect.id: (effect, file) for effect, file in found}
    return [effect for effect, _ in found]


@contextmanager
def using(folders: Iterable[Path | str]) -> Iterator[None]:
    """The catalogue with the effects of these folders; as it was afterwards."""
    before = dict(_folders)
    try:
        for folder in folders:
            load_folder(folder)
        yield
    finally:
        _folders.clear()
        _folders.update(before)


@contextmanager
def having(effect: Effect) -> Iterator[None]:
    """The catalogue with one effect in the place of any with its id; as it was afterwards."""
    before = dict(_folders)
    try:
        _folders[Path(f"<{effect.id}>")] = {effect.id: (effect, Path("<given>"))}
        yield
    finally:
        _folders.clear()
        _folders.update(before)


def loaded_folders() -> list[Path]:
    """The folders that are loaded, in order: what a further process has to be told."""
    return list(_folders)


@cache
def _installed() -> dict[str, Effect]:
    """The package's own effects, and those of installed packages."""
    own = importlib.import_module(ENTRIES)
    names = sorted(module.name for module in pkgutil.iter_modules(own.__path__) if not module.name.startswith("_"))
    effects = {effect.id: effect for effect in (importlib.import_module(f"{ENTRIES}.{name}").EFFECT for name in names)}
    if len(effects) != len(names):
        raise EffectError(f"{ENTRIES}: two files give one id")
    from importlib.metadata import entry_points

    for point in entry_points(group=GROUP):
        where = f"installed effect {point.name!r} ({point.value})"
        try:
            given = point.load()
        except Exception as error:
            raise EffectError(f"{where}: cannot be loaded: {type(error).__name__}: {error}; mend or uninstall its package") from None
        effect = tried(given.EFFECT if isinstance(given, ModuleType) and hasattr(given, "EFFECT") else given, where)
        if effect.id in effects:
            raise EffectError(f"{where}: its id {effect.id!r} is already that of another effect")
        effects[effect.id] = effect
    return effects
