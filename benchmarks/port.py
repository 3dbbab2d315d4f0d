"""From the virtual board through a pseudo-terminal to disk: what arrives, and what it costs."""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from common import markdown, progress

from session.bench.decoder import StreamDecoder
from session.bench.logwriter import LogWriter
from session.bench.recorder import Recorder, stream

ROOT = Path(__file__).resolve().parent.parent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rates", type=int, nargs="*", default=[416, 1667, 6667], help="Hz")
    parser.add_argument("--segments", type=int, default=2, help="turns, some 6 s each")
    args = parser.parse_args()
    header = ("stream", "seconds", "samples sent", "received", "lost", "dropped by the board", "replay", "CPU", "clock, host / device")
    rows = [measure(rate, frames, args.segments) for rate in args.rates for frames in (False, True)]
    progress("")
    print(markdown(header, rows))


def measure(rate_hz: int, frames: bool, segments: int) -> tuple:
    """One line of the table."""
    name = f"{rate_hz} Hz, {'frames' if frames else 'text'}"
    progress(name)
    with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
        out, link, result = Path(folder) / "session", Path(folder) / "port", Path(folder) / "board.json"
        command = [
            sys.executable,
            "calibrate.py",
            "board",
            "--rate",
            str(rate_hz),
            "--segments",
            str(segments),
            "--lead",
            "2",
            "--tail",
            "1",
        ]
        command += ["--link", str(link), "--json", str(result), "--quiet"] + ["--frames"] * frames
        board = subprocess.Popen(command, cwd=ROOT)
        while not link.exists():
            time.sleep(0.1)
            if board.poll() is not None:
                raise SystemExit("the board stopped")
        began, cpu = time.monotonic(), _cpu_s()
        recorder = Recorder(out, str(link))
        while not recorder.why:
            recorder.poll()
        seconds, cpu, ratio = time.monotonic() - began, _cpu_s() - cpu, recorder.clock.device_seconds_per_second
        recorder.close()
        board.wait()
        sent = json.loads(result.read_text())
        same = [path.read_bytes() for path in recorder.logs.paths] == replayed(out / "raw.bin", Path(folder))
        counts = recorder.decoder
        received = f"{counts.samples}"
        share = f"{100 * cpu / seconds:.0f} % of a core"
        return (
            name,
            f"{seconds:.0f}",
            sent["samples"],
            received,
            counts.lost,
            sent["dropped"],
            "same" if same else "DIFFERS",
            share,
            f"{ratio:.5f}",
        )


def replayed(raw_path: Path, folder: Path) -> list[bytes]:
    """The logs that the raw bytes make."""
    decoder, logs = StreamDecoder(), LogWriter(folder)
    for _ in stream(raw_path, decoder, logs):
        pass
    logs.write(decoder.finish())
    logs.close()
    return [path.read_bytes() for path in logs.paths]


def _cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
