"""The whole chain in one command: a simulated session, felt by the register model of the ASM330LHH on an emulated STM32F405 that runs the
driver's own ELF file; a pseudo-terminal; ``record --view`` with somebody at its page; ``fit``, ``explain`` and ``report``.  Beside it the
same commands on a file of the session: the simulated registers at their true times, with the still lead and up to the sample at which the
recording ended.

Needs the tools of docs/firmware.md and Unicorn.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import markdown, progress
from emulated_driver import built

from tinygc.annexes.emulated.board import with_its_own_rate
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import RegisterLog, Simulation, simulate_session, unit_of
from tinygc.simulation.virtual_board import STILL_S
from tinygc.simulation.write import write_simulation

ROOT = Path(__file__).resolve().parent.parent
CALIBRATE = [sys.executable, str(ROOT / "calibrate.py")]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
METHODS = ("raw", "least_squares", "tinygc")
LEAD_S = 6


class Visitor(threading.Thread):
    """Somebody who looks at the page: counts its events."""

    def __init__(self, address: str):
        super().__init__(daemon=True)
        self.address, self.events = address, {}

    def run(self) -> None:
        """Until the recording ends: the page would stay as long as somebody looks at it."""
        with urllib.request.urlopen(self.address) as page:
            assert b"<html" in page.read().lower()
        with urllib.request.urlopen(self.address + "events") as stream:
            for line in stream:
                if line.startswith(b"event: "):
                    name = line[7:].strip().decode()
                    self.events[name] = self.events.get(name, 0) + 1
                    if name == "end":
                        return


def chain(folder: Path, elf: Path, rate: float, segments: int, speed: str, resets: str = "") -> dict[str, object]:
    """One session at one data rate: figures by name."""
    options = SimulationOptions(segments=segments, closure_s=0.0, odr_hz=rate, seed=7)
    file, recorded, port, config = folder / "file", folder / "recorded", folder / "port", folder / "bench.toml"
    words = ["--firmware", elf, "--rate", rate, "--segments", segments, "--seed", 7, "--take", 1, "--link", port, "--config", config]
    words += ["--lead", LEAD_S, "--speed", speed, "--faults", resets, "--json", folder / "board.json"]
    board = subprocess.Popen(_command("board", *words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)
    board.stdout.readline()
    try:
        told, said, visitor, seconds = _record(port, recorded, config, rate, segments)
    finally:
        board.terminate()
        board_text = board.communicate()[1]
    found = {"seconds": seconds, "told": told, "said": said, "page": visitor.events if visitor else {}, "board": board_text.splitlines()}
    simulation = simulate_session(options, unit=with_its_own_rate(unit_of(options), options.odr_hz))
    found["rows"] = laid_beside(simulation, recorded, file)
    for name, where in (("recorded", recorded), ("file", file)):
        progress(f"{rate:g} Hz: fit, explain, report of {name}")
        fit = json.loads(_run("fit", where, "--methods", ",".join(METHODS), "--json", "-"))
        explained = json.loads(_run("explain", where, "--json", "-"))
        _run("report", where, "--out", folder / f"{name}.html")
        found[name] = {
            "closure_deg": {method: fit["methods"][method]["holdout"]["tilt_rms_deg"] for method in METHODS},
            "segments": fit["segments"]["used"],
            "verdict": explained.get("verdict"),
            "report_bytes": (folder / f"{name}.html").stat().st_size,
        }
    return found


def laid_beside(simulation: Simulation, recorded: Path, file: Path) -> dict[str, int]:
    """Write the file of what the sensor felt while it was recorded; rows of the session in the recording, rows of them that differ, the
    largest difference of their times in us."""
    (path,) = recorded.glob("log*.csv")
    lines = [line for line in path.read_text().splitlines() if line[0].isdigit()]  # no header, no comment
    got = np.array([line.split(",") for line in lines], np.int64)
    log, odr_hz = simulation.log, simulation.unit.odr_hz
    rows = np.column_stack([log.gyro, log.accel, log.temp]).astype(np.int64)
    first = np.flatnonzero((got[:, 1:7] == rows[0, :6]).all(axis=1))
    begin = max(k for k in first if np.array_equal(got[k : k + 20, 1:7], rows[:20, :6]))  # its first rows are the lead, too
    index = np.arange(len(got)) - begin
    still = round(STILL_S * odr_hz)
    behind = len(rows) - 1 - (index - len(rows)) % still
    felt = rows[np.where(index < 0, index % still, np.where(index < len(rows), index, behind))]
    t_us = np.rint(1e6 * np.arange(len(got)) / odr_hz).astype(np.int64)
    columns = felt.astype(np.int16)
    whole = RegisterLog(t_us, columns[:, :3], columns[:, 3:6], columns[:, 6])
    write_simulation(replace(simulation, log=whole), file)
    wrong = (got[:, 1:7] != felt[:, :6]).any(axis=1)
    off_us = got[:, 0] - got[begin, 0] - (t_us - t_us[begin])
    return {"rows": len(got), "differ": int(wrong.sum()), "off_us": int(np.abs(off_us).max())}


def _record(port: Path, out: Path, config: Path, rate: float, segments: int) -> tuple[dict, list[str], Visitor | None, float]:
    words = ["--port", port, "--out", out, "--like", config, "--segments", segments, "--odr", rate, "--view", "--json", "-"]
    began, visitor, said = time.monotonic(), None, []
    record = subprocess.Popen(_command("record", *words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)
    answer: list[str] = []
    reader = threading.Thread(target=lambda: answer.append(record.stdout.read()))
    reader.start()
    for line in record.stderr:
        said.append(line.rstrip("\n"))
        progress(said[-1][:100])
        if visitor is None and (found := re.search(r"http://\S+", line)):
            visitor = Visitor(found[0])
            visitor.start()
    reader.join()
    if record.wait():
        raise RuntimeError("record: " + "\n".join(said[-5:]))
    return json.loads(answer[0]), said, visitor, time.monotonic() - began


def _command(*words) -> list[str]:
    return [*CALIBRATE, *map(str, words)]


def _run(*words) -> str:
    done = subprocess.run(_command(*words), capture_output=True, text=True, env=ENVIRONMENT, check=False)
    if done.returncode:
        raise RuntimeError(f"{words[0]}: {done.stderr.strip()[-300:]}")
    return done.stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, nargs="+", default=[416.0, 1667.0, 6667.0], metavar="HZ", help="data rates (%(default)s)")
    parser.add_argument("--segments", type=int, default=12, help="turns of the session (%(default)s)")
    parser.add_argument("--speed", default="max", help="of the emulated board, as calibrate.py board takes it (%(default)s)")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep the sessions there")
    parser.add_argument("--json", type=Path, metavar="FILE", help="all figures")
    args = parser.parse_args()
    found = {}
    with tempfile.TemporaryDirectory(prefix="tinygc-") as name:
        folder = args.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        elf = built(folder / "elf", baud=921600)
        for rate in args.rate:
            (folder / f"{rate:g}").mkdir()
            found[f"{rate:g}"] = chain(folder / f"{rate:g}", elf, rate, args.segments, args.speed)
    progress("")
    print_table(found)
    if args.json:
        args.json.write_text(json.dumps(found, indent=1) + "\n")


def print_table(found: dict) -> None:
    """A line for each data rate."""
    head = ["Hz", "s", "accepted", "samples", "lost", "rows that differ", "stamps off, µs", "page's events"]
    head += [f"{method}, held out" for method in METHODS] + ["largest difference from the file", "verdict", "the file's"]
    rows = []
    for rate, row in found.items():
        told, mine, theirs = row["told"], row["recorded"], row["file"]
        off = max(abs(mine["closure_deg"][method] - theirs["closure_deg"][method]) for method in METHODS)
        accepted = f"{told['segments']['accepted']} of {told['segments']['accepted'] + told['segments']['rejected']}"
        closures = [f"{mine['closure_deg'][method]:.5f}°" for method in METHODS]
        events = sum(row["page"].values())
        verdicts = (str(each["verdict"]) for each in (mine, theirs))
        rows.append(
            [
                rate,
                f"{row['seconds']:.0f}",
                accepted,
                told["samples"],
                told["lost"],
                row["rows"]["differ"],
                row["rows"]["off_us"],
                events,
                *closures,
                f"{off:.1e}°",
                *verdicts,
            ]
        )
    print(markdown(head, rows))


if __name__ == "__main__":
    main()
