"""What the tests share: the recordings beside the repository, and a simulated hand-turned table with a known truth."""

from __future__ import annotations

import gzip
import importlib
import os
import shutil
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as calibrate.py has it; before NumPy is there
os.environ.setdefault("OMP_NUM_THREADS", "1")  # each worker has a core's share; before torch is there
os.environ["TINYGC_DEFAULTS"] = ""  # what whoever runs the tests has set for a bench of their own must not be in an answer

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))
ASSERTING = ["dialect_logs", "exports_read_back", "formats_page", "html_pages", "looks", "processes"]
ASSERTING += ["recording_wires"]
pytest.register_assert_rewrite(*ASSERTING)  # whose assertions are the tests'

from any_order import (  # noqa: E402, F401  # hooks and a fixture of all tests
    no_reader_is_left,
    pytest_addoption,
    pytest_collection_finish,
    pytest_collection_modifyitems,
    pytest_runtest_setup,
    pytest_xdist_auto_num_workers,
)
from posix_only import pytest_pycollect_makemodule  # noqa: E402, F401

import calibrate  # noqa: E402
from session.log.config import Accelerometer, Config, Protocol, Sensor, Site  # noqa: E402
from session.log.logfile import Log  # noqa: E402
from session.log.registers import accel_mps2_per_lsb, gyro_rps_per_lsb  # noqa: E402
from session.log.samples import Samples  # noqa: E402
from tinygc import Session, read_session  # noqa: E402

DEG = np.pi / 180
GRAVITY = 9.7946


def broad(*values, id=None):
    """Values of a parametrised test that walk the path of its other values: run by ``.ci/run``, not with the quick tests."""
    return pytest.param(*values, id=id, marks=pytest.mark.broad)


@pytest.fixture(scope="session")
def shared():
    """The folder of recordings that lies beside the repository."""
    folder = ROOT.parent / "shared"
    if not folder.is_dir():
        pytest.skip(f"no recordings: {folder} is not there")
    return folder


class Table:
    """A plan of rests and turns, played to a sensor in the middle of the table (no lever arm), starting level.

    ``Table().rest(2).turn(90, (1, 0, 0), 3).rest(2).samples(odr_hz=208)``; rests are listed as (start_s, stop_s) in ``rests``.
    """

    def __init__(self):
        self.phases: list[tuple[float, np.ndarray, bool]] = []  # duration s, rotation vector in body axes rad, smooth
        self.rests: list[tuple[float, float]] = []

    @property
    def duration_s(self):
        return sum(duration for duration, _, _ in self.phases)

    def rest(self, seconds):
        self.rests.append((self.duration_s, self.duration_s + seconds))
        self.phases.append((seconds, np.zeros(3), True))
        return self

    def turn(self, degrees, axis, seconds=3.0):
        """About an axis fixed in the body, starting and ending at rest."""
        axis = np.asarray(axis, float)
        self.phases.append((seconds, degrees * DEG * axis / np.linalg.norm(axis), True))
        return self

    def steady(self, dps, axis, seconds):
        """At a constant rate from the first moment to the last."""
        axis = np.asarray(axis, float)
        self.phases.append((seconds, dps * DEG * seconds * axis / np.linalg.norm(axis), False))
        return self

    def tumble(self, turns, rest_s=2.0, turn_s=3.0, seed=0):
        """Rest, turn, rest, … by 90 to 200 degrees about random axes."""
        rng = np.random.default_rng(seed)
        self.rest(rest_s)
        for _ in range(turns):
            self.turn(rng.uniform(90, 200), rng.normal(size=3), turn_s).rest(rest_s)
        return self

    def truth(self, t_s):
        """Rate in body axes (N, 3) rad/s and attitude, body to north-east-down."""
        rate = np.zeros((len(t_s), 3))
        quat = np.zeros((len(t_s), 4))
        start, attitude = 0.0, Rotation.identity()
        for duration, vector, smooth in self.phases:
            now = (t_s >= start) & (t_s <= start + duration)
            part = (t_s[now] - start) / duration
            done = part - np.sin(2 * np.pi * part) / (2 * np.pi) if smooth else part
            speed = (1 - np.cos(2 * np.pi * part)) / duration if smooth else np.full(len(part), 1 / duration)
            rate[now] = speed[:, None] * vector
            quat[now] = (attitude * Rotation.from_rotvec(done[:, None] * vector)).as_quat()
            start, attitude = start + duration, attitude * Rotation.from_rotvec(vector)
        return rate, Rotation.from_quat(quat)

    def samples(
        self,
        odr_hz=208.0,
        gyro_mdps=5.0,
        accel_ug=60.0,
        bias_dps=(0.5, -0.3, 0.6),
        seed=0,
        registers=True,
    ):
        """What an ideal sensor reads: bias, white noise (one-sided densities in mdps, ug per √Hz), registers of 500 dps, 4 g."""
        rng = np.random.default_rng(seed)
        t_ns = np.rint(np.arange(0, self.duration_s, 1 / odr_hz) * 1e6).astype(np.int64) * 1000
        rate, attitude = self.truth(t_ns * 1e-9)
        nyquist = np.sqrt(odr_hz / 2)
        gyro = rate + np.multiply(bias_dps, DEG) + rng.normal(size=rate.shape) * gyro_mdps * 1e-3 * DEG * nyquist
        accel = attitude.inv().apply([0, 0, -GRAVITY]) + rng.normal(size=rate.shape) * accel_ug * 1e-6 * 9.80665 * nyquist
        if registers:
            gyro, accel = (np.rint(values / lsb) * lsb for values, lsb in ((gyro, gyro_rps_per_lsb(500)), (accel, accel_mps2_per_lsb(4))))
        return Samples(t_ns, gyro, accel, 25 + np.rint(rng.normal(size=len(t_ns)) * 20) / 256)


