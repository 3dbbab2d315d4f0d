"""The exported model on the emulated STM32F405: the same bits as on this machine, within its bounds, and over the serial port."""

import contextlib
import ctypes
import json
import re
import struct

import numpy as np
import pytest
import serial
from conftest import DEG, ROOT
from emulator import build as kit
from exported_models import MODELS, WHOLE, as_inputs, needs_compiler, random_inputs
from exports_read_back import context
from processes import CALIBRATE, PATIENCE_S, PIPE, run, started, until

from session.bench import frames
from session.bench.decoder import StreamDecoder
from tinygc import read_session
from tinygc.deploy.embedded.program import program
from tinygc.deploy.exports import exporter

MISSING = kit.tools_missing()
on_board = pytest.mark.skipif(bool(MISSING), reason=MISSING)


def needs_board(test):
    """Built for the microcontroller, and run in its emulator."""
    return pytest.mark.emulation(on_board(test))


F = np.float32


def write_model(folder, name):
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in exporter("c").export(MODELS[name], context()).items():
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


class Link:
    """One of the board's ports."""

    IN_FLIGHT = 8  #: samples that may be on their way: fewer bytes than the board's ring holds
    CALIBRATED, SELF_TEST = struct.Struct("<BHIfff"), struct.Struct("<BHHfI")

    def __init__(self, port):
        self._port, self._buffer, self._bodies = serial.Serial(port, 921600, timeout=0.5), b"", []
        self.close, self.send = self._port.close, self._port.write

    def hello(self):
        """The board's self-test: failed, worst, model.  What is sent before QEMU has seen the terminal open is lost, so it is repeated."""

        def ask():
            self.send(frames.encode_blocks(np.array([[0x10, 0, 0]], np.uint8)).tobytes())
            while (body := self.next()) and body[0] != 0x04:
                pass
            return body

        return self.SELF_TEST.unpack(until(ask, what="a self-test"))[2:]

    def calibrate(self, t_us, registers):
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

    def next(self):
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


@needs_board
def test_recorded_from_the_board_and_calibrated_there_equals_calibrated_here(tmp_path):
    """A log is played to the board as if by its sensor, ``calibrate.py record`` guides and records what the board streams: the log is
    whole, and what the board calibrated is what the host makes of it."""
    rows = np.loadtxt(ROOT / "data" / "session1" / "log0001.csv.gz", np.int64, delimiter=",", skiprows=2, max_rows=2700)
    t_us, registers = rows[:, 0], rows[:, 1:].astype(np.int16)
    elf = kit.build("tinygc.elf", write_model(tmp_path / "model", "tinygc_denoised"), tmp_path, SERIAL="4711")
    folder, words = tmp_path / "recorded", ("--segments", 1, "--no-coach", "--mute", "--json", tmp_path / "record.json")
    with contextlib.ExitStack() as running:
        host_port, sensor_port = kit.ports_under_qemu(
            elf, lambda command, **how: running.enter_context(started(command, limit_s=4 * PATIENCE_S, **how))
        )
        link = running.enter_context(contextlib.closing(Link(sensor_port)))
        assert link.hello() == (0, 0.0, program(WHOLE).identity)
        command = [*CALIBRATE, "record", "--port", host_port, "--out", folder, *words]
        record = running.enter_context(started(command, stderr=PIPE, stdout=PIPE, text=True))
        until(lambda: (folder / "raw.times").exists() and "open" in (folder / "raw.times").read_text(), what="an open port")
        rates = link.calibrate(t_us, registers)
        _, trouble = record.communicate()
    assert record.returncode == 0, trouble
    assert json.loads((tmp_path / "record.json").read_text())["segments"]["accepted"] == 1

    registers = np.pad(registers[:, :3] * F(17.5e-3 * DEG), ((0, 0), (0, 4)))
    host = program(WHOLE).run(as_inputs(registers))
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


class Frame(ctypes.Structure):
    _fields_ = (("bytes", ctypes.c_uint8 * 80), ("count", ctypes.c_uint))


class Decoder(ctypes.Structure):
    _fields_ = (("bytes", ctypes.c_uint8 * 81), ("count", ctypes.c_uint))


@needs_compiler
def test_frames_written_in_c_are_read_in_python_and_the_other_way_round_and_noise_is_not(tmp_path):
    flags = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-fsanitize=undefined", "-fno-sanitize-recover", "-shared", "-fPIC"]
    run(["gcc", *flags, ROOT / "firmware" / "frames.c", "-o", tmp_path / "frames.so"], check=True)
    library, rng, stream = ctypes.CDLL(str(tmp_path / "frames.so")), np.random.default_rng(4), b""
    expected = (rng.integers(-32768, 32768, (200, 7)) * (rng.random((200, 7)) < 0.6)).astype(np.int16)
    for n, registers in enumerate(expected):
        frame, out = Frame(), ctypes.create_string_buffer(82)
        library.frame_begin(ctypes.byref(frame), 1, n)
        library.frame_u32(ctypes.byref(frame), 256 * n)
        for value in registers:
            library.frame_u16(ctypes.byref(frame), int(value) & 0xFFFF)
        count = library.frame_end(ctypes.byref(frame), out)
        stream += out.raw[:count]
    (chunk,) = StreamDecoder().feed(stream)
    np.testing.assert_array_equal(chunk.registers, expected)
    np.testing.assert_array_equal(chunk.t_us, 256 * np.arange(200))
    decoder, got = Decoder(), []
    for coded in frames.encode_samples(np.arange(200), np.arange(200), expected):
        for byte in (*rng.bytes(int(rng.integers(0, 80))), 0, *coded.tobytes()):
            if count := library.frame_take(ctypes.byref(decoder), byte):
                got.append(bytes(decoder.bytes[:count]))
    assert got == [bytes([1, n, 0, n, 0, 0, 0]) + registers.tobytes() for n, registers in enumerate(expected)]
