"""INT1: what lets it rise."""

from __future__ import annotations

from collections.abc import Iterable

from tinygc.simulation.asm330lhh import registers as reg
from tinygc.simulation.asm330lhh.faults import Fault
from tinygc.simulation.asm330lhh.flags import FifoFlags
from tinygc.simulation.asm330lhh.outputs import Outputs

DRDY_PULSE_S = 75e-6


class Int1:
    """Of a register file, the FIFO's flags, the output registers, and faults."""

    def __init__(self, registers: bytearray, flags: FifoFlags, outputs: Outputs, faults: Iterable[Fault]):
        self._registers, self._flags, self._outputs = registers, flags, outputs
        self._dead = [fault for fault in faults if fault.kind == "int1"]

    def level(self, t_s: float, booting: bool, sample_s: float) -> bool:
        """Of the pin at a time; sample_s: when the last sample was made."""
        if any(fault.holds(t_s) for fault in self._dead):
            return False
        r, ctrl, flags = self._registers, self._registers[reg.INT1_CTRL], self._flags.flags()
        pulsed = r[reg.COUNTER_BDR_REG1] & reg.DATAREADY_PULSED
        ready = 0 if pulsed and t_s >= sample_s + DRDY_PULSE_S else self._outputs.status
        active = (
            (ctrl & reg.INT1_DRDY_XL and ready & reg.XLDA)
            or (ctrl & reg.INT1_DRDY_G and ready & reg.GDA)
            or (ctrl & reg.INT1_BOOT and booting)
            or (ctrl & reg.INT1_FIFO_TH and flags & reg.FIFO_WTM_IA)
            or (ctrl & reg.INT1_FIFO_OVR and flags & reg.FIFO_OVR_IA)
            or (ctrl & reg.INT1_FIFO_FULL and flags & reg.FIFO_FULL_IA)
            or (ctrl & reg.INT1_CNT_BDR and flags & reg.COUNTER_BDR_IA)
        )
        return bool(active) != bool(r[reg.CTRL3_C] & reg.H_LACTIVE)

    def edges_s(self, sample_s: float, next_s: float) -> list[float]:
        """Times of faults, and of data-ready between two samples, at which it may change."""
        edges = [edge for fault in self._dead for edge in (fault.at_s, fault.at_s + fault.lasts_s)]
        if self._registers[reg.INT1_CTRL] & (reg.INT1_DRDY_XL | reg.INT1_DRDY_G | reg.INT1_CNT_BDR):
            edges += [next_s, sample_s + DRDY_PULSE_S]
        return edges
