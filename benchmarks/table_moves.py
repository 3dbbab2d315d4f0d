"""Moves that are computed on the way, against fixed tumbles, a sequence made beforehand, and random moves: sigma by minute of a session.

Every session runs through the whole loop, on a virtual table with a virtual board on it: guide, stills found in the samples, driver and
settling times.  Only who chooses the next move differs:

    computed    the coach, by what is still uncertain after what was recorded, and by the end of the session behind each move
    greedy      the same by the gain of each move alone
    best fixed  one sequence for all units, which the coach chooses beforehand by the end of the session, of the data sheet's noise; from
                its end it goes back, and begins again
    tumble      each axis in quarter turns, four this way and four back, then the next one: the multi-position tests of IEEE 1431 in their
                order as recalled; the standard's text was not at hand
    random      any of the moves that the coach chooses from

By hand: ``benchmarks/coach.py``'s coached hand, 8 s from still to still, its sigmas by the same code.  Sigmas are those of
``parameter_covariance`` on the recorded session, in units of their targets; the largest of the twelve is shown.  The units' noise is
between half and twice the data sheet's.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from coach import COUNTS, CoachedHand, worst_sigmas
from common import in_parallel, markdown

from session.annexes.machines.description import read_description
from session.bench import guided_session
from session.bench.guide import HOLD_STILLS, Guide
from session.bench.guided_session import GuidedRecording
from session.bench.live import SEGMENT_S
from session.bench.messages import AxisMove, Kind
from session.bench.recorder import Recorder
from session.bench.session_file import SessionFile
from session.io.config import Protocol
from session.io.folder import read_session
from session.io.units import DEG
from tinygc.annexes.machines.planner import TableMoves
from tinygc.annexes.machines.recording import TurnedRecording
from tinygc.annexes.machines.virtual_bench import PORT, VirtualBench
from tinygc.closure.build import build_problem
from tinygc.closure.floor import BiasWander, Floor
from tinygc.closure.uncertainty import parameter_covariance
from tinygc.planning.coach import Coach
from tinygc.planning.proposals import TARGETS
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import config_text

HAND = "by hand"
STRATEGIES = ("computed", "greedy", "best fixed", "tumble", "random")
#: directions of the axes, from the ground outwards, of tables of three, two and one
TABLES = {
    "three axes": ("[0, 0, 1]", "[0, 1, 0]", "[1, 0, 0]"),
    "two axes": ("[0, 1, 0]", "[0, 0, 1]"),
    "one axis, level": ("[1, 0, 0]",),
}
MINUTES = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0)


def table_toml(directions: tuple[str, ...]) -> str:
    """A table of 90 deg/s and 200 deg/s^2, as a stepper's."""
    text = 'schema = "tinygc-table/1"\nname = "bench"\nmake = "grbl"\n'
    for number, direction in enumerate(directions):
        text += f'[[axis]]\nname = "axis{number}"\ndirection = {direction}\nfastest_dps = 90\nacceleration_dps2 = 200\n'
        text += f'sigma_deg = 0.02\nword = "{"XYZ"[number]}"\n'
    return text


#: turns before which too little is seen for a covariance
FEWEST = 8


def unit_options(seed: int, segments: int = 40) -> SimulationOptions:
    """A unit whose noise is between half and twice the data sheet's."""
    factor = 2.0 ** np.random.default_rng([seed, 5]).uniform(-1, 1)
    return SimulationOptions(segments=segments, odr_hz=208, seed=seed, closure_s=0.0, gyro_noise_dps_rthz=float(0.005 * factor))


class Scripted:
    """Stands for ``TableMoves``: gives one sequence of moves after the other."""

    def __init__(self, moves: Iterator[tuple[AxisMove, ...]], start: np.ndarray):
        self.angles, self._moves = start, moves

    def choose(self, most_rps: float) -> tuple[AxisMove, ...]:
        """The next of the sequence."""
        return next(self._moves)


class Quiet:
    """Stands for a screen."""

    def __init__(self) -> None:
        self.accepted_s: list[float] = []

    def change(self, change) -> None:
        """Note when a turn was accepted."""
        if change.kind is Kind.ACCEPTED:
            self.accepted_s.append(change.at_s)

    def show(self, guide) -> None:
        """Nothing is shown."""


def tumble(axes: int) -> Iterator[tuple[AxisMove, ...]]:
    """Quarter turns about each axis, four this way and four back, again and again."""
    angles = np.zeros(axes)
    while True:
        for axis in reversed(range(axes)):
            for sense in [1.0] * 4 + [-1.0] * 4:
                angles[axis] += sense * 90 * DEG
                yield (AxisMove(axis, float(angles[axis]), 90 * DEG),)
            angles[axis] += 90 * DEG  # the next axis is turned in another attitude of this one
            yield (AxisMove(axis, float(angles[axis]), 90 * DEG),)


