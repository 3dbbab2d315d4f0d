"""A make as data: ``makes/<name>.toml``, or a file of one's own (docs/formats/tables.md).

Patterns are no regular expressions but texts with fields, so that no file can make its reader wait, and nobody need know the syntax:

    <{state}|MPos:{angles}|*>      a state, angles with commas between, and anything behind them

A space stands for any number of spaces, ``*`` for anything.  Lines longer than ``LONGEST_LINE`` are cut.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from session.base.errors import FormatError
from session.base.files import MOST_TOML, read_bytes
from session.base.results import Flag, Keys, ListOf, MapOf, Mismatch, Number, Shape, Text, require, shown
from session.base.toml import toml_of

SCHEMA = "tinygc-make/1"
FOLDER = Path(__file__).parent / "makes"
AGAIN = "correct the file (docs/formats/tables.md)"
#: characters of a line that are looked at, and of a request
LONGEST_LINE = 200
#: characters and wildcards of a pattern: a line is tried in at most so many ways as its length to this power
LONGEST_PATTERN, MOST_WILDCARDS = 120, 3
#: of a list
MOST_PATTERNS = 20
_NUMBER = r"[-+]?\d{1,15}(?:\.\d{0,15})?(?:[eE][-+]?\d{1,3})?"
FIELDS = {
    **dict.fromkeys(("angle", "count", "rate", "clock"), _NUMBER),
    "angles": rf"{_NUMBER}(?:,{_NUMBER}){{0,5}}",
    **dict.fromkeys(("state", "code", "fault"), r"[-+A-Za-z0-9_:.]{1,40}"),
    "word": r"[A-Za-z0-9_]{1,20}",
}
#: what a request may hold in braces, besides the make's settings
VALUES = ("word", "axis", "angle", "rate", "signed_rate")


class Pattern:
    """A line with fields; ``word``: where the word of an axis stands, it must be that one."""

    def __init__(self, text: str):
        self.text = text
        self._compiled: dict[str, re.Pattern[str]] = {}

    @property
    def names_an_axis(self) -> bool:
        """Whether it is of one axis."""
        return "{word}" in self.text

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


class _Patterns(Shape):
    expected = f"a list of at most {MOST_PATTERNS} texts"

    def check(self, value: object, where: str) -> None:
        if not isinstance(value, list) or len(value) > MOST_PATTERNS or not all(isinstance(text, str) for text in value):
            self.refuse(value, where)
        for number, text in enumerate(value):
            names, rest = re.findall(r"\{(\w*)\}", text), re.sub(r"\{\w*\}", "", text)
            if not 0 < len(text) <= LONGEST_PATTERN or rest.count("*") > MOST_WILDCARDS:
                raise Mismatch(
                    f"{where}[{number}] is {shown(text)}, expected 1 to {LONGEST_PATTERN} characters and at most {MOST_WILDCARDS} *"
                )
            if set(names) - set(FIELDS) or len(set(names)) < len(names) or set(rest) & set("{}"):
                known = ", ".join(f"{{{name}}}" for name in FIELDS)
                raise Mismatch(f"{where}[{number}] is {shown(text)}, expected fields among {known}, each once")


@dataclass(frozen=True)
class Step:
    """One request: ``send``, a line; or ``raw``, bytes without an end.

    answers: lines of which one must come; later: its acknowledgement comes when the motion ends; each: for every axis; pause_s: wait after
    it; unanswered: no acknowledgement comes; states: of a stop, those that it ends (``Dialogue.stop``).
    """

    send: str = ""
    raw: str = ""
    answers: tuple[Pattern, ...] = ()
    later: bool = False
    each: bool = False
    pause_s: float = 0.0
    unanswered: bool = False
    states: tuple[str, ...] = ()


@dataclass(frozen=True)
class Messages:
    """Lines that say that something is wrong, and what each code means."""

    patterns: tuple[Pattern, ...] = ()
    words: Mapping[str, str] = field(default_factory=dict)

    def meaning(self, line: str) -> str | None:
        """What a line says; None where it says nothing of the kind."""
        for pattern in self.patterns:
            if (found := pattern.match(line)) is not None:
                code = found.get("code", "")
                return self.words.get(code, "a code that the make's file does not know" if code else "")
        return None


@dataclass(frozen=True)
class Make:
    """How a make is spoken to (docs/formats/tables.md names every key)."""

    name: str
    title: str
    source: str
    unchecked: str
    warning: str  #: what whoever lets it move must know
    baud: int
    most_axes: int
    settings: Mapping[str, float | str | bool]
    end: str
    prompt: str
    done: tuple[Pattern, ...]
    greeting: tuple[Pattern, ...]
    begin: tuple[Step, ...]
    home: tuple[Step, ...]
    turn_to: tuple[Step, ...]
    turn_at: tuple[Step, ...]  #: none: it has no rate mode
    stop: tuple[tuple[Step, ...], ...]  #: each harder than the one before
    clear: tuple[Step, ...]
    where: tuple[Step, ...]
    order: str  #: words of the axes whose angles come with commas
    moving: tuple[str, ...]
    rest: tuple[str, ...]
    states: Mapping[str, str]  #: states that are faults, and what they mean
    silent: str  #: what it may mean that it answers nothing
    refused: Messages
    alarms: Messages
    controller: tuple[Step, ...]  #: asks its own settings
    numbers: Mapping[str, int]  #: of these settings, by what they are (``travel``)
    errors: Step | None  #: asked after each motion; its {code} is checked
    none: tuple[str, ...]  #: codes and faults that mean no error
    sha256: str  #: of its file, in hexadecimal

    def requests(self) -> Iterator[tuple[str, tuple[Step, ...]]]:
        """All that it can send: key of its file and requests, in the order in which they are sent."""
        for name in ("where", "controller", "begin", "home", "turn_to", "turn_at"):
            yield name, getattr(self, name)
        yield "ask", () if self.errors is None else (self.errors,)
        yield from (("stop", steps) for steps in self.stop)
        yield "clear", self.clear


PATTERNS = _Patterns()
_STEP = Keys(
    {},
    {
        "send": Text(),
        "raw": Text(),
        "answers": PATTERNS,
        "later": Flag(),
        "each": Flag(),
        "pause_s": Number(0, 10),
        "unanswered": Flag(),
        "states": ListOf(Text()),
    },
)


class _Steps(Shape):
    expected = "a list of requests: texts, or tables with send or raw"

    def check(self, value: object, where: str) -> None:
        if not isinstance(value, list) or len(value) > 20:
            self.refuse(value, where)
        for number, step in enumerate(value):
            if isinstance(step, str):
                continue
            _STEP.check(step, f"{where}[{number}]")
            if ("send" in step) == ("raw" in step):
                raise Mismatch(f"{where}[{number}] needs send or raw, and not both")


#: settings of a controller, by what they are
NUMBERS = ("inches", "soft", "hard", "homes", "sense", "pulloff", "travel")
_MESSAGES = Keys({}, {"lines": PATTERNS, "words": MapOf(Text())})
SHAPE = Keys(
    {
        "schema": Text((SCHEMA,)),
        "title": Text(),
        "requests": Keys(
            {"turn_to": _Steps(), "where": _Steps(), "stop": ListOf(_Steps())},
            {"begin": _Steps(), "home": _Steps(), "turn_at": _Steps(), "clear": _Steps()},
        ),
    },
    {
        "source": Text(),
        "unchecked": Text(),
        "warning": Text(),
        "baud": Number(1, 1e8, whole=True),
        "most_axes": Number(1, 3, whole=True),
        "settings": Keys(),
        "line": Keys({}, {"end": Text(), "prompt": Text(), "done": PATTERNS, "greeting": PATTERNS}),
        "states": Keys({}, {"order": Text(), "moving": ListOf(Text()), "rest": ListOf(Text()), "faults": MapOf(Text()), "silent": Text()}),
        "refused": _MESSAGES,
        "alarms": _MESSAGES,
        "controller": Keys({"ask": _Steps(), **dict.fromkeys(NUMBERS, Number(0, 1000, whole=True))}),
        "errors": Keys({}, {"ask": _Steps(), "none": ListOf(Text())}),
    },
)
#: settings of every make, and what they are where neither its file nor table.toml says otherwise
SETTINGS: Mapping[str, float | str | bool] = {
    "per_deg": 1.0,  # units of an angle, in requests and answers, per degree
    "rate_per_dps": 1.0,  # units of a rate per degree per second
    "count_per_deg": 1.0,  # of a {count} that is answered
    "decimals": 4,  # of numbers that are sent
    "open_s": 0.0,  # until it listens, after its port was opened
    "answer_s": 2.0,  # the longest that it takes to answer
    "home_s": 180.0,  # the longest that homing takes
    "rest_dps": 0.01,  # a {rate} below it is rest
    "same_s": 0.4,  # angles that stay for so long are rest, where nothing else says so
    "clock_per_s": 1.0,  # units of a {clock} per second
    "latency_s": 0.0,  # by which the angles in table.csv are late; nothing is sent differently
    "visa": "",  # PyVISA's library, as @py
}


def make_names() -> list[str]:
    """The makes that come with the tool as files."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def read_make(path: Path) -> Make:
    """Read a make's file.  Raises FormatError for what is wrong with it."""
    data = read_bytes(path, MOST_TOML)
    table = toml_of(data, path)
    require(table, SHAPE, str(path), AGAIN)
    line, requests, states = table.get("line", {}), table["requests"], table.get("states", {})
    settings = {**SETTINGS, **table.get("settings", {})}
    require_settings(settings, f"{path}: settings")

    def steps(name: str, given: Mapping = requests) -> tuple[Step, ...]:
        return tuple(_step(step, settings, f"{path}: {name}") for step in given.get(name, []))

    errors = steps("ask", table.get("errors", {}))
    make = Make(
        name=path.stem,
        title=table["title"],
        source=table.get("source", ""),
        unchecked=table.get("unchecked", ""),
        warning=table.get("warning", ""),
        baud=table.get("baud", 115200),
        most_axes=table.get("most_axes", 3),
        settings=settings,
        end=line.get("end", "\n"),
        prompt=line.get("prompt", ""),
        done=_patterns(line.get("done", [])),
        greeting=_patterns(line.get("greeting", [])),
        begin=steps("begin"),
        home=steps("home"),
        turn_to=steps("turn_to"),
        turn_at=steps("turn_at"),
        stop=tuple(tuple(_step(step, settings, f"{path}: stop") for step in harder) for harder in requests["stop"]),
        clear=steps("clear"),
        where=steps("where"),
        order=states.get("order", ""),
        moving=tuple(states.get("moving", [])),
        rest=tuple(states.get("rest", [])),
        states=states.get("faults", {}),
        silent=states.get("silent", ""),
        refused=_messages(table.get("refused", {})),
        alarms=_messages(table.get("alarms", {})),
        controller=steps("ask", table.get("controller", {})),
        numbers={name: number for name, number in table.get("controller", {}).items() if name in NUMBERS},
        errors=errors[0] if errors else None,
        none=tuple(table.get("errors", {}).get("none", ["0"])),
        sha256=hashlib.sha256(data).hexdigest(),
    )
    if make.controller and (not make.order or not make.done):
        raise FormatError(f"{path}: controller needs states.order and line.done; {AGAIN}")
    fields = {name for step in make.where for pattern in step.answers for name in re.findall(r"\{(\w+)\}", pattern.text)}
    if not fields & {"angle", "angles", "count"} or not make.stop or not make.turn_to:
        raise FormatError(
            f"{path}: requests needs stop, turn_to, and a where whose answers hold {{angle}}, {{angles}} or {{count}}; {AGAIN}"
        )
    if not all(make.stop) or all(step.states for step in make.stop[-1]):
        raise FormatError(f"{path}: requests.stop has an empty list, or a hardest without a request that has no states; {AGAIN}")
    for step in make.where if make.most_axes > 1 else ():
        one_angle = any("{angle}" in pattern.text or "{count}" in pattern.text for pattern in step.answers)
        if one_angle and not step.each and not all(pattern.names_an_axis for pattern in step.answers):
            raise FormatError(f"{path}: {step.send!r} is answered with one angle: add each = true, or {{word}} to its answers; {AGAIN}")
    return make


