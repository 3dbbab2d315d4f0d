"""A guided recording: from the port to the guide, from the guide to the coach, and both to the screen."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor

from session.bench.closure_guide import BEGIN
from session.bench.events import BoardStatus, CommandResult, Event, FaultCounts, Info, SampleChunk, SelfTestResult, Trouble
from session.bench.guide import Guide, View, joined_chunks, samples_of
from session.bench.logwriter import NEW_LOG, SHORT_STARTS, SHORT_US
from session.bench.messages import Advice, GuideMessage, Kind, Progress, Stage
from session.bench.operator import Notebook, OperatorInput, Wished
from session.bench.progress import LiveAccelerometerFit
from session.bench.rawfile import RecordingDecision
from session.bench.recorder import Recorder
from session.bench.screen import BoardReporter
from session.io.config import Config
from session.io.errors import CalibrationError, OtherSensor, StorageError
from session.io.samples import Samples

# Whether the board that speaks is the one that the recording is of: by its serial number, and by the rate that it states.

#: 0 is what a firmware sends that knows none
NO_SERIAL = ("", "0")
#: by which the rate that one board states may differ from one connection to the next: three steps of INTERNAL_FREQ_FINE (0.15 % each);
#: two boards are some percent apart, and a board is set to another rate by a factor of two
RATE_WITHIN = 0.005
ANOTHER = "give another sensor another --out"


class SensorIdentity:
    """``require`` it of each info, in all of a recording, resumed or not: two sensors have two calibrations."""

    def __init__(self) -> None:
        self._serial: str | None = None
        self._connection = self._of = 0  # the present one, and that of the rate
        self._odr_hz: float | None = None

    def new_connection(self) -> None:
        """The port was opened again: whoever speaks may be another."""
        self._connection += 1

    def require(self, info: Info) -> None:
        """OtherSensor where it is another's.  Within a connection no board is swapped, and one that measures its rate may correct it."""
        named = info.serial not in NO_SERIAL
        if named and self._serial not in (None, info.serial):
            raise OtherSensor(f"the board says serial={info.serial}, this recording is of {self._serial}; {ANOTHER}")
        changed = self._odr_hz is not None and abs(info.odr_hz / self._odr_hz - 1) > RATE_WITHIN
        if changed and self._connection != self._of:
            who = "this is another board, or it was set otherwise" if named else "this is another board (it has no serial number)"
            raise OtherSensor(f"the board says odr_hz={info.odr_hz:g}, this recording's {self._odr_hz:g}: {who}; {ANOTHER}")
        self._serial = info.serial if named else self._serial
        self._odr_hz, self._of = info.odr_hz, self._connection


# The coach in a thread of its own: it gets what the session has so far, and a recording never waits for its word.

Coach = Callable[[Progress], Advice]


