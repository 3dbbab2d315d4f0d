"""The FIFO: words of seven bytes, the words of each time slot, its status, the interrupt."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from tinygc.annexes.emulated import readings
from tinygc.annexes.emulated.readings import (
    ACCEL,
    BDR_GY_COEFFICIENTS,
    COEFFICIENTS,
    CONFIG_CHANGE,
    GYRO,
    ORDER,
    TEMPERATURE,
    TEMPERATURE_TICKS,
    TIMESTAMP,
    TIMESTAMP_DECIMATION,
    WORD_KINDS,
    Fault,
    Outputs,
    tag_byte,
    with_even_parity,
)
from tinygc.annexes.emulated.readings import ACCEL_OUT as ACCEL_BYTES
from tinygc.annexes.emulated.readings import GYRO_OUT as GYRO_BYTES
from tinygc.annexes.emulated.readings import TEMP as TEMP_BYTES

# The FIFO: words of seven bytes, a tag and six of data.

EMPTY = bytes(7)
BYPASS, UNTIL_FULL, TO_FIFO, CONTINUOUS = 0, 1, 3, 6
TAG_CNT = 0b110


class Fifo:
    """words: unread, oldest first; capacity: largest number of them; mode, limit (the same or a watermark): as the registers set them;
    whole_slots: whether a full FIFO loses whole time slots.

    lost: words that were not read in time; overrun: one was lost and no room has been made since; latched: an overrun since the last read.
    """

    def __init__(self, capacity: int, whole_slots: bool = False) -> None:
        self.words: deque[bytes] = deque()
        self.mode, self.limit, self.capacity, self._whole_slots = BYPASS, capacity, capacity, whole_slots
        self.slot = 0
        self._begun = b""
        self.lost = 0
        self.overrun = self.latched = False

    @property
    def collects(self) -> bool:
        """Whether words are stored at all."""
        return self.mode in (UNTIL_FULL, TO_FIFO, CONTINUOUS)

    def set_mode(self, mode: int) -> None:
        """Set the mode; bypass, or an equivalent mode, empties the FIFO."""
        self.mode = mode
        if not self.collects:
            self.clear()

    def clear(self) -> None:
        """Empty the FIFO and clear the overrun; TAG_CNT continues."""
        self.words.clear()
        self.overrun = self.latched = False

    def word(self, sensor: int, data: bytes) -> bytes:
        """Return seven bytes of the present time slot."""
        return bytes((tag_byte(sensor, self.slot),)) + data

    def put(self, word: bytes) -> None:
        """Append a word; in a full FIFO the oldest is dropped (continuous), alone or with its time slot, or this one."""
        if len(self.words) < self.limit:
            self.words.append(word)
            return
        self.overrun = self.latched = True
        if self.mode == UNTIL_FULL:
            self.lost += 1
            return
        before = len(self.words) + 1
        self.words.append(word)
        while len(self.words) > self.limit:
            slot = self.words.popleft()[0] & TAG_CNT
            while self._whole_slots and len(self.words) > 1 and self.words[0][0] & TAG_CNT == slot:
                self.words.popleft()
        self.lost += before - len(self.words)

    def begin(self) -> bytes:
        """Return the word to be read next, zeros where there is none, and keep it from the reading of its tag on."""
        self._begun = self.words[0] if self.words else EMPTY
        return self._begun

    def data(self) -> bytes:
        """Return the word whose tag was read last."""
        return self._begun or self.begin()

    def finish(self) -> None:
        """Remove the word after its last byte was read, unless an overrun has removed it."""
        if self.words and self.words[0] is self._begun:
            self.words.popleft()
            self.overrun = False
        self._begun = b""


# The words that each time slot adds to the FIFO.

#: pairs of bits of a tag
PAIRS = [1 << low | 1 << high for high in range(8) for low in range(high)]


class Batching:
    """slot: ticks of the clock from one slot to the next, 0 where nothing is batched; most: largest number of words in a slot;
    counted: batch events of the sensor that COUNTER_BDR counts."""

    def __init__(self, fifo: Fifo, faults: tuple[Fault, ...], order: tuple[int, ...] = ORDER):
        self._fifo, self._order = fifo, order
        self._faults = sorted((fault for fault in faults if fault.kind in WORD_KINDS), key=lambda fault: fault.at_s)
        self._halved = [fault for fault in faults if fault.kind == "rate"]
        self._pairs = self._left = self._spared = 0
        self._next_fault()
        self._held: bytes | None = None  # a word to be swapped with the next
        self.slot = self.most = self.counted = 0
        self._ticks: dict[int, int] = {}
        self._watched = ACCEL

    def _next_fault(self) -> None:
        if self._faults:
            self._left, self._spared = self._faults[0].words, self._faults[0].spared

    def set(self, ctrl3: int, ctrl4: int, gyro: int, accel: int, timestamps: bool, counts_gyro: bool) -> None:
        """Apply FIFO_CTRL3 and 4; gyro, accel: ticks of a sample, 0 where the sensor is off; counts_gyro: what COUNTER_BDR counts."""
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
        self._watched = GYRO if counts_gyro else ACCEL

    def batch(self, tick: int, t_s: float, sample: bytes, timestamp: Callable[[float], int]) -> None:
        """Add the words of the slot at a tick, at that time."""
        if self._halved and tick // self.slot & 1 and any(fault.holds(t_s) for fault in self._halved):
            return
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
        """Add the word that odrchg_en requests."""
        self._put(self._fifo.word(CONFIG_CHANGE, bytes(6)), t_s)

    def _put(self, word: bytes, t_s: float) -> None:
        """Append to the FIFO, corrupted where a fault is due."""
        if self._held is not None:
            held, self._held = self._held, None
            self._fifo.put(word)
            self._fifo.put(held)
            return
        if not self._faults or t_s < self._faults[0].at_s:
            self._fifo.put(word)
            return
        if self._spared:
            self._spared -= 1
            self._fifo.put(word)
            return
        fault = self._faults[0]
        self._left -= 1
        if self._left <= 0:
            del self._faults[0]
            self._next_fault()
        if fault.kind == "swapped":
            self._held = word
        elif fault.kind != "missing":
            self._fifo.put(bytes((self._spoilt_tag(word[0], fault),)) + word[1:])

    def _spoilt_tag(self, tag: int, fault: Fault) -> int:
        if fault.kind == "parity":
            return tag ^ 1
        if fault.kind == "tag_count":
            return with_even_parity(tag ^ 4)
        if fault.kind == "tag_pair":
            self._pairs += 1
            return tag ^ (fault.mask or PAIRS[(self._pairs - 1) % len(PAIRS)])
        return tag_byte(fault.value, tag >> 1)


# FIFO_STATUS2, from the level of the FIFO and its settings.


class FifoFlags:
    """Status flags from a register file, a FIFO and its batching; threshold_high: a chip's."""

    def __init__(self, registers: bytearray, fifo: Fifo, batching: Batching, threshold_high: int):
        self._registers, self._fifo, self._batching, self._high = registers, fifo, batching, threshold_high

    @property
    def watermark(self) -> int:
        """Watermark in words."""
        return self._registers[readings.FIFO_CTRL1] | (self._registers[readings.FIFO_CTRL2] & 1) << 8

    @property
    def threshold(self) -> int:
        """Threshold of COUNTER_BDR."""
        return (self._registers[readings.COUNTER_BDR_REG1] & self._high) << 8 | self._registers[readings.COUNTER_BDR_REG2]

    def flags(self) -> int:
        """Return the bits above the two of the level."""
        fifo, watermark, threshold = self._fifo, self.watermark, self.threshold
        level = len(fifo.words)
        return (
            (readings.OVER_RUN_LATCHED if fifo.latched else 0)
            | (readings.COUNTER_BDR_IA if threshold and self._batching.counted >= threshold else 0)
            | (readings.FIFO_FULL_IA if fifo.collects and level + self._batching.most > fifo.limit else 0)
            | (readings.FIFO_OVR_IA if fifo.overrun else 0)
            | (readings.FIFO_WTM_IA if watermark and level >= watermark else 0)
        )


