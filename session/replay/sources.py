"""What holds a log: text files, streams of binary logs, and folders and zip archives of either, all read in the same way."""

from __future__ import annotations

import json
import lzma
import re
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from session.base.budget import budget, current
from session.base.errors import FormatError
from session.base.files import MOST_ARCHIVE, open_file, read_bytes, unreadable, write_new
from session.base.questions import Question, QuestionsError, all_of
from session.base.units import beyond_any_sensor
from session.log.layout import Triad, three
from session.log.lines import STANDARD
from session.log.one_sensor import MOST_SENSORS, SENSORS
from session.log.reader import Piece
from session.replay.binary import registry
from session.replay.binary.arrays import Tables
from session.replay.binary.source import Messages, Stream, Topic
from session.replay.dialects import DIALECTS, OTHER, TableLayout
from session.replay.forms import EXAMPLES, Number, flattened
from session.replay.headings import plain
from session.replay.options import Answers
from session.replay.recognise import NO_TIME, parse_axes, unit_of
from session.replay.tables import TableReader


class Source(Protocol):
    """path; layout: what is what; notes and comments as they are met."""

    path: Path
    layout: TableLayout
    notes: list[str]
    comments: dict[str, str]

    @property
    def wraps(self) -> int:
        """How often the counter of the stamps has come round."""
        ...

    def pieces(self, *, as_written: bool) -> Iterator[Piece]:
        """All rows, stamps as the file has them.  Raises FormatError for what cannot be read."""
        ...

    def unrolled(self, stamps: np.ndarray) -> np.ndarray:
        """(N,) ns that go on, of all stamps (N,) ns as written.  FormatError where they go back."""
        ...


@contextmanager
def sources_of(paths: Sequence[Path], answers: Answers, columns: Sequence[str] = (), gyro_alone: bool = False) -> Iterator[list[Source]]:
    """The sources of some files; what is unpacked for them is removed behind the block.

    columns: a list of columns for each file, in their order; one is for all of them.  gyro_alone: whether no accelerometer is needed.
    Raises FormatError, and QuestionsError of all that the files do not state.
    """
    if len(columns) not in (0, 1, len(paths)):
        raise FormatError(f"--columns is given {len(columns)} times for {len(paths)} files; give it once, or once for each file")
    with ExitStack() as stack, budget(paths):
        found: list[Source] = []
        unanswered: list[QuestionsError] = []
        faults: list[FormatError] = []
        for place, path in enumerate(paths):
            own = replace(answers, columns=columns[place % len(columns)]) if columns else answers
            try:
                found += _of_path(path, own, stack, faults)
            except QuestionsError as error:
                unanswered.append(error)
        if unanswered:
            raise all_of(unanswered) if len(unanswered) > 1 else unanswered[0]
        for kind, called in ("gyro", "gyroscope"), ("accel", "accelerometer"):
            needed = kind == "gyro" or not gyro_alone
            if needed and faults and all(getattr(source.layout, kind) is None for source in found):
                raise _left_out(paths, kind, called, faults)
        yield found


def _of_path(path: Path, answers: Answers, stack: ExitStack, faults: list[FormatError]) -> list[Source]:
    """The sources of one path; faults: what is wrong with the files of a folder that are left out."""
    if str(path) == STANDARD or not path.exists():
        return [TableReader(path, answers)]
    if not path.is_file() and not path.is_dir():
        return [TableReader(path, answers)]  # a pipe
    head = b"" if path.is_dir() else head_of(path)
    reader = _binary(path, head, answers.like)
    if reader is not None:
        return list(_streams(path, reader, answers))
    if path.is_dir():
        return _of_folder(path, answers, faults)
    if head.startswith(b"PK\x03\x04"):
        return _of_folder(_unpacked(path, stack), answers, faults, path.name)
    if _is_document(head):
        tables = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="import-")))
        _unpack_document(path, tables)
        return _of_folder(tables, answers, faults, path.name)
    return _texts(path, answers)


