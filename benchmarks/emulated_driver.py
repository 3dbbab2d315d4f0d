"""The driver's own program on the emulated STM32F405, beside a sensor whose every sample is known: what was streamed, what was made."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "firmware"))

import measure

from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import FAULTS, BoardStatus, CommandResult, FaultCounts, Info, SampleChunk, Trouble
from session.io.units import DEG, G
from tinygc.annexes.emulated.bus import CORE_HZ
from tinygc.annexes.emulated.machine import Machine
from tinygc.annexes.emulated.readings import CLOCK_HZ, Fault, Oscillator
from tinygc.annexes.emulated.sensor import Asm330lhh, SensorPort

BAUD = 2_000_000
NOMINAL_HZ = (12.5, 26.0, 52.0, 104.0, 208.0, 417.0, 833.0, 1667.0, 3333.0, 6667.0)
#: at most this far is a stamp from the time of its sample: a tick of the sensor, 25 us (1 +- 0.19), and the frame's whole microseconds
STAMP_US = 33.0
SLICE_S = 0.25
ROUND = 30_011  #: a prime: the sample's number is written in two digits of it


def built(folder: Path, odr_hz: float = 417.0, baud: int = BAUD) -> Path:
    """The recorder's ELF file.  RuntimeError where it cannot be built."""
    if missing := measure.tools_missing():
        raise RuntimeError(missing)
    return measure.build("recorder.elf", folder, folder, ODR_HZ=f"{odr_hz:g}", BAUD=str(baud))


