"""The sensor in simulated time, with its SPI port."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from tinygc.annexes.emulated import readings as reg
from tinygc.annexes.emulated.fifo import EMPTY, Batching, Fifo, FifoFlags, Int1
from tinygc.annexes.emulated.readings import (
    ACCEL_OUT,
    FIFO_DATA_OUT_LAST,
    FIFO_DATA_OUT_TAG,
    FIFO_STATUS2,
    GYRO_OUT,
    OUT_FIRST,
    OUT_LAST,
    PORT_KINDS,
    TEMP,
    Fault,
    Motion,
    Oscillator,
    Outputs,
    Readings,
    SelfTest,
    Silicon,
    Timestamp,
)
from tinygc.annexes.emulated.settling import ACCEL_MASKED, GYRO_MASKED, LPF2_SAMPLES, Filters, Settling, lpf1_samples

# The sensor: its registers in simulated time.

START_S, SW_RESET_S = 0.010, 50e-6  #: after power-up and for a reboot; for a reset
TEMPERATURE_TICKS = 128  #: OUT_TEMP is new at 52 Hz, or at the data rate where that is lower
RATE_BITS = {reg.CTRL1_XL: 0xF0, reg.CTRL2_G: 0xF0, reg.FIFO_CTRL3: 0xFF}
NEVER = math.inf


class Made(NamedTuple):
    """One sample: its true time, the 14 bytes of the output registers, what was not settled or masked (bits of ``settling``), and the
    number of its grid: the clock of samples begins anew where both sensors were off, as behind each start-up and reset."""

    t_s: float
    registers: bytes
    unsettled: int
    grid: int


class Asm330lhh:
    """The model of the sensor; ``SensorPort`` connects it to SPI.  Times are s of true time and never decrease.

    motion: its input; identity: another than the chip's; keep: whether ``kept`` stores every sample; start_s: time from power-up, or an
    internal reset, until it answers; silicon: what no source settles.

    objections: a driver's errors that the map does not allow, each reported once; starts: number of start-ups; samples: number made.
    """

    def __init__(
        self,
        motion: Motion,
        oscillator: Oscillator | None = None,
        faults: Iterable[Fault] = (),
        self_test: SelfTest | None = None,
        identity: int | None = None,
        keep: bool = False,
        start_s: float = START_S,
        silicon: Silicon | None = None,
    ):
        self._motion, self._oscillator, self.silicon = motion, oscillator or Oscillator(), silicon or Silicon()
        self.chip = self.silicon.chip
        self._self_test, self._identity, self._keep = self_test or SelfTest(), self.chip.identity if identity is None else identity, keep
        self.faults, self._start_s = tuple(faults), start_s
        #: what happens by itself, next first
        self._events = sorted((fault for fault in self.faults if fault.kind in ("reset", "register")), key=lambda fault: fault.at_s)
        self._first_s = max((fault.at_s for fault in self.faults if fault.kind == "late"), default=0.0)
        self._identities = [fault for fault in self.faults if fault.kind == "identity"]
        self.fifo = Fifo(self.silicon.fifo_words, self.silicon.overrun_slots)
        self._batching = Batching(self.fifo, self.faults, self.silicon.order)
        self._registers = bytearray(128)
        self._flags = FifoFlags(self._registers, self.fifo, self._batching, self.chip.threshold_high)
        self.outputs = Outputs()
        self._pin = Int1(self._registers, self._flags, self.outputs, self.faults)
        self.objections: dict[str, None] = {}
        self.kept: list[Made] = []
        self.starts = self.samples = self._grid = 0
        self._stamps_off = self.silicon.stamps_off()
        self._gyro_code = 0  # odr_g that drives it; 0: off
        self._gyro_on_s = self._gyro_off_s = -NEVER
        self._start(0.0)

    def _start(self, t_s: float) -> None:
        """Power up."""
        self.starts += 1
        self._ready_s = max(t_s + self._start_s, self._first_s)
        self._boot_s = self._sw_reset_s = t_s
        self._defaults(t_s)

    def _defaults(self, t_s: float) -> None:
        """Set all registers to their values after a reset."""
        self._registers[:] = bytes(128)
        for address, value in reg.DEFAULTS.items():
            self._registers[address] = value
        self.outputs.clear()
        self.fifo.set_mode(0)
        self.fifo.limit = self.fifo.capacity
        self._batching.counted = 0
        self._readings: Readings | None = None  # of the sensors that are on
        self._gyro = self._accel = 0  # ticks of a sample; 0: off
        self._filters, self._lpf1, self._lpf2 = Filters(self.silicon), 0, 0  # samples of the filters
        if self._gyro_code:
            self._gyro_code, self._gyro_off_s = 0, t_s
        self._timestamp = Timestamp(self._oscillator, self._stamps_off)
        self._next_tick, self._next_s, self._sample_s = 0, NEVER, -NEVER

    # Time

    def advance(self, t_s: float) -> None:
        """Process all events up to a time."""
        while self._events and self._events[0].at_s <= t_s:
            fault = self._events.pop(0)
            self._run(fault.at_s)
            if fault.kind == "reset":
                self._start(fault.at_s)
            else:
                before = self._registers[fault.address]
                self._registers[fault.address] ^= fault.mask or reg.DEC_TS
                self._configure(fault.address, before, fault.at_s)
        if self._next_s <= t_s:
            self._run(t_s)

    def _run(self, t_s: float) -> None:
        readings, batching, fifo, outputs = self._readings, self._batching, self.fifo, self.outputs
        if readings is None:
            return
        gyro, accel, temp, slot = self._gyro, self._accel, max(TEMPERATURE_TICKS, readings.step), batching.slot
        collects = fifo.collects and slot
        tick, now_s = self._next_tick, self._next_s
        masks, until = bool(self._registers[reg.CTRL4_C] & reg.DRDY_MASK), self._filters.until
        while now_s <= t_s:
            words = sample = readings.at(tick)
            unsettled = 0
            if tick < until:
                sample, words, unsettled = self._filters.spoil(tick, sample, masks)
            if gyro and tick % gyro == 0 and not unsettled & GYRO_MASKED:
                outputs.update(GYRO_OUT, sample)
            if accel and tick % accel == 0 and not unsettled & ACCEL_MASKED:
                outputs.update(ACCEL_OUT, sample)
            if tick % temp == 0:
                outputs.update(TEMP, sample)
            if collects and tick % slot == 0:
                batching.batch(tick, now_s, words, self._timestamp.stamp)
            if self._keep:
                self.kept.append(Made(now_s, sample, unsettled, self._grid))
            self.samples += 1
            self._sample_s = now_s
            tick += readings.step
            now_s = readings.time_s(tick)
        self._next_tick, self._next_s = tick, now_s

    @property
    def _ticks_hz(self) -> float:
        """Frequency of the timestamp with the present registers."""
        counts = self._registers[reg.CTRL10_C] & reg.TIMESTAMP_EN
        return self._oscillator.ticks_hz(self._readings is not None) if counts else 0.0

    @property
    def clock_hz(self) -> float:
        """The true frequency of the sample clock, the highest rate."""
        return self._oscillator.clock_hz(self.silicon.ticks_per_period)

    # Registers

    def read(self, address: int, t_s: float) -> int:
        """Read one register at a time; 0 until the sensor has started up."""
        self.advance(t_s)
        if t_s < self._ready_s:
            return 0
        if reg.OUT_FIRST <= address <= reg.OUT_LAST:
            return self.outputs.read(address)
        if reg.FIFO_DATA_OUT_TAG <= address <= reg.FIFO_DATA_OUT_LAST:
            if address == reg.FIFO_DATA_OUT_TAG:
                return self.fifo.begin()[0]
            value = self.fifo.data()[address - reg.FIFO_DATA_OUT_TAG]
            if address == reg.FIFO_DATA_OUT_LAST:
                self.fifo.finish()
            return value
        if address == reg.WHO_AM_I:
            return next((fault.value for fault in self._identities if fault.holds(t_s)), self._identity)
        if address == reg.STATUS_REG:
            return self.outputs.status
        if address == reg.FIFO_STATUS1:
            return len(self.fifo.words) & 0xFF
        if address == reg.FIFO_STATUS2:
            status = self._flags.flags() | len(self.fifo.words) >> 8
            self.fifo.latched = False
            return status
        if reg.TIMESTAMP0 <= address <= reg.TIMESTAMP3:
            return self._timestamp.at(t_s) >> 8 * (address - reg.TIMESTAMP0) & 0xFF
        if address == reg.INTERNAL_FREQ_FINE:
            return (self._oscillator.fine_on if self._readings else self._oscillator.fine_off) & 0xFF
        value = self._registers[address]
        if address == reg.CTRL3_C:
            value |= (reg.SW_RESET if t_s < self._sw_reset_s else 0) | (reg.BOOT if t_s < self._boot_s else 0)
        return value

    def read_word(self, t_s: float) -> bytes:
        """Read a whole word of the FIFO, its tag at a time; zeros until the sensor has started up."""
        self.advance(t_s)
        if t_s < self._ready_s:
            return EMPTY
        word = self.fifo.begin()
        self.fifo.finish()
        return word

    @property
    def counts_up(self) -> bool:
        """Whether the port's address increments (if_inc)."""
        return bool(self._registers[reg.CTRL3_C] & reg.IF_INC)

    @property
    def cs_pull_up(self) -> bool:
        """Whether the sensor itself pulls the chip select up: not with I2C_DISABLE and DEVICE_CONF (I3C_disable) together."""
        return not (self._registers[reg.CTRL4_C] & reg.I2C_DISABLE and self._registers[reg.CTRL9_XL] & reg.DEVICE_CONF)

    def write(self, address: int, value: int, t_s: float) -> None:
        """Write one register at a time; ignored until the sensor has started up."""
        self.advance(t_s)
        if t_s < self._ready_s:
            self._object(f"0x{address:02X} was written before the sensor had started up")
            return
        if address == reg.TIMESTAMP2:
            if value == reg.TIMESTAMP_RESET:
                self._timestamp.set(0.0, t_s, self._ticks_hz)
            return
        writable = self.chip.writable
        if address not in writable:
            self._object(f"0x{address:02X} was written, which cannot be")
            return
        if reserved := value & ~writable[address]:
            self._object(f"reserved bits of 0x{address:02X} were written: 0x{reserved:02X}")
        if unknown := value & self.chip.unmodelled.get(address, 0):
            self._object(f"bits of 0x{address:02X} were set whose effect is not modelled: 0x{unknown:02X}")
        if address == reg.CTRL3_C and value & reg.SW_RESET:
            self._defaults(t_s)
            self._sw_reset_s = t_s + SW_RESET_S
            return
        if address == reg.CTRL3_C and value & reg.BOOT:
            self._boot_s = t_s + START_S
            value &= ~reg.BOOT
        before, self._registers[address] = self._registers[address], value & writable[address]
        self._configure(address, before, t_s)

    def _object(self, what: str) -> None:
        self.objections[what] = None

    def _configure(self, address: int, before: int, t_s: float) -> None:
        """Apply a written register."""
        r = self._registers
        if address == reg.CTRL3_C:
            self.outputs.set_bdu(bool(r[address] & reg.BDU))
        elif address == reg.CTRL10_C:
            if before ^ r[address]:
                self._timestamp.set(0.0, t_s, self._ticks_hz)
            self._set_batching()
        elif address == reg.COUNTER_BDR_REG1:
            if r[address] & reg.RST_COUNTER_BDR:
                self._batching.counted = 0
                r[address] &= ~reg.RST_COUNTER_BDR
            self._set_batching()
        elif address in (reg.CTRL1_XL, reg.CTRL2_G, reg.CTRL4_C, reg.CTRL5_C, reg.CTRL6_C, reg.CTRL8_XL):
            self._set_rates(t_s)
            self._say_change(before, address, t_s)
        elif reg.FIFO_CTRL1 <= address <= reg.FIFO_CTRL4:
            self.fifo.set_mode(r[reg.FIFO_CTRL4] & 7)
            stops = r[reg.FIFO_CTRL2] & reg.STOP_ON_WTM and self._flags.watermark
            self.fifo.limit = min(stops or self.fifo.capacity, self.fifo.capacity)
            self._set_batching()
            self._say_change(before, address, t_s)

    def _say_change(self, before: int, address: int, t_s: float) -> None:
        """Add a word for every new data or batch rate to the FIFO where odrchg_en is set."""
        changed = (before ^ self._registers[address]) & RATE_BITS.get(address, 0)
        if changed and self._registers[reg.FIFO_CTRL2] & reg.ODRCHG_EN and self.fifo.collects:
            self._batching.config_change(t_s)

    def _set_rates(self, t_s: float) -> None:
        r = self._registers
        ticks = self._timestamp.exact(t_s)
        gyro, accel = self._gyro, self._accel
        asleep = r[reg.CTRL4_C] & reg.SLEEP_G
        self._gyro = 0 if asleep else reg.COEFFICIENTS.get(r[reg.CTRL2_G] >> 4, 0)
        self._accel = reg.COEFFICIENTS.get(r[reg.CTRL1_XL] >> 4, 0)
        if r[reg.CTRL2_G] & 15 not in self.chip.gyro_mdps:
            self._object(f"fs_g {r[reg.CTRL2_G] & 15} is no full scale")
        for name, code in (("odr_g", r[reg.CTRL2_G] >> 4), ("odr_xl", r[reg.CTRL1_XL] >> 4)):
            if code and code not in reg.COEFFICIENTS:
                self._object(f"{name} {code} is no data rate")
        steps = [step for step in (self._gyro, self._accel) if step]
        if not steps:
            self._readings, self._next_s = None, NEVER
            self._filters = Filters(self.silicon)
        else:
            if self._readings is None:
                self._readings = Readings(self._motion, t_s, self.clock_hz, self._oscillator)
                self._grid += 1
            tests = r[reg.CTRL5_C]
            self._readings.set(
                min(steps),
                r[reg.CTRL2_G] & 15,
                r[reg.CTRL1_XL] >> 2 & 3,
                self._self_test.gyro(tests >> 2 & 3),
                self._self_test.accel(tests & 3),
            )
            self._next_tick = self._readings.after(t_s)
            self._next_s = self._readings.time_s(self._next_tick)
        self._drive_gyro(t_s)
        if self._readings:
            self._settle(self._readings, gyro, accel)
        self._timestamp.set(ticks, t_s, self._ticks_hz)
        self._set_batching()

    def _drive_gyro(self, t_s: float) -> None:
        """Switch the gyroscope's drive on or off; it goes on while the gyroscope sleeps."""
        code = self._registers[reg.CTRL2_G] >> 4
        if code and not self._gyro_code:
            self._gyro_on_s = t_s
            if t_s < self._gyro_off_s + self.silicon.gyro_off_s:
                least_ms = 1000 * self.silicon.gyro_off_s
                self._object(f"the gyroscope was switched on less than {least_ms:g} ms after it had been switched off")
        elif self._gyro_code and not code:
            self._gyro_off_s = t_s
        self._gyro_code = code

    def _settle(self, readings: Readings, gyro: int, accel: int) -> None:
        """Begin to settle where a rate or a filter has changed; gyro, accel: the ticks of a sample before."""
        r, filters = self._registers, self._filters
        lpf1, lpf2 = self._lpf1, self._lpf2
        self._lpf1 = lpf1_samples(r[reg.CTRL6_C] & 7, r[reg.CTRL2_G] >> 4) if r[reg.CTRL4_C] & reg.LPF1_SEL_G and self._gyro else 0
        self._lpf2 = LPF2_SAMPLES[r[reg.CTRL8_XL] >> 5] if r[reg.CTRL1_XL] & reg.LPF2_XL_EN and self._accel else 0
        if not self._gyro:
            filters.gyro = Settling()
        else:
            first = -(-self._next_tick // self._gyro) * self._gyro
            if self._gyro != gyro:
                on_for_s = readings.time_s(first) - self._gyro_on_s
                filters.set_gyro(first, r[reg.CTRL2_G] >> 4, on_for_s, self.clock_hz, self._lpf1)
            elif self._lpf1 != lpf1:
                filters.refilter_gyro(first, self._lpf1)
        if not self._accel:
            filters.accel = Settling()
        else:
            first = -(-self._next_tick // self._accel) * self._accel
            if self._accel != accel:
                filters.set_accel(first, self._accel, self._lpf2)
            elif self._lpf2 != lpf2:
                filters.refilter_accel(first, self._lpf2)

    def _set_batching(self) -> None:
        r = self._registers
        self._batching.set(
            r[reg.FIFO_CTRL3],
            r[reg.FIFO_CTRL4],
            self._gyro,
            self._accel,
            bool(r[reg.CTRL10_C] & reg.TIMESTAMP_EN),
            bool(r[reg.COUNTER_BDR_REG1] & reg.TRIG_COUNTER_BDR),
        )

    # The interrupt

    def int1(self, t_s: float) -> bool:
        """Return the level of the pin; low until the sensor has started up."""
        self.advance(t_s)
        return t_s >= self._ready_s and self._pin.level(t_s, t_s < self._boot_s, self._sample_s)

    def int1_stays_until(self, t_s: float) -> float:
        """Return a time before which the pin cannot change without an access to a register; infinite where it cannot change at all."""
        self.advance(t_s)
        ctrl, level = self._registers[reg.INT1_CTRL], len(self.fifo.words)
        edges = [self._ready_s, self._boot_s, *(fault.at_s for fault in self._events[:1]), *self._pin.edges_s(self._sample_s, self._next_s)]
        if ctrl & reg.INT1_FIFO_TH and level < self._flags.watermark:
            edges.append(self._slots_later(self._flags.watermark - level))
        if ctrl & (reg.INT1_FIFO_OVR | reg.INT1_FIFO_FULL):
            edges.append(self._slots_later(self.fifo.limit - self._batching.most - level))
        return min((edge for edge in edges if edge > t_s), default=NEVER)

    def _slots_later(self, words: int) -> float:
        """Return the earliest time at which so many more words can be there; infinite where nothing is batched."""
        if self._readings is None or not self.fifo.collects or not self._batching.slot:
            return NEVER
        slot = self._batching.slot
        first = -(-self._next_tick // slot) * slot
        slots = max(0, -(-words // self._batching.most) - 1)
        return self._readings.time_s(first + slots * slot)


# The sensor's SPI port: chip select, then an address with its read bit, then data.

READ = 0x80
WORD_BYTES = 7
#: reading these registers can clear the interrupt pin
CLEARING = {FIFO_DATA_OUT_LAST, FIFO_STATUS2, *range(OUT_FIRST, OUT_LAST + 1)}
HIGH = 0xFF  #: level of an undriven line


class SensorPort:
    """transactions, bytes: numbers transferred; rises: number of rising edges of INT1 while it is ``watched``."""

    def __init__(self, sensor: Asm330lhh):
        self.sensor = sensor
        self._faults = [fault for fault in sensor.faults if fault.kind in PORT_KINDS]
        self._selected, self._address, self._reads = False, -1, False
        self.transactions = self.bytes = self.rises = 0
        self.watched = self._pin = False

    def select(self, selected: bool, t_s: float) -> None:
        """Set the chip select."""
        self.sensor.advance(t_s)
        if selected and not self._selected:
            self.transactions += 1
            self._address = -1
        self._selected = selected

    def int1(self, t_s: float) -> bool:
        """Return the level of the interrupt's pin."""
        before, self._pin = self._pin, self.sensor.int1(t_s)
        self.rises += self._pin and not before
        return self._pin

    def int1_stays_until(self, t_s: float) -> float:
        """Return a time before which it cannot change without a transfer."""
        return self.sensor.int1_stays_until(t_s)

    def transfer(self, out: bytes, t_s: float, byte_s: float) -> bytes:
        """Send bytes to the sensor, the first at a time, each with a duration; return its answer."""
        if not self._selected:
            return bytes([HIGH]) * len(out)
        self.bytes += len(out)
        answers, place = bytearray(), 0
        while place < len(out):
            if self._bursts and len(out) - place >= WORD_BYTES:
                answers += self.sensor.read_word(t_s + place * byte_s)
                place += WORD_BYTES
                if self.watched:
                    self.int1(t_s + (place - 1) * byte_s)
            else:
                answers.append(self._exchange(out[place], t_s + place * byte_s))
                place += 1
        return bytes(answers)

    @property
    def _bursts(self) -> bool:
        """Whether a whole word of the FIFO comes next, and nothing can come between its bytes."""
        return self._address == FIFO_DATA_OUT_TAG and self._reads and not self._faults and self.sensor.counts_up

    def _exchange(self, byte: int, t_s: float) -> int:
        fault = next((fault.kind for fault in self._faults if fault.holds(t_s)), "") if self._faults else ""
        if fault == "hang":
            self.sensor.advance(t_s)
            return HIGH
        answer = self._answer(byte, t_s)
        return {"zeros": 0x00, "ones": HIGH}.get(fault, answer) if fault else answer

    def _answer(self, byte: int, t_s: float) -> int:
        address = self._address
        if address < 0:
            self._address, self._reads = byte & ~READ, bool(byte & READ)
            return HIGH
        answer = HIGH
        if self._reads:
            answer = self.sensor.read(address, t_s)
            if self.watched and address in CLEARING:
                self.int1(t_s)
        else:
            self.sensor.write(address, byte, t_s)
        if self.sensor.counts_up:
            self._address = FIFO_DATA_OUT_TAG if self._reads and address == FIFO_DATA_OUT_LAST else address + 1 & 0x7F
        return answer
