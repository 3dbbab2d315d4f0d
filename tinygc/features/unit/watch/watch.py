r"""The watch of one stream: samples in, events out; constant memory however long it is.

    samples -> calibrated rates -> detector (blocks, windows, tests) -> rests, alarms
                               \-> turns between rests -> closures

After an alarm the present reading is the new state, and the watch goes on.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import CalibrationError, DataError
from session.base.texts import measured, significant
from session.base.units import DEG, MG, NS, NS_PER_S
from session.log.config import read_config
from session.log.stamps import pace_of
from tinygc.closure.motion import LIMIT_DEG, MINUTE_S, at_rest
from tinygc.deploy.apply import Applicable, model_of, taken
from tinygc.deploy.calibration import Calibration, Stream, surroundings
from tinygc.features.unit.options import SourceOptions, WatchOptions
from tinygc.features.unit.watch.detector import ATTITUDE, COEFFICIENT, Change, Detector, Reading, WindowResult, change_of
from tinygc.features.unit.watch.expectation import (
    BLOCKS,
    CHANNELS,
    CLIP,
    FORCE_WITHIN,
    SHIFTS,
    Settings,
    expect,
    settings,
)
from tinygc.features.unit.watch.source import RESTART, SILENT_S, Item, Remark, items_of, require_source
from tinygc.features.unit.watch.turns import LEAST_RAD, LONGEST_S, Turn, TurnTest
from tinygc.fitting.unit_state import UnitState, read_state
from tinygc.inference.decide import Answer
from tinygc.library.arguments import public
from tinygc.models.linear import LinearModel

DAY_S = 86400.0
#: mean time at rest to a false alarm
FALSE_ALARM_EVERY_S = 30 * DAY_S
#: s of samples that show the data rate
RATE_S = 2.0
#: s: a longer step between two stamps is a gap; shorter ones are a clock's and a port's own
GAP_S, GAP_STEPS = 0.1, 8
#: windows that are remembered for the words of an alarm
REMEMBERED = 4096
#: s without a rest after which that is reported, and then each time twice as long
RESTLESS_S = 600.0
SCHEMA = "tinygc-watch/1"
#: whether a calibration held, by the kind of the answer; None where that is not decided
HELD = {"holds": True, "does not hold": False, "undecided": None}


@dataclass(frozen=True, eq=False)
class Event:
    """kind: ``start``, ``rest``, ``turn``, ``alarm``, ``remark`` or ``end``; t_s since the first sample; words: one line; table:
    figures."""

    kind: str
    t_s: float
    words: str
    table: dict[str, Any]

    def to_json(self) -> dict[str, Any]:
        """A line of ``tinygc-watch/1`` (docs/formats.md)."""
        return {"schema": SCHEMA, "event": self.kind, "t_s": round(self.t_s, 3), "words": self.words, **self.table}


class Watch:
    """known: the model and the files next to it; false_alarm_every_s: mean time at rest to a false alarm."""

    def __init__(self, known: UnitState, false_alarm_every_s: float = FALSE_ALARM_EVERY_S):
        self._known, self._every_s = known, false_alarm_every_s
        self._early: list[Applicable] = []
        self.settings: Settings | None = None
        self.counts: Counter[str] = Counter()
        self.alarms, self.windows, self.rests, self.turns, self.short = 0, 0, 0, 0, 0
        self.t_s = self.rested_s = 0.0
        self._base_ns = 0  # what makes stamps go on over restarts
        self._last_ns: int | None = None
        self._first_ns: int | None = None
        self._zero: tuple[np.ndarray, np.ndarray] | None = None  # rad/s, of the last rest, and its sigma
        self._windows_here = self._quiet_blocks = 0
        self._force_sum, self._force_count = 0.0, 0  # m/s^2, of all samples

    # From items to events.

    def take(self, item: Item) -> Iterator[Event]:
        """Events of what a source gives."""
        if isinstance(item, Applicable):
            if len(item.t_ns):
                yield from self._readings(item)
        elif item.kind == RESTART:
            yield from self._restart(item)
        else:
            yield from self._remark(item)

    def _remark(self, item: Remark) -> Iterator[Event]:
        """Reported at the first, then whenever the count has grown tenfold."""
        before = self.counts[item.kind]
        self.counts[item.kind] += item.count
        now = self.counts[item.kind]
        if before == 0 or len(str(now)) > len(str(before)):
            yield Event("remark", self.t_s, f"{item.words} ({now} so far)", {"what": item.kind, "count": now})

    def _restart(self, item: Remark) -> Iterator[Event]:
        self.counts[RESTART] += 1
        self._end_quiet()
        yield from self._end_rest()
        self._base_ns += 0 if self._last_ns is None else self._last_ns
        self._last_ns = self._first_ns = None
        self._early = []
        if self.settings is not None:
            self._begin(item.switched_on)
        yield Event("remark", self.t_s, item.words, {"what": RESTART, "count": self.counts[RESTART]})

    def _readings(self, item: Applicable) -> Iterator[Event]:
        assert item.accel is not None  # a source without forces was refused
        finite = np.isfinite(item.gyro).all(axis=1) & np.isfinite(item.accel).all(axis=1)
        if not finite.all():
            yield from self._remark(Remark("not a number", "readings are no numbers: left out", int(np.sum(~finite))))
            item = item.rows(finite)
            if not len(item.t_ns):
                return
        if self.settings is None:
            self._early.append(item)
            item = _joined(self._early)
            seconds = float(item.t_ns[-1] - item.t_ns[0]) * NS
            if seconds < RATE_S and len(item.t_ns) < 100_000:
                return
            self._early = []
            yield self._start(item)
        for piece in _parts(item, self._gap_ns):
            yield from self._piece(piece)

    def _start(self, item: Applicable) -> Event:
        """The data rate is known: make the detector."""
        if not (np.diff(item.t_ns) > 0).any():
            raise DataError("the stamps stand still, and show no data rate; import counts samples at a rate: --odr HZ")
        begun = item.t_ns[item.t_ns <= item.t_ns[0] + round(RATE_S * NS_PER_S)]  # so that pieces do not matter
        rate_hz = pace_of(begun if (np.diff(begun) > 0).any() else item.t_ns).rate_hz
        temp_c = None if item.temp is None or not np.isfinite(item.temp).any() else float(np.nanmean(item.temp))
        expected = expect(self._known, rate_hz)
        self.settings = chosen = settings(expected, self._every_s, None if self._known.model.kind == "thermal" else temp_c)
        self.window_s = chosen.window_s
        self._gap_ns = round(max(GAP_S, GAP_STEPS / rate_hz) * NS_PER_S)
        self._period_s = 1 / rate_hz
        self._calibration = Calibration(self._known.model, rate_hz, self._known.table)
        self._begin(True)
        table = {
            "rate_hz": rate_hz,
            "window_s": self.window_s,
            "false_alarm_every_s": self._every_s,
            "zero_sigma_dps": (expected.gyro.offset / DEG).tolist(),
            "window_sigma_dps": (chosen.rate_sigma_rps / DEG).tolist(),
            "gravity_sigma_mg": chosen.gravity_sigma * expected.gravity_mps2 / MG,
            "assumed": list(expected.assumed),
        }
        words = f"watching at {rate_hz:.0f} Hz: rests of {self.window_s * (1 + 2 / BLOCKS):.1f} s or more are tested"
        return Event("start", 0.0, words, table)

    def _begin(self, switched_on: bool) -> None:
        """A stream begins, or goes on after an interruption; switched_on: with another zero, perhaps."""
        assert self.settings is not None
        if switched_on:
            self._detector = Detector(self.settings)
            self._turn_test = TurnTest(self.settings.expected, self._every_s / self.window_s)
            self._since = np.zeros((len(CHANNELS), 2, len(SHIFTS)), dtype=int)
            self._records: deque[Reading] = deque(maxlen=REMEMBERED)
        else:
            self._detector.gap(0)
        self._stream: Stream = self._calibration.stream()
        self._waiting: deque[Applicable] = deque()
        self._left = np.zeros((0, 7))  # samples of no whole block: calibrated and measured rate (3), rad/s, and t_s
        self._forget_turn()
        self._restless_s, self._restless_limit_s = 0.0, RESTLESS_S
        self._windows_here = 0

    def _piece(self, piece: tuple[int, Applicable]) -> Iterator[Event]:
        """Consecutive samples behind a gap of so many ns, 0 for none."""
        gap_ns, item = piece
        if gap_ns < 0:
            yield from self._restart(Remark(RESTART, "the stamps went back: the clock was set, or began again", switched_on=False))
        elif gap_ns > 0:
            samples = round(gap_ns * NS / self._period_s)
            yield from self._remark(Remark("gap", f"a gap of {significant(gap_ns * NS)} s", 1))
            self._end_quiet()
            yield from self._end_rest()
            self._detector.gap(samples)
            self._stream = self._calibration.stream()
            self._waiting.clear()
            self._left = self._left[:0]
            self._forget_turn()
        self._first_ns = int(item.t_ns[0]) if self._first_ns is None else self._first_ns
        self._last_ns = int(item.t_ns[-1]) - self._first_ns
        self._waiting.append(item)
        omega = self._stream.push(item.gyro, item.accel, item.temp)
        if len(omega):
            yield from self._calibrated(omega, _joined(list(taken(self._waiting, len(omega)))))

    def _calibrated(self, omega: np.ndarray, item: Applicable) -> Iterator[Event]:
        n = self._detector.chosen.samples
        t_s = ((item.t_ns - (self._first_ns or 0)) + self._base_ns) * NS
        assert item.accel is not None
        self._force_sum += float(np.linalg.norm(item.accel, axis=1).sum())
        self._force_count += len(item.accel)
        rows, k = np.concatenate([self._left, np.column_stack([omega, item.gyro, t_s])]), 0
        for quiet, result in self._detector.feed(omega, item.accel, item.temp):
            block = rows[k : k + n]
            k += n
            self.t_s = float(block[-1, 6])
            yield from self._block(block, quiet, result)
        self._left = rows[k:]

    # Blocks: rests, and the turns between them.

    def _forget_turn(self) -> None:
        self._turn: Turn | None = None
        self._direction: np.ndarray | None = None  # force of the last tested rest, in g
        self._pending: deque[np.ndarray] = deque()  # blocks since then that may be those of the next tested window

    def _block(self, block: np.ndarray, quiet: bool, result: WindowResult | None) -> Iterator[Event]:
        seconds = len(block) * self._period_s
        if quiet:
            self.rested_s += seconds
            self._quiet_blocks += 1
        else:
            self._end_quiet()
        self._restless_s = 0.0 if result is not None else self._restless_s + seconds
        if self._restless_s > self._restless_limit_s:
            self._restless_limit_s *= 2
            why = f"no rest of {self.window_s * (1 + 2 / BLOCKS):.1f} s for {self._restless_s / 60:.0f} min: nothing is tested"
            yield Event("remark", self.t_s, why + self._wrong_force(), {"what": "no rest", "count": 1})
        if not quiet:
            yield from self._end_rest()
        if self._direction is not None:
            yield from self._follow(block, result)
        if result is None:
            return
        self._restless_limit_s = RESTLESS_S
        self.windows += 1
        if self._direction is None:
            self._pending.append(block)
        self._direction = result.window.direction[:, 0]
        self._resting_rps = block[:, 3:6].mean(axis=0)
        self._last = *self._detector.filter.rate.total(COEFFICIENT), result.window.gravity[0]
        self._windows_here += 1
        yield from self._tested(result)

    def _end_quiet(self) -> None:
        """A quiet stretch has ended; one of a second or more in which no window was complete is a rest that was passed over."""
        self.short += self._quiet_blocks >= BLOCKS // 2 and not self._windows_here
        self._quiet_blocks = 0

    def _wrong_force(self) -> str:
        """A remark where the mean length of the force is not that of a rest."""
        assert self.settings is not None
        mean, gravity = self._force_sum / max(self._force_count, 1), self.settings.expected.gravity_mps2
        if not self._force_count or abs(mean / gravity - 1) < FORCE_WITHIN:
            return ""
        return f"; force {mean:.3g} m/s², expected {gravity:.3g}: check its unit and full scale"

    def _follow(self, block: np.ndarray, result: WindowResult | None) -> Iterator[Event]:
        """A turn goes from the end of one tested window to the beginning of the next: a hand begins and ends softly."""
        kept = BLOCKS if result is not None else BLOCKS + 1
        while len(self._pending) > kept:
            if self._turn is None:
                self._turn = Turn(self._turn_test.x[:9])
                self._measured_rps = self._resting_rps
                self._zero_rps = self._detector.filter.rate.total(ATTITUDE)[0][:, 0] * self._detector.chosen.rate_sigma_rps
            gone = self._pending.popleft()
            self._turn.add(gone[:, :3] - self._zero_rps, gone[:, 3:6] - self._measured_rps, np.full(len(gone), self._period_s))
        turn = self._turn
        if result is not None:
            self._turn = None
            self._pending.clear()
            if turn is not None and turn.angle > LEAST_RAD:
                yield from self._closed(turn, result)
        self._pending.append(block)
        if turn is not None and turn.seconds > LONGEST_S:
            self._forget_turn()

    def _closed(self, turn: Turn, result: WindowResult) -> Iterator[Event]:
        """result: the window after the turn.  A zero that has jumped did so at an unknown moment of the turn."""
        innovation = result.whole[:3, 0] * result.sigma[0, 0]
        jumped = np.max(np.where(np.abs(result.whole[:3, 0]) >= CLIP, innovation**2, 0.0))
        variance = float(np.max(self._detector.chosen.rate_sigma_rps) ** 2 * (self._detector.filter.rate.total(ATTITUDE)[1][0] + jumped))
        assert self._direction is not None
        closure = self._turn_test.evaluate(turn, self._direction, result.window.direction[:, 0], variance, self.window_s)
        self.turns += 1
        tilt, sigma, angle = (float(np.linalg.norm(closure.tilt_rad)) / DEG, closure.sigma_rad / DEG, turn.angle / DEG)
        table = {"tilt_deg": tilt, "sigma_deg": sigma, "chi_square": closure.square, "seconds": turn.seconds, "angle_deg": angle}
        words = f"turn of {angle:.0f}° in {turn.seconds:.1f} s: tilt {tilt:.3f}°, stated {sigma:.3f}° (one sigma)"
        yield Event("turn", self.t_s, words, table)
        if closure.alarm:
            self.alarms += 1
            advice = "verify with ten turns, or calibrate again"
            words = f"ALARM closure: turns are worse than stated, the last by {tilt:.3f}°"
            yield Event("alarm", self.t_s, words, {"channel": "closure", "channels": ["closure"], **table, "advice": advice})

    # Windows: what the tests find.

    def _tested(self, result: WindowResult) -> Iterator[Event]:
        f = self._detector.filter
        self._records.append((self.t_s, result))
        alarmed = {int(k): int(result.alarm[k, 0]) for k in np.flatnonzero(result.alarm[:, 0])}
        if alarmed:
            begun = {k: self.windows - int(self._since[k, 0 if sign > 0 else 1, int(result.shift[k, 0])]) for k, sign in alarmed.items()}
            yield self._alarm(alarmed, {k: change_of(self._records, k, begun[k], self._detector.chosen) for k in alarmed})
            self._records.clear()
        self._since[f.cusum[..., 0] == 0] = self.windows

    def _alarm(self, alarmed: dict[int, int], changes: dict[int, Change]) -> Event:
        """One event of all channels that alarm in a window: their signs, and what has changed.  Its table is of the largest change."""
        c = self._detector.chosen
        self.alarms += 1
        units = np.r_[c.rate_sigma_rps / DEG, c.gravity_sigma * c.expected.gravity_mps2 / MG]
        sizes = {k: (change.size * float(units[k]), change.sigma * float(units[k])) for k, change in changes.items()}
        zeros = [k for k in alarmed if k < 3]
        first = max(zeros or alarmed, key=lambda k: abs(sizes[k][0]))
        (size, sigma), change = sizes[first], changes[first]
        table: dict[str, Any] = {"channel": CHANNELS[first], "channels": [CHANNELS[k] for k in alarmed], "sign": alarmed[first]}
        table |= {"began_s": round(change.began_s, 1), "kind": change.kind}
        advice = []
        if zeros:
            changed = np.zeros(3)
            changed[zeros] = [sizes[k][0] * DEG for k in zeros]
            zero = self._last[0][:, 0] * c.rate_sigma_rps
            table |= {"size_dps": size, "sigma_dps": sigma, "zero_dps": (zero / DEG).tolist()}
            table |= {"cost_deg": _cost_deg(changed), "zero_cost_deg": _cost_deg(zero)}
            advice.append("use the new bias (verify --write)")
        if 3 in alarmed:
            size, sigma = sizes[3]
            table |= {"size_mg": size, "sigma_mg": sigma}
            table.setdefault("cost_deg", float(np.degrees(abs(size) * 1e-3)))
            advice.append("record the accelerometer in six attitudes, then verify")
        table["advice"] = "; ".join(advice)
        order = sorted(alarmed, key=lambda k: k != first)
        amounts = {k: f"{'+' if sizes[k][0] > 0 else ''}{measured(*sizes[k])} {'mg' if k == 3 else 'dps'}" for k in alarmed}
        words = ", ".join(f"{CHANNELS[k]}: {changes[k].words(amounts[k])}" for k in order)
        return Event("alarm", self.t_s, f"ALARM {words}, {significant(table['cost_deg'], 2)}°{'/min' * bool(zeros)}", table)

    def _end_rest(self) -> Iterator[Event]:
        """The rest has ended: what it was."""
        count, c = self._windows_here, self.settings
        if not count or c is None:
            return
        last, variance, reading = self._last
        self._zero = last[:, 0] * c.rate_sigma_rps, np.sqrt(variance[0]) * c.rate_sigma_rps
        zero, sigma = (each / DEG for each in self._zero)
        gravity = float(reading * c.gravity_sigma * c.expected.gravity_mps2 / MG)
        self.rests += 1
        self._windows_here = 0
        words = f"rest of {count * self.window_s:.0f} s: zero {', '.join(f'{each:+.4f}' for each in zero)} dps, gravity {gravity:+.2f} mg"
        table = {"windows": count, "zero_dps": zero.tolist(), "zero_sigma_dps": sigma.tolist(), "gravity_mg": gravity}
        yield Event("rest", self.t_s, words, table)

    def end(self) -> Iterator[Event]:
        """The stream has ended.  Raises DataError where it is too short to show its data rate."""
        if self.settings is None:
            if self._early:
                item = _joined(self._early)
                if len(item.t_ns) < 2:
                    raise DataError("one sample alone came; a watch needs seconds of them")
                self._early = []
                yield self._start(item)
                for piece in _parts(item, self._gap_ns):
                    yield from self._piece(piece)
        else:
            rest = self._stream.flush()
            if len(rest):
                yield from self._calibrated(rest, _joined(list(taken(self._waiting, len(rest)))))
        self._end_quiet()
        yield from self._end_rest()
        answer = self._answer()
        table = {
            "windows": self.windows,
            "rests": self.rests,
            "short_rests": self.short,
            "turns": self.turns,
            "alarms": self.alarms,
            "rested_s": round(self.rested_s, 1),
            "counts": dict(self.counts),
            "held": HELD[answer.kind],
        }
        if self._zero is not None:
            zero, sigma = ((each / DEG).tolist() for each in self._zero)
            table |= {"zero_dps": zero, "zero_sigma_dps": sigma, "zero_cost_deg": _cost_deg(self._zero[0])}
        yield Event("end", self.t_s, answer.headline, table | ({"advice": answer.do} if answer.do else {}))

    def _answer(self) -> Answer:
        if self._zero is None or self.settings is None:
            short = f" ({self.short} were too short)" if self.short else ""
            force = self._wrong_force() if self.settings else ""
            return Answer("undecided", f"no rest that is long enough in {self.t_s:.0f} s{short}{force}.", "let it rest for some seconds")
        counts = (f"{count} {name}{'s' * (count != 1)}" for name, count in (("rest", self.rests), ("turn", self.turns)))
        what = f"{', '.join(counts)}, {self.t_s / 3600:.2f} h"
        cost_deg, use_new = _cost_deg(self._zero[0]), "use the new bias: verify the model with a rest, --write FILE"
        error = f"zero error {significant(cost_deg, 2)}°/min"
        if self.alarms:
            return Answer("does not hold", f"{self.alarms} alarm{'s' * (self.alarms > 1)} in {what}; {error}.")
        # Whether a minute at rest misses more than the limit by the last zero, as ``verify`` tests it: beyond two sigmas
        size, sigma = (float(np.linalg.norm(each)) for each in self._zero)
        if cost_deg > LIMIT_DEG and size > 2 * sigma:
            return Answer("undecided", f"no alarm, but {error} ({what}).", use_new)
        return Answer("holds", f"no alarm in {what}; {error}.")


def _cost_deg(zero_rps: np.ndarray) -> float:
    """Angle of the attitude's error after a minute at rest with this zero uncorrected, degrees."""
    same = LinearModel(np.eye(3), np.zeros(3))
    return float(np.linalg.norm(at_rest(same, MINUTE_S).largest_error(same, LinearModel(np.eye(3), zero_rps))[1]) / DEG)


