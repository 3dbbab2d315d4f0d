"""What a looser tie of TinyGC-Net promises with its first step, against what it gives once settled: sets ``PROMISE`` in network.py.

Simulated sessions of 40 turns with what ``asymmetry.py`` conceals, and less.  Gains are over the linear solution, of the left-out errors of
the segments in pairs, in standard errors; "promised" is the most that any tie's first step does, "given" the most that one gives.  "Bends"
is how often the net of all ties does, and how often the tool's, which settles only ties that promise ``PROMISE``; "same" how often both
choose the same tie.
"""

from __future__ import annotations

import argparse

import numpy as np
from asymmetry import CASES, Case
from common import in_parallel, markdown, simulated

from session.io.folder import read_session
from tinygc.closure.build import build_problem
from tinygc.estimation import network
from tinygc.models.nets import CalibrationNet
from tinygc.simulation.options import SimulationOptions

SMALLER = (Case("asymmetry ±0.1 %", asymmetry=0.001), Case("cubic 0.3 %", cubic=0.003))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=4, help="simulated sessions of each case (%(default)s)")
    parser.add_argument("--seed", type=int, default=7000, help="of the first session (%(default)s)")
    args = parser.parse_args()
    cases = [*CASES, *SMALLER]
    jobs = [(case, args.seed + i) for case in cases for i in range(args.sessions)]
    results = in_parallel(one_session, jobs, "session")
    rows = []
    for number, case in enumerate(cases):
        promised, given, all_ties, tool = np.array(results[number * args.sessions : (number + 1) * args.sessions]).T
        spans = (f"{values.min():.1f} to {values.max():.1f}" for values in (promised, given))
        rows.append([case.words, *spans, f"{sum(all_ties > 0)}, {sum(tool > 0)}", f"{sum(all_ties == tool)} of {len(tool)}"])
    print(markdown(["concealed", "promised", "given", "bends", "same"], rows))


def one_session(job: tuple[Case, int]) -> tuple[float, float, float, float]:
    """Gain promised, gain given, the tie chosen of all, and by the tool."""
    case, seed = job
    options = SimulationOptions(seed=seed, segments=40, closure_s=0.0, gyro_misalignment=case.misalignment)
    with simulated(options, distort=case.distort) as folder:
        problem = build_problem(read_session(folder))
    batch, sigma = problem.batch, problem.floor.sigma
    return (*_all_ties(batch, sigma), network.train_second_order(batch, sigma).tie)


def _all_ties(batch, sigma) -> tuple[float, float, float]:
    """Gains in standard errors, and the tie that is chosen where each is settled."""
    rows = network._Problem(batch, sigma, None)
    (_, prior), *rungs = CalibrationNet.identity().rungs(rows.typical_rps)
    vector, r, unbent, _ = rows.settle(rows.identity, prior)
    linear, lowest, chosen, promised, given = rows.linear(vector, r), unbent, 0.0, [], []
    for tie, prior in rungs:
        vector, _, left_out, _ = rows.settle(vector, prior)
        promised.append(_gain(linear.left_out(prior), unbent))
        given.append(_gain(left_out, unbent))
        if network._less(left_out, lowest, network.BELIEF):
            chosen, lowest = tie, left_out
    return max(promised), max(given), chosen


def _gain(trial: np.ndarray, best: np.ndarray) -> float:
    gain = best - trial
    return float(gain.mean() / (gain.std(ddof=1) / np.sqrt(len(gain))))


if __name__ == "__main__":
    main()
