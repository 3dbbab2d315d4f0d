"""A virtual board: streams a session through a pseudo-terminal, with the faults of a real line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from session.base.errors import CalibrationError, DataError
from session.base.files import MOST_TOML, read_text
from session.base.progress import Reporter, no_report
from session.base.results import write_text_whole
from session.base.texts import comment
from session.base.units import DEG, G
from session.bench import frames
from session.bench.clocks import Clock
from session.bench.events import HEADER, Info
from session.log.folder import Session, read_session
from session.log.registers import DEFAULT, RegisterUnits
from session.log.samples import Samples
from session.log.sensors import REGISTER_MAX
from session.log.written import toml_text
from tinygc.simulation.movement import PEAK_RPS, MovementPlan, not_faster, stroke
from tinygc.simulation.options import SimulatedUnit, SimulationOptions
from tinygc.simulation.simulator import plan_of, simulate_session

if TYPE_CHECKING:
    from tinygc.simulation.terminal import Terminal

# Faults between a sensor and its host, drawn from a seed.


@dataclass(frozen=True)
class LineFaults:
    """Faults of a serial line.

    lost, torn: probability that a message is lost, or truncated; flip: probability that a bit is flipped; garbage: count of random
    bytes at each start of the board; reset, unplug: interval in s of device time, 0 for never.
    """

    lost: float = 0.0
    flip: float = 0.0
    torn: float = 0.0
    garbage: float = 0.0
    reset: float = 0.0
    unplug: float = 0.0

    @classmethod
    def parse(cls, text: str) -> LineFaults:
        """Parse text such as ``lost=0.05,flip=0.01``; CalibrationError names the wrong word."""
        known = [field.name for field in fields(cls)]
        chosen = {}
        for word in filter(None, text.split(",")):
            name, _, number = (part.strip() for part in word.partition("="))
            try:
                chosen[name] = float(number)
            except ValueError:
                raise CalibrationError(f"--faults {word!r}: expected NAME=NUMBER") from None
            most = 1.0 if name in known[:3] else 1e9
            if name not in known or not 0 <= chosen[name] <= most:
                raise CalibrationError(f"--faults {word!r}: expected one of {', '.join(known)}, from 0 to {most:.0f}")
        return cls(**chosen)


def spoil(messages: list[bytes], faults: LineFaults, rng: np.random.Generator) -> bytes:
    """Bytes of the messages as they arrive."""
    if faults.lost:
        messages = [message for message, luck in zip(messages, rng.random(len(messages)), strict=True) if luck >= faults.lost]
    if faults.torn:
        torn = rng.random(len(messages)) < faults.torn
        messages = [message[: rng.integers(len(message))] if cut else message for message, cut in zip(messages, torn, strict=True)]
    data = b"".join(messages)
    return flipped(data, faults.flip, rng) if faults.flip else data


def flipped(data: bytes, probability: float, rng: np.random.Generator) -> bytes:
    """Flip each bit with this probability."""
    bits = np.unpackbits(np.frombuffer(data, np.uint8))
    return np.packbits(bits ^ (rng.random(len(bits)) < probability)).tobytes()


# A guided session needs the table on its index mark before the closure run, with a still there.

#: rest on the mark before the closure run: a fraction of the run's length, or a multiple of still_s, plus seconds; longer than any
#: still that a guided session requests there
REST_PART, REST_STILLS, REST_MORE_S = 0.11, 4.0, 1.5


def onto_the_mark(options: SimulationOptions, plan: MovementPlan) -> MovementPlan:
    """Insert a turn of all gimbals to their zeros, and a still, before the plan's closure run."""
    if plan.closure is None:
        return plan
    rng = np.random.default_rng([options.seed, 99])
    angles = plan.start_rad.copy()
    before = [each for each in plan.strokes if each.start_s < plan.log_s]
    for each in before:
        angles[each.gimbal] += each.change_rad
    begin_s, rest_s = plan.log_s, max(REST_PART * options.closure_s, REST_STILLS * options.still_s) + REST_MORE_S
    back = [-((angle + np.pi) % (2 * np.pi) - np.pi) for angle in angles]
    way = [stroke(gimbal, begin_s, options.turn_s, float(change), rng) for gimbal, change in enumerate(back)]
    if len(slower := not_faster(way, PEAK_RPS)) and slower is not way:  # a slower hand takes longer for the same angle
        seconds = options.turn_s * float(way[0].change_rad / slower[0].change_rad)
        way = [replace(each, duration_s=seconds) for each in way]
    later_s = max(each.duration_s for each in way) + rest_s
    run = [replace(each, start_s=each.start_s + later_s) for each in plan.strokes if each.start_s >= plan.log_s]
    log_s, closure = plan.log_s + later_s, (plan.closure[0] + later_s, plan.closure[1] + later_s)
    turns = (*plan.turns, (begin_s, begin_s + later_s - rest_s))
    return MovementPlan(plan.start_rad, (*before, *way, *run), turns, log_s, closure, plan.duration_s + later_s)


