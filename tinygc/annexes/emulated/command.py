"""``board --firmware``: the real board's program on an emulated one.  Imports nothing heavy at its top."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from session.io.errors import CalibrationError
from tinygc.cli.arguments import is_standard_output, path_read
from tinygc.cli.results import write_json

if TYPE_CHECKING:
    from tinygc.annexes.emulated.readings import Fault
    from tinygc.simulation.options import SimulatedUnit, SimulationOptions
    from tinygc.simulation.terminal import Terminal
    from tinygc.simulation.virtual_board import BoardSource

#: options of the virtual board that the program determines itself
DECIDED_BY_PROGRAM = ("frames", "physical", "uptime")


def add_board_arguments(command: argparse.ArgumentParser) -> None:
    """Add the options of ``board``."""
    command.add_argument(
        "--firmware",
        type=path_read,
        metavar="ELF",
        help="run this program on an emulated STM32F405 with a model of the sensor, an ASM330LHH or LSM6DSO, that feels the session "
        "(docs/emulated-board.md); --faults is then KIND@S of zeros, ones, hang, reset, register, rate, late, identity, parity, tag_count, "
        "tag_unknown, tag_pair, swapped, missing and int1",
    )


def check_options(args: argparse.Namespace) -> None:
    """Raise CalibrationError where an option is incompatible with ``--firmware``, or a requirement is missing."""
    from tinygc.annexes.emulated.cpu import missing

    for name in DECIDED_BY_PROGRAM:
        if getattr(args, name):
            raise CalibrationError(f"board: with --firmware the program says that itself; leave --{name} out")
    if missing():
        raise CalibrationError(f"board: --firmware: {missing()}")
    _faults(args.faults)


def _faults(text: str) -> list[Fault]:
    from tinygc.annexes.emulated.readings import Fault

    try:
        return [Fault.parse(word) for word in text.split(",") if word.strip()]
    except ValueError as error:
        raise CalibrationError(f"board: --faults: {error}") from None


def unit_of_the_model(options: SimulationOptions) -> SimulatedUnit:
    """Return the simulated session's sensor, at the data rate of the register model.  CalibrationError for a sensor without a model."""
    from tinygc.annexes.emulated.board import with_its_own_rate
    from tinygc.annexes.emulated.readings import CHIPS
    from tinygc.simulation.simulator import unit_of

    if options.sensor not in CHIPS:
        known = " and ".join(CHIPS)
        raise CalibrationError(f"board: --sensor {options.sensor}: with --firmware there are {known}; give one of them")
    return with_its_own_rate(unit_of(options), options.odr_hz)


def run(args: argparse.Namespace, source: BoardSource, terminal: Terminal, say: Callable[[str], None]) -> int:
    """Stream until Ctrl-C or the end of ``--tail``.  Raises CalibrationError for an invalid program, and where the program faults."""
    from tinygc.annexes.emulated.board import EmulatedBoard, Replayed, oscillator_of
    from tinygc.annexes.emulated.cpu import ProgramError
    from tinygc.annexes.emulated.readings import ASM330LHH, CHIPS, Silicon
    from tinygc.annexes.emulated.sensor import Asm330lhh

    motion = Replayed(source)
    silicon = Silicon(chip=CHIPS.get(source.info.sensor or "", ASM330LHH))
    sensor = Asm330lhh(motion, oscillator_of(source.info.odr_hz), _faults(args.faults), silicon=silicon)
    try:
        board = EmulatedBoard(
            args.firmware,
            sensor,
            terminal,
            motion,
            speed=args.speed if args.speed < math.inf else None,
            lead_s=args.lead,
            tail_s=args.tail,
            uid=(args.seed + 1).to_bytes(12, "little"),
            say=say,
        )
    except (ValueError, OSError, ProgramError) as error:
        raise CalibrationError(f"board: --firmware: {error}") from None
    machine = board.machine
    try:
        if not args.quiet and not is_standard_output(args.json):
            print(terminal.name, flush=True)
        say(f"{args.firmware.name} on an emulated STM32F405 with an {sensor.chip.name}: open it with another program; Ctrl-C ends")
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
        counts = {"samples": sensor.samples, "dropped": terminal.dropped, "starts": machine.resets + 1, "take": source.number}
        write_json(args.json, {"schema": "tinygc-board/1", **counts})
    return 0
