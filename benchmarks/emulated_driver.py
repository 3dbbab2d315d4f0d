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
from session.bench.events import BOARD_TYPE, FAULTS, STANDIN, BoardStatus, CommandResult, FaultCounts, Info, Trouble
from session.io.units import DEG, G
from tinygc.annexes.emulated.bus import CORE_HZ
from tinygc.annexes.emulated.machine import Machine
from tinygc.annexes.emulated.readings import CLOCK_HZ, Fault, Oscillator, Silicon
from tinygc.annexes.emulated.sensor import Asm330lhh, SensorPort
from tinygc.annexes.emulated.settling import ACCEL_UNSETTLED, GYRO_UNSETTLED, MASKS

BAUD = 2_000_000
NOMINAL_HZ = (12.5, 26.0, 52.0, 104.0, 208.0, 417.0, 833.0, 1667.0, 3333.0, 6667.0)
#: at most this far is a stamp from the time of its sample: a tick of the sensor, 25 us (1 +- 0.19), and the frame's whole microseconds
STAMP_US = 33.0
TICK_US = 31.0  #: longest tick of a sensor: what a tick of jitter may add
SLICE_S = 0.25
LATENCY_S = 1.0  #: samples of so long before the end may still be on their way
ROUND = 30_011  #: a prime: the sample's number is written in two digits of it


def built(folder: Path, odr_hz: float = 417.0, baud: int = BAUD, **variables: str) -> Path:
    """The recorder's ELF file; variables: of the Makefile.  RuntimeError where it cannot be built."""
    if missing := measure.tools_missing():
        raise RuntimeError(missing)
    return measure.build("recorder.elf", folder, folder, ODR_HZ=f"{odr_hz:g}", BAUD=str(baud), **variables)


