"""Model files of every kind, as text and as good tables with odd values in them; applied to a log."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
from annex import annex

from fuzz_targets.json_edits import edited
from fuzz_targets.material import COUNT, FORCES_G, RATES_DPS, T_US, lines
from fuzz_targets.rules import choose, finite, must_hold
from session.io.config import Accelerometer, Sensor
from session.io.dialects import Answers
from session.io.samples import Samples
from session.io.units import DEG, G
from tinygc import models
from tinygc.deploy.apply import apply_model
from tinygc.effects import AppliedEffect, Conditions, effect_of
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.linear import LinearModel
from tinygc.models.model import accelerometer_of, accelerometer_table, sensor_of, sensor_table
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import CarriedNet, PhysicsModel

LOG = f"t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c\n{lines(T_US, RATES_DPS, FORCES_G, np.full(COUNT, 25.5))}"
SAMPLES = Samples(T_US * 1000, RATES_DPS * DEG, FORCES_G * G, np.full(COUNT, 25.5))
EFFECTS = ("gyro.thermal_bias", "gyro.g_sensitivity", "gyro.scale_asymmetry", "gyro.bandwidth", "gyro.bias_step", "timing.axis_skew")
MODES = ("text", "edited", "applied")


@cache
def tables() -> list[dict]:
    """A model file of each kind."""
    linear, net = LinearModel(np.eye(3) + 0.01, np.array([0.001, -0.002, 0.003])), CalibrationNet.identity()
    known = Conditions(200.0, 500 * DEG, 25.0)
    claims = []
    for name in EFFECTS:
        effect = effect_of(name)
        effect = effect if effect.scan is None else effect.at(50.0 * effect.scan.si)
        claims.append(AppliedEffect(effect, np.full(effect.parameter.size, 0.01 * effect.parameter.plausible)))
    physics = PhysicsModel(linear, tuple(claims), known)
    found = [linear, net, DenoisedNet(net, Denoiser.identity(), 104.0), physics]
    found += [CarriedNet(PhysicsModel(linear, tuple(claims[:2]), known), net)]
    if temperature := annex("tinygc.annexes.temperature.model"):
        polynomials = np.stack([np.eye(3), 1e-4 * np.eye(3)]), np.full((3, 3), 1e-5)
        found.append(temperature.ThermalModel(*polynomials, np.full(3, 60.0), 25.0, (-10.0, 60.0)))
    more = {
        "accelerometer": accelerometer_table(Accelerometer(np.eye(3), np.zeros(3))),
        "sensor": sensor_table(Sensor("ASM330LHH", "7", 104.0, 500.0, 4.0)),
    }
    return [models.to_dict(each, **more) for each in found]


def seeds() -> list[bytes]:
    """Each kind as it is, applied, and as text the shortest."""
    count = len(tables())
    return [
        *(bytes([mode, kind]) for mode in (1, 2) for kind in range(count)),
        *(bytes([1, kind, 0, 3 * kind, 5 * kind]) for kind in range(count)),
        b"\0" + json.dumps(tables()[0]).encode(),
    ]


def run(data: bytes, folder: Path) -> None:
    """What is read is finite in use, and is written and read again as the same."""
    mode, data = choose(data, MODES)
    path = folder / "model.json"
    if mode == "text":
        path.write_bytes(data)
    else:
        table, program = choose(data, tables())
        path.write_text(edited(table, program), encoding="utf-8")
    model, table = models.load_with_table(path)
    accelerometer, sensor = accelerometer_of(table), sensor_of(table)
    finite(sensor.gyro_fs_dps, sensor.accel_fs_g, *sensor.own_units.values())
    if accelerometer is not None:
        finite(accelerometer.matrix, accelerometer.bias_mps2)
    if mode == "applied":
        (folder / "log.csv").write_text(LOG)
        apply_model(path, folder / "log.csv", folder / "out.csv", Answers(odr_hz=104.0, gyro_fs_dps=500.0, accel_fs_g=4.0))
        assert len((folder / "out.csv").read_text().splitlines()) >= COUNT
        return
    rates = model.calibrate(SAMPLES)
    finite(rates)
    with must_hold("what was read and is written"):
        again = models.from_dict(json.loads(json.dumps(models.to_dict(model))))
    assert np.array_equal(again.calibrate(SAMPLES), rates)
