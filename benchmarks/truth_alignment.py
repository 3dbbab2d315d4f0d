"""A truth file's clock and mounting: sigmas over seeds, and what real recordings show whose clocks their authors have aligned.

Simulated: turns of 2 s about random axes, a truth whose moments err by themselves.  ``python benchmarks/truth_alignment.py`` prints two
tables; ../shared/euroc is left out where it is not there.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from common import markdown
from public.euroc import write_sequences
from scipy.spatial.transform import Rotation

from session.detect.truth_alignment import align
from session.io.config import Accelerometer, Config, Protocol, Sensor, Site, TruthReading
from session.io.folder import Session, read_session
from session.io.logfile import Log, Truth
from session.io.samples import Samples
from session.io.units import DEG

EUROC = Path(__file__).resolve().parents[2] / "shared" / "euroc"
SEQUENCES = ("MH_02", "MH_03", "MH_04", "MH_05", "V1_01", "V1_02", "V1_03", "V2_01", "V2_02", "V2_03")
RATE_HZ, TURN_S, NOISE_RPS_RTHZ = 208.0, 2.0, 0.005 * DEG
#: turns, noise of a moment in degrees, s between moments, s late, mounting in degrees about x, y, z
CASES = {
    "60 s": (30, 0.02, 0.1, 0.0, (0.0, 0.0, 0.0)),
    "60 s, 4.06 ms late": (30, 0.02, 0.1, 0.00406, (0.0, 0.0, 0.0)),
    "20 s": (10, 0.02, 0.1, 0.0, (0.0, 0.0, 0.0)),
    "60 s, a moment every 0.5 s": (30, 0.02, 0.5, 0.0, (0.0, 0.0, 0.0)),
    "60 s, moments of 0.2°": (30, 0.2, 0.1, 0.0, (0.0, 0.0, 0.0)),
    "60 s, inverse, mounted 3, -2, 1°, 4.06 ms early": (30, 0.02, 0.1, -0.00406, (3.0, -2.0, 1.0)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=60, help="sessions of each kind (%(default)s)")
    args = parser.parse_args()
    print(
        markdown(
            ("simulated", "sigma of the offset, ms", "offsets within it", "rms in sigmas", "mountings within it", "rms", "claimed"),
            [_row(name, case, args.seeds) for name, case in CASES.items()],
        )
    )
    if EUROC.is_dir():
        print()
        print(markdown(("EuRoC", "offset, ms", "sigmas", "gyro to truth, °", "read as"), [_real(name) for name in SEQUENCES]))


def _row(name: str, case: tuple, seeds: int) -> tuple[str, ...]:
    offsets, turns, sigmas, claimed = [], [], [], 0
    for seed in range(seeds):
        alignment = align(simulated(seed, *case)).alignment
        assert alignment is not None
        own = Rotation.from_rotvec(np.multiply(case[4], DEG))
        offsets.append((alignment.offset_s + case[3]) / alignment.offset_sigma_s)
        turns.append((own.inv() * Rotation.from_rotvec(alignment.turned)).as_rotvec() / alignment.turned_sigma)
        sigmas.append(alignment.offset_sigma_s)
        claimed += alignment.source["offset_s"] == "found"
    within = [f"{np.mean(np.abs(values) < 1):.0%}" for values in (offsets, turns)]
    rms = [f"{np.sqrt(np.mean(np.square(values))):.2f}" for values in (offsets, turns)]
    return (name, f"{1e3 * np.median(sigmas):.3f}", within[0], rms[0], within[1], rms[1], f"{claimed} of {seeds}")


def _real(name: str) -> tuple[str, ...]:
    with tempfile.TemporaryDirectory() as folder:
        alignment = align(read_session(write_sequences(EUROC, [name], Path(folder) / name, segment_s=2.0))).alignment
    assert alignment is not None
    shown = f"{1e3 * alignment.offset_s:+.3f} ± {1e3 * alignment.offset_sigma_s:.3f}"
    turned = ", ".join(f"{t:.2f} ± {s:.2f}" for t, s in zip(alignment.turned / DEG, alignment.turned_sigma / DEG, strict=True))
    reading = alignment.reading
    return (
        name,
        shown,
        f"{abs(alignment.offset_s) / alignment.offset_sigma_s:.1f}",
        turned,
        f"{reading.frame}, {reading.sense}, {reading.order}",
    )


def simulated(seed: int, turns: int, sigma_deg: float, every_s: float, late_s: float, mounting_deg: tuple[float, ...]) -> Session:
    """A gyro whose matrix errs symmetrically by half a percent, beside a truth; with a mounting, an inverse one."""
    rng = np.random.default_rng(seed)
    axes, angles = rng.normal(size=(turns, 3)), rng.uniform(40, 120, turns) * DEG
    vectors = angles[:, None] * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    starts = [Rotation.identity()]
    for vector in vectors:
        starts.append(starts[-1] * Rotation.from_rotvec(vector))
    begun = Rotation.concatenate(starts)

    def at(t_s: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Rate in the body (N, 3) rad/s and attitude: each turn a bell from rest to rest."""
        number = np.clip((t_s // TURN_S).astype(int), 0, turns - 1)
        part = np.clip(t_s / TURN_S - number, 0, 1)[:, None]
        done = part - np.sin(2 * np.pi * part) / (2 * np.pi)
        return (1 - np.cos(2 * np.pi * part)) / TURN_S * vectors[number], begun[number] * Rotation.from_rotvec(done * vectors[number])

    t_s = np.arange(0, turns * TURN_S, 1 / RATE_HZ)
    rate, attitude = at(t_s)
    error = rng.normal(size=(3, 3)) * 0.005
    gyro = rate @ np.linalg.inv(np.eye(3) + (error + error.T) / 2).T + np.multiply((0.5, -0.3, 0.6), DEG)
    gyro = gyro + rng.normal(size=rate.shape) * NOISE_RPS_RTHZ * np.sqrt(RATE_HZ / 2)
    moments = np.arange(0.3 + max(late_s, 0), turns * TURN_S - 0.3 + min(late_s, 0), every_s)
    noisy = at(moments - late_s)[1] * Rotation.from_rotvec(rng.normal(size=(len(moments), 3)) * sigma_deg * DEG)
    mounting = Rotation.from_rotvec(np.multiply(mounting_deg, DEG)).as_matrix()
    reading = TruthReading(sense="world_to_body" if any(mounting_deg) else "body_to_world", mounting=mounting)
    force = attitude.inv().apply([0, 0, -9.8])
    config = Config(Sensor("", "", RATE_HZ, 500, 4), Accelerometer(), Site(), Protocol(1.0, 2.0, "truth", sigma_deg))
    log = Log(Path("log0001.csv"), Samples(np.rint(t_s * 1e9).astype(np.int64), gyro, force), raw=False)
    truth = Truth(Path("truth0001.csv"), np.rint(moments * 1e9).astype(np.int64), reading.written(noisy.as_quat(scalar_first=True)))
    return Session(Path("made"), config, (log,), (), None, (truth,))


if __name__ == "__main__":
    main()
