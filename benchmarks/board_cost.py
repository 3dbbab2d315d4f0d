"""What the firmware takes of an STM32F405: memory and stack from the build, the longest pass of its loop on the emulated board.

A pass is what lies between two returns of the main loop to the same place: all ports, the sensor, what is said, and the sleep at its end of
a millisecond at most.  The watchdog wants one in each 0.68 s.  Needs the tools of docs/firmware.md and Unicorn.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "firmware"))

import measure
from common import markdown, progress
from emulated_driver import BAUD, Driven
from misra_check import write_model
from stack import Stack, sections, stack

from session.bench import frames
from tinygc.annexes.emulated.bus import CORE_HZ
from tinygc.annexes.emulated.cpu import RAM
from tinygc.annexes.emulated.machine import Machine
from tinygc.annexes.emulated.readings import KINDS, Fault

PLACE = "status_service"  #: called once in each pass
PAINT = 0x5A
WATCHDOG_S = 32_000 / 47e3  #: the least that it may take
FAULTY_S = 0.05


@dataclass(frozen=True)
class Pass:
    """The longest pass: seconds, of which awake, and instructions.  Each is the longest of its own kind."""

    lasted_s: float
    awake_s: float
    instructions: int


class Passes:
    """Measures a machine's passes from now on."""

    def __init__(self, machine: Machine, address: int):
        self._machine = machine
        self.clear()
        machine.cpu.watch(address, self._next)

    def clear(self) -> None:
        """Begin anew."""
        self._last: tuple[float, float, int] | None = None
        self.longest = Pass(0.0, 0.0, 0)

    def _next(self) -> None:
        machine, longest = self._machine, self.longest
        now = machine.clock.now(), machine.slept, machine.cpu.instructions + machine.cpu.executed()
        if self._last:
            cycles, slept, instructions = (new - old for new, old in zip(now, self._last, strict=True))
            awake_s = max(longest.awake_s, (cycles - slept) / CORE_HZ)
            self.longest = Pass(max(longest.lasted_s, cycles / CORE_HZ), awake_s, max(longest.instructions, int(instructions)))
        self._last = now


def place(elf: Path) -> int:
    """Address of PLACE."""
    return next(symbol.address for symbol in measure.symbols(elf) if symbol.name == PLACE)


def wait(driven: Driven) -> None:
    """Five seconds of streaming."""
    driven.run(5.0)


def set_all(driven: Driven) -> None:
    """Each kind of command."""
    for command in (
        (frames.RANGES, 250, 2),
        (frames.FILTERS, 1, 20),
        (frames.DATA_RATE, 12.5),
        (frames.DATA_RATE, 6667.0),
        (frames.IDENTIFY,),
    ):
        driven.ask(*command)
        driven.run(0.2)


def test(driven: Driven) -> None:
    """The sensor's self-test, whatever comes of it."""
    driven.machine.usart1.feed(frames.encode_command(frames.SELF_TEST, 7))
    driven.run(3.0)


def slow_port(driven: Driven) -> None:
    """Another rate of the host's port while it is busy, and back after the trial."""
    driven.machine.usart1.feed(frames.encode_command(frames.BAUD, 8, 3_000_000))
    driven.run(6.0)


def faults_from(begin_s: float) -> list[Fault]:
    """Every kind of fault that a running sensor can have, one behind the other, and one second without the sensor.

    "int1" is none: this board does not read that pin.
    """
    kinds = [kind for kind in KINDS if kind not in ("late", "int1", "rate")]
    found = [Fault(kind, begin_s + 0.4 * n, FAULTY_S, 3) for n, kind in enumerate(kinds)]
    then_s = begin_s + 0.4 * len(kinds)
    return [*found, Fault("rate", then_s, 1.5), Fault("hang", then_s + 2.0, 1.0)]


@dataclass(frozen=True)
class Situation:
    """What the board does while its passes are measured: at 6667 Hz, or from power-up on."""

    name: str
    do: Callable[[Driven], None]
    faults: tuple[Fault, ...] = ()
    from_power_up: bool = False


