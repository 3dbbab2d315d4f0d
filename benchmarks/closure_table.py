"""Closure runs after a fit to 40 segments: the error at the return, by method and by what is known of the Earth's rotation.

Simulated sessions (40 segments, closure run of 54 to 58 s, bias instability 3 °/h), each fitted three times: with the heading of
the table given, with it unknown, and with the Earth's rotation left out.  The closure run is never fitted.  The floor is
what the sensor's white noise alone must leave.
"""

from __future__ import annotations

import argparse

import numpy as np
from common import first_still_heading_deg, in_parallel, markdown, simulated, with_heading

from session.base.units import DEG
from session.log.folder import Session, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import Nearby, fit_least_squares
from tinygc.closure.problem import Problem
from tinygc.closure.runs import read_closure_runs
from tinygc.estimation.choice import run_figures
from tinygc.methods.denoiser import of_problem, train_denoiser
from tinygc.methods.network import train_second_order
from tinygc.methods.particle_swarm import search
from tinygc.models.linear import bias_only
from tinygc.simulation.options import SimulationOptions

METHODS = ("raw", "least_squares", "tinygc")
EARTH = {"given": "heading given", "unknown": "heading unknown", "none": "Earth's rotation left out"}
CLOSURE_S = (54.0, 58.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=24, help="simulated sessions (%(default)s)")
    parser.add_argument("--seed", type=int, default=1000, help="of the first session (%(default)s)")
    args = parser.parse_args()
    results = in_parallel(one_session, range(args.seed, args.seed + args.sessions), "session")
    print("RMSE over roll, pitch, yaw at the return, degrees: median (and quartiles).\n")
    print(markdown(["Earth", "raw", "least squares", "TinyGC-Net", "floor"], _closure_rows(results)))
    bent = sum(r["bent"] for r in results)
    print(f"\nTinyGC-Net chose a bent (not linear) solution in {bent} of {len(results)} fits with the heading unknown.")


def one_session(seed: int) -> dict:
    """Closure errors of one simulated session: by Earth and method."""
    seconds = np.random.default_rng(seed).uniform(*CLOSURE_S)
    options = SimulationOptions(seed=seed, closure_s=round(float(seconds), 3))
    truth_deg = first_still_heading_deg(options)
    with simulated(options) as folder:
        session = read_session(folder)
    return figures(session, truth_deg)


def figures(session: Session, heading_deg: float) -> dict:
    """RMSE in degrees by Earth and method, of the session's first closure run."""
    result = {"rmse_deg": {}, "bent": False}
    for earth in EARTH:
        known = with_heading(session, (heading_deg + 180) % 360 - 180 if earth == "given" else None)
        problem = build_problem(known, use_earth=earth != "none")
        run = read_closure_runs(problem)[0]
        models = {name: fit_model(name, problem) for name in METHODS}
        result["rmse_deg"][earth] = {name: run_figures(run.errors(model))["rmse_deg"] for name, model in models.items()}
        result["floor_deg"] = rms(run.floor_rad) / DEG
        if earth == "unknown":
            result["bent"] = bool(np.abs(models["tinygc"].slope - 1).max() > 1e-6)
    return result


def fit_model(name: str, problem: Problem):
    """One method's model of all segments, without the folds that ``fit`` adds."""
    batch, sigma, start = problem.batch, problem.floor.sigma, bias_only(problem.still_rates.rate[0])
    if name == "raw":
        return bias_only()
    if name == "least_squares":
        return fit_least_squares(batch, sigma, start).model
    if name == "pso":
        return search(Nearby.about(start, batch), start, sigma, 1.0, seed=0)[0]
    net = train_second_order(batch, sigma).net
    return net if name == "tinygc" else train_denoiser(of_problem(problem), net)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _closure_rows(results: list[dict]):
    floor = f"{np.median([result['floor_deg'] for result in results]):.4f}"
    for earth, words in EARTH.items():
        yield [words, *(_median([result["rmse_deg"][earth][method] for result in results]) for method in METHODS), floor]


def _median(values: list[float]) -> str:
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    return f"{middle:.4f} ({low:.3f}–{high:.3f})" if middle < 1 else f"{middle:.1f} ({low:.1f}–{high:.1f})"


if __name__ == "__main__":
    main()