# Readings of the board's sensor: still, then a session, then still without end.

#: length of the still at each end of a session
STILL_S = 0.8


@dataclass(frozen=True, eq=False)
class BoardSource:
    """Session that a board streams.

    rows (n, 7) int16 registers of the session, at info.odr_hz; config: text of its session.toml, or None; units: scaling of the registers,
    if the model and the full scales of ``info`` do not define it; number: which take of a simulated sensor it is (``taken``).
    live: instead of rows, the sensor itself, which gives its next so many; it ends never.
    """

    rows: np.ndarray
    info: Info
    config: str | None = None
    units: RegisterUnits | None = None
    number: int | None = None
    live: Callable[[int], np.ndarray] | None = None

    def in_units(self, rows: np.ndarray) -> np.ndarray:
        """Registers (n, 7) in dps, g and degC; 0 degC if the temperature's scaling is unknown."""
        values, info = rows.astype(float), self.info
        units = self.units or RegisterUnits(info.sensor or DEFAULT, info.gyro_fs_dps, info.accel_fs_g)
        temp_c = units.temperature_c(values[:, 6])
        temp_c = np.zeros(len(rows)) if temp_c is None else temp_c
        return np.column_stack([values[:, :3] * (units.gyro_rps / DEG), values[:, 3:6] * (units.accel_mps2 / G), temp_c])

    def take(self, start: int, stop: int, rng: np.random.Generator) -> np.ndarray:
        """Rows start <= i < stop; rows before 0 and after the last are drawn from the first and the last still."""
        if self.live is not None:
            return self.live(stop - start)
        count = max(1, min(len(self.rows), round(STILL_S * self.info.odr_hz)))
        before = rng.integers(0, count, max(0, min(stop, 0) - start))
        behind = len(self.rows) - 1 - rng.integers(0, count, max(0, stop - max(start, len(self.rows))))
        return self.rows[np.concatenate([before, np.arange(max(start, 0), min(max(stop, 0), len(self.rows))), behind]).astype(np.int64)]


def simulated(options: SimulationOptions, calibrated: bool = True) -> BoardSource:
    """Simulate a session in which the table is set onto its index mark before the closure run, if any, without a break in the data.

    calibrated: whether session.toml holds the accelerometer's pre-calibration.
    """
    from tinygc.simulation.write import config_of, head_of

    simulation = simulate_session(options, plan=onto_the_mark(options, plan_of(options)))
    rows = np.concatenate([part.rows for part in (simulation.log, simulation.closure) if part is not None])
    text = head_of(options) + toml_text(config_of(options, simulation.unit, calibrated))
    return BoardSource(rows, info_of(options, simulation.unit), text)


def info_of(options: SimulationOptions, unit: SimulatedUnit) -> Info:
    """What the board of a simulated sensor reports of itself."""
    return Info(options.gyro_fs_dps, options.accel_fs_g, unit.odr_hz, str(options.unit_drawn_from), options.sensor, options.latitude_deg)


def recorded(folder: Path) -> BoardSource:
    """Logs of a session folder, one after the other, then its closure runs, as registers at the rate of their stamps."""
    session = read_session(folder)
    logs = [log.samples for log in (*session.logs, *session.closures)]
    sensor = session.config.sensor
    odr_hz = (len(logs[0]) - 1) / logs[0].duration_s
    model = "" if sensor.profile is None else sensor.profile.name
    info = Info(sensor.gyro_fs_dps, sensor.accel_fs_g, odr_hz, sensor.serial, model, session.config.site.latitude_deg)
    rows = np.concatenate([_registers(samples, session) for samples in logs])
    return BoardSource(rows, info, read_text(folder / "session.toml", MOST_TOML), sensor.register_units)


