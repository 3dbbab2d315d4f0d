"""The sessions of a history: fitted folders, folders that hold such, or a table of them; grouped by unit, in the order of their dates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from session.base import features
from session.base.errors import FormatError
from session.base.files import KB, read_text
from session.base.names import is_session, is_special
from session.base.numeric import derivative, sigmas_in
from session.base.progress import Progress
from session.base.records import DERIVED
from session.base.texts import command_line, printable
from session.base.units import DEG
from session.detect.accelerometer import NAMES as TRIAD
from session.detect.accelerometer import PARAMETERS
from tinygc.estimation.accelerometer import ROWS, UNITS, triad_errors
from tinygc.estimation.session_times import Moment, moment_of, parsed
from tinygc.fitting.listing import folders_of
from tinygc.fitting.unit_state import MODEL, UnitState, fitted_state, in_one_frame, refuse_same
from tinygc.models.linear import NAMES, WORDS, field_facts, field_jacobian, field_vector

#: a table of dates has a line for each session
MOST_DATES = 256 * KB


@dataclass(frozen=True)
class Number:
    """A number of a unit: name and component as people read them, unit, and its size in SI."""

    name: str
    component: str
    unit: str
    si: Annotated[float, DERIVED]

    @property
    def words(self) -> str:
        """``bias x``."""
        return f"{self.name} {self.component}"


_SHOWN = [(word, component, unit, si) for word, components, unit, si in WORDS for component in components]
#: places in ``field_vector`` of what a history follows; the others are combinations of the misalignments
KEPT = [i for i, (word, _, _, _) in enumerate(_SHOWN) if word in ("scale factor error", "misalignment", "bias")]
GYROSCOPE = len(KEPT)
_TRIAD_ORDER = [i for *_, which in ROWS for i in which]
_TRIAD = [Number(f"accelerometer {word}", TRIAD[i].split()[-1], unit, UNITS[unit]) for _, word, unit, which in ROWS for i in which]
#: the numbers of a unit, in the order of every array here
NUMBERS = (*(Number(*_SHOWN[i]) for i in KEPT), *_TRIAD)
#: places of the gyroscope's zero
ZERO = slice(GYROSCOPE - 3, GYROSCOPE)
assert NUMBERS[GYROSCOPE - 1] == Number("bias", "z", "dps", DEG)


@dataclass(frozen=True, eq=False)
class UnitSession:
    """One session of a unit.

    values (21,) SI in the order of ``NUMBERS``, NaN where unknown; covariance (21, 21) of errors that no other session has, NaN there;
    vector (12,) of the calibration, stated (12, 12) its covariance; shared (12, 12): part of it that all sessions were given alike, of the
    gyroscope's numbers; temperature_c: of the session, None where not known.
    """

    name: str
    model: str
    serial: str
    moment: Moment | None
    values: np.ndarray
    covariance: np.ndarray
    vector: np.ndarray
    stated: np.ndarray
    shared: np.ndarray = field(default_factory=lambda: np.zeros((GYROSCOPE, GYROSCOPE)))
    temperature_c: float | None = None

    @property
    def sigmas(self) -> np.ndarray:
        """(21,) SI."""
        return sigmas_in(self.covariance)


def sessions_of(
    paths: Sequence[Path], dates: Mapping[str, Moment], progress: Progress, serial: str = ""
) -> tuple[dict[tuple[str, str], list[UnitSession]], list[str]]:
    """Sessions by unit (model, serial), and remarks on what was passed over.

    Raises FormatError for what is no fitted session and holds none, for a date of no session, for a serial that is not there, and for
    one of several sessions that names no serial number.
    """
    read: list[UnitState] = []
    units: dict[tuple[str, str], list[UnitSession]] = {}
    remarks: list[str] = []
    used: set[str] = set()
    for path in paths:
        if (fitted := features.first("fitted sessions of a table", path)) is not None:
            for session in (each for row in fitted if (each := _of_row(row)) is not None):
                units.setdefault((session.model, session.serial), []).append(_dated(session, dates, used))
            continue
        folders, passed = _fitted_folders(path)
        remarks += passed
        for folder in folders:
            progress(f"reading {printable(folder.name)}", len(read), len(folders))
            read.append(fitted_state(folder))
    refuse_same(read)
    grouped: dict[tuple[str, str], list[UnitState]] = {}
    for one in read:
        grouped.setdefault((printable(one.settings.sensor.model), printable(one.settings.sensor.serial)), []).append(one)
    for unit, of_unit in grouped.items():
        units.setdefault(unit, []).extend(_dated(session, dates, used) for session in unit_sessions(of_unit))
    if unknown := sorted(set(dates) - used):
        raise FormatError(f"--dates: {unknown[0]} is no session of these; expected names of folders: {_named(units)}")
    if serial:
        units = {unit: each for unit, each in units.items() if unit[1] == serial}
    if not units:
        raise FormatError(f"--serial {serial}: no session of that serial number; leave it out to see all")
    nameless = [each.name for unit, sessions in units.items() if not unit[1] for each in sessions]
    if nameless and sum(map(len, units.values())) > 1:
        raise FormatError(f"{nameless[0]}: names no serial number; give sensor.serial in its session.toml, so that its unit is known")
    return units, remarks


def _named(units: Mapping[tuple[str, str], Sequence[UnitSession]]) -> str:
    names = [session.name for each in units.values() for session in each]
    return f"{', '.join(names[:5])}{' …' if len(names) > 5 else ''}"


def _fitted_folders(path: Path) -> tuple[list[Path], list[str]]:
    if not path.is_dir():
        what = "that is a file" if path.exists() else "not found"
        raise FormatError(f"{path}: {what}; expected a fitted session folder, a folder that holds such, or a table of them")
    if is_session(path):
        return [path], []
    found, passed = [], []
    for folder in folders_of(path):
        if is_special(folder) or not (folder / "session.toml").exists():
            passed.append(f"{printable(folder.name)} is passed over: it is no session of one sensor")
        elif not (folder / MODEL).exists():
            passed.append(f"{printable(folder.name)} is passed over: it is not fitted; run `{command_line('fit', folder)}`")
        else:
            found.append(folder)
    if not found:
        why = f" ({passed[0]})" if passed else ""
        raise FormatError(f"{path}: holds no fitted session{why}; expected session folders with {MODEL}")
    return found, passed


def unit_sessions(sessions: Sequence[UnitState]) -> list[UnitSession]:
    """Sessions of one unit, their numbers in the body frame of the last one that was read."""
    return list(map(_session_of, sessions, *in_one_frame(sessions, sessions[-1].triad.calibration)))


def _session_of(each: UnitState, vector: np.ndarray, whole: np.ndarray, own: np.ndarray) -> UnitSession:
    values, covariance, shared = gyroscope_numbers(vector, own, whole, each.unobserved)
    triad_values, triad_covariance = np.full(PARAMETERS, np.nan), np.full((PARAMETERS, PARAMETERS), np.nan)
    if each.triad.covariance is not None:
        slope = each.triad.jacobian
        triad_values, triad_covariance = triad_numbers(each.triad.values, slope @ each.triad.covariance @ slope.T)
        hidden = np.isin([TRIAD[i] for i in _TRIAD_ORDER], each.triad.unobserved)
        triad_values[hidden], triad_covariance[hidden], triad_covariance[:, hidden] = np.nan, np.nan, np.nan
    sensor = each.settings.sensor
    return UnitSession(
        each.name,
        printable(sensor.model),
        printable(sensor.serial),
        each.moment,
        np.concatenate([values, triad_values]),
        _blocks(covariance, triad_covariance),
        vector,
        whole,
        shared,
        each.temperature_c,
    )


def gyroscope_numbers(
    vector: np.ndarray, own: np.ndarray, whole: np.ndarray, unobserved: tuple[str, ...] = ()
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values (12,), own covariance and shared covariance (12, 12) of a calibration (12,); own, whole (12, 12): its covariances."""
    jacobian = field_jacobian(vector)[KEPT]
    values, covariance = field_vector(vector)[KEPT], jacobian @ own @ jacobian.T
    quantities = field_facts(vector, whole, unobserved)
    hidden = ~np.array([quantities[i].observed for i in KEPT])
    values[hidden], covariance[hidden], covariance[:, hidden] = np.nan, np.nan, np.nan
    return values, covariance, jacobian @ (whole - own) @ jacobian.T


