"""What becomes of a session that is damaged: refused, warned of, or certified; and is its calibration right?

    python benchmarks/damaged_sessions.py [--seeds 8] [--family "one rate 5 ms late" …] [--processes 2]

A simulated session, whose truth is known, is damaged in one way (``FAMILIES``) and written as a folder; then ``check`` and ``fit`` (least
squares) look at it.  Each case ends as one of ``OUTCOMES``.  *Warned*: anything but a plain pass of check and fit.  *Wrong*: one of the
twelve numbers of the gyroscope is more than 3 of the stated sigmas from the truth.  Where the damage changes the sensor itself, the truth
is the mean over the session; where it mixes or scales columns, it is what is right for the rows as they are written.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from common import in_parallel, markdown
from damaged_families import FAMILIES, damaged, write

from session.base.errors import CalibrationError
from tinygc.inference.choose import MISMATCH_P
from tinygc.models.linear import NAMES

WRONG = 3.0  #: sigmas
REFUSED, CRASHED = "refused", "crashed"
OUTCOMES = (REFUSED, "warned, right", "silent, right", "warned, wrong", "silent, wrong", CRASHED)


# What the tool says of it.


def doubts_of(result) -> list[str]:
    """What a fit says against itself, in short: its verdict, misfit, and what it noticed."""
    answer = result.verdict().answer
    found = [] if answer == "pass" else [answer]
    if result.goodness.p_value < MISMATCH_P or result.widened > 1:
        found.append("misfit")
    if result.noise is not None and result.noise.noise.unusual:
        found.append("noise")
    return found + [f"fit: {each.what}" for each in result.warnings if each.level == "warning"]


def one_case(job: tuple[str, int]) -> dict:
    """Outcome, what was said, errors over stated and over combined sigmas (12,), of a family and a seed."""
    from tinygc import check, fit

    name, seed = job
    r = damaged(name, seed)
    case: dict = {"family": name, "seed": seed, "z": None, "z_combined": None}
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        folder = Path(parent) / "damaged"
        folder.mkdir()
        write(r, folder)
        try:
            findings = check(folder)
            errors = [f"{each.what}: {each.description}" for each in findings if each.level == "error"]
            if errors:
                return case | {"end": REFUSED, "said": ["check: " + errors[0]]}
            result = fit(folder, methods=("least_squares",)).result
        except CalibrationError as error:
            return case | {"end": REFUSED, "said": ["fit: " + str(error).replace(f"{folder}: ", "")]}
        except Exception as error:  # a traceback is a finding of its own
            return case | {"end": CRASHED, "said": [f"{type(error).__name__}: {error}"]}
    said = [f"check: {each.what}" for each in findings if each.level == "warning"]
    said = list(dict.fromkeys(said + [each for each in doubts_of(result) if each.replace("fit:", "check:") not in said]))
    error = result.linear.model.vector - np.concatenate([r.E.ravel(), r.B])
    systematic = np.zeros(12) if result.allowed is None else result.allowed.sigma
    stated, combined = np.sqrt(np.diag(result.covariance)), np.sqrt(np.diag(result.covariance) + systematic**2)
    case |= {"z": error / stated, "z_combined": error / combined}
    return case | {"end": "warned" if said else "silent", "said": said}


def outcome(case: dict) -> str:
    """One of ``OUTCOMES``."""
    z = case["z"]
    return case["end"] if z is None else f"{case['end']}, {'right' if np.abs(z).max() <= WRONG else 'wrong'}"


# The table.


def row_of(name: str, cases: Sequence[dict]) -> list[str]:
    """One line of the table: outcomes, the largest error in stated and in combined sigmas, which number it is, what was said most."""
    counts = Counter(outcome(case) for case in cases)
    fitted = [case for case in cases if case["z"] is not None]
    silent = [case for case in fitted if case["end"] == "silent"]
    worst = max(fitted, key=lambda case: np.abs(case["z"]).max(), default=None)
    number = "" if worst is None else NAMES[int(np.argmax(np.abs(worst["z"])))]
    said = Counter(": ".join(words.split(": ")[:2]) for case in cases for words in case["said"])
    return [
        name,
        *(str(counts[outcome] or "") for outcome in OUTCOMES),
        largest(fitted, "z") + (f" {number}" if number else ""),
        largest(silent, "z"),
        largest(fitted, "z_combined"),
        "; ".join(f"{words[:60]} {times}" for words, times in said.most_common(3)).replace("|", "/"),
    ]


def largest(cases: Sequence[dict], key: str) -> str:
    """The largest error over the sigmas of a kind."""
    values = [np.abs(case[key]).max() for case in cases if case[key] is not None]
    return f"{max(values):.1f}" if values else ""


def share(cases: Sequence[dict], key: str, bar: float) -> str:
    """Of all numbers of all cases, how many are within so many sigmas."""
    z = np.abs([case[key] for case in cases if case[key] is not None])
    return f"{np.mean(z < bar):.1%}" if z.size else "–"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=8, help="sessions of each family (%(default)s)")
    seeds = "seed of the first (%(default)s); undamaged, none of 10 to 39 is wrong by chance"
    parser.add_argument("--first", type=int, default=10, metavar="SEED", help=seeds)
    parser.add_argument("--family", nargs="+", default=list(FAMILIES), choices=list(FAMILIES), metavar="NAME", help="only these")
    parser.add_argument("--processes", type=int, default=2, help="(%(default)s)")
    args = parser.parse_args()
    jobs = [(name, seed) for seed in range(args.first, args.first + args.seeds) for name in args.family]
    cases = in_parallel(one_case, jobs, "case", args.processes)
    header = ["family", *OUTCOMES, "largest error/σ", "of silent ones", "in combined σ", "said most"]
    print(markdown(header, [row_of(name, [case for case in cases if case["family"] == name]) for name in args.family]))
    clean, others = ([case for case in cases if (case["family"] == "clean") == which] for which in (True, False))
    rows = []
    for title, group in (("clean", clean), ("damaged", others)):
        counts = Counter(outcome(case) for case in group)
        shares = (share(group, key, bar) for key in ("z", "z_combined") for bar in (1, 2))
        rows.append([f"{len(group)} {title}", *(counts[name] for name in OUTCOMES), *shares])
    print("\n" + markdown(["sessions", *OUTCOMES, "1 stated σ", "2 stated σ", "1 combined σ", "2 combined σ"], rows))


if __name__ == "__main__":
    main()
