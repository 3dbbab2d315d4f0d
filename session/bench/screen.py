"""The screen of a guided recording: a live view in a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Collection
from types import TracebackType

from rich.console import Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from session.bench.console import PlainConsole
from session.bench.events import SENSOR, STANDIN, BoardMessage, BoardStatus, FaultCounts, SelfTestResult
from session.bench.guide import Guide, wait_of
from session.bench.live import StreamHealth
from session.bench.messages import GuideMessage, Kind, Stage
from session.io.texts import printable

# What a board says of its sensor, in words for whoever turns the table: faults when their counts rise, a stand-in once.

WIRES = "look at supply, wires and their length"
#: what happened, and what to do
FAULT_SAYS = {
    "overrun": ("the sensor's FIFO ran over", "the board is too slow for this data rate: a lower --odr"),
    "order": ("words of the FIFO were out of order", WIRES),
    "parity": ("words of the FIFO had a wrong parity", WIRES),
    "tag": ("the FIFO gave words that there are none of", WIRES),
    "hang": ("the bus to the sensor hung", WIRES),
    "zeros": ("the sensor's bus answered 0x00", WIRES),
    "ones": ("the sensor's bus answered 0xFF", WIRES),
    "reset": ("the sensor reset itself", "look at its supply"),
    "changed": ("a register of the sensor changed by itself", "look at its supply"),
    "identity": ("the sensor's identity is another's", WIRES),
    "silent": ("the sensor fell silent", WIRES),
    "stamp": ("the sensor's stamps did not follow each other", WIRES),
    "incomplete": ("words of a sample did not come", WIRES),
    "crowded_out": ("the board's port had no room", "a higher --baud, or a lower --odr"),
}
#: of these the board counts samples, or what follows from another fault
COUNTED_APART = ("lost", "starts")
NO_SENSOR = (
    "the board has no sensor (source 0): what comes is made up, or played to it, and calibrates no sensor; "
    "look at the wiring, then switch the board on again (it looks for its sensor when it is switched on)"
)
FOUND = (
    "the board has found its sensor: a new log begins; "
    "those before it hold no sensor's samples: take them out of the folder (check names them)"
)
#: WHO_AM_I of a bus on which nobody answers, and of the sensor and its siblings
NOBODY, FAMILY = (0x00, 0xFF), 0x6B
#: times that faults are said; a sensor with a loose wire would say nothing else
MOST_SAID = 20


class BoardReporter:
    """``hear`` what a board says; gives what to say to the person, a line each."""

    def __init__(self) -> None:
        self.board: BoardStatus | None = None
        self.faults: FaultCounts | None = None
        self._said = 0
        self._open_fault = False  # one was said, and what it costs may be counted only once the sensor is back

    def new_connection(self) -> None:
        """What is said from here on may be another board's, or of one that was switched on again."""
        self.board = self.faults = None
        self._open_fault = False

    def changes_source(self, board: BoardStatus) -> bool:
        """Whether the samples are another's from here on: the sensor's, and not what stood in for it."""
        return self.board is not None and board.source != self.board.source

    def hear(self, said: BoardMessage) -> list[str]:
        """In words, where there is something to be said."""
        if isinstance(said, BoardStatus):
            found = self.changes_source(said) and said.source == SENSOR
            before, self.board = self.board, said
            if found:
                return [FOUND]
            return [_no_sensor(said)] if said.source == STANDIN and (before is None or before.source != STANDIN) else []
        if isinstance(said, SelfTestResult):
            return [f"the sensor's self-test failed (bits 0x{said.failed:X})"] if said.failed else []
        if not isinstance(said, FaultCounts):
            return []
        before_faults, self.faults = self.faults, said
        risen = said.since(before_faults)
        if not risen:
            return []
        if not set(risen) - set(COUNTED_APART):  # without a fault it is what setting the sensor anew has cost
            was_open, self._open_fault = self._open_fault and "lost" in risen, self._open_fault and "lost" not in risen
            return [f"the sensor is back: {risen['lost']} samples lost"] if was_open else []
        self._open_fault = True
        self._said += 1
        if self._said > MOST_SAID:
            return []
        words = [_words(risen, since_power_up=before_faults is None)]
        if self._said == MOST_SAID:
            words.append(f"this was the {MOST_SAID}th fault, and they are said no more; the logs' comments have all")
        return words


