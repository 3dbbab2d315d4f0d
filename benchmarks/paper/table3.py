"""The paper's Table 3: the error after a closure run, by method, by what the fit is told, and with and without the Earth's rotation.

Simulated sessions (40 segments, a closure run of 54 to 58 s, an ASM330LHH with 3 deg/h of bias instability, heading not given).  The
closure run is never fitted.  The denoised net's delay is allowed for.
"""

from __future__ import annotations

import numpy as np
from closure_table import CLOSURE_S, fit_model, rms
from common import in_parallel, markdown, simulated, with_heading

from session.base.units import DEG
from session.log.folder import Session, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.runs import read_closure_runs
from tinygc.estimation.choice import run_figures
from tinygc.simulation.options import SimulationOptions

METHODS = ("pso", "least_squares", "tinygc", "tinygc_denoised")
CASES = {
    True: "endpoints",
    False: "endpoints, Earth's rotation left in",
}
FIRST_SEED = 3000


def table3(sessions: int) -> str:
    """The table as Markdown: roll, pitch, yaw together as RMSE in degrees, medians."""
    results = in_parallel(one_session, range(FIRST_SEED, FIRST_SEED + sessions), "session")
    return markdown(["fitted to", "PSO", "least squares", "TinyGC-Net", "TinyGC-Net, denoised", "floor"], _rows(results))


def one_session(seed: int) -> dict:
    """RMSE in degrees by case and method, and the floor."""
    seconds = round(float(np.random.default_rng(seed).uniform(*CLOSURE_S)), 3)
    with simulated(SimulationOptions(seed=seed, closure_s=seconds)) as folder:
        return _figures(with_heading(read_session(folder), None))


def _figures(session: Session) -> dict:
    table = {}
    for earth in CASES:
        problem = build_problem(session, use_earth=earth)
        run = read_closure_runs(problem)[0]
        table[earth] = {name: run_figures(run.errors(fit_model(name, problem)))["rmse_deg"] for name in METHODS}
        table["floor"] = rms(run.floor_rad) / DEG
    return table


def _rows(results: list[dict]):
    floor = np.median([result["floor"] for result in results])
    for case, words in CASES.items():
        yield [words, *(f"{np.median([result[case][name] for result in results]):.4f}" for name in METHODS), f"{floor:.4f}"]
