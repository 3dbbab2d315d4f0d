"""What holds a log: text files, streams of binary logs, and folders and zip archives of either, all read in the same way."""

from __future__ import annotations

import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Protocol

import numpy as np

from session.io.annexes import find
from session.io.dialects import Answers, Layout, Triad, three
from session.io.errors import FormatError
from session.io.files import MOST_ARCHIVE, open_file, unreadable
from session.io.lines import STANDARD
from session.io.questions import Question, QuestionsError, all_of
from session.io.reader import Piece, Reader
from session.io.recognise import CHOICES, NO_TIME, parse_axes
from session.io.streams import Stream, Topic
from session.io.units import Unit, beyond_any_sensor, known, parse_unit


class Source(Protocol):
    """path; layout: what is what; notes and comments as they are met."""

    path: Path
    layout: Layout
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


class Sources:
    """The sources of some files, in a ``with``, since what is unpacked for it is removed behind it."""

    def __init__(self, paths: Sequence[Path], answers: Answers, columns: Sequence[str] = ()):
        """columns: a list of columns for each file, in their order; one is for all of them.  Raises FormatError."""
        if len(columns) not in (0, 1, len(paths)):
            raise FormatError(f"--columns is given {len(columns)} times for {len(paths)} files; give it once, or once for each file")
        self._paths, self._answers = paths, answers
        self._columns = [columns[0] if len(columns) == 1 else columns[place] if columns else None for place in range(len(paths))]
        self._stack = ExitStack()

    def __enter__(self) -> list[Source]:
        """Raises FormatError, and QuestionsError of all that the files do not say."""
        with ExitStack() as stack:
            found: list[Source] = []
            asked: list[QuestionsError] = []
            for path, columns in zip(self._paths, self._columns, strict=True):
                answers = self._answers if columns is None else replace(self._answers, columns=columns)
                try:
                    found += _sources_of(path, answers, stack)
                except QuestionsError as error:
                    asked.append(error)
            if asked:
                raise all_of(asked) if len(asked) > 1 else asked[0]
            self._stack = stack.pop_all()
            return found

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def _sources_of(path: Path, answers: Answers, stack: ExitStack) -> list[Source]:
    if str(path) == STANDARD or not path.exists():
        return [Reader(path, answers)]
    if not path.is_file() and not path.is_dir():
        return [Reader(path, answers)]  # a pipe
    head = b"" if path.is_dir() else head_of(path)
    registry = find("binary logs")
    reader = None if registry is None else registry.reader_of(path, head)
    if reader is not None:
        return list(_streams(path, reader, answers))
    if path.is_dir():
        return _of_folder(path, answers)
    if head.startswith(b"PK\x03\x04"):
        return _of_folder(_unpacked(path, stack), answers, path.name)
    return [Reader(path, answers)]


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

SUFFIXES = (".csv", ".txt", ".tsv")
#: files of such an export
MOST_FILES = 200


def _of_folder(folder: Path, answers: Answers, called: str = "") -> list[Source]:
    """The sources among the files of a folder; what holds neither sensor is left out."""
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())[:MOST_FILES]
    found: list[Source] = []
    asked: list[QuestionsError] = []
    for path in paths:
        try:
            found.append(Reader(path, answers))
        except QuestionsError as error:
            asked.append(error)
        except FormatError:
            continue
    if asked and not found:
        raise all_of(asked)
    name = called or str(folder)
    if not paths:
        raise FormatError(f"{name}: cannot be read (it holds no {', '.join(SUFFIXES)}); give the log's file")
    if not found:
        raise FormatError(f"{name}: none of its {len(paths)} text files holds a gyroscope or an accelerometer; give the files themselves")
    return found


