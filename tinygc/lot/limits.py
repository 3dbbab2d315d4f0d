"""Limits of a lot's numbers, from a person's TOML file: lower and upper, in the units that people see (docs/lots.md)."""

from __future__ import annotations

import difflib
import math
from pathlib import Path
from typing import Any

from session.common.errors import FormatError
from session.files.shapes import shown
from session.files.toml import read_toml
from tinygc.lot.quantities import SEEN

SCHEMA = "tinygc-limits/1"
#: a section may name all components of one kind: ``gyro_bias_mdps``
GROUPS = {f"{each.sensor} {each.word} {each.unit}".replace(" ", "_") for each in SEEN}
KEYS = {each.key for each in SEEN}
_SIDES = ("lower", "upper")


def read_limits(path: Path | str) -> dict[str, tuple[float, float]]:
    """(lower, upper) of each number that has limits, by its key; infinite where only one side is given.

    Raises FormatError, in one line, for a key that is none, a limit that is no number, and a lower one that is not below the upper.
    """
    table = read_toml(Path(path))
    if table.get("schema") != SCHEMA:
        raise FormatError(f'{path}: no limits of a lot, expected schema = "{SCHEMA}" at the top')
    found: dict[str, tuple[float, float]] = {}
    sections = {name: value for name, value in table.items() if name != "schema"}
    # What names one component wins over what names all of its kind.
    for name in sorted(sections, key=lambda each: each in KEYS):
        if name not in KEYS and name not in GROUPS:
            near = difflib.get_close_matches(name, [*GROUPS, *KEYS], 1)
            hint = f"; did you mean {near[0]}?" if near else "; the names are in docs/lots.md"
            raise FormatError(f"{path}: {name} is no number of a lot{hint}")
        limits = _limits(sections[name], f"{path}: {name}")
        for each in SEEN:
            if name in (each.key, f"{each.sensor} {each.word} {each.unit}".replace(" ", "_")):
                found[each.key] = limits
    if not found:
        raise FormatError(f"{path}: no limits, expected a section such as [gyro_bias_mdps] with lower and upper (docs/lots.md)")
    return found


def _limits(section: Any, where: str) -> tuple[float, float]:
    if not isinstance(section, dict):
        raise FormatError(f"{where} is {shown(section)}, expected a section with lower, upper or both")
    if strange := sorted(set(section) - set(_SIDES)):
        raise FormatError(f"{where}.{strange[0]} is no key of limits, expected lower, upper or both")
    lower, upper = (_number(section[side], f"{where}.{side}") if side in section else None for side in _SIDES)
    if lower is None and upper is None:
        raise FormatError(f"{where} has no limit, expected lower, upper or both")
    if lower is not None and upper is not None and not lower < upper:
        raise FormatError(f"{where}.lower is {lower:g}, expected less than upper, {upper:g}")
    return (-math.inf if lower is None else lower, math.inf if upper is None else upper)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or abs(value) > 1e12:
        raise FormatError(f"{where} is {value!s:.40}, expected a number")
    return float(value)
