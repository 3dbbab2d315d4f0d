"""The driver's own program on the emulated STM32F405, beside a sensor whose every sample is known: what was streamed, what was made."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
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
from tinygc.annexes.emulated.readings import CLOCK_HZ, TEMPERATURE_LSB, TEMPERATURE_TICKS, TEMPERATURE_ZERO_C, Fault, Oscillator, Silicon
from tinygc.annexes.emulated.sensor import Asm330lhh, Made, SensorPort
from tinygc.annexes.emulated.settling import ACCEL_UNSETTLED, GYRO_UNSETTLED, MASKS

BAUD = 2_000_000
NOMINAL_HZ = (12.5, 26.0, 52.0, 104.0, 208.0, 417.0, 833.0, 1667.0, 3333.0, 6667.0)
#: at most this far is a stamp from the time of its sample: a tick of the sensor, 25 us (1 +- 0.19), and the frame's whole microseconds
STAMP_US = 33.0
TICK_US = 31.0  #: longest tick of a sensor: what a tick of jitter may add
SLICE_S = 0.25
LATENCY_S = 1.0  #: samples of so long before the end may still be on their way
ROUND = 30_011  #: a prime: the sample's number is written in two digits of it
#: the temperature's register rises so quickly that it says when it was read to 10 ms, and begins anew after so many steps
WARMTH_LSB_S, WARMTHS = 100, 40_000
#: a temperature is as old as it comes through the FIFO, at 12.5 Hz, and a slot more: it counts when the slot behind its own is whole
WARMTH_TICKS, WARMTH_SLOTS = TEMPERATURE_TICKS[2], 1
LONG = 32  #: bytes of a transfer that reads words of the FIFO


def built(folder: Path, odr_hz: float = 417.0, baud: int = BAUD, **variables: str) -> Path:
    """The recorder's ELF file; variables: of the Makefile.  RuntimeError where it cannot be built."""
    if missing := measure.tools_missing():
        raise RuntimeError(missing)
    return measure.build("recorder.elf", folder, folder, ODR_HZ=f"{odr_hz:g}", BAUD=str(baud), **variables)


