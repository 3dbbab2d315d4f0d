"""Which words a time slot brings into the FIFO."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from tinygc.simulation.asm330lhh.faults import WORD_KINDS, Fault
from tinygc.simulation.asm330lhh.fifo import Fifo
from tinygc.simulation.asm330lhh.outputs import ACCEL as ACCEL_BYTES
from tinygc.simulation.asm330lhh.outputs import GYRO as GYRO_BYTES
from tinygc.simulation.asm330lhh.outputs import TEMP as TEMP_BYTES
from tinygc.simulation.asm330lhh.registers import (
    ACCEL,
    BDR_GY_COEFFICIENTS,
    COEFFICIENTS,
    CONFIG_CHANGE,
    GYRO,
    TEMPERATURE,
    TEMPERATURE_TICKS,
    TIMESTAMP,
    TIMESTAMP_DECIMATION,
    tag_byte,
    with_even_parity,
)

#: of the words in a slot
ORDER = (TIMESTAMP, TEMPERATURE, GYRO, ACCEL)


class Batching:
    """slot: ticks of the clock from one slot to the next, 0 where nothing is batched; most: words that a slot can bring;
    counted: batch events of the sensor that COUNTER_BDR watches."""

    def __init__(self, fifo: Fifo, faults: Iterable[Fault], order: tuple[int, ...] = ORDER):
        self._fifo, self._order = fifo, order
        self._faults = sorted((fault for fault in faults if fault.kind in WORD_KINDS), key=lambda fault: fault.at_s)
        self._left = self._faults[0].words if self._faults else 0
        self._held: bytes | None = None  # a word that changes places with the next
        self.slot = self.most = self.counted = 0
        self._ticks: dict[int, int] = {}
        self._watched = GYRO

    def set(self, ctrl3: int, ctrl4: int, gyro: int, accel: int, timestamps: bool, counts_accel: bool) -> None:
        """FIFO_CTRL3 and 4; gyro, accel: ticks of a sample, 0 where the sensor is off; counts_accel: what COUNTER_BDR watches."""
        ticks = {}
        for sensor, on, batched in (
            (GYRO, gyro, BDR_GY_COEFFICIENTS.get(ctrl3 >> 4)),
            (ACCEL, accel, COEFFICIENTS.get(ctrl3 & 15)),
        ):
            if on and batched:
                ticks[sensor] = max(on, batched)
        self.slot = min(ticks.values(), default=0)
        if self.slot:
            if temperature := TEMPERATURE_TICKS.get(ctrl4 >> 4 & 3):
                ticks[TEMPERATURE] = max(temperature, self.slot)
            if timestamps and (decimation := TIMESTAMP_DECIMATION.get(ctrl4 >> 6)):
                ticks[TIMESTAMP] = decimation * self.slot
        self._ticks = {sensor: ticks[sensor] for sensor in self._order if sensor in ticks}
        self.most = len(ticks)
        self._watched = ACCEL if counts_accel else GYRO

    def batch(self, tick: int, t_s: float, sample: bytes, timestamp: Callable[[float], int]) -> None:
        """The words of the slot at a tick, at that time."""
        fifo = self._fifo
        fifo.slot = fifo.slot + 1 & 3
        for sensor, ticks in self._ticks.items():
            if tick % ticks:
                continue
            if sensor == GYRO:
                data = sample[GYRO_BYTES]
            elif sensor == ACCEL:
                data = sample[ACCEL_BYTES]
            elif sensor == TEMPERATURE:
                data = sample[TEMP_BYTES] + b"\0\0\0\0"
            else:
                data = timestamp(t_s).to_bytes(4, "little") + b"\0\0"
            if sensor == self._watched:
                self.counted += 1
            self._put(fifo.word(sensor, data), t_s)

    def config_change(self, t_s: float) -> None:
        """The word that odrchg_en asks for."""
        self._put(self._fifo.word(CONFIG_CHANGE, bytes(6)), t_s)

    def _put(self, word: bytes, t_s: float) -> None:
        """Into the FIFO, spoilt where a fault is due."""
        if self._held is not None:
            held, self._held = self._held, None
            self._fifo.put(word)
            self._fifo.put(held)
            return
        if not self._faults or t_s < self._faults[0].at_s:
            self._fifo.put(word)
            return
        fault = self._faults[0]
        self._left -= 1
        if self._left <= 0:
            del self._faults[0]
            self._left = self._faults[0].words if self._faults else 0
        if fault.kind == "swapped":
            self._held = word
        elif fault.kind != "missing":
            self._fifo.put(bytes((_spoilt_tag(word[0], fault),)) + word[1:])


def _spoilt_tag(tag: int, fault: Fault) -> int:
    if fault.kind == "parity":
        return tag ^ 1
    if fault.kind == "tag_count":
        return with_even_parity(tag ^ 4)
    return tag_byte(fault.value, tag >> 1)