def _no_sensor(board: BoardStatus) -> str:
    if board.who_am_i in NOBODY:
        return NO_SENSOR
    who = "a sensor answers on its bus, but did not start" if board.who_am_i == FAMILY else "a chip that is no ASM330LHH answers on its bus"
    return f"{NO_SENSOR}; {who}: WHO_AM_I 0x{board.who_am_i:02X}"


def _words(risen: dict[str, int], since_power_up: bool) -> str:
    kinds = [name for name in risen if name not in COUNTED_APART]
    what = "; ".join(f"{FAULT_SAYS[name][0]} ({risen[name]}×)" for name in kinds)
    lost = risen.get("lost", 0) + risen.get("crowded_out", 0)
    how_many = f"{lost} samples lost" if lost else "no sample lost so far"
    do = "; ".join(dict.fromkeys(FAULT_SAYS[name][1] for name in kinds))
    do = f"; {do}" if do else ""
    return f"{'before this recording: ' if since_power_up else ''}{what}: {how_many}{do}"


# The screen of a guided recording: one live view in a terminal, plain lines elsewhere; a bell.

BELLS = {Kind.READY: 1, Kind.ACCEPTED: 1, Kind.REJECTED: 2, Kind.WARNING: 2, Kind.DONE: 3}
STYLES = {Kind.READY: "green", Kind.ACCEPTED: "green", Kind.REJECTED: "red", Kind.WARNING: "yellow", Kind.DONE: "bold green"}
FAULTS = (("lost", "lost"), ("crc", "CRC"), ("garbage", "garbage"), ("implausible", "implausible"), ("reset", "resets"))
COLOURS = {Stage.HOLD_STILL: "cyan", Stage.TURN: "magenta", Stage.CLOSURE: "magenta", Stage.DONE: "green"}
WIDTH = 80  #: of what is typed, the end is seen
REMEMBERED = 4  #: changes that stay on the screen
REMIND_S = 5.0  #: between two lines that say the same, where there is no terminal


class LiveScreen:
    """A context: the live view between enter and exit."""

    def __init__(self, title: str, mute: bool = False, console: PlainConsole | None = None):
        self.console = console or PlainConsole(stderr=True)
        self._title, self._mute = printable(title), mute
        self._changes: deque[GuideMessage] = deque(maxlen=REMEMBERED)
        self._live = Live(console=self.console, auto_refresh=False, redirect_stdout=False, redirect_stderr=False)

    def __enter__(self) -> LiveScreen:
        self._live.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self._live.__exit__(kind, error, traceback)

    def change(self, change: GuideMessage) -> None:
        """Remember it on the screen, and ring."""
        if change.kind is not Kind.STAGE:
            self._changes.append(change)
        if not self._mute:
            for _ in range(BELLS.get(change.kind, 0)):
                self.console.bell()

    def show(self, guide: Guide) -> None:
        """Draw the present state."""
        self._live.update(view(guide, self._title, self._changes), refresh=True)


class PlainLines:
    """A line for each change, and for what it waits for."""

    def __init__(self, console: PlainConsole | None = None):
        self.console = console or PlainConsole(stderr=True)
        self._said, self._said_s = "", 0.0

    def __enter__(self) -> PlainLines:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def change(self, change: GuideMessage) -> None:
        """Say it in a line."""
        self.console.print(f"[{change.at_s:7.1f} s] {change.text}", soft_wrap=True)

    def show(self, guide: Guide) -> None:
        """Say a new instruction, and every few seconds why it waits."""
        now, wall_s = guide.instruction, time.monotonic()
        if now.do == self._said and (now.good or wall_s - self._said_s < REMIND_S):
            return
        why = now.why if not now.good or (now.stage in (Stage.TURN, Stage.CLOSURE) and not guide.turning) else ""
        self._said, self._said_s = now.do, wall_s
        self.console.print(f"{'':12}{now.do}{f' ({why})' if why else ''}", soft_wrap=True)


