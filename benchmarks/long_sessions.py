"""Peak memory and CPU seconds of ``check``, ``fit`` and ``explain`` on long sessions: a day at 208 Hz whose turns lie between long
rests, and a session of 2000 turns.

Both are simulated with the project's own motion, filters, noise and registers, a few minutes at a time, so that writing them takes no
memory either; the same seed writes the same bytes.  Each command is a process of one thread; its peak is ``ru_maxrss``.
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
from session.io.units import DEG, DEG_PER_HOUR, G
from tinygc.simulation import simulator
from tinygc.simulation.movement import MovementPlan, Stroke
from tinygc.simulation.options import GYRO_LPF2_HZ, SimulationOptions, draw_unit
from tinygc.simulation.simulator import RegisterLog, Simulation, bias_instability, plan_of, true_signals
from tinygc.simulation.write import HEADER, config_text

ROOT = Path(__file__).resolve().parents[1]
#: s that are simulated at once
PIECE_S = 120.0
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
        for part in _pieces(options, unit, plan):
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


def _pieces(options: SimulationOptions, unit, plan: MovementPlan) -> Iterator[RegisterLog]:
    """What ``simulate_session`` gives at once, ``PIECE_S`` at a time: each with a run-up of its own for the filters."""
    odr_hz = unit.odr_hz
    count, size = int(np.ceil(plan.log_s * odr_hz)), round(PIECE_S * odr_hz)
    factor, run_up = simulator.oversampling(odr_hz), int(np.ceil(simulator.RUN_UP_S * odr_hz))
    gyro_noise, accel_noise = options.gyro_noise_dps_rthz * DEG, options.accel_noise_ug_rthz * 1e-6 * G
    gyro_hz, accel_hz, units = GYRO_LPF2_HZ[options.odr_hz], simulator.ACCEL_BANDWIDTH_ODR * odr_hz, options.register_units
    rng = np.random.default_rng([options.seed, 1])
    flicker = bias_instability(options.bias_instability_dph * DEG_PER_HOUR, odr_hz, count, rng).astype(np.float32)
    for start in range(0, count, size):
        progress(f"{start / count:.0%}")
        stop = min(start + size, count)
        t_fine = np.arange((start - run_up) * factor, stop * factor) / (factor * odr_hz)
        rate, force, temp_c = true_signals(options, unit, _near(plan, t_fine[0], t_fine[-1]), t_fine)
        gyro = simulator.low_pass(unit.measured_rate(rate), gyro_hz, gyro_noise, odr_hz, factor, rng)[run_up:] + flicker[start:stop]
        accel = simulator.low_pass(unit.measured_force(force), accel_hz, accel_noise, odr_hz, factor, rng)[run_up:]
        yield RegisterLog(
            t_us=np.rint(np.arange(start, stop) / odr_hz * 1e6).astype(np.int64),
            gyro=simulator.registers_of(gyro, options.gyro_fs_dps * DEG, units.gyro_rps),
            accel=simulator.registers_of(accel, options.accel_fs_g * G, units.accel_mps2),
            temp=simulator.temperature_registers(temp_c[run_up * factor :: factor], rng, units),
        )


def _near(plan: MovementPlan, begin_s: float, end_s: float) -> MovementPlan:
    """The strokes of a moment, those before it already made: a day of them need not be walked through for each piece."""
    start = np.array(plan.start_rad, dtype=float)
    for stroke in plan.strokes:
        if stroke.stop_s < begin_s:
            start[stroke.gimbal] += stroke.change_rad
    return replace(plan, start_rad=start, strokes=tuple(s for s in plan.strokes if s.stop_s >= begin_s and s.start_s <= end_s))


if __name__ == "__main__":
    main()
