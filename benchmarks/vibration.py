"""The coefficient of ``gyro.vibration_rectification``, as of the energy that the accelerometer passes and as of the energy that is felt.

    python benchmarks/vibration.py [--seeds 6]

Sessions in which the vibration of some turns moves the gyro's zero, made by the challenge's own code, in several bands and at several
data rates.  The simulated accelerometer's low-pass is at a quarter of the data rate.  What it passes of the vibration is the difference
of two recordings of the same session, with and without it.  Each row says how far the fitted coefficient is off (rms over axes and
sessions, a share of its size) if it is read per g² that the accelerometer passes, and if it is read per g² that the element feels.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from common import in_parallel, markdown

from session.base.units import DEG, G
from session.log.folder import read_session
from session.log.registers import accel_mps2_per_lsb
from tinygc.closure.build import build_problem
from tinygc.explanation.physics import fit_physics
from tinygc.features.challenge.other_effects import bench, vibration_rectification
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.sensor import LOWEST_FINE_HZ
from tinygc.simulation.simulator import plan_of, simulate_session
from tinygc.simulation.write import config_of, write_files

EFFECT = "gyro.vibration_rectification"
#: data rate, Hz; band of the vibration, Hz
BANDS = {
    208.0: ((10.0, 20.0), (15.0, 30.0), (20.0, 45.0), (40.0, 80.0), (60.0, 120.0)),
    104.0: ((20.0, 45.0),),
    416.0: ((20.0, 45.0), (40.0, 150.0)),
}
SCENES = [(odr_hz, band) for odr_hz, bands in BANDS.items() for band in bands]
Job = tuple[float, tuple[float, float], int]


def fitted(job: Job) -> dict:
    """One session: share of the felt energy that the accelerometer passes, the fitted coefficient per g² passed over the true one,
    and its sigma (3,)."""
    odr_hz, band_hz, seed = job
    options = SimulationOptions(segments=40, closure_s=0.0, seed=seed, odr_hz=odr_hz)
    plan = plan_of(options)
    one = vibration_rectification(bench(np.random.default_rng(seed), 1.0, options, plan), band_hz)
    assert one.disturb is not None  # it shakes the accelerometer
    shaken = simulate_session(options, one.distort, plan=plan, disturb=one.disturb)
    quiet = simulate_session(options, one.distort, plan=plan)
    passed = (shaken.log.accel.astype(float) - quiet.log.accel) * accel_mps2_per_lsb(options.accel_fs_g) / G
    fine_s = np.arange(0, plan.log_s, 1 / LOWEST_FINE_HZ)
    felt = one.disturb(fine_s, np.zeros((len(fine_s), 3))) / G
    with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
        write_files(shaken, Path(folder), config_of(shaken.options, shaken.unit))
        found = fit_physics(build_problem(read_session(Path(folder))), (EFFECT,))
    (claim,) = found.model.claims
    true = np.array(one.truth["dps_per_g2"]) * DEG  # per g² that the accelerometer passes
    return {
        "passed": float(np.mean(passed**2) / np.mean(felt**2)),
        "ratio": claim.theta / true,
        "sigma": np.sqrt(np.diag(found.fit.theta_covariance(0))) / np.abs(true),
    }


def row(scene: tuple[float, tuple[float, float]], found: list[dict]) -> list[str]:
    odr_hz, (low, high) = scene
    passed = np.array([one["passed"] for one in found])
    per_passed = np.array([one["ratio"] for one in found])
    per_felt = per_passed / passed[:, None]
    numbers = [passed.mean(), *(np.sqrt(np.mean((ratio - 1) ** 2)) for ratio in (per_passed, per_felt)), per_passed.mean() - 1]
    sigma = np.sqrt(np.mean([one["sigma"] ** 2 for one in found]))
    return [f"{odr_hz:g} Hz, {low:g} to {high:g} Hz", str(len(found)), *(f"{100 * x:.1f} %" for x in (*numbers, sigma))]


def main() -> None:
    """One table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    args = parser.parse_args()
    jobs: list[Job] = [(odr_hz, band_hz, seed) for odr_hz, band_hz in SCENES for seed in range(1, args.seeds + 1)]
    found = in_parallel(fitted, jobs, "session")
    rows = [row(scene, found[i * args.seeds : (i + 1) * args.seeds]) for i, scene in enumerate(SCENES)]
    header = ["data rate, band", "sessions", "passed", "off, per g² passed", "off, per g² felt", "mean, per g² passed", "sigma of noise"]
    print(markdown(header, rows))


if __name__ == "__main__":
    main()
