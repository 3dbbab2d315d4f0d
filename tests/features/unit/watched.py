"""A sensor under watch: its figures, rests and turns sample by sample."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from conftest import DEG, Table

from session.log.config import Accelerometer
from tinygc import models
from tinygc.deploy.apply import Applicable
from tinygc.features.unit.watch.watch import Event, Watch
from tinygc.fitting.unit_state import UnitState
from tinygc.models.linear import LinearModel
from tinygc.models.model import accelerometer_table

RATE_HZ, G = 100.0, 9.80665
#: one-sided densities of the stills as fit.json has them, dps/sqrt(Hz) and g/sqrt(Hz)
GYRO, ACCEL = 0.005, 6e-5
WHITE, ACCEL_WHITE = GYRO * DEG / np.sqrt(2), ACCEL * G / np.sqrt(2)
COVARIANCE = np.diag(np.r_[np.full(9, 1e-4**2), np.full(3, 1e-5**2)])


def known(spread_dps=0.1, model=None):
    """A model in use whose figures are those of ``samples``."""
    noise = {"gyro_dps_rthz": [GYRO] * 3, "accel_g_rthz": [ACCEL] * 3, "gyro_bias_instability_dph": 0.0}
    table = {"covariance": COVARIANCE.tolist(), "bias_sigma_rps": [spread_dps * DEG] * 3}
    return UnitState(Path("model.json"), model or LinearModel(np.eye(3), np.zeros(3)), table, {"noise": noise})


def samples(seconds, seed, zero_dps=(0.0, 0.0, 0.0), start_s=0.0, force=(0.0, 0.0, -G)):
    """A rest with white noise."""
    rng, count = np.random.default_rng(seed), round(seconds * RATE_HZ)
    rate = np.array(zero_dps) * DEG + rng.normal(size=(count, 3)) * WHITE * np.sqrt(RATE_HZ)
    accel = np.array(force) + rng.normal(size=(count, 3)) * ACCEL_WHITE * np.sqrt(RATE_HZ)
    stamps = np.rint((start_s + np.arange(count) / RATE_HZ) * 1e9).astype(np.int64)
    return Applicable(stamps, rate, accel, None)


def joined(*parts):
    """One after the other, at the sensor's rate."""
    count = sum(len(part.t_ns) for part in parts)
    stamps = np.rint(np.arange(count) / RATE_HZ * 1e9).astype(np.int64)
    gyro, accel = (np.concatenate([getattr(part, name) for part in parts]) for name in ("gyro", "accel"))
    return Applicable(stamps, gyro, accel, None)


def turning(turns, seed, scale=(1.0, 1.0, 1.0), rest_s=4.0, angle_deg=180.0, turn_s=3.0):
    """Rests, and between them turns about changing axes, exact but for noise and the scale of each axis."""
    rng, table = np.random.default_rng(seed), Table().rest(rest_s)
    for _ in range(turns):
        table.turn(angle_deg, rng.normal(size=3), turn_s).rest(rest_s)
    still = samples(table.duration_s, seed, force=np.zeros(3))
    rate, attitude = table.truth(still.t_ns * 1e-9)
    return Applicable(still.t_ns, still.gyro + rate * scale, still.accel + attitude.inv().apply([0.0, 0.0, -G]), None)


def watched(readings, piece=700, **options):
    """All events of readings in pieces."""
    live = Watch(options.pop("known", None) or known(), **options)
    events: list[Event] = []
    for begin in range(0, len(readings.t_ns), piece):
        part = slice(begin, begin + piece)
        events += live.take(readings.rows(part))
    return live, [*events, *live.end()]


def of_kind(events, kind):
    """Those of a kind."""
    return [event for event in events if event.kind == kind]


def model_file(path):
    """A model's file with what a watch needs of it."""
    used = known()
    more = used.table | {"accelerometer": accelerometer_table(Accelerometer(np.eye(3), np.zeros(3), "given"))}
    path.write_text(json.dumps(models.to_dict(used.model, **more)), encoding="utf-8")
    return path


def csv(readings):
    """As lines of a board in physical units."""
    rows = zip(readings.t_ns.tolist(), readings.gyro.tolist(), readings.accel.tolist(), strict=True)
    lines = ["t_us,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2"]
    lines += [f"{t // 1000},{','.join(f'{each:.7f}' for each in (*g, *a))}" for t, g, a in rows]
    return "\n".join(lines) + "\n"
