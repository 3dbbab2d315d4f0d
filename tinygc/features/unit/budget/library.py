"""Python interface of ``budget``: the uncertainty of a fit by source, and of a use of its calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from session import VERSION
from session.base.errors import CalibrationError
from session.base.options import records
from session.base.progress import Progress, untold
from session.base.records import plain
from session.base.texts import printable
from session.log.folder import Session
from tinygc.estimation.options import FitOptions
from tinygc.features.unit.budget.monte_carlo import MonteCarlo, monte_carlo
from tinygc.features.unit.budget.page import drawn_page, overview, page, whole
from tinygc.features.unit.budget.quantities import (
    SHOWN,
    TOTAL,
    accelerometer_budgets,
    named,
    parameter_budgets,
    sensor_error_budgets,
    use_budgets,
)
from tinygc.features.unit.budget.rows import Budget
from tinygc.features.unit.options import BudgetOptions
from tinygc.fitting.fit import fit_session
from tinygc.fitting.results import FitResult
from tinygc.library.arguments import is_fit, public, session_or_folder
from tinygc.library.records import Kept
from tinygc.reporting.facts import Part, screen
from tinygc.reporting.terminal import Group

SCHEMA = "tinygc-budget/1"
FILE, PAGE = "budget.json", "budget.html"
#: what is in no U here, and in that of requirements; each quantity's own table states its size
WITHOUT = "without an effect that the model lacks"


@dataclass(frozen=True, eq=False, repr=False)
class UncertaintyBudget(Kept):
    """Result of ``tinygc.budget``: ``parameters``, ``sensor_errors``, ``accelerometer``, ``attitude``: a ``Budget`` of each quantity;
    ``asked``: those that were asked for; ``motion``: in words; ``when``: for which switch-on the attitude is."""

    FILES: ClassVar = (FILE, PAGE)
    name: str
    parameters: tuple[Budget, ...]
    sensor_errors: tuple[Budget, ...]
    accelerometer: tuple[Budget, ...]
    attitude: tuple[Budget, ...]
    motion: str
    when: str
    asked: tuple[Budget, ...] = ()
    drawn: MonteCarlo | None = None

    def __repr__(self) -> str:
        return f"<UncertaintyBudget of {self.name}: {len(self.parameters[0].rows)} sources>"

    @property
    def budgets(self) -> tuple[Budget, ...]:
        """All quantities."""
        return (*self.parameters, *self.sensor_errors, *self.accelerometer, *self.attitude)

    @property
    def shown(self) -> tuple[Budget, ...]:
        """Those of the overview."""
        return (*(each for each in self.sensor_errors if each.name.startswith(SHOWN)), *self.attitude)

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        drawn: list[Part] = [] if self.drawn is None else ["", *drawn_page(self.drawn)]
        if self.asked:
            return screen([part for each in self.asked for part in (*whole(each), "")][:-1] + drawn)
        title = f"Attitude after {self.motion}, {self.when}, about the axes of its start, 95 % (total: at least), {WITHOUT}"
        errors = [each for each in self.shown if each not in self.attitude]
        gyroscope = overview(f"Sensor errors, 95 %, the bias for this switch-on only, {WITHOUT}", errors)
        force: list[Part] = [overview("Accelerometer, 95 %, for this switch-on only", self.accelerometer), ""] if self.accelerometer else []
        return screen([gyroscope, "", *force, overview(title, self.attitude), *drawn])

    def to_json(self) -> dict:
        """``tinygc-budget/1`` (docs/features/unit/budget-format.md)."""
        return plain(
            {
                "schema": SCHEMA,
                "version": VERSION,
                "session": self.name,
                "motion": f"{self.motion}, {self.when}",
                "budgets": [each.to_json() for each in (self.asked or self.budgets)],
                "monte_carlo": None if self.drawn is None else self.drawn.to_json(),
            }
        )

    def html(self) -> str:
        """The budgets as one HTML document."""
        errors = [each for each in self.shown if each not in self.attitude]
        return page(self.name, errors, self.attitude, f"{self.motion}, {self.when}", self.drawn)


def budget_of_fit(result: FitResult, use: BudgetOptions, progress: Progress = untold) -> UncertaintyBudget:
    """The budget of a fit.

    Raises CalibrationError for a name that is none, for a motion that cannot be read, and for draws of a fit whose errors cannot be drawn.
    """
    if use.monte_carlo and use.elapsed_s is not None:
        raise CalibrationError("--monte-carlo: the drift of session and use is not drawn as one; leave --elapsed out, or the draws")
    motion, attitude, in_use = use_budgets(result, use)
    when = "at another switch-on" if use.elapsed_s is None else "for this switch-on only"
    force = tuple(accelerometer_budgets(result))
    parameters, errors = tuple(parameter_budgets(result)), tuple(sensor_error_budgets(result))
    made = UncertaintyBudget(result.session.name, parameters, errors, force, tuple(attitude), motion.words, when)
    chosen = []
    for name in use.of:
        if (found := named(made.budgets, name)) is None:
            known = ", ".join(each.name.replace(" ", "_") for each in made.budgets)
            raise CalibrationError(f"--of {printable(name)[:60]!r}: no such quantity; give one of {known}")
        chosen.append(found)
    made = replace(made, asked=tuple(chosen))
    if not use.monte_carlo:
        return made
    drawn = [each for each in made.asked if each not in made.accelerometer] or made.shown  # draws fit the gyroscope alone
    judged = [each for each in drawn if each.name != TOTAL] or [each for each in attitude if each.name != TOTAL]
    return replace(made, drawn=monte_carlo(result, motion, in_use, judged, use.monte_carlo, use.seed, progress))


@public(BudgetOptions, FitOptions)
def budget(session: Session | Path | str, *, progress: Progress | None = None, **choices: Any) -> Any:
    """Split the uncertainty of a calibration by source: of each parameter, and of the attitude after a motion.

    Parameters
    ----------
    session : Session, str, Path or Fit
        The recording, its folder, or its fit.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    UncertaintyBudget
        ``parameters``, ``sensor_errors`` and ``attitude``: a ``Budget`` of each quantity with ``rows``, ``u``, ``freedom``, ``k``,
        ``expanded``, ``beside``; ``drawn``; ``summary()``, ``html()``, ``to_json()``, ``save(folder)``.

    Raises
    ------
    CalibrationError
        For data that cannot be read or fitted, a name that is none; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session
    >>> found = tinygc.budget(session, motion="rest")
    >>> bias = found.parameters[9]
    >>> bias.name, bias.largest[0].source
    ('B_x', 'drift of the bias')

    """
    use, options = records({"methods": ("least_squares",)} | choices, BudgetOptions, FitOptions)
    said = progress or untold
    found = session.result if is_fit(session) else fit_session(session_or_folder(session), options, said)  # type: ignore[union-attr]
    return budget_of_fit(found, use, said)
