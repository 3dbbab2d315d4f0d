"""The ASM330LHH in simulated time, or its sibling LSM6DSO: registers, samples, FIFO, and its SPI port."""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

# The register map: addresses, writable bits, reset values, and the meaning of the codes.

FIFO_CTRL1, FIFO_CTRL2, FIFO_CTRL3, FIFO_CTRL4, WHO_AM_I = 0x07, 0x08, 0x09, 0x0A, 0x0F
CTRL1_XL, CTRL2_G, CTRL3_C, CTRL4_C, CTRL5_C, CTRL10_C, STATUS_REG = 0x10, 0x11, 0x12, 0x13, 0x14, 0x19, 0x1E
OUT_FIRST, OUT_LAST, FIFO_STATUS1, FIFO_STATUS2 = 0x20, 0x2D, 0x3A, 0x3B
INTERNAL_FREQ_FINE, FIFO_DATA_OUT_TAG, FIFO_DATA_OUT_LAST = 0x63, 0x78, 0x7E

#: address -> bits with a name in the ASM330LHH's map: all others are reserved, and stay 0
WRITABLE = {0x02: 0xFF, 0x07: 0xFF, 0x08: 0x91, 0x09: 0xFF, 0x0A: 0xF7, 0x0B: 0xE3, 0x0C: 0xFF, 0x0D: 0xFF, 0x0E: 0xFF, 0x10: 0xFE}
WRITABLE |= {0x11: 0xFF, 0x12: 0xFD, 0x13: 0x6E, 0x14: 0x6F, 0x15: 0xEF, 0x16: 0x72, 0x17: 0xFD, 0x18: 0xFE, 0x19: 0x20}
#: reset values other than 0
DEFAULTS = {0x02: 0x3F, CTRL3_C: 0x04, 0x18: 0xE0}
SW_RESET, IF_INC, BOOT = 1 << 0, 1 << 2, 1 << 7  # CTRL3_C
DRDY_MASK, SLEEP_G, TIMESTAMP_EN = 1 << 3, 1 << 6, 1 << 5
XLDA, GDA = 1, 2  # STATUS_REG
LATCHED, OVERRUN, WATERMARK = 1 << 3, 1 << 6, 1 << 7  # FIFO_STATUS2
CONTINUOUS = 6  #: the FIFO's mode; every other one empties it here

#: ticks of the 6667 Hz clock in a sample, by code of odr_xl, odr_g, bdr_xl, bdr_gy
COEFFICIENTS = {code: 1 << (10 - code) for code in range(1, 11)}
#: by code of odr_t_batch; OUT_TEMP is not modelled but in the FIFO
TEMPERATURE_TICKS = {1: 4096, 2: 512, 3: 128}
#: fs_g -> mdps/LSB, fs_xl -> mg/LSB
GYRO_MDPS = {2: 4.375, 0: 8.75, 4: 17.5, 8: 35.0, 12: 70.0, 1: 140.0}
ACCEL_MG = {0: 0.061, 2: 0.122, 3: 0.244, 1: 0.488}
STANDARD_GRAVITY, TEMPERATURE_LSB, TEMPERATURE_ZERO_C = 9.80665, 256.0, 25.0
GYRO, ACCEL, TEMPERATURE, TIMESTAMP = 1, 2, 3, 4  # tags
TICKS_HZ, FINE_STEP = 40000.0, 0.0015  #: of the timestamp; a step of INTERNAL_FREQ_FINE

START_S, SW_RESET_S = 0.010, 50e-6  #: after power-up; for a reset
#: by ST's Linux driver: a gyroscope must stay off for so long before it is on again; its output is not settled for so long and so many
#: samples from off to on, the accelerometer's for so many.  The filters beyond are not modelled.
GYRO_OFF_S, GYRO_ON_S, GYRO_SAMPLES, ACCEL_SAMPLES = 0.010, 0.070, 3, 2
MASKED, WRONG_LSB = 0x7FFD, 4096  #: what DRDY_MASK puts into the FIFO for an unsettled value; by how much it is off without
GYRO_UNSETTLED, ACCEL_UNSETTLED = 1, 2
NEVER = math.inf


