"""Moves that are computed on the way, against a sequence made beforehand: sigma by minute of a session.

Every session runs through the whole loop, on a virtual table of three axes with a virtual board on it: guide, stills found in the samples,
driver and settling times.  Only who chooses the next move differs:

    computed    the coach, by what is still uncertain after what was recorded
    fixed       one sequence for all units, which the coach chooses beforehand, of the data sheet's noise; from its end it goes back, and
                begins again

Sigmas are those of ``parameter_covariance`` on the recorded session, in units of their targets; the largest of the twelve is shown.  The
units' noise is between half and twice the data sheet's.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from common import in_parallel, markdown

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import table_recordings

from session.bench import guided_session
from session.bench.guide import HOLD_STILLS
from session.bench.messages import AxisMove, Kind
from session.io.config import Protocol
from session.io.folder import read_session
from session.io.units import DEG
from tinygc.annexes.machines.planner import TableMoves
from tinygc.closure.build import build_problem
from tinygc.closure.floor import BiasWander, Floor
from tinygc.closure.uncertainty import parameter_covariance
from tinygc.planning.coach import Coach
from tinygc.planning.proposals import TARGETS
from tinygc.simulation.options import SimulationOptions

STRATEGIES = ("computed", "fixed")
MINUTES = (0.5, 1.0, 1.5, 2.0, 3.0)
TABLE = table_recordings.table_toml("outer", "middle", "inner")
#: turns before which too little is seen for a covariance
FEWEST = 8


class Scripted:
    """Stands for ``TableMoves``: gives a sequence there and back, so that its angles fit when it begins again."""

    def __init__(self, turns: list[tuple[AxisMove, ...]]):
        there = [(AxisMove(0, 0.0, 90 * DEG),), *turns]
        self.angles = np.zeros(3)
        self._moves: Iterator[tuple[AxisMove, ...]] = itertools.chain(turns, itertools.cycle([*reversed(there[1:-1]), *turns[1:]]))

    def choose(self, most_rps: float) -> tuple[AxisMove, ...]:
        """The next of the sequence."""
        return next(self._moves)


def bench(folder: str, seed: int) -> table_recordings.Bench:
    """The table, with a unit whose noise is between half and twice the data sheet's."""
    factor = 2.0 ** np.random.default_rng([seed, 5]).uniform(-1, 1)
    options = SimulationOptions(segments=40, odr_hz=208, seed=seed, closure_s=0.0, gyro_noise_dps_rthz=float(0.005 * factor))
    return table_recordings.Bench(Path(folder), TABLE, options)


def beforehand() -> list[tuple[AxisMove, ...]]:
    """The fixed sequence."""
    with tempfile.TemporaryDirectory() as folder:
        moves = TableMoves(bench(folder, 0).description, np.zeros(3), HOLD_STILLS * Protocol().still_s)
    return [turn.moves for turn in Coach(machine=moves).rehearse(False).turns]


def one(job: tuple[str, int, int, list[tuple[AxisMove, ...]]]) -> list[tuple[float, float]]:
    """(s, worst sigma) after each turn from the eighth, of a strategy and a seed."""
    strategy, seed, segments, fixed = job
    guided_session.SILENT_S = 1e9
    scripted = Scripted(fixed)

    def each(guide, mover) -> None:
        mover._moves = scripted

    table_recordings.Coach = Coach if strategy != "fixed" else lambda machine: None
    with tempfile.TemporaryDirectory() as folder:
        table = bench(folder, seed)
        _, said = table.record(segments, each=each if strategy == "fixed" else None)
        problem = build_problem(read_session(table.folder))
    times_s, found = [change.at_s for change in said.changes if change.kind is Kind.ACCEPTED], []
    for count in range(FEWEST, min(len(times_s), len(problem.used)) + 1):
        first = slice(0, count)
        floor = Floor(problem.floor.own[first], problem.floor.shared[: count - 1])
        wander = BiasWander(problem.middle_s[first], problem.instability.rps)
        covariance = parameter_covariance(problem.batch.pick(first), floor, problem.first, problem.earth, wander=wander)
        found.append((times_s[count - 1], float(np.max(np.sqrt(np.diag(covariance)) / TARGETS))))
    return found


def reached_s(curve: list[tuple[float, float]]) -> float:
    """When the worst sigma first meets its target, between two turns by its logarithm; infinite where it does not."""
    for (before_s, before), (after_s, after) in itertools.pairwise(curve):
        if after <= 1:
            share = np.log(before) / np.log(before / after) if before > 1 else 0.0
            return before_s + share * (after_s - before_s)
    return float("inf")


def row(curves: list[list[tuple[float, float]]]) -> list[str]:
    """Median worst sigma at each minute, and when the targets were met."""
    at = [[min((sigma for at_s, sigma in curve if at_s <= 60 * minute), default=np.inf) for curve in curves] for minute in MINUTES]
    times_s = [reached_s(curve) for curve in curves]
    return [*(f"{np.median(sigmas):.2f}" for sigmas in at), f"{np.median(times_s):.0f} ({min(times_s):.0f}–{max(times_s):.0f})"]


def main() -> None:
    """Print the table of docs/measured/table-moves.md."""
    command = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    command.add_argument("--seeds", type=int, default=8)
    command.add_argument("--first", type=int, default=3000, help="first seed")
    command.add_argument("--segments", type=int, default=44)
    args = command.parse_args()
    seeds, fixed = range(args.first, args.first + args.seeds), beforehand()
    jobs = [(strategy, seed, args.segments, fixed) for strategy in STRATEGIES for seed in seeds]
    curves = dict(zip([job[:2] for job in jobs], in_parallel(one, jobs, "session"), strict=True))
    for other in STRATEGIES[1:]:
        ratios = np.array([reached_s(curves["computed", seed]) / reached_s(curves[other, seed]) for seed in seeds])
        print(f"s to all targets, computed over {other}, unit by unit: {np.round(np.sort(ratios), 2)}, mean {ratios.mean():.3f}")
    rows = [(strategy, *row([curves[strategy, seed] for seed in seeds])) for strategy in STRATEGIES]
    print(markdown(("moves", *(f"{minute:g} min" for minute in MINUTES), "all targets, s"), rows))


if __name__ == "__main__":
    main()
