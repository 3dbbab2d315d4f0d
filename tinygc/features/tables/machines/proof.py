"""What is proven of a make's requests before a port is opened: that they fit the table, and that a turn is the plan's and nothing more.

A make's file is a text of whoever wrote it, in a language that only the machine knows.  Proven is what needs no knowledge of it:

- ``turn_to`` holds the plan's angle once, its rate at most once, its axis, and no other number but words of G-code that say how numbers
  are meant (``MODAL``); nothing stands beside a number that would make another of it, nor what controllers take for a comment,
  an expression or the end of a line, nor a sign or a point before it, behind blanks.  It repeats no request of ``home``.  ``turn_at``
  likewise, with its rate and its sign.  In G-code the rate has the angle's unit.
- No other request is given an angle or a rate, nor is any of them the make's own turn with numbers in it, or an axis and a number.
- A question has an answer that says something.  A request is one line.

The rest (what a word moves, how large a unit is) is shown by ``table check``, and a person confirms it.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from session.base.errors import FormatError
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.makefile import AGAIN, LONGEST_LINE, Make, Step, require_settings

#: G-code that a turn may hold: a motion at a rate, degrees as millimetres, machine coordinates, absolute, a rate per minute
MODAL = re.compile(r"(?<![A-Z0-9.])G0*+(?:1|21|53|90|94)(?![\d.])", re.IGNORECASE)
#: what ends a line; anything longer would be a request behind each request
ENDS = ("\n", "\r", "\r\n", "\n\r", "\0", ";")
#: the text of a turn, without its values
LITERAL = re.compile(r"[A-Za-z0-9 $=:,._@&-]*")
WORD = re.compile(r"[A-Za-z0-9$=:,._@&-]+")
SIGNS = "$ = : , . _ @ & -"
PLACE = re.compile(r"\{(\w+)\}")
#: what is filled in to see which numbers a turn holds: whole, so that a digit, a point or a sign beside them makes others of them
PROBE = {"angle": "7301", "rate": "6007", "signed_rate": "6011"}
AXIS = "83"
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?", re.IGNORECASE)


def require_fit(table: Description, make: Make) -> None:
    """FormatError for settings or axes that a make does not have, and for requests that may do more than the plan says."""
    require_settings(table.settings, f"{table.name}: settings", make.settings)
    if len(table.axes) > make.most_axes:
        raise FormatError(f"{table.name}: {len(table.axes)} axes, and a {make.name} has at most {make.most_axes}; {AGAIN}")
    words = [axis.word for axis in table.axes]
    if len(set(words)) < len(words) or (make.order and not all(len(word) == 1 and word in make.order for word in words)):
        allowed = f" among {', '.join(make.order)}" if make.order else ""
        raise FormatError(f"{table.name}: words of the axes are {', '.join(words)}, expected words of their own{allowed}; {AGAIN}")
    if wrong := [word for word in words if not WORD.fullmatch(word)]:
        raise FormatError(f"{table.name}: the word of an axis is {wrong[0][:40]!r}, expected letters, digits and {SIGNS}; {AGAIN}")
    if make.end not in ENDS:
        raise FormatError(f"{make.name}: line.end is {make.end[:20]!r}, expected one of {', '.join(map(repr, ENDS))}; {AGAIN}")
    settings: dict[str, Any] = {**make.settings, **table.settings}
    homes = {_bare(step.send) for step in make.home}
    for name, steps, numbers in (("turn_to", make.turn_to, {"angle": 1, "rate": 1}), ("turn_at", make.turn_at, {"signed_rate": 1})):
        for word in words if steps else ():
            if why := _more_than_the_plan(steps, numbers, word, make.most_axes > 1):
                raise FormatError(f"{make.name}: {name} {why}; a turn says the plan's axis, angle and rate, and nothing else; {AGAIN}")
        if same := [step.send for step in steps if _bare(step.send) in homes]:
            raise FormatError(f"{make.name}: {name} has the request {same[0][:60]!r}, which home has: it may search marks; {AGAIN}")
        per_deg, rate = (abs(float(settings[key])) for key in ("per_deg", "rate_per_dps"))
        in_minutes = math.isclose(rate, 60 * per_deg, rel_tol=1e-6) and any("F{rate}" in step.send for step in steps)
        if any(MODAL.search(step.send) for step in steps) and not in_minutes:
            said = f"settings.rate_per_dps is {rate:g}, and G-code wants F{{rate}} per minute in the unit of the angle, {60 * per_deg:g}"
            raise FormatError(f"{make.name}: {said}; {AGAIN}")
    turns = [turn.send for turn in (*make.turn_to, *make.turn_at) if {"angle", "signed_rate"} & set(PLACE.findall(turn.send))]
    begins = [(" *+".join(map(re.escape, head)), ".*") for turn in turns if (head := _head(turn))]
    begins += [(word.upper(), " *+=?+ *+[-+]?+ *+[0.]*+") for word in {*words, *make.order} if word.isalpha()]
    for name, steps in make.requests():
        for step in steps if name not in ("turn_to", "turn_at") else ():
            text = _filled(step.send, settings)
            if why := _may_move(name, step, text, begins):
                raise FormatError(f"{make.name}: {name} {why} {(text or step.raw)[:60]!r}; {AGAIN}")


def _more_than_the_plan(steps: Iterable[Step], numbers: dict[str, int], word: str, names_an_axis: bool) -> str:
    """Why a turn of the axis of that word may be more than its plan; empty where it is not."""
    held, used = Counter[str](), Counter[str]()
    for step in steps:
        if step.raw or step.each:
            return "has a request that is raw, or for each axis"
        text = step.send
        places = PLACE.findall(text)
        used.update(places)
        if unknown := [name for name in places if name not in ("word", "axis", *numbers)]:
            return f"has {{{unknown[0]}}} in {text[:60]!r}"
        if not LITERAL.fullmatch(PLACE.sub("", text)):
            return f"has a character in {text[:60]!r} that may hide or change a number, expected letters, spaces and {SIGNS}"
        values = PROBE | {"word": word, "axis": AXIS}
        if re.search(r"[-.] +\{", _filled(text, {"word": word, "axis": AXIS})):  # a controller may drop blanks
            return f"has a sign or a point before a value in {text[:60]!r}"
        left = Counter(NUMBER.findall(_filled(MODAL.sub(" ", text), values)))
        for name in places:
            left.subtract(NUMBER.findall(values[name]))
        held.update(left)
    if wrong := [number for number, count in held.items() if count]:
        return f"has the number {max(wrong, key=len)}, once {PROBE['angle']} and {PROBE['rate']} are filled in"
    first = next(iter(numbers))
    if used[first] != 1 or any(used[name] > most for name, most in numbers.items()):
        return f"needs {{{first}}} once, and no other value twice"
    if names_an_axis and not used["word"] + used["axis"]:
        return "names no axis: {word} or {axis} is missing, or most_axes = 1"
    return ""


def _may_move(name: str, step: Step, text: str, begins: Iterable[tuple[str, str]]) -> str:
    """Why a request that is no turn may turn something by itself; empty where nothing shows it.

    begins: patterns of what turns begin with, and of what stands before the first digit of a number that is not 0.
    """
    if {*PROBE} & {*PLACE.findall(step.send)}:
        return "has a value that turn_to and turn_at alone may have, in"
    if not text.isprintable() or len(text) > LONGEST_LINE:
        return "has more than one line, or a character that is to be raw, in"
    if name in ("where", "controller", "ask") and not (step.answers and all(PLACE.search(pattern.text) for pattern in step.answers)):
        return "has no answer with a field, so that it is no question, in"
    said = MODAL.sub("", text + step.raw).upper()
    if name not in ("home", "stop"):  # which may go to zero, or at a rate of zero
        said = said.replace("0", "1")
    if any(re.search(rf"(?<![A-Z]){word}{before}[1-9]", said, re.DOTALL) for word, before in begins):
        return "has a turn, which turn_to and turn_at alone may be,"
    return ""


def _bare(text: str) -> str:
    """A request as a controller may read it, which drops blanks."""
    return text.replace(" ", "").upper()


def _filled(text: str, values: Mapping[str, object]) -> str:
    """A request with the values that there are; other places stay."""
    return PLACE.sub(lambda place: str(values.get(place[1], place[0])), text)


def _head(turn: str) -> str:
    """What a turn's line begins with, behind the word of its axis and before its first number."""
    parts = PLACE.split(MODAL.sub("", turn).upper().replace(" ", ""))
    literals = parts[::2] if PLACE.match(turn) is None else parts[2::2]
    return literals[0] if literals else ""