def _unpacked(path: Path, stack: ExitStack) -> Path:
    """A folder with the archive's text files.  FormatError for what is damaged or beyond any log."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="import-")))
    try:
        with zipfile.ZipFile(path) as archive:
            members = [each for each in archive.infolist() if Path(each.filename).suffix.lower() in SUFFIXES][:MOST_FILES]
            if sum(each.file_size for each in members) > MOST_ARCHIVE:
                raise FormatError(f"{path.name}: its text files are larger than {MOST_ARCHIVE} bytes; unpack it, and give the files")
            for each in members:
                (folder / Path(each.filename).name).write_bytes(archive.read(each))  # no name of the archive's is a path here
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError, OSError) as error:
        raise FormatError(f"{path.name}: a damaged zip archive ({error}); unpack it as far as it goes, and give the files") from None
    return folder


# Streams of binary logs.


@dataclass(eq=False)
class StreamSource:
    """One stream of a binary log as a source."""

    path: Path
    layout: Layout
    stream: Stream
    notes: list[str]
    comments: dict[str, str] = field(default_factory=dict)
    wraps: int = 0

    def unrolled(self, stamps: np.ndarray) -> np.ndarray:
        """They do: ``pieces`` puts rows in the order of their stamps."""
        return stamps

    def pieces(self, *, as_written: bool = True) -> Iterator[Piece]:
        """All rows at once.  FormatError for values that no sensor measures."""
        t_ns, gyro, accel, temp = self.stream.t_ns, self.stream.gyro, self.stream.accel, self.stream.temp
        arrays = [array for array in (gyro, accel, temp) if array is not None]
        sound = np.all([np.isfinite(array).reshape(len(array), -1).all(axis=1) for array in arrays], axis=0)
        if t_ns is not None:
            order = np.argsort(t_ns, kind="stable")
            if (np.diff(t_ns) < 0).any():
                self.notes.append(f"{np.count_nonzero(np.diff(t_ns) < 0)} times a stamp goes back: put in the order of their stamps")
            sound = order[sound[order]]
        elif not sound.all():
            raise FormatError(f"{self.path.name}: {np.count_nonzero(~sound)} rows are no finite numbers, and nothing stamps the others")
        if lost := len(arrays[0]) - (len(sound) if t_ns is not None else int(sound.sum())):
            self.notes.append(f"{lost} rows are no finite numbers: left out")
        gyro, accel, temp = (None if array is None else array[sound] for array in (gyro, accel, temp))
        gyro, accel = self._turned(gyro, self.layout.gyro, "gyro", 1), self._turned(accel, self.layout.accel, "accel", 4)
        if len(sound):
            yield Piece(None if t_ns is None else t_ns[sound], gyro, accel, temp)

    def _turned(self, values: np.ndarray | None, triad: Triad | None, kind: str, first: int) -> np.ndarray | None:
        if values is None or triad is None:
            return None
        if triad.unit.si is not None and beyond_any_sensor(values, triad.unit.si, kind).any():
            most = f"{float(np.abs(values).max()):g} {triad.unit.word}"
            raise FormatError(f"{self.path.name}: {self.stream.name} reaches {most}, beyond any sensor; is its unit right?")
        return values[:, [column - first for column in triad.columns]] * np.array(triad.signs, dtype=float)


def _streams(path: Path, reader: ModuleType, answers: Answers) -> Iterator[StreamSource]:
    topics: list[Topic] = reader.topics(path, answers.columns)
    for stream in reader.read(path, _chosen(path, reader.NAME, topics, answers.topic), answers.columns):
        yield _stream_source(path, reader.NAME, stream, answers)


def _chosen(path: Path, called: str, topics: Sequence[Topic], told: str | None) -> list[str]:
    """The names of the topics that are meant: the one that holds both sensors, or one for each.  QuestionsError where that is unclear."""
    names = {topic.name: topic for topic in topics}
    listed = "; ".join(f"{topic.name}: {topic.rows} rows of {' and '.join(topic.holds)}" for topic in topics[:12])
    if not topics:
        raise FormatError(f"{path.name} ({called}): no gyroscope and no accelerometer in it")
    if told is not None:
        wanted = [name.strip() for name in told.split(",")]
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

    def unit_of(kind: str, told: str | None, word: str) -> Unit:
        unit = parse_unit(kind, told or word)
        if unit is None:
            what = {"gyro": "gyroscope", "accel": "accelerometer", "temp": "temperature"}[kind]
            if told or word:
                raise FormatError(
                    f"{path.name}: {(told or word)[:30]!r} is no unit of the {what} that is known; give --{kind}-unit ({known(kind)})"
                )
            questions.append(Question(f"the unit of the {what}", f"--{kind}-unit", CHOICES[kind]))
        return unit or Unit(1, "")

    def triad(kind: str, told: str | None, word: str, axes: str, first: int) -> Triad:
        order, signs = parse_axes(axes, f"--{kind}-axes")
        return Triad(three(first + each for each in order), three(signs), unit_of(kind, told, word))

    gyro = None if stream.gyro is None else triad("gyro", answers.gyro_unit, stream.gyro_unit, answers.gyro_axes, 1)
    accel = None if stream.accel is None else triad("accel", answers.accel_unit, stream.accel_unit, answers.accel_axes, 4)
    temp_unit = None if stream.temp is None else unit_of("temp", None, stream.temp_unit or "c")
    if stream.t_ns is None and answers.odr_hz is None and stream.odr_hz is None:
        questions.append(Question(NO_TIME, "--odr HZ", "the true data rate"))
    if questions:
        raise QuestionsError(path.name, called, questions)
    counted = stream.t_ns is None or answers.time_unit == "none"
    layout = Layout(
        dialect=called,
        delimiter=None,
        first=0,
        time=None if counted else 0,
        time_ns=1,
        clock=False,
        gyro=gyro,
        accel=accel,
        temp=None if stream.temp is None else 7,
        temp_unit=temp_unit,
        names=(f"{stream.name} stamps", *(f"{stream.name} {what} {axis}" for what in ("gyro", "accel") for axis in "xyz"), "temperature"),
        frame=stream.frame,
        sources=_sources(stream, answers),
    )
    facts = {"gyro_fs_dps": stream.gyro_fs_dps, "accel_fs_g": stream.accel_fs_g, "odr_hz": stream.odr_hz, "sensor": stream.sensor}
    comments = {key: str(value) for key, value in facts.items() if value is not None}
    return StreamSource(path, layout, replace(stream, t_ns=None) if counted else stream, list(stream.notes), comments)


def _sources(stream: Stream, answers: Answers) -> Mapping[str, str]:
    told = {"gyro": answers.gyro_unit, "accel": answers.accel_unit}
    return {"time": "the file"} | {kind: "as you say" if said else "the file" for kind, said in told.items()}