def require_settings(settings: Mapping[str, object], where: str, known: Mapping[str, object] | None = None) -> None:
    """FormatError for a setting of the wrong kind, or, where they are given, that is not among the known."""
    for name, value in settings.items():
        if known is not None and name not in known:
            raise FormatError(f"{where}.{name[:40]}: this make has no such setting; it has {', '.join(known)}; {AGAIN}")
        if name in SETTINGS and name not in ("visa",):
            sound = isinstance(value, int | float) and not isinstance(value, bool) and 0 < abs(value) < 1e9
            if not sound and not (name in ("decimals", "open_s", "latency_s") and value == 0):
                raise FormatError(f"{where}.{name} is {shown(value)}, expected a number that is not 0; {AGAIN}")
            if name == "decimals" and not (isinstance(value, int) and 0 <= value <= 9):
                raise FormatError(f"{where}.decimals is {shown(value)}, expected a whole number from 0 to 9; {AGAIN}")
        elif not isinstance(value, int | float | str) or (isinstance(value, str) and not value.isprintable()):
            kinds = "a number, a text without control characters, true or false"
            raise FormatError(f"{where}.{name[:40]} is {shown(value)}, expected {kinds}; {AGAIN}")


def _patterns(texts: list[str]) -> tuple[Pattern, ...]:
    return tuple(Pattern(text) for text in texts)


