"""What the seeds are made of: a few samples of a sensor that lies still and turns, all of our own making."""

from __future__ import annotations

import numpy as np

from session.bench import frames
from session.bench.events import Info

COUNT = 12
PERIOD_US = 9600
T_US = 4_000_000 + PERIOD_US * np.arange(COUNT)
_RNG = np.random.default_rng(14)
#: (COUNT, 7) int16: gx gy gz ax ay az temp, near those of a sensor of 500 dps and 4 g that lies level
REGISTERS = np.rint([28, -17, 34, 0, 0, -8190, 120] + _RNG.normal(size=(COUNT, 7)) * [3, 3, 3, 9, 9, 9, 1]).astype(np.int16)
RATES_DPS = REGISTERS[:, :3] * 0.0175
FORCES_G = REGISTERS[:, 3:6] * 0.000122
INFO = Info(500.0, 4.0, 104.0, "77")
FRAMES = b"".join(row.tobytes() for row in frames.encode_samples(np.arange(COUNT), T_US, REGISTERS))
INFO_FRAME = frames.encode_info(COUNT, INFO)
REGISTER_HEADER = "t_us,gx,gy,gz,ax,ay,az,temp"
UNIT_HEADER = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"


def lines(*columns: np.ndarray | list, separator: str = ",", form: str = "{:.5g}") -> str:
    """Rows of columns (COUNT,) or (COUNT, K), whole numbers as they are."""
    table = [column if np.ndim(column) == 2 else np.reshape(column, (-1, 1)) for column in map(np.asarray, columns)]
    cells = [[str(v) if isinstance(v, int | str) else form.format(v) for part in table for v in part[row].tolist()] for row in range(COUNT)]
    return "".join(separator.join(row) + "\n" for row in cells)


REGISTER_LINES = lines(T_US, REGISTERS)
UNIT_LINES = lines(T_US, RATES_DPS, FORCES_G)
