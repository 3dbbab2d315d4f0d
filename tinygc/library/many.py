"""``tinygc.array``, ``tinygc.lot`` and ``tinygc.fleet``: several units on one body, a lot of sensors, many sessions; all of features."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.base.features import need
from session.detect.findings import Finding
from session.log.dialects import Answers
from session.log.folder import Session
from tinygc.library.arguments import Progress, answers_of, column_unit, is_path, nothing, public

# ``tinygc.array``: several units on one rigid body.


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
    def fit(self, *, bias: str = "auto", accelerometer: str = "auto", use_earth: bool = True, progress: Progress | None = None) -> Any:
        """Estimate all units together.

        bias: ``auto``, ``ends`` or ``stills``; accelerometer: ``auto``, ``given``, ``fit`` or ``prior``.  Returns a FittedArray:
        ``result`` in SI, ``summary()``, ``save(folder)``, ``to_json()``.  Raises CalibrationError for data that cannot be fitted.
        """
        feature = need("calibrations of arrays")
        return feature.fit(self.session, bias=bias, accelerometer=accelerometer, use_earth=use_earth, progress=progress or nothing)

    @public()
    def explain(self, *, seed: int = 0, use_earth: bool = True, check_on: Sequence[Any] = (), progress: Progress | None = None) -> Any:
        """Explain each unit by itself and by comparison with the others.

        check_on: other recordings of the array, or their folders.  Returns an ExplainedArray: ``result``, ``summary()``,
        ``save(folder)``, ``to_json()``.  Raises CalibrationError for data that cannot be explained.
        """
        feature, others = need("calibrations of arrays"), [each.session if isinstance(each, Array) else each for each in check_on]
        return feature.explain(self.session, seed=seed, use_earth=use_earth, check_on=others, progress=progress or nothing)

    @public(Answers)
    def apply(
        self,
        model: Path | str,
        out: Path | str,
        *,
        which: str | None = None,
        unit: str = "rad/s",
        progress: Progress | None = None,
        **choices: Any,
    ) -> Any:
        """Write the array's folder as one log: the fused units, without those that fault detection excludes.

        model: the array's model file, as its fit saves it; which: the log, of several; unit: of the rates in the log, rad/s or dps;
        choices: what the logs do not tell, as of ``tinygc.apply``.  Returns an ArrayApplied: ``rows``, ``used``, ``events``, ``notes``.
        """
        feature, answers = need("calibrations of arrays"), answers_of(choices)
        return feature.apply(Path(model), self.session.folder, Path(out), answers, which, column_unit(unit), progress or nothing)


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
        For units that are no array, and if the arrays feature was removed; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> array = tinygc.array("data/array")  # doctest: +SKIP
    >>> array.fit().save("fit")  # doctest: +SKIP

    """
    if is_path(units):
        return Array(need("recordings of arrays").read_array(Path(units)))
    if isinstance(units, list | tuple) and units and all(isinstance(unit, Session) for unit in units):
        return Array(need("recordings of arrays").array_of(units, name))
    if not hasattr(units, "units"):
        raise CalibrationError(f"units is of type {type(units).__name__}, expected an array's folder or the sessions of its units")
    return Array(units)


# ``tinygc.fleet`` and ``tinygc.lot``: many sessions in one table, and its statistics.


@public()
def fleet(
    folders: Path | str | Sequence[Path | str],
    out: Path | str,
    *,
    steps: Sequence[str] = ("check", "fit", "explain"),
    seed: int = 0,
    use_earth: bool = True,
    accelerometer: str = "auto",
    effects: Sequence[Path | str] = (),
    jobs: int | None = None,
    scheduler: str | None = None,
    retry: bool = False,
    limit_deg: float | None = None,
    progress: Callable[[Any], None] | None = None,
) -> Any:
    """Check, fit and explain many sessions, each once, into one table and one page.

    Parameters
    ----------
    folders : str, Path or sequence of them
        Where session folders lie, at any depth; none to sum up the table that is there.
    out : str or Path
        Folder of the table (fleet.sqlite), the page, and the lot's file.
    steps : sequence of str, optional
        Some of ``check``, ``fit``, ``explain``.
    seed, use_earth, accelerometer : optional
        As of ``fit`` and ``explain``.
    effects : sequence of str or Path, optional
        Folders with further effects.
    jobs : int, optional
        Processes, one for each core by default.  They import the main module: a script calls this under ``if __name__ == "__main__":``.
    scheduler : str, optional
        Address of a Dask scheduler, whose cluster computes instead.
    retry : bool, optional
        Compute again what has failed before.
    limit_deg : float, optional
        Of the verdict of each session: held-out tilt and closure runs, degrees.
    progress : callable, optional
        Called with the counts so far: ``done``, ``failed``, ``reused``.

    Returns
    -------
    Fleet
        ``result`` (counts, distributions, failures), ``lot``, ``files``, ``summary()``, ``to_json()``.

    Raises
    ------
    CalibrationError
        For folders without a session, and if the lots feature was removed; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> found = tinygc.fleet("data", "fleet", steps=("check", "fit"))  # doctest: +SKIP
    >>> found.result.passed  # doctest: +SKIP

    """
    feature = need("lots and fleets")
    places = [Path(each) for each in ([folders] if isinstance(folders, str | os.PathLike) else folders)]
    if isinstance(steps, str):
        steps = (steps,)
    options = feature.FleetOptions(tuple(steps), seed, use_earth, accelerometer, tuple(os.path.abspath(each) for each in effects))
    how = {"jobs": jobs, "scheduler": scheduler, "retry": retry, "limit_deg": limit_deg}
    return feature.fleet(places, Path(out), options, **how, progress=progress or (lambda tally: None))


@public()
def lot(table: Path | str, *, model: str | None = None) -> Any:
    """Compute the statistics of a lot of sensors: mean, spread, drift, units that do not belong.

    Parameters
    ----------
    table : str or Path
        The folder that ``fleet`` wrote, or its fleet.sqlite.
    model : str, optional
        Of a table with several models of sensors, this one.

    Returns
    -------
    LotStatistics
        ``result``, ``summary()``, ``to_json()``; ``save(path)`` writes the lot's file for ``fit(…, lot=path)``, ``save_page(path)`` a page.

    Raises
    ------
    CalibrationError
        For a table that cannot be read or has fewer than two fitted units, and if the lots feature was removed.

    Examples
    --------
    >>> import tinygc
    >>> tinygc.lot("fleet").save("lot.json")  # doctest: +SKIP

    """
    return need("lots and fleets").lot(Path(table), model=model)