FAULTS_FROM_S, FAULTS_S = 1.5, 9.5
SITUATIONS = (
    Situation("streams 6667 Hz", wait),
    Situation("starts, and its sensor answers 1 s late", lambda driven: driven.run(3.0), (Fault("late", 1.0),), from_power_up=True),
    Situation(
        "6667 Hz, every kind of fault, 1 s without the sensor", lambda driven: driven.run(FAULTS_S), tuple(faults_from(FAULTS_FROM_S))
    ),
    Situation("is set anew, each kind of command", set_all),
    Situation("tests its sensor", test),
    Situation("changes its port's rate", slow_port),
)


def passes_of(elf: Path, situation: Situation) -> tuple[Pass, float, list[str]]:
    """The longest pass, the longest time between two reloads of the watchdog, and what no board would do."""
    driven = Driven(elf, faults=situation.faults)
    passes = Passes(driven.machine, place(elf))
    if not situation.from_power_up:
        driven.run(0.4)
        driven.ask(frames.DATA_RATE, 6667.0)
        driven.run(0.5)
        passes.clear()
        driven.machine.iwdg.longest_s = 0.0
    situation.do(driven)
    resets = [f"{driven.machine.resets} resets"] if driven.machine.resets else []
    return passes.longest, driven.machine.iwdg.longest_s, [*driven.objections, *resets]


def start_of(machine: Machine) -> float:
    """Seconds from power-up to the first byte that is sent, to a millisecond."""
    t_ms = 0
    while not machine.usart1.take():
        t_ms += 1
        machine.run_until(t_ms / 1e3)
    return t_ms / 1e3


def paint(machine: Machine, bound: Stack) -> None:
    """Fill the stack of a machine that has not begun."""
    machine.cpu.set_memory(RAM, bytes([PAINT]) * bound.reserved)


def used(machine: Machine, bound: Stack) -> int:
    """Bytes of a painted stack that were written."""
    data = machine.cpu.memory(RAM, bound.reserved)
    return bound.reserved - (len(data) - len(data.lstrip(bytes([PAINT]))))


def used_by_all(elf: Path, bound: Stack) -> int:
    """With each kind of fault and command."""
    driven = Driven(elf, faults=faults_from(FAULTS_FROM_S))
    paint(driven.machine, bound)
    driven.run(0.4)
    set_all(driven)
    driven.run(FAULTS_S)
    test(driven)
    return used(driven.machine, bound)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.parse_args()
    if missing := measure.tools_missing():
        sys.exit(f"board_cost: {missing}")
    with tempfile.TemporaryDirectory(prefix="tinygc-") as name:
        folder = Path(name)
        (folder / "model").mkdir()
        write_model(folder / "model")
        programs = {
            "recorder": measure.build("recorder.elf", folder, folder / "recorder", BAUD=str(BAUD)),
            "with the 195-parameter model": measure.build("tinygc.elf", folder / "model", folder / "modelled", BAUD=str(BAUD)),
        }
        rows = []
        for program, elf in programs.items():
            progress(program)
            size, bound = sections(elf), stack(elf)
            row = [program, size["code"], size["variables"], bound.main, bound.interrupt, bound.fault, bound.total]
            starts = (start_of(Driven(elf).machine), start_of(Machine(elf)))
            rows.append([*row, used_by_all(elf, bound), bound.reserved, *(f"{1e3 * start_s:.0f}" for start_s in starts)])
        progress("")
        head = ["program", "code and constants", "variables", "stack: main", "+ interrupt", "+ fault", "= bound", "used", "reserved"]
        print(markdown([*head, "first byte with a sensor, ms", "without one, ms"], rows))
        print()
        rows = []
        for situation in SITUATIONS:
            progress(situation.name)
            longest, reload_s, objections = passes_of(programs["recorder"], situation)
            share = f"{100 * reload_s / WATCHDOG_S:.1f} %"
            row = [
                situation.name,
                longest.instructions,
                f"{1e3 * longest.awake_s:.2f}",
                f"{1e3 * longest.lasted_s:.2f}",
                f"{1e3 * reload_s:.2f}",
                share,
            ]
            rows.append([*row, "; ".join(objections) or "none"])
        progress("")
        head = [
            "the board",
            "instructions of a pass",
            "awake, ms",
            "pass, ms",
            "between two reloads, ms",
            "of the watchdog's least 0.68 s",
            "objections",
        ]
        print(markdown(head, rows))


if __name__ == "__main__":
    main()
