"""Sessions beside a truth file that is late, turned, inverse or upside down by a known amount: in memory, and as a folder."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from conftest import DEG, Table
from scipy.spatial.transform import Rotation

from session.log.config import Accelerometer, Config, Protocol, Sensor, Site
from session.log.logfile import Log
from session.log.samples import Samples
from tinygc import Session
from tinygc.features.truth.points import TruthFiles
from tinygc.features.truth.reading import Truth, TruthGiven, TruthReading

BIAS_DPS = (0.5, -0.3, 0.6)
TOML = """schema = "tinygc-session/1"
[sensor]
odr_hz = 208.0
gyro_fs_dps = 500
accel_fs_g = 4
[protocol]
segment_s = 2.0
reference = "truth"
truth_sigma_deg = {sigma_deg}
"""


@dataclass(frozen=True)
class Wrong:
    """What is wrong with a truth, and how good it is: late_s; mounting, a rotation vector in degrees; noise of each angle of a moment;
    moments every so many s; turns of 2 s each; force: whether there is an accelerometer."""

    late_s: float = 0.0
    mounting_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frame: str = "ned"
    sense: str = "body_to_world"
    order: str = "wxyz"
    sigma_deg: float = 0.02
    every_s: float = 0.1
    turns: int = 30
    force: bool = True
    axis: tuple[float, float, float] | None = None
    given: TruthGiven = field(default_factory=TruthGiven)


def made(wrong, seed=1):
    """The session, its truth read by what is given, and the gyro's true matrix (3, 3): rate = matrix (measured - bias)."""
    table, rng = Table(), np.random.default_rng(seed)
    for _ in range(wrong.turns):
        table.turn(rng.uniform(40, 120), rng.normal(size=3) if wrong.axis is None else np.multiply(wrong.axis, rng.choice([-1, 1])), 2.0)
    samples = table.samples(seed=seed, bias_dps=(0, 0, 0), registers=False)
    E = np.eye(3) + rng.normal(size=(3, 3)) * 0.005
    gyro = samples.gyro @ np.linalg.inv(E).T + np.multiply(BIAS_DPS, DEG)
    moments = np.arange(0.3 + max(wrong.late_s, 0), table.duration_s - 0.3 + min(wrong.late_s, 0), wrong.every_s)
    _, attitude = table.truth(moments - wrong.late_s)
    q = (attitude * Rotation.from_rotvec(rng.normal(size=(len(moments), 3)) * wrong.sigma_deg * DEG)).as_quat(scalar_first=True)
    mounting = Rotation.from_rotvec(np.multiply(wrong.mounting_deg, DEG)).as_matrix()
    written = TruthReading(wrong.order, wrong.sense, wrong.frame, mounting).written(q)
    config = Config(
        Sensor("", "", 208.0, 500, 4),
        Accelerometer(),
        Site(),
        Protocol(1.0, 2.0, "truth", wrong.sigma_deg),
        sections={"truth": wrong.given},
    )
    log = Log(Path("log0001.csv"), Samples(samples.t_ns, gyro, samples.accel * wrong.force), raw=False)
    truth = Truth(Path("truth0001.csv"), np.rint(moments * 1e9).astype(np.int64), written)
    read = truth.reread(TruthReading(), TruthReading.of(wrong.given))
    return Session(Path("made"), config, (log,), (), None, TruthFiles((read,), wrong.sigma_deg)), E


def write(folder, wrong, seed=1, more=""):
    """The same as a folder; more: lines for session.toml."""
    session, _ = made(wrong, seed)
    samples, (truth,) = session.logs[0].samples, session.reference.truths
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "session.toml").write_text(TOML.format(sigma_deg=wrong.sigma_deg) + more)
    header = "t_s,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2"
    rows = np.column_stack([samples.t_ns * 1e-9, samples.gyro, samples.accel])
    np.savetxt(folder / "log0001.csv", rows, fmt="%.10f", delimiter=",", header=header, comments="")
    rows = np.column_stack([truth.t_ns * 1e-9, truth.q_nb])
    np.savetxt(folder / "truth0001.csv", rows, fmt="%.10f", delimiter=",", header="t_s,qw,qx,qy,qz", comments="")
    return folder
