"""Whether the screening of all forms is calibrated: its chance level on simulated sessions that hide nothing.

    python benchmarks/discover_nulls.py [--sessions 16] [--segments 40]

Each is screened beside no name at all, with the noise as it is known beforehand and as it is estimated.  The p-values of the best form
should be uniform, or larger: what the noise's components have taken up chance cannot take.  Without ``signals.moving_rate`` the noise of
the rate at rest, which is in the columns as well as in the residuals, makes half of them smaller than 1e-6.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from common import markdown, progress
from scipy import stats

from session.io.folder import read_session
from tinygc.annexes.discovery.enumeration import bits, enumerated
from tinygc.annexes.discovery.quantities import largest_of
from tinygc.annexes.discovery.screening import screened
from tinygc.annexes.discovery.words import equation
from tinygc.closure.build import build_problem
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.search import rewhitened
from tinygc.noise.refit import Replay
from tinygc.noise.twin import Twin
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

SEED = 100


def best_of(options: SimulationOptions) -> tuple[float, float, str]:
    """p-value and studentised promise of the best form, and its equation."""
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        evidence = Evidence(Twin(build_problem(read_session(write_session(options, Path(parent) / "session")))))
    have = evidence.nothing
    forms = enumerated(largest_of(evidence.twin.movements))
    projections = [(whiten, rewhitened(have, whiten)) for whiten in (evidence.first_whiten, have.whiten)]
    screening = screened(Replay(evidence.twin, have.fit), forms, np.array([bits(form) for form in forms]), projections, options.seed)
    best = int(np.argmax(screening.tested))
    return screening.chance_p(screening.tested[best]), float(screening.tested[best]), equation(forms[best])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=16)
    parser.add_argument("--segments", type=int, default=40)
    args = parser.parse_args()
    rows = []
    for seed in range(SEED, SEED + args.sessions):
        progress(f"session {seed - SEED + 1} of {args.sessions}")
        options = SimulationOptions(segments=args.segments, odr_hz=104.0, closure_s=0.0, warm_up_c=6.0, seed=seed, bias_instability_dph=3.0)
        rows.append(best_of(options))
    progress("")
    print(markdown(("p", "promise", "best form"), [(f"{p:.2g}", f"{promise:.1f}", form) for p, promise, form in sorted(rows)]))
    p = np.array([row[0] for row in rows])
    smaller = stats.kstest(p, "uniform", alternative="greater").pvalue
    print(f"\nsmaller than 5 %: {np.sum(p < 0.05)} of {len(p)}; smaller than uniform ones would be: p = {smaller:.2g}")


if __name__ == "__main__":
    main()
