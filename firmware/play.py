#!/usr/bin/env python3
"""Play a log to the board, and keep the rates that it answers: python firmware/play.py PORT [LOG [-o rates.csv]]

Without a log the board runs its self-test, and its stand-in falls silent.
The board streams the same samples on its other port meanwhile, as if a sensor had given them.
"""

from __future__ import annotations

import argparse
import gzip
import struct
import sys
import time
from collections import deque
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
import serial

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from session.bench import frames
from session.bench.events import HEADER
from session.io.errors import CalibrationError, DeviceError, FormatError
from tinygc.cli.arguments import Paths, file_written, path_read, refuse_overwriting

CALIBRATED_TYPE, SELF_TEST_TYPE, HELLO_TYPE = 0x03, 0x04, 0x10
CALIBRATED, SELF_TEST = struct.Struct("<BHIfff"), struct.Struct("<BHHfI")
#: samples that may be on their way: fewer bytes than the board's ring holds
IN_FLIGHT = 8
READ_S, SILENCE_S = 0.5, 5.0


@dataclass(frozen=True)
class SelfTest:
    """failed: number of the first vector that failed, or 0; worst difference in rad/s; model: TINYGC_MODEL_ID of the board's header."""

    failed: int
    worst: float
    model: int


class Board:
    """One of the board's ports.  Raises DeviceError when it cannot be opened, or sends nothing for SILENCE_S."""

    def __init__(self, name: str):
        self._name, self._buffer, self._bodies = name, b"", deque()
        try:
            self._port = serial.Serial(name, 921600, timeout=READ_S, write_timeout=SILENCE_S)
        except (OSError, ValueError) as error:
            raise DeviceError(f"{name}: cannot be opened ({getattr(error, 'strerror', None) or error})") from None

    def close(self) -> None:
        self._port.close()

    def hello(self) -> SelfTest:
        """Run the board's self-test, and make it forget the samples so far.

        Repeated until there is an answer: what is sent to a pseudo-terminal before the emulator has seen it open is lost.
        """
        until = time.monotonic() + SILENCE_S
        while time.monotonic() < until:
            self._send(frames.encode_blocks(np.array([[HELLO_TYPE, 0, 0]], np.uint8)).tobytes())
            while body := self._next():
                if body[0] == SELF_TEST_TYPE and len(body) == SELF_TEST.size:
                    return SelfTest(*SELF_TEST.unpack(body)[2:])
        raise DeviceError(f"{self._name}: no answer; is this the board's port?")

    def calibrate(self, t_us: np.ndarray, registers: np.ndarray) -> np.ndarray:
        """Rates (N, 3) float32 rad/s for samples: t_us (N,), registers (N, 7) int16.  Never more than IN_FLIGHT samples ahead."""
        coded = frames.encode_samples(np.arange(len(t_us)), t_us, registers)
        rates, sent, got, heard_s = np.zeros((len(t_us), 3), np.float32), 0, 0, time.monotonic()
        while got < len(rates):
            if sent - got <= IN_FLIGHT // 2 and sent < len(rates):
                self._send(coded[sent : got + IN_FLIGHT].tobytes())
                sent = min(got + IN_FLIGHT, len(rates))
            body = self._next()
            if body and body[0] == CALIBRATED_TYPE and len(body) == CALIBRATED.size:
                _, sequence, _, *rates[got] = CALIBRATED.unpack(body)
                if sequence != got & 0xFFFF:
                    raise DeviceError(f"{self._name}: the answer to sample {got} is missing")
                got, heard_s = got + 1, time.monotonic()
            elif time.monotonic() - heard_s > SILENCE_S:
                raise DeviceError(f"{self._name}: no answer to sample {got}")
        return rates

    def _send(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except OSError as error:
            raise DeviceError(f"{self._name}: takes no bytes ({error})") from None

    def _next(self) -> bytes | None:
        """The next good frame without its CRC; None where READ_S passes without a byte."""
        while not self._bodies:
            try:
                data = self._port.read(max(1, self._port.in_waiting))
            except OSError as error:
                raise DeviceError(f"{self._name}: {error}") from None
            if not data:
                return None
            *tokens, self._buffer = (self._buffer + data).split(b"\0")
            for token in tokens:
                fits = frames.SHORTEST_OTHER <= len(token) <= frames.LONGEST_OTHER
                body, good = frames.decode_blocks(np.frombuffer(token, np.uint8)[None]) if fits else (None, [False])
                if good[0]:
                    self._bodies.append(body.tobytes())
        return self._bodies.popleft()


def read_registers(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """t_us (N,) and registers (N, 7) of a log that holds registers; FormatError for another one."""
    expected = f"expected a log of registers, {HEADER}"
    try:
        with gzip.open(path, "rt", encoding="utf-8") if path.suffix == ".gz" else path.open(encoding="utf-8") as log:
            lines = [line for line in log if line.strip() and not line.startswith("#")]
        if not lines or not lines[0].strip().startswith(HEADER):
            raise FormatError(f"{path}: the header is {''.join(lines[:1]).strip()[:60]!r}; {expected}")
        table = np.loadtxt(lines[1:], delimiter=",", dtype=np.int64, ndmin=2, usecols=range(8))
    except (OSError, EOFError, ValueError) as error:
        raise FormatError(f"{path}: {getattr(error, 'strerror', None) or error}; {expected}") from None
    if not len(table) or table[:, 1:].min() < -32768 or table[:, 1:].max() > 32767:
        raise FormatError(f"{path}: no samples, or numbers beyond 16 bits; {expected}")
    return table[:, 0], table[:, 1:].astype(np.int16)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("port", help="of the board: any serial port, or the pseudo-terminal that QEMU names")
    parser.add_argument("log", type=path_read, nargs="?", help=f"log of registers: {HEADER}")
    parser.add_argument("-o", "--out", type=file_written, help="where the calibrated rates go: t_us,wx_rps,wy_rps,wz_rps")
    parser.set_defaults(paths=Paths.of(parser))
    args = parser.parse_args()
    try:
        refuse_overwriting(args)
        t_us, registers = read_registers(args.log) if args.log else (np.zeros(0, np.int64), np.zeros((0, 7), np.int16))
        with args.out.open("w", encoding="utf-8") if args.out else nullcontext() as out:
            return play(args.port, t_us, registers, out)
    except CalibrationError as error:
        print(f"play: {error}", file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f"play: {args.out}: {error.strerror or error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("play: interrupted", file=sys.stderr)
        return 130


def play(port: str, t_us: np.ndarray, registers: np.ndarray, out: TextIO | None) -> int:
    """Self-test, then the samples; 1 where the self-test failed, else 0."""
    board = Board(port)
    try:
        test = board.hello()
        verdict = f"failed at vector {test.failed}" if test.failed else "passed"
        print(f"model {test.model:08x}, self-test {verdict}, worst {test.worst:g} rad/s", flush=True)
        began = time.monotonic()
        rates = board.calibrate(t_us, registers)
        if len(rates):
            print(f"{len(rates)} samples calibrated in {time.monotonic() - began:.1f} s")
    finally:
        board.close()
    if out:
        out.write("t_us,wx_rps,wy_rps,wz_rps\n")
        out.writelines(f"{t},{x:.9g},{y:.9g},{z:.9g}\n" for t, (x, y, z) in zip(t_us, rates, strict=True))
    return 1 if test.failed else 0


if __name__ == "__main__":
    sys.exit(main())
