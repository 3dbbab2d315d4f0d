"""The page of ``budget``, a stacked bar and a table for each quantity, and what the draws say; its section of a report; and the screen."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10

import numpy as np

from session import VERSION
from session.base.texts import NONE, command_line, printable, significant
from tinygc.explanation.reported import ReportData
from tinygc.features.unit.budget.monte_carlo import MonteCarlo
from tinygc.features.unit.budget.quantities import SHOWN, TOTAL, sensor_error_budgets
from tinygc.features.unit.budget.rows import Budget, Row, apportioned, decimals_of
from tinygc.reporting.html.chart import drawing
from tinygc.reporting.html.markup import Section, code, escape, figure, key, paragraph, table
from tinygc.reporting.html.page import document
from tinygc.reporting.pictures.canvas import plain
from tinygc.reporting.terminal import RenderableType, Table, one_line, plain_table

#: the section of the report that this one stands behind
BEHIND = "correlations"
#: colours of the sources, in their order; further ones share the last
COLOURS = ("least_squares", "y", "raw", "x", "pso", "tinygc", "tinygc_denoised", "raw_bias_removed", "tinygc_physics", "quiet")
BAR, GAP, NAMES_PX = 16, 6, 150
#: share of a source below which it has no entry in the key
LEAST_IN_KEY = 0.005
HEADER = ("source", "type", "dof", "size", "", "sensitivity", "u", "u²", "share, %")


def page(name: str, errors: Sequence[Budget], attitude: Sequence[Budget], motion: str, drawn: MonteCarlo | None) -> str:
    """The page as one HTML document; errors: of the parameters that are shown; name: of the session."""
    colours = colours_of([*errors, *attitude])
    of_errors = bars(errors, "Share of each source in the variance of each sensor error", colours)
    of_attitude = bars(attitude, "Share of each source in the attitude's variance", colours)
    sections = [
        Section("parameters", "Sensor errors", of_errors + _summary(errors)),
        Section("attitude", f"Attitude after {motion}", of_attitude + _summary(attitude)),
    ]
    if drawn is not None:
        header, rows = drawn_cells(drawn)
        said = paragraph(escape(f"{drawn.words}."))
        found = table(header, [[escape(cell) for cell in row] for row in rows])
        sections.append(Section("draws", "Monte Carlo (JCGM 101)", said + found + paragraph(escape(source_words(drawn)))))
    sections.append(Section("tables", "Budgets", "".join(whole_html(each) for each in (*errors, *attitude))))
    head = f'<header><p class="kicker">Uncertainty budget</p><h1>{escape(name)}</h1></header>'
    foot = (
        "<footer>U = k u with 95 % coverage, of a total at least; k by the effective degrees of freedom (Welch–Satterthwaite, GUM G.4). "
        f"Type A: evaluated from this recording; B: from anything else. TinyGC {escape(VERSION)}.</footer>"
    )
    return document(f"Uncertainty budget: {name}", head, sections, foot)


def colours_of(budgets: Sequence[Budget]) -> dict[str, str]:
    """The colour of each source that has a share worth a key in one of the budgets."""
    shown = dict.fromkeys(row.source for budget in budgets for row in budget.rows if budget.share(row) >= LEAST_IN_KEY)
    return {name: COLOURS[min(i, len(COLOURS) - 1)] for i, name in enumerate(shown)}


def bars(budgets: Sequence[Budget], about: str, colours: dict[str, str]) -> str:
    """A figure of one stacked bar for each quantity, with the key of its sources; colours: of all sources on the page."""
    keys = [key(colours[name], escape(name), "solid block") for name in colours_of(budgets)]
    return figure(lambda width: _bars(budgets, colours, width, about), "", keys)


def _bars(budgets: Sequence[Budget], kinds: dict[str, str], width: int, about: str) -> str:
    room, parts = width - NAMES_PX, []
    for i, budget in enumerate(budgets):
        y, x = i * (BAR + GAP), float(NAMES_PX)
        parts.append(f'<text x="{NAMES_PX - 8}" y="{y + BAR - 4}" text-anchor="end">{escape(budget.name)}</text>')
        # A mixture with a prior may take variance away: what is left shares the whole bar.
        positive = sum(max(row.variance, 0.0) for row in budget.rows)
        for row in budget.rows:
            size = room * max(row.variance, 0.0) / positive
            title = f"{budget.name}: {row.source} {100 * budget.share(row):.1f} %"
            parts.append(
                f'<rect class="solid k-{kinds.get(row.source, COLOURS[-1])}" x="{x:.1f}" y="{y}" width="{size:.1f}" height="{BAR}">'
                f"<title>{escape(title)}</title></rect>"
            )
            x += size
    return drawing(width, len(budgets) * (BAR + GAP), about, "".join(parts))


def _summary(budgets: Sequence[Budget]) -> str:
    return table(("", "value", "U", "unit", "k"), [[escape(cell) for cell in overview_cells(each)] for each in budgets])


def whole_html(budget: Budget) -> str:
    """The table of one quantity, its sum and what stands beside it, as HTML."""
    rows = [[escape(cell) for cell in cells] for cells in cells_of(budget)]
    said = "".join(paragraph(escape(words)) for words in (sum_words(budget), *beside_words(budget)))
    return f"<h3>{escape(heading(budget))}</h3>{table(HEADER, rows)}{said}"


def section(evidence: ReportData) -> Section | None:
    """The section; None where the calibration to use is another than the linear model, whose sources these are."""
    if evidence.adopted.name != "least_squares":
        return None
    budgets = [each for each in sensor_error_budgets(evidence.fit) if each.name.startswith(SHOWN)]
    if not budgets:
        return None
    worst = max(budgets, key=lambda each: each.share(each.largest[0]))
    said = paragraph(escape(f"Each bar is the variance of one sensor error by its sources. {worst.name}: {largest_words(worst)}."))
    more = paragraph("The tables, with degrees of freedom and coverage factors:") + code(command_line("budget", evidence.fit.session.name))
    drawn = bars(budgets, "Share of each source in each sensor error", colours_of(budgets))
    return Section("sources", "Where the uncertainty comes from", said + drawn + more)


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
    shown = [row for row in budget.largest[:MOST] if budget.share(row) >= LEAST_IN_KEY]
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
