"""The catalogue of effects: those of this package, and of folders that the user named."""

from __future__ import annotations

import hashlib
import importlib
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from session.base.rotation import unit_vectors
from session.base.units import DEG
from tinygc.effects.effect import Effect
from tinygc.effects.movement import EffectError, Movement

# A first test of an external effect: plain mistakes are reported while the file can still be named.

SAMPLES, RATE_HZ, FULL_SCALE_DPS = 64, 104.0, 500.0


def tried(effect: Any, where: str) -> Effect:
    """Return the effect if its functions return the right shapes for a short movement.

    Raises EffectError that begins with ``where``.
    """
    if not isinstance(effect, Effect):
        raise EffectError(f"{where}: EFFECT is of type {type(effect).__name__}, expected tinygc.effects.Effect")
    try:
        grid = None if effect.scan is None else effect.scan.grid
        values = np.array([SAMPLES / RATE_HZ / 2]) if grid is None else grid([short_movement()])
        for one in effect.variants(values[:1]):
            _try(one)
    except EffectError as error:
        raise EffectError(f"{where}: {error}") from None
    except Exception as error:
        what = " ".join(str(error).split())
        raise EffectError(f"{where}: {effect.id} fails on a movement of {SAMPLES} samples: {type(error).__name__}: {what}") from None
    return effect


def _try(effect: Effect) -> None:
    movement, size = short_movement(), effect.parameter.size
    _expect(effect, "columns", effect.columns(effect.shown(movement)), (SAMPLES, 3, size))
    theta = np.full(size, 1e-3 * effect.parameter.plausible)
    if effect.kind == "rate":
        _expect(effect, "distort", effect.distort(movement, theta), (SAMPLES, 3))
        _expect(effect, "correct", effect.correct(movement.rate, movement, theta), (SAMPLES, 3))
    if effect.kind == "force":
        _expect(effect, "bends", effect.bent(movement), (SAMPLES, 3, size))
    if not isinstance(words := effect.describe(theta), str):
        raise EffectError(f"{effect.id}: describe gives {type(words).__name__}, expected a sentence")


def _expect(effect: Effect, name: str, value: Any, shape: tuple[int, ...]) -> None:
    if np.shape(value) != shape or not np.isfinite(value).all():
        raise EffectError(f"{effect.id}: {name} gives shape {np.shape(value)} or numbers that are not finite, expected {shape}")


def short_movement() -> Movement:
    """Return half a second of a hand's turn with warm-up and vibration."""
    t_s = np.arange(SAMPLES) / RATE_HZ
    turn = np.stack([np.sin(9 * t_s), np.cos(7 * t_s), np.sin(5 * t_s + 1)], axis=-1)
    force = unit_vectors(turn)
    return Movement(
        t_s, 1 / RATE_HZ, 100 * DEG * turn, force, 25 + t_s, 0.1 + 0 * t_s, SAMPLES / RATE_HZ, FULL_SCALE_DPS * DEG, first_temp_c=25.0
    )


# The effects of a folder: each of its Python files that does not begin with an underscore defines ``EFFECT``.


def effects_in(given: Path, folder: Path) -> list[tuple[Effect, Path]]:
    """Load each effect with its file, in the order of the names; ``given``: the folder as the user wrote it.

    Raises EffectError for a path that is no folder, a folder without effects, and a file that cannot be loaded or defines no effect.
    """
    if folder.is_file():
        raise EffectError(f"{given}: that is a file; give its folder, {given.parent}")
    if not folder.is_dir():
        raise EffectError(f"{given}: no such folder; --effects names a folder of files that define EFFECT")
    found = _effects(_package(folder), folder, given)
    if not found:
        raise EffectError(f"{given}: no effect in it, expected files that define EFFECT (names that begin with _ are passed over)")
    return found


def _effects(package: str, folder: Path, given: Path) -> list[tuple[Effect, Path]]:
    return [(_effect(package, path, given / path.name), given / path.name) for path in _files(folder)]


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.py") if not path.name.startswith("_"))


def _package(folder: Path) -> str:
    """Make a new package of the folder's files; its name cannot be imported by accident."""
    name = f"tinygc_effects_folder_{hashlib.sha256(os.fsencode(folder)).hexdigest()[:12]}"
    for loaded in [module for module in sys.modules if module == name or module.startswith(f"{name}.")]:
        del sys.modules[loaded]
    importlib.invalidate_caches()
    package = ModuleType(name)
    package.__path__ = [str(folder)]
    sys.modules[name] = package
    return name