def _registers(samples: Samples, session: Session) -> np.ndarray:
    sensor = session.config.sensor
    units = sensor.register_units
    temp = units.temperature_lsb(samples.temp_c, len(samples))
    rows = np.rint(np.column_stack([samples.gyro / units.gyro_rps, samples.accel / units.accel_mps2, temp]))
    if np.abs(rows).max() > REGISTER_MAX + 1:
        raise DataError(f"{session.folder}: holds values beyond the registers of {sensor.gyro_fs_dps:g} dps and {sensor.accel_fs_g:g} g")
    return rows.astype(np.int16)


# Which movement a virtual board streams: switched on again, a real board is the same sensor, but its movement differs.
#
# A take is one movement, with its noise, of one simulated sensor.  The board stores in a file next to its link which takes of a seed it
# has begun, and streams the next one, so an interrupted recording continues with new turns.

MOST_TAKES = 10**9
MOST_BYTES = 100_000


def taken(options: SimulationOptions, take: int) -> SimulationOptions:
    """Options of a take, counted from 1: take 1 has ``options`` itself, a later one another seed with the same unit."""
    if take == 1:
        return options
    (seed,) = np.random.SeedSequence([options.seed, take]).generate_state(1, np.uint64)
    return replace(options, seed=int(seed) >> 1, unit_seed=options.unit_drawn_from)  # within the range of the command line's --seed


def next_take(link: Path, seed: int) -> int:
    """First take of that seed not yet begun by a board at ``link``; 1 without a record."""
    return _known(link).get(seed, 0) + 1


def remember(link: Path, seed: int, take: int) -> None:
    """Record that a board at ``link`` begins this take; a failure to write is ignored."""
    known = _known(link)
    known[seed] = max(take, known.get(seed, 0))
    try:
        write_text_whole(_memory_of(link), "".join(f"{each} {count}\n" for each, count in sorted(known.items())))
    except (OSError, CalibrationError):
        return


def _memory_of(link: Path) -> Path:
    return link.with_name(link.name + ".takes")


def _known(link: Path) -> dict[int, int]:
    """Last take by seed; empty if the file is not valid."""
    try:
        pairs = [tuple(map(int, line.split())) for line in read_text(_memory_of(link), MOST_BYTES).splitlines()]
        known = {seed: take for seed, take in pairs}
    except (OSError, ValueError, CalibrationError):
        return {}
    return known if all(0 < take < MOST_TAKES for take in known.values()) else {}


# Stream a source in real time, or faster by a factor.

TICK_S = 0.004
#: physical units with the digits of a float32, as from a board's printf
ROW, PHYSICAL_ROW = ",".join(["%d"] * 8) + "\n", ",".join(["%d"] + ["%.7g"] * 7) + "\n"
PHYSICAL_HEADER = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c"
CATCH_UP_S = 0.02  #: of delay made up for in a tick
RESET_S = 0.5  #: startup time of a board
UNPLUGGED_S = 1.0  #: host time for which a pulled cable stays out


