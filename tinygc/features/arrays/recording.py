"""An array's folder as one record: several units on one rigid body, each a session of its own."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np

from session.base.errors import CalibrationError, DataError, FormatError
from session.base.files import require_file
from session.base.names import log_paths
from session.base.progress import Reporter, no_report
from session.base.results import Keys, require, shown
from session.base.texts import printable
from session.base.toml import read_toml
from session.base.units import NS
from session.log.config import DO, SHAPE, Config, config_of, read_session_toml
from session.log.folder import ATTITUDES, Session, read_logs, read_session
from session.log.logfile import NAME as KNOWN_TURNS
from tinygc.features.arrays.feature import FOLDERS, LARGEST_NUMBER, UNIT, array_section, array_size, unit_of

# Several units that were fixed to one rigid body and recorded at the same time: each a session of its own, on its own clock.


@dataclass(frozen=True, eq=False)
class ArraySession:
    """units: of each unit what a session folder of its own would hold, stamps as its own clock gave them; numbers: theirs, increasing.

    The array's body frame is that of ``units[0]``, and so is its clock.
    """

    folder: Path
    numbers: tuple[int, ...]
    units: tuple[Session, ...]

    def __len__(self) -> int:
        return len(self.units)

    @property
    def name(self) -> str:
        """The folder's last name, as it may stand in a line."""
        return printable(self.folder.resolve().name)

    def own_folder(self, name: str) -> Path:
        """Where results of that name go, unless another place is given.  CalibrationError where the array was never a folder."""
        if not self.folder.is_dir():
            raise CalibrationError(f"{self.name}: made of arrays, it has no folder of its own; give one to save to")
        return self.folder / name


# An array's folder as one record: logs that name their unit, or a list of session folders, one for each unit (arrays.md).

#: sections that an array has for all of its units
SHARED = {name: SHAPE.may[name] for name in ("notes", "exclude", "still")}
#: of a unit's table: sections of session.toml that are a unit's own
OWN_SECTIONS = ("sensor", "accelerometer")
UNIT_KEYS = ("number", *OWN_SECTIONS)
LEAST_UNITS = 2
#: readings that are compared first, which differ between any two sensors
BEGINS = 1000


def read_array(folder: Path | str, progress: Reporter = no_report) -> ArraySession:
    """Read a whole array.  ``progress`` is called with each file's name.

    Raises FormatError or DataError, naming file and line, for what the format does not allow; stamps stay as each unit's clock gave them.
    """
    folder = Path(folder)
    if array_size(folder) is None:
        hint = "is no folder" if not folder.is_dir() else "is no array: it has neither log0001.unit0.csv and so on, nor [array] folders"
        raise FormatError(f"{folder}: {hint} (docs/features/arrays/arrays.md)")
    path = folder / "session.toml"
    table = read_session_toml(path)
    section = table.get("array", {})
    if not isinstance(section, dict):
        raise FormatError(f"{path}: [array] must be a table, not {shown(section)}")
    read = _by_folders if FOLDERS in section else _by_names
    units = dict(sorted(read(folder, path, table, section, progress).items()))
    if len(units) < LEAST_UNITS:
        only = _listed(list(units))
        raise FormatError(f"{folder}: an array of one unit (unit {only}); expected two or more, or a session folder without [array]")
    return _checked(folder, units)


def array_of(units: Sequence[Session], name: str = "array") -> ArraySession:
    """An array of sessions that are in memory, numbered from 0 in their order.  Raises DataError or FormatError as ``read_array``."""
    if Path(name).name != name or not name or "\0" in name:
        raise DataError(f"name is {name!r:.60}, expected one word, as of a folder")
    if len(units) < LEAST_UNITS:
        raise DataError(f"{name}: an array of {len(units)} unit{'s' * (len(units) != 1)}; expected two sessions or more")
    for number, unit in enumerate(units):
        _refuse_other_reference(f"{name}: unit {number} has reference", unit.config, DataError)
    return _checked(Path(name), dict(enumerate(units)))


