"""The corrected copy of a session whose units, axes, scale, time or settings ``check`` has found wrong, with its provenance."""

from __future__ import annotations

import contextlib
import gzip
import re
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

from session import VERSION
from session.base.errors import DataError, FormatError
from session.base.files import MOST_TOML, copy_new, folder_whole, read_text, replaced
from session.base.names import log_paths, refuse_special
from session.base.records import write_whole
from session.base.toml import edited, setting
from session.base.units import ENDINGS, WORDS
from session.detect.findings import Axes, Correction, Finding
from session.detect.first_look import check_folder
from session.log.config import read_config, reference_of
from session.log.folder import sha256_of
from session.log.lines import Lines

# From findings to a copy.
#
# The causes are reversed one after the other: time first, since stills depend on it; then settings and the accelerometer's unit, which the
# gyroscope is examined against; then axes; then the gyroscope's scale.  Of several causes that explain one finding, each is tried on a
# copy: the one that leaves fewest errors is right, and where two leave as few, nothing shows which it is.  One after which gyroscope and
# gravity do not close is none.

NAME, SCHEMA = "repaired.json", "tinygc-repair/1"
#: what a finding is of, in the order in which its cause is reversed
STAGES = ("time unit", "sample rate", "full scale", "gravity", "axes", "gyro scale")


@dataclass(frozen=True)
class Change:
    """A cause that was reversed: the finding it explains, what it was, and the files whose columns changed."""

    what: str
    cause: Correction
    files: tuple[str, ...]

    def to_json(self) -> dict:
        """Return one of ``changes`` of ``tinygc-repair/1``."""
        return {
            "finding": self.what,
            "cause": self.cause.description,
            "files": list(self.files),
            "columns": self.cause.kind,
            "factor": self.cause.factor,
            "axes": None if self.cause.axes is None else [list(row) for row in self.cause.axes],
            "settings": dict(self.cause.settings),
        }


@dataclass(frozen=True)
class Repaired:
    """A corrected copy: folder of the source and of the copy, what was changed, SHA-256 of the source's files, the copy's findings."""

    source: Path
    folder: Path
    changes: tuple[Change, ...]
    sha256: dict[str, str]
    findings: tuple[Finding, ...]

    def to_json(self) -> dict:
        """Return ``tinygc-repair/1``."""
        return {
            "schema": SCHEMA,
            "session": self.source.resolve().name,
            "sha256": self.sha256,
            "changes": [change.to_json() for change in self.changes],
            "version": VERSION,
        }


def repair(source: Path, out: Path, cause: int | None = None) -> Repaired:
    """Write the corrected copy of a session folder into ``out``, which must not exist.

    cause: which of several causes that explain a finding alike, counted from 1 as the refusal lists them.
    Raises FormatError where ``out`` exists or the folder is an array, and DataError where no cause is determined, or several explain alike.
    """
    if out.exists():
        raise FormatError(f"{out}: exists; give --repair a new folder")
    refuse_special(source)
    protocol = read_config(source / "session.toml").protocol  # what is not there is named as the user wrote it
    if (kind := reference_of(protocol.reference)) is not None:
        raise DataError(
            f"{source}: a {kind.title} has its own clock and axes (see check); --repair takes sessions whose reference is gravity"
        )
    with folder_whole(out) as whole, tempfile.TemporaryDirectory(dir=whole) as work:
        copy, changes = Path(work) / "0", []
        names = _copy(source, copy)
        sha256 = {name: sha256_of(source / name) for name in names}
        findings = check_folder(copy)
        while (what := _stage(findings)) is not None:
            copy, findings, change, cause = _reverse(source, copy, findings, what, cause)
            changes.append(change)
        if not changes:
            raise DataError(f"{source}: {_why_not(findings)}")
        if cause is not None:
            raise DataError(f"{source}: no several causes explain alike; leave --cause out")
        done = Repaired(source, out, tuple(changes), sha256, tuple(findings))
        _note(copy, done)
        for path in copy.iterdir():
            path.rename(whole / path.name)
    return done


def _copy(source: Path, folder: Path) -> list[str]:
    """Copy what a session is read from; returns the files' names."""
    folder.mkdir()
    names = ["session.toml", "attitudes.csv", "turns.csv"]
    names += [path.name for stem in ("log", "closure", "rest") for path in log_paths(source, stem)]
    names = [name for name in names if (source / name).exists()]
    for name in names:
        copy_new(source / name, folder / name)
    return names


