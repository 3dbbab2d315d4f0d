"""The uncertainty budget in a calibration report: a stacked bar for each sensor error."""

from __future__ import annotations

from session.base.texts import command_line
from tinygc.explanation.reported import ReportData
from tinygc.features.unit.budget.page import bars, colours_of
from tinygc.features.unit.budget.quantities import SHOWN, sensor_error_budgets
from tinygc.features.unit.budget.text import largest_words
from tinygc.reporting.html.markup import Section, code, escape, paragraph

#: the section of the report that this one stands behind
BEHIND = "correlations"


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
