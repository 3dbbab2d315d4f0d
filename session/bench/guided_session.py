"""A guided recording: from the port to the guide, from the guide to the coach, and both to the screen.

The recorder's reader thread stores the bytes; this loop only reads events, so it cannot lose any.  The coach works in a thread of its own:
its advice may come while the next still is being held.  Decisions of the guide or the operator go to the recorder, so that a resumed
recording repeats them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import UTC, datetime

from session.base.errors import CalibrationError, OtherSensor, StorageError
from session.base.texts import printable
from session.bench.board import BoardReporter
from session.bench.clocks import OFF
from session.bench.events import TROUBLES, AnyEvent, BoardStatus, Event, Info, SampleChunk, starts_log
from session.bench.guide import BEGIN, REST, Guide, Moment, Mover, View, joined_chunks, samples_of
from session.bench.messages import Advice, GuideMessage, Kind, Progress, Stage
from session.bench.operator import BrowserCommands, TypingLine
from session.bench.progress import LiveAccelerometerFit
from session.bench.recorder import Recorder
from session.bench.session_file import SessionFile
from session.log.config import Config, clock_words
from session.log.samples import Samples

Coach = Callable[[Progress], Advice]


class _CoachThread:
    """Runs the coach in a thread, since a recording must not wait for it.  coach: None where there is none; it is dropped if it fails."""

    def __init__(self, coach: Coach | None) -> None:
        self._coach = coach
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="coach")
        self._pending: Future[Advice] | None = None
        self._pending_stills = 0  # number of stills
        self._about: tuple[int, ...] = ()  # the state that was passed to it last

    def hear(self, guide: Guide) -> list[GuideMessage]:
        """Pass its finished advice to the guide, and the present state to it; returns the messages that this causes."""
        changes: list[GuideMessage] = []
        if self._pending is not None and self._pending.done():
            done, self._pending = self._pending, None
            if (error := done.exception()) is not None:  # no failure of the coach may end a recording
                self._coach, guide.coached = None, False
                failed = f"the coach has failed ({type(error).__name__}: {error}); any turn will do"
                changes = [GuideMessage(Kind.WARNING, failed, guide.now_s)]
            else:
                changes = guide.advise(done.result(), self._pending_stills)
        if self._pending is None and self._behind(guide):
            self._about, self._pending_stills = _about(guide), len(guide.taken.stills)
            if guide.taken.turns and self._coach is not None:
                self._pending = self._thread.submit(self._coach, guide.taken.progress)
            else:
                guide.advise(None)
        return changes

    def busy(self, guide: Guide) -> bool:
        """Whether advice on the present state is still to come."""
        return self._pending is not None or self._behind(guide)

    def close(self) -> None:
        """Stop the thread."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _behind(self, guide: Guide) -> bool:
        return self._coach is not None and _about(guide) != self._about


def _about(guide: Guide) -> tuple[int, ...]:
    """What the advice depends on: the turns that count, and the stills, since the board may have another attitude."""
    return (len(guide.taken.stills), *map(id, guide.taken.turns)) if guide.taken.stills else ()


SILENT_S = 1.5
UNKNOWN_S = 10.0  #: of samples without their ranges
KEEPS_BAUD = "a board that was set to 6667 Hz keeps --baud 2000000 until it is switched off"
LAST_WORD_S = 5.0  #: for the coach at the end
SHOW_EVERY_S = 0.1
MOST_SHOWN = 20  #: new logs
NEW_LOG_CAUSE = {"reset": "the board was reset", "reconnect": "the port was opened again"}

Configure = Callable[[Info | None, float], Config | None]
Watch = Callable[[Guide, Samples], None]


