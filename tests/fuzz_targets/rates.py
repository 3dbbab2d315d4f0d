"""What ``rates`` reads: a table of points, or gains and phases of a sweep, by the input's first byte; and what it makes of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fuzz_targets.rules import choose, finite
from tinygc.annexes.rates.choice import choose as choose_law
from tinygc.annexes.rates.points import read_points, read_table
from tinygc.annexes.rates.sweep import fit_response, is_response, read_response
from tinygc.annexes.rates.terms import terms

CHOICES = ("points", "response")
#: a law is chosen of tables this short, so that an input takes no second
SHORT = 12


def run(data: bytes, folder: Path) -> None:
    """Read it; whatever is accepted is finite, and so is what is said of it."""
    kind, data = choose(data, CHOICES)
    path = folder / "table.csv"
    path.write_bytes(data)
    if kind == "points":
        for points in read_points(path)[0][:1]:
            finite(points.rate_dps, points.output)
            if len(points) <= SHORT:
                finite(*(row.value for row in terms(choose_law(points)) if row.value is not None))
    elif is_response(read_table(path)[0]):
        sweep = fit_response(read_response(path))
        finite(sweep.vector)


def seeds() -> list[bytes]:
    """Good ones of each kind."""
    rng = np.random.default_rng(1)
    rates = np.linspace(-100, 100, 9)
    points = "\n".join(f"A,{rate:g},{0.02 * rate + 1e-3 * rng.normal():.5f},0.01,100" for rate in rates)
    gains = "\n".join(f"{f},{1 / np.hypot(1, f / 20):.5f},{-np.degrees(np.arctan(f / 20)):.4f}" for f in (1, 2, 5, 10, 20, 40))
    return [
        b"\0" + f"sensor,rate_dps,mean_v,std_v,readings\n{points}\n".encode(),
        b"\x01" + f"frequency_hz,gain,phase_deg\n{gains}\n".encode(),
    ]
