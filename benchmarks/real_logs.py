"""What is bridged and weighed down, on every real recording beside the checkout; the tables of docs/real-logs.md.

    python benchmarks/real_logs.py [xsens mikov mimu] [--only NAME …]

First, gaps of one to five samples are cut into each recording, where it turns, and bridged: the error of the rotation, and how many of
these errors are within the sigma that is stated.  Then the turns with an impact: what they miss by the calibration of the others, the
sigma that they get, and held-out closure with all turns counted alike and with these weighed down.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import in_parallel
from real_recordings import Job, add_choice, chosen_jobs

from session.detect import bridging
from session.io.config import Sensor
from session.io.folder import read_session
from session.io.samples import Samples
from session.io.units import DEG

SETS = ("xsens", "mikov", "mimu")
#: gaps that are cut: how many at once, how often; where it turns by this
GAPS, REPEATS, TURNING_RPS = 12, 8, 20 * DEG
LONGEST = 5
COLUMNS = (
    "recording",
    "turns with an impact",
    "hardest, g",
    "they miss by, °",
    "sigma, °",
    "held out, all turns alike, °",
    "weighed down, °",
    "of the other turns: alike, °",
    "weighed, °",
    "raw, °",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_choice(parser, f"of {', '.join(SETS)} (all)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tinygc-") as made:
        jobs = chosen_jobs(parser, args, SETS, Path(made))
        results = in_parallel(one_recording, jobs, "recording")
    print("| set | samples missing | gaps | error, ° rms | stated, ° rms | within 1 sigma | within 2 |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for name in dict.fromkeys(job.set_name for job in jobs):
        for count in range(1, LONGEST + 1):
            rows = np.concatenate([r["gaps"][count] for r in results if r["set"] == name and len(r["gaps"][count])])
            error, sigma = rows[:, 0], rows[:, 1]
            within = [np.mean(np.abs(error) < k * sigma) for k in (1, 2)]
            figures = " | ".join(f"{np.sqrt(np.mean(each**2)) / DEG:.3f}" for each in (error, sigma))
            print(f"| {name} | {count} | {len(rows) // 3} | {figures} | {within[0]:.0%} | {within[1]:.0%} |")
    print(f"\n| {' | '.join(COLUMNS)} |\n| --- | ---: | ---: | --- | --- |{' ---: |' * 5}")
    for r in results:
        print(r["row"])


def one_recording(job: Job) -> dict:
    return {"set": job.set_name, "gaps": pulls_of_gaps(job), "row": impacts_row(job)}


def pulls_of_gaps(job: Job) -> dict[int, np.ndarray]:
    """By length: (3 K, 2) rad, error of the rotation over a gap and its sigma, each axis by itself."""
    session = read_session(job.folder)
    sensor, samples = session.config.sensor, session.logs[0].samples
    limit = 0.9 * sensor.gyro_fs_dps * DEG
    speed = np.linalg.norm(samples.gyro - np.median(samples.gyro, axis=0), axis=1)
    fast = np.flatnonzero((speed > TURNING_RPS) & (np.abs(samples.gyro).max(axis=1) < limit))
    fast = fast[(fast > 100) & (fast < len(samples) - 100)]
    usual, found = bridging.MOST, {}
    bridging.MOST = LONGEST
    try:
        for count in range(1, LONGEST + 1):
            rng = np.random.default_rng(count)
            parts = [_one_cut(samples, sensor, rng.choice(fast, GAPS, replace=False), count) for _ in range(REPEATS)]
            found[count] = np.concatenate(parts)
    finally:
        bridging.MOST = usual
    return found


def _one_cut(samples: Samples, sensor: Sensor, rows: np.ndarray, count: int) -> np.ndarray:
    rows = np.sort(rows)
    rows = rows[np.concatenate([[True], np.diff(rows) > 25])]
    keep = np.ones(len(samples), dtype=bool)
    for row in rows:
        keep[row : row + count] = False
    filled, found = bridging.bridged(Samples(samples.t_ns[keep], samples.gyro[keep], samples.accel[keep]), sensor)
    if len(filled) != len(samples):
        return np.zeros((0, 2))  # stamps so coarse that none is known to be missing
    pairs = []
    for bridge in (each for each in found if each.what == bridging.GAP):
        part = slice(bridge.row, bridge.row + bridge.count)
        pairs.append(np.stack([(filled.gyro[part] - samples.gyro[part]).sum(axis=0) * samples.period_s, bridge.sigma_rad], axis=-1))
    return np.concatenate(pairs) if pairs else np.zeros((0, 2))


def impacts_row(job: Job) -> str:
    """Of the table."""
    from tinygc.closure.least_squares import fit_least_squares
    from tinygc.closure.prepared import prepare
    from tinygc.closure.residual import closure_angles
    from tinygc.estimation.bias import choose
    from tinygc.estimation.choice import closure_figures
    from tinygc.estimation.held_out import run_method
    from tinygc.estimation.options import FitOptions

    problem, options = prepare(job.folder).problem, FitOptions()
    name = f"{job.set_name}/{job.folder.name}".removesuffix(f"/{job.set_name}")

    def tilt(angles: np.ndarray) -> float:
        return closure_figures(angles)["tilt_rms_deg"]

    raw, weighed = tilt(run_method("raw_bias_removed", problem, options).held_out), choose(problem, options)[2].held_out
    sigma = {each.segment: each.sigma_rad for each in problem.widened if each.cause == "impact"}
    if not sigma:
        return f"| {name} | 0 | – | – | – | {tilt(weighed):.3f} | – | – | – | {raw:.3f} |"
    alike = replace(problem, floor=replace(problem.floor, own=problem.floor.white, wider=None), widened=())
    counted = choose(alike, options)[2].held_out
    hit = np.array([segment.number in sigma for segment in problem.used])
    calm = fit_least_squares(problem.batch.pick(~hit), alike.floor.sigma[~hit], problem.first).model if (~hit).sum() > 8 else problem.first
    missed = np.linalg.norm(closure_angles(problem.batch, calm)[hit], axis=1) / DEG
    hardest = max(float(each.says.split(" g ")[0].split()[-1]) for each in problem.widened if each.cause == "impact")
    columns = [", ".join(f"{value:.2f}" for value in values) for values in (missed, np.array(list(sigma.values())) / DEG)]
    held = [f"{tilt(angles):.3f}" for angles in (counted, weighed, counted[~hit], weighed[~hit])]
    return f"| {name} | {hit.sum()} | {hardest:.1f} | {columns[0]} | {columns[1]} | {' | '.join(held)} | {raw:.3f} |"


if __name__ == "__main__":
    main()
