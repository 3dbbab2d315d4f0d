"""One simulated session as the logs of many programs: what is typed, what is asked, and the fit against the truth.

``python benchmarks/any_log.py`` writes each log by the writers of ``tests/``, imports it by the command line, fits it, and compares the
twelve numbers with the truth.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from common import markdown, progress

import calibrate
import tinygc
from session.io.errors import CalibrationError
from session.io.samples import Samples
from session.io.units import DEG, G

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
import written_logs as binary
from written_texts import TEXTS, Files

#: the session: turns, Hz
TURNS, RATE_HZ, SEED = 30, 104.0, 11
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
    """A kind of log: files of a recording's samples in a folder, and the options that answer what it does not say."""

    name: str
    write: Callable[[Samples, Path], list[Path]]
    options: tuple[str, ...] = ()


def _text(name: str) -> Kind:
    def write(samples: Samples, folder: Path) -> list[Path]:
        files: Files = TEXTS[name].write(samples)
        for called, data in files:
            (folder / called).write_bytes(data)
        return [folder / called for called, _ in files]

    return Kind(name, write, TEXTS[name].options)


def _binary(name: str, writer: Callable, file: str, options: tuple[str, ...] = (), **more: object) -> Kind:
    def write(samples: Samples, folder: Path) -> list[Path]:
        temp = np.full(len(samples), 25.0) if samples.temp_c is None else np.asarray(samples.temp_c)
        made = writer(folder / file, samples.t_ns, np.asarray(samples.gyro), np.asarray(samples.accel), temp, **more)
        return [made if isinstance(made, Path) else folder / file]

    return Kind(name, write, options)


KINDS = [
    *map(_text, TEXTS),
    _binary("PX4 ULog", binary.write_ulog, "log.ulg", ("--topic", "sensor_combined[0]")),
    _binary("ROS 1 bag", binary.write_ros1, "imu.bag"),
    _binary("ROS 2 bag (sqlite)", binary.write_ros2, "imu_bag"),
    _binary("MCAP", binary.write_mcap, "imu.mcap"),
    _binary("ArduPilot .BIN", binary.write_ardupilot, "00000042.BIN", ("--topic", "IMU[0]")),
    _binary("Betaflight .bbl", binary.write_blackbox, "LOG00001.BBL"),
    _binary("HDF5", binary.write_hdf5, "imu.h5"),
    _binary("MATLAB 5", binary.write_mat, "imu.mat"),
    _binary("MATLAB 7.3", binary.write_mat73, "imu73.mat"),
    _binary("npz", binary.write_npz, "imu.npz"),
    _binary("parquet", binary.write_parquet, "imu.parquet"),
]


def called(*words: object) -> tuple[int, str]:
    """The exit code of a command, and what it says on standard error."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            code = calibrate.main([str(word) for word in words])
        except SystemExit as left:
            code = int(left.code or 0)
    return code, said.getvalue()


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
    start = time.perf_counter()
    code, said = called("import", *paths, "--out", out)
    questions = 0 if code == 0 else asked(said)
    if code != 0:
        code, said = called("import", *paths, "--out", out, *kind.options)
    imported_s = time.perf_counter() - start
    row: dict = {"log": kind.name, "typed": " ".join(kind.options), "questions": questions, "read": code == 0, "import_s": imported_s}
    if code != 0:
        return row | {"said": said.strip()}, None
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
    head = ["log", "options typed", "asked", "import, s", "rms σ", "most σ", "from own σ"]
    print(markdown(head, map(_cells, rows)))


def _cells(row: dict) -> list[str]:
    keys = ("rms_sigmas", "most_sigmas", "from_native")
    fitted = [f"{row[key]:.2f}" for key in keys] if "rms_sigmas" in row else [row["said"], "", ""]
    typed = f"`{row['typed']}`" if row["typed"] else ""
    return [row["log"], typed, str(row["questions"]), f"{row['import_s']:.2f}", *fitted]


if __name__ == "__main__":
    main()
