"""What is bridged, on every real recording beside the checkout: the table of docs/real-logs.md.

    python benchmarks/real_logs.py [xsens mikov mimu] [--only NAME …]

Gaps of one and three samples are cut into each recording, where it turns, and bridged: the error of the rotation, and how many of these
errors are within the sigma that is stated.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from common import in_parallel, markdown
from real_recordings import Job, add_choice, chosen_jobs

from session.base.units import DEG
from session.detect import bridging
from session.log.config import Sensor
from session.log.folder import read_session
from session.log.samples import Samples

SETS = ("xsens", "mikov", "mimu")
#: gaps that are cut: how many at once, how often; where it turns by this
GAPS, REPEATS, TURNING_RPS = 12, 8, 20 * DEG
MISSING = 1, 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_choice(parser, f"of {', '.join(SETS)} (all)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tinygc-") as made:
        jobs = chosen_jobs(parser, args, SETS, Path(made))
        results = in_parallel(pulls_of_gaps, jobs, "recording")
    table = []
    for name in dict.fromkeys(job.set_name for job in jobs):
        for count in MISSING:
            rows = np.concatenate([gaps[count] for job, gaps in zip(jobs, results, strict=True) if job.set_name == name])
            error, sigma = rows[:, 0], rows[:, 1]
            figures = [f"{np.sqrt(np.mean(each**2)) / DEG:.3f}" for each in (error, sigma)]
            table.append([name, count, len(rows) // 3, *figures, f"{np.mean(np.abs(error) < sigma):.0%}"])
    print(markdown(["set", "samples missing", "gaps", "error, ° rms", "stated, ° rms", "within 1σ"], table))


def pulls_of_gaps(job: Job) -> dict[int, np.ndarray]:
    """By length: (3 K, 2) rad, error of the rotation over a gap and its sigma, each axis by itself."""
    session = read_session(job.folder)
    sensor, samples = session.config.sensor, session.logs[0].samples
    limit = 0.9 * sensor.gyro_fs_dps * DEG
    speed = np.linalg.norm(samples.gyro - np.median(samples.gyro, axis=0), axis=1)
    fast = np.flatnonzero((speed > TURNING_RPS) & (np.abs(samples.gyro).max(axis=1) < limit))
    fast = fast[(fast > 100) & (fast < len(samples) - 100)]
    found = {}
    for count in MISSING:
        rng = np.random.default_rng(count)
        parts = [_one_cut(samples, sensor, rng.choice(fast, GAPS, replace=False), count) for _ in range(REPEATS)]
        found[count] = np.concatenate(parts)
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


if __name__ == "__main__":
    main()
