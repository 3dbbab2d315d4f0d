"""Are the stated uncertainties true?  How often the error of a parameter is within one and two of its own sigmas.

Simulated sessions, least squares with the bias of the ends, sigmas as ``fit`` states them, without the accelerometer's part: the
simulated one is exact.  Right sigmas give 68 % and 95 %.  ``--stamps``: of the scale factors alone, with stamps that err in several ways.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from common import in_parallel, markdown, simulated

from session.log.folder import Session, read_session
from session.log.logfile import Log
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.estimation.stated_noise import stated_covariance, stated_goodness, stated_noise
from tinygc.inference.choose import MISMATCH_P
from tinygc.models.linear import BIAS, bias_only
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session


@dataclass(frozen=True)
class Job:
    seed: int
    segments: int
    instability_dph: float
    stamps: str = "exact"


#: °/h: none, as the simulator, more than the fit takes for typical
INSTABILITIES_DPH = (0.0, 3.0, 10.0)
#: measured ratio of two clocks: its relative sigma, and within what it is drawn
RATIO_SIGMA, RATIO_WITHIN = 70e-6, 5e-3
#: kind of stamps -> the step that they are rounded to, s, and the sigma of the half-normal delay that they come with, s
STAMPS = {
    "exact": (1e-6, 0.0),
    "of 1 ms": (1e-3, 0.0),
    "0.5 ms late": (1e-6, 5e-4),
    "2 ms late": (1e-6, 2e-3),
    "5 ms late": (1e-6, 5e-3),
    "of 1 ms, clock ± 0.5 %, measured to 70 ppm": (1e-3, 0.0),
}
#: s that a line takes on the wire: what comes late is followed at once
ON_THE_WIRE_S = 2e-4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=200, help="(%(default)s)")
    parser.add_argument("--seed", type=int, default=2000, help="of the first session (%(default)s)")
    parser.add_argument("--segments", type=int, default=40, help="per session (%(default)s)")
    parser.add_argument("--stamps", action="store_true", help="the scale factors, with each kind of stamps")
    args = parser.parse_args()
    if args.stamps:
        return by_stamps(args)
    jobs = [Job(args.seed + i, args.segments, dph) for dph in INSTABILITIES_DPH for i in range(args.sessions)]
    results = in_parallel(one_session, jobs, "session")
    rows = []
    for dph in INSTABILITIES_DPH:
        mine = [result for job, result in zip(jobs, results, strict=True) if job.instability_dph == dph]
        z = np.array([result["z"] for result in mine])
        bias, chi_square = _row("", z[:, BIAS].ravel()), np.mean([result["chi_square"] for result in mine])
        rows.append([*_row(f"{dph:g} °/h", z.ravel())[:3], bias[1], bias[3], f"{chi_square:.1f}"])
    print(markdown(["bias instability", "within 1σ", "within 2σ", "B, within 1σ", "B, error rms / σ", "mean χ² of twelve"], rows))


def one_session(job: Job) -> dict:
    """Errors in sigmas (12,), and the goodness of fit."""
    options = SimulationOptions(seed=job.seed, segments=job.segments, closure_s=0.0, bias_instability_dph=job.instability_dph)
    unit = simulate_session(SimulationOptions(seed=job.seed, segments=1, closure_s=0.0)).unit
    truth = np.concatenate([unit.E.ravel(), unit.B])
    with simulated(options) as folder:
        session = with_stamps(read_session(folder), job)
        problem = build_problem(session)
    fit = fit_least_squares(problem.batch, problem.floor.sigma, bias_only(problem.still_rates.rate[0]))
    noise = stated_noise(problem)
    found, widened = stated_goodness(problem, fit.model, noise)
    whole, accelerometer = stated_covariance(problem, fit.model, noise)
    covariance = widened * (whole - accelerometer) + (0.0 if session.clock is None else session.clock.covariance(fit.model.vector))
    sigma, error = np.sqrt(np.diag(covariance)), fit.model.vector - truth
    return {
        "z": error / sigma,
        "sigma": sigma,
        "chi_square": float(error @ np.linalg.solve(covariance, error)),
        "p_value": found.p_value,
    }


def with_stamps(session: Session, job: Job) -> Session:
    """A session whose stamps err as the job says; a clock that was measured is taken out of them."""
    rng, (step_s, delay_s) = np.random.default_rng(job.seed), STAMPS[job.stamps]
    if job.stamps == "exact":
        return session
    ratio = 1 + rng.uniform(-RATIO_WITHIN, RATIO_WITHIN) if "clock" in job.stamps else 1.0

    def late(log: Log) -> Log:
        t_s = log.samples.t_ns * 1e-9 + np.abs(rng.normal(0, 1, len(log.samples))) * delay_s
        wire_s = ON_THE_WIRE_S * np.arange(len(t_s))
        t_s = (np.maximum.accumulate(t_s - wire_s) + wire_s) * ratio
        return replace(log, samples=replace(log.samples, t_ns=np.rint(np.rint(t_s / step_s) * step_s * 1e9).astype(np.int64)))

    session = replace(session, logs=tuple(map(late, session.logs)))
    if ratio == 1.0:
        return session
    measured = {"clock_ratio": ratio * (1 + RATIO_SIGMA * rng.normal()), "clock_sigma_ppm": 1e6 * RATIO_SIGMA}
    sensor = replace(session.config.sensor, **measured)
    return replace(session, config=replace(session.config, sensor=sensor)).on_clock("arrivals")


def by_stamps(args: argparse.Namespace) -> None:
    """Coverage of the three scale factors, and how many sessions agree with their model, for each kind of stamps."""
    jobs = [Job(args.seed + i, args.segments, 3.0, kind) for kind in STAMPS for i in range(args.sessions)]
    results = in_parallel(one_session, jobs, "session")
    rows, scales = [], [0, 4, 8]
    for kind in [*STAMPS, "all"]:
        mine = [result for job, result in zip(jobs, results, strict=True) if kind in (job.stamps, "all")]
        sigma_ppm = 1e6 * float(np.median([result["sigma"][scales] for result in mine]))
        agrees = np.mean([result["p_value"] >= MISMATCH_P for result in mine])
        rows.append([*_row(kind, np.array([result["z"][scales] for result in mine]).ravel()), f"{sigma_ppm:.0f}", f"{agrees:.0%}"])
    print(f"{len(jobs)} simulated sessions of {args.segments} segments, {args.sessions} with each kind of stamps: their scale factors.\n")
    print(markdown(["stamps", "within 1σ", "within 2σ", "error rms / σ", "mean error / σ", "σ, ppm", "noise explains it"], rows))


def _row(name: str, z: np.ndarray) -> list[str]:
    inside = [f"{np.mean(np.abs(z) < bar):.1%}" for bar in (1, 2)]
    return [name, *inside, f"{np.sqrt(np.mean(z**2)):.2f}", f"{z.mean():+.2f}"]


if __name__ == "__main__":
    main()
