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


SUNDEVIL = """schema = "tinygc-session/1"

[sensor]
model = "unknown"
odr_hz = 20.0
gyro_fs_dps = {full_scale_dps:g}
accel_fs_g = 16
"""


def write_sundevil(source: Path, folder: Path, factor: float = 1.0) -> Path:
    """A session folder of a file of a rocket's 9-axis board at 20 Hz: t, specific force in m/s², rates in dps, then what is not read.

    As its authors read it, ±250 dps; or with rates and full scale times a factor."""
    folder.mkdir(parents=True)
    lines = ["t_s,ax_mps2,ay_mps2,az_mps2,gx_dps,gy_dps,gz_dps"]
    for line in source.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.split("\t")[:7]]
        lines.append(",".join([*cells[:4], *(repr(factor * float(cell)) for cell in cells[4:])]))
    (folder / "log0001.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "session.toml").write_text(SUNDEVIL.format(full_scale_dps=250 * factor), encoding="utf-8")
    return folder
