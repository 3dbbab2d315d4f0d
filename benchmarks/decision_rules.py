"""Are decisions wrong as often as they say?  Limits near the truth, of closures and sensor errors.

``closures``: rms tilts of many sets of segments about a truth that is known: how often a stated U holds it, and how often a set at its
limit passes by a guard band of U.  ``runs``: closure runs of known noise whose true errors are drawn: how often the stated probability of
conformity is right, near the floor and far from it.  ``sessions``: simulated sessions whose sensor errors are known, against limits laid
at random about the truth: whether values that state a probability of conformity p conform in that share.
"""

from __future__ import annotations

import argparse
from itertools import pairwise

import numpy as np
from common import in_parallel, markdown, simulated
from scipy import stats

from session.log.requirements import GUARDED, Rule
from tinygc.estimation.options import FitOptions
from tinygc.fitting.fit import fit_session
from tinygc.inference.decide import Conformity, conforms_probability
from tinygc.models.linear import LinearModel, field_facts, field_vector
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session
from tinygc.verdict.requirements import closure_measured, run_measured, sensor_measured

#: of segments in a set
COUNTS = (7, 13, 40, 100)
SETS = 2000
#: limits in sigmas about the truth, for each sensor error of each session
LIMITS = 20
FARTHEST = 4.0
BANDS = (0.0, 0.025, 0.16, 0.5, 0.84, 0.975, 1.0)
OPTIONS = FitOptions(methods=("raw", "raw_bias_removed", "least_squares"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=("closures", "runs", "sessions"))
    parser.add_argument("--sessions", type=int, default=60, help="(%(default)s)")
    args = parser.parse_args()
    {"closures": closures, "runs": runs, "sessions": sessions}[args.part](args)


# Closures of known truth


def draws(kind: str, count: int, rng: np.random.Generator) -> np.ndarray:
    """(S, 2) tilts of rms 1: independent, of stills that neighbours share, or with Student's tails."""
    if kind == "shared stills":
        ends = rng.normal(size=(count + 1, 2)) / 2
        return np.diff(ends, axis=0)
    if kind == "Student's t, 5":
        return stats.t(5).rvs((count, 2), random_state=rng) / np.sqrt(5 / 3 * 2)
    return rng.normal(size=(count, 2)) / np.sqrt(2)


def closures(args: argparse.Namespace) -> None:
    rows = []
    for kind in ("independent", "shared stills", "Student's t, 5"):
        for count in COUNTS:
            rng = np.random.default_rng(count)
            found = [closure_measured(draws(kind, count, rng), range(count)) for _ in range(SETS)]
            truth = np.degrees(1.0)
            holds = np.mean([abs(np.log(each.value / truth)) <= each.expanded / each.value for each in found])
            answers = [Conformity(each, (-np.inf, truth), Rule(GUARDED)).answer for each in found]
            rows.append([kind, str(count), *(f"{100 * share:.1f} %" for share in (holds, *_shares(answers)))])
    print(f"{SETS} sets of segments each. At the limit: the true rms is the limit, guard band w = U.\n")
    print(markdown(["tilts", "segments", "truth within U", "at the limit: PASS", "FAIL", "not decided"], rows))


def _shares(answers: list[str]) -> list[float]:
    return [answers.count(answer) / len(answers) for answer in ("pass", "fail", "not decided")]


# Closure runs of known truth

#: floors across which true errors are drawn, all alike: the rule presumes nothing of them
SPREAD = 20.0
RUNS, OF_EACH = 6_000_000, 2000


def runs(args: argparse.Namespace) -> None:
    rng = np.random.default_rng(1)
    floor = np.radians([0.02, 0.03, 0.04])
    size = float(np.sqrt(np.mean(floor**2)))
    drawn = SPREAD * size * rng.uniform(-1, 1, (RUNS, 3))
    measured = drawn + floor * rng.normal(size=drawn.shape)
    sizes = np.sqrt(np.mean(measured**2, axis=1)) / size
    rows = []
    for low, high in pairwise((0.0, 1.0, 2.0, 4.0, 8.0)):
        at = np.flatnonzero((sizes >= low) & (sizes < high))[:OF_EACH]
        stated, true = [], []
        for number in at:
            found = run_measured("run", measured[number], floor)
            limit = max(1e-3, found.value + float(rng.uniform(-2, 2)) * found.sigma)
            stated.append(Conformity(found, (-np.inf, limit), Rule()).probability)
            true.append(np.degrees(np.sqrt(np.mean(drawn[number] ** 2))) <= limit)
        p, conforms = np.array(stated), np.array(true)
        for least, most in pairwise(BANDS):
            inside = (p >= least) & (p < most if most < 1 else p <= 1)
            if inside.sum() >= 30:
                words = [f"{low:g} to {high:g}", f"{least:g} to {most:g}", f"{inside.sum()}"]
                rows.append([*words, f"{p[inside].mean():.3f}", f"{conforms[inside].mean():.3f}"])
    print(markdown(["measured RMSE, floors", "probability of conformity", "statements", "stated, mean", "conform in truth"], rows))


# Sensor errors of known truth


def sessions(args: argparse.Namespace) -> None:
    pairs = [pair for found in in_parallel(_session, range(args.sessions), "session") for pair in found]
    p, conforms = np.array(pairs).T
    rows = []
    for low, high in pairwise(BANDS):
        inside = (p >= low) & (p < high if high < 1 else p <= 1)
        rows.append([f"{low:g} to {high:g}", f"{inside.sum()}", f"{p[inside].mean():.3f}", f"{conforms[inside].mean():.3f}"])
    print(f"{args.sessions} sessions of 40 turns, 18 sensor errors each, {LIMITS} limits each.\n")
    print(markdown(["probability of conformity", "statements", "stated, mean", "conform in truth"], rows))


def _session(seed: int) -> list[tuple[float, bool]]:
    options, rng = SimulationOptions(seed=9000 + seed, segments=40, closure_s=0.0), np.random.default_rng(seed)
    unit = simulate_session(SimulationOptions(seed=9000 + seed, segments=1, closure_s=0.0)).unit
    with simulated(options) as folder:
        fit = fit_session(folder, OPTIONS)
    linear = fit.linear.model
    assert isinstance(linear, LinearModel)
    truth = field_vector(LinearModel(unit.E, unit.B).vector)
    found = []
    for number, each in enumerate(sensor_measured("gyro", field_facts(linear.vector, fit.covariance, sources=fit.sources))):
        true = truth[number] * (each.value / field_vector(linear.vector)[number])
        for limit in true + each.sigma * rng.uniform(-FARTHEST, FARTHEST, LIMITS):
            found.append((conforms_probability(each.value, each.sigma, (-np.inf, limit), each.freedom), bool(true <= limit)))
    return found


if __name__ == "__main__":
    main()
