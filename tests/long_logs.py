"""A simulated session whose turns lie between rests of half a minute and more: short enough for a test, long beside its turns."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.io.numeric import decimal_rows
from tinygc import SimulationOptions
from tinygc.simulation.simulator import simulate_session
from tinygc.simulation.write import HEADER, config_text

OPTIONS = SimulationOptions(segments=14, closure_s=0.0, seed=3, odr_hz=104)


def long_session(folder: Path, samples: int) -> Path:
    """The folder of a session of so many rows: the rests go on with readings drawn from themselves."""
    simulation, rng = simulate_session(OPTIONS), np.random.default_rng(5)
    log, odr_hz = simulation.log, simulation.unit.odr_hz
    table = np.column_stack([log.gyro, log.accel, log.temp])
    begins = [0.0, *(stop for _, stop in simulation.plan.turns)]
    ends = [*(start for start, _ in simulation.plan.turns), simulation.plan.log_s]
    longer, parts, at = (samples - len(table)) // len(begins), [], 0
    for number, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        # What is well within the rest: a turn's filter has let go of it.
        first, last = int((begin + 0.3) * odr_hz), int((end - 0.1) * odr_hz)
        count = longer if number < len(begins) - 1 else samples - len(table) - longer * (len(begins) - 1)
        parts += [table[at:last], table[rng.integers(first, last, count)]]
        at = last
    table = np.concatenate([*parts, table[at:]])
    t_us = np.rint(np.arange(len(table)) / odr_hz * 1e6).astype(np.int64)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "log0001.csv").write_bytes(f"{HEADER}\n".encode() + decimal_rows([t_us, *table.T.astype(np.int64)], [0] * 8))
    (folder / "session.toml").write_text(config_text(simulation, concealed=False), encoding="utf-8")
    return folder
