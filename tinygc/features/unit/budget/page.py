"""The page of ``budget``: a stacked bar for each quantity, a table for each, and what the draws say."""

from __future__ import annotations

from collections.abc import Sequence

from session import VERSION
from session.base.texts import command_line
from tinygc.explanation.reported import ReportData
from tinygc.features.unit.budget.monte_carlo import MonteCarlo
from tinygc.features.unit.budget.quantities import SHOWN, sensor_error_budgets
from tinygc.features.unit.budget.rows import Budget
from tinygc.features.unit.budget.text import (
    beside_words,
    cells_of,
    drawn_cells,
    heading,
    largest_words,
    overview_cells,
    source_words,
    sum_words,
)
from tinygc.reporting.html.chart import drawing
from tinygc.reporting.html.markup import Section, code, escape, figure, key, paragraph, table
from tinygc.reporting.html.page import document

#: the section of the report that this one stands behind
BEHIND = "correlations"
#: colours of the sources, in their order; further ones share the last
COLOURS = ("least_squares", "y", "raw", "x", "pso", "tinygc", "tinygc_denoised", "raw_bias_removed", "tinygc_physics", "quiet")
BAR, GAP, NAMES_PX = 16, 6, 150
#: share of a source below which it has no entry in the key
LEAST_SHARE = 0.005
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
    sections.append(Section("tables", "Budgets", "".join(whole(each) for each in (*errors, *attitude))))
    head = f'<header><p class="kicker">Uncertainty budget</p><h1>{escape(name)}</h1></header>'
    foot = (
        "<footer>U = k u with 95 % coverage, of a total at least; k by the effective degrees of freedom (Welch–Satterthwaite, GUM G.4). "
        f"Type A: evaluated from this recording; B: from anything else. TinyGC {escape(VERSION)}.</footer>"
    )
    return document(f"Uncertainty budget: {name}", head, sections, foot)


def colours_of(budgets: Sequence[Budget]) -> dict[str, str]:
    """The colour of each source that has a share worth a key in one of the budgets."""
    shown = dict.fromkeys(row.source for budget in budgets for row in budget.rows if budget.share(row) >= LEAST_SHARE)
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


def whole(budget: Budget) -> str:
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
