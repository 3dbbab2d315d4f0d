"""A simulated unit, its model as a file, and today's sessions of it."""

import json
from dataclasses import replace

import numpy as np

from session.io.units import DEG
from tinygc import SimulationOptions, models
from tinygc.library.sessions import Simulated
from tinygc.models.linear import LinearModel
from tinygc.models.model import accelerometer_table, sensor_table
from tinygc.simulation.simulator import simulate_session

OPTIONS = SimulationOptions(segments=10, closure_s=0.0, odr_hz=104.0, seed=5, unit_seed=3)
SIGMA = np.r_[np.full(9, 1e-4), np.full(3, 0.003 * DEG)]


def session_of(unit, distort=None, **more):
    """A session of a unit; distort: its measured rates, by t_s, rate, force and temp_c."""
    return Simulated({}, simulate_session(replace(OPTIONS, **more), distort, unit=unit)).session


def write(path, vector, config, **more):
    table = models.to_dict(
        LinearModel.from_vector(vector), sensor=sensor_table(config.sensor), accelerometer=accelerometer_table(config.accelerometer), **more
    )
    path.write_text(json.dumps(table))
    return path


def rest_log(path, session, shift=0.0, seconds=30):
    """A rest of the first still's readings, as CSV."""
    samples, rng = session.logs[0].samples, np.random.default_rng(1)
    rows = rng.integers(0, 90, int(seconds * 104))
    gyro, accel = samples.gyro[rows] / DEG + shift, samples.accel[rows] / 9.80665
    lines = ["t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"]
    lines += [f"{k / 104:.6f}," + ",".join(f"{v:.7f}" for v in (*g, *a)) for k, (g, a) in enumerate(zip(gyro, accel, strict=True))]
    path.write_text("\n".join(lines) + "\n")
    return path
