"""The effects of a folder: each of its Python files that does not begin with an underscore defines ``EFFECT``."""

from __future__ import annotations

import hashlib
import importlib
import os
import sys
from pathlib import Path
from types import ModuleType

from tinygc.effects.effect import Effect
from tinygc.effects.errors import EffectError
from tinygc.effects.trial import tried


def effects_in(said: Path, folder: Path) -> list[tuple[Effect, Path]]:
    """Each effect with its file, in the order of the names; ``said``: the folder as the user wrote it.

    Raises EffectError for a folder that is none or holds no effect, and for a file that cannot be loaded or defines none.
    """
    if folder.is_file():
        raise EffectError(f"{said}: that is a file; give its folder, {said.parent}")
    if not folder.is_dir():
        raise EffectError(f"{said}: no such folder; --effects names a folder of files that define EFFECT")
    files = sorted(path for path in folder.glob("*.py") if not path.name.startswith("_"))
    if not files:
        raise EffectError(f"{said}: no effect in it, expected files that define EFFECT (names that begin with _ are passed over)")
    package = _package(folder)
    return [(_effect(package, path, said / path.name), said / path.name) for path in files]


def _package(folder: Path) -> str:
    """A package of the folder's files alone, freshly: its name is no file's, so that nothing else imports it by chance."""
    name = f"tinygc_effects_folder_{hashlib.sha256(os.fsencode(folder)).hexdigest()[:12]}"
    for loaded in [module for module in sys.modules if module == name or module.startswith(f"{name}.")]:
        del sys.modules[loaded]
    importlib.invalidate_caches()
    package = ModuleType(name)
    package.__path__ = [str(folder)]
    sys.modules[name] = package
    return name


def _effect(package: str, path: Path, said: Path) -> Effect:
    if not path.stem.isidentifier():
        raise EffectError(f"{said}: the file's name is no name in Python; use letters, digits and underscores")
    if not path.is_file():  # Python would wait for a named pipe
        raise EffectError(f"{said}: is no file; take it out of the folder")
    try:
        module = importlib.import_module(f"{package}.{path.stem}")
    except EffectError as error:
        raise EffectError(f"{said}: {error}") from None
    except (Exception, SystemExit) as error:
        raise EffectError(f"{said}: cannot be loaded: {_words(error, path)}; mend it, or take it out of the folder") from None
    if not hasattr(module, "EFFECT"):
        raise EffectError(f"{said}: defines no EFFECT; a helper's name begins with _")
    return tried(module.EFFECT, str(said))


def _words(error: BaseException, path: Path) -> str:
    """In one line: the kind, what it says, and the file's line where that is known."""
    line, at = getattr(error, "lineno", None), error.__traceback__
    while at is not None:
        if Path(at.tb_frame.f_code.co_filename) == path:
            line = at.tb_lineno
        at = at.tb_next
    what = " ".join(str(getattr(error, "msg", None) or error).split())
    return f"{type(error).__name__}: {what}" + ("" if line is None else f" (line {line})")
