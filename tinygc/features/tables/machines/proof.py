"""What may be sent, and is proven of it: before a port is opened, that a make's requests fit the table, and that a turn is the plan's and
nothing more; before a plan is confirmed, that the controller's own settings allow it.

A make's file is a text of whoever wrote it, in a language that only the machine knows.  Proven is what needs no knowledge of it:

- ``turn_to`` holds the plan's angle once, its rate at most once, its axis, and no other number but words of G-code that set how numbers
  are meant (``MODAL``); nothing stands next to a number that would make another of it, nor what controllers take for a comment,
  an expression or the end of a line, nor a sign or a point before it, behind blanks.  It repeats no request of ``home``.  ``turn_at``
  likewise, with its rate and its sign.  In G-code the rate has the angle's unit.
- No other request is given an angle or a rate, nor is any of them the make's own turn with numbers in it, or an axis and a number.
- A question has an answer with a content.  A request is one line.

The rest (what a word moves, how large a unit is) is shown by ``table check`` (``example``), and a person confirms it.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from session.base.errors import FormatError
from session.base.results import Keys, require
from session.base.units import DEG
from tinygc.features.tables.machines.description import AGAIN, Description, Settings
from tinygc.features.tables.machines.link import TableLimit
from tinygc.features.tables.machines.makefile import LONGEST_LINE, PLACE, Controller, Make, Step

#: G-code that a turn may hold: a motion at a rate, degrees as millimetres, machine coordinates, absolute, a rate per minute
MODAL = re.compile(r"(?<![A-Z0-9.])G0*+(?:1|21|53|90|94)(?![\d.])", re.IGNORECASE)
#: what ends a line; anything longer would be a request behind each request
ENDS = ("\n", "\r", "\r\n", "\n\r", "\0", ";")
#: the text of a turn, without its values
LITERAL = re.compile(r"[A-Za-z0-9 $=:,._@&-]*")
WORD = re.compile(r"[A-Za-z0-9$=:,._@&-]+")
SIGNS = "$ = : , . _ @ & -"
#: what is filled in to see which numbers a turn holds: whole, so that a digit, a point or a sign next to them makes others of them
PROBE = {"angle": "7301", "rate": "6007", "signed_rate": "6011"}
AXIS = "83"
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?", re.IGNORECASE)
#: deg by which a limit may lie beyond the travel: settings have three decimals
WITHIN_DEG = 1e-3
#: bits of ``homes``: it homes, and sets its zero there (grblHAL), which moves its travel
HOMES, ZERO_THERE = 1, 8


def fitted(table: Description, make: Make) -> Make:
    """The make with the table's settings.

    FormatError for settings or axes that it does not have, and for requests that may do more than is in the plan.
    """
    if unknown := [name for name in table.settings if name not in make.settings]:
        has = f"this make has no such setting; it has {', '.join(make.settings)}"
        raise FormatError(f"{table.name}: settings.{unknown[0][:40]}: {has}; {AGAIN}")
    require({"settings": dict(table.settings)}, Keys({"settings": Settings()}), table.name, AGAIN)
    make = replace(make, settings={**make.settings, **table.settings})
    settings, of, order = make.settings, make.requests, make.states.order
    if len(table.axes) > make.most_axes:
        raise FormatError(f"{table.name}: {len(table.axes)} axes, and a {make.name} has at most {make.most_axes}; {AGAIN}")
    words = [axis.word for axis in table.axes]
    if len(set(words)) < len(words) or (order and not all(len(word) == 1 and word in order for word in words)):
        allowed = f" among {', '.join(order)}" if order else ""
        raise FormatError(f"{table.name}: words of the axes are {', '.join(words)}, expected words of their own{allowed}; {AGAIN}")
    if wrong := [word for word in words if not WORD.fullmatch(word)]:
        raise FormatError(f"{table.name}: the word of an axis is {wrong[0][:40]!r}, expected letters, digits and {SIGNS}; {AGAIN}")
    if make.line.end not in ENDS:
        raise FormatError(f"{make.name}: line.end is {make.line.end[:20]!r}, expected one of {', '.join(map(repr, ENDS))}; {AGAIN}")
    homes = {_bare(step.send) for step in of.home}
    for name, steps, numbers in (("turn_to", of.turn_to, {"angle": 1, "rate": 1}), ("turn_at", of.turn_at, {"signed_rate": 1})):
        for word in words if steps else ():
            if why := _more_than_the_plan(steps, numbers, word, make.most_axes > 1):
                raise FormatError(f"{make.name}: {name} {why}; a turn holds the plan's axis, angle and rate, and nothing else; {AGAIN}")
        if same := [step.send for step in steps if _bare(step.send) in homes]:
            raise FormatError(f"{make.name}: {name} has the request {same[0][:60]!r}, which home has: it may search marks; {AGAIN}")
        per_deg, rate = (abs(float(settings[key])) for key in ("per_deg", "rate_per_dps"))
        in_minutes = math.isclose(rate, 60 * per_deg, rel_tol=1e-6) and any("F{rate}" in step.send for step in steps)
        if any(MODAL.search(step.send) for step in steps) and not in_minutes:
            reported = f"settings.rate_per_dps is {rate:g}, and G-code takes F{{rate}} per minute in the angle's unit, {60 * per_deg:g}"
            raise FormatError(f"{make.name}: {reported}; {AGAIN}")
    turns = [turn.send for turn in (*of.turn_to, *of.turn_at) if {"angle", "signed_rate"} & set(PLACE.findall(turn.send))]
    begins = [(" *+".join(map(re.escape, head)), ".*") for turn in turns if (head := _head(turn))]
    begins += [(word.upper(), " *+=?+ *+[-+]?+ *+[0.]*+") for word in {*words, *order} if word.isalpha()]
    for name, steps in make.sent():
        for step in steps if name not in ("turn_to", "turn_at") else ():
            text = _filled(step.send, settings)
            if why := _may_move(name, step, text, begins):
                raise FormatError(f"{make.name}: {name} {why} {(text or step.raw)[:60]!r}; {AGAIN}")
    return make


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
    reported = MODAL.sub("", text + step.raw).upper()
    if name not in ("home", "stop"):  # which may go to zero, or at a rate of zero
        reported = reported.replace("0", "1")
    if any(re.search(rf"(?<![A-Z]){word}{before}[1-9]", reported, re.DOTALL) for word, before in begins):
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


def require_travel(table: Description, make: Make, number: Controller, values: Mapping[int, float]) -> None:
    """TableLimit where the controller counts in inches, or an axis may turn beyond its travel; number: of each setting; values: by these.

    A GRBL that homes ($22) has all its travel ($130 and on) below 0: its switch is at 0, or at the other end with $23, and behind
    homing it rests by $27 next to it.  A turn to the other side of 0 drives through the switch: an alarm with $21, nothing at all without.
    """
    if values.get(number.inches):
        raise TableLimit(f"{table.name}: its controller has angles in inches: set ${number.inches} to 0; nothing was moved")
    if int(values.get(number.homes, 0)) & (HOMES | ZERO_THERE) != HOMES:
        return
    pulloff, sense = values.get(number.pulloff, 0.0), int(values.get(number.sense, 0))
    for axis in table.axes:
        place = make.states.order.index(axis.word)
        if (travel := values.get(number.travel + place)) is None:
            continue
        ends = (pulloff - travel, 0.0) if sense >> place & 1 else (-travel, -pulloff)
        least, most = sorted(end / make.settings["per_deg"] + 0.0 for end in ends)  # no -0
        if axis.is_endless:
            if stops := [each for each in (number.soft, number.hard) if values.get(each)]:
                why = f"turns without end by table.toml, and ${stops[0]} stops it at {least:g} and {most:g} deg"
                raise TableLimit(f"{table.name}: {axis.name} {why}; set it to 0, or give limits; nothing was moved")
        elif axis.least_rad / DEG < least - WITHIN_DEG or axis.most_rad / DEG > most + WITHIN_DEG:
            allowed = f"{least:g} to {most:g} by its controller (${number.travel + place}, ${number.pulloff}, ${number.sense})"
            raise TableLimit(
                f"{table.name}: {axis.name} may turn from {axis.limits} by table.toml, and from {allowed}: beyond is its switch, or "
                "nothing that stops it; correct least_deg and most_deg, or these settings; nothing was moved"
            )


# What is sent.


def request_text(step: Step, settings: Mapping[str, Any], word: str, axis: int, angle_rad: float, rate_rps: float) -> str:
    """A request with its values filled in, without the end of its line."""
    if step.raw:
        return step.raw
    decimals, signed = int(settings["decimals"]), rate_rps / DEG * settings["rate_per_dps"]
    values = {
        "word": word,
        "axis": axis + 1,
        "angle": f"{angle_rad / DEG * settings['per_deg']:.{decimals}f}",
        "rate": f"{abs(signed):.{decimals}f}",
        "signed_rate": f"{signed * math.copysign(1.0, settings['per_deg']):.{decimals}f}",
    }
    return _filled(step.send, {**settings, **values})


def example(table: Description, make: Make) -> list[tuple[str, str]]:
    """All that would be sent, and when, in this order: to compare with a manual before anything moves.  Turns with an example's numbers."""
    rows = []
    for name, steps in make.sent():
        if name in ("turn_to", "turn_at"):
            for number, axis in enumerate(table.axes if steps else ()):
                angle = min(30 * DEG, axis.most_rad)
                rate = min(10 * DEG, axis.fastest_rps)
                what = f"{axis.name} {f'to {angle / DEG:g} deg ' if name == 'turn_to' else ''}at {rate / DEG:g} dps"
                rows.append((what, sent_text(table, make, steps, number, angle, rate)))
        elif steps:
            harder = name == "stop" and any(what == WHEN["stop"] for what, _ in rows)
            rows.append((f"{WHEN[name]}{', harder' * harder}", sent_text(table, make, steps)))
    return rows


#: when requests are sent, for a reader
WHEN = {
    "where": "where it is",
    "controller": "its own settings, before a plan",
    "begin": "the first motion, before it",
    "home": "homing",
    "ask": "whether it takes a motion",
    "stop": "stop",
    "clear": "clear",
}


def sent_text(table: Description, make: Make, steps: tuple[Step, ...], axis: int = 0, angle_rad: float = 0.0, rate_rps: float = 0.0) -> str:
    """Requests as they would be sent, on one line."""
    texts = [
        request_text(step, make.settings, table.axes[number].word, number, angle_rad, rate_rps)
        for step in steps
        for number in step.axes(len(table.axes), axis)
    ]
    return "; ".join(text if text.isprintable() else repr(text) for text in texts)