def unwound(turns: list[tuple[AxisMove, ...]]) -> Iterator[tuple[AxisMove, ...]]:
    """A sequence there and back, so that its angles fit when it begins again."""
    there = [(AxisMove(0, 0.0, 90 * DEG),), *turns]
    yield from turns
    yield from itertools.cycle([*reversed(there[1:-1]), *turns[1:]] if len(turns) > 2 else turns)


Sequence = tuple[tuple[AxisMove, ...], ...]


def beforehand(table: str) -> tuple[Sequence, np.ndarray]:
    """The best fixed sequence of a table, and which of the twelve parameters its turns show."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "table.toml"
        file.write_text(table_toml(TABLES[table]))
        moves = TableMoves(read_description(file), np.zeros(len(TABLES[table])), HOLD_STILLS * Protocol().still_s)
    rehearsal = Coach(machine=moves).rehearse(False, enough=True, ahead=True)
    return tuple(turn.moves for turn in rehearsal.turns), ~rehearsal.unseen


def record(folder: Path, strategy: str, directions: tuple[str, ...], seed: int, segments: int, stop: bool, fixed: Sequence) -> list[float]:
    """Record a session; returns when each turn was accepted, s."""
    guided_session.SILENT_S = 1e9
    file = folder / "table.toml"
    file.write_text(table_toml(directions))
    options = unit_options(seed)
    bench = VirtualBench(read_description(file), options)
    bench.home()
    session = folder / "session"
    session.mkdir()
    text = config_text(SimpleNamespace(options=options, unit=bench.unit), concealed=False)  # type: ignore[arg-type]
    (session / "session.toml").write_text(text.replace("SIM-", ""))
    notebook, view = SessionFile(session, None, None, None, None), Quiet()
    recorder = Recorder(session, PORT, port=bench.port)  # type: ignore[arg-type]
    guide = Guide(notebook.protocol, segments, stop)
    machine = TurnedRecording(file, opened=bench.opened, now_s=bench.clock.now_s)
    machine.confirmed(False, segments, False, 0.0, yes=True, quiet=True)
    mover = machine.mover(session, guide)
    moves, coach = machine.moves, None
    if strategy in ("computed", "greedy"):
        coach = Coach(machine=moves, ahead=strategy == "computed")
    elif strategy == "best fixed":
        mover._moves = Scripted(unwound(list(fixed)), moves.angles)
    elif strategy == "tumble":
        mover._moves = Scripted(tumble(len(directions)), moves.angles)
    else:
        moves.first = ()

    def configure(info, waited_s):
        return notebook.configure(info, waited_s, recorder.logs.physical, recorder.logs.board, True)

    guided = GuidedRecording(guide, recorder, configure, coach, view, notebook, mover=mover)
    bench.holds = lambda: guided.coaching
    guided.lead()
    recorder.close()
    machine.close()
    return view.accepted_s


def by_time(folder: Path, times_s: list[float], shown: np.ndarray) -> list[tuple[float, float]]:
    """(s, worst sigma of those shown) after each turn from the eighth, of a recorded session."""
    problem = build_problem(read_session(folder / "session"))
    found = []
    for count in range(FEWEST, min(len(times_s), len(problem.used)) + 1):
        first = slice(0, count)
        floor = Floor(problem.floor.own[first], problem.floor.shared[: count - 1])
        wander = BiasWander(problem.middle_s[first], problem.instability.rps)
        covariance = parameter_covariance(problem.batch.pick(first), floor, problem.first, problem.earth, wander=wander)
        found.append((times_s[count - 1], float(np.max((np.sqrt(np.diag(covariance)) / TARGETS)[shown]))))
    return found


def one(job: tuple[str, str, int, int, tuple[Sequence, np.ndarray]]) -> list[tuple[float, float]]:
    """Sigma by time of a table, a strategy and a seed."""
    table, strategy, seed, segments, (fixed, shown) = job
    with tempfile.TemporaryDirectory() as folder:
        times_s = record(Path(folder), strategy, TABLES[table], seed, segments, False, fixed)
        return by_time(Path(folder), times_s, shown)


def by_hand(seed: int) -> list[tuple[float, float]]:
    """The coached hand's sigmas, 8 s from still to still."""
    options = unit_options(seed, max(COUNTS))
    sigmas = worst_sigmas(options, CoachedHand(options).plan(max(COUNTS)))
    return [(SEGMENT_S * count, sigma) for count, sigma in zip(COUNTS, sigmas, strict=True)]