def numbered(clock_hz: float):
    """A motion whose registers, at 500 dps and 4 g, spell the number of the 6667 Hz clock's tick; every one of the six depends on it."""

    def motion(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        tick = np.rint(t_s * clock_hz).astype(np.int64)
        low, high = tick % ROUND - ROUND // 2, tick // ROUND
        gyro = np.column_stack([low, high, tick * 7 % ROUND - ROUND // 2])
        accel = np.column_stack([-low, high + 9, tick * 11 % ROUND - ROUND // 2])
        return gyro * (0.0175 * DEG), accel * (0.122e-3 * G), 25.0 + np.floor(t_s) / 256

    return motion


class Watched(Asm330lhh):
    """written: (address, value) in their order."""

    def __init__(self, *args, **how) -> None:
        super().__init__(*args, **how)
        self.written: list[tuple[int, int]] = []

    def write(self, address: int, value: int, t_s: float) -> None:
        """As the sensor's own."""
        self.written.append((address, value))
        super().write(address, value, t_s)


@dataclass(frozen=True)
class Verdict:
    """made: samples of the sensor between the first and the last that was streamed; streamed, missing: of them; said_lost: numbers that
    the stream leaves out; falsified: streamed samples that the sensor did not make, or at another time, or twice.

    odr_hz: as the stamps show it; true_hz; off_us: largest distance of a stamp from the true time within a run of the sensor;
    restart_off_us: by how much a further run of the sensor is off against the first one.
    """

    made: int
    streamed: int
    missing: int
    said_lost: int
    falsified: int
    odr_hz: float
    true_hz: float
    off_us: float
    restart_off_us: float


class Driven:
    """An ELF file, the sensor, the host.  fine: INTERNAL_FREQ_FINE; faults, stalls: as the model and the machine take them."""

    def __init__(self, elf: Path, fine: int = 7, faults: Iterable[Fault] = (), stalls: Iterable[tuple[float, float]] = ()):
        oscillator = Oscillator(fine - 1, fine)
        self.clock_hz = oscillator.clock_hz()
        self.sensor = Watched(numbered(self.clock_hz), oscillator, faults, keep=True)
        self.machine = Machine(elf, SensorPort(self.sensor), stalls=stalls)
        self.decoder, self.t_s, self.bytes = StreamDecoder(), 0.0, 0
        self.info: Info | None = None
        self.board: BoardStatus | None = None
        self.counts = dict.fromkeys(FAULTS, 0)
        self.troubles: list[Trouble] = []
        self.said: list[FaultCounts] = []
        self._chunks: list[SampleChunk] = []
        self._asked, self._answers = 0, {}

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

    def _take(self, event) -> None:
        if isinstance(event, SampleChunk):
            self._chunks.append(event)
        elif isinstance(event, Info):
            self.info = event
        elif isinstance(event, BoardStatus):
            self.board = event
        elif isinstance(event, CommandResult):
            self._answers[event.sequence] = event.result
        elif isinstance(event, FaultCounts):
            self.said.append(event)
            self.counts = dict(zip(FAULTS, event.counts, strict=True))
        elif isinstance(event, Trouble):
            self.troubles.append(event)

    def ask(self, command: int, *values: float, within_s: float = 4.0) -> None:
        """Send a command; RuntimeError where the board does not obey."""
        self._asked += 1
        self.machine.usart1.feed(frames.encode_command(command, self._asked, *values))
        end_s = self.t_s + within_s
        while self._asked not in self._answers and self.t_s < end_s:
            self.run(0.05)
        if (result := self._answers.get(self._asked)) != frames.DONE:
            raise RuntimeError(f"command 0x{command:02X} {values}: result {result}")

    def load(self, seconds: float) -> float:
        """The part of the next seconds in which the core does not sleep."""
        slept, began = self.machine.slept, self.machine.clock.now()
        self.run(seconds)
        return 1 - (self.machine.slept - slept) / (self.machine.clock.now() - began)

    def forget(self) -> None:
        """What was streamed and made up to now does not count."""
        self._chunks, self.troubles = [], []
        self.decoder.lost = 0
        del self.sensor.kept[:-1000]  # the FIFO holds some of them

    def verdict(self) -> Verdict:
        """Of what was streamed since ``forget``."""
        made_s = np.array([t_s for t_s, _ in self.sensor.kept])
        made = np.frombuffer(b"".join(row for _, row in self.sensor.kept), "<i2").reshape(-1, 7)
        ticks = np.rint(made_s * self.clock_hz).astype(np.int64)
        t_us = np.concatenate([chunk.t_us for chunk in self._chunks])
        got = np.concatenate([chunk.registers for chunk in self._chunks])
        spelled = got[:, 0].astype(np.int64) + ROUND // 2 + ROUND * got[:, 1].astype(np.int64)
        place = np.searchsorted(ticks, spelled).clip(0, len(ticks) - 1)
        wrong = (made[place, 1:] != got[:, :6]).any(axis=1) | (np.abs(made[place, 0] - got[:, 6]) > 1)
        wrong |= np.diff(place, prepend=-1) <= 0
        place, t_us = place[~wrong], t_us[~wrong]
        off_us = t_us - 1e6 * made_s[place]
        step = np.abs(np.diff(made_s[place], prepend=made_s[place[0]]) * self.clock_hz)
        between_runs = np.abs(step - np.rint(step)) > 0.01  # the grid of samples is another's
        runs = np.cumsum(between_runs | np.concatenate([[False], np.abs(np.diff(off_us)) > 2 * STAMP_US]))
        centre = np.array([np.median(off_us[runs == run]) for run in range(runs[-1] + 1)])
        off_us = off_us - centre[runs]
        first = place[0]
        count = place[-1] - first + 1
        longest = np.bincount(runs).argmax()
        best = np.flatnonzero(runs == longest)
        slope = np.polyfit(made_s[place[best]] - made_s[first], off_us[best], 1)[0] * 1e-6 if len(best) > 1000 else 0.0
        true_hz = self.clock_hz / max(1, round(float(np.median(np.diff(ticks)))))
        return Verdict(
            made=int(count),
            streamed=len(got),
            missing=int(count - len(place)),
            said_lost=self.decoder.lost,
            falsified=int(np.count_nonzero(wrong) + np.count_nonzero(np.abs(off_us) > STAMP_US)),
            odr_hz=true_hz / (1 + slope),
            true_hz=true_hz,
            off_us=float(np.abs(off_us).max()),
            restart_off_us=float(np.abs(centre - centre[0]).max()),
        )

    @property
    def objections(self) -> list[str]:
        """What no real board would do, of the microcontroller and of the sensor."""
        return [*self.machine.bus.objections, *self.sensor.objections]


def cycles_per_sample(load: float, odr_hz: float) -> float:
    """Of the core, asleep or not counted apart."""
    return load * CORE_HZ / odr_hz


def nominal_code(odr_hz: float) -> int:
    """Ticks of the 6667 Hz clock in a sample."""
    return 2 ** round(np.log2(CLOCK_HZ / odr_hz))
