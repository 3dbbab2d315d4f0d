"""``watch``: whether a calibration still holds, while the sensor is in use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.errors import CalibrationError
from session.base.options import argument, option, part
from tinygc.cli.arguments import is_standard_output
from tinygc.cli.options import Command, UsesEffects
from tinygc.cli.results import Interruption, complain, output
from tinygc.features.unit.options import SourceOptions, WatchOptions

EPILOG = (
    "exit code: 0 no alarm, 1 an alarm, 5 no rest to evaluate, or a zero that is to be measured again; Ctrl-C ends a watch as the end of "
    "the stream does"
)


@dataclass(frozen=True)
class Options(WatchOptions, SourceOptions, Command, UsesEffects):
    """Options of ``watch``."""

    model: Path = argument("model file, or the folder of a session: the model that its fit recommends")
    source: Path = argument("a standard log, a port, udp:HOST:PORT, or - for standard input")
    until_alarm: bool = option(False, "end at the first alarm")
    command: str | None = option(None, "run at an alarm, without a shell; its JSON line is at the input", metavar="CMD")
    verbose: bool = option(False, "print each rest and each turn")


def run(args: Options) -> int:
    """Watch a source until it ends; print events, write JSON lines, run a command at an alarm."""
    from session.base.records import json_line
    from tinygc.features.unit.watch.alarms import AlarmCommand, JsonLines, words_of
    from tinygc.features.unit.watch.watch import HELD, events_of
    from tinygc.inference.decide import KINDS

    source = str(args.source)
    to_standard = is_standard_output(args.json)
    if args.follow and not args.source.is_file():
        raise CalibrationError(f"--follow: {source} is no file; a port, UDP and standard input are followed anyway")
    at_alarm = None if args.command is None else AlarmCommand(words_of(args.command), complain)
    lines = None if args.json is None else JsonLines(None if to_standard else args.json, complain)
    is_log = args.source.is_file() and not args.follow  # whose answer is known before anything is printed
    shown = {"alarm", "remark"} | ({"start"} if args.verbose or not is_log else set()) | ({"rest", "turn"} if args.verbose else set())
    interruption = Interruption()
    alarmed, held, advice = False, None, ""
    later: list[str] = []

    def ended() -> bool:
        return interruption() or (alarmed and args.until_alarm)

    with interruption:
        for event in events_of(args.model, source, part(args, SourceOptions), part(args, WatchOptions), ended):
            if event.kind in shown:
                (later.append if is_log else output(args).print)(f"{event.t_s:10.1f} s  {event.words}")
            advice = event.table.get("advice", advice)
            if event.kind == "alarm" and not is_log:
                output(args).print(f"next: {advice}")
            if lines is not None:
                lines.write(event.to_json())
            if event.kind == "alarm":
                alarmed = True
                if at_alarm is not None:
                    at_alarm(json_line(event.to_json()))
            elif event.kind == "end":
                held = event.table["held"]
                for line in (event.words, *later, *([f"next: {advice}"] if advice else [])):
                    output(args).print(line)
    if at_alarm is not None:
        at_alarm.wait()
    if lines is not None:
        lines.end()
    return next(KINDS[kind].exit_code for kind, each in HELD.items() if each is held)
