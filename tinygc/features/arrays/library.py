"""Python interface of ``fit`` and ``explain`` for an array: several units on one rigid body, estimated together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError, DataError
from session.base.progress import Progress, untold
from session.base.texts import printable
from session.detect.check_references import with_own_accelerometer
from session.detect.findings import Finding
from session.log.folder import Session
from tinygc.explanation import checked as on_others
from tinygc.explanation.checked import Checked, checked_to_json
from tinygc.explanation.engine import explain_session
from tinygc.features.arrays.apply import apply_array
from tinygc.features.arrays.explanation import (
    ArrayExplanation,
    array_explain_page,
    array_page,
    explain_array,
    explained_to_json,
    save_array_explanation,
)
from tinygc.features.arrays.fit import ArrayFit, array_to_json, fit_array, save_array
from tinygc.features.arrays.recording import ArraySession, array_of, read_array
from tinygc.library.arguments import column_unit, is_path, public
from tinygc.library.records import Shown
from tinygc.reporting.checked_text import checked_page
from tinygc.reporting.terminal import Group, RenderableType, one_line

# Effects of an array's units, checked on the same units in other recordings of the array.


def check_units(
    found: ArrayExplanation,
    other: ArraySession,
    *,
    seed: int,
    use_earth: bool,
    progress: Progress,
) -> dict[int, Checked]:
    """Check each unit's effects on the unit of the same number in another recording, by that number.  DataError where none is in both."""
    numbers = [number for number in found.explanations if number in other.numbers]
    if not numbers:
        have, want = (", ".join(map(str, these)) for these in (other.numbers, found.explanations))
        raise DataError(f"{other.folder}: it has units {have}, expected some of {want}; give another recording of the same array")
    units = {}
    for done, number in enumerate(numbers):
        progress(f"checking unit {number} on {printable(other.name)}", done, len(numbers))
        unit = other.units[other.numbers.index(number)]
        try:
            explained = explain_session(with_own_accelerometer(unit)[0], seed=seed, use_earth=use_earth)
            units[number] = on_others.check_on(found.explanations[number], explained, seed)
        except CalibrationError as error:
            units[number] = Checked(unit, None, error=str(error))
    return units


def checked_units_page(checked: Sequence[tuple[str, dict[int, Checked]]]) -> list[RenderableType]:
    """Return what the checks on recordings, by their names, say of each unit that names an effect or could not be checked."""
    parts: list[RenderableType] = []
    for number in sorted({number for _, units in checked for number in units}):
        mine = [units[number] for _, units in checked if number in units]
        if any(each.effects or each.error for each in mine):
            parts += [one_line(f"Unit {number}", "bold"), *checked_page(mine)]
    return parts or ([one_line("Checked on other recordings: nothing is named here that could be checked.")] if checked else [])


def checked_units_to_json(checked: Sequence[tuple[str, dict[int, Checked]]]) -> list[dict]:
    """Return ``checked`` of ``tinygc-array-explain/2``."""
    return [
        {"array": name, "units": [{"number": number, **checked_to_json([one])[0]} for number, one in units.items()]}
        for name, units in checked
    ]


# What a user has of an array.


@dataclass(frozen=True, eq=False, repr=False)
class FittedArray(Shown):
    """Result of ``fit``; ``result`` holds all estimates, in SI."""

    result: ArrayFit

    def __repr__(self) -> str:
        return repr(self.result)

    @property
    def page(self) -> Group:
        """Return the command's output, for rich."""
        return array_page(self.result)

    def to_json(self) -> dict:
        """Return ``tinygc-array-fit/2`` (docs/formats.md)."""
        return array_to_json(self.result)

    def save(self, folder: Path | str | None = None) -> Path:
        """Write the result, and each unit's model, into a folder (``fit`` in the array's); return it."""
        return save_array(self.result, self.result.array.own_folder("fit") if folder is None else Path(folder))


