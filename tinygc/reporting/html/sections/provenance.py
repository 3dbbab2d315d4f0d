"""Where the numbers come from: files with their SHA-256, settings, versions, sensor and site."""

from __future__ import annotations

from session.io.config import BoardGiven, Config
from session.io.texts import STANDIN_NAME
from session.io.toml import Note
from tinygc.reporting.fit_text import TITLES
from tinygc.reporting.html.evidence import Evidence
from tinygc.reporting.html.markup import Section, escape, facts, paragraph, table
from tinygc.reporting.html.sections.recording import temperature_words

#: source of the accelerometer's calibration -> in words
SOURCES = {
    "given": "as session.toml gives it",
    "prior": "session.toml’s, sharpened by this session’s stills and turns",
    "stills": "from this session’s own stills and turns",
    "none": "nobody has calibrated it: as measured",
}


def section(evidence: Evidence) -> Section:
    """Everything that would be needed to make the same report again."""
    config, options = evidence.fit.session.config, evidence.fit.options
    rows = [(escape(name), f'<span class="hash">{digest}</span>') for name, digest in evidence.hashes.items()]
    html = table(("File", "SHA-256, of the bytes on the disk"), rows, kind="words stack")
    html += "<h3>Sensor and site</h3>"
    sensor, site = config.sensor, config.site
    html += facts(
        (name, escape(value))
        for name, value in [
            ("Model", sensor.model),
            ("Serial", sensor.serial or "not given"),
            ("Full scales", f"±{sensor.gyro_fs_dps:g} dps, ±{sensor.accel_fs_g:g} g"),
            ("Data rate, nominal", f"{sensor.odr_hz:g} Hz"),
            ("Temperature", temperature_words(evidence.problem)),
            ("Latitude", "not given" if site.latitude_deg is None else f"{site.latitude_deg:g}°"),
            ("Gravity", "not given" if site.gravity_mps2 is None else f"{site.gravity_mps2:g} m/s²"),
            ("Heading", "not given" if site.heading_deg is None else f"{site.heading_deg:g}°"),
            ("Board", board_said(config.board)),
            ("Registers", _registers(evidence)),
        ]
    )
    accelerometer = evidence.adopted.accelerometer
    matrix = "; ".join(", ".join(f"{value:.6f}" for value in row) for row in accelerometer.matrix).replace("-", "−")
    bias = ", ".join(f"{value:.5f}" for value in accelerometer.bias_mps2).replace("-", "−")
    html += paragraph(
        f"Calibration of the accelerometer that the references rest on ({SOURCES[accelerometer.source]}), <i>f</i> = matrix "
        f"(measured − bias): matrix {escape(matrix)}; bias {escape(bias)} m/s².",
        "soft",
    )
    html += noted(config)
    html += "<h3>How it was made</h3>"
    html += facts((name, escape(value)) for name, value in [*_settings(evidence), *evidence.versions.items(), ("Made", evidence.made)])
    if evidence.reused:
        names = ", ".join(TITLES.get(name, name) for name in evidence.reused)
        html += paragraph(
            f"Taken from the session’s own fit, which was made from these very files with these settings: {escape(names)}.", "soft"
        )
    for log in (*evidence.fit.session.logs, *evidence.fit.session.closures):
        for note in log.notes:
            html += paragraph(f"{escape(log.path.name)}: {escape(note)}.")
    if options.exclude:
        html += paragraph(f"Left out by request: segments {', '.join(map(str, options.exclude))}.")
    return Section("provenance", "Provenance", html)


def noted(config: Config) -> str:
    """What a person wrote into session.toml beside the data: notes, and turns that do not count."""
    html = "<h3>Notes</h3>" + facts((escape(name), escape(_noted(value))) for name, value in config.notes.items()) if config.notes else ""
    for row in config.exclude:
        html += paragraph(f"Left out in session.toml: the turn of {escape(row.log)} that moved at {row.at_s:g} s of its clock.")
    return html


def board_said(board: BoardGiven) -> str:
    """What the board said of itself when it was recorded."""
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


def _noted(value: Note) -> str:
    """A note as a person reads it."""
    return "yes" if value is True else "no" if value is False else str(value)


def _settings(evidence: Evidence) -> list[tuple[str, str]]:
    options = evidence.fit.options
    return [
        ("Seed", str(options.seed)),
        ("Folds", str(min(options.folds, len(evidence.problem.used)))),
        ("Integrator", options.integrator),
        ("Net’s optimizer", options.optimizer),
        ("Rates of the stills as data", "yes" if options.still_rates else "no"),
        ("Earth’s rotation", "taken off" if options.earth and evidence.problem.earth.source != "none" else "left in"),
        ("Explain", "asked" if evidence.verdict else "not asked"),
    ]


def _registers(evidence: Evidence) -> str:
    """What the log's own comments say of the sensor's settings."""
    said = [f"{name}={value}" for log in evidence.fit.session.logs for name, value in sorted(log.comments.items())]
    return ", ".join(dict.fromkeys(said)) or "not stated in the logs"