# Pieces of readings.


def _joined(items: list[Applicable]) -> Applicable:
    if len(items) == 1:
        return items[0]
    parts = zip(*(vars(each).values() for each in items), strict=True)
    return Applicable(*(None if any(each is None for each in part) else np.concatenate(part) for part in parts))  # type: ignore[arg-type]


def _parts(item: Applicable, gap_ns: int) -> Iterator[tuple[int, Applicable]]:
    """Parts without gaps, each with the ns before it where that is a gap, negative where stamps go back; 0 for none."""
    steps = np.diff(item.t_ns)
    cuts = np.flatnonzero((steps > gap_ns) | (steps < 0)) + 1
    for number, (begin, stop) in enumerate(zip([0, *cuts.tolist()], [*cuts.tolist(), len(item.t_ns)], strict=True)):
        yield 0 if number == 0 else int(steps[begin - 1]), item.rows(slice(begin, stop))


# For Python and for the command.


@dataclass(frozen=True)
class Watched:
    """Result of ``tinygc.watch``: events in their order; held: True, False after an alarm, None where nothing could be tested."""

    events: tuple[Event, ...]

    @property
    def held(self) -> bool | None:
        """Whether the calibration held."""
        return self.events[-1].table["held"] if self.events else None

    @property
    def alarms(self) -> tuple[Event, ...]:
        """The alarms alone."""
        return tuple(event for event in self.events if event.kind == "alarm")

    def summary(self) -> str:
        """One line."""
        return self.events[-1].words if self.events else ""

    def to_json(self) -> list[dict]:
        """A table of ``tinygc-watch/1`` for each event."""
        return [event.to_json() for event in self.events]