def can_be_repaired(findings: Iterable[Finding]) -> bool:
    """Whether the cause of any error is known."""
    return _stage(findings) is not None


def _explained(findings: Iterable[Finding], what: str) -> list[Finding]:
    """Errors of a kind whose causes are known."""
    return [finding for finding in findings if finding.what == what and finding.level == "error" and finding.corrections]


def _stage(findings: Iterable[Finding]) -> str | None:
    findings = list(findings)
    return next((what for what in STAGES if _explained(findings, what)), None)


def _why_not(findings: Sequence[Finding]) -> str:
    errors = [finding for finding in findings if finding.level == "error"]
    return f"no cause is determined: {errors[0].line}" if errors else "nothing to repair: check finds no error"


def _reverse(
    source: Path, copy: Path, findings: list[Finding], what: str, cause: int | None
) -> tuple[Path, list[Finding], Change, int | None]:
    """Reverse the cause of one finding in a further copy; returns it, its findings, what was changed, and ``cause`` unless it was used."""
    mine = _explained(findings, what)
    tried = []
    for number, each in enumerate(mine[0].corrections):
        folder = copy.with_name(f"{copy.name}{number}")
        change = _apply(copy, folder, each, what, findings)
        after = check_folder(folder)
        # Where gyroscope and gravity close with no order, sign and scale at all, nothing has been put right.
        closes = all(each.what not in ("gyro against gravity", "gravity moves") or each.level == "note" for each in after)
        if len(_explained(after, what)) < len(mine) and closes:
            tried.append((sum(finding.level == "error" for finding in after), folder, after, change))
    fewest = min((errors for errors, *_ in tried), default=0)
    best = [(folder, after, change) for errors, folder, after, change in tried if errors == fewest]
    if not best:
        causes = " and ".join(each.description for each in mine[0].corrections)
        raise DataError(f"{source}: no cause is determined: {mine[0].line}; undone ({causes}), it is still there")
    if len(best) == 1:
        return *best[0], cause
    if cause is None:
        listed = "; ".join(f"{number}: {change.cause.description}" for number, (_, _, change) in enumerate(best, start=1))
        raise DataError(f"{source}: {len(best)} causes explain {what} alike: {listed}; choose one (--cause 1, 2)")
    if not 1 <= cause <= len(best):
        raise DataError(f"{source}: --cause is {cause}, expected 1 to {len(best)}")
    return *best[cause - 1], None


# The copy itself: session.toml, and the columns of the logs.


def _apply(copy: Path, folder: Path, cause: Correction, what: str, findings: list[Finding]) -> Change:
    """Write a copy of a copy without one cause: its logs, but for those in which this check found another one, or nothing; session.toml."""
    names = _copy(copy, folder)
    kinds = (what, "sample rate") if what == "time unit" else (what,)
    other = {f.where for f in findings if f.what in kinds and cause not in f.corrections and (f.corrections or f.level != "error")}
    logs = [name for name in names if name not in ("session.toml", "attitudes.csv", "turns.csv")]
    files = tuple(name for name in logs if cause.kind and name not in other)
    for name in logs:
        if name in files or cause.settings:
            _rewrite(copy / name, folder / name, cause, name in files)
    path = folder / "session.toml"
    times = {name.removesuffix(".gz"): cause.factor for name in files if cause.kind == "time"}
    if cause.settings or times:
        _edit(path, partial(_set, cause=cause, times=times))
    return Change(what, cause, files)


def _edit(path: Path, change: Callable[[Any], None]) -> None:
    """Change a session.toml, whatever its line ends; what is not touched stays as it is written."""
    text = edited(read_text(path, MOST_TOML).replace("\r\n", "\n").replace("\r", "\n"), change)
    with replaced(path) as file:
        file.write(text.encode())


def _set(document: Any, cause: Correction, times: dict[str, float]) -> None:
    """Other settings of the sensor; moments that the file names, on another clock."""
    for key, value in cause.settings:
        document.setdefault("sensor", {})[key] = setting(value)
    for row in (*document.get("exclude", []), *document.get("still", [])):
        for key in [key for key in row if key.endswith("_s")]:
            row[key] = float(row[key]) * times.get(str(row["log"]).removesuffix(".gz"), 1.0)


