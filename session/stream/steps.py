"""Steps that no sensor makes: out and back within one sample, while the wire is bad.

A frame whose damage is confined to its registers can pass its CRC with the right number and stamp.  Then a register stands alone,
away from what is before and behind it, which agree.  A knock on the table can look so too, so a sample is doubted only where something
unreadable came among the samples shortly before; on a wire that spoils nothing, nothing passes a CRC by chance.
"""

from __future__ import annotations

import numpy as np

from session.stream.continuity import Accepted
from session.stream.events import Chunk, Trouble

#: LSB, for one sample period on either side: gyro 0.8 % of full scale, accelerometer 1.6 %, temperature 0.25 degC
BAR = np.array([256, 256, 256, 512, 512, 512, 64], np.int64)
#: samples for which a wire is doubted after something unreadable
DOUBT = 1000


class StepFilter:
    """Passes samples on; holds a doubtful one until the next has come."""

    def __init__(self) -> None:
        self._doubt = 0  # samples still to be doubted
        self._before: np.ndarray | None = None  # (7,) the last sample passed on
        self._held: tuple[int, np.ndarray, int] | None = None  # t_us, registers, periods

    def take(self, accepted: Accepted) -> list[Chunk | Trouble]:
        """What is passed on, and what is left out."""
        if not (self._doubt or accepted.damaged.any()):
            self._before = accepted.registers[-1].astype(np.int64)
            return [Chunk(accepted.t_us, accepted.registers)]
        count = len(accepted.t_us)
        last_damage = np.maximum.accumulate(np.where(accepted.damaged, np.arange(count), -count - DOUBT))
        doubted = (np.arange(count) - last_damage < DOUBT) | (np.arange(count) < self._doubt)
        self._doubt = max(0, self._doubt - count, DOUBT - int(count - last_damage[-1]))
        values = accepted.registers.astype(np.int64)
        before = values[:1] if self._before is None else self._before[None]
        jumps = (np.abs(np.diff(values, axis=0, prepend=before)) > BAR * accepted.periods[:, None]).any(axis=1) & doubted
        out: list[Chunk | Trouble] = []
        if self._held is not None:
            held, self._held = self._held, None
            self._judge(held, values[0], int(accepted.periods[0]), out)
            jumps[0] = doubted[0] and self._jumps(values[0], int(accepted.periods[0]))
        start = 0  # of what is not yet passed on
        while start < count:
            k = start + int(np.argmax(jumps[start:])) if jumps[start:].any() else count
            if k > start:
                self._pass_on(accepted, values, start, k, out)
            if k == count:
                break
            if k == count - 1:
                self._held = int(accepted.t_us[k]), values[k], int(accepted.periods[k])
                break
            assert self._before is not None  # what is doubted first is measured against itself, and passed on
            if _alone(self._before, values[k], values[k + 1], int(accepted.periods[k] + accepted.periods[k + 1])):
                out.append(Trouble("implausible", 1, int(accepted.t_us[k])))
            else:
                self._pass_on(accepted, values, k, k + 1, out)
            jumps[k + 1] = doubted[k + 1] and self._jumps(values[k + 1], int(accepted.periods[k + 1]))
            start = k + 1
        return out

    def _pass_on(self, accepted: Accepted, values: np.ndarray, start: int, stop: int, out: list) -> None:
        out.append(Chunk(accepted.t_us[start:stop], accepted.registers[start:stop]))
        self._before = values[stop - 1]

    def finish(self) -> list[Chunk | Trouble]:
        """Nothing more comes: a doubtful last sample stays doubtful and is left out."""
        held, self._held, self._before, self._doubt = self._held, None, None, 0
        return [Trouble("implausible", 1, held[0])] if held else []

    def _jumps(self, value: np.ndarray, periods: int) -> bool:
        return self._before is not None and bool((np.abs(value - self._before) > BAR * periods).any())

    def _judge(self, held: tuple[int, np.ndarray, int], following: np.ndarray, periods: int, out: list) -> None:
        t_us, value, own = held
        if self._before is not None and _alone(self._before, value, following, own + periods):
            out.append(Trouble("implausible", 1, t_us))
        else:
            out.append(Chunk(np.array([t_us], np.int64), value[None].astype(np.int16)))
            self._before = value


def _alone(before: np.ndarray, value: np.ndarray, behind: np.ndarray, periods: int) -> bool:
    """Whether some register goes out and back: beyond the bar on both sides, where those beside it agree."""
    out, back = value - before, behind - value
    far = np.minimum(np.abs(out), np.abs(back))
    return bool(((far > BAR * periods // 2) & (out * back < 0) & (np.abs(behind - before) < far // 2)).any())
