"""``table``: a table that turns by itself: its makes, its description, where it is, and single moves, each confirmed before."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from session.base.errors import CalibrationError
from session.base.options import argument, file_written, option
from session.base.progress import Reporter
from session.base.texts import command_line, printable
from session.base.units import DEG
from tinygc.cli.arguments import is_standard_output
from tinygc.cli.options import Command
from tinygc.cli.results import ended_by_signals, output, write_json
from tinygc.estimation.options import Seed

if TYPE_CHECKING:
    from tinygc.features.tables.machines.description import Description
    from tinygc.features.tables.machines.link import Where
    from tinygc.features.tables.machines.safety import Guarded, Move

#: action -> its words, and what it does
ACTIONS = {
    "list": ("", "the makes"),
    "new": ("MAKE", "print a table.toml to fill in, of so many --axes"),
    "check": ("", "read the table's file; print axes, limits and all that can be sent"),
    "where": ("", "ask for angles and state"),
    "home": ("", "search the reference marks"),
    "turn": ("AXIS DEG", "turn one axis to an angle"),
    "spin": ("AXIS DPS SECONDS", "turn one axis at a rate"),
    "stop": ("", "bring all axes to rest"),
    "clear": ("", "clear an alarm whose reason you have seen"),
    "virtual": ("", "run a virtual table at a pseudo-terminal"),
}
#: deg/s of ``turn`` where no rate is given
RATE_DPS = 10.0
#: s between two lines of a motion; between two looks at a port
PRINT_S, POLL_S = 1.0, 0.002
SCHEMA = "tinygc-table-command/1"


VIRTUAL = "a virtual table"


@dataclass(frozen=True)
class Options(Command, Seed):
    """Options of ``table``."""

    action: str = argument(
        "; ".join(f"{' '.join(filter(None, (name, words)))}: {what}" for name, (words, what) in ACTIONS.items()),
        choices=tuple(ACTIONS),
        metavar="ACTION",
    )
    words: tuple[str, ...] = argument("of the action, as above; then, if you like, FILE", (), metavar="WORD", read=str)
    table: Path | None = option(None, "its description (table.toml)")
    axes: int = option(1, "of new: one to three", least=1, most=3)
    rate: float | None = option(None, f"of turn ({RATE_DPS:g}, or as fast as the axis can if that is less)", unit="dps", above=0)
    home: bool = option(False, "search the reference marks first: boards that restart when a port is opened")
    at_zero: bool = option(
        False,
        "every axis stands at its zero, where you turned it by hand: boards without marks that restart when a port is opened",
    )
    yes: bool = option(False, "the plan is confirmed: do not ask")
    link: Path | None = option(
        None, "name of its port (tinygc-table in the temporary folder)", metavar="PATH", read=file_written, group=VIRTUAL, rare=True
    )
    faults: str = option(
        "",
        "what goes wrong, and when: estop@20, stall@move2 (docs/features/tables/tables.md)",
        metavar="NAME@S",
        read=str,
        group=VIRTUAL,
        rare=True,
    )
    resets: bool = option(False, "it restarts when its port is opened, as an Arduino Uno does", group=VIRTUAL, rare=True)


def run(args: Options) -> int:
    """Do one action."""
    words = ACTIONS[args.action][0].split()
    if len(args.words) == len(words) + 1 and args.words[-1].endswith(".toml") and args.table is None and args.action not in ("list", "new"):
        args = replace(args, table=Path(args.words[-1]), words=args.words[:-1])
    if len(args.words) != len(words):
        given = f"; it has {len(args.words)} words" if args.words else ""
        raise CalibrationError(f"table {args.action}: expected {' '.join((args.action, *words))}{given}")
    if args.action in ("list", "new"):
        args.refuse_with(f"table {args.action}", *(("axes",) if args.action == "new" else ()))
        from tinygc.features.tables.machines.makes import makes, template

        stated = {"schema": SCHEMA, "action": args.action}
        if args.action == "new":
            return _printed(args, template(args.words[0], args.axes).splitlines(), stated | {"make": args.words[0]})
        known = makes()
        listed = [{"name": name, "title": title} for name, title in known.items()]
        return _printed(args, [f"{name:10}  {title}" for name, title in known.items()], stated | {"makes": listed})
    from tinygc.features.tables.machines.description import read_description

    args = replace(args, table=args.table or Path("table.toml"))  # no default: `table new … > table.toml` writes it
    assert args.table is not None
    table = read_description(args.table)
    with ended_by_signals(ignored_interrupt=True):
        return {"check": _check, "virtual": _virtual}.get(args.action, _machine)(args, table)


def _printed(args: Options, lines: Sequence[str], table: dict) -> int:
    """Print lines, and write the JSON."""
    for line in lines:
        output(args).print(printable(line))
    write_json(args.json, table)
    return 0


def _check(args: Options, table: Description) -> int:
    from tinygc.features.tables.machines.makes import is_own, make_of
    from tinygc.features.tables.machines.proof import example

    lines = [f"{table.name}: make {table.make}, port {table.port or 'none'}"]
    for axis in table.axes:
        direction = ", ".join(f"{x:g}" for x in axis.direction)
        most = f"up to {axis.fastest_rps / DEG:g} dps, {axis.acceleration_rps2 / DEG:g} dps/s"
        accuracy = f"angle within {axis.sigma_rad / DEG:g} deg, play {axis.backlash_rad / DEG:g} deg"
        lines.append(f"  {axis.name} ({axis.word}): about {direction}; {axis.limits}; {most}; {accuracy}")
    assert args.table is not None
    make = make_of(table, args.table.parent)
    lines += [f"sent for {what}: {text}" for what, text in example(table, make)]
    if make.warning:
        lines.append(f"warning: {make.warning}")
    if make.unchecked:
        lines.append(f"unchecked in the make's file: {make.unchecked}")
    if is_own(table):
        line = f'make_sha256 = "{make.sha256}"'
        lines.append(
            f"{table.make} is confirmed as it is"
            if table.make_sha256 == make.sha256
            else f"{table.make} is not confirmed; once you have read all of that, write next to make = in {args.table}: {line}"
        )
    return _printed(args, lines, _state(args, table, None))


def _machine(args: Options, table: Description) -> int:
    """What needs the machine."""
    from tinygc.features.tables.machines.makes import open_table
    from tinygc.features.tables.machines.safety import Guarded

    moves = _moves(args, table)
    assert args.table is not None
    machine = open_table(table, args.table.parent, stops=args.action == "stop")
    with Guarded(machine) as guarded:
        if args.at_zero:
            guarded.stands_at_zero()
        if args.action == "clear":
            _confirm(args, f"{table.name}: clear its alarm? You have seen why it stopped, and no one is near")
            guarded.clear()
        if args.action == "stop":
            guarded.stop()
        if moves:
            guarded.confirm(moves, None if args.yes else lambda question: _confirm(args, question), _printer(args))
            _move(args, guarded, moves)
        found = guarded.where()
    lines = [f"{axis.name}  {_shown(angle, 3)}" for axis, angle in zip(table.axes, found.angles, strict=True)]
    return _printed(args, [*lines, "it moves" if found.moving else "it rests"], _state(args, table, found))


def _moves(args: Options, table: Description) -> list[Move]:
    """The plan of an action; empty for those that move nothing."""
    from tinygc.features.tables.machines.safety import Move

    first = [Move.home()] if args.home and args.action in ("turn", "spin") else []
    if args.action == "home":
        return [Move.home()]
    if args.action not in ("turn", "spin"):
        return []
    axis = table.axis(args.words[0])
    numbers = [_number(word) for word in args.words[1:]]
    if args.action == "spin":
        if not numbers[0] or numbers[1] <= 0:
            raise CalibrationError("table spin: expected a rate in deg/s that is not 0, and seconds above 0")
        return [*first, Move.at(axis, numbers[0] * DEG, numbers[1])]
    rate_rps = args.rate * DEG if args.rate else min(RATE_DPS * DEG, table.axes[axis].fastest_rps)
    return [*first, Move.to(axis, numbers[0] * DEG, rate_rps)]


def _move(args: Options, guarded: Guarded, moves: Sequence[Move]) -> None:
    from session.bench.clocks import Clock

    clock, show = Clock(), _printer(args)
    for move in moves:
        end_s = float("inf")
        if move.axis is None:
            guarded.home()
        elif move.at_rate:
            guarded.turn_at(move.axis, _number(args.words[1]) * DEG)
            end_s = clock.now_s() + _number(args.words[2])
        else:
            guarded.turn_to(move.axis, move.most_rad, move.fastest_rps)
        printed_s = clock.now_s()
        while (found := guarded.where()).moving and clock.now_s() < end_s:
            if clock.now_s() - printed_s >= PRINT_S:
                printed_s = clock.now_s()
                axes = zip(guarded.description.axes, found.angles, strict=True)
                show("  ".join(f"{axis.name} {_shown(angle, 2)}" for axis, angle in axes))
            clock.sleep(0.05)
        if found.moving:
            guarded.stop()


def _virtual(args: Options, table: Description) -> int:
    """Run a virtual table until Ctrl-C."""
    try:
        from tinygc.simulation.terminal import Terminal
    except ImportError:
        raise CalibrationError("table virtual: needs a pseudo-terminal, which only POSIX systems have (Linux, macOS)") from None
    from session.bench.clocks import Clock
    from tinygc.features.tables.machines.virtual import LINK, TableLine, VirtualTable
    from tinygc.features.tables.machines.virtual_motion import Fault

    virtual = VirtualTable(table, Clock(), Fault.parse(args.faults), args.seed)
    with Terminal(args.link or LINK) as terminal:
        if not args.quiet and not is_standard_output(args.json):
            print(terminal.name, flush=True)
        _printer(args)(
            f'{table.name}: a virtual {table.make}; write port = "{terminal.name}" into the file that {command_line("table")} reads'
        )
        try:
            line = TableLine(virtual, terminal, args.resets)
            while True:
                line.sleep(POLL_S)
        except KeyboardInterrupt:
            pass
        finally:
            write_json(args.json, _state(args, table, None))
    return 0


def _confirm(args: Options, question: str) -> bool:
    """Ask the person at the terminal.  CalibrationError where there is none, or the answer is no."""
    from tinygc.features.tables.machines.safety import ask_person

    return args.yes or ask_person(f"{question} [y/N]", f"table {args.action}: not confirmed; nothing was moved")


def _printer(args: Options) -> Reporter:
    """Prints to standard error; a plan is shown even with --quiet where it has to be confirmed."""
    quiet = args.quiet and args.yes
    return lambda text: None if quiet else print(printable(text), file=sys.stderr, flush=True)


def _shown(angle_rad: float, decimals: int) -> str:
    return f"{angle_rad / DEG:.{decimals}f} deg" if isfinite(angle_rad) else "not known yet"


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e7:
        raise CalibrationError(f"table: {text[:40]!r} is no number of degrees, degrees per second or seconds")
    return value


def _state(args: Options, table: Description, found: Where | None) -> dict:
    angles = [None] * len(table.axes) if found is None else [float(angle / DEG) if isfinite(angle) else None for angle in found.angles]
    return {
        "schema": SCHEMA,
        "action": args.action,
        "name": table.name,
        "make": table.make,
        "axes": [{"name": axis.name, "angle_deg": angle} for axis, angle in zip(table.axes, angles, strict=True)],
        "moving": None if found is None else found.moving,
        "table_s": None if found is None else found.table_s,
    }
