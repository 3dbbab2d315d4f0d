"""All laws by id."""

from __future__ import annotations

from tinygc.challenge.concealment import Maker
from tinygc.challenge.discover.laws.chance import CHANCE
from tinygc.challenge.discover.laws.drawn import DRAWN
from tinygc.challenge.discover.laws.element import ELEMENT
from tinygc.challenge.discover.laws.magnetic import MAGNETIC
from tinygc.challenge.discover.laws.memory import MEMORY
from tinygc.challenge.discover.laws.package import PACKAGE
from tinygc.challenge.discover.laws.rectification import RECTIFICATION
from tinygc.challenge.discover.laws.supply import SUPPLY

#: written by hand, from physics
BY_HAND: dict[str, Maker] = {**MAGNETIC, **SUPPLY, **ELEMENT, **MEMORY, **PACKAGE, **RECTIFICATION, **CHANCE}
LAWS: dict[str, Maker] = {**BY_HAND, **DRAWN}