def _binary(path: Path, head: bytes, like: str | None) -> Messages | Tables | None:
    """The reader of a binary log: the one that knows its bytes, or that ``--like`` names; None for text.

    FormatError where ``--like`` names a program whose log is text, and the file is none.
    """
    reader = registry.reader_of(path, head)
    if like in registry.READERS and (reader is not None or like not in {dialect.name for dialect in DIALECTS}):
        return registry.format_of(like)
    if reader is not None and like is not None:
        raise FormatError(f"{path.name}: by its bytes a log of {reader.name}, and --like is {like[:40]!r}; leave --like out")
    return reader


#: as ``import --list`` calls a table of no program, whose header states what its columns are
BY_NAMES = "columns by their names"


def _texts(path: Path, answers: Answers) -> list[Source]:
    """The reader of a text log, or one for each quantity of a table with empty cells, as of two files."""
    reader = _text(path, answers)
    return [TableReader(path, answers, only=kind) for kind in reader.parts] or [reader]


def _text(path: Path, answers: Answers) -> TableReader:
    """The reader of a text log.  FormatError for ``--topic``, and for ``--like`` with a form of text that it does not have."""
    if answers.topic is not None:
        raise FormatError(f"{path.name}: a text log has no topics; leave --topic out")
    like = answers.like
    if like not in (BY_NAMES, *EXAMPLES):
        return TableReader(path, answers)
    reader = TableReader(path, replace(answers, like=None))
    forms = [note.removesuffix(": read as a table") for note in reader.notes if note.endswith(": read as a table")]
    if not (reader.layout.dialect == OTHER and not forms if like == BY_NAMES else any(form.startswith(like) for form in forms)):
        raise FormatError(f"{path.name}: read as {', '.join((*forms, reader.layout.dialect))}, and --like is {like!r}; leave --like out")
    return reader


#: bytes of a file by which it is known
HEAD_BYTES = 1 << 16


def head_of(path: Path) -> bytes:
    """The first bytes of a file.  FormatError where it cannot be read."""
    try:
        with open_file(path) as file:
            return file.read(HEAD_BYTES)
    except OSError as error:
        raise unreadable(path, error) from None


# Folders and archives, as a telephone's program exports them: a file for each sensor, and others that are not meant.

SUFFIXES = (".csv", ".txt", ".tsv", ".log", ".jsonl", ".ndjson")
#: files of such an export
MOST_FILES = 200
#: of what is wrong with files that are left out: how many are listed, and how much of each
MOST_FAULTS, FAULT_LENGTH = 3, 140
#: of a file's name: whose log it may be
NAMED = {"gyro": "gyr", "accel": "acc"}


def _of_folder(folder: Path, answers: Answers, faults: list[FormatError], called: str = "") -> list[Source]:
    """The sources among the files of a folder; what holds neither sensor is left out.  QuestionsError for what any of the others does not
    state; what is wrong with those that are left out is added to ``faults``."""
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())[:MOST_FILES]
    found: list[Source] = []
    unanswered: list[QuestionsError] = []
    wrong: list[FormatError] = []
    for path in paths:
        try:
            found += _texts(path, answers)
        except QuestionsError as error:
            unanswered.append(error)
        except FormatError as error:
            wrong.append(error)
    if unanswered:
        raise all_of(unanswered)
    name = called or str(folder)
    if not paths:
        raise FormatError(f"{name}: cannot be read (it holds no {', '.join(SUFFIXES)}); give the log's file")
    if not found:
        what = f"none of its {len(paths)} text files holds a gyroscope or an accelerometer"
        raise FormatError(f"{name}: {what} ({_listed(wrong, '')}); give the files themselves")
    faults += wrong
    return found


def _left_out(paths: Sequence[Path], kind: str, called: str, faults: Sequence[FormatError]) -> FormatError:
    """The complaint about a sensor that is missing where files were left out, perhaps its own."""
    return FormatError(f"{', '.join(path.name for path in paths)}: no {called} in it; files were left out: {_listed(faults, NAMED[kind])}")


def _listed(faults: Sequence[FormatError], first: str) -> str:
    """What is wrong with some of the files, those first whose name has this in it."""
    texts = sorted((str(fault) for fault in faults), key=lambda text: first not in text.split(" ")[0].lower())
    length = FAULT_LENGTH if len(texts) > 1 else MOST_FAULTS * FAULT_LENGTH
    some = [text if len(text) <= length else f"{text[:length]}…" for text in texts[:MOST_FAULTS]]
    return "; ".join((*some, *([f"and {len(texts) - MOST_FAULTS} more"] if len(texts) > MOST_FAULTS else [])))


