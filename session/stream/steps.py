"""Steps that no sensor makes: out and back within one sample, while the wire is bad.

A frame whose damage is confined to its registers can pass its CRC with the right number and stamp.  Then a register stands alone,
away from what is before and behind it, which agree.  A knock on the table can look so too, so a sample is doubted only where something
unreadable came among the samples shortly before; on a wire that spoils nothing, nothing passes a CRC by chance.
"""

from __future__ import annotations

import numpy as np

from session.stream.events import Chunk, Trouble
from session.stream.form import REGISTERS, Form
from session.stream.readings import Accepted

#: samples for which a wire is doubted after something unreadable
DOUBT = 1000


class StepFilter:
    """Passes samples on; holds a doubtful one until the next has come.  form: what the samples are, and which step is none of theirs."""

    def __init__(self, form: Form = REGISTERS) -> None:
        self._form, self._bars, self._type = form, form.bars, np.float64 if form.physical else np.int64
        self._doubt = 0  # samples still to be doubted
        self._before: np.ndarray | None = None  # (7,) the last sample passed on
        self._held: tuple[int, np.ndarray, int] | None = None  # t_us, registers, periods

    def take(self, accepted: Accepted) -> list[Chunk | Trouble]:
        """What is passed on, and what is left out."""
        if not (self._doubt or accepted.damaged.any()):
            self._before = accepted.registers[-1].astype(self._type)
            return [Chunk(accepted.t_us, accepted.registers, self._form)]
        count = len(accepted.t_us)
        last_damage = np.maximum.accumulate(np.where(accepted.damaged, np.arange(count), -count - DOUBT))
        doubted = (np.arange(count) - last_damage < DOUBT) | (np.arange(count) < self._doubt)
        self._doubt = max(0, self._doubt - count, DOUBT - int(count - last_damage[-1]))
        values = accepted.registers.astype(self._type)
        before = values[:1] if self._before is None else self._before[None]
        jumps = (np.abs(np.diff(values, axis=0, prepend=before)) > self._bars * accepted.periods[:, None]).any(axis=1) & doubted
        out: list[Chunk | Trouble] = []
        if self._held is not None:
            held, self._held = self._held, None
            self._judge(held, values[0], int(accepted.periods[0]), out)
            jumps[0] = doubted[0] and self._jumps(values[0], int(accepted.periods[0]))
        start = place = 0  # of what is not yet passed on, and of the next that jumps
        places = [*np.flatnonzero(jumps).tolist(), count]
        while start < count:
            while places[place] < start or (places[place] == start and not jumps[start]):
                place += 1
            k = start if jumps[start] else places[place]
            if k > start:
                self._pass_on(accepted, values, start, k, out)
            if k == count:
                break
            if k == count - 1:
                self._held = int(accepted.t_us[k]), values[k], int(accepted.periods[k])
                break
            assert self._before is not None  # what is doubted first is measured against itself, and passed on
            if _alone(self._before, values[k], values[k + 1], self._bars * int(accepted.periods[k] + accepted.periods[k + 1]) / 2):
                out.append(Trouble("implausible", 1, int(accepted.t_us[k])))
            else:
                self._pass_on(accepted, values, k, k + 1, out)
            jumps[k + 1] = doubted[k + 1] and self._jumps(values[k + 1], int(accepted.periods[k + 1]))
            start = k + 1
        return out

    def _pass_on(self, accepted: Accepted, values: np.ndarray, start: int, stop: int, out: list) -> None:
        out.append(Chunk(accepted.t_us[start:stop], accepted.registers[start:stop], self._form))
        self._before = values[stop - 1]

    def finish(self) -> list[Chunk | Trouble]:
        """Nothing more comes: a doubtful last sample stays doubtful and is left out."""
        held, self._held, self._before, self._doubt = self._held, None, None, 0
        return [Trouble("implausible", 1, held[0])] if held else []

    def _jumps(self, value: np.ndarray, periods: int) -> bool:
        return self._before is not None and bool((np.abs(value - self._before) > self._bars * periods).any())

    def _judge(self, held: tuple[int, np.ndarray, int], following: np.ndarray, periods: int, out: list) -> None:
        t_us, value, own = held
        if self._before is not None and _alone(self._before, value, following, self._bars * (own + periods) / 2):
            out.append(Trouble("implausible", 1, t_us))
        else:
            registers = value[None].astype(np.float64 if self._form.physical else np.int16)
            out.append(Chunk(np.array([t_us], np.int64), registers, self._form))
            self._before = value


def _alone(before: np.ndarray, value: np.ndarray, behind: np.ndarray, bars: np.ndarray) -> bool:
    """Whether some register goes out and back: beyond the bar on both sides, where those beside it agree."""
    out, back = value - before, behind - value
    far = np.minimum(np.abs(out), np.abs(back))
    half = far // 2 if far.dtype.kind == "i" else far / 2
    return bool(((far > bars) & (out * back < 0) & (np.abs(behind - before) < half)).any())
