"""Find the authors' files of a public set, read their numbers, and write a session folder of a recording."""

from __future__ import annotations

import gzip
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from session.base.errors import FormatError, SegmentError
from session.base.units import STANDARD_GRAVITY_MPS2
from session.detect.accelerometer import fit_lengths, force_of, times_of, why_not, with_section
from session.detect.stills import find_stills, references
from session.log.config import Accelerometer
from session.log.folder import read_session
from session.log.samples import Samples

LOG, TRUTH, REST = "log0001.csv.gz", "truth0001.csv.gz", "rest0001.csv.gz"
AGAIN = "download it again"
#: header and lines of a file beside ``session.toml``
Table = tuple[str, Iterable[str]]


def found(folder: Path, pattern: str, below: str = "") -> list[Path]:
    """Files of a pattern in the folder, else in ``folder/below``, where a clone has them, in name order.  FormatError where none is."""
    if paths := sorted(folder.glob(pattern)) or sorted((folder / below).glob(pattern)):
        return paths
    raise FormatError(f"{folder}: holds no {pattern}; download the authors' files first (docs/real-recordings.md)")


def text_of(path: Path) -> str:
    """A text file.  FormatError where it is none."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise FormatError(f"{path}: not UTF-8 text; {AGAIN}") from None


def rows_of_numbers(path: Path, columns: tuple[str, ...], separator: str | None = None, skip: int = 0) -> list[list[str]]:
    """The cells of each line as they are written, all finite numbers; separator: None for white space.  Lines with # are left out, and
    the first ``skip``.  FormatError with the number of the line."""
    rows = []
    for number, line in enumerate(text_of(path).splitlines(), start=1):
        if number <= skip or not line.strip() or line.startswith("#"):
            continue
        cells = [cell.strip() for cell in line.split(separator)]
        if len(cells) != len(columns) or not all(map(_finite, cells)):
            raise FormatError(f"{path} line {number}: {line[:60]!r}, expected {len(columns)} numbers: {' '.join(columns)}; {AGAIN}")
        rows.append(cells)
    return rows


def _finite(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False


def rows(times: np.ndarray, *values: np.ndarray) -> Iterator[str]:
    """Lines of times (N,) and values (N, C), every digit of them."""
    for t, row in zip(times.tolist(), np.column_stack(values).tolist(), strict=True):
        yield f"{t},{','.join(map(repr, row))}"


def write_folder(folder: Path, toml: str, files: Mapping[str, Table], given: bool = True) -> Path:
    """``session.toml`` and files of lines by their names, those of ``.gz`` packed, whole or not at all; not given: with an accelerometer
    from its own stills.  FormatError where the folder is there, SegmentError where its stills do not suffice."""
    if folder.exists():
        raise FormatError(f"{folder}: exists; choose another folder with --out, or remove that one")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".part-") as part:
        made = Path(part) / folder.name
        made.mkdir()
        (made / "session.toml").write_text(toml, encoding="utf-8")
        for name, (header, lines) in files.items():
            data = "\n".join(chain([header], lines, [""])).encode()
            (made / name).write_bytes(gzip.compress(data, compresslevel=6, mtime=0) if name.endswith(".gz") else data)
        if not given:
            _calibrate_from_stills(made, folder)
        made.replace(folder)
    return folder


def from_stills(samples: Sequence[Samples], gravity_mps2: float = STANDARD_GRAVITY_MPS2, still_s: float = 1.0) -> Accelerometer:
    """The pre-calibration that brings every still's mean specific force to ``gravity_mps2``, upper triangular, with its bias.

    samples: the logs, accelerometer as measured in m/s^2.  A few stills that are none hardly count.  Raises SegmentError where the
    stills are too few or their attitudes too alike for all nine numbers.
    """
    logs = [references(find_stills(log, still_s)[0]) for log in samples]
    middle_s, duration_s = times_of(logs, samples)
    found = fit_lengths(force_of([still for log in logs for still in log]), gravity_mps2, middle_s=middle_s, duration_s=duration_s)
    if not found.fixes_all:
        raise SegmentError(f"{why_not(found)}: rest it on all six sides and some edges, or leave its calibration out")
    return found.accelerometer


def _calibrate_from_stills(made: Path, folder: Path) -> None:
    session, path = read_session(made), made / "session.toml"
    config = session.config
    try:
        accelerometer = from_stills([log.samples for log in session.logs], config.site.expected_gravity_mps2, config.protocol.still_s)
    except SegmentError as error:
        raise SegmentError(f"{folder}: {error}") from None
    path.write_text(with_section(path.read_text(encoding="utf-8"), accelerometer), encoding="utf-8")
