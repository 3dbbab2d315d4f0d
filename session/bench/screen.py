"""The screen of a guided recording: a live view in a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Collection, Iterable
from textwrap import wrap

from rich.console import Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from session.base.console import PlainConsole
from session.base.texts import printable
from session.bench.guide import Guide
from session.bench.live import StreamHealth
from session.bench.messages import GuideMessage, Kind, Stage
from session.bench.rest_guide import RestGuide

BELLS = {Kind.READY: 1, Kind.ACCEPTED: 1, Kind.REJECTED: 2, Kind.WARNING: 2, Kind.DONE: 3}
STYLES = {Kind.READY: "green", Kind.ACCEPTED: "green", Kind.REJECTED: "red", Kind.WARNING: "yellow", Kind.DONE: "bold green"}
COLOURS = {Stage.HOLD_STILL: "cyan", Stage.TURN: "magenta", Stage.CLOSURE: "magenta", Stage.DONE: "green"}
WIDTH = 80  #: of a typed line its end is shown
REMEMBERED = 4  #: messages that stay on the screen
REMIND_S = 5.0  #: between two equal lines, where there is no terminal


class LiveScreen(Live):
    """A context with the live view in a terminal."""

    def __init__(self, title: str, mute: bool = False, console: PlainConsole | None = None):
        super().__init__(
            console=console or PlainConsole(stderr=True), auto_refresh=False, transient=True, redirect_stdout=False, redirect_stderr=False
        )
        self._title, self._mute = printable(title), mute
        self._changes: deque[GuideMessage] = deque(maxlen=REMEMBERED)

    def change(self, change: GuideMessage) -> None:
        """Show a message, and ring its bell."""
        if change.kind is not Kind.STAGE:
            self._changes.append(change)
        if not self._mute:
            for _ in range(BELLS.get(change.kind, 0)):
                self.console.bell()

    def show(self, guide: Guide) -> None:
        """Draw the present state."""
        self.update(view(guide, self._title, self._changes), refresh=True)


class PlainLines:
    """Prints a line for each message, and for each instruction."""

    def __init__(self, console: PlainConsole | None = None):
        self.console = console or PlainConsole(stderr=True)
        self._shown, self._shown_s = "", 0.0

    def change(self, change: GuideMessage) -> None:
        """Print a message."""
        self.console.print(f"[{change.at_s:7.1f} s] {change.text}")

    def show(self, guide: Guide) -> None:
        """Print a new instruction, and every few seconds why the guide waits."""
        now, wall_s = guide.instruction, time.monotonic()
        if now.do == self._shown and (now.good or wall_s - self._shown_s < REMIND_S):
            return
        why = now.reason if not now.good or (now.stage in (Stage.TURN, Stage.CLOSURE) and not guide.turning) else ""
        self._shown, self._shown_s = now.do, wall_s
        self.console.print(f"{'':12}{now.do}{f' ({why})' if why else ''}")


def view(guide: Guide, title: str, changes: Collection[GuideMessage]) -> Group:
    """The whole screen, at most 22 lines of 80 columns."""
    messages = Table.grid(padding=(0, 2))
    messages.add_column(justify="right", width=8)
    messages.add_column()
    for number, change in enumerate(changes, start=1):
        style, newest, text = STYLES.get(change.kind, ""), number == len(changes), printable(change.text)
        if not newest:  # the newest is shown in full, of the ones before it a line each
            text = next(iter(wrap(text.partition("; ")[0], WIDTH - 10)), "")
        messages.add_row(Text(f"{change.at_s:.1f} s", style="dim"), Text(text, style=style, overflow="fold"))
    parts: list[RenderableType] = [_instruction(guide, title), _state(guide), messages]
    if guide.keys:
        parts.append(Text(guide.keys[-WIDTH:], style="dim"))
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
    why = Text(now.reason, style="" if now.good else "bold yellow")
    return Panel(
        Group(Text(now.do.replace(", then at once ", ",\nthen at once "), style=f"bold {colour}"), bar, why),
        title=Text(title),
        title_align="left",
        border_style=colour,
        height=7,
    )


def _state(guide: Guide) -> Table:
    health, taken, table = guide.health, guide.taken, Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    stream: list[tuple[str, RenderableType]] = [
        ("stream", _stream(health)),
        ("faults", _counts((f"{count} {name}", True) for name, count in health.faults.items() if count) or "none"),
        ("temperature", _temperature(guide)),
    ]
    if isinstance(guide, RestGuide):
        rows = [*guide.rows, *stream]
    else:
        gravity = [] if taken.own is None else [("gravity", taken.own.words)]
        ups = _counts(((f"{face} {count}", not count) for face, count in taken.stills_up.items()), "yellow")
        about = _counts(((f"{axis} {degrees:.0f}°", not degrees) for axis, degrees in taken.turned_deg.items()), "yellow")
        rows = [("numbers", _numbers(guide)), ("turns", _turns(guide)), *gravity, *stream, ("up in stills", ups), ("turned about", about)]
    for row in rows:
        table.add_row(*row)
    return table


def _counts(counts: Iterable[tuple[str, bool]], style: str = "bold yellow") -> Text:
    """Counts in a row; those that are marked are highlighted."""
    return Text.assemble(*((f"{words}  ", style if marked else "") for words, marked in counts))


def _numbers(guide: Guide) -> RenderableType:
    met, targets = guide.met
    if not targets:
        return "–"
    row = Table.grid(padding=(0, 1))
    bar = ProgressBar(total=targets, completed=met, width=24, complete_style="green")
    row.add_row(bar, f"{met} of {targets} are good enough")
    return row


def _turns(guide: Guide) -> str:
    of = "" if guide.stop_at_target else f" of {guide.segments}"
    return f"{guide.accepted}{of} accepted{f', {guide.rejected} rejected' if guide.rejected else ''}"


def _stream(health: StreamHealth) -> Text:
    if health.odr_hz is None:
        return Text(f"– Hz; {health.samples} samples")
    others = {"stated": health.info_odr_hz, "host clock": health.odr_by_host_hz}
    stated = ", ".join(f"{who} {odr_hz:.2f}" for who, odr_hz in others.items() if odr_hz)
    return Text(f"{health.odr_hz:.2f} Hz; {f'{stated}; ' if stated else ''}{health.samples} samples")


def _temperature(guide: Guide) -> Text:
    health = guide.health
    if health.temp_c is None:
        return Text("–")
    slope = health.temp_slope
    text = Text(f"{health.temp_c:.1f} °C")
    if slope is not None:
        text.append(f", {slope:+.2f} °C/min")
    if (wait := guide.wait) is not None:
        text.append(f"\n{wait.words}")
    return text
