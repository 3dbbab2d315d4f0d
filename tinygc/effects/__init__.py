"""The catalogue: every effect that can make a recording differ from its simulation, one small file each (FORMATS, effects).

A file in this folder that defines ``EFFECT`` is in the catalogue; nothing else has to be changed.  Names that begin with an underscore
are not effects.  ``effect.py`` says what an effect must offer.

May import: session.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from tinygc.effects import entries
from tinygc.effects.effect import Effect


@cache
def catalogue() -> dict[str, Effect]:
    """All effects by id, in the order of their ids."""
    names = sorted(module.name for module in pkgutil.iter_modules(entries.__path__) if not module.name.startswith("_"))
    effects = [importlib.import_module(f"{entries.__name__}.{name}").EFFECT for name in names]
    return {effect.id: effect for effect in sorted(effects, key=lambda effect: effect.id)}
