"""Python interface of ``budget``: the uncertainty of a fit by source, and of a use of its calibration; its screen, its page with a stacked
bar and a table for each quantity, and its section of a report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError
from session.base.options import records
from session.base.progress import Progress, no_report
from session.base.records import plain
from session.base.texts import NONE, command_line, measured, printable, significant
from session.log.folder import Session
from tinygc.estimation.options import FitOptions
from tinygc.explanation.reported import ReportData
from tinygc.features.unit.budget.quantities import (
    AS_USUAL,
    SHOWN,
    TOTAL,
    Budget,
    Row,
    accelerometer_budgets,
    named,
    parameter_budgets,
    sensor_error_budgets,
    use_budgets,
)
from tinygc.features.unit.options import BudgetOptions
from tinygc.fitting.fit import fit_session
from tinygc.fitting.results import FitResult
from tinygc.library.arguments import is_fit, public
from tinygc.library.records import Kept
from tinygc.library.sources import session_or_folder
from tinygc.reporting import facts
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.facts import Part, Table, screen
from tinygc.reporting.html.markup import Section, code
from tinygc.reporting.terminal import Group

SCHEMA = "tinygc-budget/1"
FILE, PAGE = "budget.json", "budget.html"


@dataclass(frozen=True, eq=False, repr=False)
class UncertaintyBudget(Kept):
    """Result of ``tinygc.budget``: ``parameters``, ``sensor_errors``, ``accelerometer``, ``attitude``: a ``Budget`` of each quantity;
    ``chosen``: those of ``of``; ``motion``: in words; ``seconds``: its length; ``when``: for which switch-on the attitude is."""

    FILES: ClassVar = (FILE, PAGE)
    name: str
    parameters: tuple[Budget, ...]
    sensor_errors: tuple[Budget, ...]
    accelerometer: tuple[Budget, ...]
    attitude: tuple[Budget, ...]
    motion: str
    seconds: float
    when: str
    chosen: tuple[Budget, ...] = ()

    def __repr__(self) -> str:
        return f"<UncertaintyBudget of {self.name}: {len(self.parameters[0].rows)} sources>"

    @property
    def budgets(self) -> tuple[Budget, ...]:
        """All quantities."""
        return (*self.parameters, *self.sensor_errors, *self.accelerometer, *self.attitude)

    @property
    def shown(self) -> tuple[Budget, ...]:
        """Those of the overview."""
        return (*self.errors, *self.attitude)

    @property
    def errors(self) -> list[Budget]:
        """The sensor errors of the overview."""
        return [each for each in self.sensor_errors if each.name.startswith(SHOWN)]

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        if self.chosen:
            return screen([part for each in self.chosen for part in whole(each)])
        errors = overview("Sensor errors, U of 95 %, the bias of this switch-on", self.errors)
        attitude = overview(f"Attitude error after {self.motion}, U of 95 %", self.attitude)
        return screen([*self.headline, errors, attitude, "next: --of NAME shows all sources of one; --out DIR, a page of all"])

    @property
    def headline(self) -> list[str]:
        """How far the attitude is off, and by which source most."""
        total = self.attitude[-1]
        answer = f"Attitude after {self.seconds:.0f} s: within {significant(total.expanded / total.si, 2)}° (95 %)"
        source = total.largest[0].source.removesuffix(AS_USUAL)
        cause = f"{100 * total.share(total.largest[0]):.0f} % from {source}."
        return [f"{answer}, {cause}"] if len(answer) + len(cause) < 79 else [f"{answer}.", cause]

    def to_json(self) -> dict:
        """``tinygc-budget/1`` (docs/formats/unit.md)."""
        return plain(
            {
                "schema": SCHEMA,
                "version": VERSION,
                "session": self.name,
                "motion": f"{self.motion}, {self.when}",
                "budgets": [each.to_json() for each in (self.chosen or self.budgets)],
            }
        )

    def html(self) -> str:
        """The budgets as one HTML document."""
        colours, about = colours_of(self.shown), "Share of each source in the variance of each"
        sections: list[tuple[str, str, list[Part]]] = [
            ("parameters", "Sensor errors", [bars(self.errors, f"{about} sensor error", colours), overview("", self.errors)]),
            (
                "attitude",
                f"Attitude after {self.motion}, {self.when}",
                [bars(self.attitude, f"{about} angle", colours), overview("", self.attitude)],
            ),
        ]
        if self.accelerometer:
            sections.append(("accelerometer", "Accelerometer", [overview("", self.accelerometer)]))
        sections.append(("tables", "Budgets", [part for each in self.shown for part in whole(each)]))
        foot = (
            "U = k u with 95 % coverage, of a total at least; k by the effective degrees of freedom (Welch–Satterthwaite, GUM G.4). "
            "Type A: evaluated from this recording; B: from anything else."
        )
        return facts.page("Uncertainty budget", self.name, sections, foot)


def budget_of_fit(result: FitResult, use: BudgetOptions) -> UncertaintyBudget:
    """The budget of a fit.  Raises CalibrationError for a name that is none, and for a motion that cannot be read."""
    motion, attitude = use_budgets(result, use)
    when = "at another switch-on" if use.elapsed_s is None else "for this switch-on only"
    force = tuple(accelerometer_budgets(result))
    parameters, errors = tuple(parameter_budgets(result)), tuple(sensor_error_budgets(result))
    made = UncertaintyBudget(result.session.name, parameters, errors, force, tuple(attitude), motion.words, motion.duration_s, when)
    chosen = []
    for name in use.of:
        if (found := named(made.budgets, name)) is None:
            known = ", ".join(each.name.replace(" ", "_") for each in made.budgets)
            raise CalibrationError(f"--of {printable(name)[:60]!r}: no such quantity; give one of {known}")
        chosen.append(found)
    return replace(made, chosen=tuple(chosen))


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
        ``expanded``, ``excluded``; ``summary()``, ``html()``, ``to_json()``, ``save(folder)``.

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
    report = progress or no_report
    found = session.result if is_fit(session) else fit_session(session_or_folder(session), options, report)  # type: ignore[union-attr]
    return budget_of_fit(found, use)


# What people see.

#: the section of the report that this one stands behind
BEHIND = "correlations"
#: colours of the sources, in their order; further ones share the last
COLOURS = ("least_squares", "y", "raw", "x", "pso", "tinygc", "tinygc_denoised", "raw_bias_removed", "tinygc_physics", "quiet")
#: share of a source below which it has no entry in the key
LEAST_IN_KEY = 0.005


def colours_of(budgets: Sequence[Budget]) -> dict[str, str]:
    """The colour of each source that has a share worth a key in one of the budgets."""
    shown = dict.fromkeys(row.source for budget in budgets for row in budget.rows if budget.share(row) >= LEAST_IN_KEY)
    return {name: COLOURS[min(i, len(COLOURS) - 1)] for i, name in enumerate(shown)}


def bars(budgets: Sequence[Budget], about: str, colours: dict[str, str]) -> Panel:
    """A picture of one stacked bar for each quantity; colours: of all sources on the page."""
    ticks, keyed = [(float(n), each.name) for n, each in enumerate(budgets)], colours_of(budgets)
    names = Axis(lo=-0.6, hi=len(budgets) - 0.4, ticks=ticks, down=True)
    panel = Panel(Axis("share of the variance (%)", 0, 100), names, about=about, height=22 * len(budgets))
    for n, budget in enumerate(budgets):
        # A mixture with a prior may take variance away: what is left shares the whole bar.
        positive, at = sum(max(row.variance, 0.0) for row in budget.rows), 0.0
        for row in budget.rows:
            share = 100 * max(row.variance, 0.0) / positive
            notes = [f"{budget.name}: {row.source} {100 * budget.share(row):.1f} %"]
            kind, name = colours.get(row.source, COLOURS[-1]), row.source if row.source in keyed else ""
            panel.area([at, at + share], n - 0.36, n + 0.36, kind, "solid", name=name, labels=notes)
            at += share
    return panel


def section(evidence: ReportData) -> Section | None:
    """The section; None where the calibration to use is another than the linear model, whose sources these are."""
    if evidence.adopted.name != "least_squares":
        return None
    budgets = [each for each in sensor_error_budgets(evidence.fit) if each.name.startswith(SHOWN)]
    if not budgets:
        return None
    worst = max(budgets, key=lambda each: each.share(each.largest[0]))
    drawn = bars(budgets, "Share of each source in each sensor error", colours_of(budgets))
    about = f"Each bar is the variance of one sensor error by its sources. {worst.name}: {largest_words(worst)}."
    more = "The tables, with degrees of freedom and coverage factors:"
    html = facts.html([about, drawn, more]) + code(command_line("budget", evidence.fit.session.folder))
    return Section("sources", "Where the uncertainty comes from", html)


# The screen: an overview with the largest source of each quantity, or one whole table for each of ``of``.

#: degrees of freedom from which k is that of infinitely many to four digits
MANY = 1e4
#: share of a row that is printed by itself
LEAST_SHARE = 5e-4


def overview(title: str, budgets: Sequence[Budget]) -> Table:
    """Value and U of each quantity, and its largest source."""
    rows = [[each.name.removeprefix("accelerometer "), *value_cells(each), each.shown_unit[0], largest_words(each)] for each in budgets]
    return Table(title, ("", "value", "U", "unit", "largest source"), rows, left=(0, 3, 4), minor=(4,))


def value_cells(budget: Budget) -> list[str]:
    """Value, where there is one, and U, with the digits that U justifies."""
    si = budget.shown_unit[1]
    value, _, expanded = measured((budget.value or 0.0) / si, budget.expanded / si).partition(" ± ")
    return ["" if budget.value is None else value, expanded]


def largest_words(budget: Budget) -> str:
    """``unexplained, turn to turn 71 %``."""
    return f"{budget.largest[0].source} {100 * budget.share(budget.largest[0]):.0f} %"


def whole(budget: Budget) -> list[Part]:
    """The answer for one quantity, the table of its sources, and what is not in the sum."""
    table = Table("", ("source", "type", "dof", "size", "", "u", "share, %"), cells_of(budget), left=(0, 1, 4))
    return [answer_words(budget), table, *excluded_words(budget)]


def answer_words(budget: Budget) -> str:
    """``bias x: 0.6302 ± 0.0022 dps (95 %, k = 2.57, 5 dof)``."""
    dof = "" if budget.freedom >= MANY else f", {freedom_words(np.floor(budget.freedom))} dof"
    conservative = ", conservative" * (budget.name == TOTAL)  # three angles in one, more than 95 % where no axis dominates
    value = " ± ".join(filter(None, value_cells(budget)))
    return f"{budget.name}: {with_unit(value, budget.shown_unit[0])} (95 %, k = {budget.k:.2f}{dof}{conservative})"


def with_unit(value: str, unit: str) -> str:
    """A number with its unit."""
    return f"{value}{unit}" if unit == "°" else f"{value} {unit}"


def cells_of(budget: Budget) -> list[list[str]]:
    """The rows of a table as text, the largest first, those too small to print as one; the shares add up to their last row."""
    large = [row for row in budget.largest if abs(budget.share(row)) >= LEAST_SHARE]
    small = [row for row in budget.largest if abs(budget.share(row)) < LEAST_SHARE]
    of_small, si = max(sum(row.variance for row in small), 0.0), budget.shown_unit[1]
    shares = apportioned([100 * budget.share(row) for row in large] + [100 * of_small / budget.variance] * bool(small), 1)
    cells = [[row.source, row.kind, freedom_words(row.freedom), *_size_cells(row), significant(row.u / si, 2)] for row in large]
    if small:
        cells.append([f"{len(small)} more, each below {100 * LEAST_SHARE:g} %", *[""] * 4, significant(np.sqrt(of_small) / si, 2)])
    cells.append(["sum", "", freedom_words(np.floor(budget.freedom)), "", "", significant(budget.u / si, 2)])
    return [[*row, f"{share:.1f}"] for row, share in zip(cells, [*shares, round(sum(shares), 1)], strict=True)]


def _size_cells(row: Row) -> list[str]:
    return [significant(row.size), row.size_unit] if row.size else [NONE, ""]


def freedom_words(freedom: float) -> str:
    """Degrees of freedom: a whole number, or ∞ where k is to all digits that of a known size."""
    return f"{freedom:.0f}" if freedom < MANY else "∞"


def excluded_words(budget: Budget) -> list[str]:
    """What is not in U, a line for each."""
    unit, si = budget.shown_unit
    amounts = [f" ({each.why})" if each.u is None else f", {with_unit(significant(each.u / si, 2), unit)}" for each in budget.excluded]
    return [printable(f"not in U: {each.what}{amount}") for each, amount in zip(budget.excluded, amounts, strict=True)]


# A printed column adds up to its printed sum: the last digits are shared out by the largest remainders.


def apportioned(values: Sequence[float], decimals: int) -> list[float]:
    """Round values to so many decimals such that they add up to their rounded sum; the largest remainders are rounded up."""
    scale = 10.0**decimals
    scaled = np.array(values, dtype=float) * scale
    down = np.floor(scaled)
    missing = round(float(np.sum(scaled))) - int(np.sum(down))
    down[np.argsort(-(scaled - down), kind="stable")[:missing]] += 1
    return [float(value) / scale for value in down]