def events_of(
    model: Path,
    source: str,
    how: SourceOptions,
    options: WatchOptions,
    ended: Callable[[], bool] = lambda: False,
) -> Iterator[Event]:
    """Events of a source until it ends, or ``ended`` returns true.

    Raises CalibrationError for what cannot be read.
    """
    require_source(source)
    path = model_of(model)
    known = read_state(path, options.noise)
    if known.model.session_s is not None:
        raise CalibrationError(f"{path}: follows the time of its own session; give {path.stem}_at_end.json")
    if options.session is not None:
        known = replace(known, config=read_config(options.session / "session.toml"))
    log = Path(source)
    around = surroundings(known.table, path, log if log.is_file() else Path("-"), options.session)  # as ``apply`` takes them
    if around.accelerometer is None:
        raise CalibrationError(
            f"{path}: no calibration of the accelerometer, which gravity's length needs; fit again, or give --session DIR"
        )
    live = Watch(known, options.false_alarm_every_s)
    items = items_of(source, how, around)
    heard_s, silent = time.monotonic(), False
    with contextlib.suppress(KeyboardInterrupt):  # where a read cannot be waited for otherwise; a second one ends the program
        for item in items:
            if item is not None:
                for event in live.take(item):
                    yield event
                    if ended():
                        break
            if item is not None and not isinstance(item, Remark):
                heard_s, silent = time.monotonic(), False
            elif not silent and time.monotonic() - heard_s > SILENT_S:
                silent = True
                yield Event("remark", live.t_s, f"no sample has come for {SILENT_S:.0f} s", {"what": "silent", "count": 1})
            if ended():
                break
    yield from live.end()


@public(WatchOptions)
def watch(model: Path | str, source: Path | str, **choices: Any) -> Any:
    """Test a log's rests, its gravity and its turns against a calibration, one after the other, as the command ``watch`` does.

    Parameters
    ----------
    model : str or Path
        A model file, or the folder of a session: the model that its fit recommends.
    source : str or Path
        A standard log, a port, ``udp:HOST:PORT``, or ``-`` for standard input; it is watched to its end.

    Returns
    -------
    Watched
        ``held`` (None where nothing could be tested), ``alarms``, ``events`` with ``t_s``, ``words`` and ``table``, ``summary()``.

    Raises
    ------
    CalibrationError
        For what cannot be read; its message is one line.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> folder = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).save(tempfile.mkdtemp() + "/a")
    >>> _ = tinygc.fit(folder, methods=("least_squares",)).save()
    >>> tinygc.watch(folder, folder / "log0001.csv.gz").held
    True

    """
    return Watched(tuple(events_of(Path(model), os.fspath(source), SourceOptions(), WatchOptions(**choices))))