def triad_numbers(correction: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (9,) and covariance (9, 9) of the accelerometer's errors, in the order of ``NUMBERS``, from its correction (9,)."""
    slope = derivative(triad_errors, correction)[_TRIAD_ORDER]
    return triad_errors(correction)[_TRIAD_ORDER], slope @ covariance @ slope.T


def _blocks(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    found = np.zeros((len(NUMBERS), len(NUMBERS)))
    found[:GYROSCOPE, :GYROSCOPE], found[GYROSCOPE:, GYROSCOPE:] = one, other
    return found


def _of_row(found: Any) -> UnitSession | None:
    """A fitted session of a table; its numbers are in the frame of its own accelerometer.  None where an axis was not turned."""
    row, covariance = found.values, found.covariance
    if np.isnan(row[:GYROSCOPE]).any() or np.isnan(covariance[:GYROSCOPE, :GYROSCOPE]).any():
        return None
    when, folder = parsed(found.recorded), Path(found.folder)
    vector, own = row[: len(NAMES)], covariance[: len(NAMES), : len(NAMES)]
    values, gyro, _ = gyroscope_numbers(vector, own, own)
    triad = np.full(PARAMETERS, np.nan), np.full((PARAMETERS, PARAMETERS), np.nan)
    if np.isfinite(row[len(NAMES) :]).all():
        triad = triad_numbers(row[len(NAMES) :], covariance[len(NAMES) :, len(NAMES) :])
    moment = moment_of(folder, None) if when is None else Moment(when, "notes")
    name, model, serial = (printable(each) for each in (folder.name, found.model, found.serial))
    return UnitSession(name, model, serial, moment, np.concatenate([values, triad[0]]), _blocks(gyro, triad[1]), vector, own)


# Dates that a person gives.


def read_dates(path: Path) -> dict[str, Moment]:
    """Lines of a folder's name and a date in ISO 8601, with a comma between them; ``#`` begins a comment, a header is passed over.

    Raises FormatError with the line for a date that is none, and for a session with two of them.
    """
    found: dict[str, Moment] = {}
    for number, line in enumerate(read_text(path, MOST_DATES).splitlines(), 1):
        text = line.split("#", 1)[0].strip()
        if not text or (number == 1 and text.lower().replace(" ", "") == "session,date"):
            continue
        name, comma, written = (part.strip() for part in text.rpartition(","))
        when = parsed(written) if comma else None
        if when is None or not name:
            raise FormatError(f"{path}:{number}: {text!r:.80} is no session with its date; expected a line such as day1,2026-11-05")
        name = printable(Path(name).name)
        if name in found:
            raise FormatError(f"{path}:{number}: {name} has a date already; give each session once")
        found[name] = Moment(when, "given")
    return found


def _dated(session: UnitSession, dates: Mapping[str, Moment], used: set[str]) -> UnitSession:
    if session.name not in dates:
        return session
    used.add(session.name)
    return replace(session, moment=dates[session.name])
