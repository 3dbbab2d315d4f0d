"""Only what an effect declares is shown to it: what it reads beyond that is said in one line, not used as NaN."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NoReturn

from tinygc.effects.errors import EffectError
from tinygc.effects.movement import Movement
from tinygc.effects.reach import AROUND, INPUTS


class Undeclared:
    """Stands where a field of the movement was not declared; any use of it is an EffectError."""

    def __init__(self, effect: str, field: str, ways: str):
        self._says = f"{effect}: reads movement.{field}, which it does not declare; add {ways} to its Effect(...)"

    def __array__(self, *args: Any, **settings: Any) -> NoReturn:
        raise EffectError(self._says)

    def __getattr__(self, name: str) -> NoReturn:
        if name.startswith("__"):
            raise AttributeError(name)
        raise EffectError(self._says)


def _refuse(self: Undeclared, *others: object) -> NoReturn:
    raise EffectError(self._says)


_USES = "add radd sub rsub mul rmul truediv rtruediv pow rpow neg abs lt le gt ge eq ne len iter getitem float int bool matmul rmatmul"
for _name in _USES.split():
    setattr(Undeclared, f"__{_name}__", _refuse)


def shown(effect: str, inputs: Iterable[str], looks_around: bool, movement: Movement) -> Movement:
    """The movement as the effect with that id, its declared inputs and a reach or none may see it."""
    may_read = {field for name in inputs for field in INPUTS[name]} | set(AROUND if looks_around else ())
    hidden: dict[str, Any] = {}  # of the fields' own types nothing is left
    for name, fields in INPUTS.items():
        for field in fields:
            if field not in may_read:
                ways = "reach=Reach(...)" if field == "dt_s" else f'inputs=("{name}",)'
                hidden[field] = Undeclared(effect, field, ways)
    return replace(movement, **hidden)
