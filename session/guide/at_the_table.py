"""What a person decides at the table, with keys, and what the guide decides about files: it is written down where a replay finds it."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Protocol as Interface

from session.common.errors import CalibrationError, StorageError
from session.guide.closure_guide import BEGIN
from session.guide.guide import Guide
from session.guide.messages import Change, Kind, Stage
from session.guide.typing_line import TypingLine, Wish
from session.recording.decisions import Decision
from session.recording.recorder import Recorder


class Notebook(Interface):
    """Where notes and turns that do not count are written down: session.toml."""

    def note(self, text: str, when: datetime) -> None:
        """A person's words of this moment (UTC)."""

    def exclude(self, log: str, at_s: float) -> None:
        """The turn that moved at that moment of a log's clock does not count."""

    def excludes(self, log: str, at_s: float) -> bool:
        """Whether that is written down (and was not taken back since)."""


class Wished(Interface):
    """What is asked for elsewhere, on a page: call it for what was since it was last asked."""

    def __call__(self) -> list[tuple[Wish, str]]:
        """In order, each once."""

    def begin(self) -> None:
        """They are taken from here on."""

    def end(self) -> None:
        """None that come later are taken."""


class AtTheTable:
    """tell: takes what has changed; keys: gives what was typed since it was last asked; None: there are none; wished: what was asked
    for elsewhere, likewise."""

    def __init__(
        self,
        guide: Guide,
        recorder: Recorder,
        tell: Callable[[list[Change]], None],
        notebook: Notebook | None,
        keys: Callable[[], str] | None,
        wished: Wished | None = None,
    ):
        self._guide, self._recorder, self._tell, self._notebook = guide, recorder, tell, notebook
        self._keys, self._wished = keys, wished
        self._typing = TypingLine()

    @property
    def after_pause(self) -> Decision:
        """How it goes on: before the closure run in a log, behind it in none until the table stands on its mark."""
        return Decision("begin", "log") if self._guide.closure is None else BEGIN

    def decide(self, decision: Decision) -> None:
        """Do it with the files, and tell the guide."""
        self._recorder.decide(decision)
        self._tell(self._guide.decided(decision))

    def was_decided(self, decision: Decision) -> None:
        """In the recording that is resumed: the guide decides it again."""
        if decision.word == "drop" and self._notebook and not self._notebook.excludes(decision.log, int(decision.rest) * 1e-6):
            return  # somebody has taken it back
        if decision.word != "note":
            self._tell(self._guide.decided(decision))

    def begin(self) -> None:
        """Somebody obeys from here on."""
        if self._wished is not None:
            self._wished.begin()

    def end(self) -> None:
        """Nobody does any more."""
        if self._wished is not None:
            self._wished.end()

    def obey(self, begun: bool) -> None:
        """What was typed, or asked for.  begun: whether samples are judged."""
        wishes = self._wished() if self._wished is not None else []
        if self._keys is not None:
            wishes += self._typing.take(self._keys())
        for wish, text in wishes:
            try:
                self._do(wish, text, begun)
            except StorageError:
                raise
            except CalibrationError as error:  # nothing that a person types ends a recording
                self._say(Kind.WARNING, str(error))
        if self._keys is not None:
            self._guide.keys = self._typing.words(self._guide.closure is not None)

    def _do(self, wish: Wish, text: str, begun: bool) -> None:
        guide = self._guide
        if wish is Wish.NOTE and self._notebook is not None:
            self._recorder.decide(Decision("note", text))  # first where nothing can refuse it
            self._notebook.note(text, datetime.now(UTC))
            self._say(Kind.STAGE, f"noted: {text}")
        elif wish is Wish.HERE and guide.closure is not None:
            guide.closure.on_the_mark()
        elif not begun or guide.stage is Stage.DONE:
            return
        elif wish is Wish.PAUSE:
            self.decide(self.after_pause if guide.stage is Stage.PAUSED else Decision("pause"))
        elif wish is Wish.DROP and guide.closure is not None:
            guide.closure.interrupted()
        elif wish is Wish.DROP and self._notebook is not None:
            self._drop(self._notebook)

    def _drop(self, notebook: Notebook) -> None:
        moment_us, why = self._guide.to_drop
        if moment_us is None:
            self._say(Kind.WARNING, why)
            return
        # First where fit reads it, then where a replay does: a mark without its entry is one that was taken back.
        notebook.exclude(self._recorder.logs.paths[-1].name, moment_us * 1e-6)
        self.decide(Decision("drop", str(moment_us)))

    def _say(self, kind: Kind, text: str) -> None:
        self._tell([Change(kind, text, self._guide.now_s)])
