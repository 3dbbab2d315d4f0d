"""What ``noise`` reads: an Allan curve, a log of any program as a rest, and ``noise.json``, by the input's first byte."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from fuzz_targets.rules import choose, finite
from session.io.dialects import Answers
from tinygc.annexes.noise import inputs
from tinygc.annexes.noise.curve_file import read_curve
from tinygc.noise.figures import TERMS, read_figures

CHOICES = ("curve", "figures", "rest")


class Sums:
    """Takes what the statistics would."""

    def __init__(self, rate_hz: float):
        finite(rate_hz)
        assert rate_hz > 0

    def add(self, samples) -> None:
        finite(samples.gyro)
        assert (np.diff(samples.t_ns) > 0).all()


def run(data: bytes, folder: Path) -> None:
    """Read it; whatever is accepted is finite, and in order."""
    kind, data = choose(data, CHOICES)
    path = folder / {"curve": "curve.csv", "figures": "noise.json", "rest": "rest.csv"}[kind]
    path.write_bytes(data)
    if kind == "curve":
        curve = read_curve(path)
        finite(curve.tau_s, *curve.deviation.values())
        assert (np.diff(curve.tau_s) > 0).all()
        assert all(len(part) == len(curve.tau_s) and (part > 0).all() for part in curve.deviation.values())
    elif kind == "figures":
        for sensor in read_figures(path).sensors().values():
            finite(*(sensor.values(name) for name in TERMS))
    else:
        before, inputs.RestSums = inputs.RestSums, Sums
        try:
            inputs.read_inputs([path], Answers())
        finally:
            inputs.RestSums = before


def seeds() -> list[bytes]:
    """Good ones of each kind."""
    tau = "\n".join(f"{2**k} {1 / 2**k} 1 1" for k in range(8))
    term = {"value": 1e-4, "sigma": 1e-6, "probability": 1.0, "at_most": None, "tau_s": 3.0}
    sensor = {axis: {"terms": dict.fromkeys(TERMS, term), "lines": [{"hz": 1.0, "rms": 1e-3}], "p_value": 0.5} for axis in "xyz"}
    figures = {"schema": "tinygc-noise/1", "gyro": sensor, "accel": None, "rate_hz": 100.0, "duration_s": 10.0}
    rng = np.random.default_rng(1)
    rows = np.column_stack([np.arange(400) / 100, rng.normal(0, 0.1, (400, 3)), rng.normal((0, 0, -1), 0.01, (400, 3))])
    log = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + "\n".join(",".join(f"{value:.3f}" for value in row) for row in rows)
    return [
        b"\0" + f"# tau x y z (deg/s)\n{tau}\n".encode(),
        b"\x01" + json.dumps(figures).encode(),
        b"\x02" + log.encode(),
    ]
