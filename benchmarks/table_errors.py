"""The table's own errors: each injected on tables of one to three axes, told from its twin in the sensor (table-errors.md).

python benchmarks/table_errors.py clean 75      share of clean recordings with a p below 5 %, and with a name
python benchmarks/table_errors.py stamps 15     the same, with stamps as a busy computer makes them, of each kind
python benchmarks/table_errors.py cases 2       two sessions of each error, size and table
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/features/tables"))

from imperfect_tables import AxisErrors, AxisTrack, TableErrors
from simulated_tables import LostSteps, Summary, draw, fixed_moves

from session.base.units import DEG
from tinygc.effects.catalogue import catalogue
from tinygc.features.tables.machines.description import Axis, Description
from tinygc.features.tables.observed import held_up_from, reported_at, stamp_offsets
from tinygc.features.tables.selection import Selected, select

#: s between the samples that show which answers were held up
TRUTH_S = 0.005
X, Y, Z = np.eye(3)
TABLES = {"one vertical axis": (Z,), "one level axis": (X,), "two axes": (Z, Y), "three axes": (Z, Y, X)}


@dataclass(frozen=True)
class Stamps:
    """Answers as a computer stamps them that has other work: every ``poll_s`` behind the last one, late by a part of its own each time
    (exponential: it waits for its turn), by a wander that lasts ``time_s`` (Gauss-Markov), and now and then by a stall.

    late_s: mean; jitter_s, wander_s: one sigma; stalled: share of the answers that are held up, by stall_s.
    """

    poll_s: float = 0.06
    late_s: float = 0.01
    jitter_s: float = 2e-3
    wander_s: float = 0.0
    time_s: float = 5.0
    stalled: float = 0.0
    stall_s: float = 0.05

    def drawn(self, until_s: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """True and stamped times (N,), s, of the answers up to a time; stamps never decrease."""
        count = int(until_s / self.poll_s) + 1
        held_up = self.stall_s * (rng.random(count) < self.stalled)
        own = self.late_s + self.jitter_s * (rng.exponential(size=count) - 1) + held_up
        asked = np.cumsum(self.poll_s * rng.uniform(0.95, 1.05, count) + np.append(0.0, held_up[:-1]))
        wander, kept = rng.normal(size=count), np.exp(-np.diff(asked, prepend=asked[0]) / self.time_s)
        for number in range(1, count):
            wander[number] = kept[number] * wander[number - 1] + np.sqrt(1 - kept[number] ** 2) * wander[number]
        return asked, np.maximum.accumulate(asked + own + self.wander_s * wander)


def stamped(
    stamps: Stamps,
    summary: Summary,
    tracks: Sequence[AxisTrack],
    spans: Sequence[tuple[float, float]],
    edges: np.ndarray,
    said: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """The word (S, B + 1, K) at the edges (S, B + 1), s, and their places among the answers, as ``observe`` has them."""

    def word(at_s: np.ndarray) -> np.ndarray:
        return np.stack([track.reported(at_s) for track in tracks], axis=-1)

    asked_s, stamp_s = stamps.drawn(spans[-1][1] + summary.still_s, rng)
    answers, cut = word(asked_s - summary.errors.latency_s), []
    for number, (start, stop) in enumerate(spans):
        within = np.flatnonzero((stamp_s > start) & (stamp_s < stop))
        within = within[np.unique(stamp_s[within], return_index=True)[1]]
        axis = int(np.argmax(np.abs(said[number + 1] - said[number])))
        t_s = np.arange(start, stop, TRUTH_S)
        way, sense = word(t_s)[:, axis] - said[number, axis], np.sign(said[number + 1, axis] - said[number, axis])
        offset_s = stamp_offsets(stamp_s[within], sense * (answers[within, axis] - said[number, axis]), t_s, sense * way)
        cut.append((within, offset_s))
    limit_s = held_up_from([offset_s for _, offset_s in cut])
    found, places = [], []
    for number, (within, offset_s) in enumerate(cut):
        kept = within[~(np.abs(offset_s) > limit_s)]
        own = np.unique(edges[number])  # the last one is repeated
        at, place = reported_at(own, stamp_s[kept], answers[kept], (said[number], said[number + 1]))
        more = edges.shape[1] - len(own)
        found.append(np.pad(at, ((0, more), (0, 0)), mode="edge"))
        places.append(np.pad(place, (0, more), mode="edge"))
    return np.stack(found), np.stack(places)


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
        Axis(name, direction, 200 * DEG, 400 * DEG, 0.01 * DEG, -np.pi, np.pi) for name, direction in zip(names, directions, strict=False)
    )
    return Description("virtual", "virtual", axes)


def cases(table: Description) -> Iterator[tuple[str, str, dict]]:
    """Name of what is injected, its size in words, and the fields of ``Summary``."""
    axes = len(table.axes)

    def errors(axis: int, **of: object) -> TableErrors:
        return TableErrors(tuple(AxisErrors(**of) if number == axis else AxisErrors() for number in range(axes)))  # type: ignore[arg-type]

    last = axes - 1
    for deg in (0.02, 0.1):
        yield "table.index", f"{deg}°", {"errors": errors(0, index=np.array([deg, 0, 0, deg / 2]) * DEG)}
        yield "table.wobble", f"{deg}°", {"errors": errors(last, wobble=np.array([deg, -deg, 0, 0]) * DEG)}
        yield "table.rate_ripple", f"{deg}°", {"errors": errors(0, ripple=deg * DEG, ripple_cycles=9, ripple_phase=1.0)}
        yield "table.backlash", f"{deg}°", {"errors": errors(last, backlash=deg * DEG)}
    for deg in (0.05, 0.2):
        yield "table.tilt", f"{deg}°", {"errors": TableErrors(errors(0).axes, tilt=np.array([deg, -deg / 2, 0]) * DEG)}
        if axes > 1:
            own = table.axes[1].direction
            away = np.cross(np.cross(table.axes[0].direction, own), own)
            yield "table.nonorthogonal", f"{deg}°", {"errors": errors(1, skew=deg * DEG * away)}
    for deg in (0.2, 1.0):
        yield "table.lost_steps", f"{deg}°", {"lost": (LostSteps(11, 11 % axes, deg * DEG),)}
        yield "timing.dropped_samples", f"{deg}°", {"dropped": ((11, deg * DEG),)}
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
        hidden = any(id == injected and parts for (id, _), parts in selected.hidden.items())
        return "inseparable" if hidden else "nothing"
    return "named" if any(each.candidate.id == injected and not each.equivalent for each in own) else "one of several"


def drawn(table: Description, seed: int, **fields: object) -> Selected:
    """What is said of one session."""
    of = {"errors": TableErrors.none(table)} | fields
    return select(draw(Summary(table, fixed_moves(table, MOVES, RATE_RPS, seed), **of), seed), seed)  # type: ignore[arg-type]


def run_cases(count: int, first: int) -> None:
    """Print a row for each table, error and size."""
    total: Counter[str] = Counter()
    for name, directions in TABLES.items():
        table = table_of(directions)
        for injected, size, fields in cases(table):
            selected = [drawn(table, seed, **fields) for seed in range(first, first + count)]
            found = Counter("unexplained" if each.excess else outcome(injected, each) for each in selected)
            total += found
            print(f"| {name} | `{injected}` | {size} | {', '.join(f'{k} {what}' for what, k in found.most_common())} |", flush=True)
    print(f"{total.total()} sessions: {dict(total)}; wrong {100 * total['wrong'] / total.total():.1f} %")


def run_clean(count: int, first: int, kind: str, tables: list[Description], **fields: object) -> None:
    """Print how often clean tables, by turns, repeatable as declared or perfectly, have a p-value below 5 and 50 %, and a name."""
    for repeatability in (0.0, 1.0):
        said = [drawn(tables[k % len(tables)], k, repeatability=repeatability, **fields) for k in range(first, first + count)]
        shares = [f"{100 * np.mean([each.first_p < level for each in said]):.1f} %" for level in (0.05, 0.5)]
        named = Counter(error.candidate.id for each in said for error in each.named)
        print(f"| {kind} | {repeatability:g} | {count} | {shares[0]} | {shares[1]} | {dict(named)} |", flush=True)


def main() -> None:
    """Parse arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("clean", "stamps", "cases"))
    parser.add_argument("count", type=int, help="sessions of each kind")
    parser.add_argument("--first", type=int, default=0, help="seed of the first session")
    args = parser.parse_args()
    if args.what == "cases":
        run_cases(args.count, args.first)
    for name, directions in TABLES.items() if args.what == "clean" else ():
        run_clean(args.count, args.first, name, [table_of(directions)])
    for kind, stamps in STAMPS.items() if args.what == "stamps" else ():
        run_clean(args.count, args.first, kind, list(map(table_of, TABLES.values())), word=partial(stamped, stamps), block_s=0.07)


if __name__ == "__main__":
    main()