def _note(folder: Path, done: Repaired) -> None:
    """The provenance: a file of its own, and a note in session.toml, which the report shows; a note that is there stays."""
    write_whole(folder / NAME, done.to_json())
    text = f"{'; '.join(change.cause.description for change in done.changes)} ({NAME})"

    def add(document: Any) -> None:
        notes = document.setdefault("notes", {})
        notes[next(name for number in count(1) if (name := f"repaired{number if number > 1 else ''}") not in notes)] = text

    _edit(folder / "session.toml", add)


AS_LOGGED: Axes = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
#: a comment of a log that states a setting
STATED = r"\b({})=\S+"
#: the largest number of a register of 16 bits, which has no smallest one's opposite
REGISTER_END = 32767


def _rewrite(source: Path, path: Path, cause: Correction, columns: bool) -> None:
    """Write a log with other columns, and with comments that agree with the settings; what is no row stays as it is."""
    stated = [(re.compile(STATED.format(key)), f"{key}={setting(value):g}") for key, value in cause.settings]
    write: Callable[[list[str]], list[str]] | None = None
    with contextlib.ExitStack() as stack:
        lines, binary = stack.enter_context(Lines(source)), stack.enter_context(replaced(path))
        packed = path.suffix.lower() == ".gz"
        file = stack.enter_context(gzip.GzipFile("", "wb", fileobj=binary, mtime=0)) if packed else binary
        width = 0
        while some := lines.take():
            for text in some:
                if text.lstrip().startswith("#"):
                    for pattern, value in stated:
                        text = pattern.sub(value, text)
                elif text.strip() and columns:
                    cells = text.split(",")
                    if write is None:
                        first = next((line for line in some[some.index(text) + 1 :] if line.strip() and line[0] != "#"), "")
                        cells, write, width = *_columns([cell.strip() for cell in cells], cause, first.split(",")), len(cells)
                        text = ",".join(cells)
                    elif len(cells) == width:
                        with contextlib.suppress(ValueError):  # a last line that was cut off
                            text = ",".join(write(cells))
                file.write(f"{text}\n".encode())


def _columns(names: list[str], cause: Correction, first: list[str]) -> tuple[list[str], Callable[[list[str]], list[str]]]:
    """The header of a log without the cause, and what writes a row; first: the first row."""
    names, factors, whole = list(names), {}, False
    if cause.kind == "time":
        at = next(i for i, name in enumerate(names) if re.fullmatch("t_(" + "|".join(ENDINGS["time"]) + ")", name))
        unit = _renamed("time", names[at].removeprefix("t_"), cause.factor)
        if unit is not None and (unit == "s" or (len(first) > at and first[at].strip().isdigit())):
            names[at] = f"t_{unit}"
        else:
            factors[at], whole = cause.factor, names[at] != "t_s"
    else:
        letter = cause.kind[0]
        at_axis = {m[1]: i for i, name in enumerate(names) if (m := re.fullmatch(rf"{letter}([xyz])(?:_\w+)?", name))}
        suffix = names[at_axis["x"]][2:]
        factor, unit = cause.factor, _renamed(cause.kind, suffix.removeprefix("_"), cause.factor)
        if unit is not None:
            suffix, factor = f"_{unit}", 1.0
        for row, axis in zip(cause.axes or AS_LOGGED, "xyz", strict=True):
            logged = next(i for i in range(3) if row[i])
            at = at_axis["xyz"[logged]]
            names[at] = f"{letter}{axis}{suffix}"
            if factor * row[logged] != 1.0:
                factors[at] = factor * row[logged]
        whole = suffix == ""

    def write(cells: list[str]) -> list[str]:
        for i, factor in factors.items():
            cells[i] = str(_whole(cells[i], factor, whole and cause.kind != "time")) if whole else repr(float(cells[i]) * factor)
        return cells

    return names, write


def _whole(cell: str, factor: float, register: bool) -> int:
    value = round(int(cell) * factor)
    return min(value, REGISTER_END) if register else value


def _renamed(kind: str, word: str, factor: float) -> str | None:
    """The unit of ours that is ``factor`` times this one; None where there is none, and numbers must change."""
    have = WORDS[kind].get(word)
    return None if have is None else next((other for other in ENDINGS[kind] if abs(have * factor / WORDS[kind][other] - 1) < 1e-9), None)
