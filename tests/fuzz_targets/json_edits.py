"""JSON that anybody may have written: a good table with some of its values in the place of others, as a short program says."""

from __future__ import annotations

import copy
import json
from typing import Any

#: what stands where a number, a text, a list or a table is expected
ODD: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 0.5, -0.0, 1e-300, 1e30, 1e308, -1e308, 10**30, float("nan"), float("inf")),
    *(
        "",
        "1",
        "nan",
        "x",
        "a\nb",
        "\ud800",
        "\x1b[31m",
        [],
        {},
        [[]],
        [1],
        [None],
        ["1"],
        [1, [2]],
        {"a": 1},
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "../x",
    ),
)
MOST_EDITS = 8
DELETE, SIBLING, DOUBLE, WRAP = range(len(ODD), len(ODD) + 4)
Key = tuple[str | int, ...]


def edited(table: Any, program: bytes) -> str:
    """JSON text after each edit of the program: two bytes say where, one says what."""
    table = copy.deepcopy(table)
    for place in range(0, min(len(program), 3 * MOST_EDITS) - 2, 3):
        keys = _places(table, ())
        if not keys:
            break
        _edit(table, keys[int.from_bytes(program[place : place + 2], "big") % len(keys)], program[place + 2] % (len(ODD) + 4))
    return json.dumps(table)


def _places(value: Any, at: Key) -> list[Key]:
    """Every place below a value, itself left out."""
    entries = list(value.items()) if isinstance(value, dict) else list(enumerate(value)) if isinstance(value, list) else []
    return [key for name, entry in entries for key in ((*at, name), *_places(entry, (*at, name)))]


def _edit(table: Any, key: Key, what: int) -> None:
    holder = table
    for name in key[:-1]:
        holder = holder[name]
    name, value = key[-1], holder[key[-1]]
    if what == DELETE:
        del holder[name]
    elif what == SIBLING:
        names = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
        holder[name] = copy.deepcopy(holder[names[(names.index(name) + 1) % len(names)]])
    elif what == DOUBLE:
        holder[name] = value + value if isinstance(value, list | str) else [value, value]
    elif what == WRAP:
        holder[name] = [value]
    else:
        holder[name] = copy.deepcopy(ODD[what])
