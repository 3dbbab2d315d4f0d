"""One simulated session as the logs of many programs: what is typed and asked, the fit against the truth, and what damage does.

``python benchmarks/any_log.py`` writes each log by the writers of ``tests/``, imports it by the command line, fits it, and compares the
twelve numbers with the truth.  Then each log is damaged in five ways, and every sample that is still read is held against the sound log's.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from common import markdown, progress

import calibrate
import tinygc
from session.base.errors import CalibrationError
from session.base.units import DEG, G
from session.log.samples import Samples

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
import written_logs as binary
from written_texts import TEXTS, Files

#: the session: turns, Hz
TURNS, RATE_HZ, SEED = 30, 104.0, 11
#: rows of the logs that are damaged
SHORT = 2000
#: bytes that a binary log's header has at least
MOST_HEADER = 200
#: what a person fills in: the accelerometer's calibration, and where the table stands
GIVEN = """[accelerometer]
matrix = {matrix}
bias_mps2 = {bias}
[site]
latitude_deg = 52.0
gravity_mps2 = 9.8127
"""


@dataclass(frozen=True)
class Kind:
    """A kind of log: files of a recording's samples in a folder, and the options that answer what it does not say; whole: its numbers are
    integers, which are always finite; accel_within: how near a force read between others is, m/s2."""

    name: str
    write: Callable[[Samples, Path], list[Path]]
    options: tuple[str, ...] = ()
    whole: bool = False
    accel_within: float = 1e-6


def _text(name: str) -> Kind:
    def write(samples: Samples, folder: Path) -> list[Path]:
        files: Files = TEXTS[name].write(samples)
        for called, data in files:
            (folder / called).write_bytes(data)
        return [folder / called for called, _ in files]

    return Kind(name, write, TEXTS[name].options, TEXTS[name].gyro_lsb > 1e-7, max(1e-6, TEXTS[name].accel_lsb))


def _binary(name: str, writer: Callable, file: str, options: tuple[str, ...] = ()) -> Kind:
    def write(samples: Samples, folder: Path) -> list[Path]:
        temp = np.full(len(samples), 25.0) if samples.temp_c is None else np.asarray(samples.temp_c)
        made = writer(folder / file, samples.t_ns, np.asarray(samples.gyro), np.asarray(samples.accel), temp)
        return [made if isinstance(made, Path) else folder / file]

    return Kind(name, write, options)


KINDS = [
    *map(_text, TEXTS),
    _binary("PX4 ULog", binary.write_ulog, "log.ulg", ("--topic", "sensor_combined[0]")),
    _binary("ROS 1 bag", binary.write_ros1, "imu.bag"),
    _binary("ROS 2 bag (sqlite)", binary.write_ros2, "imu_bag"),
    _binary("MCAP", binary.write_mcap, "imu.mcap"),
    _binary("ArduPilot .BIN", binary.write_ardupilot, "00000042.BIN", ("--topic", "IMU[0]")),
    _binary("HDF5", binary.write_hdf5, "imu.h5"),
    _binary("MATLAB 5", binary.write_mat, "imu.mat"),
    _binary("MATLAB 7.3", binary.write_mat73, "imu73.mat"),
    _binary("npz", binary.write_npz, "imu.npz"),
    _binary("parquet", binary.write_parquet, "imu.parquet"),
]


# Damage: one function each, to the bytes of a log's first file, or to the samples before they are written.


def cut(data: bytes) -> bytes:
    """In the middle of the last line, or as near the end."""
    return data[: (data.rstrip().rfind(b"\n") + len(data)) // 2]


def garbage(data: bytes) -> bytes:
    middle = data.find(b"\n", len(data) // 2) + 1
    return data[:middle] + b"\xff@garbage; 7\n" + data[middle:]


def half_header(data: bytes) -> bytes:
    return data[: max(min(data.find(b"\n"), MOST_HEADER), 2) // 2]


def not_finite(samples: Samples) -> Samples:
    gyro = np.array(samples.gyro)
    gyro[len(gyro) // 2, 1] = np.nan
    return replace(samples, gyro=gyro)


def rows_lost(samples: Samples) -> Samples:
    middle = len(samples) // 2
    return samples.pick(np.r_[0 : middle - 20, middle + 20 : len(samples)])


OF_BYTES = {"last line cut": cut, "garbage in the middle": garbage, "half a header": half_header}
OF_SAMPLES = {"a value not finite": not_finite, "40 rows lost": rows_lost}
DAMAGES = ("last line cut", "garbage in the middle", "a value not finite", "half a header", "40 rows lost")


def outcome(kind: Kind, damage: str, samples: Samples, sound: Samples, folder: Path) -> str:
    """What ``import`` makes of a damaged log; sound: what it reads of the whole one."""
    if kind.whole and damage == "a value not finite":
        return "–"
    folder.mkdir()
    paths = kind.write(OF_SAMPLES.get(damage, lambda same: same)(samples), folder)
    if damage in OF_BYTES:
        file = paths[0] if paths[0].is_file() else max(paths[0].iterdir(), key=lambda path: path.stat().st_size)
        file.write_bytes(OF_BYTES[damage](file.read_bytes()))
    code, said, _ = called("import", *paths, "--out", folder / "made", *kind.options)
    if code:
        fault = code != 2 or len(said.strip().splitlines()) > 1
        return "FAULT" if fault else "its line" if re.search(r"line \d", said) else "refused"
    read = tinygc.read_session(folder / "made").logs[0].samples
    # In their order: what is lost is lost at the end, or about the middle.
    count, lost = np.arange(len(read)), len(sound) - len(read)
    orders = (count, count + lost * (count >= len(sound) // 2 - lost // 2), np.searchsorted(sound.t_ns, read.t_ns - 1_000_000))
    off_ns, wrong = min(
        (_differ(sound, read, np.clip(at, 0, len(sound) - 1), kind.accel_within) for at in orders), key=lambda each: each[::-1]
    )
    unseen = ", unseen" if "--odr" in kind.options and damage == "40 rows lost" else ""  # without stamps they are counted
    stamps = f", stamps {off_ns * 1e-6:.0f} ms off" if off_ns > 1_000_000 and not unseen else ""
    return f"WRONG: {wrong}" if wrong else f"−{lost}{unseen}{stamps}"


def _differ(sound: Samples, read: Samples, at: np.ndarray, within: float) -> tuple[int, int]:
    """By how much stamps differ, ns, and how many readings do, of those that are held against the rows ``at``."""
    same = np.ones(len(read), dtype=bool)
    for a, b, most in ((sound.gyro, read.gyro, 1e-9), (sound.accel, read.accel, within)):
        same &= (np.abs(np.asarray(a)[at] - np.asarray(b)) < most).all(axis=1)
    return int(np.abs(sound.t_ns[at] - read.t_ns).max(initial=0)), int(np.count_nonzero(~same))


def called(*words: object) -> tuple[int, str, str]:
    """The exit code of a command, and what it says on standard error and on standard output."""
    said, out = io.StringIO(), io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
        try:
            code = calibrate.main([str(word) for word in words])
        except SystemExit as left:
            code = int(left.code or 0)
    return code, said.getvalue(), out.getvalue()


def asked(message: str) -> int:
    """How many options a refusal names."""
    given = message.partition("; give ")[2]
    return given.count("--") if given else int("--" in message)


def row_of(
    kind: Kind, samples: Samples, truth: np.ndarray, native: tinygc.Fit | None, given: str, work: Path
) -> tuple[dict, tinygc.Fit | None]:
    folder = work / "".join(letter for letter in kind.name if letter.isalnum())
    folder.mkdir()
    paths, out = kind.write(samples, folder), folder / "made"
    start = time.process_time()
    code, said, took = called("import", *paths, "--out", out)
    questions = 0 if code == 0 else asked(said)
    if code != 0:
        code, said, took = called("import", *paths, "--out", out, *kind.options)
    imported_s = time.process_time() - start
    row: dict = {"log": kind.name, "typed": " ".join(kind.options), "questions": questions, "read": code == 0, "import_s": imported_s}
    if code != 0:
        return row | {"said": said.strip()}, None
    row["clock"] = next((line.split("clock: ")[1].split(";")[0] for line in took.splitlines() if line.startswith("  clock: ")), "")
    (short_folder := folder / "short").mkdir()
    short = samples.between(0, SHORT)
    called("import", *kind.write(short, short_folder), "--out", short_folder / "made", *kind.options)
    sound = tinygc.read_session(short_folder / "made").logs[0].samples
    row["damage"] = [outcome(kind, damage, short, sound, folder / f"damage{place}") for place, damage in enumerate(DAMAGES)]
    with (out / "session.toml").open("a") as toml:
        toml.write(given)
    try:
        fit = tinygc.fit(out, methods=("raw", "least_squares"))
    except CalibrationError as error:
        return row | {"said": str(error)}, None
    values = np.array([each.value for each in fit.parameters.values()])
    sigmas = np.array([each.sigma for each in fit.parameters.values()])
    z = (values - truth) / sigmas
    other = z if native is None else (values - np.array([each.value for each in native.parameters.values()])) / sigmas
    return row | {
        "rms_sigmas": float(np.sqrt(np.mean(z**2))),
        "most_sigmas": float(np.abs(z).max()),
        "from_native": float(np.abs(other).max()) if native is not None else 0.0,
    }, fit


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="kinds whose name holds this")
    parser.add_argument("--seed", type=int, default=SEED)
    args = parser.parse_args()
    simulated = tinygc.simulate(segments=TURNS, odr_hz=RATE_HZ, closure_s=0.0, seed=args.seed, latitude_deg=52.0, gravity_mps2=9.8127)
    (log,) = simulated.session.logs
    # Registers that are rounded again, to other steps, would be rounded twice; spread over their own step, they are what was measured.
    rng, steps = np.random.default_rng(args.seed), (17.5e-3 * DEG, 0.122e-3 * G)
    gyro, accel = (
        np.asarray(values) + step * rng.uniform(-0.5, 0.5, values.shape)
        for values, step in zip((log.samples.gyro, log.samples.accel), steps, strict=True)
    )
    samples = Samples(log.samples.t_ns, gyro, accel)
    truth = np.array([*np.ravel(simulated.truth["E"]), *np.multiply(simulated.truth["B_dps"], DEG)])
    accelerometer = simulated.session.config.accelerometer
    given = GIVEN.format(matrix=accelerometer.matrix.tolist(), bias=accelerometer.bias_mps2.tolist())
    rows, native = [], None
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        for kind in KINDS:
            if args.only.lower() not in kind.name.lower() and native is not None:
                continue
            row, fit = row_of(kind, samples, truth, native, given, work)
            native = native or fit
            rows.append(row)
            progress(f"{len(rows)} of {len(KINDS)}: {kind.name}")
    progress("")
    print(markdown(["log", "typed", "asked", "import, s", "rms, σ", "most, σ", "from its own, σ"], map(_cells, rows)))
    print(markdown(["log", "clock, and how its unit is known", *DAMAGES], ([row["log"], row["clock"], *row["damage"]] for row in rows)))
    print("\n".join(summary(rows)))


def summary(rows: list[dict]) -> list[str]:
    """What can be counted of all logs: options asked for, errors, and outcomes of each damage."""
    fitted, asked_for = [row for row in rows if "rms_sigmas" in row], Counter(row["questions"] for row in rows)
    beyond = [row["log"] for row in fitted if row["most_sigmas"] > 2]
    lines = [
        f"- {len(rows)} kinds; options that `import` asks for: {', '.join(f'{k} in {asked_for[k]}' for k in sorted(asked_for))}.",
        f"- Errors, rms: {min(row['rms_sigmas'] for row in fitted):.2f} to {max(row['rms_sigmas'] for row in fitted):.2f} sigmas; "
        f"a number beyond two sigmas: {', '.join(beyond) or 'none'}.",
    ]
    for place, damage in enumerate(DAMAGES):
        found = Counter(row["damage"][place] for row in rows if "damage" in row)
        lines.append(f"- {damage}: {', '.join(f'{what} ({count})' for what, count in found.most_common())}.")
    return lines


def _cells(row: dict) -> list[str]:
    keys = ("rms_sigmas", "most_sigmas", "from_native")
    fitted = [f"{row[key]:.2f}" for key in keys] if "rms_sigmas" in row else [row["said"], "", ""]
    typed = f"`{row['typed']}`" if row["typed"] else ""
    return [row["log"], typed, str(row["questions"]), f"{row['import_s']:.2f}", *fitted]


if __name__ == "__main__":
    main()
