"""The register map, the sensor's input, and the int16 registers at the true sample times."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

# The register map: addresses, writable bits, reset values, and the meaning of the codes.

PIN_CTRL = 0x02
FIFO_CTRL1, FIFO_CTRL2, FIFO_CTRL3, FIFO_CTRL4 = 0x07, 0x08, 0x09, 0x0A
COUNTER_BDR_REG1, COUNTER_BDR_REG2 = 0x0B, 0x0C
INT1_CTRL, INT2_CTRL = 0x0D, 0x0E
WHO_AM_I = 0x0F
CTRL1_XL, CTRL2_G, CTRL3_C, CTRL4_C, CTRL5_C = 0x10, 0x11, 0x12, 0x13, 0x14
CTRL6_C, CTRL7_G, CTRL8_XL, CTRL9_XL, CTRL10_C = 0x15, 0x16, 0x17, 0x18, 0x19
STATUS_REG = 0x1E
OUT_TEMP_L, OUTX_L_G, OUTX_L_A = 0x20, 0x22, 0x28
OUT_FIRST, OUT_LAST = 0x20, 0x2D
FIFO_STATUS1, FIFO_STATUS2 = 0x3A, 0x3B
TIMESTAMP0, TIMESTAMP2, TIMESTAMP3 = 0x40, 0x42, 0x43
INTERNAL_FREQ_FINE = 0x63
X_OFS_USR, Y_OFS_USR, Z_OFS_USR = 0x73, 0x74, 0x75
FIFO_DATA_OUT_TAG, FIFO_DATA_OUT_LAST = 0x78, 0x7E

TIMESTAMP_RESET = 0xAA

#: address -> bits with a name in the ASM330LHH's map: all others are reserved, and stay 0
WRITABLE = {
    PIN_CTRL: 0xFF,
    FIFO_CTRL1: 0xFF,
    FIFO_CTRL2: 0b1001_0001,
    FIFO_CTRL3: 0xFF,
    FIFO_CTRL4: 0b1111_0111,
    COUNTER_BDR_REG1: 0b1110_0011,
    COUNTER_BDR_REG2: 0xFF,
    INT1_CTRL: 0xFF,
    INT2_CTRL: 0xFF,
    CTRL1_XL: 0b1111_1110,
    CTRL2_G: 0xFF,
    CTRL3_C: 0b1111_1101,
    CTRL4_C: 0b0110_1110,
    CTRL5_C: 0b0110_1111,
    CTRL6_C: 0b1110_1111,
    CTRL7_G: 0b0111_0010,
    CTRL8_XL: 0b1111_1101,
    CTRL9_XL: 0b1111_1110,
    CTRL10_C: 0b0010_0000,
    X_OFS_USR: 0xFF,
    Y_OFS_USR: 0xFF,
    Z_OFS_USR: 0xFF,
}
#: reset values other than 0
DEFAULTS = {PIN_CTRL: 0x3F, CTRL3_C: 0x04, CTRL9_XL: 0xE0}

# CTRL3_C
SW_RESET, IF_INC, H_LACTIVE, BDU, BOOT = 1 << 0, 1 << 2, 1 << 5, 1 << 6, 1 << 7
# CTRL1_XL, CTRL4_C, CTRL9_XL
LPF2_XL_EN = 1 << 1
LPF1_SEL_G, I2C_DISABLE, DRDY_MASK, SLEEP_G = 1 << 1, 1 << 2, 1 << 3, 1 << 6
DEVICE_CONF = 1 << 1  # I3C_disable of the LSM6DSO
TIMESTAMP_EN = 1 << 5  # CTRL10_C
ODRCHG_EN, STOP_ON_WTM = 1 << 4, 1 << 7  # FIFO_CTRL2
DATAREADY_PULSED = 1 << 7  # COUNTER_BDR_REG1
RST_COUNTER_BDR, TRIG_COUNTER_BDR = 1 << 6, 1 << 5
# INT1_CTRL
INT1_DRDY_XL, INT1_DRDY_G, INT1_BOOT = 1 << 0, 1 << 1, 1 << 2
INT1_FIFO_TH, INT1_FIFO_OVR, INT1_FIFO_FULL, INT1_CNT_BDR = 1 << 3, 1 << 4, 1 << 5, 1 << 6
# STATUS_REG
XLDA, GDA, TDA = 1, 2, 4
# FIFO_STATUS2
OVER_RUN_LATCHED, COUNTER_BDR_IA, FIFO_FULL_IA, FIFO_OVR_IA, FIFO_WTM_IA = 1 << 3, 1 << 4, 1 << 5, 1 << 6, 1 << 7

#: ticks of the 6667 Hz clock in a sample, by code of odr_xl, odr_g, bdr_xl, bdr_gy
COEFFICIENTS = {code: 1 << (10 - code) for code in range(1, 11)}
BDR_GY_COEFFICIENTS = COEFFICIENTS | {11: 1024}
#: by code of odr_t_batch and of dec_ts_batch
TEMPERATURE_TICKS = {1: 4096, 2: 512, 3: 128}
TIMESTAMP_DECIMATION = {1: 1, 2: 8, 3: 32}

#: fs_g -> mdps/LSB, fs_xl -> mg/LSB
GYRO_MDPS = {2: 4.375, 0: 8.75, 4: 17.5, 8: 35.0, 12: 70.0, 1: 140.0}
ACCEL_MG = {0: 0.061, 2: 0.122, 3: 0.244, 1: 0.488}
TEMPERATURE_LSB, TEMPERATURE_ZERO_C = 256.0, 25.0

# Tags
GYRO, ACCEL, TEMPERATURE, TIMESTAMP, CONFIG_CHANGE = 1, 2, 3, 4, 5

#: the highest rate by its name, the timestamp's, and a step of INTERNAL_FREQ_FINE
CLOCK_HZ, TICKS_HZ, FINE_STEP = 6667.0, 40000.0, 0.0015


def with_even_parity(byte: int) -> int:
    """Set bit 0 of a tag byte such that its number of ones is even."""
    byte &= 0xFE
    return byte | byte.bit_count() & 1


def tag_byte(sensor: int, count: int) -> int:
    """Return parity, TAG_CNT in bits 2:1, TAG_SENSOR in bits 7:3."""
    return with_even_parity((sensor & 31) << 3 | (count & 3) << 1)


# The parts of the family, and what their documents leave open.


@dataclass(frozen=True)
class Chip:
    """A part, by ST's header of its registers.

    writable: address -> bits with a name; unmodelled: address -> those whose effect the model does not have; gyro_mdps: fs_g ->
    mdps/LSB; threshold_high: the high bits of CNT_BDR_TH in COUNTER_BDR_REG1.
    """

    name: str
    identity: int
    writable: dict[int, int]
    unmodelled: dict[int, int]
    gyro_mdps: dict[int, float]
    threshold_high: int


ASM330LHH = Chip("ASM330LHH", 0x6B, WRITABLE, {}, GYRO_MDPS, 0b11)
#: OIS, low-power modes, compression of the FIFO
_LSM6DSO_MORE = {FIFO_CTRL2: 0b0100_0110, CTRL5_C: 0b1000_0000, CTRL6_C: 0b0001_0000, CTRL7_G: 0b1000_0101, CTRL8_XL: 0b0000_0010}
LSM6DSO = Chip(
    "LSM6DSO",
    0x6C,
    WRITABLE
    | {address: WRITABLE[address] | bits for address, bits in _LSM6DSO_MORE.items()}
    | {CTRL2_G: 0b1111_1110, COUNTER_BDR_REG1: 0b1110_0111},
    _LSM6DSO_MORE,
    {code: mdps for code, mdps in GYRO_MDPS.items() if code != 1},
    0b111,
)
CHIPS = {chip.name: chip for chip in (ASM330LHH, LSM6DSO)}

#: order of the words in a time slot of the FIFO
ORDER = (TIMESTAMP, TEMPERATURE, GYRO, ACCEL)
JITTERS = ("uniform", "alternating", "blocks", "late")
LONGEST_BLOCK = 128  #: stamps in a row that are off by the same, where the jitter comes in blocks


@dataclass(frozen=True)
class Silicon:
    """What a chip may do and no public source settles, or sources state in two ways; docs/emulated-board.md has the sources.

    ticks_per_period: ticks of the timestamp in a period of the highest rate, 40000/6667 or 6; both have one oscillator.
    stamp_jitter_ticks: a stamp in the FIFO is off by up to so many ticks, but none is before the last; jitter, of ``JITTERS``: uniform
    either way; by all of them, to either side in turn; by all of them, to one side for a block of 1 to 128 stamps; uniform, but only late.
    order: of the words in a time slot, by their tags.
    fifo_words: capacity of the FIFO, words of seven bytes; overrun_slots: whether a full one loses its oldest time slot, or only a word.
    settling: factor on all settling times; 0: settled at once.
    mask_covers_all: whether DRDY_MASK masks the gyroscope's LPF1 and the accelerometer's LPF2, too.
    mask_first: whether the samples of the discard table are counted behind those that the mask covers, or run together with them.
    gyro_off_s: shortest time that a gyroscope must stay off before it is switched on again.
    chip: whose map it has; seed: of the jitter.

    Raises ValueError for what no chip can be.
    """

    ticks_per_period: float = 6.0
    stamp_jitter_ticks: int = 0
    jitter: str = "uniform"
    order: tuple[int, ...] = ORDER
    fifo_words: int = 438
    overrun_slots: bool = False
    settling: float = 1.0
    mask_covers_all: bool = False
    mask_first: bool = False
    gyro_off_s: float = 0.010
    chip: Chip = ASM330LHH
    seed: int = 0

    def __post_init__(self) -> None:
        if not 4 <= self.fifo_words <= 1023:
            raise ValueError(f"fifo_words {self.fifo_words}: expected 4, a time slot, to 1023, what ten bits can say")
        if self.ticks_per_period <= 0 or min(self.stamp_jitter_ticks, self.settling, self.gyro_off_s) < 0:
            raise ValueError(f"{self}: expected times and counts that are not negative, and ticks_per_period above 0")
        if self.jitter not in JITTERS:
            raise ValueError(f"jitter {self.jitter!r}: expected one of {', '.join(JITTERS)}")
        if sorted(self.order) != sorted(ORDER):
            raise ValueError(f"order {self.order}: expected the tags {ORDER} in any order")

    def stamps_off(self) -> Iterator[int]:
        """By how many ticks each stamp in turn is off."""
        draw, most = random.Random(self.seed), self.stamp_jitter_ticks
        while True:
            if self.jitter == "uniform":
                yield draw.randint(-most, most)
            elif self.jitter == "alternating":
                yield from (most, -most)
            elif self.jitter == "blocks":
                yield from [draw.choice((-most, most))] * draw.randint(1, LONGEST_BLOCK)
            else:
                yield draw.randint(0, most)


# The sensor's input as a function of true time.

#: t_s (N,) s -> rate (N, 3) rad/s, specific force (N, 3) m/s^2, temperature (N,) degC, all including the sensor's errors
Motion = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]

STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True)
class AtRest:
    """Constant input: level by default."""

    rate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    force: tuple[float, float, float] = (0.0, 0.0, STANDARD_GRAVITY)
    temp_c: float = 25.0

    def __call__(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rate, force and temperature at these times."""
        n = len(t_s)
        return np.tile(self.rate, (n, 1)), np.tile(self.force, (n, 1)), np.full(n, self.temp_c)


