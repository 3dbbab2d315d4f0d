"""Clean movements, and what spoils their registers: false readings and losses, at rows that are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from conftest import DEG, Table, config

from session.io.logfile import Log
from session.io.samples import Samples
from tinygc import Session

RATES = (104.0, 208.0, 416.0, 833.0)
FS = 500 * DEG
GYRO_STD = 5e-3 * DEG  # per root hertz, as in Table.samples


def clean(odr_hz: float, seed: int, turns: int = 6) -> tuple[Samples, Table]:
    table = Table().tumble(turns, seed=seed)
    return table.samples(odr_hz=odr_hz, seed=seed), table


def noise_std(odr_hz: float) -> np.ndarray:
    """(6,) of a sample: white noise and the register's steps (500 dps, 4 g)."""
    gyro, accel = GYRO_STD * np.sqrt(odr_hz / 2), 60e-6 * 9.80665 * np.sqrt(odr_hz / 2)
    steps = np.array([17.5e-3 * DEG, 0.122e-3 * 9.80665]) / np.sqrt(12)
    return np.repeat(np.hypot([gyro, accel], steps), 3)


def rows_in_turns(table: Table, samples: Samples, each: int, seed: int) -> np.ndarray:
    """Rows well inside the turns, ``each`` in every turn, at least a third of a second apart: where rate and gravity both change."""
    rng = np.random.default_rng(seed)
    stops, starts = [stop for _, stop in table.rests[:-1]], [start for start, _ in table.rests[1:]]
    times = []
    for stop, start in zip(stops, starts, strict=True):
        slots = stop + (start - stop) * (0.2 + 0.6 * np.arange(each) / each)
        times += (slots + rng.uniform(0, 0.6 * (start - stop) / each - 0.35, each)).tolist()
    return np.searchsorted(samples.t_s, np.array(times))


def with_glitches(samples: Samples, rows: np.ndarray, lengths: np.ndarray, seed: int) -> Samples:
    """A constant false offset of 20 to 80 dps on a random axis or all of them."""
    rng, gyro = np.random.default_rng(seed), samples.gyro.copy()
    for row, length in zip(rows, lengths, strict=True):
        size = rng.uniform(20, 80, 3) * rng.choice([-1, 1], 3) * DEG
        size *= rng.choice([0, 1], 3, p=[0.5, 0.5]) if rng.random() < 0.5 else 1
        size[rng.integers(3)] = 40 * DEG
        gyro[row : row + length] += size
    return replace(samples, gyro=gyro)


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