# INT1: the sources of the interrupt.

DRDY_PULSE_S = 75e-6


class Int1:
    """Interrupt pin from a register file, the FIFO's flags, the output registers, and faults."""

    def __init__(self, registers: bytearray, flags: FifoFlags, outputs: Outputs, faults: Iterable[Fault]):
        self._registers, self._flags, self._outputs = registers, flags, outputs
        self._dead = [fault for fault in faults if fault.kind == "int1"]

    def level(self, t_s: float, booting: bool, sample_s: float) -> bool:
        """Return the pin's level at a time; sample_s: time of the last sample."""
        if any(fault.holds(t_s) for fault in self._dead):
            return False
        r, ctrl, flags = self._registers, self._registers[readings.INT1_CTRL], self._flags.flags()
        pulsed = r[readings.COUNTER_BDR_REG1] & readings.DATAREADY_PULSED
        ready = 0 if pulsed and t_s >= sample_s + DRDY_PULSE_S else self._outputs.status
        active = (
            (ctrl & readings.INT1_DRDY_XL and ready & readings.XLDA)
            or (ctrl & readings.INT1_DRDY_G and ready & readings.GDA)
            or (ctrl & readings.INT1_BOOT and booting)
            or (ctrl & readings.INT1_FIFO_TH and flags & readings.FIFO_WTM_IA)
            or (ctrl & readings.INT1_FIFO_OVR and flags & readings.FIFO_OVR_IA)
            or (ctrl & readings.INT1_FIFO_FULL and flags & readings.FIFO_FULL_IA)
            or (ctrl & readings.INT1_CNT_BDR and flags & readings.COUNTER_BDR_IA)
        )
        return bool(active) != bool(r[readings.CTRL3_C] & readings.H_LACTIVE)

    def edges_s(self, sample_s: float, next_s: float) -> list[float]:
        """Return the times at which it may change between two samples, through faults and data-ready."""
        edges = [edge for fault in self._dead for edge in (fault.at_s, fault.at_s + fault.lasts_s)]
        if self._registers[readings.INT1_CTRL] & (readings.INT1_DRDY_XL | readings.INT1_DRDY_G | readings.INT1_CNT_BDR):
            edges += [next_s, sample_s + DRDY_PULSE_S]
        return edges