class CoachThread:
    """coach: None where there is none, or where it has failed."""

    def __init__(self, coach: Coach | None) -> None:
        self._coach = coach
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="coach")
        self._asked: Future[Advice] | None = None
        self._asked_at = 0  # so many stills
        self._about: tuple[int, ...] = ()  # what it was asked about last

    def hear(self, guide: Guide) -> list[GuideMessage]:
        """Hand its last word to the guide, and give it what has come since.  Returns what that changes."""
        changes: list[GuideMessage] = []
        if self._asked is not None and self._asked.done():
            asked, self._asked = self._asked, None
            if (error := asked.exception()) is not None:  # whatever it is, it must not end a recording
                self._coach, guide.coached = None, False
                failed = f"the coach has failed ({type(error).__name__}: {error}); any turn will do"
                changes = [GuideMessage(Kind.WARNING, failed, guide.now_s)]
            else:
                changes = guide.advise(asked.result(), self._asked_at)
        if self._asked is None and self._behind(guide):
            self._about, self._asked_at = _about(guide), len(guide.taken.stills)
            if guide.taken.turns and self._coach is not None:
                self._asked = self._thread.submit(self._coach, guide.taken.progress)
            else:
                guide.advise(None)
        return changes

    def busy(self, guide: Guide) -> bool:
        """Whether it has not yet said its word on all that there is."""
        return self._asked is not None or self._behind(guide)

    def close(self) -> None:
        """What it thinks about is of no use any more."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _behind(self, guide: Guide) -> bool:
        return self._coach is not None and _about(guide) != self._about


def _about(guide: Guide) -> tuple[int, ...]:
    """Another turn that counts, or does not any more; another still, in which the board may lie elsewhere."""
    return (len(guide.taken.stills), *map(id, guide.taken.turns)) if guide.taken.stills else ()


# A guided recording: what the port gives goes to the guide, what the guide accepts goes to the coach, what both say to the screen.
#
# What is decided at the table, by the guide or with a key, goes to the recorder, so that a recording that is resumed decides it again.
#
# The reader thread stores the bytes (``session.recording``); this loop only reads events, so nothing that it does can lose any.  The coach
# works in a thread of its own: a segment's advice may come while the next still is being held.

SILENT_S = 1.5
UNKNOWN_S = 10.0  #: of samples without a word of their ranges
KEEPS_BAUD = "a board that was set to 6667 Hz keeps --baud 2000000 until it is switched off"
LAST_WORD_S = 5.0  #: that the coach may take at the end
SHOW_EVERY_S = 0.1
CLOCK_RATIO = 0.005  #: by which the board's second may differ from the host's; a host's is good to 0.0001
CLOCK_RATIO_MOST = 0.25  #: a board whose second is that much longer is no sensor's, but a virtual one that was told to hurry
CLOCK_AFTER_S = 20.0  #: of comparison: arrivals are late by some 10 ms

Configure = Callable[[Info | None, float], Config | None]
Watch = Callable[[Guide, Samples], None]


class GuidedRecording:
    """``lead`` until the guide is done.

    configure(info or None, seconds of samples without one) gives the session's configuration, or None while that is not enough; it raises
    CalibrationError where the board contradicts what is known.  keys: gives what was typed since it was last asked; None: there are none.
    watch: is shown all samples, after the guide; wished: gives what was asked for on a page since it was last asked.
    """

    def __init__(
        self,
        guide: Guide,
        recorder: Recorder,
        configure: Configure,
        coach: Coach | None,
        view: View,
        notebook: Notebook | None = None,
        keys: Callable[[], str] | None = None,
        watch: Watch | None = None,
        wished: Wished | None = None,
    ):
        self.guide, self.recorder, self._configure, self._view, self._watch = guide, recorder, configure, view, watch
        self._table = OperatorInput(guide, recorder, self._tell, notebook, keys, wished)
        self.config: Config | None = None
        guide.coached, self._coach = coach is not None, CoachThread(coach)
        self._early: list[SampleChunk] = []  # samples whose ranges nobody has told yet
        self._heard_s = self._shown_s = time.monotonic()
        self._clock_said = False
        self._last_said: tuple | None = None
        self._new_logs = 0
        self._live = False  # what an earlier recording left is not decided again
        self._resuming = False  # until the port is open
        self.board = BoardReporter()
        self._same = SensorIdentity()
        self._landmarks = self._sound = 0  # new logs and infos taken; up to which of them nothing was wrong
        self._agreed = False  # whether an info was of this recording's sensor
        #: whether what an earlier recording left held another board's bytes: they are apart now, and a replay passes them over
        self.begin_again = False

    def lead(self, interrupted: Callable[[], bool] = lambda: False) -> None:
        """Take in what an earlier recording left, then follow the port until done; KeyboardInterrupt when ``interrupted``.

        That is asked between two steps only: what has been taken from the port is in the log by then.
        """
        self._view.show(self.guide)
        self._table.begin()
        try:
            if not self._catch_up(interrupted):
                self._live = True
            elif self.guide.stage is not Stage.DONE:
                self._resuming = True
                self.guide.new_log()
                self._say(Kind.STAGE, f"resumed: {self.guide.accepted} segments so far")
            while self.guide.stage is not Stage.DONE:
                if interrupted():
                    raise KeyboardInterrupt
                self._take(self.recorder.poll())
                if (decision := self.guide.wants) is not None:
                    self._table.decide(decision)
                self._table.obey(self.config is not None)
                self._look_at_port()
                self._look_at_clock()
                self._tell(self._coach.hear(self.guide))
                self._show()
            self._last_word()
            self._table.end()
            self._table.obey(self.config is not None)
        finally:
            self._table.end()
            self._coach.close()
            self._view.show(self.guide)

    def _catch_up(self, interrupted: Callable[[], bool]) -> bool:
        """Take in what an earlier recording left, a slice at a time; whether there was anything."""
        anything = False
        for events in self.recorder.catch_up():
            anything = anything or bool(events)
            self._take(events)
            self._show()
            if interrupted():
                raise KeyboardInterrupt
        return anything

    def _show(self) -> None:
        if time.monotonic() - self._shown_s > SHOW_EVERY_S:
            self._shown_s = time.monotonic()
            self._view.show(self.guide)

    def _begin_behind(self) -> None:
        """The port is open again, or the board was reset: a pause ends with the recording that it was in, and a closure run begins anew."""
        if not (self._live or self._resuming):
            return
        if self._resuming and self.guide.stage is Stage.PAUSED:
            self._table.decide(self._table.after_pause)
        elif self.guide.closure is not None and self.guide.stage is not Stage.PAUSED:
            self.recorder.decide(BEGIN)  # what comes now belongs to no log
        self._live, self._resuming = True, False

    def _tell(self, changes: list[GuideMessage]) -> None:
        for change in changes:
            self._view.change(change)

    def _take(self, events: Iterable[Event | RecordingDecision]) -> None:
        for event in joined_chunks(events):
            if isinstance(event, SampleChunk):
                self._heard_s = time.monotonic()
                self._samples(event)
            elif isinstance(event, Info):
                self._landmarks += 1
                self._hear_board(event)
            elif isinstance(event, (BoardStatus, FaultCounts, CommandResult, SelfTestResult)):
                if isinstance(event, BoardStatus) and self.board.changes_source(event):
                    self.guide.new_log()
                for words in self.board.hear(event):
                    self._say(Kind.WARNING, words)
            elif isinstance(event, RecordingDecision):
                self._table.was_decided(event)
            elif isinstance(event, Trouble):
                self.guide.health.troubles[event.kind] += event.count
                if event.kind in NEW_LOG:
                    self._landmarks += 1
                    self._sound = self._landmarks
                    self._early = []
                    if event.kind == "reconnect":
                        self.board.new_connection()
                        self._same.new_connection()
                    self._begin_behind()
                    self.guide.new_log()
                    self._say_new_log(event.kind)

    def _samples(self, chunk: SampleChunk) -> None:
        if self.config is None:
            self._early.append(chunk)
            waited_s = float(chunk.t_us[-1] - self._early[0].t_us[0]) * 1e-6
            if self._know(None, waited_s):
                return
            if waited_s > UNKNOWN_S:
                raise CalibrationError(
                    f"{UNKNOWN_S:g} s of samples without a word of their ranges: give --gyro-fs, --accel-fs, --odr, or a session.toml"
                )
            self.guide.waits(Stage.CHECK_STREAM, "the board has not yet said its ranges (an info frame, or a # line)")
            return
        samples = samples_of(chunk, self.config)
        self._tell(self.guide.feed(samples))
        if self._watch is not None:
            self._watch(self.guide, samples)

    def _hear_board(self, info: Info) -> None:
        """What it says of itself.  A contradiction counts when it is said twice running: a line of text carries no check.

        Another board's bytes are set apart, so that the recording can go on: all since the last word that was right.
        """
        said = (info.gyro_fs_dps, info.accel_fs_g, info.odr_hz, info.serial)
        again, self._last_said = said == self._last_said, said
        try:
            self._same.require(info)
            self._know(info)
        except StorageError:
            raise
        except OtherSensor as error:
            if again:
                raise OtherSensor(f"{error}{self._set_apart()}") from None
        except CalibrationError:
            if again:
                raise
        else:
            self._sound, self._agreed = self._landmarks, True
            self.guide.health.info_odr_hz = info.odr_hz

    def _set_apart(self) -> str:
        """What to say of it.  Where nothing of what was recorded before agrees with session.toml, it is the file that is wrong."""
        if not (self._live or self._resuming or self._agreed):
            return ""
        self.begin_again = not (self._live or self._resuming)
        logs = self.recorder.set_apart(self._sound)
        more = f" and {len(logs) - 1} more" if len(logs) > 1 else ""
        kept = f"{self.recorder.raw.path.name}, {logs[0]}{more}" if logs else self.recorder.raw.path.name
        return f"; its bytes stay apart ({kept}); --resume goes on with the own board"

    def _know(self, info: Info | None, waited_s: float = 0.0) -> bool:
        """What the samples mean; asked again at each info, which may contradict it.  Whether that is known only now."""
        config = self._configure(info, waited_s)
        if config is None or self.config is not None:
            return False
        self.config = config
        uncalibrated = config.accelerometer.source == "none"
        self.guide.begin(config.sensor, LiveAccelerometerFit(config.site.expected_gravity_mps2) if uncalibrated else None)
        early, self._early = self._early, []
        for chunk in early:
            self._samples(chunk)
        return True

    def _look_at_port(self) -> None:
        silent_s = time.monotonic() - self._heard_s
        if not self.recorder.connected:
            self.guide.waits(Stage.FIND_PORT, f"{self.recorder.port.name}: {self.recorder.why or 'opening'}; it is tried again and again")
        elif silent_s > SILENT_S:
            counts = self.recorder.decoder
            what = "nothing comes: is the board sending?"
            if counts.garbage or counts.crc_errors:
                what = (
                    f"{counts.garbage} bytes and {counts.crc_errors} frames that are none: is the baud rate right? ({KEEPS_BAUD}; --header)"
                )
            self.guide.waits(Stage.CHECK_STREAM, f"no samples for {silent_s:.0f} s; {what}")

    def _look_at_clock(self) -> None:
        """Said once: a device time that runs wrong is a wrong scale factor of all axes."""
        clock, health = self.recorder.clock, self.guide.health
        health.clock_ratio = ratio = clock.device_seconds_per_second
        if ratio is None or self._clock_said or clock.compared_s < CLOCK_AFTER_S:
            return
        if CLOCK_RATIO < abs(ratio - 1) < CLOCK_RATIO_MOST:
            self._clock_said = True
            wrong = f"the board's clock runs {100 * abs(ratio - 1):.2f} % {'fast' if ratio > 1 else 'slow'} by this computer's"
            self._say(Kind.WARNING, f"{wrong} (bar {100 * CLOCK_RATIO:g} %): every scale factor will be off by as much")

    def _say(self, kind: Kind, text: str) -> None:
        self._view.change(GuideMessage(kind, text, self.guide.now_s))

    def _say_new_log(self, kind: str) -> None:
        """A few times; a board that resets again and again would say nothing else."""
        self._new_logs += 1
        if self._new_logs <= SHORT_STARTS:
            self._say(Kind.WARNING, f"{_NEW_LOG_SAYS[kind]}: a new log begins")
        if self._new_logs == SHORT_STARTS:
            again = (
                f"this was the {SHORT_STARTS}th time, and it is said no more; a start that lasts less than {SHORT_US / 1e6:g} s gets no log"
            )
            self._say(Kind.WARNING, again)

    def _last_word(self) -> None:
        """Of the coach, on all segments; it has had all but the last one before."""
        until_s = time.monotonic() + LAST_WORD_S
        while self._coach.busy(self.guide) and time.monotonic() < until_s:
            self._tell(self._coach.hear(self.guide))
            time.sleep(0.01)


_NEW_LOG_SAYS = {"reset": "the board was reset", "reconnect": "the port was opened again"}
