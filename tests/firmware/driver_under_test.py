"""The sensor's driver of firmware/, compiled for this machine, on the four functions of driver_fake.c."""

import ctypes
import itertools
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from conftest import ROOT
from processes import run

FIRMWARE = ROOT / "firmware"
SOURCES = ("src/lsm6dsx.c", "lsm6dsx_self_test.c", "identity.c", "frames.c")  #: the first is the driver
FLAGS = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wdouble-promotion", "-Werror", "-fsanitize=undefined", "-fno-sanitize-recover")
#: enum fault of lsm6dsx_fifo.h, in its order
FAULTS = ("overrun", "order", "parity", "tag", "hang", "zeros", "ones", "reset", "changed", "identity", "silent", "stamp", "incomplete")
FAULTS += ("starts", "lost", "rate")
NONE = len(FAULTS)
GYRO, ACCEL, TEMPERATURE, STAMP, CONFIGURATION = 1, 2, 3, 4, 5
ANSWERS, HANGS, BUSY_FOR_EVER, ZEROS, ONES, FAILS_LATE = range(6)
RATES_HZ = (12.5, 26.0, 52.0, 104.0, 208.0, 417.0, 833.0, 1667.0, 3333.0, 6667.0)
#: registers' addresses
FIFO_CTRL1, FIFO_CTRL2, FIFO_CTRL3, FIFO_CTRL4, INT1_CTRL, WHO_AM_I, CTRL1_XL, CTRL2_G = 0x07, 0x08, 0x09, 0x0A, 0x0D, 0x0F, 0x10, 0x11
CTRL3_C, CTRL4_C, CTRL6_C, CTRL8_XL, CTRL9_XL, CTRL10_C = 0x12, 0x13, 0x15, 0x17, 0x18, 0x19
FREQ_FINE = 0x63
ASM330LHH, LSM6DSO = 0x6B, 0x6C  #: WHO_AM_I
#: 1667 Hz, its period in ticks
ODR = 8
PERIOD = 4 * 40000 / 6667
SAMPLE = np.dtype([("t_us", "<u4"), ("number", "<u4"), ("registers", "<i2", (7,)), ("", "<u2")])


@cache
def library():
    """One for all tests of a process: its state is that of the last ``attach``."""
    if shutil.which("gcc") is None:
        pytest.skip("not installed: gcc")
    built = Path(mkdtemp()) / "driver.so"
    sources = [*(FIRMWARE / name for name in SOURCES), ROOT / "tests" / "firmware" / "driver_fake.c"]
    run(["gcc", *FLAGS, "-O1", "-shared", "-fPIC", f"-I{FIRMWARE}", *sources, "-o", built], check=True)
    found = ctypes.CDLL(str(built))
    found.faults.restype = ctypes.POINTER(ctypes.c_uint32 * len(FAULTS))
    found.fifo_rate_hz.restype = ctypes.c_float
    found.fifo_rate_hz.argtypes = [ctypes.c_uint8, ctypes.c_int8]
    found.fifo_tick_q32.restype = ctypes.c_uint64
    found.fifo_tick_q32.argtypes = [ctypes.c_int8]
    found.lsm6dsx_odr.argtypes = [ctypes.c_float]
    found.identity_serial.restype = ctypes.c_uint32
    return found


#: variables of the fake that are bytes
BYTES = ("who", "fine", "turned", "turned_bits", "stuck")


def number(name):
    """A variable of the fake; set its ``value``."""
    return (ctypes.c_uint8 if name in BYTES else ctypes.c_int).in_dll(library(), name)


def put(**values):
    """Set variables of the fake."""
    for name, value in values.items():
        number(name).value = value


def faults():
    """Those that have been counted at all."""
    return {name: count for name, count in zip(FAULTS, library().faults().contents, strict=True) if count}


def accesses():
    """Addresses, with 0x80 where read, and what was written."""
    table = (ctypes.c_uint16 * 1024).in_dll(library(), "accesses")
    return [(entry & 0xFF, entry >> 8) for entry in table[: number("logged").value]]


def attached(odr=ODR, gyro_fs_dps=500, accel_fs_g=4, lpf1=0xFF, lpf2=2, fine=0, who=ASM330LHH):
    """The driver before its first transfer."""
    lib = library()
    put(who=who)
    lib.attach(gyro_fs_dps, accel_fs_g, odr, lpf1, lpf2)
    keep_fine(fine)
    return lib


def accessed_us():
    """Their times."""
    return list((ctypes.c_uint32 * 1024).in_dll(library(), "accessed_us")[: number("logged").value])


def started(odr=ODR, lpf1=0xFF, lpf2=2, settles=True, **how):
    """The driver, its sensor running, its filters settled unless they are to be left alone."""
    lib = attached(odr, lpf1=lpf1, lpf2=lpf2, **how)
    assert lib.start() == NONE
    if settles:
        settle(odr, lpf1, lpf2, how.get("fine", 0))
    return lib


