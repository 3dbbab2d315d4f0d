"""Provenance of the numbers: files with their SHA-256, settings, versions, sensor and site."""

from __future__ import annotations

from session.base.texts import STANDIN_NAME
from session.log.config import BoardGiven
from tinygc.explanation.reported import ReportData
from tinygc.reporting.fit_text import TITLES
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
    session, options, accelerometer = evidence.fit.session, evidence.fit.options, evidence.adopted.accelerometer
    sensor, site = session.config.sensor, session.config.site
    registers = [f"{name}={value}" for log in session.logs for name, value in sorted(log.comments.items())]
    html = render(
        "provenance.html",
        e=evidence,
        sensor_and_site=[
            ("Model", sensor.model),
            ("Serial", sensor.serial or "not given"),
            ("Full scales", f"±{sensor.gyro_fs_dps:g} dps, ±{sensor.accel_fs_g:g} g"),
            ("Data rate, nominal", f"{sensor.nominal_hz:g} Hz"),
            ("Temperature", temperature_words(evidence.problem)),
            ("Latitude", "not given" if site.latitude_deg is None else f"{site.latitude_deg:g}°"),
            ("Gravity", "not given" if site.gravity_mps2 is None else f"{site.gravity_mps2:g} m/s²"),
            ("Heading", "not given" if site.heading_deg is None else f"{site.heading_deg:g}°"),
            ("Board", board_text(session.config.board)),
            ("Registers", ", ".join(dict.fromkeys(registers)) or "not stated in the logs"),
        ],
        source=SOURCES[accelerometer.source],
        matrix="; ".join(", ".join(f"{value:.6f}" for value in row) for row in accelerometer.matrix).replace("-", "−"),
        bias=", ".join(f"{value:.5f}" for value in accelerometer.bias_mps2).replace("-", "−"),
        settings=[
            ("Seed", options.seed),
            ("Folds", min(options.folds, len(evidence.problem.used))),
            ("Nets", "trained as in the paper" if options.as_in_paper else "trained by the second order"),
            ("Rates of the stills as data", "yes" if options.still_rates else "no"),
            ("Earth’s rotation", "taken off" if options.earth and evidence.problem.earth.source != "none" else "left in"),
            ("Explain", "run" if evidence.verdict else "not run"),
            *evidence.versions.items(),
            ("Made", evidence.made),
        ],
        reused=[TITLES.get(name, name) for name in evidence.reused],
    )
    return Section("provenance", "Provenance", html)


def board_text(board: BoardGiven) -> str:
    """Board information that was stored with the recording."""
    if not board.source:
        return "said nothing of itself"
    if board.source == STANDIN_NAME:
        return f"firmware {board.firmware}; it had no sensor: the samples are made up, or were played to it"
    said = [f"firmware {board.firmware}"]
    if board.who_am_i is not None:
        said.append(f"WHO_AM_I 0x{int(board.who_am_i):02X}, which siblings of the sensor share")
    if board.freq_fine is not None:
        said.append(f"INTERNAL_FREQ_FINE {board.freq_fine:g}".replace("-", "−"))
    if board.registers:
        said.append(f"CTRL1_XL to CTRL10_C {board.registers}")
    return "; ".join(said)