def reached_s(curve: list[tuple[float, float]]) -> float:
    """When the worst sigma first meets its target, between two turns by its logarithm; infinite where it does not."""
    for (before_s, before), (after_s, after) in itertools.pairwise(curve):
        if after <= 1:
            share = np.log(before) / np.log(before / after) if before > 1 else 0.0
            return before_s + share * (after_s - before_s)
    return float("inf")


def same_calibration(seed: int) -> tuple[float, float, int]:
    """A unit calibrated by the machine and by hand: chi-square (12) of the difference over both covariances; the machine's s and turns."""
    from tinygc import FitOptions, fit
    from tinygc.simulation.write import write_session

    options = FitOptions(methods=("least_squares",))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        times_s = record(folder, "computed", TABLES["three axes"], seed, 60, True, ())
        turned = fit(folder / "session", options).result
        hand = replace(unit_options(seed), seed=seed + 10_000, unit_seed=seed)
        held = fit(write_session(hand, folder / "hand"), options).result
    difference = turned.linear.model.vector - held.linear.model.vector  # type: ignore[attr-defined]
    return float(difference @ np.linalg.solve(turned.covariance + held.covariance, difference)), times_s[-1], len(times_s)


def main() -> None:
    """Print the tables of docs/measured/table-moves.md."""
    command = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    command.add_argument("--seeds", type=int, default=5)
    command.add_argument("--first", type=int, default=2000, help="first seed")
    command.add_argument("--segments", type=int, default=50)
    command.add_argument("--same", type=int, default=0, metavar="N", help="calibrate N units by machine and by hand instead")
    command.add_argument("--tables", nargs="+", default=list(TABLES), choices=list(TABLES))
    command.add_argument("--moves", nargs="+", default=[*STRATEGIES, HAND], choices=[*STRATEGIES, HAND])
    args = command.parse_args()
    seeds = range(args.first, args.first + args.seeds)
    if args.same:
        found = np.array(in_parallel(same_calibration, range(args.first, args.first + args.same), "unit"))
        chi = found[:, 0]
        print(f"chi-square of 12: mean {chi.mean():.1f}, from {chi.min():.1f} to {chi.max():.1f}, {args.same} units")
        print(f"the machine: {np.median(found[:, 1]):.0f} s and {np.median(found[:, 2]):.0f} turns (median); by hand 40 turns")
        return
    asked = [strategy for strategy in STRATEGIES if strategy in args.moves]
    planned = dict(zip(args.tables, in_parallel(beforehand, args.tables, "sequence"), strict=True))
    jobs = [(table, strategy, seed, args.segments, planned[table]) for table in args.tables for strategy in asked for seed in seeds]
    curves = dict(zip([job[:3] for job in jobs], in_parallel(one, jobs, "session"), strict=True))
    rows = []
    for table in args.tables:
        for strategy in asked:
            rows.append((table, strategy, *_row([curves[table, strategy, seed] for seed in seeds])))
        for other in asked[1:3]:
            both = [[reached_s(curves[table, strategy, seed]) for strategy in (asked[0], other)] for seed in seeds]
            ratios = np.sort([computed / its for computed, its in both if np.isfinite(computed + its)])
            print(f"{table}: s to all targets, {asked[0]} over {other}, unit by unit: {np.round(ratios, 2)}, mean {ratios.mean():.3f}")
    if HAND in args.moves:
        rows.append((HAND, "coached, 8 s a turn", *_row(in_parallel(by_hand, seeds, "hand"))))
    print(markdown(("table", "moves", *(f"{minute:g} min" for minute in MINUTES), "all targets, s"), rows))


def _row(curves: list[list[tuple[float, float]]]) -> list[str]:
    """Median worst sigma at each minute, and when the targets were met."""
    cells = []
    for minute in MINUTES:
        sigmas = [min((sigma for at_s, sigma in curve if at_s <= 60 * minute), default=np.inf) for curve in curves]
        over = [curve[-1][0] < 60 * minute - 2 * SEGMENT_S for curve in curves]
        value = float(np.median(sigmas))
        cells.append("–" if all(over) else f"{value:.2f}" if value < 100 else "> 100")
    times_s = [reached_s(curve) for curve in curves]
    return [*cells, f"{np.median(times_s):.0f} ({min(times_s):.0f}–{max(times_s):.0f})" if np.isfinite(np.median(times_s)) else "never"]


if __name__ == "__main__":
    main()
