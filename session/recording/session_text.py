"""A configuration as the text of a ``session.toml``: what a person may fill in stands there as a comment."""

from __future__ import annotations

from collections.abc import Mapping

from session.log.additions import exclude_text, notes_text
from session.log.config import OWN_UNITS, SCHEMA, Accelerometer, Config, Protocol
from session.log.toml_text import Value, line, setting
from session.log.truth_reading import TruthGiven

OPTIONAL = ("gyro_bias_instability_dph", "gyro_noise_mdps_rthz", *OWN_UNITS)
NO_SITE = "# latitude_deg = …  # without it the Earth's rotation stays in the rates\n"


def toml_text(config: Config) -> str:
    """``session.toml`` of a configuration (docs/formats.md)."""
    sensor, site, protocol = config.sensor, config.site, config.protocol
    here = {"latitude_deg": site.latitude_deg, "gravity_mps2": site.gravity_mps2, "heading_deg": site.heading_deg}
    chip: dict[str, Value | None] = {"model": sensor.model, "serial": sensor.serial, "odr_hz": sensor.odr_hz}
    chip |= {name: setting(getattr(sensor, name)) for name in ("gyro_fs_dps", "accel_fs_g")}
    chip |= {name: getattr(sensor, name) for name in OPTIONAL}
    table: dict[str, Value | None] = {"still_s": protocol.still_s, "segment_s": protocol.segment_s, "reference": protocol.reference}
    stated = protocol.reference == "truth" or protocol.truth_sigma_deg != Protocol().truth_sigma_deg
    table |= {"truth_sigma_deg": protocol.truth_sigma_deg} if stated else {}
    notes = f"\n[notes]\n{notes_text(config.notes)}" if config.notes else ""
    return f"""\
{line("schema", SCHEMA)}
[sensor]
{_lines(chip)}
{_accelerometer_text(config.accelerometer)}
[site]
{_lines(here) or NO_SITE}
[protocol]
{_lines(table)}{_truth_text(config.truth)}{notes}{exclude_text(config.exclude)}"""


def _lines(table: Mapping[str, Value | None]) -> str:
    return "".join(line(name, value) for name, value in table.items() if value is not None)


def _accelerometer_text(accelerometer: Accelerometer) -> str:
    """Its section; a comment where nobody has calibrated it, for a section that is there counts as a calibration."""
    if accelerometer.source == "none":
        return "# [accelerometer]  # nobody has calibrated it: the session's own stills do\n"
    table: dict[str, Value | None] = {"matrix": accelerometer.matrix.tolist(), "bias_mps2": accelerometer.bias_mps2.tolist()}
    return "[accelerometer]\n" + _lines(table | {"sigma_mg": accelerometer.sigma_mg, "own_stills": accelerometer.own_stills})


def _truth_text(truth: TruthGiven) -> str:
    """Its section; nothing where the recording is to tell how the file is to be read."""
    mounting = truth.mounting.tolist() if truth.mounting is not None else None
    given = _lines({"offset_s": truth.offset_s, "frame": truth.frame, "sense": truth.sense, "order": truth.order, "mounting": mounting})
    return f"\n[truth]\n{given}" if given else ""
