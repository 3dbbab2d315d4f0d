"""Python interface of ``budget``: the uncertainty of a fit by source, and of a use of its calibration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session import VERSION
from session.io.errors import CalibrationError
from session.io.texts import printable
from tinygc.annexes.budget.quantities import named, parameter_budgets, sensor_error_budgets, use_budgets
from tinygc.annexes.budget.rows import Budget
from tinygc.annexes.budget.text import overview, whole
from tinygc.annexes.budget.use import Use
from tinygc.estimation.fit import fit_session
from tinygc.estimation.options import FitOptions
from tinygc.estimation.results import FitResult
from tinygc.library.arguments import Progress
from tinygc.library.records import Shown
from tinygc.reporting.terminal import Group, RenderableType

SCHEMA = "tinygc-budget/1"
#: sensor errors of the overview
SHOWN = ("scale factor error", "misalignment", "bias")


@dataclass(frozen=True, eq=False, repr=False)
class UncertaintyBudget(Shown):
    """Result of ``tinygc.budget``: ``parameters``, ``sensor_errors``, ``attitude``: a ``Budget`` of each quantity; ``asked``: those that
    were asked for; ``motion``: in words."""

    name: str
    parameters: tuple[Budget, ...]
    sensor_errors: tuple[Budget, ...]
    attitude: tuple[Budget, ...]
    motion: str
    asked: tuple[Budget, ...] = ()

    def __repr__(self) -> str:
        return f"<UncertaintyBudget of {self.name}: {len(self.parameters[0].rows)} sources>"

    @property
    def budgets(self) -> tuple[Budget, ...]:
        """All quantities."""
        return (*self.parameters, *self.sensor_errors, *self.attitude)

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        if self.asked:
            parts: list[RenderableType] = []
            for each in self.asked:
                parts += [*whole(each), ""]
            return Group(*parts[:-1])
        shown = [each for each in self.sensor_errors if each.name.startswith(SHOWN)]
        title = f"Attitude after {self.motion}, about the axes of its start, 95 %"
        return Group(overview("Sensor errors, 95 %", shown), "", overview(title, self.attitude))

    def to_json(self) -> dict:
        """``tinygc-budget/1`` (docs/formats/budget.md)."""
        return {
            "schema": SCHEMA,
            "version": VERSION,
            "session": self.name,
            "motion": self.motion,
            "budgets": [each.to_json() for each in (self.asked or self.budgets)],
        }


def budget_of_folder(folder: Path, options: FitOptions, use: Use, asked: tuple[str, ...], progress: Progress) -> UncertaintyBudget:
    """The budget of a session folder.  Raises the errors of a fit, and CalibrationError for a name that is none."""
    return budget_of_fit(fit_session(folder, options, progress), use, asked)


def budget_of_fit(result: FitResult, use: Use, asked: tuple[str, ...] = ()) -> UncertaintyBudget:
    """The budget of a fit.  Raises CalibrationError for a name that is none, and for a motion that cannot be read."""
    motion, attitude = use_budgets(result, use)
    made = UncertaintyBudget(
        result.session.name, tuple(parameter_budgets(result)), tuple(sensor_error_budgets(result)), tuple(attitude), motion.words
    )
    found = [(name, named(made.budgets, name)) for name in asked]
    for name, each in found:
        if each is None:
            known = ", ".join(one.name.replace(" ", "_") for one in made.budgets)
            raise CalibrationError(f"--of {printable(name)[:60]!r}: no such quantity; give one of {known}")
    return UncertaintyBudget(
        made.name, made.parameters, made.sensor_errors, made.attitude, made.motion, tuple(each for _, each in found if each is not None)
    )