@dataclass(frozen=True, eq=False)
class Sampled:
    """Values at increasing times, interpolated linearly and constant outside.

    t_s (N,) s, rate (N, 3) rad/s, force (N, 3) m/s^2, temp_c (N,) degC.
    """

    t_s: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    temp_c: np.ndarray

    def __call__(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rate, force and temperature at these times."""
        rate, force = (
            np.column_stack([np.interp(t_s, self.t_s, table[:, axis]) for axis in range(3)]) for table in (self.rate, self.force)
        )
        return rate, force, np.interp(t_s, self.t_s, self.temp_c)


# Faults of a sensor, and their times.

#: faults of the port: the line is stuck, though the sensor receives; or it neither receives nor answers, and the line is pulled up
PORT_KINDS = ("zeros", "ones", "hang")
#: faults of the FIFO's words
WORD_KINDS = ("parity", "tag_count", "tag_unknown", "tag_pair", "swapped", "missing")
KINDS = (*PORT_KINDS, *WORD_KINDS, "reset", "register", "rate", "late", "identity", "int1")
DEC_TS = 1 << 6  #: the bit of FIFO_CTRL4 that ``register`` flips by default


@dataclass(frozen=True)
class Fault:
    """One fault at ``at_s`` of the sensor's time.

    kind:
      zeros, ones   the sensor's line reads 0x00 or 0xFF for ``lasts_s``; writes arrive
      hang          the sensor neither receives nor answers for ``lasts_s`` (reads 0xFF), and continues to measure
      parity        the next ``words`` words in the FIFO have a false parity bit
      tag_count     their TAG_CNT is two too high, with correct parity
      tag_unknown   their tag is ``value`` (31 by default), with correct parity
      tag_pair      two bits of their tag are flipped, those of ``mask``, or each pair in its turn: the parity stays even
      swapped       the next word is swapped with the one after it
      missing       they never reach the FIFO
      reset         the sensor restarts by itself
      register      the bits ``mask`` of the register ``address`` flip by themselves (by default the timestamps in the FIFO cease)
      rate          words are batched at half the rate for ``lasts_s``, and the registers read as they were set
      late          the sensor answers for the first time at that moment after power-up
      identity      WHO_AM_I reads ``value`` for ``lasts_s``
      int1          the interrupt's pin stays low for ``lasts_s``

    Raises ValueError for an unknown kind, a register that cannot be written, and bits that are none of it.
    """

    kind: str
    at_s: float
    lasts_s: float = math.inf
    words: int = 1
    value: int = 31
    address: int = FIFO_CTRL4
    mask: int = 0  #: 0: the kind's own
    spared: int = 0  #: words from ``at_s`` on that nothing happens to; 0 hits the first of a time slot, as a rule the timestamp

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"no fault {self.kind!r}; there are {', '.join(KINDS)}")
        if self.address not in WRITABLE:
            raise ValueError(f"{self.kind}: 0x{self.address:02X} is no register that can be written")
        if self.mask and self.kind not in ("register", "tag_pair"):
            raise ValueError(f"{self.kind}: bits are of register and tag_pair only")
        if self.kind == "tag_pair" and self.mask.bit_count() not in (0, 2):
            raise ValueError(f"tag_pair: 0x{self.mask:02X} is not two bits")

    @classmethod
    def parse(cls, text: str) -> Fault:
        """Parse ``KIND@S``, with ``+S`` for the duration, ``xN`` for the number of words, and ``:ADDRESS`` and ``^BITS``, both hexadecimal,
        behind the kind: ``hang@20+0.5``, ``parity@10x3``, ``register:09^77@20``.  Raises ValueError for other text."""
        form = re.fullmatch(
            r"(\w+)(?::([\da-fA-F]{1,2}))?(?:\^([\da-fA-F]{1,2}))?@(\d+\.?\d*|\.\d+)(?:\+(\d+\.?\d*|\.\d+))?(?:x(\d+))?", text.strip()
        )
        if not form:
            raise ValueError(f"{text!r} is no fault; expected KIND@S, KIND@S+S or KIND@SxN, as in parity@10x3")
        kind, address, mask, at_s, lasts_s, words = form.groups()
        if address and kind != "register":
            raise ValueError(f"{text!r}: an address is of register only")
        place = int(address, 16) if address else FIFO_CTRL4
        return cls(
            kind,
            float(at_s),
            float(lasts_s) if lasts_s else math.inf,
            int(words or 1),
            address=place,
            mask=int(mask or "0", 16),
        )

    def holds(self, t_s: float) -> bool:
        """Whether the fault lasts at that time."""
        return self.at_s <= t_s < self.at_s + self.lasts_s


# The counter of 25 us.


class Timestamp:
    """Counter of an oscillator that stays at 0 until ``set``, and then counts at a rate that may change; off: by how many ticks each
    further stamp is off."""

    def __init__(self, oscillator: Oscillator, off: Iterator[int]) -> None:
        self._ticks, self._since_s, self._hz = 0.0, 0.0, 0.0
        self._oscillator, self._off, self._last = oscillator, off, 0

    def exact(self, t_s: float) -> float:
        """Return the ticks at a time, with their fraction."""
        return self._ticks + (self._oscillator.elapsed_s(t_s) - self._since_s) * self._hz

    def at(self, t_s: float) -> int:
        """Return the 32 bits at a time, including a tick that is due then."""
        return math.floor(self.exact(t_s) + 1e-6) % 2**32

    def stamp(self, t_s: float) -> int:
        """Return the 32 bits that the FIFO gets at a time: never less than the last."""
        self._last = max(self._last, math.floor(self.exact(t_s) + 1e-6) + next(self._off))
        return self._last % 2**32

    def set(self, ticks: float, t_s: float, hz: float) -> None:
        """Set the ticks at a time, and the rate from then on."""
        self._ticks, self._since_s, self._hz = ticks, self._oscillator.elapsed_s(t_s), hz
        if not ticks:
            self._last = 0


# The true sample times, and the int16 registers at each of them.

BLOCK, BLOCK_S = 256, 0.25  #: samples computed at once, and their longest duration
Number = TypeVar("Number", float, np.ndarray)
REGISTER_BYTES = 14  #: temperature, gyroscope, accelerometer: 0x20 to 0x2D


@dataclass(frozen=True)
class Oscillator:
    """fine_off, fine_on: INTERNAL_FREQ_FINE while both sensors are off, and while one is on; residual_ppm: excess of the true frequency
    over the one that the register states, at the beginning, and drift_ppm_s, by which it rises; rate and ticks have it in common."""

    fine_off: int = 0
    fine_on: int = 0
    residual_ppm: float = 0.0
    drift_ppm_s: float = 0.0

    def factor(self, on: bool) -> float:
        """Ratio of the true frequency to the typical one."""
        return (1 + FINE_STEP * (self.fine_on if on else self.fine_off)) * (1 + 1e-6 * self.residual_ppm)

    def elapsed_s(self, t_s: Number) -> Number:
        """Return the time since the beginning as the oscillator counts it, at its first frequency; t_s: true, a number or an array."""
        return t_s * (1 + 0.5e-6 * self.drift_ppm_s * t_s)

    def true_s(self, elapsed_s: Number) -> Number:
        """Return the true time at which it counts so much: the inverse."""
        return 2 * elapsed_s / (1 + (1 + 2e-6 * self.drift_ppm_s * elapsed_s) ** 0.5)

    def clock_hz(self, ticks_per_period: float = Silicon.ticks_per_period) -> float:
        """Return the frequency of the sample clock, the highest rate: that of the timestamp over so many of its ticks."""
        return self.ticks_hz(True) / ticks_per_period

    def ticks_hz(self, on: bool) -> float:
        """Return the frequency of the timestamp: 40 kHz, typically."""
        return TICKS_HZ * self.factor(on)


@dataclass(frozen=True)
class SelfTest:
    """Signals that the self-test actuators add to every axis."""

    gyro_dps: float = 400.0
    accel_mg: float = 500.0

    def gyro(self, code: int) -> float:
        """Return the rate in dps that st_g adds."""
        return {1: self.gyro_dps, 3: -self.gyro_dps}.get(code, 0.0)

    def accel(self, code: int) -> float:
        """Return the force in mg that st_xl adds."""
        return {1: self.accel_mg, 2: -self.accel_mg}.get(code, 0.0)


def to_registers(
    rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray, fs_g: int, fs_xl: int, added_dps: float = 0.0, added_mg: float = 0.0
) -> np.ndarray:
    """(N, 7) int16, temperature, gyroscope, accelerometer, in the order of the map; values beyond a register's range are clipped.

    rate (N, 3) rad/s, force (N, 3) m/s^2, temp_c (N,) degC; fs_g, fs_xl: the codes of the full scales.  An undefined code of fs_g
    reads as 250 dps (code 0).
    """
    gyro = (np.degrees(rate) + added_dps) * (1000 / GYRO_MDPS.get(fs_g, GYRO_MDPS[0]))
    accel = (force * (1000 / STANDARD_GRAVITY) + added_mg) / ACCEL_MG[fs_xl]
    temp = (temp_c - TEMPERATURE_ZERO_C) * TEMPERATURE_LSB
    table = np.rint(np.column_stack([temp, gyro, accel]))
    return np.clip(table, -32768, 32767).astype("<i2")


class Readings:
    """Samples at every ``step``-th tick of an oscillator's clock, computed in blocks."""

    def __init__(self, motion: Motion, zero_s: float, clock_hz: float, oscillator: Oscillator):
        self._motion, self._oscillator, self._zero_s, self.clock_hz = motion, oscillator, oscillator.elapsed_s(zero_s), clock_hz
        self._settings: tuple[int, int, float, float] = (0, 0, 0.0, 0.0)
        self.step = 1
        self._first, self._data = 0, b""

    def set(self, step: int, fs_g: int, fs_xl: int, added_dps: float, added_mg: float) -> None:
        """Change the settings from the next sample on."""
        self.step, self._settings, self._data = step, (fs_g, fs_xl, added_dps, added_mg), b""

    def time_s(self, tick: Number) -> Number:
        """Return the time of a tick of the clock, or of an array of them."""
        return self._oscillator.true_s(self._zero_s + tick / self.clock_hz)

    def after(self, t_s: float) -> int:
        """Return the first tick with a sample after a time."""
        tick = int((self._oscillator.elapsed_s(t_s) - self._zero_s) * self.clock_hz) // self.step * self.step
        while self.time_s(tick) <= t_s or tick <= 0:
            tick += self.step
        return tick

    def at(self, tick: int) -> bytes:
        """Return the 14 bytes of the output registers at a tick with a sample; ticks must be requested in increasing order."""
        place = (tick - self._first) // self.step * REGISTER_BYTES
        if place < 0 or place >= len(self._data):
            ticks = tick + self.step * np.arange(max(1, min(BLOCK, int(BLOCK_S * self.clock_hz / self.step))))
            self._first, place = tick, 0
            rate, force, temp_c = self._motion(self.time_s(ticks))
            self._data = to_registers(rate, force, temp_c, *self._settings).tobytes()
        return self._data[place : place + REGISTER_BYTES]


# The output registers 0x20 to 0x2D: STATUS, and the block data update.

GYRO_OUT, ACCEL_OUT, TEMP = slice(2, 8), slice(8, 14), slice(0, 2)
STATUS = ((TEMP, TDA), (GYRO_OUT, GDA), (ACCEL_OUT, XLDA))


class Outputs:
    """status: STATUS_REG; bdu: whether a register that was read by half is held until its other half is read."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Reset to the state after a reset."""
        self._newest, self._shown = bytearray(REGISTER_BYTES), bytearray(REGISTER_BYTES)
        self._half_read: dict[int, int] = {}  # register -> which half
        self.status, self.bdu = 0, False

    def update(self, part: slice, sample: bytes) -> None:
        """Update one sensor with new values: its slice of the 14 bytes of a sample."""
        self._newest[part] = sample[part]
        for place, bit in STATUS:
            if place == part:
                self.status |= bit
        if not self._half_read:
            self._shown[part] = sample[part]
            return
        for low in range(part.start, part.stop, 2):
            if low // 2 not in self._half_read:
                self._shown[low : low + 2] = self._newest[low : low + 2]

    def read(self, address: int) -> int:
        """Read one byte; a high byte clears its sensor's bit of STATUS."""
        place = address - OUT_FIRST
        value, pair, half = self._shown[place], place // 2, place % 2
        if half:
            self.status &= ~(TDA if address < OUTX_L_G else GDA if address < OUTX_L_A else XLDA)
        if self.bdu and self._half_read.get(pair, half) == half:
            self._half_read[pair] = half
        elif pair in self._half_read:
            del self._half_read[pair]
            self._shown[2 * pair : 2 * pair + 2] = self._newest[2 * pair : 2 * pair + 2]
        return value

    def set_bdu(self, bdu: bool) -> None:
        """Set block data update; without it no register is held."""
        self.bdu = bdu
        if not bdu:
            self._half_read.clear()
            self._shown[:] = self._newest
