"""``watch``: whether a calibration still holds, while the sensor is in use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.errors import CalibrationError
from session.base.options import argument, option
from tinygc.cli.arguments import duration, is_standard_output, stream_header
from tinygc.cli.options import Command, UsesEffects
from tinygc.cli.results import Interruption, complain, output

SUMMARY = "watch a live stream or a log: whether the zero, gravity and the turns still agree with the calibration"
EPILOG = (
    "exit code: 0 no alarm, 1 an alarm, 5 no rest to judge, or a zero that is to be taken anew; Ctrl-C ends a watch as the end of "
    "the stream does"
)
#: exit code of a watch that could judge nothing
UNDECIDED = 5


@dataclass(frozen=True)
class Options(Command, UsesEffects):
    """Options of ``watch``."""

    model: Path = argument("model file, or the folder of a session: the model that its fit recommends")
    source: Path = argument("a standard log, a port, udp:HOST:PORT, or - for standard input")
    follow: bool = option(False, "read a log on while it grows, until Ctrl-C")
    false_alarm_every: float = option(
        30 * 86400.0, "mean time at rest to a false alarm, s, or as 30d, 12h, 90min", metavar="TIME", read=duration, above=0
    )
    until_alarm: bool = option(False, "end at the first alarm")
    command: str | None = option(None, "run at an alarm, without a shell; its JSON line is at the input", metavar="CMD")
    noise: Path | None = option(None, "noise.json of this unit, or its folder (beside the model)", metavar="PATH")
    session: Path | None = option(None, "where session.toml is: place, full scales, accelerometer", metavar="DIR")
    verbose: bool = option(False, "print each rest and each turn")
    baud: int = option(921600, "of a port that has one", least=1)
    header: str | None = option(None, "of a text stream that does not send it: t_us,gx_dps,…", metavar="LINE", read=stream_header)


def run(args: Options) -> int:
    """Watch a source until it ends; print events, write JSON lines, run a command at an alarm."""
    from session.base.results import json_line
    from tinygc.features.unit.watch.alarm_command import AlarmCommand, words_of
    from tinygc.features.unit.watch.library import SourceOptions, events_of
    from tinygc.features.unit.watch.lines import JsonLines

    source = str(args.source)
    to_standard = is_standard_output(args.json)
    if args.follow and not args.source.is_file():
        raise CalibrationError(f"--follow: {source} is no file; a port, UDP and standard input are followed anyway")
    at_alarm = None if args.command is None else AlarmCommand(words_of(args.command), complain)
    options = SourceOptions(args.follow, args.header, args.baud)
    lines = None if args.json is None else JsonLines(None if to_standard else args.json, complain)
    shown = {"start", "alarm", "remark", "end"} | ({"rest", "turn"} if args.verbose else set())
    interruption = Interruption()
    alarmed, held = False, None

    def ended() -> bool:
        return interruption() or (alarmed and args.until_alarm)

    with interruption:
        events = events_of(
            args.model,
            source,
            options,
            false_alarm_every_s=args.false_alarm_every,
            noise=args.noise,
            session=args.session,
            ended=ended,
        )
        for event in events:
            if event.kind in shown:
                output(args).print(f"{event.t_s:10.1f} s  {event.words}", soft_wrap=True, markup=False)
            if lines is not None:
                lines.write(event.to_json())
            if event.kind == "alarm":
                alarmed = True
                if at_alarm is not None:
                    at_alarm(json_line(event.to_json()))
            elif event.kind == "end":
                held = event.table["held"]
    if at_alarm is not None:
        at_alarm.wait()
    if lines is not None:
        lines.end()
    return UNDECIDED if held is None else 0 if held else 1
