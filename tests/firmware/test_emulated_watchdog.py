"""The firmware under the watchdog of the test kit's STM32F405: what hangs is reset in time, what runs is not."""

from __future__ import annotations

import numpy as np
import pytest
from f405_programs import tools_missing

from session.bench import frames

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

from emulator.build import build, symbols
from emulator.core import AIRCR, RESET_KEY, RESET_REQUEST, SYSTICK_CSR
from emulator.cpu import CCM
from emulator.machine import Machine
from emulator.sensor import Asm330lhh, AtRest, SensorPort

pytestmark = pytest.mark.emulation

RATE_HZ = 208
RUNS, SETTLES, BY_WATCHDOG, BY_FAULT = 0b11, 1 << 2, 1 << 3, 1 << 4  #: of the board's state; the first: it streams its sensor's samples
LSI_HZ = (17e3, 32e3, 47e3)  #: least, typical and most of the data sheet


@pytest.fixture(scope="module")
def recorder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("watched")
    return build("recorder.elf", folder, folder, ODR_HZ=str(RATE_HZ))


def bodies(stream: bytes) -> list[bytes]:
    """The good frames of a stream, without their CRC."""
    decoded = (frames.decode_blocks(np.frombuffer(token, np.uint8)[None]) for token in stream.split(b"\0") if 6 <= len(token) < 254)
    return [body.tobytes() for body, good in decoded if good[0]]


def states(stream: bytes) -> list[int]:
    """The board's own states."""
    return [body[4] for body in bodies(stream) if body[0] == 0x05]


def state(machine: Machine) -> int:
    """The one that it has said last, but for whether its filters settle."""
    return states(machine.usart1.take())[-1] & ~SETTLES


def samples(stream: bytes) -> int:
    return sum(body[0] == 0x01 for body in bodies(stream))


def started(elf, lsi_hz: float, seconds: float = 2.0, **how) -> Machine:
    machine = Machine(elf, SensorPort(Asm330lhh(AtRest())), lsi_hz=lsi_hz, **how)
    machine.run_until(seconds)
    assert state(machine) == RUNS
    return machine


def stop_time(machine: Machine) -> None:
    """An upset of SysTick's register: nobody ever wakes."""
    machine.core.ticks.write(SYSTICK_CSR, 0)


def hang(machine: Machine) -> None:
    """The loop comes to a place that it never leaves, while interrupts go on."""
    machine.cpu.set_memory(CCM + 0x8000, b"\xfe\xe7")  # b .
    machine.cpu.set("PC", CCM + 0x8001)


@pytest.mark.parametrize("upset", [stop_time, hang])
@pytest.mark.parametrize("lsi_hz", LSI_HZ)
def test_a_board_that_hangs_is_reset_and_streams_again(recorder, lsi_hz, upset):
    """Within 32000 cycles of the low-speed oscillator; then it says so, and samples come."""
    machine = started(recorder, lsi_hz)
    upset(machine)
    machine.run_until(2.0 + 32032 / lsi_hz)
    assert (machine.resets, machine.watchdog_resets) == (1, 1)
    machine.usart1.take()
    machine.run_until(machine.clock.now_s() + 1.5)
    stream = machine.usart1.take()
    assert states(stream)[-1] & ~SETTLES == RUNS | BY_WATCHDOG
    assert samples(stream) > 1.0 * RATE_HZ
    assert machine.watchdog_resets == 1


def flip(machine: Machine, address: int, bit: int) -> None:
    """One bit of the memory changes."""
    (byte,) = machine.cpu.memory(address, 1)
    machine.cpu.set_memory(address, bytes([byte ^ 1 << bit]))


@pytest.mark.parametrize(
    ("register", "value", "by"),
    [
        ("PC", 0x30000001, BY_FAULT),  # no memory
        ("PC", 0x080FFF01, BY_FAULT),  # behind the program, up to the memory's end
        ("SP", 0x60000F00, BY_WATCHDOG),  # no memory: neither the handler of a fault has a stack
        ("SP", 0x20000010, BY_WATCHDOG),  # the stack's own end, with the memory's behind it
    ],
)
def test_a_core_that_runs_astray_is_reset_and_streams_again(recorder, register, value, by):
    """By the handler of faults at once, or where the core locks up by the watchdog."""
    machine = started(recorder, 32e3, hard_faults=True)
    machine.cpu.set(register, value)
    machine.run_until(2.9)
    assert machine.resets == (by == BY_FAULT)
    machine.run_until(4.0)
    assert (machine.resets, machine.watchdog_resets) == (1, by == BY_WATCHDOG)
    assert state(machine) == RUNS | by
    machine.run_until(5.2)
    assert samples(machine.usart1.take()) == pytest.approx(1.2 * RATE_HZ, rel=0.05)
    assert machine.resets == 1


def test_a_board_names_the_cause_of_its_last_reset_alone(recorder):
    """A reset that somebody asks for, as a flasher does, is none of its own; neither is one behind a fault that was said before."""
    machine, said = started(recorder, 32e3, 1.0, hard_faults=True), []

    def ask() -> None:
        machine.core.write(AIRCR, RESET_KEY | RESET_REQUEST)

    for n, upset in enumerate((ask, lambda: machine.cpu.set("PC", 0x30000001), ask, lambda: hang(machine), ask)):
        upset()
        machine.run_until(1.0 + 2.0 * (n + 1))
        said.append(state(machine))
        assert machine.resets == n + 1
    assert said == [RUNS, RUNS | BY_FAULT, RUNS, RUNS | BY_WATCHDOG, RUNS]


@pytest.mark.parametrize("place", [8192 + 4 + 3, 8192 + 20 + 2])  # out, which the end of DMA moves on; next_baud
def test_what_the_ring_cannot_hold_is_not_sent(recorder, place):
    """A count of the ring with a bit too many: old frames would go out again for as long as it takes to send 4 GB."""
    (waiting,) = [symbol.address for symbol in symbols(recorder) if symbol.name == "waiting"]
    machine = started(recorder, 32e3)
    flip(machine, waiting + place, 6)
    machine.run_until(2.5)
    assert 0.4 * RATE_HZ < samples(machine.usart1.take()) <= 0.5 * RATE_HZ + 1
    machine.run_until(3.7)
    assert samples(machine.usart1.take()) == pytest.approx(1.2 * RATE_HZ, rel=0.05)


def test_a_board_that_works_is_never_reset(recorder):
    """The quickest oscillator, its least period 0.68 s: a start, six seconds, a command; a millisecond or two between two reloads.  Then a
    debugger holds the core for 3 s."""
    machine = started(recorder, 47e3, stalls=[(8.5, 3.0)])
    machine.iwdg.longest_s = 0.0
    machine.run_until(6.0)
    assert machine.iwdg.longest_s < 0.005
    machine.usart1.feed(frames.encode_command(frames.DATA_RATE, 1, 12.5))
    machine.run_until(8.0)
    assert machine.resets == 0
    assert machine.iwdg.longest_s < 0.1
    machine.run_until(12.0)
    assert machine.resets == 0
    assert state(machine) == RUNS
    assert machine.bus.objections == {}


def test_it_can_be_left_out(tmp_path):
    """For a debugger without DBG_IWDG_STOP."""
    elf = build("recorder.elf", tmp_path, tmp_path, ODR_HZ="104", WATCHDOG="0")
    machine = started(elf, 32e3)
    hang(machine)
    machine.run_until(6.0)
    assert (machine.resets, machine.iwdg.running) == (0, False)
