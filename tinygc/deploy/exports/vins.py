"""VINS-Fusion and VINS-Mono: ``acc_n``, ``gyr_n``, ``acc_w``, ``gyr_w`` of their configuration.

They are numbers of one sample, not densities.  Each step of dt (vins_estimator, IntegrationBase) takes the mean of two samples, counts
their noises as independent, and gives the bias dt times its own:

    variance of the angle  += 2 (dt / 2)^2 gyr_n^2,    variance of the bias  += dt^2 gyr_w^2;    acc_n, acc_w likewise.

N^2 dt and K^2 dt are meant, so gyr_n = N sqrt(2 / dt) and gyr_w = K / sqrt(dt).  The sqrt(2) restores what the mean of two samples halves:
each sample is in two steps, and the sum of the steps has all its noise.
"""

from __future__ import annotations

import numpy as np

from session.base.texts import command_line
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._noise import densities, noise_remarks
from tinygc.deploy.exports._text import remarks, yaml_text
from tinygc.models.model import Model

NAME = "vins"
KEYS = {"accel": ("acc_n", "acc_w"), "gyro": ("gyr_n", "gyr_w")}
UNITS = {"acc_n": "m/s^2", "acc_w": "m/s^3", "gyr_n": "rad/s", "gyr_w": "rad/s^2"}


def export(model: Model, context: Context) -> dict[str, str]:
    """Export the noise; of the model nothing, since VINS has no intrinsics."""
    context.remark(f"vins has no intrinsics: calibrate the readings before VINS reads them (`{command_line('apply')}`, or --to c)")
    return export_noise(context)


def export_noise(context: Context) -> dict[str, str]:
    """Export the noise, which needs no model."""
    found = densities(context, NAME, of_rate=True)
    rate_hz = context.config.sensor.odr_hz
    values: dict[str, float] = {}
    sources: dict[str, str] = {}
    for kind, (white, walk) in KEYS.items():
        both = found[kind]
        values |= {white: both.white.largest * np.sqrt(2 * rate_hz), walk: both.walk.largest * np.sqrt(rate_hz)}
        sources |= {white: f"{UNITS[white]}, {both.white.source}", walk: f"{UNITS[walk]}, {both.walk.source}"}
    head = remarks(
        context,
        "Lines for VINS' own yaml.  They are of one sample: gyr_n = N sqrt(2 rate), gyr_w = K sqrt(rate); acc_n, acc_w likewise,",
        f"rate = {rate_hz:g} Hz of the topic that VINS reads.  Of another rate r multiply all four by sqrt(r / {rate_hz:g}).",
        "The 2: VINS takes the mean of two samples for each step and counts their noises as independent.",
        "VINS calibrates nothing of the sensor but its biases: give it calibrated readings.",
        *noise_remarks(context, found),
    )
    return {"vins_imu.yaml": head + yaml_text(values, sources)}
