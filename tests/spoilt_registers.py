"""Clean movements, and what spoils their registers: false readings and losses, at rows that are known."""

from pathlib import Path

import numpy as np
from conftest import DEG, Table, config

from session.io.logfile import Log
from session.io.samples import Samples
from tinygc import Session

RATES = (104.0, 208.0, 416.0, 833.0)
FS = 500 * DEG


def clean(odr_hz: float, seed: int, turns: int = 6) -> tuple[Samples, Table]:
    table = Table().tumble(turns, seed=seed)
    return table.samples(odr_hz=odr_hz, seed=seed), table


def rows_in_turns(table: Table, samples: Samples, each: int, seed: int) -> np.ndarray:
    """Rows well inside the turns, ``each`` in every turn, at least a third of a second apart: where rate and gravity both change."""
    rng = np.random.default_rng(seed)
    stops, starts = [stop for _, stop in table.rests[:-1]], [start for start, _ in table.rests[1:]]
    times = []
    for stop, start in zip(stops, starts, strict=True):
        slots = stop + (start - stop) * (0.2 + 0.6 * np.arange(each) / each)
        times += (slots + rng.uniform(0, 0.6 * (start - stop) / each - 0.35, each)).tolist()
    return np.searchsorted(samples.t_s, np.array(times))


def with_losses(samples: Samples, rows: np.ndarray, count: int) -> Samples:
    """``count`` samples gone after each row, and the stamps closed up."""
    kept = np.ones(len(samples), dtype=bool)
    for row in rows:
        kept[row + 1 : row + 1 + count] = False
    return Samples(samples.t_ns[: kept.sum()], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept])


def closed_up(rows: np.ndarray, count: int) -> np.ndarray:
    """The same rows, counted after the losses before them."""
    return rows - count * np.arange(len(rows))


# In whole sessions: rows and times go on from log to log


def session_of_logs(*logs: Samples) -> Session:
    return Session(Path("made"), config(), tuple(Log(Path(f"log{i:04}.csv"), samples) for i, samples in enumerate(logs)), ())
