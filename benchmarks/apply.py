"""``calibrate.py apply`` on a long log: samples per second and peak memory; the models alone, reading alone, writing alone; and how long
NumPy and Python's csv module take to read and write the same rows, without a calibration between."""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import tinygc  # noqa: E402
from session.io.dialects import Answers  # noqa: E402
from session.io.numeric import decimal_rows  # noqa: E402
from session.io.reader import Reader  # noqa: E402
from tinygc import models  # noqa: E402
from tinygc.models.denoiser import DenoisedNet, Denoiser  # noqa: E402
from tinygc.models.linear import LinearModel  # noqa: E402
from tinygc.models.nets import CalibrationNet  # noqa: E402

RATE_HZ = 208.0
PIECE = 1 << 14
#: rows that the slow ways are timed on
FEWER = 300_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=3_000_000)
    parser.add_argument("--repeat", type=int, default=3, help="the best of so many")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        report(Path(folder), args.samples, args.repeat)


def report(folder: Path, samples: int, repeat: int) -> None:
    """Print the table."""
    rng = np.random.default_rng(0)
    linear = LinearModel(np.eye(3) + 0.01 * rng.normal(size=(3, 3)), 0.01 * rng.normal(size=3))
    net = CalibrationNet.from_vector(CalibrationNet.from_linear(linear).vector + 1e-3 * rng.normal(size=27))
    made = {"linear": linear, "TinyGC-Net": net, "TinyGC-Net, denoised": DenoisedNet(net, Denoiser.identity(), RATE_HZ)}
    for name, model in made.items():
        (folder / f"{name}.json").write_text(json.dumps(models.to_dict(model)))
    print("| step | samples/s | samples per CPU second | peak memory |\n| --- | ---: | ---: | ---: |")
    rate = rng.normal(size=(samples, 3))
    for name in made:
        stream = tinygc.load(folder / f"{name}.json").stream()
        pieces = [rate[i : i + PIECE] for i in range(0, samples, PIECE)]
        seconds = best(lambda stream=stream, pieces=pieces: [stream.push(piece) for piece in pieces], repeat)
        print(f"| {name}, arrays in pieces of {PIECE} | {in_millions(samples, *seconds)} | |")
    calibration, few = tinygc.load(folder / "linear.json"), rate[:20_000]
    seconds = best(lambda: list(map(calibration.live(), few)), repeat)
    print(f"| linear, one sample after another | {in_millions(len(few), *seconds)} | |")
    del rate, pieces
    log = folder / "log.csv"
    write_log(log, samples, rng)
    seconds = best(lambda: sum(len(piece.gyro) for piece in Reader(log, Answers()).pieces()), repeat)
    print(f"| reading {samples:,} rows of registers ({log.stat().st_size / 1e6:.0f} MB), alone | {in_millions(samples, *seconds)} | |")
    piece = next(Reader(log, Answers()).pieces())
    columns, decimals = [piece.t_ns, *piece.gyro.T, *piece.accel.T, piece.temp], [0, 9, 9, 9, 6, 6, 6, 4]
    seconds = best(lambda: decimal_rows(columns, decimals), repeat)
    print(f"| writing as many, alone | {in_millions(len(piece.gyro), *seconds)} | |")
    shorter = folder / "shorter.csv"
    write_log(shorter, min(FEWER, samples), np.random.default_rng(1))
    for name, copy in {"`numpy.loadtxt`, `numpy.savetxt`": by_numpy, "`csv.reader`, `float`, `csv.writer`": by_csv}.items():
        seconds = best(lambda copy=copy: copy(shorter, folder / "copy.csv"), repeat)
        print(f"| reading and writing by {name}, no calibration | {in_millions(min(FEWER, samples), *seconds)} | |")
    for name in made:
        runs = [run(folder / f"{name}.json", log, folder / "out.csv") for _ in range(repeat)]
        wall, cpu, memory = (choose(column) for choose, column in zip((min, min, max), zip(*runs, strict=True), strict=True))
        print(f"| `calibrate.py apply`, {name}, from start to end | {in_millions(samples, wall, cpu)} | {memory / 1e6:.0f} MB |")


def best(work, repeat: int) -> tuple[float, float]:
    """Seconds, and seconds of the processor, of the fastest of so many runs."""
    times = []
    for _ in range(repeat):
        began = time.perf_counter(), time.process_time()
        work()
        times.append((time.perf_counter() - began[0], time.process_time() - began[1]))
    return min(wall for wall, _ in times), min(cpu for _, cpu in times)


def by_numpy(log: Path, out: Path) -> None:
    """Read all rows as floats and write them with the decimals that ``apply`` writes."""
    table = np.loadtxt(log, delimiter=",", skiprows=1)
    np.savetxt(out, table, delimiter=",", fmt=["%d", *["%.9f"] * 3, *["%.6f"] * 3, "%.4f"])


def by_csv(log: Path, out: Path) -> None:
    """The same, line by line."""
    with log.open(newline="") as source, out.open("w", newline="") as target:
        lines, writer = csv.reader(source), csv.writer(target)
        writer.writerow(next(lines))
        for t, *rest in lines:
            gx, gy, gz, ax, ay, az, temp = map(float, rest)
            force = (f"{ax:.6f}", f"{ay:.6f}", f"{az:.6f}")
            writer.writerow((t, f"{gx:.9f}", f"{gy:.9f}", f"{gz:.9f}", *force, f"{temp:.4f}"))


def run(model: Path, log: Path, out: Path) -> tuple[float, float, float]:
    """Seconds, seconds of the processor and peak bytes of one command."""
    command = [sys.executable, str(ROOT / "calibrate.py"), "apply", str(model), str(log), "-o", str(out)]
    probe = "import resource as r, subprocess, sys; subprocess.run(sys.argv[1:], check=True); u = r.getrusage(r.RUSAGE_CHILDREN); "
    probe += "print(u.ru_utime + u.ru_stime, u.ru_maxrss)"
    options = ["--gyro-fs", "500", "--accel-fs", "4", "--force", "--quiet"]
    began = time.perf_counter()
    said = subprocess.run([sys.executable, "-c", probe, *command, *options], capture_output=True, text=True, check=True)
    cpu, memory = said.stdout.split()
    return time.perf_counter() - began, float(cpu), int(memory) * (1 if sys.platform == "darwin" else 1024)


def write_log(path: Path, samples: int, rng: np.random.Generator) -> None:
    """Registers at 208 Hz."""
    with path.open("wb") as file:
        file.write(b"t_us,gx,gy,gz,ax,ay,az,temp\n")
        for start in range(0, samples, PIECE):
            count = min(PIECE, samples - start)
            t_us = ((start + np.arange(count)) * 1e6 / RATE_HZ).astype(np.int64)
            registers = rng.integers(-20_000, 20_000, (7, count))
            file.write(decimal_rows([t_us, *registers], [0] * 8))


def in_millions(samples: int, wall: float, cpu: float) -> str:
    """Two cells."""
    return f"{samples / wall / 1e6:.2f} million | {samples / cpu / 1e6:.2f} million"


if __name__ == "__main__":
    main()
