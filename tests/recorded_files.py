"""A recording with one file of every name that a recording has, for tests that would spoil it; and one of a rocket's board."""

from pathlib import Path

#: a recording with one file of every name that docs/formats.md lists
RECORDED = (
    "session.toml",
    "log0001.csv",
    "log0002.csv.gz",
    "closure0001.csv",
    "rest0001.csv.gz",
    "attitudes.csv",
    "turns.csv",
    "truth0001.csv",
    "unclosed0001.csv",
    "foreign0001.csv",
    "raw.bin",
    "raw.times",
    "truth.json",
    "log0001.csv.changed1",
)


def make_recording(tmp_path) -> Path:
    folder = tmp_path / "D"
    folder.mkdir()
    for number, name in enumerate(RECORDED):
        (folder / name).write_bytes(b"recorded %d" % number)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def numbers(log: Path) -> list[list[float]]:
    """The rows below a header, read as a program reads a CSV that is told nothing: ValueError for what is no number, a comment among it."""
    header, *rows = [line.split(",") for line in log.read_text().splitlines()]
    assert all(len(row) == len(header) for row in rows)
    return [[float(cell) for cell in row] for row in rows]
