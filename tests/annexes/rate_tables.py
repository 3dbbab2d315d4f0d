"""Recordings of a simulated sensor on a virtual table with one axis: steps of its rate, and swings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.annexes.machines.angles import header, row
from session.annexes.machines.description import Axis, Description
from session.annexes.machines.mechanics import AxisErrors, AxisTrack, TableErrors
from session.io.units import DEG
from tinygc.annexes.machines.sensor_on_table import SensorOnTable
from tinygc.simulation.options import SimulatedUnit, SimulationOptions

ODR_HZ, ANSWERS_HZ = 104.0, 50.0
DOWN = Axis("turn", np.array([0.0, 0.0, 1.0]), None, None, 400 * DEG, 400 * DEG, 0.005 * DEG, 0.0, "X")
TABLE = Description("bench", "virtual", (DOWN,))
TOML = """schema = "tinygc-table/1"
make = "virtual"
{settings}
[[axis]]
name = "turn"
direction = [0, 0, 1]
fastest_dps = 400
acceleration_dps2 = 400
sigma_deg = 0.005
"""
SESSION = """schema = "tinygc-session/1"

[sensor]
model = "LSM6DS3"
odr_hz = 104.0
gyro_fs_dps = 500
accel_fs_g = 4

[site]
latitude_deg = 50.0
gravity_mps2 = 9.81
"""


def unit(scale: float = 1.0, odr_hz: float = ODR_HZ) -> SimulatedUnit:
    """A unit whose gyroscope reads scale times the rate."""
    return SimulatedUnit(np.eye(3) / scale, np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3), odr_hz, 0.0)


class Swings:
    """A track that swings at one frequency after the other, a rest between."""

    def __init__(self, frequencies_hz, seconds, amplitude_dps=30.0):
        self.plan = [(1.0 + n * (seconds + 1.0), f) for n, f in enumerate(frequencies_hz)]
        self.seconds, self.amplitude = seconds, amplitude_dps * DEG
        self.ends_s = self.plan[-1][0] + seconds + 1.0

    def angle(self, t_s):
        found = np.zeros(len(t_s))
        for begin, f in self.plan:
            whole_s = np.floor(self.seconds * f) / f  # whole cycles, so that it ends where it began
            since = np.clip(t_s - begin, 0, whole_s)
            found += self.amplitude / (2 * np.pi * f) * (1 - np.cos(2 * np.pi * f * since))
        return found

    def said_and_sense(self, t_s):
        return self.angle(t_s), np.ones(len(t_s))


def steps(rates_dps, dwell_s: float) -> tuple[AxisTrack, float]:
    """A track that turns at one rate after the other; and when it ends, s."""
    track, t_s = AxisTrack(), 1.0
    for rate in rates_dps:
        track.turn_at(t_s, rate * DEG, DOWN.acceleration_rps2)
        t_s += dwell_s
    track.turn_at(t_s, 0.0, DOWN.acceleration_rps2)
    return track, t_s + 1.0


def record(
    folder: Path,
    track,
    ends_s: float,
    *,
    scale=1.0,
    distort=None,
    latency_s=0.0,
    seed=1,
    settings="",
    noise=5.0,
    name="rates0001.csv",
    jitter_s=0.0,
    has_clock=False,
    limits="",
):
    """Write the folder of a recording; latency_s: by which its angles are late; jitter_s: of their stamps, which a clock of the machine
    has not."""
    folder.mkdir(parents=True, exist_ok=True)
    options = SimulationOptions(seed=seed, gyro_noise_dps_rthz=noise * 1e-3, odr_hz=ODR_HZ, gyro_fs_dps=500, bias_instability_dph=0.0)
    sensor = SensorOnTable(TABLE, TableErrors((AxisErrors(),)), options, unit(scale), distort)
    log = sensor.take([track], int(ends_s * ODR_HZ))
    lines = ["t_us,gx,gy,gz,ax,ay,az,temp"]
    lines += [",".join(map(str, cells)) for cells in np.column_stack([log.t_us, log.gyro, log.accel, log.temp]).tolist()]
    (folder / name).write_text("\n".join(lines) + "\n")
    (folder / "session.toml").write_text(SESSION)
    (folder / "table.toml").write_text(TOML.format(settings=settings) + limits)
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, ends_s - 0.1, 1 / ANSWERS_HZ)
    said = track.said_and_sense(t_s - latency_s)[0] + 0.002 * DEG * rng.normal(size=len(t_s))
    stamp_s = np.maximum.accumulate(t_s + jitter_s * np.abs(rng.normal(size=len(t_s))))
    clock = [7.0 + t if has_clock else None for t in t_s.tolist()]
    rows = [row(name, round(s * 1e6), c, True, [angle]) for s, c, angle in zip(stamp_s.tolist(), clock, said, strict=True)]
    path = folder / "table.csv"
    before = path.read_text() if path.exists() else header(TABLE) + "\n"
    path.write_text(before + "\n".join(rows) + "\n")
    return folder
