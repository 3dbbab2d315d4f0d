"""The errors that E and B take off, as ``fit`` prints them; and on paper when, by whom and in which conditions it was recorded."""

from __future__ import annotations

import re

from session.base.texts import printable
from tinygc.estimation.session_times import date_of
from tinygc.explanation.reported import ReportData
from tinygc.reporting.facts import errors_table
from tinygc.reporting.fit_text import TERMS
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.html.sections.parameters import MEANINGS
from tinygc.reporting.html.sections.recording import reference_words, temperature_words

#: a date as ``date_of`` gives it; what an operator noted stays as it is
_TO_MINUTES = re.compile(r"^(\d+-\d+-\d+)T(\d+:\d+):\d+\+00:00$")
#: of the operator's notes, so that the page stays one
MOST_NOTES = 6


def section(evidence: ReportData) -> Section:
    """Section without a title, not among the contents, of which a screen shows the table alone."""
    session = evidence.fit.session
    notes = [pair for pair in [*session.config.notes.items()][:MOST_NOTES] if pair[0] != "date"]
    shown = [q for q in evidence.quantities if q.word in TERMS]
    table = errors_table(f"Sensor errors ({evidence.adopted.title}): value ± one sigma", shown, meanings=MEANINGS)
    around = temperature_words(evidence.problem), reference_words(session)
    when = recorded(evidence) or "not known"
    return Section("front", "", render("front.html", e=evidence, recorded=when, notes=notes, around=around, table=table))


def recorded(evidence: ReportData) -> str | None:
    """Return when the session was recorded, as far as its port or its notes state it: a log's file may be younger."""
    session = evidence.fit.session
    if session.in_memory:  # a folder of that name may be another's
        noted = session.config.notes.get("date")
        return None if noted is None else printable(str(noted))
    date, _ = date_of(session.folder, session.config)
    return None if date is None else _TO_MINUTES.sub(r"\1 \2 UTC", date)
