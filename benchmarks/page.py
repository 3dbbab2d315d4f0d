"""What the page beside a recording costs: processor time, lateness of the board's attitude, samples lost, by how many browsers look on.

A virtual board streams frames through a pseudo-terminal to ``record`` in a process of its own; the browsers are sockets here.  Late is
the time from the write that put a sample's bytes into the port to the arrival of the attitude that holds it; a page shows it until the
next comes.
"""

from __future__ import annotations

import argparse
import bisect
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from multiprocessing import Pipe, Process
from multiprocessing.connection import Connection
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from common import markdown, progress

from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.terminal import Terminal
from tinygc.simulation.virtual_board import VirtualBoard, simulated

ROOT = Path(__file__).resolve().parent.parent
SETTLED_S = 6.0  #: behind the first sample: modules are loaded by then
CASES = {"no page": None, "0 browsers": (0, 0), "1": (1, 0), "12": (12, 0), "12, and 1 that hangs": (12, 1)}


class MarkedBoard(VirtualBoard):
    """Remembers when which sample went into the port: device time, and the clock of all processes here."""

    def _samples(self, stop: int) -> None:
        super()._samples(stop)
        self.marks.append(((self._zero_us + (stop - 1 - self._zero) / self.source.info.odr_hz * 1e6) * 1e-6, time.monotonic()))


def stream(source, port: Path, asked: Connection) -> None:
    """The board, in a process of its own, until it is asked for what it remembers."""
    with Terminal(port) as terminal:
        board = MarkedBoard(source, terminal, frames=True, lead_s=SETTLED_S, tail_s=None)
        board.marks = []
        threading.Thread(target=board.run, daemon=True).start()
        asked.send("ready")
        while not board.marks:
            time.sleep(0.05)
        asked.send("streaming")
        asked.recv()
        asked.send(board.marks)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=int, default=1667, help="Hz")
    parser.add_argument("--seconds", type=float, default=20.0, help="measured, of each case")
    parser.add_argument("--repeats", type=int, default=1, help="of all cases; medians are told")
    args = parser.parse_args()
    source = simulated(SimulationOptions(segments=30, closure_s=0.0, odr_hz=args.rate))
    found = {name: [] for name in CASES}
    for _ in range(args.repeats):
        for name, looking in CASES.items():
            progress(name)
            found[name].append(measured(source, looking, args.seconds))
    progress("")
    without = np.median([each["core"] for each in found["no page"]])
    rows = []
    for name, all_ in found.items():
        core = float(np.median([each["core"] for each in all_]))
        late = np.concatenate([each["late_ms"] for each in all_])
        ages = np.concatenate([each["age_ms"] for each in all_])
        lateness = [f"{np.median(late):.0f}", f"{np.percentile(late, 99):.0f}", f"{late.max():.0f}"] if len(late) else ["–"] * 3
        shown = f"{np.percentile(ages, 99):.0f}" if len(ages) else "–"
        samples, lost = (sum(each[key] for each in all_) for key in ("samples", "lost"))
        rows.append([name, f"{core:.1f} %", f"{core - without:+.1f} %", *lateness, shown, str(samples), str(lost)])
    head = [
        "looking on",
        "of a core",
        "of it the page",
        "late, median ms",
        "99 %",
        "most",
        "old before the next, 99 %, ms",
        "samples",
        "lost",
    ]
    print(f"load of the machine: {os.getloadavg()[1]:.1f}, on {os.cpu_count()} cores\n")
    print(markdown(head, rows))


def measured(source, looking: tuple[int, int] | None, seconds: float) -> dict:
    """One recording."""
    with tempfile.TemporaryDirectory(prefix="tinygc-") as name:
        folder = Path(name)
        config, port = folder / "bench.toml", folder / "port"
        config.write_text(source.config)
        board, asked = Pipe()
        Process(target=stream, args=(source, port, asked), daemon=True).start()
        board.recv()
        words = ["record", "--port", port, "--out", folder / "s", "--like", config, "--no-coach", "--json", folder / "told"]
        command = [sys.executable, str(ROOT / "calibrate.py"), *map(str, words), *(["--view"] if looking is not None else [])]
        environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
        recording = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment)
        address = None
        while looking is not None and address is None:
            line = recording.stderr.readline()
            address = line.split()[-1] if "http://" in line else None
        threading.Thread(target=recording.stderr.read, daemon=True).start()
        board.recv()
        sockets = [connected(address) for _ in range(sum(looking or (0, 0)))]
        readers = sockets[: looking[0]] if looking else []
        read(readers, SETTLED_S)
        began_s, spent_s = time.monotonic(), cpu_s(recording.pid)
        poses = read(readers, seconds)
        core = 100 * (cpu_s(recording.pid) - spent_s) / (time.monotonic() - began_s)
        recording.send_signal(signal.SIGINT)
        recording.wait(30)
        told = json.loads((folder / "told").read_text())
        board.send("marks")
        marks = board.recv()
        stamps = [stamp for stamp, _ in marks]
        late = [1e3 * (at_s - marks[bisect.bisect_left(stamps, t_s - 2e-4)][1]) for t_s, at_s in poses]
        ages = [late[i] + 1e3 * (poses[i + 1][1] - poses[i][1]) for i in range(len(poses) - 1)]
        return {"core": core, "late_ms": late, "age_ms": ages, "samples": told["samples"], "lost": told["lost"]}


def connected(address: str) -> socket.socket:
    """A browser that has asked for the events."""
    parts = urlsplit(address)
    made = socket.create_connection((parts.hostname, parts.port))
    made.sendall(f"GET {parts.path}events HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode())
    made.setblocking(False)
    return made


def read(readers: list[socket.socket], seconds: float) -> list[tuple[float, float]]:
    """All take what comes; of the first one the device time of each attitude and when it came."""
    until_s, poses, left = time.monotonic() + seconds, [], b""
    while (now_s := time.monotonic()) < until_s:
        for each in select.select(readers, [], [], until_s - now_s)[0]:
            data, at_s = each.recv(1 << 16), time.monotonic()
            if each is not readers[0]:
                continue
            *events, left = (left + data).split(b"\n\n")
            poses += [(json.loads(event.split(b"data: ", 1)[1])["t_s"], at_s) for event in events if event.startswith(b"event: pose")]
    return poses


def cpu_s(process: int) -> float:
    """Of all its threads so far (Linux)."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
