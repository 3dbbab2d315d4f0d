"""A session folder of one recording: its log, its ``session.toml``, and an accelerometer calibrated from its own stills if asked."""

from __future__ import annotations

import gzip
from collections.abc import Iterable
from pathlib import Path

from session.accelerometer.from_stills import from_stills
from session.common.errors import FormatError, SegmentError
from session.log.config import Accelerometer
from session.log.folder import log_paths, read_session

SECTION = "[accelerometer]"
NEXT_SECTION = "[protocol]"


def write_folder(folder: Path, toml: str, header: str, lines: Iterable[str]) -> Path:
    """``session.toml`` and ``log0001.csv.gz``; the same lines make the same bytes.  FormatError where another log lies there."""
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log0001.csv.gz"
    if others := [path.name for path in log_paths(folder, "log") if path != log]:
        raise FormatError(f"{folder}: holds {others[0]} of another recording; choose another folder with --out")
    text = "\n".join([header, *lines, ""])
    log.write_bytes(gzip.compress(text.encode(), compresslevel=6, mtime=0))
    (folder / "session.toml").write_text(toml, encoding="utf-8")
    return folder


def calibrate_from_stills(folder: Path) -> None:
    """Write the pre-calibration that the folder's own stills give into its ``session.toml``.  SegmentError where they do not."""
    session = read_session(folder)
    config = session.config
    try:
        accelerometer = from_stills([log.samples for log in session.logs], config.site.expected_gravity_mps2, config.protocol.still_s)
    except SegmentError as error:
        raise SegmentError(f"{folder}: {error}") from None
    path = folder / "session.toml"
    text = path.read_text(encoding="utf-8")
    remark = "# From the recording's own stills: in each of them the corrected force has gravity's length.\n"
    path.write_text(text.replace(NEXT_SECTION, f"{remark}{section(accelerometer)}\n{NEXT_SECTION}", 1), encoding="utf-8")


def section(accelerometer: Accelerometer) -> str:
    """``[accelerometer]`` of session.toml, 1e-9 and 1e-8 m/s^2 its last digits."""
    rows = ", ".join("[" + ", ".join(f"{value:.9f}" for value in row) + "]" for row in accelerometer.matrix)
    bias = ", ".join(f"{value:.8f}" for value in accelerometer.bias_mps2)
    return f"{SECTION}\nmatrix = [{rows}]\nbias_mps2 = [{bias}]\n"
