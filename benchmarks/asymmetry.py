"""What TinyGC-Net takes up of a concealed scale-factor asymmetry and of a cubic: held out, against least squares.

Simulated sessions of 80 turns; every second one is fitted, the others are judged.  On every axis the sensor feels + and - rates with
sensitivities that differ by +-0.3 %, or bends by a cubic (a share of full scale at full scale), or both.  "taken up" is the share of
least squares' excess over the noise floor, as a variance, that is gone.  The last rows are of a sensor whose axes are aligned.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from closure_table import rms
from common import in_parallel, markdown, simulated

from session.io.folder import read_session
from session.io.units import DEG
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import closure_angles
from tinygc.estimation.network import train_second_order
from tinygc.models.linear import bias_only
from tinygc.simulation.options import SimulationOptions

FS_RPS = 500 * DEG


@dataclass(frozen=True)
class Case:
    """What is concealed: half the difference of the sensitivities, the cubic at full scale; misalignment rad of the axes."""

    words: str
    asymmetry: float = 0.0
    cubic: float = 0.0
    misalignment: float = 0.005

    def distort(self, t_s, rate, force, temp_c):
        return rate + self.asymmetry * np.abs(rate) + self.cubic * FS_RPS * (rate / FS_RPS) ** 3


CASES = (
    Case("nothing"),
    Case("asymmetry ±0.3 %", asymmetry=0.003),
    Case("cubic 0.1 %", cubic=0.001),
    Case("cubic 1 %", cubic=0.01),
    Case("asymmetry ±0.3 %, cubic 1 %", asymmetry=0.003, cubic=0.01),
    Case("aligned axes, asymmetry ±0.3 %", asymmetry=0.003, misalignment=0.0),
    Case("aligned axes, cubic 1 %", cubic=0.01, misalignment=0.0),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=12, help="simulated sessions of each case (%(default)s)")
    parser.add_argument("--seed", type=int, default=7000, help="of the first session (%(default)s)")
    args = parser.parse_args()
    jobs = [(case, args.seed + i) for case in CASES for i in range(args.sessions)]
    results = in_parallel(one_session, jobs, "session")
    print(f"Tilt of the held-out segments, degrees rms, median of {args.sessions} sessions; in brackets: taken up, how often it bent.\n")
    rows = []
    for number, case in enumerate(CASES):
        found = results[number * args.sessions : (number + 1) * args.sessions]
        rows.append([case.words, *_cells(found)])
    print(markdown(["concealed", "least squares", "TinyGC-Net", "noise floor"], rows))


def one_session(job: tuple[Case, int]) -> dict:
    """Held-out rms in degrees by method, and the floor; ``bent``: whether the net left the linear model."""
    case, seed = job
    options = SimulationOptions(seed=seed, segments=80, closure_s=0.0, gyro_misalignment=case.misalignment)
    with simulated(options, distort=case.distort) as folder:
        problem = build_problem(read_session(folder))
    seen = np.arange(len(problem.batch)) % 2 == 0
    batch, sigma, unseen = problem.batch.pick(seen), problem.floor.sigma[seen], problem.batch.pick(~seen)
    linear = fit_least_squares(batch, sigma, bias_only(problem.still_rates.rate[0])).model
    found = {"least squares": _tilt(unseen, linear), "floor": problem.floor.tilt_rms / DEG}
    trained = train_second_order(batch, sigma)
    return found | {"net": _tilt(unseen, trained.net), "bent": trained.tie > 0}


def _tilt(batch, model) -> float:
    return rms(closure_angles(batch, model)) * np.sqrt(batch.angles) / DEG


def _cells(found: list[dict]):
    floor, linear, net = (np.array([one[name] for one in found]) for name in ("floor", "least squares", "net"))
    yield f"{np.median(linear):.4f}"
    taken = np.median(1 - (net**2 - floor**2) / (linear**2 - floor**2))
    share = f"{100 * taken:.0f} %, " if np.median(linear) > 1.5 * np.median(floor) else ""
    yield f"{np.median(net):.4f} ({share}{sum(one['bent'] for one in found)} of {len(found)})"
    yield f"{np.median(floor):.4f}"


if __name__ == "__main__":
    main()
