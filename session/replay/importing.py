"""``import``: one door for any log; what it is, its bytes say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path

from session.io.annexes import find, need
from session.io.dialects import DIALECTS, Answers
from session.io.errors import FormatError
from session.io.forms import EXAMPLES
from session.io.standard import OWN
from session.replay.convert import Converted, convert
from session.replay.raw import convert_raw, is_raw
from session.replay.sources import head_of


def import_log(
    paths: Sequence[Path],
    out: Path | None,
    answers: Answers,
    *,
    add: str | None = None,
    serial: str = "",
    columns: Sequence[str] = (),
    header: str | None = None,
    array_by: str | None = None,
    turns: Path | None = None,
) -> Converted:
    """Make a session folder of a log; out: None for one with the log's name, in the folder where one works.

    header: of a port's bytes as text; array_by: the column whose values tell the units of an array; turns: the known turns of a gyroscope
    alone.  Raises FormatError and DataError, QuestionsError for all that the log does not say, StorageError.
    """
    if add not in (None, "log", "closure"):
        raise FormatError(f"add is {add!r:.40}, expected log or closure")
    out = Path(_stem(paths[0])) if out is None else out
    if len(paths) == 1 and is_raw(paths[0]) and not _is_known(paths[0]):
        return convert_raw(paths[0], out, answers.odr_hz, answers.gyro_fs_dps, answers.accel_fs_g, answers.sensor, header)
    if array_by is not None:
        return need("arrays out of one log", "--array-by").import_array(paths, out, answers, array_by, columns)
    if turns is not None:
        return need("turns of known angle", "--turns").import_turns(paths, out, answers, turns, columns)
    return convert(paths, out, answers, add, serial, columns)


def _stem(path: Path) -> str:
    """``flight_3.bin`` becomes ``flight_3``.  FormatError where a name says nothing."""
    stem = path.resolve().name.split(".")[0]
    if not stem or str(path) == "-":
        raise FormatError(f"{path}: says no name for the session; give --out DIR")
    return stem


def _is_known(path: Path) -> bool:
    """Whether a file with the name of a port's bytes is a binary log after all."""
    registry = find("binary logs")
    return registry is not None and path.is_file() and registry.reader_of(path, head_of(path)) is not None


def known_logs() -> Iterator[tuple[str, str, str]]:
    """Of each kind of log that is read: its name, an example line, and the package that it needs."""
    yield OWN, "t_us,gx,gy,gz,ax,ay,az,temp", ""
    for dialect in DIALECTS:
        yield dialect.name, dialect.example, ""
    for name, (_, example) in EXAMPLES.items():
        yield name, example, ""
    yield "columns by their names", "time_ms,accX,accY,accZ,gyroX,gyroY,gyroZ", ""
    registry = find("binary logs")
    for reader in map(import_module, registry.READERS.values()) if registry is not None else ():
        needs = f"{reader.PACKAGE}: pip install 'tinygc[{reader.EXTRA}]'" if reader.PACKAGE else ""
        yield reader.NAME, reader.EXAMPLE, needs