class Chip(NamedTuple):
    name: str
    identity: int
    writable: dict[int, int]
    gyro_mdps: dict[int, float]


ASM330LHH = Chip("ASM330LHH", 0x6B, WRITABLE, GYRO_MDPS)
#: no 4000 dps; what else it has and the driver does not use counts as reserved
LSM6DSO = Chip("LSM6DSO", 0x6C, WRITABLE | {CTRL2_G: 0xFE}, {code: mdps for code, mdps in GYRO_MDPS.items() if code != 1})
CHIPS = {chip.name: chip for chip in (ASM330LHH, LSM6DSO)}


@dataclass(frozen=True)
class Silicon:
    """What a chip may do and no public source settles: ticks of the timestamp in a period of the highest rate, 40000/6667 or 6; by up to so
    many ticks a stamp in the FIFO is off, either way, but none is before the last; words that the FIFO holds.  settles: else at once."""

    ticks_per_period: float = 6.0
    stamp_jitter_ticks: int = 0
    fifo_words: int = 438
    chip: Chip = ASM330LHH
    settles: bool = True


#: t_s (N,) s -> rate (N, 3) rad/s, specific force (N, 3) m/s^2, temperature (N,) degC, all including the sensor's errors
Motion = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


class AtRest:
    """A sensor that lies level."""

    def __call__(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        n = len(t_s)
        return np.zeros((n, 3)), np.tile([0.0, 0.0, STANDARD_GRAVITY], (n, 1)), np.full(n, TEMPERATURE_ZERO_C)


PORT_KINDS, WORD_KINDS = ("zeros", "ones", "hang"), ("parity", "tag_unknown", "missing")
KINDS = (*PORT_KINDS, *WORD_KINDS, "reset", "register", "rate", "late", "identity")


@dataclass(frozen=True)
class Fault:
    """One fault at ``at_s`` of the sensor's time.

    zeros, ones   its line reads 0x00 or 0xFF for ``duration_s``; writes arrive
    hang          it neither receives nor answers for ``duration_s`` (reads 0xFF), and continues to measure
    parity, tag_unknown, missing   the next word of the FIFO has a false parity, a tag that is none, or never comes
    reset         it restarts by itself
    register      the bits ``mask`` of the register ``address`` flip by themselves
    rate          words are batched at half the rate for ``duration_s``, and the registers read as they were set
    late          it answers for the first time at that moment after power-up
    identity      WHO_AM_I reads another part's for ``duration_s``
    """

    kind: str
    at_s: float
    duration_s: float = NEVER
    address: int = FIFO_CTRL4
    mask: int = 1 << 6  #: the timestamps in the FIFO cease

    def __post_init__(self) -> None:
        assert self.kind in KINDS

    def holds(self, t_s: float) -> bool:
        return self.at_s <= t_s < self.at_s + self.duration_s


@dataclass(frozen=True)
class Oscillator:
    """fine_off, fine_on: INTERNAL_FREQ_FINE while both sensors are off, and while one is on."""

    fine_off: int = 0
    fine_on: int = 0

    def ticks_hz(self, on: bool = True) -> float:
        """The frequency of the timestamp: 40 kHz, typically."""
        return TICKS_HZ * (1 + FINE_STEP * (self.fine_on if on else self.fine_off))


class Made(NamedTuple):
    """One sample: its true time, the 14 bytes of the output registers, which sensor was not settled, and the number of its grid: the clock
    of samples begins again where both sensors were off, as behind each start-up and reset."""

    t_s: float
    registers: bytes
    unsettled: int
    grid: int


class Readings:
    """int16 registers at every ``step``-th tick of a clock that begins at zero_s, computed in blocks of ``BLOCK``."""

    BLOCK, BLOCK_S, BYTES = 256, 0.25, 14

    def __init__(self, motion: Motion, zero_s: float, clock_hz: float):
        self._motion, self._zero_s, self._clock_hz = motion, zero_s, clock_hz
        self.step, self._first, self._data = 1, 0, b""

    def set(self, step: int, dps: float, mg: float, added_dps: float, added_mg: float) -> None:
        """Change the settings from the next sample on: an LSB of each sensor, and what the self-test adds."""
        self.step, self._settings, self._data = step, (dps, mg, added_dps, added_mg), b""

    def time_s(self, tick):
        return self._zero_s + tick / self._clock_hz

    def after(self, t_s: float) -> int:
        """The first tick with a sample after a time."""
        tick = max(self.step, int((t_s - self._zero_s) * self._clock_hz) // self.step * self.step)
        while self.time_s(tick) <= t_s:
            tick += self.step
        return tick

    def at(self, tick: int) -> bytes:
        """The 14 bytes of the output registers; ticks must be requested in increasing order."""
        place = (tick - self._first) // self.step * self.BYTES
        if place < 0 or place >= len(self._data):
            ticks = tick + self.step * np.arange(max(1, min(self.BLOCK, int(self.BLOCK_S * self._clock_hz / self.step))))
            self._first, place = tick, 0
            rate, force, temp_c = self._motion(self.time_s(ticks))
            dps, mg, added_dps, added_mg = self._settings
            temp = (temp_c - TEMPERATURE_ZERO_C) * TEMPERATURE_LSB
            table = np.column_stack([temp, (np.degrees(rate) + added_dps) / dps, (force * (1000 / STANDARD_GRAVITY) + added_mg) / mg])
            self._data = np.clip(np.rint(table), -32768, 32767).astype("<i2").tobytes()
        return self._data[place : place + self.BYTES]


def with_even_parity(byte: int) -> int:
    return byte & 0xFE | (byte & 0xFE).bit_count() & 1


class Fifo:
    """words: unread, oldest first, of seven bytes; capacity: largest number of them, of which the oldest go first.

    lost: words that were not read in time; overrun: one was lost and no room has been made since; latched: an overrun since the last read.
    """

    def __init__(self, capacity: int) -> None:
        self.words: deque[bytes] = deque()
        self.capacity, self.lost, self._begun = capacity, 0, b""
        self.clear()

    def clear(self) -> None:
        self.words.clear()
        self.overrun = self.latched = False

    def put(self, word: bytes) -> None:
        self.words.append(word)
        if len(self.words) > self.capacity:
            self.words.popleft()
            self.lost += 1
            self.overrun = self.latched = True

    def begin(self) -> bytes:
        """The word to be read next, zeros where there is none; it is kept from the reading of its tag on."""
        self._begun = self.words[0] if self.words else bytes(7)
        return self._begun

    def data(self) -> bytes:
        """The word whose tag was read last."""
        return self._begun or self.begin()

    def finish(self) -> None:
        """Remove the word after its last byte was read, unless an overrun has removed it."""
        if self.words and self.words[0] is self._begun:
            self.words.popleft()
            self.overrun = False
        self._begun = b""


class Asm330lhh:
    """The model of the sensor; ``SensorPort`` connects it to SPI.  Times are s of true time and never decrease.

    motion: its input; keep: whether ``kept`` stores every sample.  Its self-test adds 400 dps and 500 mg.

    objections: a driver's errors that the map does not allow, each reported once; written: (address, value) in their order.
    """

    def __init__(self, motion: Motion, oscillator: Oscillator | None = None, faults: Iterable[Fault] = (), keep: bool = False,
                 silicon: Silicon | None = None):  # fmt: skip
        self._motion, self._oscillator, self.silicon = motion, oscillator or Oscillator(), silicon or Silicon()
        self.chip, self._keep, self.faults = self.silicon.chip, keep, tuple(faults)
        #: what happens by itself, next first
        self._events = sorted((fault for fault in self.faults if fault.kind in ("reset", "register")), key=lambda fault: fault.at_s)
        self._words_spoilt = sorted((fault for fault in self.faults if fault.kind in WORD_KINDS), key=lambda fault: fault.at_s)
        self._lasting = [fault for fault in self.faults if fault.kind in ("identity", "rate")]
        self._first_s = max((fault.at_s for fault in self.faults if fault.kind == "late"), default=0.0)
        self.fifo = Fifo(self.silicon.fifo_words)
        self._registers = bytearray(128)
        self.objections: dict[str, None] = {}
        self.written: list[tuple[int, int]] = []
        self.kept: list[Made] = []
        self._grid, self._slot_count, self._draw, self._last_stamp = 0, 0, random.Random(0), 0
        self._gyro_driven, self._gyro_on_s, self._gyro_off_s = False, -NEVER, -NEVER
        self.clock_hz = self._oscillator.ticks_hz() / self.silicon.ticks_per_period
        self._start(0.0)

    def _start(self, t_s: float) -> None:
        """Power up."""
        self._ready_s = max(t_s + START_S, self._first_s)
        self._defaults(t_s)

    def _defaults(self, t_s: float) -> None:
        """Set all registers to their values after a reset."""
        self._registers[:] = bytes(128)
        for address, value in DEFAULTS.items():
            self._registers[address] = value
        self._newest, self._latch, self._status = bytes(Readings.BYTES), 0, 0
        self.fifo.clear()
        self._readings: Readings | None = None  # of the sensors that are on
        self._gyro = self._accel = 0  # ticks of a sample; 0: off
        self._gyro_settles = self._accel_settles = 0  # the tick from which on each has settled
        if self._gyro_driven:
            self._gyro_driven, self._gyro_off_s = False, t_s
        self._ticks, self._ticks_since_s, self._ticks_hz = 0.0, 0.0, 0.0
        self._next_tick, self._next_s, self._reset_s = 0, NEVER, t_s
        self._set_batching()

    # Time

    def advance(self, t_s: float) -> None:
        """Process all events up to a time."""
        while self._events and self._events[0].at_s <= t_s:
            fault = self._events.pop(0)
            self._run(fault.at_s)
            if fault.kind == "reset":
                self._start(fault.at_s)
            else:
                self._registers[fault.address] ^= fault.mask
                self._configure(fault.address, fault.at_s)
        if self._next_s <= t_s:
            self._run(t_s)

    def _run(self, t_s: float) -> None:
        readings = self._readings
        if readings is None:
            return
        tick, now_s = self._next_tick, self._next_s
        until = max(self._gyro_settles, self._accel_settles)
        while now_s <= t_s:
            sample = words = readings.at(tick)
            unsettled = 0
            if tick < until:
                sample, words, unsettled = self._unsettled(tick, sample)
            self._newest = sample
            if self._gyro and tick % self._gyro == 0 and not (unsettled & GYRO_UNSETTLED and words is not sample):
                self._status |= GDA
            if self._accel and tick % self._accel == 0 and not (unsettled & ACCEL_UNSETTLED and words is not sample):
                self._status |= XLDA
            if self._slot and tick % self._slot == 0:
                self._batch(tick, now_s, words)
            if self._keep:
                self.kept.append(Made(now_s, sample, unsettled, self._grid))
            tick += readings.step
            now_s = readings.time_s(tick)
        self._next_tick, self._next_s = tick, now_s

    def _unsettled(self, tick: int, sample: bytes) -> tuple[bytes, bytes, int]:
        """The 14 bytes of the outputs, those that the FIFO gets, and which sensor is not settled."""
        values = np.frombuffer(sample, "<i2").astype(int)
        masks, bits = values.copy(), 0
        for until, place, bit in ((self._gyro_settles, slice(1, 4), GYRO_UNSETTLED), (self._accel_settles, slice(4, 7), ACCEL_UNSETTLED)):
            if tick < until:
                bits |= bit
                values[place] -= WRONG_LSB
                masks[place] = MASKED
        outputs = values.clip(-32768, 32767).astype("<i2").tobytes()
        return outputs, masks.astype("<i2").tobytes() if self._registers[CTRL4_C] & DRDY_MASK else outputs, bits

    def _batch(self, tick: int, t_s: float, sample: bytes) -> None:
        """Add the words of the slot at a tick to the FIFO, at that time."""
        if self._lasting and tick // self._slot & 1 and any(fault.kind == "rate" and fault.holds(t_s) for fault in self._lasting):
            return
        self._slot_count = self._slot_count + 1 & 3
        for sensor, ticks in self._batched:
            if tick % ticks:
                continue
            if sensor == TIMESTAMP:
                off = self.silicon.stamp_jitter_ticks and self._draw.randint(
                    -self.silicon.stamp_jitter_ticks, self.silicon.stamp_jitter_ticks
                )
                self._last_stamp = max(self._last_stamp, math.floor(self._stamp(t_s) + 1e-6) + off)
                data = (self._last_stamp % 2**32).to_bytes(4, "little") + b"\0\0"
            else:
                data = {GYRO: sample[2:8], ACCEL: sample[8:14], TEMPERATURE: sample[:2] + b"\0\0\0\0"}[sensor]
            tag = with_even_parity(sensor << 3 | self._slot_count << 1)
            if self._words_spoilt and self._words_spoilt[0].at_s <= t_s:
                kind = self._words_spoilt.pop(0).kind
                if kind == "missing":
                    continue
                tag = tag ^ 1 if kind == "parity" else with_even_parity(31 << 3 | self._slot_count << 1)
            self.fifo.put(bytes((tag,)) + data)

    def _stamp(self, t_s: float) -> float:
        """The counter of 25 us at a time, with its fraction."""
        return self._ticks + (t_s - self._ticks_since_s) * self._ticks_hz

    def _set_stamp(self, ticks: float, t_s: float) -> None:
        """Set the counter, and its rate from then on; it stays at 0 until it is switched on."""
        counts = self._registers[CTRL10_C] & TIMESTAMP_EN
        self._ticks, self._ticks_since_s = ticks, t_s
        self._ticks_hz = self._oscillator.ticks_hz(self._readings is not None) if counts else 0.0
        if not ticks:
            self._last_stamp = 0

    # Registers

    def read(self, address: int, t_s: float) -> int:
        """Read one register at a time; 0 until the sensor has started up."""
        self.advance(t_s)
        if t_s < self._ready_s:
            return 0
        if OUT_FIRST <= address <= OUT_LAST:
            place = address - OUT_FIRST
            if place % 2:  # the high byte belongs to the low one that was read before (BDU)
                self._status &= ~(XLDA if place > 7 else GDA if place > 1 else 0)
                return self._latch
            self._latch = self._newest[place + 1]
            return self._newest[place]
        if FIFO_DATA_OUT_TAG <= address <= FIFO_DATA_OUT_LAST:
            if address == FIFO_DATA_OUT_TAG:
                return self.fifo.begin()[0]
            value = self.fifo.data()[address - FIFO_DATA_OUT_TAG]
            if address == FIFO_DATA_OUT_LAST:
                self.fifo.finish()
            return value
        if address == WHO_AM_I:
            other = any(fault.kind == "identity" and fault.holds(t_s) for fault in self._lasting)
            return 31 if other else self.chip.identity
        if address == STATUS_REG:
            return self._status
        if address == FIFO_STATUS1:
            return len(self.fifo.words) & 0xFF
        if address == FIFO_STATUS2:
            fifo, watermark, level = self.fifo, self._registers[FIFO_CTRL1] | (self._registers[FIFO_CTRL2] & 1) << 8, len(self.fifo.words)
            flags = LATCHED * fifo.latched | OVERRUN * fifo.overrun | WATERMARK * (0 < watermark <= level)
            fifo.latched = False
            return flags | level >> 8
        if address == INTERNAL_FREQ_FINE:
            return (self._oscillator.fine_on if self._readings else self._oscillator.fine_off) & 0xFF
        return self._registers[address] | (SW_RESET if address == CTRL3_C and t_s < self._reset_s else 0)

    def read_word(self, t_s: float) -> bytes:
        """Read a whole word of the FIFO, its tag at a time."""
        self.advance(t_s)
        if t_s < self._ready_s:
            return bytes(7)
        word = self.fifo.begin()
        self.fifo.finish()
        return word

    @property
    def counts_up(self) -> bool:
        """Whether the port's address increments (if_inc)."""
        return bool(self._registers[CTRL3_C] & IF_INC)

    def write(self, address: int, value: int, t_s: float) -> None:
        """Write one register at a time; ignored until the sensor has started up."""
        self.advance(t_s)
        self.written.append((address, value))
        writable = self.chip.writable.get(address, 0)
        if t_s < self._ready_s:
            self.objections[f"0x{address:02X} was written before the sensor had started up"] = None
            return
        if reserved := value & ~writable:
            self.objections[f"reserved bits of 0x{address:02X} were written: 0x{reserved:02X}"] = None
        if address == CTRL3_C and value & SW_RESET:
            self._defaults(t_s)
            self._reset_s = t_s + SW_RESET_S
        elif writable:
            self._registers[address] = value & writable & ~(BOOT if address == CTRL3_C else 0)
            self._configure(address, t_s)

    def _configure(self, address: int, t_s: float) -> None:
        """Apply a written register."""
        if address == CTRL10_C:
            self._set_stamp(0.0, t_s)
        elif address in (CTRL1_XL, CTRL2_G, CTRL4_C, CTRL5_C):
            self._set_rates(t_s)
        elif address == FIFO_CTRL4 and self._registers[address] & 7 != CONTINUOUS:
            self.fifo.clear()
        self._set_batching()

    def _set_rates(self, t_s: float) -> None:
        r, ticks, before = self._registers, self._stamp(t_s), (self._gyro, self._accel)
        self._gyro = 0 if r[CTRL4_C] & SLEEP_G else COEFFICIENTS.get(r[CTRL2_G] >> 4, 0)
        self._accel = COEFFICIENTS.get(r[CTRL1_XL] >> 4, 0)
        if r[CTRL2_G] & 15 not in self.chip.gyro_mdps:
            self.objections[f"fs_g {r[CTRL2_G] & 15} is no full scale"] = None
        steps = [step for step in (self._gyro, self._accel) if step]
        self._drive_gyro(t_s)
        if not steps:
            self._readings, self._next_s, self._gyro_settles, self._accel_settles = None, NEVER, 0, 0
        else:
            if self._readings is None:
                self._readings = Readings(self._motion, t_s, self.clock_hz)
                self._grid += 1
            dps = self.chip.gyro_mdps.get(r[CTRL2_G] & 15, GYRO_MDPS[0]) / 1000
            added_dps, added_mg = {1: 400.0, 3: -400.0}.get(r[CTRL5_C] >> 2 & 3, 0.0), {1: 500.0, 2: -500.0}.get(r[CTRL5_C] & 3, 0.0)
            self._readings.set(min(steps), dps, ACCEL_MG[r[CTRL1_XL] >> 2 & 3], added_dps, added_mg)
            self._next_tick = self._readings.after(t_s)
            self._next_s = self._readings.time_s(self._next_tick)
            self._settle(before)
        self._set_stamp(ticks, t_s)

    def _drive_gyro(self, t_s: float) -> None:
        """Switch the gyroscope's drive on or off; it goes on while the gyroscope sleeps."""
        on = bool(self._registers[CTRL2_G] >> 4)
        if on and not self._gyro_driven:
            self._gyro_on_s = t_s
            if t_s < self._gyro_off_s + GYRO_OFF_S:
                self.objections["the gyroscope was switched on less than 10 ms after it had been switched off"] = None
        elif self._gyro_driven and not on:
            self._gyro_off_s = t_s
        self._gyro_driven = on

    def _settle(self, before: tuple[int, int]) -> None:
        """Begin to settle where a rate has changed; before: the ticks of a sample of both."""
        if not self.silicon.settles or self._readings is None:
            return
        if self._gyro and self._gyro != before[0]:
            driven = math.ceil((self._gyro_on_s + GYRO_ON_S - self._readings.time_s(0)) * self.clock_hz)
            first = -(-max(self._next_tick, driven) // self._gyro) * self._gyro
            self._gyro_settles = first + GYRO_SAMPLES * self._gyro
        if self._accel and self._accel != before[1]:
            self._accel_settles = -(-self._next_tick // self._accel) * self._accel + ACCEL_SAMPLES * self._accel

    def _set_batching(self) -> None:
        """slot: ticks of the clock from one slot of the FIFO to the next, 0 where nothing is batched."""
        r = self._registers
        codes = ((GYRO, self._gyro, r[FIFO_CTRL3] >> 4), (ACCEL, self._accel, r[FIFO_CTRL3] & 15))
        ticks = {sensor: max(on, COEFFICIENTS[code]) for sensor, on, code in codes if on and code in COEFFICIENTS}
        self._slot = min(ticks.values(), default=0) if r[FIFO_CTRL4] & 7 == CONTINUOUS else 0
        if r[FIFO_CTRL4] >> 4 & 3:
            ticks[TEMPERATURE] = max(TEMPERATURE_TICKS[r[FIFO_CTRL4] >> 4 & 3], self._slot)
        if r[CTRL10_C] & TIMESTAMP_EN and r[FIFO_CTRL4] >> 6 == 1:
            ticks[TIMESTAMP] = self._slot
        self._batched = [(sensor, ticks[sensor]) for sensor in (TIMESTAMP, TEMPERATURE, GYRO, ACCEL) if sensor in ticks]


# The sensor's SPI port: chip select, then an address with its read bit, then data.

READ, WORD_BYTES, HIGH = 0x80, 7, 0xFF  #: high: level of an undriven line


class SensorPort:
    """A device on the bus."""

    def __init__(self, sensor: Asm330lhh):
        self.sensor = sensor
        self._faults = [fault for fault in sensor.faults if fault.kind in PORT_KINDS]
        self._selected, self._address, self._reads = False, -1, False

    def select(self, selected: bool, t_s: float) -> None:
        """Set the chip select."""
        self.sensor.advance(t_s)
        if selected and not self._selected:
            self._address = -1
        self._selected = selected

    def transfer(self, out: bytes, t_s: float, byte_s: float) -> bytes:
        """Send bytes to the sensor, the first at a time, each with a duration; return its answer."""
        if not self._selected:
            return bytes([HIGH]) * len(out)
        answers = bytearray()
        while (place := len(answers)) < len(out):
            whole = self._address == FIFO_DATA_OUT_TAG and self._reads and not self._faults and self.sensor.counts_up
            if whole and len(out) - place >= WORD_BYTES:  # nothing can come between its bytes
                answers += self.sensor.read_word(t_s + place * byte_s)
            else:
                answers.append(self._exchange(out[place], t_s + place * byte_s))
        return bytes(answers)

    def _exchange(self, byte: int, t_s: float) -> int:
        fault = next((fault.kind for fault in self._faults if fault.holds(t_s)), "")
        if fault == "hang":
            return HIGH
        answer = self._answer(byte, t_s)
        return {"zeros": 0x00, "ones": HIGH}.get(fault, answer)

    def _answer(self, byte: int, t_s: float) -> int:
        address, answer = self._address, HIGH
        if address < 0:
            self._address, self._reads = byte & ~READ, bool(byte & READ)
            return HIGH
        if self._reads:
            answer = self.sensor.read(address, t_s)
        else:
            self.sensor.write(address, byte, t_s)
        if self.sensor.counts_up:
            self._address = FIFO_DATA_OUT_TAG if self._reads and address == FIFO_DATA_OUT_LAST else address + 1 & 0x7F
        return answer
