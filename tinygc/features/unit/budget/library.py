"""Python interface of ``budget``: the uncertainty of a fit by source, and of a use of its calibration; its screen, its page with a stacked
bar and a table for each quantity, and its section of a report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import floor, log10
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError
from session.base.options import records
from session.base.progress import Progress, untold
from session.base.records import plain
from session.base.texts import NONE, command_line, measured, printable, significant
from session.log.folder import Session
from tinygc.estimation.options import FitOptions
from tinygc.explanation.reported import ReportData
from tinygc.features.unit.budget.monte_carlo import MonteCarlo, monte_carlo
from tinygc.features.unit.budget.quantities import (
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
from tinygc.library.arguments import is_fit, public, session_or_folder
from tinygc.library.records import Kept
from tinygc.reporting import facts
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.facts import Part, Table, screen
from tinygc.reporting.html.markup import Section, code
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
        """``tinygc-budget/1`` (docs/formats/unit.md)."""
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
        colours, about = colours_of(self.shown), "Share of each source in the variance of each"
        sections: list[tuple[str, str, list[Part]]] = [
            ("parameters", "Sensor errors", [bars(errors, f"{about} sensor error", colours), overview("", errors)]),
            (
                "attitude",
                f"Attitude after {self.motion}, {self.when}",
                [bars(self.attitude, f"{about} angle", colours), overview("", self.attitude)],
            ),
        ]
        if self.drawn is not None:
            sections.append(("draws", "Monte Carlo (JCGM 101)", drawn_page(self.drawn)))
        sections.append(("tables", "Budgets", [part for each in self.shown for part in whole(each)]))
        foot = (
            "U = k u with 95 % coverage, of a total at least; k by the effective degrees of freedom (Welch–Satterthwaite, GUM G.4). "
            "Type A: evaluated from this recording; B: from anything else."
        )
        return facts.page("Uncertainty budget", self.name, sections, foot)


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
            says = [f"{budget.name}: {row.source} {100 * budget.share(row):.1f} %"]
            kind, name = colours.get(row.source, COLOURS[-1]), row.source if row.source in keyed else ""
            panel.area([at, at + share], n - 0.36, n + 0.36, kind, "solid", name=name, says=says)
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
    said = f"Each bar is the variance of one sensor error by its sources. {worst.name}: {largest_words(worst)}."
    more = "The tables, with degrees of freedom and coverage factors:"
    html = facts.html([said, drawn, more]) + code(command_line("budget", evidence.fit.session.name))
    return Section("sources", "Where the uncertainty comes from", html)


# The screen: an overview with the three largest sources of each quantity, or one whole table for each that is asked for.

#: sources of each quantity in the overview
MOST = 3
#: significant digits of a sum of variances
DIGITS = 5
#: degrees of freedom from which k is that of infinitely many to four digits
MANY = 1e4
#: share of a row that is printed by itself
LEAST_SHARE = 5e-4


def overview(title: str, budgets: Sequence[Budget]) -> Table:
    """Value, U and k of each quantity, and what it owes most to."""
    rows = [[each.name, *value_cells(each), each.shown_unit, f"{each.k:.2f}", largest_words(each)] for each in budgets]
    return Table(title, ("", "value", "U", "unit", "k", "largest sources"), rows, left=(0, 3, 5), minor=(5,))


def value_cells(budget: Budget) -> list[str]:
    """Value, where there is one, and U, with the digits that U justifies."""
    value, _, expanded = measured((budget.value or 0.0) / budget.si, budget.expanded / budget.si).partition(" ± ")
    return ["" if budget.value is None else value, expanded]


def largest_words(budget: Budget) -> str:
    """``turns, each by itself 71 %, …``."""
    shown = [row for row in budget.largest[:MOST] if budget.share(row) >= LEAST_IN_KEY]
    return ", ".join(f"{row.source} {100 * budget.share(row):.0f} %" for row in shown)


def whole(budget: Budget) -> list[Part]:
    """The table of one quantity, its sum, what it means and what stands beside it."""
    table = Table(
        heading(budget), ("source", "type", "dof", "size", "", "sensitivity", "u", "u²", "share, %"), cells_of(budget), left=(0, 1, 4)
    )
    return [table, sum_words(budget), *beside_words(budget)]


def heading(budget: Budget) -> str:
    """The quantity, its value and unit."""
    value = "" if budget.value is None else f" = {' ± '.join(value_cells(budget))}"
    return f"{', '.join(filter(None, (budget.name, budget.shown_unit)))}{value}"


def cells_of(budget: Budget) -> list[list[str]]:
    """The rows of a table as text, the largest first, those too small to print as one; u² and share add up to their last row."""
    large = [row for row in budget.largest if abs(budget.share(row)) >= LEAST_SHARE]
    small = [row for row in budget.largest if abs(budget.share(row)) < LEAST_SHARE]
    si2 = budget.si**2
    squares = [row.variance / si2 for row in large] + [sum(row.variance for row in small) / si2] * bool(small)
    exponent = floor(log10(budget.variance / si2)) if budget.variance > 0 else 0
    exponent = exponent if abs(exponent) >= DIGITS else 0
    decimals = decimals_of(budget.variance / si2 / 10.0**exponent, DIGITS)
    power, shown = f"e{exponent}" if exponent else "", apportioned([square / 10.0**exponent for square in squares], decimals)
    shares = apportioned([100 * square * si2 / budget.variance for square in squares], 1)
    cells = [[row.source, row.kind, freedom_words(row.freedom), *_size_cells(budget, row), significant(row.u / budget.si)] for row in large]
    if small:
        cells.append([f"{len(small)} further, each below {100 * LEAST_SHARE:g} %", *[""] * 5, significant(np.sqrt(max(squares[-1], 0.0)))])
    cells.append(["sum", "", freedom_words(np.floor(budget.freedom)), "", "", "", significant(budget.u / budget.si)])
    shown.append(round(sum(shown), decimals))
    shares.append(round(sum(shares), 1))
    return [[*row, f"{square:.{decimals}f}{power}", f"{share:.1f}"] for row, square, share in zip(cells, shown, shares, strict=True)]


def _size_cells(budget: Budget, row: Row) -> list[str]:
    if not row.size:
        return [NONE, "", NONE]
    return [significant(row.size), row.size_unit, significant(abs(row.u) / budget.si / row.size)]


def freedom_words(freedom: float) -> str:
    """Degrees of freedom: a whole number, or ∞ where k is to all digits that of a known size."""
    return f"{freedom:.0f}" if freedom < MANY else "∞"


def sum_words(budget: Budget) -> str:
    """Combined and expanded uncertainty in one line."""
    u, expanded = budget.u / budget.si, budget.expanded / budget.si
    unit = f" {budget.shown_unit}".rstrip()
    of = "" if budget.freedom >= MANY else f" with {freedom_words(np.floor(budget.freedom))} effective degrees of freedom"
    share = "95 %" if budget.name != TOTAL else "at least 95 %, and more where no axis dominates"
    return f"u = {significant(u)}{unit}; U = {significant(expanded)}{unit}: k = {budget.k:.2f}, {share}{of}"


def beside_words(budget: Budget) -> list[str]:
    """What is not in the sum, a line for each."""
    unit = f" {budget.shown_unit}".rstrip()
    sizes = ["" if each.u is None else f"{significant(each.u / budget.si)}{unit}; " for each in budget.beside]
    return [f"not in the sum: {printable(each.what)}: {size}{printable(each.why)}" for each, size in zip(budget.beside, sizes, strict=True)]


def drawn_page(drawn: MonteCarlo) -> list[Part]:
    """What the draws say of the budgets."""
    header = ("", "unit", "u", "drawn", "95 % by u", "drawn from", "to", "stable digits", "apart", "allowed", "", "cover, %")
    rows = []
    for each in drawn.quantities:
        sizes = [significant(value / each.si) for value in (each.u, each.drawn_u, each.half, each.low, each.high)]
        ends = [str(each.digits), significant(each.apart / each.si), significant(each.tolerance / each.si), each.answer]
        rows.append([each.name, "" if each.unit == "1" else each.unit, *sizes, *ends, f"{100 * drawn.coverage[each.name]:.1f}"])
    return [Table(f"Monte Carlo (JCGM 101): {drawn.words}", header, rows, left=(0, 1, 10)), source_words(drawn)]


def source_words(drawn: MonteCarlo) -> str:
    """The variance by source that is farthest from the budget's, and what chance allows."""
    far, failed = drawn.farthest, f"; {drawn.failed} fits did not converge" if drawn.failed else ""
    where = f"{far.parameter} by {far.source}: drawn / budget = {far.ratio:.2f}, {far.sigmas:+.1f} sigmas"
    return f"of {len(drawn.sources)} variances by source the farthest: {where} (by chance up to {drawn.sigmas_by_chance:.1f}){failed}"


# A printed column adds up to its printed sum: the last digits are shared out by the largest remainders.


def apportioned(values: Sequence[float], decimals: int) -> list[float]:
    """Round values to so many decimals such that they add up to their rounded sum; the largest remainders are rounded up."""
    scale = 10.0**decimals
    scaled = np.array(values, dtype=float) * scale
    down = np.floor(scaled)
    missing = round(float(np.sum(scaled))) - int(np.sum(down))
    down[np.argsort(-(scaled - down), kind="stable")[:missing]] += 1
    return [float(value) / scale for value in down]


def decimals_of(value: float, digits: int) -> int:
    """Decimals with which a value has so many significant digits, 0 or more."""
    return max(0, digits - 1 - floor(log10(abs(value)))) if value else digits
