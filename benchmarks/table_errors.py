"""The table's own errors: each injected on tables of one to three axes, told from its twin in the sensor (docs/table-errors.md).

python benchmarks/table_errors.py --clean 300        share of clean recordings with a p below 5 %, and with a name
python benchmarks/table_errors.py --stamps 100       the same, with stamps as a busy computer makes them, of each kind
python benchmarks/table_errors.py --cases 4          four sessions of each error, size and table
python benchmarks/table_errors.py --samples          a few whole recordings, sample by sample
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from session.annexes.machines.angles import read_angles
from session.annexes.machines.description import Axis, Description, read_description
from session.annexes.machines.mechanics import AxisErrors, TableErrors
from session.io.units import DEG
from tinygc.annexes.machines.observed import observe
from tinygc.annexes.machines.selection import Selected, select
from tinygc.annexes.machines.simulation import LostSteps, fixed_moves, simulate_on_table
from tinygc.annexes.machines.summaries import Stamps, Summary, draw
from tinygc.closure.prepared import prepare
from tinygc.effects.catalogue import catalogue
from tinygc.simulation.options import SimulationOptions

X, Y, Z = np.eye(3)
TABLES = {"one vertical axis": (Z,), "one level axis": (X,), "two axes": (Z, Y), "three axes": (Z, Y, X)}
#: stamps of live recordings: good, of a poll of 10 ms, of a clock that wanders, with stalls, and all of it
STAMPS = {
    "1 ms late, jitter 0.3 ms": Stamps(late_s=1e-3, jitter_s=3e-4),
    "10 ms late, jitter 3 ms": Stamps(late_s=10e-3, jitter_s=3e-3),
    "10 ms late, jitter 2 ms, wander 2 ms for 5 s": Stamps(late_s=10e-3, jitter_s=2e-3, wander_s=2e-3, time_s=5.0),
    "10 ms late, jitter 2 ms, wander 3 ms for 0.3 s": Stamps(late_s=10e-3, jitter_s=2e-3, wander_s=3e-3, time_s=0.3),
    "5 ms late, jitter 1 ms, 2 % stalled by 50 ms": Stamps(late_s=5e-3, jitter_s=1e-3, stalled=0.02),
    "20 ms late, jitter 5 ms, wander 5 ms for 20 s, 2 % stalled": Stamps(0.06, 20e-3, 5e-3, 5e-3, 20.0, 0.02),
}
MOVES = 24
RATE_RPS = 80 * DEG


def table_of(directions: tuple[np.ndarray, ...]) -> Description:
    """A table with these axes, each accurate to 0.01 degrees."""
    names = ("outer", "middle", "inner")
    axes = tuple(
        Axis(name, direction, -np.pi, np.pi, 200 * DEG, 400 * DEG, 0.01 * DEG, 0.0, name)
        for name, direction in zip(names, directions, strict=False)
    )
    return Description("virtual", "virtual", axes)


def cases(table: Description, large: bool = False) -> Iterator[tuple[str, str, dict]]:
    """Name of what is injected, its size in words, and the fields of ``Summary``."""
    axes = len(table.axes)
    small, usual = ((0.5, 2.0, 5.0),) * 2 if large else ((0.02, 0.1), (0.05, 0.2))

    def errors(axis: int, **of: object) -> TableErrors:
        return TableErrors(tuple(AxisErrors(**of) if number == axis else AxisErrors() for number in range(axes)))  # type: ignore[arg-type]

    last = axes - 1
    for deg in small:
        yield "table.index", f"{deg}°", {"errors": errors(0, index=np.array([deg, 0, 0, deg / 2]) * DEG)}
        yield "table.wobble", f"{deg}°", {"errors": errors(last, wobble=np.array([deg, -deg, 0, 0]) * DEG)}
        yield "table.rate_ripple", f"{deg}°", {"errors": errors(0, ripple=deg * DEG, ripple_cycles=9, ripple_phase=1.0)}
        yield "table.backlash", f"{deg}°", {"errors": errors(last, backlash=deg * DEG)}
    for deg in usual:
        yield "table.tilt", f"{deg}°", {"errors": TableErrors(errors(0).axes, tilt=np.array([deg, -deg / 2, 0]) * DEG)}
        if axes > 1:
            own = table.axes[1].direction
            away = np.cross(np.cross(table.axes[0].direction, own), own)
            yield "table.nonorthogonal", f"{deg}°", {"errors": errors(1, skew=deg * DEG * away)}
    for deg in (2.0, 5.0, 8.0) if large else (0.2, 1.0):
        yield "table.lost_steps", f"{deg}°", {"lost": (LostSteps(11, 11 % axes, deg * DEG),)}
        yield "timing.dropped_samples", f"{deg}°", {"dropped": ((11, deg * DEG),)}
    if large:
        return
    for ms in (40, 100):
        yield "table.latency", f"{ms} ms", {"errors": TableErrors(errors(0).axes, latency_s=1e-3 * ms)}
    effects = catalogue()
    for id, size, theta in (
        ("gyro.scale_asymmetry", "0.1 %", np.full(3, 1e-3)),
        ("gyro.scale_asymmetry", "0.5 %", np.full(3, 5e-3)),
        ("gyro.scale_nonlinearity", "5 % of full scale", np.full(3, 0.05)),
        ("gyro.g_sensitivity", "0.02 dps/g", np.eye(3).ravel() * 0.02 * DEG),
        ("gyro.bandwidth", "0, 10, 20 ms", np.array([0.0, 0.01, 0.02])),
        ("accelerometer.nonlinearity", "2 mg/g²", np.full(3, 2e-3 * 9.80665)),
        ("accelerometer.scale_asymmetry", "0.1 %", np.full(3, 1e-3)),
    ):
        if effects[id].parameter.size == len(theta):
            yield id, size, {"effects": ((effects[id], theta),)}


def outcome(injected: str, selected: Selected) -> str:
    """``named``, ``one of several`` (not told from others, and said so), ``inseparable`` (from the calibration, and said so), ``nothing``
    or ``wrong``."""
    own = [each for each in selected.named if injected in (each.candidate.id, *each.equivalent)]
    if len(own) < len(selected.named):
        return "wrong"
    if not own:
        hidden = any(each.candidate.id == injected and each.hidden_in for each in selected.unseen)
        return "inseparable" if hidden else "nothing"
    return "named" if any(each.candidate.id == injected and not each.equivalent for each in own) else "one of several"


def run_cases(count: int, first: int, large: bool, live: bool) -> None:
    """Print a row for each table, error and size; live: with the stamps of a poll of 10 ms."""
    answers = {"stamps": STAMPS["10 ms late, jitter 3 ms"], "block_s": 0.07} if live else {}
    total: Counter[str] = Counter()
    for name, directions in TABLES.items():
        table = table_of(directions)
        for injected, size, fields in cases(table, large):
            found: Counter[str] = Counter()
            said: Counter[str] = Counter()
            for seed in range(first, first + count):
                of = {"errors": TableErrors.none(table)} | answers | fields
                summary = Summary(table, fixed_moves(table, MOVES, RATE_RPS, seed), **of)
                selected = select(draw(summary, seed), seed)
                found["unexplained" if selected.excess else outcome(injected, selected)] += 1
                said.update("/".join((each.candidate.id, *each.equivalent)) for each in selected.named)
            total += found
            words = ", ".join(f"{number} {what}" for what, number in found.most_common())
            print(f"| {name} | `{injected}` | {size} | {words} | {'; '.join(f'{k} {v}' for k, v in said.most_common(3))} |", flush=True)
    runs = sum(total.values())
    print(f"{runs} sessions: {dict(total)}; wrong {100 * total['wrong'] / runs:.1f} %")


def run_clean(count: int, first: int) -> None:
    """Print how often a clean table, repeatable as declared or perfectly, has a p-value below 5 %, and a name."""
    for repeatability in (0.0, 1.0):
        for name, directions in TABLES.items():
            table, p_values, named = table_of(directions), [], Counter[str]()
            for seed in range(first, first + count):
                moves = fixed_moves(table, MOVES, RATE_RPS, seed)
                summary = Summary(table, moves, TableErrors.none(table), repeatability=repeatability)
                selected = select(draw(summary, seed), seed)
                p_values.append(selected.first_p)
                named.update(each.candidate.id for each in selected.named)
            share = 100 * np.mean(np.array(p_values) < 0.05)
            print(f"| {name} | {repeatability:g} | {count} | {share:.1f} % | {sum(named.values())} | {dict(named)} |", flush=True)


def run_stamps(count: int, first: int) -> None:
    """Print the same for stamps of live recordings, tables by turns; answers every 60 ms, in blocks of 70 ms."""
    for kind, stamps in STAMPS.items():
        for repeatability in (0.0, 1.0):
            p_values, named = [], Counter[str]()
            for seed in range(first, first + count):
                table = table_of(list(TABLES.values())[seed % len(TABLES)])
                moves = fixed_moves(table, MOVES, RATE_RPS, seed)
                of = {"repeatability": repeatability, "stamps": stamps, "block_s": 0.07}
                selected = select(draw(Summary(table, moves, TableErrors.none(table), **of), seed), seed)
                p_values.append(selected.first_p)
                named.update(each.candidate.id for each in selected.named)
            shares = " | ".join(f"{100 * np.mean(np.array(p_values) < level):.1f} %" for level in (0.05, 0.5))
            print(f"| {kind} | {repeatability:g} | {count} | {shares} | {sum(named.values())} | {dict(named)} |", flush=True)


def run_samples() -> None:
    """Print what whole recordings say, simulated sample by sample."""
    table = table_of(TABLES["two axes"])
    for injected, size, fields in cases(table):
        if "effects" in fields or "dropped" in fields:
            continue
        options = SimulationOptions(seed=5, closure_s=0.0, still_s=1.5)
        moves = fixed_moves(table, MOVES, RATE_RPS, 5)
        simulated = simulate_on_table(table, moves, options, fields.get("errors"), lost=fields.get("lost", ()))
        with TemporaryDirectory() as place:
            folder = simulated.save(Path(place) / "session")
            description = read_description(folder / "table.toml")
            observed = observe(prepare(folder).problem, description, read_angles(folder / "table.csv", description))
        selected = select(observed)
        said = "; ".join(f"{each.candidate.id} {each.candidate.values(each.theta)} {each.equivalent}" for each in selected.named)
        print(f"| `{injected}` | {size} | {outcome(injected, selected)} | {said} |", flush=True)


def main() -> None:
    """Parse arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--clean", type=int, metavar="N", help="clean sessions of each table")
    parser.add_argument("--cases", type=int, metavar="N", help="sessions of each error, size and table")
    parser.add_argument("--stamps", type=int, metavar="N", help="clean sessions with each kind of live stamps")
    parser.add_argument("--live", action="store_true", help="with --cases: stamps of a live recording")
    parser.add_argument("--large", action="store_true", help="with --cases: errors of 0.5 degrees and more, of the table alone")
    parser.add_argument("--samples", action="store_true", help="whole recordings, sample by sample")
    parser.add_argument("--first", type=int, default=0, help="seed of the first session")
    args = parser.parse_args()
    if args.clean:
        run_clean(args.clean, args.first)
    if args.stamps:
        run_stamps(args.stamps, args.first)
    if args.cases:
        run_cases(args.cases, args.first, args.large, args.live)
    if args.samples:
        run_samples()


if __name__ == "__main__":
    main()
