"""How long all forms take to be screened, step by step, and how it grows with segments and forms.

    python benchmarks/discover_speed.py [--segments 20 40 120 500 1000] [--forms 5000 10000 20000 40000] [--looks 2]

Each session hides a law that no catalogue has, the root of the rate's cube.  Each runs in a fresh process of one thread; the times are its
CPU seconds, as in ``explain_speed.py``, and the memory is its largest, beside what the twin alone had taken.  Forms are drawn from the
grammar's and, where more are asked for, from further products of functions, with lags and without; sessions beyond
``spread.MOST_TURNS`` are screened by part of them.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
from common import markdown, progress
from explain_speed import exponent, peak_memory_mb

from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

#: of a quantity's largest size, and s: constants and lags of forms beyond the grammar's
SHARES, LAGS_S = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7), (None, 0.5, 5.0)
STEPS = ("screening", "chance and order", "forms that differ", "same as the best", "sharpening five", "learnable", "learnable from")


def distort(t_s, rate, force, temp_c):
    """A thousandth of it, of full scale."""
    return rate + 1e-3 * rate * np.sqrt(np.abs(rate) / 8.7)


def forms_of(largest: dict[str, float], count: int) -> list:
    """The grammar's, and products beyond it until there are so many."""
    from tinygc.annexes.discovery.enumeration import enumerated
    from tinygc.annexes.discovery.form import Factor, LawForm

    forms = list(enumerated(largest))
    names = [name for name, size in largest.items() if size > 0]
    plain = [Factor(name, function) for name in names for function in ("itself", "size")]
    functions = product(names, ("dead_zone", "beyond", "decay", "within"), SHARES, LAGS_S)
    more = [Factor(name, function, share * largest[name], lag_s) for name, function, share, lag_s in functions]
    generator = np.random.default_rng(0)
    while len(forms) < count:
        pair = plain[generator.integers(len(plain))], more[generator.integers(len(more))]
        forms += [LawForm(pair, pattern) for pattern in ("each", "full") if pattern == "each" or any(factor.vector for factor in pair)]
    order = generator.permutation(len(forms))[:count]
    return [forms[number] for number in order]


def timed(folder: Path, count: int, projections: int) -> dict:
    """Seconds by step, and MB, of screening one folder in this process."""
    from session.io.folder import read_session
    from tinygc.annexes.discovery.constants import refined
    from tinygc.annexes.discovery.detection_limits import learnable, learnable_from
    from tinygc.annexes.discovery.quantities import largest_of
    from tinygc.annexes.discovery.screening import screened
    from tinygc.closure.build import build_problem
    from tinygc.explanation.evidence import Evidence
    from tinygc.explanation.search import rewhitened
    from tinygc.noise.refit import Replay
    from tinygc.noise.twin import Twin

    evidence = Evidence(Twin(build_problem(read_session(folder))))
    nothing = evidence.nothing
    replay = Replay(evidence.twin, nothing.fit)
    forms = forms_of(largest_of(evidence.twin.movements), count)
    before_mb, seconds = peak_memory_mb(), {}

    def step(name: str, work: Callable):
        begun = time.process_time()
        found = work()
        seconds[name] = time.process_time() - begun
        return found

    whitens = [whiten for _, whiten in zip(range(projections), (nothing.whiten, evidence.first_whiten, nothing.whiten), strict=False)]
    seen = [(whiten, rewhitened(nothing, whiten)) for whiten in whitens]
    bits = np.full(len(forms), np.log2(len(forms)))
    screening = step("screening", lambda: screened(replay, forms, bits, seen, 1))
    best = step("chance and order", lambda: screening.chance.level(0.05) and forms[screening.order[0]])
    distinct = step("forms that differ", lambda: screening.distinct)
    step("same as the best", lambda: screening.same_as(best))
    every, last = screening.all_responses, screening.all_projections[-1]
    step("sharpening five", lambda: [refined(forms[number], every, last) for number in screening.order[:5]])
    step("learnable", lambda: learnable(screening, 0.01))
    step("learnable from", lambda: learnable_from(screening, best, np.full(best.size, 1e-3), 0.01))
    more_mb = peak_memory_mb() - before_mb
    return {"seconds": seconds, "memory_mb": more_mb, "distinct": distinct, "products": int(screening.sizes.sum()), "best": repr(best)}


def measured(segments: int, forms: int, projections: int) -> dict:
    """Simulate, and screen in a fresh process."""
    options = SimulationOptions(segments=segments, odr_hz=104.0, closure_s=0.0, warm_up_c=6.0, seed=1)
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        folder = write_session(options, Path(parent) / "session", distort=distort)
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, __file__, "--one", str(folder), "--forms", str(forms), "--looks", str(projections)]
        return json.loads(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)


def growth(title: str, sizes: list[int], results: list[dict]) -> str:
    """A row for each step, a column for each size, and the power that it grows with."""
    rows = []
    for name in (*STEPS, "total"):
        seconds = [sum(each["seconds"].values()) if name == "total" else each["seconds"][name] for each in results]
        power = f"{exponent(sizes, seconds):.2f}" if max(seconds) > 0.3 and len(sizes) > 2 else ""
        rows.append((name, *(f"{each:.2f}" for each in seconds), power))
    rows.append(("memory, MB", *(f"{each['memory_mb']:.0f}" for each in results), ""))
    rows.append(("coefficients of all forms", *(str(each["products"]) for each in results), ""))
    rows.append(("forms that differ", *(str(each["distinct"]) for each in results), ""))
    return markdown((title, *map(str, sizes), "∝ size^"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--segments", type=int, nargs="*", default=[20, 40, 120, 500, 1000])
    parser.add_argument("--forms", type=int, nargs="*", default=[5000, 10000, 20000, 40000])
    parser.add_argument("--looks", type=int, default=2, help="hypotheses beside which forms are looked for")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        print(json.dumps(timed(args.one, args.forms[0], args.projections)))
        return
    for title, sizes, pairs in (
        ("forms, 40 segments: CPU seconds", args.forms, [(40, forms) for forms in args.forms]),
        ("segments, 20000 forms: CPU seconds", args.segments, [(segments, 20000) for segments in args.segments]),
    ):
        results = []
        for segments, forms in pairs:
            progress(f"{segments} segments, {forms} forms")
            results.append(measured(segments, forms, args.projections))
        progress("")
        if results:
            print(growth(title, sizes, results), end="\n\n")


if __name__ == "__main__":
    main()