def _by_names(folder: Path, path: Path, table: dict, section: dict, progress: Reporter) -> dict[int, Session]:
    """Units whose logs lie in this folder, log0001.unit0.csv and so on."""
    paths = {stem: log_paths(folder, stem) for stem in ("log", "closure", "rest")}
    alone = [each for each in (*paths["log"], *paths["closure"]) if unit_of(each) is None]
    numbers = tuple(sorted({unit[1] for present in paths.values() for unit in map(unit_of, present) if unit is not None}))
    if not numbers:
        raise FormatError(f"{path}: [array] without folders, and no log names its unit; expected log0001.unit0.csv, log0001.unit1.csv …")
    if alone:
        raise FormatError(f"{folder}: {alone[0].name} names no unit next to units {_listed(numbers)}; expected {_with_unit(alone[0])}")
    for name in (ATTITUDES, KNOWN_TURNS):
        if os.path.lexists(folder / name):
            raise FormatError(f"{folder}: {name} is of one sensor's axes and stills; give that unit a folder of its own ([array] folders)")
    for stem, present in paths.items():
        if stem != "rest":
            # FormatError where a log has not the units of another
            by_log: dict[str, set[int]] = {}
            for unit in map(unit_of, present):
                assert unit is not None  # or it was refused
                by_log.setdefault(unit[0], set()).add(unit[1])
            for which, there in sorted(by_log.items()):
                if missing := sorted(set(numbers) - there):
                    raise FormatError(
                        f"{folder}: {which} has no unit {_listed(missing)} of {_listed(numbers)}; every {stem} needs a file of every unit: "
                        f"add {which}.unit{missing[0]}.csv, or take that unit's other logs out"
                    )
    for each in (*paths["log"], *paths["closure"], *paths["rest"]):
        require_file(each)
    # [[array.unit]] by its number
    rows = section.get(UNIT, [])
    expected = "[[array.unit]] expects number = 3, and sensor.serial, accelerometer.matrix and the like"
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise FormatError(f"{path}: array.unit is {shown(rows)}; {expected}")
    own: dict[int, dict] = {}
    for row in rows:
        number = row.get("number")
        if isinstance(number, bool) or not isinstance(number, int):
            raise FormatError(f"{path}: array.unit has number {shown(number)}; {expected}")
        if number in own:
            raise FormatError(f"{path}: [[array.unit]] number {number} is there twice; keep one")
        if number not in numbers:
            raise FormatError(f"{path}: [[array.unit]] number {number} has no log; there are units {_listed(numbers)}")
        for name in OWN_SECTIONS:
            if not isinstance(row.get(name, {}), dict):
                raise FormatError(f"{path}: array.unit.{name} of unit {number} is {shown(row[name])}, expected a table")
        own[number] = row
    unknown = _unknown(section, ("folders", UNIT), "array")
    units = {}
    for number in numbers:
        config = _unit_config(path, table, own.get(number, {}), number)
        mine = {stem: [each for each in present if _number(each) == number] for stem, present in paths.items()}
        config = config.with_names(partial(_log_of_unit, path, mine["log"], number == numbers[0], numbers))
        if number == numbers[0]:
            config = replace(config, unknown=(*config.unknown, *unknown))
        units[number] = read_logs(folder, config, mine["log"], mine["closure"], mine["rest"], progress)
    return units


def _number(path: Path) -> int | None:
    unit = unit_of(path)
    return None if unit is None else unit[1]


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))


def _with_unit(path: Path) -> str:
    return path.name.replace(".csv", ".unit0.csv", 1)


def _unit_config(path: Path, table: dict, own: dict, number: int) -> Config:
    """session.toml as it holds for one unit: its entries for all, and over them those for this one."""
    if "accelerometer" in table:
        raise FormatError(f"{path}: [accelerometer] is of one unit; write it as [array.unit.accelerometer] under its [[array.unit]]")
    merged = {name: value for name, value in table.items() if name != "array"}
    for name in OWN_SECTIONS:
        shared = table.get(name, {})
        if name in own and isinstance(shared, dict):
            merged[name] = {**shared, **own[name]}
    config = config_of(Path(f"{path} (unit {number})") if own else path, merged)
    _refuse_other_reference(f"{path}: protocol.reference is", config)
    return replace(config, unknown=(*config.unknown, *_unknown(own, UNIT_KEYS, "array.unit")))


def _unknown(table: dict, known: Sequence[str], name: str) -> tuple[tuple[str, str | None], ...]:
    """Keys that nothing reads, as ``Config.unknown`` has them."""
    near = {key: get_close_matches(str(key).lower(), known, n=1, cutoff=0.75) for key in table if key not in known}
    return tuple((f"{name}.{key}", f"{name}.{found[0]}" if found else None) for key, found in near.items())


