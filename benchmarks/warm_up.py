"""What a warm-up costs: how far a bias that drifts while the session lasts moves the calibration, beside the targets of its parameters.

Simulated sessions of 40 segments, each twice: as it is, and with a bias that follows a warm-up (exponential, of which the session sees
what is left of it) on one axis.  The difference of the two least squares fits is the drift's doing alone: of E, and of B beside the mean
bias.  It sets ``_BAR_RPS`` of ``session/bench/live.py``; ``cold_start.py`` measures whole sessions.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import in_parallel, markdown

from session.base.units import MDPS
from session.log.config import Accelerometer, Config, Protocol, Sensor, Site
from session.log.folder import Session
from session.log.logfile import Log
from session.log.registers import DEFAULT, RegisterUnits, accel_mps2_per_lsb, gyro_rps_per_lsb
from session.log.samples import Samples
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.planning.proposals import TARGETS
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session

DRIFTS_MDPS = (0.5, 1.0, 2.0, 5.0, 10.0)
SETTLES_S = (60.0, 150.0, 600.0)


def one_seed(job: tuple[int, float]) -> list[float]:
    """The largest change of a parameter beside its target, for each rms drift."""
    seed, settles_s = job
    options = SimulationOptions(closure_s=0.0, seed=seed)
    simulation = simulate_session(options)
    log, unit = simulation.log, simulation.unit
    gyro, accel = log.gyro * gyro_rps_per_lsb(options.gyro_fs_dps), log.accel * accel_mps2_per_lsb(options.accel_fs_g)
    samples = Samples(log.t_us * 1000, gyro, accel, RegisterUnits(DEFAULT, None, None).temperature_c(log.temp.astype(float)))
    config = Config(
        Sensor("ASM330LHH", "", options.odr_hz, options.gyro_fs_dps, options.accel_fs_g),
        Accelerometer(unit.accel_matrix, unit.accel_bias),
        Site(options.latitude_deg, options.gravity_mps2),
        Protocol(options.still_s),
    )
    shape = -np.exp(-(samples.t_s - samples.t_s[0]) / settles_s)
    shape = (shape - shape.mean()) / shape.std()
    along = np.eye(3)[seed % 3]

    def fitted(drift_rps: float) -> np.ndarray:
        moved = replace(samples, gyro=samples.gyro + drift_rps * shape[:, None] * along)
        problem = build_problem(Session(Path(f"seed{seed}"), config, (Log(Path("log0001.csv"), moved),), ()))
        return fit_least_squares(problem.batch, problem.floor.sigma, problem.first).model.vector

    still = fitted(0.0)
    return [float(np.max(np.abs(fitted(drift * MDPS) - still) / TARGETS)) for drift in DRIFTS_MDPS]


def main() -> None:
    command = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    command.add_argument("--seeds", type=int, default=12)
    args = command.parse_args()
    jobs = [(2000 + seed, settles_s) for settles_s in SETTLES_S for seed in range(args.seeds)]
    found = np.array(in_parallel(one_seed, jobs, "session")).reshape(len(SETTLES_S), args.seeds, -1)
    rows = [
        (f"{settles_s:g} s", *(f"{np.median(each):.2f} ({np.quantile(each, 0.9):.2f})" for each in of.T))
        for settles_s, of in zip(SETTLES_S, found, strict=True)
    ]
    print(markdown(("settles in", *(f"{drift:g} mdps rms" for drift in DRIFTS_MDPS)), rows))


if __name__ == "__main__":
    main()
