"""Python interface of ``fit``, ``explain`` and ``apply`` for an array: several units on one rigid body, estimated together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from session.base.errors import CalibrationError
from session.log.dialects import Answers
from tinygc.features.arrays.apply import ArrayApplied, apply_array
from tinygc.features.arrays.checked import CheckedArray, check_units, checked_units_page, checked_units_to_json
from tinygc.features.arrays.explanation import (
    ArrayExplanation,
    array_explain_page,
    array_page,
    explain_array,
    explained_to_json,
    save_array_explanation,
)
from tinygc.features.arrays.fit import ArrayFit, array_to_json, fit_array, save_array
from tinygc.features.arrays.recording import ArraySession, read_array
from tinygc.reporting.terminal import Group, as_html, as_text

#: called with the current step's name, the steps done, and their total
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, repr=False)
class FittedArray:
    """Result of ``fit``; ``result`` holds all estimates, in SI."""

    result: ArrayFit

    def __repr__(self) -> str:
        return repr(self.result)

    @property
    def page(self) -> Group:
        """Return the command's output, for rich."""
        return array_page(self.result)

    def summary(self) -> str:
        """Return the page as plain text."""
        return as_text(self.page)

    def _repr_html_(self) -> str:
        return as_html(self.page)

    def to_json(self) -> dict:
        """Return ``tinygc-array-fit/2`` (docs/formats.md)."""
        return array_to_json(self.result)

    def save(self, folder: Path | str | None = None) -> Path:
        """Write the result, and each unit's model, into a folder (``fit`` in the array's); return it."""
        return save_array(self.result, None if folder is None else Path(folder))


def fit(
    array: ArraySession | Path | str,
    *,
    bias: str = "auto",
    accelerometer: str = "auto",
    use_earth: bool = True,
    progress: Progress = lambda what, done, of: None,
) -> FittedArray:
    """Fit an array, or an array's folder.  Raises CalibrationError with one line for data that cannot be read or fitted."""
    read = array if isinstance(array, ArraySession) else read_array(array, lambda name: progress(f"reading {name}", 0, 1))
    told = fit_array(read, bias=bias, accelerometer=accelerometer, use_earth=use_earth, progress=lambda what: progress(what, 0, 1))
    return FittedArray(told)


@dataclass(frozen=True, eq=False, repr=False)
class ExplainedArray:
    """Result of ``explain`` of an array; ``result`` holds all estimates, in SI."""

    result: ArrayExplanation
    #: other recordings of the array that it was checked on
    checked: tuple[CheckedArray, ...] = ()

    def __repr__(self) -> str:
        return f"<ExplainedArray {self.result.fit.array.name}: {self.result.verdict}>"

    @property
    def page(self) -> Group:
        """Return the command's output, for rich."""
        return Group(array_explain_page(self.result), *checked_units_page(list(self.checked)))

    def summary(self) -> str:
        """Return the page as plain text."""
        return as_text(self.page)

    def to_json(self) -> dict:
        """Return ``tinygc-array-explain/2`` (docs/formats.md)."""
        return explained_to_json(self.result) | {"checked": checked_units_to_json(list(self.checked))}

    def save(self, folder: Path | str | None = None) -> Path:
        """Write the result, and each unit's, into a folder (``explain`` in the array's); return it."""
        return save_array_explanation(self.result, None if folder is None else Path(folder), self.to_json())


def explain(
    array: ArraySession | Path | str,
    *,
    seed: int = 0,
    use_earth: bool = True,
    check_on: Sequence[ArraySession | Path | str] = (),
    progress: Progress = lambda what, done, of: None,
) -> ExplainedArray:
    """Explain an array, or an array's folder; check_on: other recordings of it.

    Raises CalibrationError with one line for data that cannot be read or fitted.
    """
    read, *others = (
        each if isinstance(each, ArraySession) else read_array(each, lambda name: progress(f"reading {name}", 0, 1))
        for each in (array, *check_on)
    )
    found = explain_array(read, seed=seed, use_earth=use_earth, progress=progress)
    return ExplainedArray(found, tuple(check_units(found, other, seed=seed, use_earth=use_earth, progress=progress) for other in others))


def apply(
    model: Path,
    folder: Path,
    out: Path,
    answers: Answers = Answers(),  # noqa: B008  # it is frozen
    which: str | None = None,
    unit: str = "rps",
    progress: Progress = lambda what, done, of: None,
) -> ArrayApplied:
    """Fuse an array's folder into one log; which: its log, of several.  CalibrationError for what is no folder, and as ``apply_array``."""
    if not folder.is_dir():
        raise CalibrationError(f"{folder}: no folder; an array's model takes the array's folder")
    return apply_array(model, folder, out, answers, which, unit, progress)
