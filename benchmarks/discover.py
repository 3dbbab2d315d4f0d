"""The search for equations, examined: what share of laws outside the catalogue is found, by strength, and how often a wrong one is stated.

    python benchmarks/discover.py [--cases 100] [--seed 13]
    python benchmarks/discover.py --scores FILE …     # of calibrate.py challenge --discover --json FILE, which takes the time

Laws by hand are written from physics, drawn ones come from a grammar that is wider than the search's.  What is found adds the rate of the
truth (correlation above 0.99 on the true movement, beyond a calibration); so do names of the catalogue where they are numerically equal.
Each share stands with its 95 % interval (Wilson).  The thresholds of ``tinygc/discovery/judge`` are set by this.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from common import markdown, progress
from scipy.stats import binomtest

from tinygc.annexes.challenge.cases import STRENGTHS
from tinygc.annexes.challenge.law_examination import SAME, WITH_LAW, examine_laws, to_json

RIGHT = ("found", "catalogue_equal")
DRAWN = "law.random"


def scores_of(cases: int, seed: int) -> list[dict]:
    """Of an examination that is run now."""
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        result = examine_laws(Path(parent) / "out", cases, seed, progress=lambda what, done, of: progress(f"{what} {done} of {of}"))
    progress("")
    return [each["score"] for each in to_json(result)["sessions"].values()]


def share(hits: Iterable[bool]) -> str:
    """Count, per cent and interval."""
    of = list(hits)
    if not of:
        return "–"
    low, high = binomtest(sum(of), len(of)).proportion_ci(method="wilson")
    return f"{sum(of)} of {len(of)}, {100 * sum(of) / len(of):.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def by_strength(scores: list[dict]) -> list[tuple[str, ...]]:
    """A row for each kind of law and strength."""
    rows = []
    kinds = (("by hand", lambda s: s["law"] != DRAWN), ("drawn", lambda s: s["law"] == DRAWN), ("all", lambda s: True))
    for kind, belongs in kinds:
        for strength in STRENGTHS:
            group = [s for s in scores if s["law"] and belongs(s) and s["strength"] == strength]
            if group:
                shares = (share(s["outcome"] in right for s in group) for right in (RIGHT, RIGHT[:1]))
                outcomes = (sum(s["outcome"] == outcome for s in group) for outcome in WITH_LAW)
                rows.append((f"{kind}, × {strength:g}", *shares, *map(str, outcomes)))
    return rows


def in_all(scores: list[dict]) -> list[tuple[str, str]]:
    """What holds over all sessions."""
    hidden = [s for s in scores if s["law"]]
    found = [s for s in scores if s["outcome"] == "found"]
    undecided = [s for s in hidden if s["outcome"] == "ambiguous"]
    gone = [s["removed"] for s in found if s["removed"] is not None]
    return [
        ("a law found, of sessions that hide one", share(s["outcome"] == "found" for s in hidden)),
        ("found, or names that are numerically equal", share(s["outcome"] in RIGHT for s in hidden)),
        ("a wrong equation stated as found, of sessions that hide a law", share(s["outcome"] == "wrong" for s in hidden)),
        ("a wrong or an invented one, of all sessions", share(s["outcome"] in ("wrong", "invented") for s in scores)),
        (
            "ambiguous, and a law on the list is numerically the truth, of those that are",
            share(s["listed"] is not None and s["listed"] > SAME for s in undecided),
        ),
        ("of what was stated as found", share(s["outcome"] != "found" for s in scores if s["outcome"] in ("found", "wrong", "invented"))),
        ("an equation where nothing is hidden", share(s["outcome"] != "silent" for s in scores if s["kind"] == "nothing")),
        (
            "an equation where a name of the catalogue is hidden",
            share(s["outcome"] != "silent" for s in scores if s["kind"] == "catalogue"),
        ),
        ("held-out excess removed where found: median, least", f"{100 * np.median(gone):.1f} %, {100 * min(gone):.1f} %" if gone else "–"),
        ("at least 95 % of it removed", share(each >= 0.95 for each in gone)),
        ("seconds of explain --discover: median, most", "{:.0f}, {:.0f}".format(*_seconds(scores))),
    ]


def _seconds(scores: list[dict]) -> tuple[float, float]:
    seconds = [s["seconds"] for s in scores if s["seconds"] is not None]
    return float(np.median(seconds)), max(seconds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=13)
    parser.add_argument("--scores", type=Path, nargs="+", help="JSON of examinations that were run before")
    args = parser.parse_args()
    if args.scores is None:
        scores = scores_of(args.cases, args.seed)
    else:
        said = [json.loads(file.read_text(encoding="utf-8")) for file in args.scores]
        scores = [each["score"] for one in said for each in one["sessions"].values()]
    print(markdown(("laws", "found or equal", "found alone", *(outcome.replace("_", " ") for outcome in WITH_LAW)), by_strength(scores)))
    print()
    print(markdown(("in all", ""), in_all(scores)))


if __name__ == "__main__":
    main()
