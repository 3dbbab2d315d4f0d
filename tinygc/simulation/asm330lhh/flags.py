"""FIFO_STATUS2: what the FIFO's registers make of its level."""

from __future__ import annotations

from tinygc.simulation.asm330lhh import registers as reg
from tinygc.simulation.asm330lhh.batching import Batching
from tinygc.simulation.asm330lhh.fifo import Fifo


class FifoFlags:
    """Of a register file, a FIFO and what it is filled with."""

    def __init__(self, registers: bytearray, fifo: Fifo, batching: Batching):
        self._registers, self._fifo, self._batching = registers, fifo, batching

    @property
    def watermark(self) -> int:
        """Words."""
        return self._registers[reg.FIFO_CTRL1] | (self._registers[reg.FIFO_CTRL2] & 1) << 8

    @property
    def threshold(self) -> int:
        """Of COUNTER_BDR."""
        return (self._registers[reg.COUNTER_BDR_REG1] & 3) << 8 | self._registers[reg.COUNTER_BDR_REG2]

    def flags(self) -> int:
        """The bits above the two of the level."""
        fifo, watermark, threshold = self._fifo, self.watermark, self.threshold
        level = len(fifo.words)
        return (
            (reg.OVER_RUN_LATCHED if fifo.latched else 0)
            | (reg.COUNTER_BDR_IA if threshold and self._batching.counted >= threshold else 0)
            | (reg.FIFO_FULL_IA if fifo.collects and level + self._batching.most > fifo.limit else 0)
            | (reg.FIFO_OVR_IA if fifo.overrun else 0)
            | (reg.FIFO_WTM_IA if watermark and level >= watermark else 0)
        )