def _log_of_unit(path: Path, logs: Sequence[Path], first: bool, numbers: Sequence[int], named: str) -> str | None:
    """The log of this unit that a row of session.toml names; of the first unit, whose clock is the array's, one that names no unit."""
    unit, name = unit_of(Path(named)), named.removesuffix(".gz")
    if unit is not None and unit[1] not in numbers:
        raise FormatError(f"{path}: an [[exclude]] or [[still]] names {named}; there are units {_listed(numbers)}")
    if unit is None and first:
        return _with_unit(Path(name)).replace(".unit0.", f".unit{numbers[0]}.")
    if any(each.name.removesuffix(".gz") == name for each in logs) or (unit is not None and unit[1] == _number(logs[0])):
        return named  # also of a log that is not there: check reports it
    return None


def _by_folders(folder: Path, path: Path, table: dict, section: dict, progress: Reporter) -> dict[int, Session]:
    """Units that have a session folder each, inside this one or next to it."""
    names = section[FOLDERS]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise FormatError(f'{path}: array.folders is {shown(names)}, expected session folders such as ["imu0", "imu2"]')
    if here := log_paths(folder, "log"):
        raise FormatError(f"{folder}: {here[0].name} lies next to session.toml with [array] folders; keep logs here or folders, not both")
    if UNIT in section:
        raise FormatError(f"{path}: [[array.unit]] with array.folders; each folder's own session.toml describes its unit")
    require(table, Keys(may=SHARED), str(path), DO)
    notes = table.get("notes", {})
    excluded, stills = (SHARED[key].made(table.get(key, [])) for key in ("exclude", "still"))
    places = [place_of(folder, path, name) for name in names]
    numbers = numbers_of(path, names)
    units = {}
    for number, place, name in zip(numbers, places, names, strict=True):
        if array_size(place) is not None:
            raise FormatError(f"{path}: array.folders holds {shown(name)}, which is an array itself; name its units' folders")
        session = read_session(place, partial(_report, progress, name))
        _refuse_other_reference(f"{place}: protocol.reference is", session.config)
        config = session.config
        units[number] = replace(session, config=replace(config, notes={**notes, **config.notes}))
    first = units[min(units)]
    others = tuple((key, None) for key in table if key not in ("schema", "array", *SHARED))
    unknown = (*others, *_unknown(section, (FOLDERS, UNIT), "array"))
    own = replace(
        first.config,
        exclude=(*first.config.exclude, *excluded),
        still=(*first.config.still, *stills),
        unknown=(*first.config.unknown, *unknown),
    )
    return {**units, min(units): replace(first, config=own)}


def _report(progress: Reporter, name: str, what: str) -> None:
    progress(f"{name}/{what}")


def place_of(folder: Path, path: Path, name: str) -> Path:
    """A unit's folder.  FormatError where it is not there, or neither inside the array's nor next to it."""
    plain = Path(os.path.normpath(name))
    inside = plain.parts[:1] != ("..",) and plain != Path(".")
    sibling = plain.parts[:1] == ("..",) and len(plain.parts) > 1 and plain.parts[1] != ".."
    if "\0" in name or plain.is_absolute() or not (inside or sibling):
        raise FormatError(f"{path}: array.folders holds {shown(name)}; expected a folder inside this one, or next to it as ../imu0")
    place = folder / plain
    if not place.is_dir():
        raise FormatError(f"{path}: array.folders holds {shown(name)}, which is {'no folder' if place.exists() else 'not there'}")
    if place.resolve() == folder.resolve():
        raise FormatError(f"{path}: array.folders holds {shown(name)}, which is this folder itself; name the units' folders")
    return place


def numbers_of(path: Path, names: Sequence[str]) -> tuple[int, ...]:
    """By the digits that each name ends with; by their order where one has none."""
    plain = [os.path.normpath(name) for name in names]
    if doubled := next((name for name in plain if plain.count(name) > 1), None):
        raise FormatError(f"{path}: array.folders holds {shown(doubled)} twice; keep one")
    ends = [re.search(r"(?<![0-9])[0-9]+$", name) for name in plain]
    if not all(ends):
        return tuple(range(len(names)))
    numbers = tuple(int(end[0]) if len(end[0]) <= len(str(LARGEST_NUMBER)) else LARGEST_NUMBER + 1 for end in ends if end is not None)
    if max(numbers) > LARGEST_NUMBER:
        return tuple(range(len(names)))  # a date or a serial number, and no unit's
    for (one, first), (other, second) in combinations(zip(numbers, plain, strict=True), 2):
        if one == other:
            raise FormatError(f"{path}: array.folders holds {shown(first)} and {shown(second)}, both unit {one} by their ends; rename one")
    return numbers


