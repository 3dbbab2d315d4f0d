"""Do calibrations of one unit agree as often as they should?  Simulated sessions of one unit, compared in pairs: p-values uniform.

Then the same with one scale factor changed in the second session of each pair: how often it is seen, and rightly named.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from common import in_parallel, markdown
from scipy import stats

from session.io.config import Accelerometer, Config, Protocol, Sensor, Site
from session.io.folder import Session
from session.io.logfile import Log
from session.io.registers import DEFAULT, RegisterUnits, accel_mps2_per_lsb, gyro_rps_per_lsb
from session.io.samples import Samples
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.uncertainty import goodness, parameter_covariance
from tinygc.estimation.compare import DIFFERS_P, Calibrated, compare
from tinygc.models.linear import bias_only
from tinygc.simulation import simulator
from tinygc.simulation.options import SimulatedUnit, SimulationOptions


@dataclass(frozen=True)
class Job:
    seed: int
    segments: int
    odr_hz: float
    scale_ppm: float = 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=60, help="(%(default)s)")
    parser.add_argument("--segments", type=int, default=40, help="per session (%(default)s)")
    parser.add_argument("--seed", type=int, default=9000, help="of the first session (%(default)s)")
    parser.add_argument("--scale-ppm", type=float, nargs="*", default=[100.0, 200.0], help="changes of the x scale factor (%(default)s)")
    args = parser.parse_args()
    jobs = [Job(args.seed + i, args.segments, 208.0) for i in range(2 * args.pairs)]
    sessions = in_parallel(calibrated, jobs, "session")
    rows = [row("nothing", [compare(pair) for pair in pairs(sessions)])]
    for ppm in args.scale_ppm:
        changed = in_parallel(calibrated, [replace(job, scale_ppm=ppm) for job in jobs[1::2]], "session")
        rows.append(row(f"x scale factor, {ppm:g} ppm", [compare([one, other]) for one, other in zip(sessions[::2], changed, strict=True)]))
    print(f"{args.pairs} pairs of simulated sessions of {args.segments} segments, one unit.\n")
    print(markdown(["changed between the two", "p < 0.05", "p < 0.01", "uniform, KS p", "median p", "x scale factor named first"], rows))
    bias = np.array([compare(pair).bias.p_value for pair in pairs(sessions)])
    uniform = stats.kstest(bias, "uniform").pvalue
    print(f"\nBias, nothing changed: p < 0.05 in {np.mean(bias < 0.05):.0%}, uniform: KS p = {uniform:.2g}.")
    together = compare(sessions).lasting
    print(f"All {len(sessions)} at once: chi-square {together.chi_square:.0f} for {together.freedom}, p = {together.p_value:.2g}.")


def pairs(sessions: list[Calibrated]) -> list[list[Calibrated]]:
    return [sessions[i : i + 2] for i in range(0, len(sessions), 2)]


def row(what: str, found: list) -> list[str]:
    p = np.array([comparison.lasting.p_value for comparison in found])
    named = [bool(c.moved) and (c.moved[0].word, c.moved[0].component) == ("scale factor error", "x") for c in found]
    seen = [*(f"{np.mean(p < bar):.0%}" for bar in (0.05, DIFFERS_P)), f"{stats.kstest(p, 'uniform').pvalue:.2g}", f"{np.median(p):.2g}"]
    return [what, *seen, f"{np.mean(named):.0%}"]


def calibrated(job: Job) -> Calibrated:
    """One session of the unit, fitted as ``fit`` does."""
    options = SimulationOptions(seed=job.seed, unit_seed=1, segments=job.segments, closure_s=0.0, odr_hz=job.odr_hz)
    session = recorded(options, job.scale_ppm)
    problem = build_problem(session)
    fit = fit_least_squares(problem.batch, problem.floor.sigma, bias_only(problem.still_rates.rate[0]))
    found = goodness(problem.batch, problem.floor, fit.model, problem.wander)
    covariance = found.excess * parameter_covariance(problem.batch, problem.floor, fit.model, problem.earth, None, problem.wander)
    return Calibrated(Path(f"day{job.seed}"), session.config, fit.model.vector, covariance, fit.unobserved, (str(job.seed),), ())


def recorded(options: SimulationOptions, scale_ppm: float = 0.0) -> Session:
    """The session in memory; the unit's x axis reads ``scale_ppm`` more."""
    unit = simulator.draw_unit(options, simulator._streams(options)[0])
    more = np.diag([1 / (1 + 1e-6 * scale_ppm), 1, 1])
    made = simulator.simulate_session(options, unit=replace(unit, E=unit.E @ more))
    return as_session(options, made.unit, made.log)


def as_session(options: SimulationOptions, unit: SimulatedUnit, log) -> Session:
    """As the folder would be read."""
    gyro, accel = gyro_rps_per_lsb(options.gyro_fs_dps), accel_mps2_per_lsb(options.accel_fs_g)
    samples = Samples(log.t_us * 1000, log.gyro * gyro, log.accel * accel, RegisterUnits(DEFAULT, None, None).temperature_c(log.temp))
    config = Config(
        Sensor("ASM330LHH", "simulated", options.odr_hz, options.gyro_fs_dps, options.accel_fs_g),
        Accelerometer(unit.accel_matrix, unit.accel_bias),
        Site(options.latitude_deg, options.gravity_mps2),
        Protocol(options.still_s, 2 * options.still_s + options.turn_s),
    )
    return Session(Path(f"day{options.seed}"), config, (Log(Path("log0001.csv"), samples),), ())


if __name__ == "__main__":
    main()
