"""What is written of a session: the texts of ``session.toml``, logs, ``turns.csv`` and ``attitudes.csv``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from session.base.records import stated
from session.base.toml import Note, section_text, setting, toml_line
from session.base.units import DEG, EARTH_RATE_RPS, MDPS
from session.log.config import SCHEMA, ByHand, Config, LeftOut, StillByHand
from session.log.logfile import COLUMNS, LOG, KnownTurn, Log

# ``session.toml``: of a recording that begins, or of a session that is saved.

#: keys that are written in any case: what a person looks for, and changes
ALWAYS = ("model", "serial", "matrix", "bias_mps2", "still_s", "segment_s", "reference")
#: keys of ``[sensor]`` that hold for the logs next to it alone, and not for a recording that is made like this one
OF_THESE_LOGS = ("gyro_bias_repeatability_dps", "odr_sigma", "clock_ratio")
LATITUDE_REMOVES = f"removes the Earth's rotation from the rates, up to {EARTH_RATE_RPS / MDPS:.1f} mdps"
NO_SITE = f"# optional: latitude_deg, north positive ({LATITUDE_REMOVES}), and gravity_mps2, the local one\n"


def toml_text(config: Config, but: tuple[str, ...] = OF_THESE_LOGS) -> str:
    """``session.toml`` of a configuration (docs/formats.md); what the user may fill in is there as a comment.  but: keys of ``[sensor]``
    that are left out."""
    sensor = stated(config.sensor, ALWAYS, but)
    sensor |= {name: setting(sensor[name]) for name in ("gyro_fs_dps", "accel_fs_g") if name in sensor}
    accelerometer = "\n# [accelerometer]  # not calibrated yet: the session's own stills do it\n"
    if config.accelerometer.source != "none":  # a section counts as a calibration
        accelerometer = section_text("accelerometer", stated(config.accelerometer, ALWAYS))
    requirements = {} if config.requirements is None else config.requirements.table
    return "".join(
        [
            toml_line("schema", SCHEMA),
            section_text("sensor", sensor),
            section_text("site", stated(config.site)) or f"\n[site]\n{NO_SITE}",
            accelerometer,
            section_text("protocol", stated(config.protocol, ALWAYS)),
            section_text("board", stated(config.board)),
            section_text("notes", config.notes),
            section_text("requirements", requirements),
            *(section_text(name, stated(section)) for name, section in config.sections.items()),
            by_hand_text(*config.exclude, *config.still),
        ]
    )


def notes_text(notes: Mapping[str, Note]) -> str:
    """Lines of ``[notes]``."""
    return "".join(toml_line(name, value) for name, value in notes.items())


def by_hand_text(*rows: ByHand) -> str:
    """``[[exclude]]`` of each turn, ``[[still]]`` of each still that a person changed."""
    names = {LeftOut: "[exclude]", StillByHand: "[still]"}
    return "".join(section_text(names[type(row)], stated(row)) for row in rows)


# Logs and tables.  A number is written with as many digits as give it back to the last bit.

#: rows that are text at a time
ROWS = 1 << 15


def log_lines(log: Log) -> Iterator[str]:
    """The lines of a log in rad/s, m/s^2 and ns, many at a time, without the readings that interpolation put in."""
    samples = log.samples.pick(~log.put_in) if log.bridges else log.samples
    yield "".join(f"# {key}={value}\n" for key, value in log.comments.items())
    names = ["t_ns", *(f"g{axis}_rps" for axis in "xyz"), *(f"a{axis}_mps2" for axis in "xyz")]
    yield ",".join([*names, *([] if samples.temp_c is None else ["temp_c"])]) + "\n"
    for start in range(0, len(samples), ROWS):
        part = samples.between(start, start + ROWS)
        temps = [] if part.temp_c is None else [part.temp_c]
        columns = [column.tolist() for column in (part.t_ns, *part.gyro.T, *part.accel.T, *temps)]
        yield "\n".join(",".join(map(repr, row)) for row in zip(*columns, strict=True)) + "\n"


def turns_text(turns: tuple[KnownTurn, ...]) -> str:
    """``turns.csv``; with the column ``log`` where a turn is counted within its log."""
    counted = any(turn.log for turn in turns)
    rows = [[f"{turn.turn}", turn.words, _degrees(turn.angle_rad, ".6f"), _degrees(turn.sigma_rad)] for turn in turns]
    if counted:
        rows = [[*row, turn.log or ""] for row, turn in zip(rows, turns, strict=True)]
    return "\n".join(map(",".join, [[*COLUMNS, *([LOG] if counted else [])], *rows])) + "\n"


def attitudes_text(attitudes: np.ndarray) -> str:
    """``attitudes.csv`` of dial readings (stills, 3) rad; a still without one has no row."""
    read = [(still, row) for still, row in enumerate(attitudes.tolist()) if np.isfinite(row).all()]
    rows = [f"{still},{','.join(map(_degrees, row))}" for still, row in read]
    return "\n".join(["still,roll_deg,pitch_deg,yaw_deg", *rows]) + "\n"


def _degrees(angle_rad: float, form: str = "g") -> str:
    """Degrees that a reader makes the very same radians of: as ``form`` has them where that does, else with all digits."""
    near = float(angle_rad / DEG)
    exact = [f"{float(value)!r}" for value in (near, np.nextafter(near, -np.inf), np.nextafter(near, np.inf))]
    return next((text for text in (f"{near:{form}}", *exact) if float(text) * DEG == angle_rad), exact[0])
