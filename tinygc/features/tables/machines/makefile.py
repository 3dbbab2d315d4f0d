"""A make as data: ``makes/<name>.toml``, or a file of one's own (docs/formats/tables.md).

Patterns are no regular expressions but texts with fields, so that no file can make its reader wait, and no one needs to know the syntax:

    <{state}|MPos:{angles}|*>      a state, angles with commas between, and anything behind them

A space stands for any number of spaces, ``*`` for anything.  Lines longer than ``LONGEST_LINE`` are cut.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from session.base.errors import FormatError
from session.base.files import MOST_TOML, read_bytes
from session.base.records import DERIVED, Key, record_from, record_of
from session.base.results import MapOf, Mismatch, Number, Shape, Text, shown
from session.base.toml import toml_of
from tinygc.features.tables.machines.description import AGAIN, Settings

#: characters of a line that are looked at, and of a request
LONGEST_LINE = 200
#: characters and wildcards of a pattern: a line is tried in at most so many ways as its length to this power
LONGEST_PATTERN, MOST_WILDCARDS = 120, 3
#: of a list
MOST_PATTERNS = MOST_STEPS = 20
PLACE = re.compile(r"\{(\w*)\}")
#: of a code without words
UNKNOWN = "a code that the make's file does not know"
_NUMBER = r"[-+]?\d{1,15}(?:\.\d{0,15})?(?:[eE][-+]?\d{1,3})?"
FIELDS = {
    **dict.fromkeys(("angle", "count", "rate", "clock"), _NUMBER),
    "angles": rf"{_NUMBER}(?:,{_NUMBER}){{0,5}}",
    **dict.fromkeys(("state", "code", "fault"), r"[-+A-Za-z0-9_:.]{1,40}"),
    "word": r"[A-Za-z0-9_]{1,20}",
}
#: what a request may hold in braces, next to the make's settings
VALUES = ("word", "axis", "angle", "rate", "signed_rate")


class Pattern:
    """A line with fields; ``word``: where the word of an axis stands, it must be that one."""

    def __init__(self, text: str):
        self.text, self.fields = text, frozenset(PLACE.findall(text))
        self._compiled: dict[str, re.Pattern[str]] = {}

    def match(self, line: str, word: str = "") -> dict[str, str] | None:
        """Its fields in a line, or None."""
        if word not in self._compiled:
            parts = []
            for part in re.split(r"(\{\w+\}|\*| +)", self.text):
                if part == "*":
                    parts.append(".*")
                elif part.startswith("{"):
                    name = part[1:-1]
                    parts.append(re.escape(word) if name == "word" and word else f"(?P<{name}>(?>{FIELDS[name]}))")
                else:
                    parts.append(" *+" if part.isspace() else re.escape(part))
            self._compiled[word] = re.compile("".join(parts))
        found = self._compiled[word].fullmatch(line[:LONGEST_LINE])
        return None if found is None else found.groupdict()


def matched(patterns: Iterable[Pattern], line: str, word: str = "") -> dict[str, str] | None:
    """The fields of the first pattern that a line has, or None."""
    return next((found for pattern in patterns if (found := pattern.match(line, word)) is not None), None)


class _Patterns(Shape):
    expected = f"a list of at most {MOST_PATTERNS} texts"

    def check(self, value: object, where: str) -> None:
        if not isinstance(value, list) or len(value) > MOST_PATTERNS or not all(isinstance(text, str) for text in value):
            self.refuse(value, where)
        for number, text in enumerate(value):
            names, rest = PLACE.findall(text), PLACE.sub("", text)
            if not 0 < len(text) <= LONGEST_PATTERN or rest.count("*") > MOST_WILDCARDS:
                raise Mismatch(
                    f"{where}[{number}] is {shown(text)}, expected 1 to {LONGEST_PATTERN} characters and at most {MOST_WILDCARDS} *"
                )
            if set(names) - set(FIELDS) or len(set(names)) < len(names) or set(rest) & set("{}"):
                known = ", ".join(f"{{{name}}}" for name in FIELDS)
                raise Mismatch(f"{where}[{number}] is {shown(text)}, expected fields among {known}, each once")

    def made(self, value: list[str]) -> tuple[Pattern, ...]:
        """The patterns."""
        return tuple(map(Pattern, value))


Patterns = Annotated[tuple[Pattern, ...], _Patterns()]
Words = Annotated[Mapping[str, str], MapOf(Text())]


@dataclass(frozen=True)
class Step:
    """One request: ``send``, a line; or ``raw``, bytes without an end.

    answers: lines of which one must come; later: its acknowledgement comes when the motion ends; each: for every axis; pause_s: wait after
    it; unanswered: no acknowledgement comes; states: of a stop, those that it ends (``Dialogue.stop``).
    """

    send: str = ""
    raw: str = ""
    answers: Patterns = ()
    later: bool = False
    each: bool = False
    pause_s: Annotated[float, Number(0, 10)] = 0.0
    unanswered: bool = False
    states: tuple[str, ...] = ()

    def axes(self, count: int, axis: int = 0) -> Sequence[int]:
        """Numbers of the axes, of so many, that it is sent for; axis: the one that turns."""
        return range(count) if self.each else (axis,)

    @staticmethod
    def fault(step: Mapping) -> str:
        """What is wrong with a table of sound keys; empty where nothing is."""
        return "needs send or raw, and not both" if ("send" in step) == ("raw" in step) else ""


class _Steps(Shape):
    expected = "a list of requests: texts, or tables with send or raw"

    def check(self, value: object, where: str) -> None:
        if not isinstance(value, list) or len(value) > MOST_STEPS:
            self.refuse(value, where)
        for number, step in enumerate(value):
            if not isinstance(step, str):
                record_of(Step).check(step, f"{where}[{number}]")

    def made(self, value: list) -> tuple[Step, ...]:
        return tuple(Step(step) if isinstance(step, str) else record_of(Step).made(step) for step in value)


Steps = Annotated[tuple[Step, ...], _Steps()]


@dataclass(frozen=True)
class Line:
    """What ends a request, and answers; lines that acknowledge a request, and that greet behind a restart."""

    end: str = "\n"
    prompt: str = ""
    done: Patterns = ()
    greeting: Patterns = ()


@dataclass(frozen=True)
class Requests:
    """What is sent, and when; turn_at: none where it has no rate mode; stop: each harder than the one before."""

    turn_to: Steps
    where: Steps
    stop: tuple[Steps, ...]
    begin: Steps = ()
    home: Steps = ()
    turn_at: Steps = ()
    clear: Steps = ()


@dataclass(frozen=True)
class States:
    """order: words of the axes whose angles come with commas; words of {state}; faults: those that are one, and their meaning; silent: what
    it may mean that it answers nothing."""

    order: str = ""
    moving: tuple[str, ...] = ()
    rest: tuple[str, ...] = ()
    faults: Words = field(default_factory=dict)
    silent: str = ""


@dataclass(frozen=True)
class Messages:
    """Lines that state that something is wrong, and what each code means."""

    patterns: Annotated[Patterns, Key("lines")] = ()
    words: Words = field(default_factory=dict)

    def meaning(self, line: str) -> str | None:
        """What a line means; None where it shows nothing of the kind."""
        if (found := matched(self.patterns, line)) is None:
            return None
        code = found.get("code", "")
        return self.words.get(code, UNKNOWN if code else "")


SettingNumber = Annotated[int, Number(0, 1000, whole=True)]


@dataclass(frozen=True)
class Controller:
    """A question for a controller's own settings, and the numbers of those that ``proof.require_travel`` reads."""

    ask: Steps
    inches: SettingNumber
    soft: SettingNumber
    hard: SettingNumber
    homes: SettingNumber
    sense: SettingNumber
    pulloff: SettingNumber
    travel: SettingNumber