def numbered(clock_hz: float):
    """A motion whose registers, at 500 dps and 4 g, spell the number of the 6667 Hz clock's tick; every one of the six depends on it."""

    def motion(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        tick = np.rint(t_s * clock_hz).astype(np.int64)
        low, high = tick % ROUND - ROUND // 2, tick // ROUND
        gyro = np.column_stack([low, high, tick * 7 % ROUND - ROUND // 2])
        accel = np.column_stack([-low, high + 9, tick * 11 % ROUND - ROUND // 2])
        return gyro * (0.0175 * DEG), accel * (0.122e-3 * G), 25.0 + np.floor(t_s / 16) / 256

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
    """made: settled samples of the sensor from the first that was streamed to the last, or to ``LATENCY_S`` before the end where it is
    later; streamed; missing: settled samples that were not; said_lost: numbers that the stream leaves out; doubled: streamed once more;
    falsified: streamed samples that the sensor did not make, or at another time; unsettled: streamed ones that the sensor made before its
    filters had settled, or that are the mask's values.

    odr_hz: as the stamps show it; true_hz; off_us: largest distance of a stamp from the true time within a run of the sensor;
    restart_off_us: by how much a further run of the sensor is off against the first one.
    """

    made: int
    streamed: int
    missing: int
    said_lost: int
    doubled: int
    falsified: int
    unsettled: int
    odr_hz: float
    true_hz: float
    off_us: float
    restart_off_us: float


class Driven:
    """An ELF file, the sensor, the host.  fine: INTERNAL_FREQ_FINE; faults, stalls, silicon: as the model and the machine take them.

    made_up: samples of the board's stand-in, which count for nothing.
    """

    def __init__(
        self,
        elf: Path,
        fine: int = 7,
        faults: Iterable[Fault] = (),
        stalls: Iterable[tuple[float, float]] = (),
        silicon: Silicon | None = None,
    ):
        self.silicon = silicon or Silicon()
        oscillator = Oscillator(fine - 1, fine)
        self.clock_hz = oscillator.clock_hz(self.silicon.ticks_per_period)
        self.sensor = Watched(numbered(self.clock_hz), oscillator, faults, keep=True, silicon=self.silicon)
        self.machine = Machine(elf, SensorPort(self.sensor), stalls=stalls)
        self.decoder, self.t_s, self.bytes = StreamDecoder(), 0.0, 0
        self.info: Info | None = None
        self.board: BoardStatus | None = None
        self.counts = dict.fromkeys(FAULTS, 0)
        self.troubles: list[Trouble] = []
        self.said: list[FaultCounts] = []
        self._rest, self._frames, self._from_standin = b"", list[bytes](), False
        self._asked, self._answers = 0, {}
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
        """Keep the sensor's sample frames as they are: the decoder does not tell their numbers."""
        *whole, self._rest = (self._rest + data).split(b"\0")
        for frame in whole:
            if len(frame) != frames.SAMPLE_BYTES:
                if len(frame) >= frames.SHORTEST_OTHER:
                    (message,), (good,) = frames.decode_blocks(np.frombuffer(frame, np.uint8)[None])
                    if good and message[0] == BOARD_TYPE:
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

    @property
    def streamed(self) -> int:
        """Samples of the sensor that were streamed since ``forget``."""
        return len(self._frames)

    def forget(self) -> None:
        """What was streamed and made up to now does not count."""
        self._frames, self.troubles = [], []
        del self.sensor.kept[:-1000]  # the FIFO holds some of them

    def verdict(self) -> Verdict:
        """Of what was streamed since ``forget``.  ValueError where that holds no good sample."""
        if not self._frames:
            raise ValueError("no sample of the sensor was streamed")
        bodies, whole = frames.decode_blocks(np.frombuffer(b"".join(self._frames), np.uint8).reshape(len(self._frames), -1))
        streamed = np.ascontiguousarray(bodies[whole]).view(frames.SAMPLE).ravel()
        got = streamed["registers"]
        t_us = np.append(0, np.cumsum(np.diff(streamed["t_us"].astype(np.int64)) % 2**32))
        kept = self.sensor.kept
        made_s = np.array([made.t_s for made in kept])
        made = np.frombuffer(b"".join(made.registers for made in kept), "<i2").reshape(-1, 7)
        settled = np.array([made.unsettled & (GYRO_UNSETTLED | ACCEL_UNSETTLED) == 0 for made in kept])
        masked = (got[:, :6] >= min(MASKS)).any(axis=1)
        keys = _spelled(made[:, 1:3])
        order = np.argsort(keys, kind="stable")
        place = order[np.searchsorted(keys[order], _spelled(got[:, :2])).clip(0, len(keys) - 1)]
        wrong = (made[place, 1:] != got[:, :6]).any(axis=1) | (np.abs(made[place, 0] - got[:, 6]) > 1)
        unsettled = masked | (~wrong & ~settled[place])
        doubled = np.zeros(len(got), bool)
        good = np.flatnonzero(~wrong & ~unsettled)
        newest = np.maximum.accumulate(np.append(-1, place[good]))[:-1]
        doubled[good] = place[good] == newest
        wrong[good] |= place[good] < newest
        kept_place = ~wrong & ~unsettled & ~doubled
        if not kept_place.any():
            raise ValueError(f"none of {len(got)} streamed samples is good: {np.count_nonzero(unsettled)} unsettled")
        numbered = np.diff(streamed["sequence"][kept_place].astype(np.int64)) % 2**16
        truly = np.diff(place[kept_place])
        numbered += np.rint((truly - numbered) / 2**16).astype(np.int64) * 2**16  # the number has 16 bits
        limit_us = STAMP_US + TICK_US * self.silicon.stamp_jitter_ticks
        stamps = self._stamps(made_s, place[kept_place], t_us[kept_place], limit_us)
        late = np.flatnonzero(made_s < self.t_s - LATENCY_S)
        first, last = place[kept_place][0], max(place[kept_place][-1], late[-1] if len(late) else 0)
        count = int(np.count_nonzero(settled[first : last + 1]))
        return Verdict(
            made=count,
            streamed=len(got),
            missing=int(count - np.count_nonzero(kept_place)),
            said_lost=int(np.sum(numbered - 1)),
            doubled=int(np.count_nonzero(doubled)),
            falsified=int(np.count_nonzero(wrong & ~masked) + np.count_nonzero(~whole) + stamps.pop("false")),
            unsettled=int(np.count_nonzero(unsettled)),
            **stamps,
        )

    def _stamps(self, made_s: np.ndarray, place: np.ndarray, t_us: np.ndarray, limit_us: float) -> dict[str, float]:
        """The stamps t_us of the samples made at made_s[place]: how many are false, and the last four figures of ``Verdict``."""
        off_us = t_us - 1e6 * made_s[place]
        step = np.abs(np.diff(made_s[place], prepend=made_s[place[0]]) * self.clock_hz)
        between_runs = np.abs(step - np.rint(step)) > 0.01  # the grid of samples is another's
        runs = np.cumsum(between_runs | np.concatenate([[False], np.abs(np.diff(off_us)) > 2 * limit_us]))
        centre = np.array([np.median(off_us[runs == run]) for run in range(runs[-1] + 1)])
        off_us = off_us - centre[runs]
        longest = np.bincount(runs).argmax()
        best = np.flatnonzero(runs == longest)
        slope = np.polyfit(made_s[place[best]] - made_s[place[0]], off_us[best], 1)[0] * 1e-6 if len(best) > 1000 else 0.0
        true_hz = self.clock_hz / max(1, round(float(np.median(np.diff(made_s))) * self.clock_hz))
        return {
            "false": int(np.count_nonzero(np.abs(off_us) > limit_us)),
            "odr_hz": true_hz / (1 + slope),
            "true_hz": true_hz,
            "off_us": float(np.abs(off_us).max()),
            "restart_off_us": float(np.abs(centre - centre[0]).max()),
        }

    @property
    def objections(self) -> list[str]:
        """What no real board would do, of the microcontroller and of the sensor."""
        return [*self.machine.bus.objections, *self.sensor.objections]


def _spelled(registers: np.ndarray) -> np.ndarray:
    """The number that two registers spell."""
    return registers[:, 0].astype(np.int64) + ROUND // 2 + ROUND * registers[:, 1].astype(np.int64)


def cycles_per_sample(load: float, odr_hz: float) -> float:
    """Of the core, asleep or not counted apart."""
    return load * CORE_HZ / odr_hz


def nominal_code(odr_hz: float) -> int:
    """Ticks of the 6667 Hz clock in a sample."""
    return 2 ** round(np.log2(CLOCK_HZ / odr_hz))