def numbered(clock_hz: float, oscillator: Oscillator | None = None):
    """A motion whose registers, at 500 dps and 4 g, spell the number of the 6667 Hz clock's tick; every one of the six depends on it.
    The temperature's register rises by ``WARMTH_LSB_S``."""
    elapsed_s = (oscillator or Oscillator()).elapsed_s

    def motion(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        tick = np.rint(elapsed_s(t_s) * clock_hz).astype(np.int64)
        low, high = tick % ROUND - ROUND // 2, tick // ROUND
        gyro = np.column_stack([low, high, tick * 7 % ROUND - ROUND // 2])
        accel = np.column_stack([-low, high + 9, tick * 11 % ROUND - ROUND // 2])
        warmth = np.floor(t_s * WARMTH_LSB_S) % WARMTHS - WARMTHS // 2
        return gyro * (0.0175 * DEG), accel * (0.122e-3 * G), TEMPERATURE_ZERO_C + warmth / TEMPERATURE_LSB

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


class HeldPort(SensorPort):
    """From a time on, one in so many bursts waits amid its bytes for 22 to 60 ms, in which nothing is clocked, as where the core clocks
    them itself and is kept from it; stall: holds the core for so long, s.  holds: how many there were;
    held_s: their time."""

    def __init__(self, sensor: Asm330lhh, one_in: int, from_s: float):
        super().__init__(sensor)
        self._draw, self._one_in, self._from_s = np.random.default_rng(0), one_in, from_s
        self.holds, self.held_s = 0, 0.0
        self.stall: Callable[[float], None] = lambda lasts_s: None

    def transfer(self, out: bytes, t_s: float, byte_s: float) -> bytes:
        """As the sensor's own, in two parts."""
        if t_s < self._from_s or len(out) < LONG or self._draw.integers(self._one_in):
            return super().transfer(out, t_s, byte_s)
        head, lasts_s = int(self._draw.integers(len(out))), float(self._draw.uniform(0.022, 0.060))
        self.holds += 1
        self.held_s += lasts_s
        self.stall(lasts_s)
        return super().transfer(out[:head], t_s, byte_s) + super().transfer(out[head:], t_s + head * byte_s + lasts_s, byte_s)


@dataclass(frozen=True)
class Verdict:
    """made: settled samples of the sensor from the first that was streamed to the last, or to ``LATENCY_S`` before the end where it is
    later; streamed; missing: settled samples that were not; said_lost: numbers that the stream leaves out; doubled: streamed once more;
    falsified: streamed samples that the sensor did not make, at another time, or with a temperature that is none of its last period;
    unsettled: streamed ones that the sensor made before its filters had settled, or that are the mask's values.

    odr_hz: as the stamps show it; true_hz; off_us: largest distance of a stamp from the time of its sample, by the sensor's oscillator,
    within a run of the sensor: as long as its clock of samples goes on; restart_off_us: by how much a further run is off against the first.
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
    """An ELF file, the sensor, the host.  fine: INTERNAL_FREQ_FINE; faults, stalls, silicon, drift_ppm_s: as the model and the machine
    take them; held: (one in so many bursts, from a time on) waits (``HeldPort``).

    made_up: samples of the board's stand-in, which count for nothing.
    """

    def __init__(
        self,
        elf: Path,
        fine: int = 7,
        faults: Iterable[Fault] = (),
        stalls: Iterable[tuple[float, float]] = (),
        silicon: Silicon | None = None,
        drift_ppm_s: float = 0.0,
        held: tuple[int, float] | None = None,
    ):
        self.silicon = silicon or Silicon()
        self.oscillator = oscillator = Oscillator(fine - 1, fine, drift_ppm_s=drift_ppm_s)
        self.clock_hz = oscillator.clock_hz(self.silicon.ticks_per_period)
        self.sensor = Watched(numbered(self.clock_hz, oscillator), oscillator, faults, keep=True, silicon=self.silicon)
        self.port = HeldPort(self.sensor, *held) if held else SensorPort(self.sensor)
        self.machine = Machine(elf, self.port, stalls=stalls)
        if isinstance(self.port, HeldPort):
            self.port.stall = self.machine.stall
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
        found = judged(streamed, self.sensor.kept, self.t_s - LATENCY_S, self.clock_hz, self.silicon, self.oscillator)
        return replace(found, falsified=found.falsified + int(np.count_nonzero(~whole)))

    @property
    def objections(self) -> list[str]:
        """What no real board would do, of the microcontroller and of the sensor."""
        return [*self.machine.bus.objections, *self.sensor.objections]


def judged(
    streamed: np.ndarray,
    kept: list[Made],
    until_s: float,
    clock_hz: float,
    silicon: Silicon,
    oscillator: Oscillator,
) -> Verdict:
    """Samples of the stream, ``frames.SAMPLE``, against all that a sensor with a numbered motion made; until_s: what was made later may
    still be on its way.  ValueError where none is good."""
    got = streamed["registers"]
    steps_us = (np.diff(streamed["t_us"].astype(np.int64)) + 2**31) % 2**32 - 2**31
    t_us = np.append(0, np.cumsum(steps_us))
    made_s = oscillator.elapsed_s(np.array([made.t_s for made in kept]))
    made = np.frombuffer(b"".join(made.registers for made in kept), "<i2").reshape(-1, 7)
    settled = np.array([made.unsettled & (GYRO_UNSETTLED | ACCEL_UNSETTLED) == 0 for made in kept])
    masked = (got[:, :6] >= min(MASKS)).any(axis=1)
    keys = _spelled(made[:, 1:3])
    order = np.argsort(keys, kind="stable")
    place = order[np.searchsorted(keys[order], _spelled(got[:, :2])).clip(0, len(keys) - 1)]
    wrong = (made[place, 1:] != got[:, :6]).any(axis=1)
    unsettled = masked | (~wrong & ~settled[place])
    doubled = np.zeros(len(got), bool)
    good = np.flatnonzero(~wrong & ~unsettled)
    newest = np.maximum.accumulate(np.append(-1, place[good]))[:-1]
    doubled[good] = place[good] == newest
    wrong[good] |= place[good] < newest
    once = ~wrong & ~unsettled & ~doubled
    if not once.any():
        raise ValueError(f"none of {len(got)} streamed samples is good: {np.count_nonzero(unsettled)} unsettled")
    place = place[once]
    numbered = np.diff(streamed["sequence"][once].astype(np.int64)) % 2**16
    numbered += np.rint((np.diff(place) - numbered) / 2**16).astype(np.int64) * 2**16  # the number has 16 bits
    grid = np.array([made.grid for made in kept])
    off_us, starts_us = _stamps_off(made_s[place], t_us[once], grid[place])
    mistimed = np.abs(off_us) > STAMP_US + TICK_US * silicon.stamp_jitter_ticks
    slot_s = float(np.median(np.diff(made_s)))
    stale = _stale(made_s, made[:, 0], place, got[once, 6], WARMTH_TICKS / clock_hz + WARMTH_SLOTS * slot_s)
    longest = np.flatnonzero(grid[place] == np.bincount(grid[place]).argmax())
    slope = np.polyfit(made_s[place[longest]] - made_s[place[0]], off_us[longest], 1)[0] * 1e-6 if len(longest) > 1000 else 0.0
    true_hz = clock_hz / max(1, round(slot_s * clock_hz))
    late = np.flatnonzero(made_s < until_s)
    count = int(np.count_nonzero(settled[place[0] : max(place[-1], late[-1] if len(late) else 0) + 1]))
    return Verdict(
        made=count,
        streamed=len(got),
        missing=int(count - np.count_nonzero(once)),
        said_lost=int(np.sum(numbered - 1)),
        doubled=int(np.count_nonzero(doubled)),
        falsified=int(np.count_nonzero(wrong & ~masked) + np.count_nonzero(mistimed | stale)),
        unsettled=int(np.count_nonzero(unsettled)),
        odr_hz=true_hz / (1 + slope),
        true_hz=true_hz,
        off_us=float(np.abs(off_us).max()),
        restart_off_us=float(np.abs(starts_us).max()),
    )


def _stamps_off(made_s: np.ndarray, t_us: np.ndarray, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By how much each stamp is off against the middle of its run, and by how much that is off against the first run's.  A run ends only
    where the sensor's clock of samples began anew, so a time that jumps or strays amid one is off."""
    off_us = t_us - 1e6 * made_s
    _, run = np.unique(grid, return_inverse=True)
    centre = np.array([np.median(off_us[run == n]) for n in range(run[-1] + 1)])
    return off_us - centre[run], centre - centre[0]


def _stale(made_s: np.ndarray, warmth: np.ndarray, place: np.ndarray, got: np.ndarray, period_s: float) -> np.ndarray:
    """Which temperatures of the samples at ``place`` are none of the last period; where samples are missing within it, a temperature may
    be missing as well, and the last one that came within a whole period holds on."""
    at_s = made_s[place]
    before = (np.searchsorted(at_s, at_s - period_s, side="right") - 1).clip(0)
    gaps = np.cumsum(np.diff(place, prepend=place[0] - 1) > 1)
    whole = (gaps == gaps[before]) & (at_s - period_s >= at_s[0])
    oldest_s = np.maximum.accumulate(np.where(whole, at_s, at_s[0]) - period_s)
    oldest = (np.searchsorted(made_s, oldest_s, side="right") - 1).clip(0)
    newest = warmth[place].astype(int)
    return (newest - got) % WARMTHS > (newest - warmth[oldest]) % WARMTHS


def _spelled(registers: np.ndarray) -> np.ndarray:
    """The number that two registers spell."""
    return registers[:, 0].astype(np.int64) + ROUND // 2 + ROUND * registers[:, 1].astype(np.int64)


def cycles_per_sample(load: float, odr_hz: float) -> float:
    """Of the core, asleep or not counted apart."""
    return load * CORE_HZ / odr_hz


def nominal_code(odr_hz: float) -> int:
    """Ticks of the 6667 Hz clock in a sample."""
    return 2 ** round(np.log2(CLOCK_HZ / odr_hz))
