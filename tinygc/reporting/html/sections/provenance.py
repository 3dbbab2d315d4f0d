"""Provenance of the numbers: files with their SHA-256, settings, versions, sensor and site."""

from __future__ import annotations

from session.base.texts import STANDIN_NAME
from session.log.config import BoardGiven
from tinygc.explanation.reported import ReportData
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.html.sections.recording import temperature_words

#: source of the accelerometer's calibration -> description
SOURCES = {
    "given": "as session.toml gives it",
    "prior": "session.toml’s, refined by this session’s stills and turns",
    "stills": "from this session’s own stills and turns",
    "none": "not calibrated: as measured",
}


def section(evidence: ReportData) -> Section:
    """Section of all that is needed to reproduce the report."""
    session = evidence.fit.session
    registers = [f"{name}={value}" for log in session.logs for name, value in sorted(log.comments.items())]
    html = render(
        "provenance.html",
        e=evidence,
        temperature=temperature_words(evidence.problem),
        board=board_text(session.config.board),
        registers=", ".join(dict.fromkeys(registers)),
        source=SOURCES[evidence.adopted.accelerometer.source],
    )
    return Section("provenance", "Provenance", html)


def board_text(board: BoardGiven) -> str:
    """Board information that was stored with the recording."""
    if not board.source:
        return "not stated"
    if board.source == STANDIN_NAME:
        return f"firmware {board.firmware}; it had no sensor: the samples are made up, or were played to it"
    parts = [f"firmware {board.firmware}"]
    if board.who_am_i is not None:
        parts.append(f"WHO_AM_I 0x{int(board.who_am_i):02X}, which siblings of the sensor share")
    if board.freq_fine is not None:
        parts.append(f"INTERNAL_FREQ_FINE {board.freq_fine:g}".replace("-", "−"))
    if board.registers:
        parts.append(f"CTRL1_XL to CTRL10_C {board.registers}")
    return "; ".join(parts)
