"""What the first page of paper says besides the answer: when, by whom, in which conditions, and the calibration's numbers."""

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
    session, sensor = evidence.fit.session, evidence.fit.session.config.sensor
    site, notes = session.config.site, session.config.notes
    place = [f"latitude {site.latitude_deg:g}°"] if site.latitude_deg is not None else []
    place += [f"g = {site.gravity_mps2:g} m/s²"] if site.gravity_mps2 is not None else []
    date, source = recorded(evidence)
    facts = [
        ("Recorded", "not known" if date is None else f"{date}{SOURCES[source]}"),
        *((name, notes[name]) for name in list(notes)[:MOST_NOTES] if name != "date"),
        *([] if "operator" in notes else [("Operator", "not stated")]),
        ("Ranges and rate", f"±{sensor.gyro_fs_dps:g} dps, ±{sensor.accel_fs_g:g} g, {sensor.odr_hz:g} Hz"),
        ("Temperature", temperature_words(evidence.problem)),
        ("Site", ", ".join(place) or "not given"),
        ("Reference", reference_words(session)),
        ("Turns used", f"{len(evidence.problem.used)} of {len(evidence.problem.segments)}"),
        ("Computed by", f"TinyGC {evidence.versions['TinyGC']}"),
    ]
    table = errors_table("Errors of the sensor, ± U (95 %)", [q for q in evidence.quantities if q.word in TERMS], meanings={})
    return Section("front", "", render("front.html", facts_of=facts, table=table))


def recorded(evidence: ReportData) -> tuple[str | None, str]:
    """Return when the session was recorded, as far as its files tell, and their source (``SOURCES``)."""
    session = evidence.fit.session
    if session.in_memory:  # a folder of that name may be another's
        noted = session.config.notes.get("date")
        return (None, "") if noted is None else (printable(str(noted)), "notes")
    date, source = date_of(session.folder, session.config, [log.path for log in session.logs])
    return (date, "") if date is None or source is None else (_TO_MINUTES.sub(r"\1 \2 UTC", date), source)
