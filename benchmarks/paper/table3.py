"""The paper's Table 3: the error after a closure run, by method, by what the fit is told, and with and without the Earth's rotation.

Simulated sessions (40 segments, a closure run of 54 to 58 s, an ASM330LHH with 3 deg/h of bias instability, heading not given), and
the recordings of ../shared/closure.  The closure run is never fitted.  The denoised net's delay is allowed for.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from closure_table import CLOSURE_S, RECORDINGS, TITLES, fit_model, rms
from common import in_parallel, markdown, simulated, with_heading

from session.base.units import DEG
from session.log.folder import Session, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.runs import read_closure_runs
from tinygc.estimation.choice import run_figures
from tinygc.simulation.options import SimulationOptions

METHODS = ("raw", "pso", "least_squares", "tinygc", "tinygc_denoised")
CASES = {
    (True, False): "endpoint loss, Earth's rotation taken off",
    (True, True): "… and still rates",
    (False, False): "endpoint loss, Earth's rotation left in",
    (False, True): "… and still rates, taken for zero",
}
FIRST_SEED = 3000


@dataclass(frozen=True)
class Job:
    """A simulated session by its seed, or a recorded one by its folder."""

    seed: int = 0
    folder: Path | None = None


def table3(sessions: int = 20, recordings: Path = RECORDINGS) -> str:
    """The table as Markdown: roll, pitch, yaw together as RMSE in degrees."""
    folders = sorted(path.parent for path in recordings.glob("*/session.toml"))
    jobs = [Job(folder=folder) for folder in folders] + [Job(seed=FIRST_SEED + i) for i in range(sessions)]
    results = in_parallel(one_session, jobs, "session")
    header = ["", *(TITLES[name] for name in METHODS), "noise floor"]
    parts = [f"RMSE over roll, pitch, yaw at the return, degrees; median (and quartiles) of {sessions} simulated sessions."]
    parts.append(markdown(header, _rows(results[len(folders) :])))
    for folder, result in zip(folders, results, strict=False):
        parts += [f"{folder.parent.name}/{folder.name}, recorded:", markdown(header, _rows([result]))]
    return "\n\n".join(parts)


def one_session(job: Job) -> dict:
    """RMSE in degrees by case and method, and the floor."""
    if job.folder is not None:
        return _figures(read_session(job.folder))
    seconds = round(float(np.random.default_rng(job.seed).uniform(*CLOSURE_S)), 3)
    with simulated(SimulationOptions(seed=job.seed, closure_s=seconds)) as folder:
        return _figures(with_heading(read_session(folder), None))


def _figures(session: Session) -> dict:
    table = {}
    for earth, still_rates in CASES:
        problem = build_problem(session, use_earth=earth)
        run = read_closure_runs(problem)[0]
        table[earth, still_rates] = {name: run_figures(run.errors(fit_model(name, problem, still_rates)))["rmse_deg"] for name in METHODS}
        table["floor"] = rms(run.floor_rad) / DEG
    return table


def _rows(results: list[dict]):
    floor = np.median([result["floor"] for result in results])
    for case, words in CASES.items():
        yield [words, *(_cell([result[case][name] for result in results]) for name in METHODS), f"{floor:.4f}"]


def _cell(values: list[float]) -> str:
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    digits = 4 if middle < 1 else 1
    return f"{middle:.{digits}f}" + (f" ({low:.{digits - 1}f}–{high:.{digits - 1}f})" if len(values) > 1 else "")