def view(guide: Guide, title: str, changes: Collection[GuideMessage]) -> Group:
    """The whole screen, at most 22 lines of 80 columns."""
    said = Table.grid(padding=(0, 2))
    said.add_column(justify="right", width=8)
    said.add_column()
    for number, change in enumerate(changes, start=1):
        style, newest = STYLES.get(change.kind, ""), number == len(changes)
        # The newest is said in full, the ones before it in a line each.
        text = Text(printable(change.text), style=style, overflow="fold" if newest else "ellipsis", no_wrap=not newest)
        said.add_row(Text(f"{change.at_s:.1f} s", style="dim"), text)
    parts: list[RenderableType] = [_instruction(guide, title), _state(guide), said]
    if guide.keys:
        parts.append(Text(guide.keys[-WIDTH:], style="dim", no_wrap=True, overflow="ellipsis"))
    return Group(*parts)


def _instruction(guide: Guide, title: str) -> Panel:
    now = guide.instruction
    bar = Table.grid(padding=(0, 1), expand=True)
    bar.add_column(ratio=1)
    bar.add_column(justify="right", width=12)
    if now.part is not None:
        bar.add_row(ProgressBar(total=1.0, completed=now.part, complete_style="green"), Text(f"{now.remaining_s:.1f} s left"))
    else:
        bar.add_row(Text(""), Text(""))
    colour = COLOURS.get(now.stage, "yellow")
    why = Text(now.why, style="" if now.good else "bold yellow")
    return Panel(
        Group(Text(now.do.replace(", then at once ", ",\nthen at once "), style=f"bold {colour}"), bar, why),
        title=Text(title),
        title_align="left",
        border_style=colour,
        height=7,
    )


def _state(guide: Guide) -> Table:
    health, table = guide.health, Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    table.add_row("segments", _segments(guide))
    table.add_row("coach", _coach(guide))
    if guide.taken.own is not None:
        table.add_row("gravity", guide.taken.own.words)
    table.add_row("stream", _stream(health))
    table.add_row("faults", _faults(health))
    table.add_row("warmth", _warmth(guide))
    stills = guide.taken.coverage.stills
    table.add_row("up in stills", Text.assemble(*(_count(f"{face} {count}", count) for face, count in stills.items())))
    turned = guide.taken.coverage.turned_deg.items()
    table.add_row("turned about", Text.assemble(*(_count(f"{axis} {degrees:.0f}°", degrees) for axis, degrees in turned)))
    return table


def _count(text: str, count: float) -> tuple[str, str]:
    """What has not been covered yet stands out."""
    return f"{text}  ", "" if count else "yellow"


def _segments(guide: Guide) -> Table:
    row = Table.grid(padding=(0, 1))
    rejected = f", {guide.rejected} rejected" if guide.rejected else ""
    row.add_row(
        ProgressBar(total=guide.segments, completed=guide.accepted, width=24, complete_style="green"),
        f"{guide.accepted} of {guide.segments} accepted{rejected}",
    )
    return row


def _coach(guide: Guide) -> str:
    if guide.advice is None:
        return "–"
    whole = f"; {guide.advice.says}" if guide.advice.says else ""
    if not guide.advice.missing:
        return guide.advice.reason + whole
    worst = guide.advice.missing[0].replace(" times its target", "×")
    return f"{len(guide.advice.missing)} parameters above target; {worst}{whole}"


def _stream(health: StreamHealth) -> Text:
    if health.odr_hz is None:
        return Text(f"– Hz; {health.samples} samples")
    others = {"board says": health.info_odr_hz, "host clock": health.odr_by_host_hz}
    said = ", ".join(f"{who} {odr_hz:.2f}" for who, odr_hz in others.items() if odr_hz)
    return Text(f"{health.odr_hz:.2f} Hz; {f'{said}; ' if said else ''}{health.samples} samples")


def _faults(health: StreamHealth) -> Text:
    text = Text()
    for name, count in (*((name, health.troubles[kind]) for kind, name in FAULTS), ("gaps", health.gaps)):
        text.append(f"{count} {name}  ", style="bold yellow" if count else "")
    return text


def _warmth(guide: Guide) -> Text:
    health = guide.health
    if health.temp_c is None:
        return Text("–")
    slope = health.temp_slope
    text = Text(f"{health.temp_c:.1f} °C")
    if slope is not None:
        text.append(f", {slope:+.2f} °C/min")
    if (wait := wait_of(guide)) is not None:
        text.append(f": {wait.words}", style="yellow")
    return text
