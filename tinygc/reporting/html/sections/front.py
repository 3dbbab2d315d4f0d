"""What the first page of paper has in addition to the answer: when, by whom, in which conditions, and the calibration's numbers."""

from __future__ import annotations

import re

from session.base.texts import printable
from tinygc.estimation.session_times import date_of
from tinygc.explanation.reported import ReportData
from tinygc.reporting.facts import errors_table
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.html.sections.recording import reference_words, temperature_words

#: a date as ``date_of`` gives it; what an operator noted stays as it is
_TO_MINUTES = re.compile(r"^(\d+-\d+-\d+)T(\d+:\d+):\d+\+00:00$")
#: the terms that make up E and B
TERMS = ("scale factor error", "misalignment", "bias")
#: of the operator's notes, so that the page stays one
MOST_NOTES = 6
#: sources of a recording's date -> what is behind the date
SOURCES = {"port": "", "notes": "", "file": ", by the log’s file"}


def section(evidence: ReportData) -> Section:
    """Section that only paper shows; it has no title, and is not among the contents."""
    session, (date, source) = evidence.fit.session, recorded(evidence)
    notes = [pair for pair in [*session.config.notes.items()][:MOST_NOTES] if pair[0] != "date"]
    table = errors_table("Errors of the sensor, ± U (95 %)", [q for q in evidence.quantities if q.word in TERMS], meanings={})
    when = "not known" if date is None else f"{date}{SOURCES[source]}"
    around = temperature_words(evidence.problem), reference_words(session)
    return Section("front", "", render("front.html", e=evidence, recorded=when, notes=notes, around=around, table=table))


def recorded(evidence: ReportData) -> tuple[str | None, str]:
    """Return when the session was recorded, as far as its files state it, and their source (``SOURCES``)."""
    session = evidence.fit.session
    if session.in_memory:  # a folder of that name may be another's
        noted = session.config.notes.get("date")
        return (None, "") if noted is None else (printable(str(noted)), "notes")
    date, source = date_of(session.folder, session.config, [log.path for log in session.logs])
    return (date, "") if date is None or source is None else (_TO_MINUTES.sub(r"\1 \2 UTC", date), source)
