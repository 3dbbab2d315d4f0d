"""What the public functions share: their arguments, fitted numbers, tables of records, and text for a terminal or a notebook."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from functools import wraps
from inspect import signature
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from session.detect.accelerometer import NAMES as ACCELEROMETER_NAMES
from session.detect.accelerometer import PARAMETERS
from session.io.arrays import si_of
from session.io.dataframe import data_frame
from session.io.dialects import Answers
from session.io.errors import CalibrationError, DataError
from session.io.folder import Session
from session.io.units import DEG
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.options import FitOptions
from tinygc.reporting.terminal import Group, as_html, as_text
from tinygc.simulation.options import SimulationOptions

# Options and arguments of the public functions.

#: progress callback: current step's description, steps done, steps in all
Progress = Callable[[str, int, int], None]
P = ParamSpec("P")
R = TypeVar("R")
Options = TypeVar("Options", FitOptions, SimulationOptions)


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
    """Raise CalibrationError for an argument whose kind is another than its annotation says, as far as ``KINDS`` knows it."""
    for name, value in given.items():
        kind = str(function.__annotations__.get(name, ""))
        optional = kind.endswith(" | None")
        suits, expected = KINDS.get(kind.removesuffix(" | None"), (None, ""))
        if suits is not None and not (optional and value is None) and not suits(value):
            raise CalibrationError(f"{function.__name__}: {name} is {value!r:.60}, expected {expected}")


def public(options: type | None = None) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a public function or method: an unknown keyword, and an argument of another kind, raise a CalibrationError of one line.

    options: a class whose fields are keywords of the function as well.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        parameters = [each.name for each in signature(function).parameters.values() if each.kind is not each.VAR_KEYWORD]
        known = [*parameters, *([] if options is None else (each.name for each in fields(options)))]

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

        return call

    return decorate


def session_or_folder(session: Any) -> Session | Path:
    """Return a session, or the path of its folder; CalibrationError for anything else."""
    if isinstance(session, Session):
        return session
    if isinstance(session, str | PathLike):
        return Path(session)
    raise CalibrationError(f"session is of type {type(session).__name__}, expected a tinygc.Session or the path of its folder")


def column_unit(unit: str) -> str:
    """Return the ending of a log's columns of rates, ``rps`` or ``dps``, of a unit's word; DataError for any other unit."""
    si = si_of("unit", "gyro", unit)
    if si not in (1.0, DEG):
        raise DataError(f"unit is {unit!r}, and a log has rad/s or dps; give one of these")
    return "dps" if si == DEG else "rps"


def answers_of(choices: Mapping[str, Any]) -> Answers:
    """Return what a log does not tell, checked; DataError for a full scale or rate that is no number above 0, and for other than text."""
    for name, value in choices.items():
        number = name in ("odr_hz", "gyro_fs_dps", "accel_fs_g")
        if value is not None and not (is_number(value) and value > 0 if number else isinstance(value, str)):
            raise DataError(f"{name} is {value!r:.60}, expected {'a number above 0' if number else 'text'}")
    return Answers(**{name: value for name, value in choices.items() if value is not None})


def nothing(what: str, done: int, of: int) -> None:
    """Ignore progress; the default callback."""


def chosen(kind: type[Options], options: Options | None, choices: dict[str, Any]) -> Options:
    """Return options of a kind with single fields replaced; CalibrationError if ``options`` are of another kind."""
    if options is not None and not isinstance(options, kind):
        raise CalibrationError(f"options is of type {type(options).__name__}, expected tinygc.{kind.__name__}")
    return replace(kind() if options is None else options, **choices)


# Fitted numbers, and records that become tables.


@dataclass(frozen=True)
class Estimate:
    """One fitted number."""

    #: ``E_xy``, ``B_x``, ``bias_x``, …
    name: str
    #: in ``unit``; NaN if the session does not observe it
    value: float
    #: one standard deviation, in ``unit``; NaN if it is not known
    sigma: float
    #: ``1`` if unitless
    unit: str

    def __repr__(self) -> str:
        return f"<{self.name} = {self.value:.6g} ± {self.sigma:.2g}{'' if self.unit == '1' else f' {self.unit}'}>"


def accelerometer_estimates(found: AccelerometerFit) -> dict[str, Estimate]:
    """Return the nine numbers of f = M (measured - b) in the accelerometer's own triad by name; a sigma is NaN if it was given."""
    sigmas = np.full(PARAMETERS, np.nan) if found.sigmas is None else found.sigmas
    names = [name.replace(" ", "_") for name in ACCELEROMETER_NAMES]
    return {
        name: Estimate(name, float(value), float(sigma), "m/s^2" if name.startswith("bias") else "1")
        for name, value, sigma in zip(names, found.values, sigmas, strict=True)
    }


#: fields of records that no cell of a table can hold
NO_CELLS = ("corrections",)


def _rows(records: Iterable[Any]) -> dict[str, list[Any]]:
    tables = [{each.name: getattr(record, each.name) for each in fields(record)} if is_dataclass(record) else record for record in records]
    names = dict.fromkeys(name for table in tables for name in table if name not in NO_CELLS)
    return {name: [table.get(name) for table in tables] for name in names}


class Named(dict[str, R]):
    """Records by name; ``to_frame()`` makes a pandas DataFrame of them, a row for each name."""

    def to_frame(self) -> Any:
        """Return a pandas DataFrame, its rows by name.  Raises CalibrationError where pandas is not installed."""
        return data_frame(_rows(self.values()), [*self])


class Listed(tuple[R, ...]):
    """Records in order; ``to_frame()`` makes a pandas DataFrame of them, a row for each."""

    def to_frame(self) -> Any:
        """Return a pandas DataFrame.  Raises CalibrationError where pandas is not installed."""
        return data_frame(_rows(self))


@public()
def to_frame(records: Any) -> Any:
    """Make a pandas DataFrame of records, such as the findings of ``check``.

    Parameters
    ----------
    records : sequence or mapping of records, Fit, Log, Samples, …
        Findings, effects, estimates by name, or anything with ``to_frame`` of its own.

    Returns
    -------
    pandas.DataFrame
        A row for each record, a column for each of its fields.

    Raises
    ------
    CalibrationError
        For what is no record, and where pandas is not installed.

    Examples
    --------
    >>> import tinygc
    >>> findings = tinygc.check(tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session)
    >>> list(tinygc.to_frame(findings))
    ['level', 'where', 'what', 'says', 'do']

    """
    if callable(own := getattr(records, "to_frame", None)):
        return own()

    def is_record(each: Any) -> bool:
        return isinstance(each, Mapping) or (is_dataclass(each) and not isinstance(each, type))

    if isinstance(records, Mapping) and all(map(is_record, records.values())):
        return Named(records).to_frame()
    if isinstance(records, Sequence) and not isinstance(records, str | bytes) and all(map(is_record, records)):
        return Listed(records).to_frame()
    raise CalibrationError(f"records is of type {type(records).__name__}, expected findings, effects, a fit, samples or the like")


class Shown:
    """A result with a ``page`` for rich, which is its text in a terminal and its table in a notebook."""

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        raise NotImplementedError

    def summary(self) -> str:
        """The command's output as plain text."""
        return as_text(self.page)

    def _repr_html_(self) -> str:
        return as_html(self.page)
