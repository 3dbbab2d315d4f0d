"""``--columns`` ready to edit, for a table that does not say what its columns are: filled with its own names, or its columns' numbers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from session.base.numeric import median_length
from session.base.texts import shell_word
from session.base.units import ENDINGS, NS_PER_S, WORDS, G, parse_unit
from session.replay.clock import CLOCKS, exact_ns
from session.replay.columns import DELIMITERS, split
from session.replay.headings import name_and_unit

#: stands where a person puts the unit; nothing stands for registers
UNIT = "UNIT"
#: columns of a table: a triad, and stamps or not
FEWEST, MOST = 3, 200
#: what a resting accelerometer shows, in the words of ``--columns``; of registers, 1 g of the usual full scales
GRAVITY = (("mps2", G), ("g", 1.0), ("mg", 1e3), ("", 16384.0), ("", 8192.0), ("", 4096.0), ("", 2048.0))
#: of it, how far the median length may be from it
NEAR = 0.1


def suggested(lines: Sequence[str]) -> tuple[int, str] | None:
    """How many columns, and ``--columns 't_UNIT=1,gx_UNIT=2,…'`` for a log that begins with these lines; None where they are no table.

    The accelerometer is the triad that is as long as gravity, the gyroscope one beside it: a person looks at it and corrects it.
    """
    values, clocks, names = max((_table(lines, delimiter) for delimiter in DELIMITERS), key=lambda table: table[0].size)
    count = values.shape[1]
    rises = [c for c in range(count) if (np.diff(values[:, c]) >= 0).all() and np.ptp(values[:, c]) > 0]
    said = [c for c in rises if set(re.findall("[a-z]+", names[c].lower())) & set(CLOCKS)]
    # A board's own time before a time of day, which is the computer's, and both before what counts the rows.
    time = next(iter((*said, *(c for c in rises if c not in clocks and (np.diff(values[:, c]) != 1).any()), *sorted(clocks), *rises)), None)
    left = [c for c in range(count) if c not in (time, *clocks) and np.isfinite(values[:, c]).all()]
    triads = [c for c in left if {c + 1, c + 2} <= set(left)]
    lengths = {c: median_length(values[:, c : c + 3]) for c in triads}
    far = {(c, word): abs(length / g - 1) for c, length in lengths.items() for word, g in GRAVITY if abs(length / g - 1) < NEAR}
    accel, unit = min(far, key=lambda each: far[each], default=(None, UNIT))
    apart = [c for c in triads if accel is None or abs(c - accel) >= 3]
    gyro = min(apart, key=lambda c: (abs(c - accel) if accel is not None else c, -c), default=None)
    accel = next((c for c in apart if gyro is not None and c >= gyro + 3), None) if accel is None else accel
    if gyro is None and accel is None:
        return None
    entries = [] if time is None else [f"t{'' if time in clocks else '_' + _unit('time', names[time], UNIT)}={_called(names, time)}"]
    for kind, first, word in (("gyro", gyro, unit and UNIT), ("accel", accel, unit)):
        for place, axis in enumerate("xyz" if first is not None else ""):
            column = (first or 0) + place
            stated = _unit(kind, names[column], word)
            entries.append(f"{kind[0]}{axis}{'_' * bool(stated)}{stated}={_called(names, column)}")
    return count, f"--columns {shell_word(','.join(entries))}"


def _table(lines: Sequence[str], delimiter: str | None) -> tuple[np.ndarray, set[int], list[str]]:
    """Numbers (N, C) of the rows of the width that most have, NaN where there are none; which columns are clocks; names, or numbers."""
    rows: list[tuple[list[float], list[bool]]] = []
    before = header = ""
    for line in lines:
        cells = [cell.strip().strip('"') for cell in line.split("#")[0].strip().split(delimiter)]
        numbers = [_number(cell.replace(",", ".") if delimiter != "," else cell) for cell in cells[:MOST]]
        if sum(number == number for number in numbers) >= FEWEST:
            header = header if rows else before
            rows.append((numbers, [":" in cell for cell in cells]))
        before = line
    width = Counter(len(numbers) for numbers, _ in rows).most_common(1)[0][0] if rows else 0
    mine = [row for row in rows if len(row[0]) == width]
    names = split(header, delimiter)
    clocks = {c for c in range(width) if mine[0][1][c]}
    values = np.array([numbers for numbers, _ in mine]).reshape(len(mine), width)
    return values, clocks, list(names) if len(names) == width else [""] * width


def _number(cell: str) -> float:
    try:
        return exact_ns(cell, NS_PER_S) / NS_PER_S
    except ValueError:
        return float("nan")


def _unit(kind: str, name: str, otherwise: str) -> str:
    """The unit that a heading states, in the words of ``--columns``."""
    unit = parse_unit(kind, name_and_unit(name)[1])
    if unit is None:
        return otherwise
    return next((word for word in (*ENDINGS[kind], "ms", "mdps", "mg") if WORDS[kind].get(word) == unit.si), otherwise)


def _called(names: Sequence[str], column: int) -> str:
    """The name of a column, where ``--columns`` can take it, else its number."""
    name = names[column]
    plain = name and names.count(name) == 1 and not re.search("[,=+*]", name) and not name.startswith("-") and not name.isdigit()
    return name if plain else f"{column + 1}"
