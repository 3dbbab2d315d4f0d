"""``import``: one door for any log; what it is, its bytes show."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from session.base import features
from session.base.budget import budget
from session.base.errors import FormatError
from session.base.files import MOST_TOML, read_bytes, read_text, replaced
from session.base.options import given, refuse_with, typed
from session.base.texts import comment, install_line, letters_of, printable
from session.log.folder import fill_in, sha256_of
from session.log.lines import STANDARD
from session.replay.binary import registry
from session.replay.convert import Imported, convert
from session.replay.dialects import DIALECTS, OWN
from session.replay.forms import EXAMPLES
from session.replay.options import Answers
from session.replay.raw import convert_raw, is_raw
from session.replay.sources import BY_NAMES, head_of


def import_log(
    paths: Sequence[Path],
    out: Path | None,
    answers: Answers,
    *,
    add: str | None = None,
    serial: str = "",
    columns: Sequence[str] = (),
    header: str | None = None,
    latitude_deg: float | None = None,
    further: Sequence[Any] = (),
    most_memory: int | None = None,
) -> Imported:
    """Make a session folder of a log; out: None for one with the log's name, in the folder where one works.

    header: of a port's bytes as text; latitude_deg, which session.toml gets; further: records of options that features add; most_memory:
    bytes that reading may take (session/base/budget.py).  Raises CalibrationError for options that do nothing here, FormatError and
    DataError, QuestionsError for all that the log does not state, StorageError.
    """
    if latitude_deg is not None:
        if add:
            raise FormatError("--latitude is of the whole session: leave it out with --add, and give it to fit")
        how: dict[str, Any] = {"header": header, "further": further, "most_memory": most_memory}
        return with_latitude(import_log(paths, out, answers, serial=serial, columns=columns, **how), latitude_deg)
    if most_memory is not None:
        with budget(paths, most_memory):
            return import_log(paths, out, answers, add=add, serial=serial, columns=columns, header=header, further=further)
    if add not in (None, "log", "closure"):
        raise FormatError(f"add is {add!r:.40}, expected log or closure")
    if missing := [path for path in paths if str(path) != STANDARD and not path.exists()]:
        raise FormatError(f"{missing[0]}: not found; give the log's file")
    if answers.like is not None:
        answers = replace(answers, like=kind_named(answers.like))
    out = Path(_stem(paths[0])) if out is None else out
    alone = replace(answers, columns=columns[0]) if len(columns) == 1 else answers
    # A file with the name of a port's bytes may be a binary log after all: by its bytes, or by ``--like``.
    binary = paths[0].is_file() and (answers.like in registry.READERS or registry.reader_of(paths[0], head_of(paths[0])) is not None)
    if len(paths) == 1 and not binary and is_raw(paths[0], alone):
        of_logs = given(alone, ("odr_hz", "gyro_fs_dps", "accel_fs_g", "sensor"))
        ignored = {**dict.fromkeys(of_logs, True), "--add": add, "--serial": serial, "--even": answers.even}
        refuse_with(f"{paths[0].name}, a port's bytes", ignored, further)
        return convert_raw(paths[0], out, answers, header)
    if header is not None:
        raise FormatError(f"{paths[0].name}: --header is of a port's bytes, named .bin; of a log, --columns states what its columns are")
    as_given: dict[str, Any] = {"columns": columns, "serial": serial, "add": add, "further": further}
    if (made := features.first("import of logs", paths, out, answers, **as_given)) is not None:
        return made
    return convert(paths, out, answers, add, serial, columns)


def with_latitude(made: Imported, latitude_deg: float) -> Imported:
    """A session folder that was made, with its latitude."""
    fill_in(made.folder / "session.toml", "site", "latitude_deg", latitude_deg)
    return replace(made, next=made.next[:1])


#: begin comments in session.toml: what a folder was made of, with which options, and how that was read
MADE_OF, MADE_WITH, READ_AS = "# made of", "# made with", "# read as:"


def session_next_to(paths: Sequence[Path], answers: Answers) -> tuple[Path, str, bool]:
    """The session folder of a log, next to it, made where it is not there; how the log was read, in one line; and whether it was made now,
    and has no error.

    Raises what ``import_log`` does, and FormatError for a folder that was made of something else.
    """
    folder, config = paths[0].parent / _stem(paths[0]), paths[0].parent / _stem(paths[0]) / "session.toml"
    made_of = [f"{MADE_OF} {comment(path.name)}, sha256 {sha256_of(path)}" for path in paths if path.is_file()]
    options = shlex.join(typed(answers, but=("sensor",)))
    if folder.is_dir() and any(folder.iterdir()):
        text = read_text(config, MOST_TOML) if config.is_file() else ""
        there = [line for line in text.splitlines() if line.startswith((MADE_OF, MADE_WITH, READ_AS))]
        if not made_of or there[: len(made_of)] != made_of:
            raise FormatError(f"{folder}: exists, and was not made of {paths[0].name} as it is now; move it, or import with --out DIR")
        if options and f"{MADE_WITH} {options}" not in there:
            raise FormatError(f"{folder}: exists, and was made with other options than {options}; move it, or leave them out")
        return folder, next((line.removeprefix("# ") for line in there if line.startswith(READ_AS)), ""), False
    made = import_log(paths, folder, answers)
    remarks = [*made_of, *([f"{MADE_WITH} {options}"] if options else []), *([f"# {made.read_as}"] if made.read_as else [])]
    whole = read_bytes(config, MOST_TOML) + "".join(f"{printable(remark)}\n" for remark in remarks).encode()
    with replaced(config) as file:
        file.write(whole)
    return folder, made.read_as, not any(finding.level == "error" for finding in made.findings)


def kind_named(text: str) -> str:
    """The name of ``import --list`` that a text means: its whole, or a beginning that only one has.  FormatError for others."""
    names = list(dict.fromkeys(name for name, _, _ in known_logs()))
    plain = {name: letters_of(name) for name in names}
    wanted = letters_of(text)
    near = [name for name in names if wanted and plain[name].startswith(wanted)]
    whole = [name for name in near if plain[name] == wanted]
    if len(whole or near) == 1:
        return (whole or near)[0]
    expected = f"which may be one of {'; '.join(near)}" if near else f"expected one of {'; '.join(names)}"
    raise FormatError(f"--like is {text[:40]!r}, {expected}")


def _stem(path: Path) -> str:
    """``flight_3.bin`` becomes ``flight_3``.  FormatError where a name is empty."""
    stem = path.resolve().name.split(".")[0]
    if not stem or str(path) == "-":
        raise FormatError(f"{path}: gives no name for the session; give --out DIR")
    return stem


def known_logs() -> Iterator[tuple[str, str, str]]:
    """Of each kind of log that is read: its name, an example line, and the package that it needs."""
    yield OWN, "t_us,gx,gy,gz,ax,ay,az,temp", ""
    for dialect in DIALECTS:
        yield dialect.name, dialect.example, ""
    for name, example in EXAMPLES.items():
        yield name, example, ""
    yield BY_NAMES, "time_ms,accX,accY,accZ,gyroX,gyroY,gyroZ", ""
    for reader in map(registry.format_of, registry.READERS):
        needs = f"{reader.package}: {install_line(reader.extra, reader.package)}" if reader.package else ""
        yield reader.name, reader.example, needs
