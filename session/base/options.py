"""Options, each declared once: a field of a frozen record, which states its meaning, unit, bounds and flag.

    @dataclass(frozen=True)
    class SearchOptions(Record):
        folds: int = option(5, "folds of the held-out closure", least=2)
        earth: bool = option(True, "leave the Earth's rotation in the rates")

Read from the fields are the command line (``add_arguments``, ``from_arguments``), the check of a record that Python code makes
(``check``), the keywords of a public function with their documentation (``keywords``, ``documented``), and the tables of the pages
(docs/make_options.py).  Imports nothing heavy.

A field's type decides how its text is read: ``bool`` is a flag, and with True as its default ``--no-…``; ``tuple[int, ...]`` and
``tuple[str, ...]`` are lists with commas; ``tuple[float, float, float]`` are three words; None is allowed where the type has it.
"""

from __future__ import annotations

import argparse
import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from difflib import get_close_matches
from functools import partial
from math import isfinite
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from session.base.errors import CalibrationError

R = TypeVar("R")


@dataclass(frozen=True)
class Rule:
    """What a field states in addition to its name, type and default.

    help: its meaning, as ``--help`` and the pages have it; off: that of ``--no-…``, of a field that is True by default; unit;
    choices: the values there are; some: the words of a list; least, most, above: bounds of each number; metavar: its value in
    ``--help``; group: heading in ``--help``; flags: in place of the field's name; positional; repeated: given once for each value;
    several: one flag, and all words behind it; example: of a text; alone: value of a flag without one; read: parser of its text; cli:
    whether the command line has it; default_key: of the user's defaults file; rare: whether only ``--help-all`` shows it.
    """

    help: str
    off: str = ""
    unit: str = ""
    choices: tuple[Any, ...] = ()
    some: tuple[str, ...] = ()
    least: float | None = None
    most: float | None = None
    above: float | None = None
    metavar: str = ""
    group: str = ""
    flags: tuple[str, ...] = ()
    positional: bool = False
    repeated: bool = False
    several: bool = False
    example: str = ""
    alone: Any = None
    read: Callable[[str], Any] | None = None
    cli: bool = True
    default_key: str = ""
    rare: bool = False


def option(default: Any, help: str, **rule: Any) -> Any:
    """A field of a record of options, required where its default is ``...``; rule: fields of ``Rule``."""
    if default is ...:
        return field(kw_only=True, metadata={"rule": Rule(help, **rule)})
    return field(default=default, metadata={"rule": Rule(help, **rule)})


def argument(help: str, default: Any = ..., **rule: Any) -> Any:
    """A positional argument."""
    return option(default, help, positional=True, **rule)


# Paths: a field declares by ``read=`` whether the command reads or writes there, so that no output replaces an input.


def _path(text: str) -> Path:
    """Parse a file or folder.  An empty path is refused: it would be the current folder, from an unset shell variable."""
    if not text.strip():
        raise argparse.ArgumentTypeError("an empty name; give a file or folder (. for this one)")
    return Path(text)


def path_read(text: str) -> Path:
    """Argument type: a file or folder that the command reads."""
    return _path(text)


def file_written(text: str) -> Path:
    """Argument type: a file that the command writes."""
    return _path(text)


def log_written(text: str) -> Path:
    """Argument type: a log that the command writes; a new one may lie in a session folder."""
    return _path(text)


def folder_written(text: str) -> Path:
    """Argument type: a folder that the command writes files into; the name of a picture, a page or a table is refused."""
    if (folder := _path(text)).suffix.lower() in (".html", ".json", ".png", ".svg"):
        raise argparse.ArgumentTypeError(f"{text} is the name of a file; give a folder, which several files go into")
    return folder


for _type in (path_read, file_written, log_written, folder_written):
    _type.__name__ = "path"  # for argparse's message "invalid path value"


class OptionError(CalibrationError):
    """A value outside of what its field declares."""

    #: of the field
    name = ""

    @classmethod
    def of(cls, name: str, value: Any, expected: str) -> OptionError:
        """An error of a field, its value, and what was expected."""
        error = cls(f"{name} is {value!r:.80}, expected {expected}")
        error.name = name
        return error