def config(odr_hz=208.0, gyro_fs_dps=500.0, accel_fs_g=4.0, still_s=1.0, segment_s=5.0, model="ASM330LHH"):
    return Config(
        Sensor(model, "test", odr_hz, gyro_fs_dps, accel_fs_g),
        Accelerometer(),
        Site(latitude_deg=31.03, gravity_mps2=GRAVITY),
        Protocol(still_s, segment_s),
    )


def session_of(samples, raw=True, **settings):
    """A session of one log, in memory."""
    return Session(Path("made"), config(**settings), (Log(Path("log0001.csv"), samples, raw=raw),), ())


SESSION_TOML = """schema = "tinygc-session/1"
[sensor]
model = "ASM330LHH"
serial = "42"
odr_hz = 208.0
gyro_fs_dps = 500
accel_fs_g = 4
[site]
latitude_deg = 31.03
gravity_mps2 = 9.7946
"""


def write_session(folder, samples, name="log0001.csv", toml=SESSION_TOML):
    """A session folder with the samples as registers."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "session.toml").write_text(toml)
    gyro = np.rint(samples.gyro / gyro_rps_per_lsb(500)).astype(int)
    accel = np.rint(samples.accel / accel_mps2_per_lsb(4)).astype(int)
    temp = np.rint((samples.temp_c - 25) * 256).astype(int)
    rows = np.column_stack([samples.t_ns // 1000, gyro, accel, temp])
    np.savetxt(folder / name, rows, fmt="%d", delimiter=",", header="t_us,gx,gy,gz,ax,ay,az,temp", comments="")
    return folder


def writable_copy(source, folder):
    """A copy of a session that may be changed, whatever the rights of its source."""
    shutil.copytree(source, folder)
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)
    return folder


# The estimation side: simulated sessions and segments made directly.


@pytest.fixture(scope="session")
def simulated(tmp_path_factory):
    """``simulated(segments=10, …)``: the folder of a simulated session, made once for each choice of options.  Read only: copy to write."""
    from tinygc import SimulationOptions
    from tinygc.simulation.write import write_session as write_simulation

    made = {}

    def make(**options):
        chosen = SimulationOptions(**{"segments": 10, "closure_s": 20.0, "seed": 3, "odr_hz": 104.0, **options})
        if chosen not in made:
            made[chosen] = write_simulation(chosen, tmp_path_factory.mktemp("simulated") / f"session{len(made)}")
        return made[chosen]

    return make


def turned(rate_at, stop_s, fine_hz=1664.0):
    """What a smooth body rate ``rate_at(t_s (N,))``, (N, 3) rad/s, turns the body by from 0 to stop_s.

    Fourth-order Magnus steps (Simpson's mean and the commutator of the ends) multiplied by scipy: none of the project's own code,
    and no assumption about what lies between samples.
    """
    count = round(stop_s * fine_hz)
    step_s = stop_s / count
    rate = rate_at(np.linspace(0, stop_s, 2 * count + 1))
    first, middle, last = rate[:-2:2], rate[1:-1:2], rate[2::2]
    return product(Rotation.from_rotvec(step_s / 6 * (first + 4 * middle + last) + step_s**2 / 12 * np.cross(first, last)))


def product(turns):
    """turns[0] * turns[1] * …, by halving."""
    while len(turns) > 1:
        odd = len(turns) % 2
        halved = turns[: len(turns) - odd : 2] * turns[1 : len(turns) : 2]
        turns = Rotation.concatenate([halved, turns[-1:]]) if odd else halved
    return turns[0]


def wxyz(turns):
    """scipy's quaternion, scalar first."""
    return turns.as_quat(scalar_first=True)


class Turns:
    """A chain of smooth hand turns, noise-free: still 0 – turn – still 1 – … with known attitudes.

    rate (S, T, 3) rad/s true, against the table; dt (S, T-1) s; q (S+1, 4) q_tb in the stills.  Each turn runs about an axis that
    wanders, so the product of its steps does not commute.  The rate is a smooth function of time, five times differentiable where
    it leaves rest and comes back to it; a sensor samples it, and the attitudes are the function's, not the samples'.
    """

    def __init__(self, count=16, seed=0, odr_hz=104.0, seconds=4.0, axes=(1, 1, 1)):
        rng = np.random.default_rng(seed)
        samples = round(seconds * odr_hz)
        t_s = np.arange(samples) / odr_hz
        self.duration_s = t_s[-1]
        self.dt = np.full((count, samples - 1), 1 / odr_hz)
        shape = (2, count, 3)
        self.speed = rng.uniform(0.5, 2.0, shape) * rng.choice([-1, 1], shape) * np.asarray(axes) * (3.2 / 0.8 / seconds)
        self.wander_hz, self.phase = rng.uniform(0.5, 2, shape) / seconds, rng.uniform(0, 2 * np.pi, shape)
        self.rate = np.stack([self.rate_at(segment, t_s) for segment in range(count)])
        attitudes = [Rotation.random(random_state=seed) if all(axes) else Rotation.identity()]
        for segment in range(count):
            attitudes.append(attitudes[-1] * turned(lambda t, segment=segment: self.rate_at(segment, t), self.duration_s))
        self.q = wxyz(Rotation.concatenate(attitudes))

    def rate_at(self, segment, t_s):
        """Rate (N, 3) rad/s of a segment at any times (N,) s since its start."""
        part = np.clip((t_s / self.duration_s - 0.1) / 0.8, 0, 1)[:, None]
        waves = 1 + 0.6 * np.sin(2 * np.pi * self.wander_hz[:, segment, None] * t_s[:, None] + self.phase[:, segment, None])
        return np.sin(np.pi * part) ** 6 * (self.speed[:, segment, None] * waves).sum(axis=0)

    def __len__(self):
        return len(self.rate)

    def batch(self, model, yaw_known=False, gyro_noise=0.0, q=None):
        """What a gyro reads whose true calibration is ``model``, with noise (S, T, 3) added, and attitudes q (S+1, 4) as references."""
        from tinygc.closure.residual import Batch

        measured = (self.rate - model.B) @ np.linalg.inv(model.E).T + gyro_noise
        q = self.q if q is None else q
        return Batch(measured, self.dt, np.zeros_like(measured), q[:-1], q[1:], yaw_known)


@pytest.fixture(scope="module", params=["made", broad("recorded")])
def good(request):
    """A session with nothing wrong: made here, and by another bench."""
    if request.param == "made":
        return session_of(Table().tumble(16, seed=5).samples())
    return read_session(request.getfixturevalue("shared") / "closure" / "case001")


@pytest.fixture(scope="session")
def torch():
    """PyTorch, which takes two seconds to import: only by the process that has its tests."""
    return importlib.import_module("torch")


@pytest.fixture
def run(capfd):
    """``run("fit", folder)``: exit code, standard output, standard error of the command line."""

    def call(*arguments):
        capfd.readouterr()
        try:
            code = calibrate.main([str(argument) for argument in arguments])
        except SystemExit as stopped:  # argparse
            code = stopped.code
        return code, *capfd.readouterr()

    return call


@pytest.fixture
def folder(simulated, tmp_path):
    """A simulated session of 10 turns that a test may spoil, its log unpacked."""
    made = tmp_path / "session"
    shutil.copytree(simulated(), made)
    packed = made / "log0001.csv.gz"
    (made / "log0001.csv").write_bytes(gzip.decompress(packed.read_bytes()))
    packed.unlink()
    return made
