"""The driver's own program next to a sensor whose every sample is known: what was streamed, what was made."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from emulator import build
from emulator.machine import Machine
from emulator.sensor import STANDARD_GRAVITY, TEMPERATURE_ZERO_C, Asm330lhh, Fault, Made, Motion, Oscillator, SensorPort, Silicon
from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import FAULTS, STANDIN, BoardStatus, Event, Info

BAUD = 2_000_000
NOMINAL_HZ = (12.5, 26.0, 52.0, 104.0, 208.0, 417.0, 833.0, 1667.0, 3333.0, 6667.0)
#: at most this far is a stamp from the time of its sample: a tick of the sensor, 25 us (1 +- 0.19), and the frame's whole microseconds
STAMP_US, TICK_US = 33.0, 31.0  #: the latter: the longest tick of a sensor, which a tick of jitter may add
SLICE_S = 0.25
LATENCY_S = 1.0  #: samples of so long before the end may still be on their way
ROUND = 30_011  #: a prime: the sample's number is written in two digits of it


def built(folder: Path, odr_hz: float = 417.0, baud: int = BAUD, **variables: str) -> Path:
    """The recorder's ELF file; variables: of the Makefile."""
    return build.build("recorder.elf", folder, folder, ODR_HZ=f"{odr_hz:g}", BAUD=str(baud), **variables)