class Record:
    """A record of options whose fields are checked when it is made; ``expect`` is for what several fields decide together."""

    #: begins the flags of all its fields
    PREFIX = ""
    #: heading of options that only ``--help-all`` shows
    RARE = ""

    def __post_init__(self) -> None:
        """Check each field by what it declares."""
        check(self)

    def expect(self, fine: bool, name: str, expected: str) -> None:
        """Raise OptionError for a field unless it is fine."""
        if not fine:
            raise OptionError.of(name, getattr(self, name), expected)


def declared(kind: Any) -> Iterator[tuple[Field[Any], Rule]]:
    """Yield the options of a record, those of its own class before those of its bases."""
    known = {each.name: each for each in fields(kind)}
    for base in (kind if isinstance(kind, type) else type(kind)).__mro__:
        for name in inspect.get_annotations(base):
            if (each := known.pop(name, None)) is not None and "rule" in each.metadata:
                yield each, each.metadata["rule"]


def flag(kind: Any, name: str) -> str:
    """The flag of a field, as it is typed; the name of a positional argument."""
    each = next(each for each in fields(kind) if each.name == name)
    rule: Rule = each.metadata["rule"]
    if rule.positional:
        return name
    return rule.flags[-1] if rule.flags else ("--no-" if each.default is True else "--") + kind.PREFIX + name.replace("_", "-")


# Values


def _kind(each: Field[Any]) -> str:
    # text in a module with ``from __future__ import annotations``, else a type
    word = each.type if isinstance(each.type, str) else getattr(each.type, "__name__", str(each.type))
    return re.sub(r"\bpathlib\.(\w+\.)?", "", word).removesuffix(" | None")


def _one(kind: str, value: Any) -> Any:
    """The value as one of a kind; ValueError for another."""
    if kind == "Path":
        if isinstance(value, PathLike) or (isinstance(value, str) and value.strip() and "\0" not in value):
            return value if isinstance(value, Path) else Path(value)  # OWN_PLACE is known by its identity
    elif kind == "bool":
        if isinstance(value, bool):
            return value
    elif kind == "int":
        if isinstance(value, Integral) and not isinstance(value, bool):
            return int(value)
    elif kind == "float":
        if isinstance(value, Real) and not isinstance(value, bool) and isfinite(value):
            return value
    elif kind != "str" or isinstance(value, str):
        return value
    raise ValueError


def suited(each: Field[Any], rule: Rule, value: Any) -> Any:
    """The value of a field, as its type has it; ValueError for one outside of what it declares."""
    kind = _kind(each)
    if kind.startswith("tuple["):
        kinds = kind[6:-1].split(", ")
        alone = isinstance(value, str | PathLike | Real)
        values = (value,) if alone else tuple(value)
        if kinds[-1] != "..." and len(values) != len(kinds):
            raise ValueError
        values = value = tuple(_one(kinds[0], each) for each in values)
        if kind == "tuple[int, ...]":
            values = value = tuple(dict.fromkeys(values))
        if rule.some and not (values and set(values) <= set(rule.some)):
            raise ValueError
    else:
        value = _one(kind, value)
        values = (value,)
    if rule.choices and value not in rule.choices:
        raise ValueError
    for number in values:
        if (
            (rule.least is not None and number < rule.least)
            or (rule.most is not None and number > rule.most)
            or (rule.above is not None and number <= rule.above)
        ):
            raise ValueError
    return value


#: one and several values of a kind
WORDS = {
    "bool": ("True or False", ""),
    "int": ("a whole number", "whole numbers"),
    "float": ("a number", "numbers"),
    "str": ("text", "words"),
    "Path": ("a path", "paths"),
}


def expected(each: Field[Any], rule: Rule) -> str:
    """What a field declares, in words: ``a whole number of 2 or more``."""
    if rule.choices or rule.some:
        return f"{'one' if rule.choices else 'some'} of {', '.join(map(str, rule.choices or rule.some))}"
    kind = _kind(each)
    if kind.startswith("tuple["):
        kinds = kind[6:-1].split(", ")
        words = f"{'a list of' if kinds[-1] == '...' else 'three'} {WORDS.get(kinds[0], ('', 'values'))[1]}"
    else:
        words = WORDS.get(kind, (kind, ""))[0] + (f", as {rule.example}" if rule.example else "")
    unit = f" {rule.unit}" if rule.unit else ""
    if rule.above is not None:
        return f"{words} above {rule.above:g}{unit}" + ("" if rule.most is None else f", at most {rule.most:g}{unit}")
    if rule.least is not None:
        return words + (f" of {rule.least:g} or more{unit}" if rule.most is None else f" from {rule.least:g} to {rule.most:g}{unit}")
    return words + ("" if rule.most is None else f" of at most {rule.most:g}") + unit


