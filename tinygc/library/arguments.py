"""Arguments of the public functions: refused in one line where they are wrong.  Imports nothing heavy."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from difflib import get_close_matches
from functools import wraps
from inspect import signature
from math import isfinite
from os import PathLike
from typing import Any, ParamSpec, TypeVar

import numpy as np

from session.base.errors import CalibrationError, DataError
from session.base.options import keywords as keywords_of
from session.base.units import DEG

P = ParamSpec("P")
R = TypeVar("R")
Options = TypeVar("Options")


def is_path(value: Any) -> bool:
    """Whether a value may be a path: a Path, or text that is not empty."""
    return isinstance(value, PathLike) or (isinstance(value, str) and bool(value.strip()) and "\0" not in value)


def is_number(value: Any) -> bool:
    """Whether a value is one finite number."""
    if not isinstance(value, int | float | np.integer | np.floating) or isinstance(value, bool):
        return False
    try:
        return isfinite(value)
    except OverflowError:  # a whole number beyond all of float64
        return False


def _is_whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(value >= 0)


def _is_many(value: Any, one: Callable[[Any], bool]) -> bool:
    return isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes) and all(map(one, value))


#: annotation of an argument -> whether a value suits it, and what is expected; others are checked where they are used
KINDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "str": (lambda value: isinstance(value, str), "text"),
    "Path | str": (is_path, "a path"),
    "int": (_is_whole, "a whole number, not below 0"),
    "float": (lambda value: is_number(value) and bool(value > 0), "a number above 0"),
    "Sequence[str]": (lambda value: isinstance(value, str) or _is_many(value, lambda one: isinstance(one, str)), "a list of words"),
    "Sequence[int]": (lambda value: _is_many(value, _is_whole), "a list of whole numbers"),
    "Sequence[float]": (lambda value: _is_many(value, is_number), "a list of numbers"),
    "Sequence[Path | str]": (lambda value: _is_many(value, is_path), "a list of paths"),
    "Path | str | Sequence[Path | str]": (lambda value: is_path(value) or _is_many(value, is_path), "a path, or a list of paths"),
}


def _check_kinds(function: Callable[..., Any], given: Mapping[str, Any]) -> None:
    """Raise CalibrationError for an argument whose kind is another than its annotation has, as far as ``KINDS`` knows it."""
    for name, value in given.items():
        kind = str(function.__annotations__.get(name, ""))
        optional = kind.endswith(" | None")
        suits, expected = KINDS.get(kind.removesuffix(" | None"), (None, ""))
        if suits is not None and not (optional and value is None) and not suits(value):
            raise CalibrationError(f"{function.__name__}: {name} is {value!r:.60}, expected {expected}")


def public(*records: type) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a public function or method: an unknown keyword, and an argument of another kind, raise a CalibrationError of one line.

    records: of options, whose fields are keywords of the function as well, in its signature and in its docstring.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        parameters = [each.name for each in signature(function).parameters.values() if each.kind is not each.VAR_KEYWORD]
        known = [*parameters, *(each.name for record in records for each in fields(record))]

        @wraps(function)
        def call(*args: P.args, **keywords: P.kwargs) -> R:
            for name in keywords:
                if name not in known:
                    near = get_close_matches(name, known, 1, 0.5)
                    hint = f"did you mean {near[0]}?" if near else f"expected some of {', '.join(known)}"
                    raise CalibrationError(f"{function.__name__}: no option {name!r}; {hint}")
            if keywords.get("progress") is not None and not callable(keywords["progress"]):
                raise CalibrationError(f"progress is {keywords['progress']!r}, expected a function of three arguments: what, done, of")
            try:
                given = signature(function).bind(*args, **keywords).arguments
            except TypeError as error:
                raise CalibrationError(f"{function.__name__}: {error}; it takes {', '.join(parameters)}") from None
            _check_kinds(function, given)
            return function(*args, **keywords)

        for record in records:
            keywords_of(call, record)
        return call

    return decorate


def is_fit(value: Any) -> bool:
    """Whether a value is a ``Fit``; nothing is imported for it, since who has one has imported its module."""
    module = sys.modules.get("tinygc.library.fits")
    return module is not None and isinstance(value, module.Fit)


def column_unit(unit: str) -> str:
    """Return the ending of a log's columns of rates, ``rps`` or ``dps``, of a unit's word; DataError for any other unit."""
    from session.log.arrays import si_of

    si = si_of("unit", "gyro", unit)
    if si not in (1.0, DEG):
        raise DataError(f"unit is {unit!r}, and a log has rad/s or dps; give one of these")
    return "dps" if si == DEG else "rps"


def chosen(kind: type[Options], options: Options | None, choices: dict[str, Any]) -> Options:
    """Return options of a kind with single fields replaced; CalibrationError if ``options`` are of another kind."""
    if options is not None and not isinstance(options, kind):
        raise CalibrationError(f"options is of type {type(options).__name__}, expected tinygc.{kind.__name__}")
    return replace(kind() if options is None else options, **choices)  # type: ignore[type-var]  # options are dataclasses