def _effect(package: str, path: Path, given: Path) -> Effect:
    if not path.stem.isidentifier():
        raise EffectError(f"{given}: the file's name is no name in Python; use letters, digits and underscores")
    if not path.is_file():  # Python would wait for a named pipe
        raise EffectError(f"{given}: is no file; take it out of the folder")
    try:
        module = importlib.import_module(f"{package}.{path.stem}")
    except EffectError as error:
        raise EffectError(f"{given}: {error}") from None
    except (Exception, SystemExit) as error:
        raise EffectError(f"{given}: cannot be loaded: {_words(error, path)}; correct it, or take it out of the folder") from None
    if not hasattr(module, "EFFECT"):
        raise EffectError(f"{given}: defines no EFFECT; a helper's name begins with _")
    return tried(module.EFFECT, str(given))


def _words(error: BaseException, path: Path) -> str:
    """Describe an error in one line: its type, its message, and the file's line where that is known."""
    line, at = getattr(error, "lineno", None), error.__traceback__
    while at is not None:
        if Path(at.tb_frame.f_code.co_filename) == path:
            line = at.tb_lineno
        at = at.tb_next
    what = " ".join(str(getattr(error, "msg", None) or error).split())
    return f"{type(error).__name__}: {what}" + ("" if line is None else f" (line {line})")


# The catalogue holds the effects of this package and of the folders that the user named, and no others.
#
# A session folder and a model file contain only ids: reading them executes nothing.

ENTRIES = "tinygc.effects.entries"
#: prefix of the ids of effects that ``explain --discover`` writes
FOUND = "discovered."
#: folder -> its effects by id, each with the file that defines it
_folders: dict[Path, dict[str, tuple[Effect, Path]]] = {}


def catalogue() -> dict[str, Effect]:
    """Return all effects by id, sorted by id."""
    whole = dict(_own())
    for effects in _folders.values():
        whole |= {name: effect for name, (effect, _) in effects.items()}
    return dict(sorted(whole.items()))


def effect_of(name: str) -> Effect:
    """Return the effect with that id.  Raises EffectError, with what to do, where it is not installed."""
    known = catalogue()
    if name not in known and name.startswith(FOUND):
        raise EffectError(
            f"effect {name[:60]!r} was found in a recording, and stands in no catalogue; explain --discover wrote its file: name that "
            "recording's folder of them with --effects DIR/explain/effects (tinygc.effects.load_folder in Python)"
        )
    if name not in known:
        raise EffectError(
            f"effect {name[:60]!r} is not on this machine; name the folder that holds its file with --effects DIR "
            "(tinygc.effects.load_folder in Python)"
        )
    return known[name]


def load_folder(path: Path | str) -> list[Effect]:
    """Add the effects of a folder, one file each, to the catalogue; a second call reloads the files.

    Files whose names begin with an underscore are not effects; effects may import them (``from ._name import …``).
    Raises EffectError, which names the file, for a folder or file that cannot be read, an effect of the wrong type, and an id that
    another effect has.
    """
    folder = Path(path).resolve()
    before = _folders.pop(folder, None)
    try:
        found = effects_in(Path(path), folder)
        others = {name: str(file) for effects in _folders.values() for name, (_, file) in effects.items()}
        for effect, file in found:
            taken = others.get(effect.id) or ("an effect of TinyGC" if effect.id in _own() else None)
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
    """Add the effects of these folders to the catalogue within a ``with`` block."""
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
    """Add one effect to the catalogue within a ``with`` block; it replaces any effect with its id."""
    with using(()):
        _folders[Path(f"<{effect.id}>")] = {effect.id: (effect, Path("<given>"))}
        yield


def loaded_folders() -> list[Path]:
    """Return the loaded folders in order, as another process needs them."""
    return list(_folders)


@cache
def _own() -> dict[str, Effect]:
    """Return the effects of this package."""
    files = _files(Path(importlib.import_module(ENTRIES).__path__[0]))
    own = [importlib.import_module(f"{ENTRIES}.{path.stem}").EFFECT for path in files]  # which the tests have tried
    effects = {effect.id: effect for effect in own}
    if len(effects) != len(own):
        raise EffectError(f"{ENTRIES}: two files give one id")
    return effects