def settle(odr=ODR, lpf1=0xFF, lpf2=2, fine=0):
    """Pass by the slots that are no samples yet, those before slot 0, each at its time; a temperature, 0, among them."""
    now_us, total = number("now_us"), library().unsettled(odr, lpf1, lpf2, fine)
    watermark = registers()[FIFO_CTRL1] // 3
    left = total
    while left:
        count = watermark if left >= 2 * watermark else left
        now_us.value += max(0, int(count * 25 * period_of(odr)) - 2000)
        words = slots(-left, count, odr)
        push(words if left == total else np.concatenate([warmth(-left), words]))
        assert len(poll(2)) == 0
        left -= count


def warmth(slot, value=0):
    """A slot's word of the temperature."""
    return np.array([[tag(TEMPERATURE, slot), value & 0xFF, value >> 8 & 0xFF, 0, 0, 0, 0]], np.uint8)


def keep_fine(fine):
    """INTERNAL_FREQ_FINE."""
    number("fine").value = registers()[0x63] = fine & 0xFF


def registers():
    return (ctypes.c_uint8 * 128).in_dll(library(), "registers")


def tag(kind, count):
    plain = kind << 3 | (count & 3) << 1
    return plain | plain.bit_count() & 1


def words_of(slots, ticks, order=(GYRO, ACCEL, STAMP)):
    """FIFO words (3 n, 7) uint8 of time slots (n,): their number is in every value, so that a sample of two slots would show."""
    words = np.zeros((len(slots), len(order), 7), np.uint8)
    for place, kind in enumerate(order):
        words[:, place, 0] = np.array([tag(kind, count) for count in range(4)], np.uint8)[slots & 3]
        values = np.zeros((len(slots), 3), "<i2")
        values[:] = registers_of(slots)[:, 0:3] if kind == GYRO else registers_of(slots)[:, 3:6]
        if kind == STAMP:
            values[:, 0:2] = (np.asarray(ticks) & 0xFFFFFFFF).astype("<u4").view("<i2").reshape(-1, 2)
            values[:, 2] = 0
        words[:, place, 1:] = values.view(np.uint8).reshape(-1, 6)
    return words.reshape(-1, 7)


def registers_of(slots):
    """(n, 6) int16: three and three values that no other slot has."""
    offsets = np.array([0, 5000, 10000, 15000, 20000, 25000])
    return (np.asarray(slots)[:, None] % 5000 + offsets - 15000).astype("<i2")


def push(words):
    data = np.ascontiguousarray(words, np.uint8)
    library().push(data.ctypes.data_as(ctypes.c_void_p), len(data))


def discard():
    """What was pushed and not read yet."""
    number("words_out").value = number("words_in").value


def poll(times, most=1 << 12):
    out = np.zeros(most, SAMPLE)
    return out[: library().poll(times, out.ctypes.data_as(ctypes.c_void_p), most)]


def take_words(
    words,
    odr=10,
    fine=0,
    word_us=50,
    *,
    made_us=None,
    unsettled=0,
    again=False,
):
    """The samples that the FIFO's part makes of these words, and the faults that it counts.

    The target makes them word_us apart, or at made_us (n,).  again: behind a restart, the words of the call before are not forgotten.
    """
    data, counts = np.ascontiguousarray(words, np.uint8), (ctypes.c_uint32 * len(FAULTS))()
    made = np.arange(len(data)) * word_us if made_us is None else np.asarray(made_us)
    made = np.ascontiguousarray(made.astype(np.int64) & 0xFFFFFFFF, np.uint32)
    out = np.zeros(len(data) + 1, SAMPLE)
    at = [ctypes.c_void_p(array.ctypes.data) for array in (data, made, out)]
    count = library().take_words(again, odr, fine, unsettled, at[0], at[1], len(data), counts, at[2])
    return out[:count], {name: number for name, number in zip(FAULTS, counts, strict=True) if number}


def patterns(count, seed=3):
    """How early or late stamps may be, in ticks (count,)."""
    rng, numbers = np.random.default_rng(seed), np.arange(count)
    return {
        "one, at random": rng.integers(-1, 2, count),
        "two, at random": rng.integers(-2, 3, count),
        "one, either way": rng.choice([-1, 1], count),
        "two, either way": rng.choice([-2, 2], count),
        "one, in turn": numbers % 2 * 2 - 1,
        "two, in turn": numbers % 2 * 4 - 2,
        "one late for long, then early": np.where(numbers // 700 % 2, 1, -1),
        "two late for long, then early": np.where(numbers // 700 % 2, 2, -2),
    }


ORDERS = tuple(itertools.permutations((GYRO, ACCEL, STAMP)))


def period_of(odr):
    """In ticks."""
    return PERIOD * 2.0 ** (ODR - odr)


def slots(first, count, odr=ODR):
    """Words of so many samples."""
    numbers = np.arange(first, first + count)
    return words_of(numbers, np.floor(100.5 + numbers * period_of(odr)).astype(np.int64))


def streamed_by_time(first, count, change=lambda words: words):
    """What comes of slots at 1667 Hz, ten in 6 ms, which are changed on their way."""
    found = []
    for place in range(first, first + count, 10):
        push(change(slots(place, 10)))
        found.append(poll(6))
    return np.concatenate(found)


def streamed(first, count, polls=20):
    """What comes of them."""
    push(slots(first, count))
    return poll(polls)


def fail_behind(behaviour):
    """The bus fails from here on."""
    number("behaviour").value = behaviour
