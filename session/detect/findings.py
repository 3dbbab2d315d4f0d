"""What a check reports: one record, and the text helpers that the checks share."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated

from session.base.errors import CalibrationError, DataError
from session.base.records import DERIVED, Key
from session.base.results import Text
from session.base.texts import printable

LEVELS = ("ok", "note", "warning", "error")


#: rows of a signed permutation of axes
Axes = tuple[tuple[int, int, int], ...]


@dataclass(frozen=True)
class Correction:
    """A cause that explains a finding, and what reverses it in a log or in session.toml.

    states: the cause; kind: ``gyro``, ``accel`` or ``time``, whose columns change, or nothing; factor: of what is read from them; axes:
    rows of a signed permutation, true = factor * axes @ read, or None; settings: keys of ``[sensor]`` with their right values.  Where these
    change what is read (registers), the columns stay.
    """

    description: str
    kind: str = ""
    factor: float = 1.0
    axes: Axes | None = None
    settings: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Finding:
    """One result of one check.

    level: ``ok`` within its bar, ``note`` worth knowing, ``warning`` costs accuracy, ``error`` makes the calibration wrong;
    where: the file, or the folder's part; what: the check's short name; description: the measured number with its bar;
    do: what to do about it, or nothing; corrections: the causes that explain it, each with what reverses it; none where it is not known.
    """

    level: Annotated[str, Text(LEVELS)]
    where: str
    what: str
    description: str
    do: Annotated[str, Key("advice")] = ""
    corrections: Annotated[tuple[Correction, ...], DERIVED] = ()

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise ValueError(f"level is {self.level!r}, expected one of {', '.join(LEVELS)}")
        for name in ("where", "description", "do"):  # they may quote a file
            object.__setattr__(self, name, printable(getattr(self, name)))

    @property
    def line(self) -> str:
        """All of it in a line, but for the level."""
        return f"{self.where}: {self.what}: {self.description}" + (f"; {self.do}" if self.do else "")


def unreadable(where: str, error: CalibrationError) -> Finding:
    """A file or folder that cannot be read, which its finding names once."""
    return Finding("error", where, "reading", re.sub(rf"^(\S*/)?{re.escape(where)}:? ", "", str(error)))


def worst(findings: Iterable[Finding]) -> str:
    """The most serious level among findings; ``ok`` where there are none."""
    return max((finding.level for finding in findings), key=LEVELS.index, default="ok")


def axes_text(flags: Iterable[bool]) -> str:
    """Names of the axes (3,) whose flag is set: ``x, z``."""
    return ", ".join(axis for axis, flag in zip("xyz", flags, strict=True) if flag)


def xyz_text(values: Iterable[float], digits: int = 2) -> str:
    """Three numbers for a person: ``0.31, -1.20, 0.05``."""
    return ", ".join(f"{value:.{digits}f}" for value in values)


def stop_at_errors(findings: list[Finding]) -> None:
    """A calibration fitted to wrong units or axes is worse than none."""
    for finding in findings:
        if finding.level == "error":
            raise DataError(finding.line)


# Findings on arrays that were never a file speak of the arguments of ``Session.from_arrays``.

#: what a finding states of a file -> the same of arguments, the longer words first
ARGUMENTS = {
    "name the columns gx_dps, gy_dps, gz_dps": 'give rate_unit="dps"',
    "name the columns gx_rps, gy_rps, gz_rps": 'give rate_unit="rad/s"',
    "the values are in g, but the header has ax_mps2; correct the header": 'the values are in g; give force_unit="g"',
    "the values are in m/s², but the header has ax_g; correct the header": 'the values are in m/s²; give force_unit="m/s^2"',
    "correct the name of the time column (t_ns, t_us, t_s), or --time-unit of import": "give t_s in seconds",
    "is the time column's unit right (us read as ns)?": "is t_s in seconds?",
    "correct the columns or their signs where the log is written": "correct the columns of gyro_rps or their signs",
    "correct the columns where the log is written": "correct the columns of gyro_rps",
    "look at the columns, and at [accelerometer] in session.toml": "look at accel_mps2, and at accelerometer=",
    "look at the columns": "look at accel_mps2",
    "look at the column and its unit": "look at temp_c and its unit",
    "correct session.toml, or what converted the log": "correct accel_fs_g, or what made the arrays",
    "correct what converted the log": "correct gyro_fs_dps, or what made the arrays",
    "correct gyro_fs_dps in session.toml": "correct gyro_fs_dps",
    "is [accelerometer] of session.toml this sensor's pre-calibration?": "is accelerometer= this sensor's pre-calibration?",
    "session.toml has": "the argument has",
    "keep it with --accelerometer given": 'keep it with accelerometer="given"',
    "give [accelerometer] where": "give accelerometer= where",
    " in session.toml": "",
    "session.toml": "arguments",
    "turns.csv": "turns=",
}


def as_arguments(finding: Finding) -> Finding:
    """The finding with the words of ``Session.from_arrays``."""
    where, text, do = finding.where, finding.description, finding.do
    for words, arguments in ARGUMENTS.items():
        where, text, do = (text.replace(words, arguments) for text in (where, text, do))
    return replace(finding, where=where, description=text, do=do)
