"""Peak memory and CPU seconds of ``check``, ``fit`` and ``explain`` on long sessions: a day at 208 Hz whose turns lie between long
rests, and a session of 2000 turns.

Both are simulated in pieces, so that writing them takes no memory either; the same seed writes the same bytes.  A line more is for
``simulate`` itself, which writes the session of 2000 turns.  Each command is a process of one thread; its peak is ``ru_maxrss``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import markdown, progress

from session.io.numeric import decimal_rows
from tinygc.simulation.movement import MovementPlan, Stroke
from tinygc.simulation.options import SimulationOptions, draw_unit
from tinygc.simulation.simulator import RegisterLog, Simulation, plan_of, record_pieces
from tinygc.simulation.write import HEADER, config_text

ROOT = Path(__file__).resolve().parents[1]
COMMANDS = ("check", "fit", "explain")
#: of each command, beside --quiet
PROBE = """
import json, resource, subprocess, sys, time
began = time.perf_counter()
done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([done.returncode, used.ru_maxrss, used.ru_utime + used.ru_stime, time.perf_counter() - began, done.stderr[-300:]]))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=24.0, help="length of the long log; 0: leave it out (%(default)s)")
    parser.add_argument("--turns", type=int, default=400, help="in the long log, spread evenly (%(default)s)")
    parser.add_argument("--segments", type=int, default=2000, help="of the other session; 0: leave it out (%(default)s)")
    parser.add_argument("--commands", default=",".join(COMMANDS), help="with commas (%(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, metavar="DIR", help="write the sessions there, or take those that are there")
    parser.add_argument("--write-only", action="store_true", help="write the sessions, and measure nothing")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="another checkout of this project, whose runs alternate with ours")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        home = args.keep or Path(parent)
        wanted = []
        if args.hours:
            wanted.append((f"{args.hours:g} h, {args.turns} turns", home / f"hours{args.hours:g}-{args.turns}", args.turns, args.hours))
        if args.segments:
            wanted.append((f"{args.segments} turns", home / f"segments{args.segments}", args.segments, 0.0))
        for words, folder, turns, hours in wanted:
            if not (folder / "session.toml").exists():
                progress(f"writing {words}")
                write_long_session(SimulationOptions(segments=turns, closure_s=0.0, seed=args.seed), folder, hours * 3600)
        if not args.write_only:
            roots = [ROOT, *([args.against.resolve()] if args.against else [])]
            table = [
                [words, f"`{command}`", str(number), *cells]
                for words, folder, *_ in wanted
                for command in args.commands.split(",")
                for number, cells in enumerate(_measured(command, folder, roots))
            ]
            for number, cells in enumerate(_simulated(args.segments, roots) if args.segments else ()):
                table.append([f"{args.segments} turns", "`simulate`", str(number), *cells])
            progress("")
            print(markdown(["session", "command", "checkout", "rows", "peak, GB", "bytes a row", "CPU, s", "elapsed, s", "exit"], table))


def _measured(command: str, folder: Path, roots: list[Path]) -> Iterator[list[str]]:
    count = sum(1 for _ in (folder / "log0001.csv").open("rb")) - 2
    for root in roots:
        progress(f"{command} {folder.name}")
        with tempfile.TemporaryDirectory(prefix="tinygc-") as out:
            more = [] if command == "check" else ["--json", f"{out}/result.json"]
            more += {"fit": ["--out", f"{out}/fit"], "explain": ["--out", f"{out}/explain"]}.get(command, [])
            code, peak_kb, cpu_s, elapsed_s, said = run([str(root / "calibrate.py"), command, str(folder), "--quiet", *more], root)
        peak = peak_kb * (1 if sys.platform == "darwin" else 1024)
        if code not in (0, 1):
            print(said, file=sys.stderr)
        yield [f"{count:,}", f"{peak / 1e9:.2f}", f"{peak / count:.0f}", f"{cpu_s:.1f}", f"{elapsed_s:.1f}", str(code)]


def _simulated(segments: int, roots: list[Path]) -> Iterator[list[str]]:
    for root in roots:
        progress(f"simulate {segments}")
        with tempfile.TemporaryDirectory(prefix="tinygc-") as out:
            asked = ["simulate", "--segments", str(segments), "--out", f"{out}/made", "--quiet"]
            code, peak_kb, cpu_s, elapsed_s, said = run([str(root / "calibrate.py"), *asked], root)
        if code:
            print(said, file=sys.stderr)
        yield ["", f"{peak_kb * (1 if sys.platform == 'darwin' else 1024) / 1e9:.2f}", "", f"{cpu_s:.1f}", f"{elapsed_s:.1f}", str(code)]


def run(arguments: list[str], root: Path) -> list:
    """Exit code, peak memory in the system's unit, CPU s, elapsed s, and the end of what it said, of a process of one thread."""
    own = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    probe = subprocess.run([sys.executable, "-c", PROBE, sys.executable, *arguments], env=own, cwd=root, capture_output=True, text=True)
    return json.loads(probe.stdout)


def write_long_session(options: SimulationOptions, folder: Path, lasts_s: float = 0.0) -> Path:
    """The folder of a session with one log, plain text, of ``options.segments`` turns; lasts_s: the log's length, its rests made longer
    by as much each; shorter than the turns need: as they are."""
    unit = draw_unit(options, np.random.default_rng([options.seed, 0]))
    plan = spread(plan_of(options), lasts_s)
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "log0001.csv").open("wb") as file:
        file.write(f"# gyro_fs_dps={options.gyro_fs_dps:g} accel_fs_g={options.accel_fs_g:g} odr_hz={unit.odr_hz:.4f}\n{HEADER}\n".encode())
        for part in record_pieces(options, unit, plan, int(np.ceil(plan.log_s * unit.odr_hz))):
            file.write(decimal_rows([part.t_us, *part.gyro.T, *part.accel.T, part.temp], [0] * 8))
    empty = RegisterLog(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    (folder / "session.toml").write_text(config_text(Simulation(options, plan, unit, empty, None), concealed=False), encoding="utf-8")
    return folder


def spread(plan: MovementPlan, lasts_s: float) -> MovementPlan:
    """The same turns with longer rests, a log of lasts_s s."""
    more_s = max(lasts_s - plan.log_s, 0.0) / (len(plan.turns) + 1)
    late_s = np.arange(1, len(plan.turns) + 1) * more_s
    starts = np.array([start for start, _ in plan.turns])

    def later(stroke: Stroke) -> Stroke:
        return replace(stroke, start_s=stroke.start_s + late_s[np.searchsorted(starts, stroke.start_s, side="right") - 1])

    turns = tuple((start + late, stop + late) for (start, stop), late in zip(plan.turns, late_s, strict=True))
    log_s = plan.log_s + more_s * (len(plan.turns) + 1)
    return replace(plan, strokes=tuple(map(later, plan.strokes)), turns=turns, log_s=log_s, duration_s=log_s)


if __name__ == "__main__":
    main()