def check(record: Any) -> None:
    """Raise OptionError for a field outside of what it declares; texts become paths, and lists tuples, where the type is one."""
    for each, rule in declared(record):
        value = getattr(record, each.name)
        if value is None and (str(each.type).endswith("| None") or each.default is None):
            continue
        try:
            object.__setattr__(record, each.name, suited(each, rule, value))
        except (TypeError, ValueError, OverflowError):
            raise OptionError.of(each.name, value, expected(each, rule)) from None


def values(options: Any, *kinds: type[Any]) -> dict[str, Any]:
    """The fields of records of these kinds, as keywords, out of a record that has them, and more."""
    return {each.name: getattr(options, each.name) for kind in kinds for each in fields(kind)}


def part(options: Any, kind: type[R], **changes: Any) -> R:
    """The record of a kind out of one that has its fields, and more."""
    return kind(**values(options, kind) | changes)


def records(choices: Mapping[str, Any], *kinds: type[Any]) -> tuple[Any, ...]:
    """The record of each kind, of the keywords that are its fields."""
    return tuple(kind(**{name: choices[name] for name in choices if name in kind.__dataclass_fields__}) for kind in kinds)


def given(options: Any, but: tuple[str, ...] = ()) -> list[str]:
    """Flags of the options that differ from their defaults, apart from those of the fields ``but``."""
    found = ((each, each.default) for each, rule in declared(options) if rule.cli and not rule.positional and each.name not in but)
    return [flag(options, each.name) for each, default in found if getattr(options, each.name) != default]


def changed(options: Any) -> dict[str, Any]:
    """Field -> value of the options that differ from their defaults."""
    return {each.name: getattr(options, each.name) for each, _ in declared(options) if getattr(options, each.name) != each.default}


def typed(options: Any, but: Sequence[str] = ()) -> list[str]:
    """The words of a command line that gives these options: those that differ from their defaults, apart from ``but``."""
    words: list[str] = []
    for each, rule in declared(options):
        value = getattr(options, each.name)
        if not rule.cli or each.name in but or value == each.default:
            continue
        several = value if isinstance(value, tuple) else (value,)
        texts = [] if isinstance(value, bool) or value == rule.alone else [_text(one) for one in several]
        commas = isinstance(value, tuple) and rule.read is numbers
        words += [] if rule.positional else [flag(options, each.name)]
        words += [",".join(texts)] if commas else texts
    return words


def _text(value: Any) -> str:
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


def record_in(records: Sequence[Any], kind: type[R]) -> R:
    """Return the record of a kind among several; one of defaults where there is none."""
    return next((each for each in records if isinstance(each, kind)), kind())


def refuse_with(what: str, others: Mapping[str, object], records: Sequence[Any], otherwise: str = "") -> None:
    """Raise CalibrationError for options that do nothing with ``what``: flag -> whether it is given, and all that records have;
    otherwise: what to do instead of leaving them out."""
    idle = [name for name, is_given in others.items() if is_given] + [name for each in records for name in given(each)]
    if idle:
        raise CalibrationError(f"{', '.join(idle)}: of no use with {what}; leave {'it' if len(idle) == 1 else 'them'} out{otherwise}")


# The command line


def meant(word: str, known: Any) -> str:
    """Name the known word that is nearest to a wrong one: ``; is 'fit' meant?``; empty where none is near."""
    plain = {each.lower(): each for each in known}
    # A command has few letters, and one of them is wrong or two have changed places; an option that is merely alike does something else.
    near = get_close_matches(word.lower(), plain, n=1, cutoff=0.8 if word.startswith("--") else 0.6) if word else []
    return f"; is {plain[near[0]]!r} meant?" if near else ""


def _number(text: str) -> float:
    return float(text)


def _whole(text: str) -> int:
    return int(text)