@dataclass(frozen=True)
class Errors:
    """ask: after each motion, its {code} is checked; none: codes and faults that mean no error."""

    ask: Steps = ()
    none: tuple[str, ...] = ("0",)


@dataclass(frozen=True)
class Make:
    """How a make is spoken to (docs/formats/tables.md names every key); warning: what whoever lets it move must know.

    settings: as a table has them, once it is ``proof.fitted`` to one; sha256: of its file, in hexadecimal.
    """

    schema: ClassVar[str] = "tinygc-make/1"
    title: str
    requests: Requests
    source: str = ""
    unchecked: str = ""
    warning: str = ""
    baud: Annotated[int, Number(1, 1e8, whole=True)] = 115200
    most_axes: Annotated[int, Number(1, 3, whole=True)] = 3
    settings: Annotated[Mapping[str, Any], Settings()] = field(default_factory=dict)
    line: Line = field(default_factory=Line)
    states: States = field(default_factory=States)
    refused: Messages = field(default_factory=Messages)
    alarms: Messages = field(default_factory=Messages)
    controller: Controller | None = None
    errors: Errors = field(default_factory=Errors)
    name: Annotated[str, DERIVED] = ""
    sha256: Annotated[str, DERIVED] = ""

    def sent(self) -> Iterator[tuple[str, tuple[Step, ...]]]:
        """All that it can send: key of its file and requests, in the order in which they are sent."""
        of = self.requests
        yield "where", of.where
        yield "controller", () if self.controller is None else self.controller.ask
        yield from (("begin", of.begin), ("home", of.home), ("turn_to", of.turn_to), ("turn_at", of.turn_at), ("ask", self.errors.ask))
        yield from (("stop", steps) for steps in of.stop)
        yield "clear", of.clear