@dataclass
class VirtualBoard:
    """Stream a ``BoardSource`` to a terminal.

    frames: binary frames instead of text lines; physical: the lines are in dps, g and degC.

    lead_s: still time between the first reader and the session; tail_s: still time after it, then ``run`` returns; None: never
    returns; uptime_s: device time at the start (its 32 bits wrap after 71.6 minutes); clock: source of time.

    Counts: sent (samples that were put on the wire, or corrupted by the faults), starts (of the device).
    """

    source: BoardSource
    terminal: Terminal
    frames: bool = False
    physical: bool = False
    speed: float = 1.0
    lead_s: float = 10.0
    tail_s: float | None = None
    uptime_s: float = 0.0
    faults: LineFaults = field(default_factory=LineFaults)
    seed: int = 0
    report: Reporter = no_report
    clock: Clock = field(default_factory=Clock)
    sent: int = 0
    starts: int = 0

    def run(self) -> None:
        """Stream until the end of the tail."""
        self._rng = np.random.default_rng(self.seed)
        odr_hz = self.source.info.odr_hz
        lead, length = round(self.lead_s * odr_hz), len(self.source.rows)
        last = None if self.tail_s is None else length + round(self.tail_s * odr_hz)
        self._position = -lead  # of the next sample in the source
        began, self._begun, over = self.clock.now_s(), False, False
        self._reset_at, self._unplug_at = (self._next(period) for period in (self.faults.reset, self.faults.unplug))
        self._plug_at = np.inf  # host time
        self._start(self.uptime_s)
        while last is None or self._position < last:
            self.clock.sleep(TICK_S)
            if not self._begun:
                if not self.terminal.has_reader:
                    continue
                self._begun, began = True, self.clock.now_s()
                self.report(f"reader connected: {self.lead_s:g} s still, then it turns by itself, not as record requests")
                self._start(self.uptime_s)
            due = -lead + int((self.clock.now_s() - began) * odr_hz * self.speed)
            # After a delay of the host, catch up in small steps: a burst would overrun the buffer.
            due = min(due, self._position + max(64, int(CATCH_UP_S * odr_hz * self.speed)))
            self._send(due if last is None else min(due, last))
            if not over and self._position >= length:
                over = True
                self.report("session over: still from here on; start it again for more turns")
            if self._position >= self._unplug_at:
                self.report("cable pulled")
                self.terminal.unplug()
                self._unplug_at, self._plug_at = np.inf, self.clock.now_s() + UNPLUGGED_S
            elif self.clock.now_s() >= self._plug_at:
                self.report("cable back: the board starts up")
                self.terminal.plug()
                self._unplug_at, self._plug_at = self._next(self.faults.unplug), np.inf
                self._start(0.0)
            elif self._position >= self._reset_at:
                self.report("the board resets")
                self._reset_at = self._next(self.faults.reset)
                self._start(0.0)
                self._silent_until = self._position + round(RESET_S * self.source.info.odr_hz)

    def _next(self, period_s: float) -> float:
        return self._position + period_s * self.source.info.odr_hz if period_s else np.inf

    def _start(self, uptime_s: float) -> None:
        """Switch on: restart sequence and time."""
        self._sequence, self._zero_us, self._zero = 0, uptime_s * 1e6, self._position
        self._next_info = self._position
        self._silent_until = self._position
        self.starts += 1
        if self.faults.garbage:
            self.terminal.write(self._rng.bytes(int(self.faults.garbage)))
        if not self.frames:
            self.terminal.write(f"{PHYSICAL_HEADER if self.physical else HEADER}\n".encode())

    def _send(self, due: int) -> None:
        """Send all samples before ``due``."""
        while self._position < due:
            stop = min(due, self._next_info) if self._next_info > self._position else self._position
            if stop > self._position:
                self._samples(stop)
            if self._position == self._next_info:
                self._info()
                self._next_info += max(1, round(self.source.info.odr_hz))

    def _samples(self, stop: int) -> None:
        rows = self.source.take(self._position, stop, self._rng)
        t_us = np.rint(self._zero_us + (np.arange(self._position, stop) - self._zero) / self.source.info.odr_hz * 1e6).astype(np.int64)
        if self.frames:
            table = frames.encode_samples(self._sequence + np.arange(len(rows)), t_us, rows)
            self._sequence += len(rows)
            messages = [table.tobytes()] if self.faults == LineFaults() else [row.tobytes() for row in table]
        else:
            table = np.column_stack([t_us % 2**32, self.source.in_units(rows) if self.physical else rows])
            text = (PHYSICAL_ROW if self.physical else ROW) * len(table) % tuple(table.ravel().tolist())
            messages = [text.encode()] if self.faults == LineFaults() else [line.encode() for line in text.splitlines(keepends=True)]
        if self._position >= self._silent_until and self.terminal.write(spoil(messages, self.faults, self._rng)):
            self.sent += len(rows)
        self._position = stop

    def _info(self) -> None:
        if self.frames:
            message = frames.encode_info(self._sequence, self.source.info)
            self._sequence += 1
        else:
            message = f"# {comment(self.source.info.text)}\n".encode()  # a serial number is kept to one line
        if self._position >= self._silent_until:
            self.terminal.write(spoil([message], self.faults, self._rng))
