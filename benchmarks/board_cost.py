"""What the firmware takes of an STM32F405: memory and stack from the build, the longest turn of its loop on the emulated board.

A turn is what lies between two returns of the main loop to the same place: all ports, the sensor, what is said, and the sleep at its end of
a millisecond at most.  The watchdog wants one in each 0.68 s.  Needs the tools of docs/firmware.md and Unicorn.
"""

from __future__ import annotations

import argparse
import re
import subprocess
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
from stack import Stack, stack

from session.bench import frames
from tinygc.annexes.emulated.bus import CORE_HZ
from tinygc.annexes.emulated.cpu import RAM
from tinygc.annexes.emulated.machine import Machine
from tinygc.annexes.emulated.readings import Fault

PLACE = "status_service"  #: called once in each turn
PAINT = 0x5A
WATCHDOG_S = 32_000 / 47e3  #: the least that it may take
FAULTY_S = 0.05


@dataclass(frozen=True)
class Turn:
    """The longest turn: seconds, of which awake, and instructions.  Each is the longest of its own kind."""

    lasted_s: float
    awake_s: float
    instructions: int


class Turns:
    """Measures a machine's turns from now on."""

    def __init__(self, machine: Machine, address: int):
        self._machine = machine
        self.clear()
        machine.cpu.watch(address, self._next)

    def clear(self) -> None:
        """Begin anew."""
        self._last: tuple[float, float, int] | None = None
        self.longest = Turn(0.0, 0.0, 0)

    def _next(self) -> None:
        machine, longest = self._machine, self.longest
        now = machine.clock.now(), machine.slept, machine.cpu.instructions + machine.cpu.executed()
        if self._last:
            cycles, slept, instructions = (new - old for new, old in zip(now, self._last, strict=True))
            awake_s = max(longest.awake_s, (cycles - slept) / CORE_HZ)
            self.longest = Turn(max(longest.lasted_s, cycles / CORE_HZ), awake_s, max(longest.instructions, int(instructions)))
        self._last = now


def symbols(elf: Path) -> dict[str, int]:
    """Symbol -> address."""
    table = subprocess.run(["arm-none-eabi-nm", elf], capture_output=True, text=True, check=True).stdout
    return {name: int(address, 16) for address, name in re.findall(r"^(\w+) \w (\S+)$", table, re.M)}


def sections(elf: Path) -> dict[str, int]:
    """Bytes of code and constants, of variables, and of the stack."""
    table = subprocess.run(["arm-none-eabi-size", "-A", elf], capture_output=True, text=True, check=True).stdout
    sizes = {name: int(size) for name, size in re.findall(r"^(\.\w+)\s+(\d+)", table, re.M)}
    variables = sum(sizes.get(name, 0) for name in (".data", ".bss", ".kept"))
    return {"code": sizes[".text"] + sizes.get(".data", 0), "variables": variables, "stack": sizes[".stack"]}


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
    """Every kind of fault, one behind the other, and one second without the sensor."""
    kinds = ("parity", "tag_count", "tag_unknown", "missing", "swapped", "zeros", "ones", "hang", "identity", "reset")
    found = [Fault(kind, begin_s + 0.4 * n, FAULTY_S, 3) for n, kind in enumerate(kinds)]
    return [*found, Fault("hang", begin_s + 0.4 * len(kinds), 1.0)]


@dataclass(frozen=True)
class Situation:
    """What the board does while its turns are measured; sensor: whether there is one."""

    name: str
    do: Callable[[Driven], None]
    faults: tuple[Fault, ...] = ()
    sensor: bool = True


SITUATIONS = (
    Situation("streams 6667 Hz", wait),
    Situation("6667 Hz, every kind of fault, 1 s without the sensor", lambda driven: driven.run(7.0), tuple(faults_from(1.5))),
    Situation("is set anew, each kind of command", set_all),
    Situation("tests its sensor", test),
    Situation("changes its port's rate", slow_port),
)


def turns_of(elf: Path, situation: Situation) -> tuple[Turn, float, list[str]]:
    """The longest turn, the longest time between two reloads of the watchdog, and what no board would do."""
    driven = Driven(elf, faults=situation.faults)
    turns = Turns(driven.machine, symbols(elf)[PLACE])
    driven.run(0.4)
    driven.ask(frames.DATA_RATE, 6667.0)
    driven.run(0.5)
    turns.clear()
    driven.machine.iwdg.longest_s = 0.0
    situation.do(driven)
    resets = [f"{driven.machine.resets} resets"] if driven.machine.resets else []
    return turns.longest, driven.machine.iwdg.longest_s, [*driven.objections, *resets]


def start_of(elf: Path) -> float:
    """Seconds from power-up to the first turn."""
    machine, began = Machine(elf), []
    machine.cpu.watch(symbols(elf)[PLACE], lambda: began.append(machine.clock.now_s()))
    machine.run_until(5.0)
    return began[0]


def used(elf: Path, bound: Stack) -> int:
    """Bytes of the stack that the board wrote, with each kind of fault and command."""
    driven = Driven(elf, faults=faults_from(1.5))
    driven.machine.cpu.set_memory(RAM, bytes([PAINT]) * bound.reserved)
    driven.run(1.0)
    set_all(driven)
    test(driven)
    data = driven.machine.cpu.memory(RAM, bound.reserved)
    return bound.reserved - (len(data) - len(data.lstrip(bytes([PAINT]))))


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
            "recorder": (measure.build("recorder.elf", folder, folder / "recorder", BAUD=str(BAUD)), folder / "recorder" / "recorder"),
            "with the 195-parameter model": (
                measure.build("tinygc.elf", folder / "model", folder / "modelled", BAUD=str(BAUD)),
                folder / "modelled",
            ),
        }
        rows = []
        for program, (elf, objects) in programs.items():
            progress(program)
            size, bound = sections(elf), stack(elf, objects)
            row = [program, size["code"], size["variables"], bound.main, bound.interrupt, bound.fault, bound.total, used(elf, bound)]
            rows.append([*row, bound.reserved, f"{1e3 * start_of(elf):.0f}"])
        progress("")
        head = ["program", "code and constants", "variables", "stack: main", "+ interrupt", "+ fault", "= bound", "used", "reserved"]
        print(markdown([*head, "start-up without a sensor, ms"], rows))
        print()
        rows = []
        for situation in SITUATIONS:
            progress(situation.name)
            turn, reload_s, objections = turns_of(programs["recorder"][0], situation)
            share = f"{100 * reload_s / WATCHDOG_S:.1f} %"
            row = [
                situation.name,
                turn.instructions,
                f"{1e3 * turn.awake_s:.2f}",
                f"{1e3 * turn.lasted_s:.2f}",
                f"{1e3 * reload_s:.2f}",
                share,
            ]
            rows.append([*row, "; ".join(objections) or "none"])
        progress("")
        head = [
            "the board",
            "instructions of a turn",
            "awake, ms",
            "turn, ms",
            "between two reloads, ms",
            "of the watchdog's least 0.68 s",
            "objections",
        ]
        print(markdown(head, rows))


if __name__ == "__main__":
    main()
