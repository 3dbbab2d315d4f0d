"""The screen of ``budget``: an overview with the three largest sources of each quantity, or one whole table for each that is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10

import numpy as np

from session.base.texts import NONE, printable, significant
from tinygc.features.unit.budget.monte_carlo import MonteCarlo
from tinygc.features.unit.budget.rows import Budget, Row, apportioned, decimals_of
from tinygc.features.unit.budget.use import TOTAL
from tinygc.reporting.pictures.canvas import plain
from tinygc.reporting.terminal import RenderableType, Table, one_line, plain_table

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
    table = plain_table(title, "", "value", "U", "unit", "k", "largest sources")
    for column in (1, 2, 4):
        table.columns[column].justify = "right"
    for each in budgets:
        table.add_row(*overview_cells(each), largest_words(each))
    return table


def overview_cells(budget: Budget) -> list[str]:
    """Name, value, U, unit and k of a quantity."""
    value, _, expanded = value_and_expanded(budget).rpartition(" ± ")
    return [budget.name, value, expanded, budget.shown_unit, f"{budget.k:.2f}"]


def value_and_expanded(budget: Budget) -> str:
    """``−1243 ± 31``: the value where there is one, and U, with the digits that U justifies."""
    expanded = budget.expanded / budget.si
    if budget.value is None:
        return f" ± {significant(expanded, 2)}"
    return plain(budget.value / budget.si, expanded)


def largest_words(budget: Budget) -> str:
    """``turns, each by itself 71 %, …``."""
    shown = [row for row in budget.largest[:MOST] if budget.share(row) >= 0.005]
    return ", ".join(f"{row.source} {100 * budget.share(row):.0f} %" for row in shown)


def whole(budget: Budget) -> list[RenderableType]:
    """The table of one quantity, its sum, what it means and what stands beside it."""
    table = plain_table(heading(budget), "source", "type", "dof", "size", "", "sensitivity", "u", "u²", "share, %")
    for column in (2, 3, 5, 6, 7, 8):
        table.columns[column].justify = "right"
    for cells in cells_of(budget):
        table.add_row(*cells)
    return [table, one_line(sum_words(budget)), *(one_line(words) for words in beside_words(budget))]


def heading(budget: Budget) -> str:
    """The quantity, its value and unit."""
    value = "" if budget.value is None else f" = {value_and_expanded(budget)}"
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
    cells = [[row.source, row.kind, freedom_words(row.freedom), *_size_cells(budget, row), number(row.u / budget.si)] for row in large]
    if small:
        cells.append([f"{len(small)} further, each below {100 * LEAST_SHARE:g} %", *[""] * 5, number(np.sqrt(max(squares[-1], 0.0)))])
    cells.append(["sum", "", freedom_words(np.floor(budget.freedom)), "", "", "", number(budget.u / budget.si)])
    shown.append(round(sum(shown), decimals))
    shares.append(round(sum(shares), 1))
    return [[*row, f"{square:.{decimals}f}{power}", f"{share:.1f}"] for row, square, share in zip(cells, shown, shares, strict=True)]


def _size_cells(budget: Budget, row: Row) -> list[str]:
    if not row.size:
        return [NONE, "", NONE]
    return [number(row.size), row.size_unit, number(abs(row.u) / budget.si / row.size)]


def number(value: float) -> str:
    """Three significant digits."""
    text = significant(value).replace("\u202f", "") if value == 0 or 1e-4 <= abs(value) < 1e5 else f"{value:.3g}"
    return text.replace("-", "−", 1) if value < 0 else text


def freedom_words(freedom: float) -> str:
    """Degrees of freedom: a whole number, or ∞ where k is to all digits that of a known size."""
    return f"{freedom:.0f}" if freedom < MANY else "∞"


def sum_words(budget: Budget) -> str:
    """Combined and expanded uncertainty in one line."""
    u, expanded = budget.u / budget.si, budget.expanded / budget.si
    unit = f" {budget.shown_unit}".rstrip()
    of = "" if budget.freedom >= MANY else f" with {freedom_words(np.floor(budget.freedom))} effective degrees of freedom"
    share = "95 %" if budget.name != TOTAL else "at least 95 %, and more where no axis dominates"
    return f"u = {number(u)}{unit}; U = {number(expanded)}{unit}: k = {budget.k:.2f}, {share}{of}"


def beside_words(budget: Budget) -> list[str]:
    """What is not in the sum, a line for each."""
    unit = f" {budget.shown_unit}".rstrip()
    sizes = ["" if each.u is None else f"{number(each.u / budget.si)}{unit}; " for each in budget.beside]
    return [f"not in the sum: {printable(each.what)}: {size}{printable(each.why)}" for each, size in zip(budget.beside, sizes, strict=True)]


def drawn_page(drawn: MonteCarlo) -> list[RenderableType]:
    """What the draws say of the budgets."""
    header, rows = drawn_cells(drawn)
    table = plain_table(f"Monte Carlo (JCGM 101): {drawn.words}", *header)
    for column in (2, 3, 4, 5, 6, 7, 8, 9, 11):
        table.columns[column].justify = "right"
    for row in rows:
        table.add_row(*row)
    return [table, one_line(source_words(drawn))]


def drawn_cells(drawn: MonteCarlo) -> tuple[tuple[str, ...], list[list[str]]]:
    """Header and rows of the table of the draws."""
    header = ("", "unit", "u", "drawn", "95 % by u", "drawn from", "to", "stable digits", "apart", "allowed", "", "cover, %")
    rows = []
    for each in drawn.quantities:
        sizes = [number(value / each.si) for value in (each.u, each.drawn_u, each.half, each.low, each.high)]
        ends = [str(each.digits), number(each.apart / each.si), number(each.tolerance / each.si), each.answer]
        unit = "" if each.unit == "1" else each.unit
        rows.append([each.name, unit, *sizes, *ends, f"{100 * drawn.coverage[each.name]:.1f}"])
    return header, rows


def source_words(drawn: MonteCarlo) -> str:
    """The variance by source that is farthest from the budget's, and what chance allows."""
    far, failed = drawn.farthest, f"; {drawn.failed} fits did not converge" if drawn.failed else ""
    where = f"{far.parameter} by {far.source}: drawn / budget = {far.ratio:.2f}, {far.sigmas:+.1f} sigmas"
    return f"of {len(drawn.sources)} variances by source the farthest: {where} (by chance up to {drawn.sigmas_by_chance:.1f}){failed}"