def _number_or_none(read: Callable[[str], Any], text: str) -> Any:
    """Parse the number of an option that may stand alone: a folder behind it would be taken for the number."""
    try:
        return read(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no {read.__name__}; put it before the option, which may stand alone") from None


def _filled(text: str) -> str:
    if not text.strip():
        raise argparse.ArgumentTypeError("an empty name")
    return text


def _words(known: tuple[str, ...], text: str) -> list[str]:
    """Parse names, separated by commas; each once.  Without known ones an empty text is an empty name, which the reader refuses."""
    chosen = [name.strip() for name in text.split(",") if name.strip() or not known]
    for name in chosen:
        if known and name not in known:
            raise argparse.ArgumentTypeError(f"{name!r} is no choice, expected some of {','.join(known)}{meant(name, known)}")
    if not chosen:
        raise argparse.ArgumentTypeError(f"name at least one of {','.join(known)}")
    return list(dict.fromkeys(chosen))


def _whole_numbers(text: str) -> list[int]:
    """Parse numbers of segments, separated by commas."""
    words = [word.strip() for word in text.split(",")]
    if not all(word.isascii() and word.isdigit() and len(word) < 10 for word in words):
        raise argparse.ArgumentTypeError(f"{text!r} is no list of segment numbers such as 3,17")
    return list(map(int, words))


def numbers(text: str) -> tuple[float, ...]:
    """Argument type: numbers, separated by commas."""
    return tuple(float(word) for word in text.split(","))


numbers.__name__ = "list of numbers"
_number.__name__, _whole.__name__, _filled.__name__ = "number", "whole number", "text"
#: type of a field -> parser of its text, or of one of its words
READERS: dict[str, Callable[[str], Any]] = {
    "int": _whole,
    "float": _number,
    "str": _filled,
    "Path": path_read,
    "tuple[int, ...]": _whole_numbers,
    "tuple[Path, ...]": path_read,
    "tuple[float, ...]": numbers,
    "tuple[float, float, float]": _number,
}


def add_arguments(command: argparse.ArgumentParser, kind: Any) -> None:
    """Add an argument for each field of a record that the command line has; what is not given is left out of the namespace."""
    groups: dict[str, Any] = {"": command}
    for each, rule in declared(kind):
        if not rule.cli:
            continue
        if rule.group not in groups:
            groups[rule.group] = command.add_argument_group(rule.group)
        settings: dict[str, Any] = {"default": argparse.SUPPRESS, "help": help_of(each, rule).replace("%", "%%")}
        words = [each.name] if rule.positional else [*rule.flags[:-1], flag(kind, each.name)]
        if not rule.positional:
            settings["dest"] = dest(kind, each.name)
        if _kind(each) == "bool":
            settings["action"] = "store_false" if each.default is True else "store_true"
        else:
            settings |= _value(each, rule)
        groups[rule.group].add_argument(*words, **settings).rare = rule.rare or (rule.group != "" and rule.group == kind.RARE)


def _value(each: Field[Any], rule: Rule) -> dict[str, Any]:
    """How argparse reads the value of a field."""
    kind, required = _kind(each), each.default is MISSING
    settings: dict[str, Any] = {"type": rule.read or (partial(_words, rule.some) if kind == "tuple[str, ...]" else READERS.get(kind))}
    if shown := metavar(each, rule):
        settings["metavar"] = shown
    if rule.choices and kind == "str":
        settings["choices"] = rule.choices
    if rule.positional:
        several = kind.startswith("tuple[")
        settings["nargs"] = ("+" if required else "*") if several else None if required else "?"
        # before Python 3.12 argparse would read its own word for "left out" as the value
        return settings if several or required else settings | {"default": each.default}
    if required:
        settings["required"] = True
    if rule.alone is not None:
        settings |= {"nargs": "?", "const": rule.alone}
        if rule.read is None:
            settings["type"] = partial(_number_or_none, settings["type"])
    elif kind == "tuple[float, float, float]" and rule.read is None:
        settings["nargs"] = 3
    elif rule.several:
        settings["nargs"] = "+"
    elif rule.repeated:
        settings["action"] = "append"
    elif kind == "tuple[int, ...]":
        settings["action"] = "extend"
    return settings


def dest(kind: Any, name: str) -> str:
    """The name of a field in the namespace of the parsed arguments."""
    return kind.PREFIX.replace("-", "_") + name


#: type of a field -> how its value is called where none is declared
METAVARS = {"int": "N", "str": "NAME", "Path": "FILE", "tuple[Path, ...]": "DIR", "tuple[int, ...]": "N,N", "tuple[str, ...]": "A,B"}


def metavar(each: Field[Any], rule: Rule) -> str:
    """How ``--help`` and the pages call a field's value; empty for a flag without one, and for choices that stand there."""
    if rule.metavar or _kind(each) == "bool" or rule.positional:
        return rule.metavar
    if rule.choices and _kind(each) == "str":
        return "|".join(rule.choices)
    return rule.unit.upper() if rule.unit.isalpha() else METAVARS.get(_kind(each), "X")


def help_of(each: Field[Any], rule: Rule) -> str:
    """The meaning of a field with its unit, where that is not its value's name, and its default."""
    unit = "" if not rule.unit or rule.unit.isalpha() else f"{rule.unit}, "
    default = each.default
    plain = isinstance(default, str | int | float) and not isinstance(default, bool) and default != ""
    return f"{unit}{rule.off or rule.help}" + (f" ({default})" if plain else "")


def from_arguments(kind: type[R], args: argparse.Namespace) -> R:
    """The record of parsed arguments.  Raises CalibrationError, with the flag as it is typed, for a value outside of what is declared."""
    known = {each.name: dest(kind, each.name) for each, _ in declared(kind)}
    try:
        return kind(**{name: getattr(args, place) for name, place in known.items() if hasattr(args, place)})
    except OptionError as error:
        if error.name not in known:
            raise
        raise CalibrationError(f"{flag(kind, error.name)}{str(error).removeprefix(error.name)}; see --help") from None


# Python


def typed_as(each: Field[Any], rule: Rule) -> tuple[str, str]:
    """The type of a field in words, and its default; the default is empty where it is None or nothing."""
    kind, default = _kind(each), each.default
    if rule.choices:
        words = "{" + ", ".join(map(repr, rule.choices)) + "}"
    elif kind.startswith("tuple["):
        words = f"tuple of {kind[6:-1].split(', ')[0]}"
    else:
        words = "str or Path" if kind == "Path" else kind
    return words, "" if default in (None, ()) else repr(default)


def parameters(kind: Any, but: Sequence[str] = ()) -> str:
    """The fields of a record, apart from ``but``, as entries of a "Parameters" section."""
    entries = []
    for each, rule in declared(kind):
        if each.name in but:
            continue
        bounds = f"; {expected(each, rule)}" if (rule.least, rule.most, rule.above) != (None, None, None) else ""
        unit = f"{rule.unit}, " if rule.unit and not bounds else ""
        text = f"{unit}{rule.help}{bounds}"
        kind, default = typed_as(each, rule)
        entries.append(f"{each.name} : {kind}, {f'default {default}' if default else 'optional'}\n    {text[:1].upper()}{text[1:]}.")
    return "\n".join(entries)


def _with_parameters(text: str, kind: Any, but: Sequence[str] = ()) -> str:
    """A docstring with the fields of a record at the end of its "Parameters" section, which is made where there is none."""
    lines = inspect.cleandoc(text).split("\n")
    heads = [index - 1 for index, line in enumerate(lines) if index and line and set(line) == {"-"}]
    begin = next((index for index in heads if lines[index] == "Parameters"), None)
    end = next((index for index in heads if begin is None or index > begin), len(lines))
    before, after = "\n".join(lines[:end]).rstrip(), "\n".join(lines[end:])
    head = "\n" if begin is not None else "\n\nParameters\n----------\n"
    return f"{before}{head}{parameters(kind, but)}\n\n{after}".rstrip() + "\n"


def documented(kind: type[R]) -> type[R]:
    """Decorate a record: its docstring gets a "Parameters" section."""
    kind.__doc__ = _with_parameters(kind.__doc__ or "", kind)
    return kind


def keywords(function: Callable[..., Any], kind: Any) -> None:
    """Give a function that takes ``**choices`` the fields of a record as keywords, in its signature and in its docstring."""
    own = [each for each in inspect.signature(function).parameters.values() if each.kind is not each.VAR_KEYWORD]
    known = [each.name for each in own]
    more = [
        inspect.Parameter(each.name, inspect.Parameter.KEYWORD_ONLY, default=each.default, annotation=each.type)
        for each, _ in declared(kind)
        if each.name not in known
    ]
    function.__signature__ = inspect.signature(function).replace(parameters=[*own, *more])  # type: ignore[attr-defined]
    function.__doc__ = _with_parameters(function.__doc__ or "", kind, known)