class GuidedRecording:
    """``lead`` until the guide is done.

    configure(info or None, seconds of samples without one) returns the session's configuration, or None while that is not enough; it raises
    CalibrationError where the board contradicts what is known.  keys returns the characters typed since the last call; None: there are no
    keys.  notebook: the session.toml that takes notes and dropped turns; watch gets all samples, after the guide; page: the commands from a
    browser; mover: a machine that turns the table, None: the operator does.
    """

    def __init__(
        self,
        guide: Guide,
        recorder: Recorder,
        configure: Configure,
        coach: Coach | None,
        view: View,
        notebook: SessionFile | None = None,
        keys: Callable[[], str] | None = None,
        watch: Watch | None = None,
        page: BrowserCommands | None = None,
        mover: Mover | None = None,
    ):
        self.guide, self.recorder, self._configure, self._view, self._watch = guide, recorder, configure, view, watch
        self._mover = mover
        self._notebook, self._keys, self._page, self._typing = notebook, keys, page or BrowserCommands(), TypingLine()
        self.config: Config | None = None
        guide.coached, self._coach = coach is not None, _CoachThread(coach)
        self._early: list[SampleChunk] = []  # samples whose ranges are not known yet
        self._heard_s = self._shown_s = time.monotonic()
        self._clock_reported = False
        self._last_info: tuple | None = None
        self._remark = ""  # the board's last, behind samples and ranges
        self._new_logs = 0
        self._live = False  # decisions of an earlier recording are not made again
        self._resuming = False  # until the port is open
        self.board = BoardReporter()
        guide.board_faults = self.board.counted

    def lead(self, interrupted: Callable[[], bool] | None = None) -> None:
        """Take in an earlier recording, then follow the port until done; KeyboardInterrupt when ``interrupted``.

        That is checked between two steps only: what has been taken from the port is in the log by then.
        """
        stopped = interrupted or (lambda: False)
        self._view.show(self.guide)
        self._page.begin()
        try:
            # Take in an earlier recording, piece by piece.
            anything = False
            for events in self.recorder.catch_up():
                anything = anything or bool(events)
                self._take(events)
                self._show()
                if stopped():
                    raise KeyboardInterrupt
            if not anything:
                self._live = True
                if (decision := self.guide.wants) is not None:  # a rest's log, before its first sample
                    self._decide(decision)
            elif self.guide.resumes():
                self._resuming = True
                self.guide.new_log()
                if (self.guide.begun == REST) != (self.guide.stem == REST):  # its own log begins with the new connection
                    self._decide(Event("pause"))
                self._announce(Kind.STAGE, f"resumed: {self.guide.so_far} so far")
            while self.guide.stage is not Stage.DONE:
                if stopped():
                    raise KeyboardInterrupt
                self._take(self.recorder.poll())
                if (decision := self.guide.wants) is not None:
                    self._decide(decision)
                self._obey()
                self._check_port()
                self._check_clock()
                self._show_messages(self._coach.hear(self.guide))
                self._move()
                self._show()
            until_s = time.monotonic() + LAST_WORD_S
            while self._coach.busy(self.guide) and time.monotonic() < until_s:
                self._show_messages(self._coach.hear(self.guide))
                time.sleep(0.01)
            self._page.end()
            self._obey()
        finally:
            if self._mover is not None:
                self._mover.close()
            self._page.end()
            self._coach.close()
            self._view.show(self.guide)

    @property
    def coaching(self) -> bool:
        """Whether advice on the present state is still to come."""
        return self._coach.busy(self.guide)

    def _move(self) -> None:
        """Let the machine do what the guide waits for."""
        if self._mover is None:
            return
        heard = self.recorder.heard
        moment = None if heard is None else Moment(self.recorder.logs.present, heard[1], heard[0])
        self._show_messages(self._mover.step(self.guide, moment, self.coaching))
        if (decision := self._mover.wants) is not None:
            self._decide(decision)

    def _show(self) -> None:
        if time.monotonic() - self._shown_s > SHOW_EVERY_S:
            self._shown_s = time.monotonic()
            self._view.show(self.guide)

    def _show_messages(self, changes: list[GuideMessage]) -> None:
        for change in changes:
            self._view.change(change)

    def _take(self, events: Iterable[AnyEvent]) -> None:
        for event in joined_chunks(events):
            if isinstance(event, SampleChunk):
                self._heard_s, self._remark = time.monotonic(), ""
                self._samples(event)
            elif isinstance(event, Info):
                self._remark = ""
                self._hear_board(event)
            elif isinstance(event, BoardStatus) or event.kind in ("faults", "tested"):
                if isinstance(event, BoardStatus) and self.board.changes_source(event):
                    self.guide.new_log()
                for words in self.board.hear(event):
                    self._announce(Kind.WARNING, words)
            elif event.kind == "comment":
                self._remark = event.text
            elif event.kind in TROUBLES:
                self.guide.health.troubles[event.kind] += event.count
                if starts_log(event):
                    self._new_log(event.kind)
            else:
                self._was_decided(event)

    def _new_log(self, kind: str) -> None:
        self._early = []
        because = self.board.was_reset() if kind == "reset" else []
        if kind == "reconnect":
            self.board.new_connection()
        if self._present:
            if self._resuming and self.guide.stage is Stage.PAUSED:  # a pause ends with its recording
                self._decide(self._after_pause)
            elif self.guide.closure is not None and self.guide.stage is not Stage.PAUSED:  # a closure run restarts
                self.recorder.decide(BEGIN)  # the next samples belong to no log
            self._live, self._resuming = True, False
        self.guide.new_log()
        self._new_logs += 1
        if self._new_logs <= MOST_SHOWN:  # a board that resets again and again would fill the screen
            self._announce(Kind.WARNING, f"{NEW_LOG_CAUSE[kind]}: a new log begins")
            for words in because:
                self._announce(Kind.WARNING, words)
        if self._new_logs == MOST_SHOWN:
            self._announce(Kind.WARNING, f"this was the {MOST_SHOWN}th time, later ones are not shown")

    def _samples(self, chunk: SampleChunk) -> None:
        if self.config is None:
            self._early.append(chunk)
            waited_s = float(chunk.t_us[-1] - self._early[0].t_us[0]) * 1e-6
            if self._know(None, waited_s):
                return
            if waited_s > UNKNOWN_S and self._present:
                raise CalibrationError(
                    f"{UNKNOWN_S:g} s of samples whose ranges are not known: give --gyro-fs, --accel-fs, --odr, or a session.toml"
                )
            self.guide.waits(Stage.CHECK_STREAM, "the board has not yet sent its ranges (an info frame, or a # line)")
            return
        samples = samples_of(chunk, self.config)
        self._show_messages(self.guide.feed(samples))
        if self._watch is not None:
            self._watch(self.guide, samples)

    @property
    def _present(self) -> bool:
        """Whether the recording is no earlier one's any more."""
        return self._live or self._resuming

    def _hear_board(self, info: Info) -> None:
        """Take the board's info.  A contradiction counts when it comes twice in a row: a line of text carries no check; another board in
        an earlier recording counts no more."""
        values = (info.gyro_fs_dps, info.accel_fs_g, info.odr_hz, info.serial)
        again, self._last_info = values == self._last_info, values
        try:
            self.board.require_same(info)
            self._know(info)
        except StorageError:
            raise
        except OtherSensor as error:
            if again and self._present:
                log = self.recorder.logs.present
                its = f"; {log} holds its samples, remove it at the end" if log else ""
                raise OtherSensor(f"{error}{its}; --resume goes on with the own board") from None
        except CalibrationError:
            if again:
                raise
        else:
            self.guide.health.info_odr_hz = info.odr_hz

    def _know(self, info: Info | None, waited_s: float = 0.0) -> bool:
        """Configure the session; each info is checked again, since it may contradict.  Returns whether it is configured only now."""
        config = self._configure(info, waited_s)
        if config is None or self.config is not None:
            return False
        self.config = config
        own = LiveAccelerometerFit(config.site.expected_gravity_mps2) if config.accelerometer.source == "none" else None
        self.guide.begin(config.sensor, own, config.accelerometer.sigma_mg)
        early, self._early = self._early, []
        for chunk in early:
            self._samples(chunk)
        return True

    # Decisions are written down where a replay finds them.
    @property
    def _after_pause(self) -> Event:
        """The decision that ends a pause: a log before the closure run, in the run no log until the table is on its mark."""
        return Event("begin", text=self.guide.stem) if self.guide.closure is None else BEGIN

    def _decide(self, decision: Event) -> None:
        """Apply a decision to the files and the guide."""
        self.recorder.decide(decision)
        self._show_messages(self.guide.decided(decision))

    def _was_decided(self, decision: Event) -> None:
        """Apply a decision of the resumed recording to the guide."""
        if decision.kind == "drop" and self._notebook:
            paths = self.recorder.logs.paths
            if not self._notebook.excludes(paths[-1].name if paths else "", int(decision.text) * 1e-6):
                return  # the operator has withdrawn it
        if decision.kind not in ("note", "done"):
            self._show_messages(self.guide.decided(decision))

    def _obey(self) -> None:
        """Carry out the operator's commands, from keys and page."""
        commands = self._page()
        if self._keys is not None:
            commands += self._typing.take(self._keys())
        for command, text in commands:
            try:
                self._do(command, text)
            except StorageError:
                raise
            except CalibrationError as error:  # no command may end a recording
                self._announce(Kind.WARNING, str(error))
        if self._keys is not None:
            self.guide.keys = self._typing.words(self.guide, self._mover is not None)

    def _do(self, command: str, text: str) -> None:
        guide, begun = self.guide, self.config is not None and self.guide.stage is not Stage.DONE
        if command == "note" and self._notebook is not None:
            self.recorder.decide(Event("note", text=text))  # first where nothing can refuse it
            self._notebook.note(text, datetime.now(UTC))
            self._announce(Kind.STAGE, f"noted: {text}")
        elif command == "here" and guide.closure is not None:
            guide.closure.on_the_mark()
        elif command == "stop" and self._mover is not None:
            self._mover.stop()
            if begun and guide.stage is not Stage.PAUSED:
                self._decide(Event("pause"))
            self._announce(Kind.WARNING, "the table is stopped; p goes on with the next move")
        elif not begun:
            return
        elif command == "finish":
            if guide.enough:
                self._decide(Event("finish"))
            elif guide.closure is None:
                self._announce(Kind.WARNING, "f ends the turns once every number is good enough; Ctrl-C ends them now and keeps all")
        elif command == "pause":
            self._decide(self._after_pause if guide.stage is Stage.PAUSED else Event("pause"))
        elif command == "drop" and guide.closure is not None:
            guide.closure.interrupted()
        elif command == "drop" and self._notebook is not None:
            moment_us, why = guide.to_drop
            if moment_us is None:
                self._announce(Kind.WARNING, why)
                return
            # First where fit reads it, then where a replay does: a mark without its entry is a withdrawn one.
            self._notebook.exclude(self.recorder.logs.paths[-1].name, moment_us * 1e-6)
            self._decide(Event("drop", text=str(moment_us)))

    def _check_port(self) -> None:
        silent_s = time.monotonic() - self._heard_s
        if not self.recorder.connected:
            self.guide.waits(Stage.FIND_PORT, f"{self.recorder.port.name}: {self.recorder.why or 'opening'}; it is tried again and again")
        elif silent_s > SILENT_S:
            counts = self.recorder.decoder
            what = "no bytes arrive: is the board sending?"
            if self._remark:
                what = f"the board reports: {printable(self._remark)}"
            elif counts.garbage or counts.crc_errors:
                what = (
                    f"{counts.garbage} bytes and {counts.crc_errors} frames that are none: is the baud rate right? ({KEEPS_BAUD}; --header)"
                )
            self.guide.waits(Stage.CHECK_STREAM, f"no samples for {silent_s:.0f} s; {what}")

    def _check_clock(self) -> None:
        """Report once that the device's clock is wrong, which is a wrong scale factor of all axes."""
        self.guide.health.clock = clock = self.recorder.clock.measured
        if clock is not None and not self._clock_reported and clock.is_informative and abs(clock.ratio - 1) > OFF:
            self._clock_reported = True
            wrong = f"{clock_words(clock.ratio, clock.sigma_ppm)} (bar {1e6 * OFF:g})"
            self._announce(Kind.WARNING, f"{wrong}: every scale factor is off by as much, which `fit --clock arrivals` takes out")

    def _announce(self, kind: Kind, text: str) -> None:
        self._view.change(GuideMessage(kind, text, self.guide.now_s))