def _unpacked(path: Path, stack: ExitStack) -> Path:
    """A folder with the archive's text files.  FormatError for what is damaged or beyond any log, and for two files of one name."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="import-")))
    there: dict[str, str] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            members = [each for each in archive.infolist() if Path(each.filename).suffix.lower() in SUFFIXES and not each.is_dir()]
            # What a system puts next to its files when it packs them.
            members = [each for each in members if not Path(each.filename).name.startswith("._")][:MOST_FILES]
            if sum(each.file_size for each in members) > MOST_ARCHIVE:
                raise FormatError(f"{path.name}: its text files are larger than {MOST_ARCHIVE} bytes; unpack it, and give the files")
            for each in members:
                name = Path(each.filename).name  # no name of the archive's is a path here
                if (other := there.setdefault(name.lower(), each.filename)) != each.filename:
                    raise FormatError(f"{path.name}: it holds {other} and {each.filename}; unpack it, and give the files of one run")
                write_new(folder / name, archive.read(each))
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, RuntimeError, ValueError, OSError) as error:
        raise FormatError(f"{path.name}: a damaged zip archive ({error}); unpack it as far as it goes, and give the files") from None
    return folder


# Streams of binary logs.

#: rows of a piece
AT_ONCE = 1 << 16


@dataclass(eq=False)
class StreamSource:
    """One stream of a binary log as a source."""

    path: Path
    layout: TableLayout
    stream: Stream
    notes: list[str]
    comments: dict[str, str] = field(default_factory=dict)
    wraps: int = 0

    def unrolled(self, stamps: np.ndarray) -> np.ndarray:
        """They do: ``pieces`` puts rows in the order of their stamps."""
        return stamps

    def pieces(self, *, as_written: bool = True) -> Iterator[Piece]:
        """All rows, some at a time; they are given up behind the last.  FormatError for values that no sensor measures."""
        t_ns, lost = self.stream.t_ns, 0
        order: np.ndarray | None = None
        if t_ns is not None and (back := np.count_nonzero(t_ns[1:] < t_ns[:-1])):
            self.notes.append(f"{back} times a stamp goes back: put in the order of their stamps")
            order = np.argsort(t_ns, kind="stable")
        for start in range(0, len(self.stream), AT_ONCE):
            which: slice | np.ndarray = slice(start, start + AT_ONCE) if order is None else order[start : start + AT_ONCE]
            parts = {kind: part.values[which] for kind, part in self.stream.parts.items()}
            sound = np.all([np.isfinite(part).reshape(len(part), -1).all(axis=1) for part in parts.values()], axis=0)
            lost += int(np.count_nonzero(~sound))
            if sound.any():
                gyro, accel, temp = (parts[kind][sound] if kind in parts else None for kind in ("gyro", "accel", "temp"))
                gyro, accel = self._turned(gyro, self.layout.gyro, "gyro", 1), self._turned(accel, self.layout.accel, "accel", 4)
                yield Piece(None if t_ns is None else t_ns[which][sound], gyro, accel, temp)
        if lost and t_ns is None:
            raise FormatError(f"{self.path.name}: {lost} rows are no finite numbers, and nothing stamps the others")
        if lost:
            self.notes.append(f"{lost} rows are no finite numbers: left out")
        self.stream = replace(self.stream, t_ns=None, parts={})

    def _turned(self, values: np.ndarray | None, triad: Triad | None, kind: str, first: int) -> np.ndarray | None:
        if values is None or triad is None:
            return None
        if triad.unit.si is not None and beyond_any_sensor(values, triad.unit.si, kind).any():
            most = f"{float(np.abs(values).max()):g} {triad.unit.word}"
            raise FormatError(f"{self.path.name}: {self.stream.name} reaches {most}, beyond any sensor; is its unit right?")
        return values[:, [column - first for column in triad.columns]] * np.array(triad.signs, dtype=float)


def _streams(path: Path, reader: Messages | Tables, answers: Answers) -> Iterator[StreamSource]:
    for option in ("rows", "where", "lines", "packed"):
        if getattr(answers, option) is not None:
            raise FormatError(f"{path.name} ({reader.name}): --{option} is of a text log; leave it out")
    with current().again():
        topics = reader.topics(path, answers.columns)
    for stream in reader.read(path, _chosen(path, reader.name, topics, answers.topic), answers.columns):
        yield _stream_source(path, reader.name, stream, answers)


#: of a column's name: of a message whose definition fixes its unit, sensor_msgs/Imu
BY_DEFINITION = ("angular_velocity", "linear_acceleration")
#: where the stamps of a stream are from: in ns here, whatever they are there
BY_FILE = "the file"


def _chosen(path: Path, called: str, topics: Sequence[Topic], stated: str | None) -> list[str]:
    """The names of the topics that are meant: the one that holds both sensors, or one for each.  QuestionsError where that is unclear."""
    names = {topic.name: topic for topic in topics}
    listed = "; ".join(f"{topic.name}: {topic.rows} rows of {' and '.join(topic.holds)}" for topic in topics[:12])
    if not topics:
        raise FormatError(f"{path.name} ({called}): no gyroscope and no accelerometer in it")
    if stated is not None:
        wanted = [name.strip() for name in stated.split(",")]
        if missing := [name for name in wanted if name not in names]:
            raise FormatError(f"{path.name} ({called}): no topic {missing[0]!r} (--topic); it holds {listed}")
        return wanted
    both = [topic.name for topic in topics if {"gyro", "accel"} <= set(topic.holds)]
    gyro = [topic.name for topic in topics if "gyro" in topic.holds and topic.name not in both]
    accel = [topic.name for topic in topics if "accel" in topic.holds and topic.name not in both]
    if len(both) == 1 and not (gyro and accel):
        return both
    if not both and len(gyro) <= 1 and len(accel) <= 1:
        return gyro + accel
    example = both[0] if both else ",".join((*gyro[:1], *accel[:1]))
    raise QuestionsError(path.name, called, [Question("which of its topics is meant", f"--topic {example}", listed)])


def _stream_source(path: Path, called: str, stream: Stream, answers: Answers) -> StreamSource:
    questions: list[Question] = []
    triads: dict[str, Triad | None] = {"gyro": None, "accel": None}
    names, sources = [stream.stamps or f"the stamps of {stream.name}"], {"time": BY_FILE}
    for kind, stated, axes in (("gyro", answers.gyro_unit, answers.gyro_axes), ("accel", answers.accel_unit, answers.accel_axes)):
        part, first = stream.parts.get(kind), len(names)
        names += part.names if part and part.names else [f"{stream.name} {kind} {axis}" for axis in "xyz"]
        defined = called == "ULog" or any(name.startswith(BY_DEFINITION) for name in stream.columns)
        sources[kind] = "as given" if stated else "as that message is defined" if defined else BY_FILE
        if part is not None:
            order, signs = parse_axes(axes, f"--{kind}-axes")
            unit = unit_of(kind, stated or part.unit, f"--{kind}-unit", path.name, questions)
            triads[kind] = Triad(three(first + each for each in order), three(signs), unit)
    temp = stream.parts.get("temp")
    temp_unit = None if temp is None else unit_of("temp", temp.unit or "c", "--columns temp_c=", path.name, questions)
    if stream.t_ns is None and answers.odr_hz is None and stream.odr_hz is None:
        questions.append(Question(NO_TIME, "--odr HZ"))
    if questions:
        raise QuestionsError(path.name, called, questions)
    counted = stream.t_ns is None or answers.time_unit == "none"
    layout = TableLayout(
        dialect=called,
        delimiter=None,
        first=0,
        time=None if counted else 0,
        time_ns=1,
        clock=False,
        gyro=triads["gyro"],
        accel=triads["accel"],
        temp=None if temp is None else len(names),
        temp_unit=temp_unit,
        names=(*names, "temperature"),
        frame=stream.frame,
        sources=sources,
    )
    scales = {
        key: stream.parts[kind].full_scale for key, kind in (("gyro_fs_dps", "gyro"), ("accel_fs_g", "accel")) if kind in stream.parts
    }
    comments = {key: str(value) for key, value in (scales | {"odr_hz": stream.odr_hz}).items() if value is not None}
    return StreamSource(path, layout, replace(stream, t_ns=None) if counted else stream, list(stream.notes), comments)


# JSON documents: each list of records in them, or set of lists of one length, as a table in a file of its own.

#: of the first bytes: how far from their end a document may seem broken, since they cut it
NEAR_END = 200
#: what a parsed document takes: bytes for each of the file, and for each record or list of it; measured
PARSED, RECORD = 10, 400
#: of a document: lists inside lists, and tables
DEPTH, MOST_TABLES = 6, 100


def _is_document(head: bytes) -> bool:
    """Whether a file that begins with these bytes, which may end anywhere, is one JSON document, and no object a line."""
    text = head.decode("utf-8-sig", "ignore").strip()
    if not text.startswith(("{", "[")):
        return False
    lines = text.splitlines()
    if len(lines) > 1 and any(flattened(line) for line in lines[:3]):
        return False
    try:
        return isinstance(json.loads(text), dict | list)
    except json.JSONDecodeError as error:
        return error.pos >= min(len(text) - 1, max(len(text) - NEAR_END, len(text) // 2))
    except RecursionError:
        return False


def _unpack_document(path: Path, folder: Path) -> None:
    """Write its tables into a folder, ``rotations.csv``.  FormatError for what is no JSON, and where it holds none."""
    data = read_bytes(path, current().most)
    current().take(path, PARSED * len(data) + RECORD * (data.count(b"{") + data.count(b"[")))
    try:
        document = json.loads(data.decode("utf-8-sig"), parse_float=Number, parse_int=Number)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path.name}: a damaged JSON document ({str(error)[:80]}); save it again, or as a table") from None
    names: dict[str, int] = {}
    for called, rows in _tables(document, path.name.split(".")[0], DEPTH):
        name = re.sub(r"[^\w.-]+", "_", called)[:60]
        names[name] = names.get(name, 0) + 1
        text = "\n".join(",".join(row) for row in rows)
        write_new(folder / f"{name}{names[name] if names[name] > 1 else ''}.csv", f"{text}\n".encode())
        if sum(names.values()) > MOST_TABLES:
            raise FormatError(f"{path.name}: a JSON document of more than {MOST_TABLES} lists; save the sensor's as a table")
    if not names:
        raise FormatError(f"{path.name}: a JSON document without a list of readings; expected such as {{'gyro': [{{'t': …, 'x': …}}, …]}}")


def _tables(node: object, called: str, depth: int) -> Iterator[tuple[str, Iterator[list[str]]]]:
    """The tables in a document, each with its name."""
    if isinstance(node, list) and len(node) > 1 and all(isinstance(each, dict | list) for each in node):
        sensors: dict[str, list[object]] = {}
        for record in node:
            sensors.setdefault(_sensor(record), []).append(record)
        for sensor, records in sensors.items() if len(sensors) <= MOST_SENSORS else [("", node)]:
            if names := [name for name, _, _ in flattened(records[0]) if plain(name) not in SENSORS]:
                yield sensor or called, _records(records, names)
                depth = 0
    if isinstance(node, dict):
        lists = {name: each for name, each in node.items() if isinstance(each, list) and len(each) > 1 and isinstance(each[0], Number)}
        if len(lists) > 1 and len({len(each) for each in lists.values()}) == 1:
            yield called, ([str(cell) for cell in row] for row in [list(lists), *zip(*lists.values(), strict=True)])
            return
    if isinstance(node, dict) and depth:
        for name, inner in node.items():
            yield from _tables(inner, name, depth - 1)


def _sensor(record: object) -> str:
    """Whose a record is, as it states."""
    items = record.items() if isinstance(record, dict) else ()
    return next((value for key, value in items if isinstance(value, str) and plain(key) in SENSORS), "")


def _records(records: list[object], names: list[str]) -> Iterator[list[str]]:
    yield names
    for record in records:
        cells = {name: value for name, value, _ in flattened(record)}
        yield [cells.get(name, "") for name in names]
