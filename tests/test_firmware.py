"""The exported model on the emulated STM32F405: the same bits as on this machine, within its bounds, and over the serial port."""

from __future__ import annotations

import contextlib
import ctypes
import re
import struct
from pathlib import Path

import numpy as np
import pytest
import serial
from conftest import ROOT
from emulator import build as kit
from exported_models import MODELS, WHOLE, as_inputs, random_inputs
from processes import CALIBRATE, PATIENCE_S, PIPE, run, started, until

from session.bench import frames
from session.bench.decoder import StreamDecoder
from tinygc import read_session
from tinygc.deploy.embedded.program import Registers, program
from tinygc.deploy.embedded.source import source_files

MISSING = kit.tools_missing()
on_board = pytest.mark.skipif(bool(MISSING), reason=MISSING)


def needs_board(test):
    """Built for the microcontroller, and run in its emulator."""
    return pytest.mark.emulation(on_board(test))


SENSOR = Registers()


def write_model(folder: Path, name: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in source_files(program(MODELS[name]), SENSOR, "A test.", {}).items():
        (folder / file).write_text(text)
    return folder


@needs_board
@pytest.mark.parametrize("name", ["tinygc_denoised", "all of it"])
def test_no_bit_differs_on_the_board_over_10_000_samples(name, tmp_path):
    model, table = write_model(tmp_path / "model", name), random_inputs()
    for optimise in ("-O2", "-Os"):
        elf = kit.build("measure.elf", model, tmp_path / optimise, optimise)
        found = kit.run(elf, table, tmp_path)
        expected = program(MODELS[name]).run(as_inputs(table))
        assert np.count_nonzero(found.rates.view(np.uint32) != expected.view(np.uint32)) == 0
        assert (found.self_test, found.exact) == (0, True)


@needs_board
def test_the_195_parameters_fit_and_are_quick_enough(tmp_path):
    """Code below 1 kB and state below 1.5 kB at -Os, fewer than 2500 instructions a sample at -O2; a nop counts as one."""
    model = write_model(tmp_path / "model", "tinygc_denoised")
    assert program(WHOLE).parameters == 195
    kit.build("measure.elf", model, tmp_path / "small", "-Os")
    small = kit.sizes(tmp_path / "small")
    assert 500 < small.code < 1024
    assert small.weights < 4 * 195 + 100  # and the sensor's sensitivities
    assert 1000 < small.state < 1536
    found = kit.run(kit.build("measure.elf", model, tmp_path / "fast", "-O2"), random_inputs(2000), tmp_path)
    assert found.per_nop == pytest.approx(1, abs=0.005)
    assert 2 * 189 < found.instructions < 2500


FAULTY = """
#include "board.h"
#include "board_spi.h"
#include "fault.h"
void SysTick_Handler(void) {}
void USART1_Handler(void) {}
void USART2_Handler(void) {}
void DMA2_Stream0_Handler(void) {}
static uint32_t semihost(uint32_t operation, uint32_t argument)
{
    register uint32_t r0 __asm("r0") = operation, r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}
__attribute__((section(".kept"))) static int starts;
int main(void)
{
    read_if_there(0x30000000);
    for (int n = 0; n < (int)(sizeof fault_record / 4); n++) {
        static char text[12];
        uint32_t word = ((uint32_t *)&fault_record)[n];
        for (int digit = 7; digit >= 0; digit--, word >>= 4) text[digit] = "0123456789abcdef"[word & 15];
        text[8] = ' ';
        semihost(0x04, (uint32_t)text);
    }
    switch (starts++) {
    case 0:
    case 1:
        UPSET;
        break;
    case 2:
        return 0; /* an end that a board's program has none of */
    default:
        semihost(0x18, 0x20026);
    }
    for (;;) ;
}
"""


@needs_board
@pytest.mark.parametrize(
    ("upset", "status"),
    [
        ("*(volatile uint32_t *)0x30000004", 0x8200),  # a precise error of the bus, at an address that is known
        ('__asm volatile(".short 0xdeff")', 0x10000),  # an undefined instruction
        ("((void (*)(void))0x30000000)()", 0x100),  # instructions from where there are none
    ],
)
def test_a_fault_of_the_core_is_a_reset_and_its_cause_is_kept(upset, status, tmp_path):
    """Twice, then ``main`` returns.  What was kept outlives each reset, and a read of what may not be there leaves nothing."""
    source, elf, firmware = tmp_path / "faulty.c", tmp_path / "faulty.elf", ROOT / "firmware"
    source.write_text(FAULTY.replace("UPSET", upset))
    core = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-std=c11", "-Os", "-ffreestanding", f"-I{firmware}"]
    parts = [source, firmware / "startup.c", firmware / "fault.c", "-T", firmware / "stm32f405.ld", "-nostartfiles", "--specs=nano.specs"]
    run(["arm-none-eabi-gcc", *core, *parts, "-o", elf], check=True)
    semihosting = ["-semihosting-config", "enable=on,target=native", "-serial", "none"]
    ran = run(["qemu-system-arm", *kit.MACHINE, *semihosting, "-kernel", elf], capture_output=True, text=True)
    records = np.reshape([int(word, 16) for word in ran.stderr.split()], (4, 7))
    assert ran.returncode == 0
    assert records[0].tolist() == [0] * 7
    np.testing.assert_array_equal(records[1:, 0], 0x0FA17)
    np.testing.assert_array_equal(records[1:, 1], [1, 2, 2])
    np.testing.assert_array_equal(records[1:, 4], status)
    assert len(set(records[1:, 2])) == 1  # where it was
    if status == 0x8200:
        np.testing.assert_array_equal(records[1:, 5], 0x30000004)


@pytest.fixture(scope="module")
def elf(tmp_path_factory):
    if MISSING:
        pytest.skip(MISSING)
    folder = tmp_path_factory.mktemp("board")
    return kit.build("tinygc.elf", write_model(folder / "model", "tinygc_denoised"), folder, SERIAL="4711")


@contextlib.contextmanager
def board_of(elf):
    """The pseudo-terminals of the host and of whoever plays a sensor, of a board under QEMU."""
    with contextlib.ExitStack() as running:
        yield kit.ports_under_qemu(elf, lambda command, **how: running.enter_context(started(command, limit_s=4 * PATIENCE_S, **how)))


@pytest.fixture(scope="module")
def board(elf):
    """One for all tests: its stand-in has fallen silent once somebody has spoken to it."""
    with board_of(elf) as ports:
        yield ports


class Link:
    """One of the board's ports."""

    IN_FLIGHT = 8  #: samples that may be on their way: fewer bytes than the board's ring holds
    CALIBRATED, SELF_TEST = struct.Struct("<BHIfff"), struct.Struct("<BHHfI")

    def __init__(self, port: str):
        self._port, self._buffer, self._bodies = serial.Serial(port, 921600, timeout=0.5), b"", []
        self.close, self.send = self._port.close, self._port.write

    def hello(self) -> tuple[int, float, int]:
        """The board's self-test: failed, worst, model.  What is sent before QEMU has seen the terminal open is lost, so it is repeated."""

        def ask():
            self.send(frames.encode_blocks(np.array([[0x10, 0, 0]], np.uint8)).tobytes())
            while (body := self.next()) and body[0] != 0x04:
                pass
            return body

        return self.SELF_TEST.unpack(until(ask, what="a self-test"))[2:]

    def calibrate(self, t_us: np.ndarray, registers: np.ndarray) -> np.ndarray:
        """Rates (N, 3) float32 rad/s for samples: t_us (N,), registers (N, 7) int16."""
        coded, rates = frames.encode_samples(np.arange(len(t_us)), t_us, registers), np.zeros((len(t_us), 3), np.float32)
        for first in range(0, len(rates), self.IN_FLIGHT):
            self.send(coded[first : first + self.IN_FLIGHT].tobytes())
            for n in range(first, min(first + self.IN_FLIGHT, len(rates))):
                while (body := until(self.next, what="an answer"))[0] != 0x03:
                    pass
                _, sequence, _, *rates[n] = self.CALIBRATED.unpack(body)
                assert sequence == n & 0xFFFF
        return rates

    def next(self) -> bytes | None:
        """The next good frame without its CRC; None where half a second passes without a byte."""
        while not self._bodies:
            data = self._port.read(max(1, self._port.in_waiting))
            if not data:
                return None
            *tokens, self._buffer = (self._buffer + data).split(b"\0")
            fit = [token for token in tokens if frames.SHORTEST_OTHER <= len(token) <= frames.LONGEST_OTHER]
            decoded = [frames.decode_blocks(np.frombuffer(token, np.uint8)[None]) for token in fit]
            self._bodies += [body[0].tobytes() for body, good in decoded if good[0]]
        return self._bodies.pop(0)


@pytest.mark.emulation
def test_recorded_from_the_board_and_calibrated_there_equals_calibrated_here(board, tmp_path):
    """A log is played to the board as if by its sensor, ``calibrate.py record`` guides and records what the board streams: the log is
    whole, and what the board calibrated is what the host makes of it."""
    rows = np.loadtxt(ROOT / "data" / "session1" / "log0001.csv.gz", np.int64, delimiter=",", skiprows=2, max_rows=2700)
    t_us, registers = rows[:, 0], rows[:, 1:].astype(np.int16)
    link = Link(board[1])
    assert link.hello() == (0, 0.0, program(WHOLE).identity)
    folder = tmp_path / "recorded"
    command = [*CALIBRATE, "record", "--port", board[0], "--out", folder, "--segments", 1, "--no-coach", "--mute"]
    with contextlib.closing(link), started(command, stderr=PIPE, stdout=PIPE, text=True) as record:
        until(lambda: (folder / "raw.times").exists() and "open" in (folder / "raw.times").read_text(), what="an open port")
        rates = link.calibrate(t_us, registers)
        said, trouble = record.communicate()
    assert record.returncode == 0, trouble
    assert "1 of 1 segments" in said

    host = program(WHOLE).run(SENSOR.inputs(registers))
    assert np.count_nonzero(rates.view(np.uint32) != host.view(np.uint32)) == 0

    # The recorded session, read as any session is, and calibrated by the model in double precision.
    session = read_session(folder)
    (log,) = session.logs
    count = len(log.samples)
    comment = re.search(r"^# gyro_fs_dps=500 accel_fs_g=4 odr_hz=(\S+) serial=4711$", (folder / "log0001.csv").read_text(), re.M)
    true_hz = float(comment[1])
    assert true_hz == pytest.approx(1 / log.samples.dt_s.mean(), rel=1e-4)  # 209.56: as the stamps show it
    assert (session.config.sensor.serial, session.config.sensor.odr_hz) == ("4711", true_hz)  # as the board said it, not 208
    assert count > 5 * 208  # still, turn, still
    np.testing.assert_array_equal(log.samples.t_ns, 1000 * t_us[:count])
    np.testing.assert_allclose(rates[:count], WHOLE(log.samples.gyro), atol=2e-6)


# The frames' C on this machine, against the Python that is its other end.


@pytest.fixture(scope="module")
def c_frames(tmp_path_factory):
    import shutil

    if shutil.which("gcc") is None:
        pytest.skip("not installed: gcc")
    library = tmp_path_factory.mktemp("frames") / "frames.so"
    flags = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-fsanitize=undefined", "-fno-sanitize-recover", "-shared", "-fPIC"]
    run(["gcc", *flags, ROOT / "firmware" / "frames.c", "-o", library], check=True)
    return ctypes.CDLL(str(library))


class Frame(ctypes.Structure):
    _fields_ = (("bytes", ctypes.c_uint8 * 80), ("count", ctypes.c_uint))


class Decoder(ctypes.Structure):
    _fields_ = (("bytes", ctypes.c_uint8 * 81), ("count", ctypes.c_uint))


def test_frames_written_in_c_are_read_in_python_whatever_they_hold(c_frames):
    rng = np.random.default_rng(4)
    stream, expected = b"", rng.integers(-32768, 32768, (300, 7)) * (rng.random((300, 7)) < 0.6)
    for n, registers in enumerate(expected):
        frame, out = Frame(), ctypes.create_string_buffer(82)
        c_frames.frame_begin(ctypes.byref(frame), 1, n)
        c_frames.frame_u32(ctypes.byref(frame), 256 * n)
        for value in registers:
            c_frames.frame_u16(ctypes.byref(frame), int(value) & 0xFFFF)
        count = c_frames.frame_end(ctypes.byref(frame), out)
        stream += out.raw[:count]
    decoder = StreamDecoder()
    (chunk,) = decoder.feed(stream)
    np.testing.assert_array_equal(chunk.registers, expected)
    np.testing.assert_array_equal(chunk.t_us, 256 * np.arange(300))


def test_frames_written_in_python_are_read_in_c_and_noise_is_not(c_frames):
    rng = np.random.default_rng(5)
    registers = (rng.integers(-32768, 32768, (200, 7)) * (rng.random((200, 7)) < 0.6)).astype(np.int16)
    coded = frames.encode_samples(np.arange(200), np.arange(200), registers)
    decoder, got = Decoder(), []
    for n in range(200):
        noise = rng.bytes(int(rng.integers(0, 80)))
        for byte in (*noise, 0, *coded[n].tobytes()):
            if count := c_frames.frame_take(ctypes.byref(decoder), byte):
                got.append(bytes(decoder.bytes[:count]))
    assert got == [np.array(registers[n]).tobytes().join([bytes([1, n, 0, n, 0, 0, 0]), b""]) for n in range(200)]