def read_make(path: Path) -> Make:
    """Read a make's file.  Raises FormatError for what is wrong with it."""
    data = read_bytes(path, MOST_TOML)
    make = record_from(Make, toml_of(data, path), str(path), AGAIN)
    make = replace(make, name=path.stem, sha256=hashlib.sha256(data).hexdigest(), settings={**Settings.usual, **make.settings})
    of = make.requests
    for name, steps in make.sent():
        for step in steps:
            if wrong := _unsendable(step, make.settings):
                raise FormatError(f"{path}: {name}: {wrong}; {AGAIN}")
    if make.controller is not None and (not make.states.order or not make.line.done):
        raise FormatError(f"{path}: controller needs states.order and line.done; {AGAIN}")
    fields = {name for step in of.where for pattern in step.answers for name in pattern.fields}
    if not fields & {"angle", "angles", "count"} or not of.stop or not of.turn_to:
        raise FormatError(
            f"{path}: requests needs stop, turn_to, and a where whose answers hold {{angle}}, {{angles}} or {{count}}; {AGAIN}"
        )
    if not all(of.stop) or all(step.states for step in of.stop[-1]):
        raise FormatError(f"{path}: requests.stop has an empty list, or a hardest without a request that has no states; {AGAIN}")
    for step in of.where if make.most_axes > 1 else ():
        one_angle = any({"angle", "count"} & pattern.fields for pattern in step.answers)
        if one_angle and not step.each and not all("word" in pattern.fields for pattern in step.answers):
            raise FormatError(f"{path}: {step.send!r} is answered with one angle: add each = true, or {{word}} to its answers; {AGAIN}")
    return make


def _unsendable(step: Step, settings: Mapping[str, object]) -> str:
    """What is wrong with a request; empty where nothing is."""
    text = step.send + step.raw
    if unknown := [name for name in PLACE.findall(step.send) if name not in VALUES and name not in settings]:
        return f"{text[:60]!r} has {{{unknown[0]}}}, expected one of {', '.join((*VALUES, *settings))}"
    if len(text) > LONGEST_LINE:
        return f"{text[:60]!r}… has more than {LONGEST_LINE} characters"
    if any(ord(character) > 255 for character in text):
        return f"{text[:60]!r} holds more than one byte a character"
    return ""
