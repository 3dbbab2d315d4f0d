"""What hangs on each threshold for what the registers show: right and wrong names and false alarms at half, at once, at double its value.

    python benchmarks/thresholds.py [--only NAME …]

Registers and stills of sessions that hide what is found there, or nothing.  A share above a half is halved and doubled in its distance
from 1, a whole number rounded.  A constant that moves nothing is not critical in these sessions; others may need it.
"""

from __future__ import annotations

import argparse
import importlib
import tempfile
from pathlib import Path

import numpy as np
from common import in_parallel, markdown

from session.base.errors import CalibrationError
from session.log.folder import read_session
from tinygc.closure.build import build_problem
from tinygc.explanation.data_repair import repair
from tinygc.features.challenge.examination import conceal
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_files

#: module -> its constants
WATCHED = {
    "tinygc.explanation.clipped_turns": "FEWEST_WHOLE LEVEL_KNOWN PLATEAU_EXCESS CEILING_EXCESS OUTLIER_SIGMAS VERTICAL CORNER "
    "LEAST_CEILING FLAT NOISES FEWEST SAME SHORTEST_S LEAST WHOLE ALIKE",
    "tinygc.explanation.data_repair": "LONGEST_LOSS_S CERTAIN PASSES OPEN KEPT",
    "tinygc.explanation.faulty_readings": "JUMP SPIKE FLANK NEIGHBOURHOOD_S NEIGHBOURHOOD START_S ALONE LOSS_IN_ACCEL PER_SECOND "
    "LONGEST SIDE BEYOND CAME_BACK SHARE NOISE_MISSES LEAST_NOISE_LSB",
    "session.detect.bridging": "SIDE AS_FAST FEWEST_TRIALS MOST_TRIALS",
}
NEAR_ONE = 0.55
KINDS = ("gyro.saturation", "timing.dropped_samples", "data.glitches", "reference.not_still")
Change = tuple[str, str, float]
Case = tuple[dict[str, float], SimulationOptions]  # strength of each effect that a session hides


def scaled(value, factor: float):
    """Half or double of it."""
    if isinstance(value, int):
        return max(1, round(value * factor))
    return 1 - (1 - value) / factor if NEAR_ONE <= value < 1 else value * factor


class Changed:
    """One constant at another value, wherever it has been imported to."""

    def __init__(self, module: str, name: str, factor: float):
        own = importlib.import_module(module)
        self.name, self.old, self.new = name, getattr(own, name), scaled(getattr(own, name), factor)
        others = [importlib.import_module(other) for other, names in WATCHED.items() if name not in names.split()]
        self.places = [own, *(other for other in others if hasattr(other, name))]

    def __enter__(self):
        for place in self.places:
            setattr(place, self.name, self.new)

    def __exit__(self, *_):
        for place in self.places:
            setattr(place, self.name, self.old)


def settings(only: list[str] | None) -> list[Change]:
    """module, constant, factor."""
    watched = [(module, name) for module, names in WATCHED.items() for name in names.split() if not only or name in only]
    return [(module, name, factor) for module, name in watched for factor in (0.5, 2.0)]


def cases() -> list[Case]:
    """Sessions that hide nothing, and each kind at four strengths."""
    hidden = [({kind: strength}, 100 + 10 * i + j) for i, kind in enumerate(KINDS) for j, strength in enumerate((1.0, 0.5, 0.2, 0.05))]
    sessions = [*(({}, seed) for seed in range(8)), *hidden]
    usual = {"closure_s": 0.0, "segments": 24, "odr_hz": 104.0, "warm_up_c": 2.0}
    return [(strengths, SimulationOptions(seed=seed, **usual)) for strengths, seed in sessions]


def looked_at(job: tuple[Case, list[Change]]) -> dict:
    """(right names, wrong names, alarm) of one session at every setting; None: as it is."""
    (strengths, options), changes = job
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        simulation, toml, _ = conceal(strengths, options, np.random.default_rng(options.seed))
        write_files(simulation, Path(parent) / "session", toml)
        problem = build_problem(read_session(Path(parent) / "session"))
        found = {None: judged(problem, set(strengths))}
        for change in changes:
            with Changed(*change):
                found[change] = judged(problem, set(strengths))
    return {"hidden": len(strengths), "found": found}


def judged(problem, hidden: set[str]) -> tuple[int, int, bool]:
    try:
        names = set(repair(problem).found)
    except (CalibrationError, np.linalg.LinAlgError, ValueError):
        return 0, 0, True
    return len(names & hidden), len(names - hidden), bool(names)


def table(results: list[dict], changes: list[Change]) -> str:
    """A row a constant: its value, and right of hidden, wrong, alarms where nothing is hidden, at half, at once, at double."""
    hidden, quiet = sum(r["hidden"] for r in results), [r for r in results if not r["hidden"]]

    def cell(change: Change | None) -> str:
        right, wrong = (sum(r["found"][change][i] for r in results) for i in (0, 1))
        return f"{right}, {wrong}, {sum(r['found'][change][2] for r in quiet)}"

    rows = []
    for module, name, factor in changes:
        if factor == 0.5:
            value = getattr(importlib.import_module(module), name)
            label = f"{module.rsplit('.', 1)[1]}.{name}"
            rows.append((label, f"{value:.4g}", cell((module, name, 0.5)), cell(None), cell((module, name, 2.0))))
    head = f"right of {hidden}, wrong, alarms of {len(quiet)} without a name"
    return markdown((head, "value", "half", "as it is", "double"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", metavar="NAME", help="these constants")
    args = parser.parse_args()
    changes = settings(args.only)
    print(table(in_parallel(looked_at, [(case, changes) for case in cases()], "session"), changes))


if __name__ == "__main__":
    main()
