"""Python interface of ``fit`` and ``explain`` for an array: several units on one rigid body, estimated together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.base.progress import Progress, no_report
from session.detect.findings import Finding
from session.log.folder import Session
from tinygc.features.arrays.apply import apply_array
from tinygc.features.arrays.explanation import explain_array
from tinygc.features.arrays.fit import fit_array
from tinygc.features.arrays.recording import array_of, read_array
from tinygc.library.arguments import column_unit, is_path, public


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

        bias: ``auto``, ``ends`` or ``stills``; accelerometer: ``auto``, ``given``, ``fit`` or ``prior``.  Returns an ArrayFit: models and
        places of the units in SI, ``summary()``, ``save(folder)``, ``to_json()``.  Raises CalibrationError for data that cannot be fitted.
        """
        how: dict[str, Any] = {"bias": bias, "accelerometer": accelerometer, "use_earth": earth}
        return fit_array(self.session, **how, progress=lambda what: (progress or no_report)(what, 0, 1))

    @public()
    def explain(self, *, seed: int = 0, earth: bool = True, check_on: Sequence[Any] = (), progress: Progress | None = None) -> Any:
        """Explain each unit by itself and by comparison with the others.

        check_on: other recordings of the array, or their folders.  Returns an ArrayShown: ``units``, the explanation of each,
        ``statements`` of the array, ``summary()``, ``save(folder)``, ``to_json()``.  Raises CalibrationError for data
        that cannot be explained.
        """
        others = [(each if isinstance(each, Array) else array(each)).session for each in check_on]
        return explain_array(self.session, seed=seed, use_earth=earth, on=others, progress=progress or no_report)

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
        return apply_array(Path(model), self.session.folder, Path(out), which, column_unit(unit), progress or no_report)


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
