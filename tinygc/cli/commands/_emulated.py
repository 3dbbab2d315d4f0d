"""``board --firmware``: the real board's program on an emulated one."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from session.common.errors import CalibrationError
from tinygc.cli.commands._results import write_json
from tinygc.cli.paths import is_standard_output

if TYPE_CHECKING:
    from tinygc.simulation.asm330lhh.faults import Fault
    from tinygc.simulation.board.source import Source
    from tinygc.simulation.board.terminal import Terminal
    from tinygc.simulation.options import SimulationOptions
    from tinygc.simulation.unit import SimulatedUnit

#: options of the virtual board that say what the program says itself
ITS_OWN = ("frames", "physical", "uptime")


def check_options(args: argparse.Namespace) -> None:
    """CalibrationError where an option does not go with ``--firmware``, or what it needs is missing."""
    from tinygc.simulation.stm32f405.cpu import missing

    for name in ITS_OWN:
        if getattr(args, name):
            raise CalibrationError(f"board: with --firmware the program says that itself; leave --{name} out")
    if missing():
        raise CalibrationError(f"board: --firmware: {missing()}")
    _faults(args.faults)


def _faults(text: str) -> list[Fault]:
    from tinygc.simulation.asm330lhh.faults import Fault

    try:
        return [Fault.parse(word) for word in text.split(",") if word.strip()]
    except ValueError as error:
        raise CalibrationError(f"board: --faults: {error}") from None


def unit_of_the_model(options: SimulationOptions) -> SimulatedUnit:
    """The simulated session's sensor, at the data rate that the register model has."""
    from tinygc.simulation.emulated.replayed import with_its_own_rate
    from tinygc.simulation.simulate import unit_of

    return with_its_own_rate(unit_of(options), options.odr_hz)


def run_emulated(args: argparse.Namespace, source: Source, terminal: Terminal, say: Callable[[str], None]) -> int:
    """Stream until Ctrl-C or the end of ``--tail``.  CalibrationError where the program is none, or faults."""
    from tinygc.simulation.asm330lhh.sensor import Asm330lhh
    from tinygc.simulation.emulated.board import EmulatedBoard
    from tinygc.simulation.emulated.replayed import Replayed, oscillator_of
    from tinygc.simulation.stm32f405.cpu import ProgramError

    motion = Replayed(source)
    sensor = Asm330lhh(motion, oscillator_of(source.info.odr_hz), _faults(args.faults))
    uid = (args.seed + 1).to_bytes(12, "little")
    try:
        board = EmulatedBoard(
            args.firmware,
            sensor,
            terminal,
            motion,
            speed=args.speed if args.speed < math.inf else None,
            lead_s=args.lead,
            tail_s=args.tail,
            uid=uid,
            say=say,
        )
    except (ValueError, OSError, ProgramError) as error:
        raise CalibrationError(f"board: --firmware: {error}") from None
    machine = board.machine
    try:
        if not args.quiet and not is_standard_output(args.json):
            print(terminal.name, flush=True)
        say(f"{args.firmware.name} on an emulated STM32F405: open it with another program; Ctrl-C ends")
        board.run()
    except ProgramError as error:
        raise CalibrationError(f"board: {args.firmware}: {error}") from None
    finally:
        for what in (*machine.bus.objections, *sensor.objections):
            say(f"not as a real board would have it: {what}")
        lost = sensor.fifo.lost
        say(f"{sensor.samples} samples made, {lost} words overrun in the FIFO, {terminal.dropped} writes dropped since nobody read")
        if board.late_s:
            say(f"the emulation fell {board.late_s:.1f} s behind the clock: too busy for --speed {args.speed:g} (max never is)")
        starts = machine.resets + 1
        told = {"samples": sensor.samples, "dropped": terminal.dropped, "starts": starts, "take": source.number}
        write_json(args.json, {"schema": "tinygc-board/1", **told})
    return 0