def numbered(clock_hz: float) -> Motion:
    """A motion whose registers, at 500 dps and 4 g, spell the number of the 6667 Hz clock's tick; every one of the six depends on it."""

    def motion(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        tick = np.rint(t_s * clock_hz).astype(np.int64)
        low, high = tick % ROUND - ROUND // 2, tick // ROUND
        gyro = np.column_stack([low, high, tick * 7 % ROUND - ROUND // 2])
        accel = np.column_stack([-low, high + 9, tick * 11 % ROUND - ROUND // 2])
        return np.radians(gyro * 0.0175), accel * (0.122e-3 * STANDARD_GRAVITY), np.full(len(tick), TEMPERATURE_ZERO_C + 1)

    return motion


@dataclass(frozen=True)
class Verdict:
    """streamed; missing: settled samples of the sensor, from the first that was streamed to the last, or to ``LATENCY_S`` before the end
    where it is later, that were not; skipped: numbers that the stream leaves out; doubled: streamed once more; falsified: streamed
    samples that the sensor did not make, or at another time; unsettled: that it made before it had settled.

    odr_hz: as the stamps show it; true_hz.
    """

    streamed: int
    missing: int
    skipped: int
    doubled: int
    falsified: int
    unsettled: int
    odr_hz: float
    true_hz: float


class Driven:
    """An ELF file, the sensor, the host.  fine: INTERNAL_FREQ_FINE; motion: another than the numbered one; faults, stalls, silicon: as the
    model and the machine take them.

    made_up: samples of the board's stand-in, which count for nothing; answers: command's number -> result.
    """

    def __init__(self, elf: Path, fine: int = 7, faults: Iterable[Fault] = (), stalls: Iterable[tuple[float, float]] = (),
                 silicon: Silicon | None = None, motion: Motion | None = None):  # fmt: skip
        self.silicon, oscillator = silicon or Silicon(), Oscillator(fine - 1, fine)
        self.clock_hz = oscillator.ticks_hz() / self.silicon.ticks_per_period
        self.sensor = Asm330lhh(motion or numbered(self.clock_hz), oscillator, faults, keep=True, silicon=self.silicon)
        self.machine = Machine(elf, SensorPort(self.sensor), stalls=stalls)
        self.decoder, self.t_s, self.bytes = StreamDecoder(), 0.0, 0
        self.info: Info | None = None
        self.board: BoardStatus | None = None
        self.counts = dict.fromkeys(FAULTS, 0)
        self.tested: list[Event] = []
        self._rest, self._frames, self._from_standin = b"", list[bytes](), False
        self._number, self.answers = 0, {}
        self.made_up = 0

    def run(self, seconds: float) -> None:
        """So much further."""
        end_s = self.t_s + seconds
        while self.t_s < end_s:
            self.t_s = min(end_s, self.t_s + SLICE_S)
            self.machine.run_until(self.t_s)
            data = self.machine.usart1.take()
            self.bytes += len(data)
            for event in self.decoder.feed(data):
                self._take(event)
            self._keep(data)

    def _keep(self, data: bytes) -> None:
        """Keep the sensor's sample frames as they are: the decoder does not return their numbers."""
        *whole, self._rest = (self._rest + data).split(b"\0")
        for frame in whole:
            if len(frame) != frames.SAMPLE_BYTES:
                if len(frame) >= frames.SHORTEST_OTHER:
                    (message,), (good,) = frames.decode_blocks(np.frombuffer(frame, np.uint8)[None])
                    if good and message[0] == frames.BOARD_TYPE:
                        self._from_standin = message[3] == STANDIN
            elif self._from_standin:
                self.made_up += 1
            else:
                self._frames.append(frame)

    def _take(self, event) -> None:
        if isinstance(event, Info):
            self.info = event
        elif isinstance(event, BoardStatus):
            self.board = event
        elif event.kind == "done":
            sequence, _, self.answers[sequence] = event.numbers
        elif event.kind == "faults":
            self.counts = dict(zip(FAULTS, event.numbers, strict=True))
        elif event.kind == "tested":
            self.tested.append(event)

    def ask(self, command: int, *values: float, within_s: float = 4.0) -> None:
        """Send a command; RuntimeError where the board does not obey."""
        self._number += 1
        self.machine.usart1.feed(frames.encode_command(command, self._number, *values))
        end_s = self.t_s + within_s
        while self._number not in self.answers and self.t_s < end_s:
            self.run(0.05)
        if (result := self.answers.get(self._number)) != frames.DONE:
            raise RuntimeError(f"command 0x{command:02X} {values}: result {result}")

    @property
    def streamed(self) -> int:
        """Samples of the sensor that were streamed since ``forget``."""
        return len(self._frames)

    def forget(self) -> None:
        """What was streamed and made up to now does not count."""
        self._frames = []
        del self.sensor.kept[:-1000]  # the FIFO holds some of them

    def verdict(self) -> Verdict:
        """Of what was streamed since ``forget``."""
        bodies, whole = frames.decode_blocks(np.frombuffer(b"".join(self._frames), np.uint8).reshape(len(self._frames), -1))
        streamed = np.ascontiguousarray(bodies[whole]).view(frames.SAMPLE).ravel()
        found = compared(streamed, self.sensor.kept, self.t_s - LATENCY_S, self.clock_hz, self.silicon)
        return replace(found, falsified=found.falsified + int(np.count_nonzero(~whole)))

    @property
    def objections(self) -> list[str]:
        """What no real board would do, of the microcontroller and of the sensor."""
        return [*self.machine.bus.objections, *self.sensor.objections]


def compared(streamed: np.ndarray, kept: list[Made], until_s: float, clock_hz: float, silicon: Silicon) -> Verdict:
    """Samples of the stream, ``frames.SAMPLE``, against all that a sensor with a numbered motion made; until_s: what was made later may
    still be on its way."""
    got = streamed["registers"]
    steps_us = (np.diff(streamed["t_us"].astype(np.int64)) + 2**31) % 2**32 - 2**31
    t_us = np.append(0, np.cumsum(steps_us))
    made_s = np.array([made.t_s for made in kept])
    made = np.frombuffer(b"".join(made.registers for made in kept), "<i2").reshape(-1, 7)
    settled, grid = np.array([made.unsettled == 0 for made in kept]), np.array([made.grid for made in kept])
    keys = _spelled(made[:, 1:3])
    order = np.argsort(keys, kind="stable")
    place = order[np.searchsorted(keys[order], _spelled(got[:, :2])).clip(0, len(keys) - 1)]
    wrong = (made[place, 1:] != got[:, :6]).any(axis=1)
    unsettled = ~wrong & ~settled[place]
    doubled = np.zeros(len(got), bool)
    good = np.flatnonzero(~wrong & ~unsettled)
    newest = np.maximum.accumulate(np.append(-1, place[good]))[:-1]
    doubled[good] = place[good] == newest
    wrong[good] |= place[good] < newest
    once = ~wrong & ~unsettled & ~doubled
    place = place[once]
    numbers = np.diff(streamed["sequence"][once].astype(np.int64)) % 2**16
    numbers += np.rint((np.diff(place) - numbers) / 2**16).astype(np.int64) * 2**16  # the number has 16 bits
    # By how much each stamp is off against the middle of its run, which ends only where the sensor's clock of samples began again.
    off_us = t_us[once] - 1e6 * made_s[place]
    for run in np.unique(grid[place]):
        off_us[grid[place] == run] -= np.median(off_us[grid[place] == run])
    mistimed = np.abs(off_us) > STAMP_US + TICK_US * silicon.stamp_jitter_ticks
    late = np.flatnonzero(made_s < until_s)
    count = np.count_nonzero(settled[place[0] : max(place[-1], late[-1] if len(late) else 0) + 1])
    return Verdict(
        streamed=len(got),
        missing=int(count - np.count_nonzero(once)),
        skipped=int(np.sum(numbers - 1)),
        doubled=int(np.count_nonzero(doubled)),
        falsified=int(np.count_nonzero(wrong) + np.count_nonzero(mistimed)),
        unsettled=int(np.count_nonzero(unsettled)),
        odr_hz=1e6 / float(np.polyfit(place, t_us[once], 1)[0]),
        true_hz=clock_hz / max(1, round(float(np.median(np.diff(made_s))) * clock_hz)),
    )


def _spelled(registers: np.ndarray) -> np.ndarray:
    """The number that two registers spell."""
    return registers[:, 0].astype(np.int64) + ROUND // 2 + ROUND * registers[:, 1].astype(np.int64)
