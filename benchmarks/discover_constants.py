"""A law's constant, put in and recovered over many sessions: how far it is from the truth in sigmas, as screened and as refitted.

    python benchmarks/discover_constants.py [--seeds 40]

Of each law the session's true form is given with a constant that is a third off.  "sharpened": by its linear columns alone
(``screen.sharpen``); "refitted": with all else (``judge.exact``).  68 % are within one sigma where the uncertainty is true.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial

import numpy as np
from common import in_parallel, markdown, simulated

from session.io.folder import read_session
from session.io.units import DEG
from tinygc.annexes.discovery.constants import gain_of, refined
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.projections import Projection
from tinygc.annexes.discovery.responses import Responses
from tinygc.annexes.discovery.selection import Constants, FormEvidence, exact
from tinygc.closure.build import build_problem
from tinygc.explanation.search import rewhitened
from tinygc.noise.refit import Replay
from tinygc.noise.twin import Twin
from tinygc.simulation.options import SimulationOptions

FS_RPS = 500 * DEG
SIZE_RPS = np.array([0.3, -0.25, 0.3]) * DEG
#: name -> what is added of the rate as a share of full scale, the form, the true constant
LAWS = {
    "soft limit": (lambda u: np.tanh(u / 0.08), Factor("rate", "soft", 0.11), 0.08),
    "soft limit, five times": (lambda u: 5 * np.tanh(u / 0.08), Factor("rate", "soft", 0.11), 0.08),
    "excess": (lambda u: 16 * np.maximum(np.abs(u) - 0.1, 0), Factor("rate", "excess", 0.13), 0.1),
    "excess, five times": (lambda u: 80 * np.maximum(np.abs(u) - 0.1, 0), Factor("rate", "excess", 0.13), 0.1),
    "within": (lambda u: 8 * np.clip(u, -0.05, 0.05), Factor("rate", "within", 0.07), 0.05),
}
#: the curvature is computed where the gain has fallen by one (one sigma): tolerance, and steps towards it
FALLEN, STEPS = (0.3, 3.0), 5
#: ln of a constant: the first step, and the range of accepted steps
FIRST_STEP, LEAST_STEP, MOST_STEP = 0.02, 1e-5, 1.0


def hidden(t_s, rate, force, temp_c, law: str):
    return rate + SIZE_RPS * LAWS[law][0](rate / FS_RPS)


def recovered(job: tuple[str, int]) -> tuple[float, ...]:
    """Of one law and seed: sigmas from the truth, and sigma as a share of it, sharpened and refitted."""
    name, seed = job
    _, factor, true = LAWS[name]
    options = SimulationOptions(segments=24, closure_s=0.0, seed=seed, odr_hz=104.0)
    with simulated(options, partial(hidden, law=name)) as folder:
        evidence = FormEvidence(Twin(build_problem(read_session(folder))))
    law = evidence.effect_of(LawForm((factor,)))
    have = evidence.of((law,), evidence.nothing)
    fit = rewhitened(evidence.nothing, have.whiten)
    responses = Responses(Replay(evidence.twin, fit))
    projection = Projection(evidence.twin, have.whiten, fit)
    sharp = refined(LawForm((factor,)), responses, projection)
    have, own = exact(evidence, have, law)
    form = evidence.forms[own.id]
    (constant,), (sigma,) = form.constants, Constants.of(evidence.twin, have, own, form).sigmas(form)
    (linear,) = sharp.constants

    def gain(logs: np.ndarray) -> float:
        return gain_of(responses.columns(sharp.with_constants(np.exp(logs))), projection)

    (linear_sigma,) = linear * _sigmas(gain, np.log([linear]))
    return (linear - true) / linear_sigma, linear_sigma / true, (constant - true) / sigma, sigma / true


def _sigmas(gain: Callable[[np.ndarray], float], at: np.ndarray) -> np.ndarray:
    """(constants,) ln: one sigma of each, where chi-square has risen by one, from the local curvature."""
    top, count = gain(at), len(at)
    steps = np.array([_step(gain, at, top, unit) for unit in np.eye(count)])
    moves = np.diag(steps)
    fallen = np.zeros((count, count))
    for i in range(count):
        fallen[i, i] = 2 * top - gain(at + moves[i]) - gain(at - moves[i])
        for j in range(i):
            corners = (gain(at + a * moves[i] + b * moves[j]) * a * b for a in (1, -1) for b in (1, -1))
            fallen[i, j] = fallen[j, i] = -sum(corners) / 4
    # In steps, chi-square rises by x' fallen x / 2.
    if np.linalg.eigvalsh(fallen)[0] <= 0:
        return np.full(count, np.inf)
    return np.sqrt(2 * np.diag(np.linalg.inv(fallen))) * steps


def _step(gain: Callable[[np.ndarray], float], at: np.ndarray, top: float, unit: np.ndarray) -> float:
    """Distance along one constant at which the gain has fallen by about one."""
    step = FIRST_STEP
    for _ in range(STEPS):
        fallen = top - (gain(at + step * unit) + gain(at - step * unit)) / 2
        if FALLEN[0] < fallen < FALLEN[1]:
            break
        step = float(np.clip(step / np.sqrt(max(fallen, 1e-2)), LEAST_STEP, MOST_STEP))
    return step


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    args = parser.parse_args()
    jobs = [(name, 100 + seed) for name in LAWS for seed in range(args.seeds)]
    found = np.array(in_parallel(recovered, jobs, "sessions")).reshape(len(LAWS), args.seeds, 4)
    rows = []
    for name, own in zip(LAWS, found, strict=True):
        for how, z, share in (("sharpened", own[:, 0], own[:, 1]), ("refitted", own[:, 2], own[:, 3])):
            within = f"{100 * np.mean(np.abs(z) < 1):.0f} %"
            rows.append((f"{name}, {how}", within, f"{z.mean():+.2f}", f"{np.sqrt(np.mean(z**2)):.2f}", f"{100 * np.median(share):.2g} %"))
    print(markdown(("constant", "within one sigma", "mean, sigmas", "rms, sigmas", "sigma, of the constant"), rows))


if __name__ == "__main__":
    main()