def _messages(table: Mapping) -> Messages:
    return Messages(_patterns(table.get("lines", [])), table.get("words", {}))


def _step(step: str | Mapping, settings: Mapping[str, object], where: str) -> Step:
    found = (
        Step(send=step)
        if isinstance(step, str)
        else Step(
            step.get("send", ""),
            step.get("raw", ""),
            _patterns(step.get("answers", [])),
            step.get("later", False),
            step.get("each", False),
            float(step.get("pause_s", 0.0)),
            step.get("unanswered", False),
            tuple(step.get("states", [])),
        )
    )
    unknown = [name for name in re.findall(r"\{(\w*)\}", found.send) if name not in VALUES and name not in settings]
    if unknown:
        raise FormatError(f"{where}: {found.send[:60]!r} has {{{unknown[0]}}}, expected one of {', '.join((*VALUES, *settings))}; {AGAIN}")
    if len(found.send + found.raw) > LONGEST_LINE:
        raise FormatError(f"{where}: {(found.send or found.raw)[:60]!r}… has more than {LONGEST_LINE} characters; {AGAIN}")
    if any(ord(character) > 255 for character in found.send + found.raw):
        raise FormatError(f"{where}: {(found.send or found.raw)[:60]!r} holds more than one byte a character; {AGAIN}")
    return found