def _checked(folder: Path, units: Mapping[int, Session]) -> ArraySession:
    """The array of these units.

    FormatError where they have not as many logs, or closure runs, each; DataError where two units' stamps of one log have no moment in
    common, or where two have the very same readings, whose noise would count as two sensors'.
    """
    for what, word in (("logs", "logs"), ("closures", "closure runs")):
        counts = {number: len(getattr(unit, what)) for number, unit in units.items()}
        first, count = next(iter(counts.items()))
        for number, other in counts.items():
            if other != count:
                raise FormatError(f"{folder}: unit {first} has {count} {word}, unit {number} has {other}; expected the same of every unit")
    logs = [(*unit.logs, *unit.closures) for unit in units.values()]
    for both in (pair for of_one_time in zip(*logs, strict=True) for pair in combinations(zip(units, of_one_time, strict=True), 2)):
        (one, first_log), (other, second_log) = both
        (begin, end), (since, until) = ((float(log.samples.t_ns[0]) * NS, float(log.samples.t_ns[-1]) * NS) for _, log in both)
        if max(begin, since) >= min(end, until):
            raise DataError(
                f"{folder}: units {one} and {other} have no time in common: {first_log.path.name} is {begin:.3f} to {end:.3f} s, "
                f"{second_log.path.name} {since:.3f} to {until:.3f} s; expected one recording, on clocks that agree to some seconds"
            )
        ours, theirs = (np.asarray(log.samples.gyro) for _, log in both)
        head = ours[:BEGINS]
        if np.ptp(head, axis=0).any() and np.array_equal(head, theirs[:BEGINS]) and np.array_equal(ours, theirs):
            raise DataError(
                f"{folder}: units {one} and {other} have the very same rates ({first_log.path.name}, {second_log.path.name}): one sensor "
                "twice; take one of them out"
            )
    return ArraySession(folder, tuple(units), tuple(units.values()))


def _refuse_other_reference(where: str, config: Config, error: type[Exception] = FormatError) -> None:
    """Raise the error where the reference of a unit is not gravity; where: what the message begins with."""
    if (reference := config.protocol.reference) != "gravity":
        raise error(f'{where} "{reference}"; the reference of an array is "gravity" and its other units')


# Where the logs of an array's units lie, without reading them.


def array_log_paths(folder: Path) -> dict[str, dict[int, Path]]:
    """Of each log and closure run, ``log0001`` and so on, the file of each unit by its number; folders' logs are paired in their order.

    FormatError where a folder is no array, or a log has not all units.
    """
    toml = folder / "session.toml"
    section = array_section(read_toml(toml)) if toml.exists() else None
    names = (section or {}).get(FOLDERS)
    found: dict[str, dict[int, Path]] = {}
    for stem in ("log", "closure"):
        if isinstance(names, list) and names and all(isinstance(name, str) for name in names):
            for number, name in sorted(zip(numbers_of(toml, names), names, strict=True)):
                for i, path in enumerate(log_paths(place_of(folder, toml, name), stem), 1):
                    found.setdefault(f"{stem}{i:04d}", {})[number] = path
            for which, paths in found.items():
                if len(paths) < len(names):
                    missing = ", ".join(str(number) for number in sorted(numbers_of(toml, names)) if number not in paths)
                    raise FormatError(f"{folder}: {which} has no unit {missing}; every unit needs as many logs, and as many closure runs")
        else:
            for path in log_paths(folder, stem):
                if (unit := unit_of(path)) is not None:
                    found.setdefault(unit[0], {})[unit[1]] = path
    if not found:
        raise FormatError(
            f"{folder}: no array: it has neither log0001.unit0.csv and so on, nor [array] folders (docs/features/arrays/arrays.md)"
        )
    return {which: dict(sorted(found[which].items())) for which in sorted(found)}