@dataclass(frozen=True, eq=False, repr=False)
class ExplainedArray(Shown):
    """Result of ``explain`` of an array; ``result`` holds all estimates, in SI."""

    result: ArrayExplanation
    #: other recordings of the array that it was checked on: name, and the outcome of each unit by number
    checked: tuple[tuple[str, dict[int, Checked]], ...] = ()

    def __repr__(self) -> str:
        return f"<ExplainedArray {self.result.fit.array.name}: {self.result.verdict}>"

    @property
    def page(self) -> Group:
        """Return the command's output, for rich."""
        return Group(array_explain_page(self.result), *checked_units_page(self.checked))

    def to_json(self) -> dict:
        """Return ``tinygc-array-explain/2`` (docs/formats.md)."""
        return explained_to_json(self.result) | {"checked": checked_units_to_json(self.checked)}

    def save(self, folder: Path | str | None = None) -> Path:
        """Write the result, and each unit's, into a folder (``explain`` in the array's); return it."""
        own = self.result.fit.array.own_folder
        return save_array_explanation(self.result, own("explain") if folder is None else Path(folder), self.to_json())


@dataclass(frozen=True, eq=False, repr=False)
class Array:
    """Result of ``tinygc.array``: what the commands do with an array's folder."""

    #: the units' sessions, with their numbers
    session: Any

    def __repr__(self) -> str:
        return f"<Array {self.session.name}: units {', '.join(map(str, self.session.numbers))}>"

    def check(self) -> list[Finding]:
        """Check each unit, and whether all are on one body; as ``tinygc.check``."""
        from tinygc.library.checks import check

        return check(self.session)

    @public()
    def fit(self, *, bias: str = "auto", accelerometer: str = "auto", earth: bool = True, progress: Progress | None = None) -> Any:
        """Estimate all units together.

        bias: ``auto``, ``ends`` or ``stills``; accelerometer: ``auto``, ``given``, ``fit`` or ``prior``.  Returns a FittedArray:
        ``result`` in SI, ``summary()``, ``save(folder)``, ``to_json()``.  Raises CalibrationError for data that cannot be fitted.
        """
        how: dict[str, Any] = {"bias": bias, "accelerometer": accelerometer, "use_earth": earth}
        return FittedArray(fit_array(self.session, **how, progress=lambda what: (progress or untold)(what, 0, 1)))

    @public()
    def explain(self, *, seed: int = 0, earth: bool = True, check_on: Sequence[Any] = (), progress: Progress | None = None) -> Any:
        """Explain each unit by itself and by comparison with the others.

        check_on: other recordings of the array, or their folders.  Returns an ExplainedArray: ``result``, ``summary()``,
        ``save(folder)``, ``to_json()``.  Raises CalibrationError for data that cannot be explained.
        """
        others = [(each if isinstance(each, Array) else array(each)).session for each in check_on]
        how: dict[str, Any] = {"seed": seed, "use_earth": earth, "progress": progress or untold}
        found = explain_array(self.session, **how)
        return ExplainedArray(found, tuple((other.name, check_units(found, other, **how)) for other in others))

    @public()
    def apply(
        self,
        model: Path | str,
        out: Path | str,
        *,
        which: str | None = None,
        unit: str = "rad/s",
        progress: Progress | None = None,
    ) -> Any:
        """Write the array's folder as one log: the fused units, without those that fault detection excludes.

        model: the array's model file, as its fit saves it; which: the log, of several; unit: of the rates in the log, rad/s or dps.
        Returns an ArrayApplied: ``rows``, ``used``, ``events``, ``notes``.
        """
        return apply_array(Path(model), self.session.folder, Path(out), which, column_unit(unit), progress or untold)


@public()
def array(units: Any, *, name: str = "array") -> Array:
    """Take several units on one rigid body as one array.

    Parameters
    ----------
    units : str, Path, ArraySession or sequence of Session
        The array's folder, or the sessions of its units, as many logs of each, at the same times.
    name : str, optional
        Of an array of sessions, one word.

    Returns
    -------
    Array
        ``check()``, ``fit()``, ``explain()`` and ``apply(model, out)``; ``session`` holds the units.

    Raises
    ------
    CalibrationError
        For units that are no array; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> array = tinygc.array("data/array")  # doctest: +SKIP
    >>> array.fit().save("fit")  # doctest: +SKIP

    """
    if is_path(units):
        return Array(read_array(Path(units)))
    if isinstance(units, list | tuple) and units and all(isinstance(unit, Session) for unit in units):
        return Array(array_of(units, name))
    if not hasattr(units, "units"):
        raise CalibrationError(f"units is of type {type(units).__name__}, expected an array's folder or the sessions of its units")
    return Array(units)
