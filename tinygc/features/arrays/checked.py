"""Effects of an array's units, checked on the same units in other recordings of the array."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from session.base.errors import CalibrationError, DataError
from session.base.texts import printable
from session.detect.check_references import with_own_accelerometer
from tinygc.explanation.checked import Checked, check_on, checked_to_json
from tinygc.explanation.engine import explain_session
from tinygc.features.arrays.explanation import ArrayExplanation
from tinygc.features.arrays.recording import ArraySession
from tinygc.reporting.checked_text import checked_page
from tinygc.reporting.terminal import RenderableType, one_line


def check_units(
    found: ArrayExplanation,
    other: ArraySession,
    *,
    seed: int = 0,
    use_earth: bool = True,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
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
            units[number] = check_on(found.explanations[number], explained, seed)
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
