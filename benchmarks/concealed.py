"""Explain every recording of a folder whose truth is known, and score what was said.

    python benchmarks/concealed.py DIR [--cases case001 …]

DIR holds session folders and truth.json (name -> effects, strength).  Prints a row a recording and the totals; the truth is opened
only after the recordings have been explained.
"""

from __future__ import annotations

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np


def explain(folder: Path) -> dict:
    """The explanation's JSON, with the seconds it took."""
    from tinygc.explanation.engine import explain_session
    from tinygc.explanation.result import to_json

    began = time.perf_counter()
    result = to_json(explain_session(folder))
    return result | {"seconds": time.perf_counter() - began}


def agrees(effect: dict, truth: dict) -> tuple[int, int]:
    """How many of an effect's parameter values are within 3 reported sigmas or 10 % of the truth, and how many there are.

    10 % of the vector: of its largest component.  Lists of times, rows or stills count once: at least 80 % found, none invented.
    """
    good = total = 0
    for name, value in effect["parameters"].items():
        if name not in truth:
            continue
        true, std = truth[name], effect["std"].get(name, 0)
        if name in ("at_s", "at", "stills") and isinstance(value, list):
            near = [min((abs(v - t) for v in value), default=np.inf) <= (0.5 if name == "at_s" else 4) for t in true]
            good, total = good + (np.mean(near) >= 0.8 and len(value) <= 1.2 * len(true)), total + 1
            continue
        value, true = np.ravel(value).astype(float), np.ravel(true).astype(float)
        close = np.abs(value - true) <= np.maximum(3 * np.ravel(std), 0.1 * np.abs(true).max())
        good, total = good + int(close.sum()), total + close.size
    return good, total


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", nargs="*", help="only these")
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args()
    cases = args.cases or sorted(path.name for path in args.folder.iterdir() if (path / "session.toml").exists())
    with ProcessPoolExecutor(args.processes) as pool:
        results = dict(zip(cases, pool.map(explain, [args.folder / case for case in cases]), strict=True))
    truth = json.loads((args.folder / "truth.json").read_text())
    print("| recording | concealed (strength) | verdict | named | parameters | held out: before, after, floor (°) | excess gone | s |")
    print("|---|---|---|---|---|---|---|---|")
    exact = wrong = cases_good = cases_named = 0
    ratios, removed = [], []
    for case in cases:
        result, effects = results[case], truth[case]["effects"]
        named = {effect["id"]: effect for effect in result["effects"]}
        right = set(named) & set(effects)
        exact += set(named) == set(effects)
        wrong += len(set(named) - set(effects))
        scores = [agrees(named[name], effects[name]) for name in right]
        good, total = (sum(column) for column in zip(*scores, strict=True)) if scores else (0, 0)
        held = result["fit"]["holdout_closure_rms_deg"]
        if right:
            cases_named += 1
            cases_good += good == total
            ratios.append(held["after"] / held["floor"])
            if result["fit"]["excess_removed"] is not None:
                removed.append(result["fit"]["excess_removed"])
        gone = "" if result["fit"]["excess_removed"] is None or not named else f"{100 * result['fit']['excess_removed']:.1f} %"
        cells = [
            case,
            f"{', '.join(effects) or 'nothing'} ({truth[case]['strength']:g})",
            result["verdict"],
            ", ".join(named) or "–",
            f"{good}/{total}",
            f"{held['before']:.4f}, {held['after']:.4f}, {held['floor']:.4f}",
            gone,
            f"{result['seconds']:.1f}",
        ]
        print("| " + " | ".join(cells) + " |")
    print(
        f"\n{exact} of {len(cases)} recordings named exactly, {wrong} wrong names; "
        f"all parameters right in {cases_good} of {cases_named} named; "
        f"held-out closure after / floor: median {np.median(ratios):.2f}; excess gone: median {100 * np.median(removed):.1f} %"
    )


if __name__ == "__main__":
    main()
