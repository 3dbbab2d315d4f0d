"""The independent watchdog of the emulated STM32F405, and the firmware under it: what hangs is reset in time, what runs is not."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from conftest import ROOT
from f405_programs import came_to_its_end, compiled, found, tools_missing

from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import SampleChunk
from tinygc.annexes.emulated.readings import AtRest
from tinygc.annexes.emulated.sensor import Asm330lhh, SensorPort

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

sys.path.insert(0, str(ROOT / "firmware"))
import measure

from tinygc.annexes.emulated.core import AIRCR, RESET_KEY, RESET_REQUEST, SYSTICK_CSR
from tinygc.annexes.emulated.cpu import CCM
from tinygc.annexes.emulated.machine import Machine

pytestmark = pytest.mark.emulation

RATE_HZ = 208
RUNS, SETTLES, BY_WATCHDOG, BY_FAULT = 0b11, 1 << 2, 1 << 3, 1 << 4  #: of the board's state; the first: it streams its sensor's samples
LSI_HZ = (17e3, 32e3, 47e3)  #: least, typical and most of the data sheet
WATCHED = """
#define IWDG(o) REG(0x40003000 + (o))
#define CSR REG(0x40023874)
static void watched(uint32_t prescaler, uint32_t reload)
{
    IWDG(0) = 0xCCCC;
    IWDG(0) = 0x5555;
    IWDG(4) = prescaler;
    IWDG(8) = reload;
    while (IWDG(12)) ;
    IWDG(0) = 0xAAAA;
}
"""


def ran(text: str, folder, t_s: float, **how) -> Machine:
    machine = Machine(compiled(WATCHED + text, folder), **how)
    machine.run_until(t_s)
    return machine


@pytest.mark.parametrize("lsi_hz", LSI_HZ)
def test_it_resets_after_its_period_of_the_low_speed_oscillator(lsi_hz, tmp_path):
    """Prescaler 32, 100 counts: 0.1 s of 32 kHz.  Found: how often it started, and the flags of the last start."""
    text = """
    int main(void)
    {
        found[1] = CSR;
        CSR |= 1u << 24;
        found[2] = CSR;
        if (found[0]++ < 2) { watched(3, 99); for (;;) found[3]++; }
        return 0;
    }"""
    machine = Machine(compiled(WATCHED + text, tmp_path), lsi_hz=lsi_hz)
    period_s = 32 * 100 / lsi_hz
    update_s = 5 / lsi_hz
    machine.run_until(period_s + 0.9 * update_s)
    assert machine.watchdog_resets == 0
    machine.run_until(period_s + 1.1 * update_s)
    assert (machine.watchdog_resets, found(machine, 2)[1]) == (1, 0x24000000)  # the watchdog's flag, and the pin's
    machine.run_until(2 * period_s + 3 * update_s)
    assert (machine.resets, machine.watchdog_resets) == (2, 2)
    assert came_to_its_end(machine)
    assert found(machine, 3)[2] == 0
    assert machine.bus.objections == {}


def test_a_program_that_reloads_it_goes_on(tmp_path):
    """The least period, 4 x 200 cycles of the quickest oscillator: 17 ms, reloaded each 16, is enough; each 18 is not."""
    text = """
    int main(void)
    {
        systick(168000);
        watched(0, 199);
        for (uint32_t n = 1;; n++) { while (milliseconds < %d * n) WFI(); IWDG(0) = 0xAAAA; }
    }"""
    for every_ms, resets in ((16, 0), (18, 53)):
        machine = ran(text % every_ms, tmp_path, 1.0, lsi_hz=47e3)
        assert machine.watchdog_resets == pytest.approx(resets, abs=6 if resets else 0)
        if not resets:
            assert machine.iwdg.longest_s == pytest.approx(every_ms / 1e3, abs=1e-4)


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("IWDG(0) = 0xCCCC; IWDG(4) = 3;", "IWDG_PR is written without its key"),
        ("IWDG(0) = 0xCCCC; IWDG(0) = 0x5555; IWDG(8) = 3; IWDG(8) = 4;", "IWDG_RLR is written before its last value was taken over"),
        ("IWDG(0) = 0x5555; IWDG(8) = 3; for (volatile int n = 0; n < 9999; n++) ; IWDG(8) = 4;", "before its last value was taken over"),
    ],
)
def test_what_the_part_ignores_is_objected_to(program, said, tmp_path):
    """The last: without the low-speed oscillator nothing is ever taken over."""
    machine = ran(f"int main(void) {{ {program} return 0; }}", tmp_path, 0.01)
    (objection,) = machine.bus.objections
    assert said in objection


def test_an_oscillator_that_is_on_takes_values_over_before_the_start(tmp_path):
    text = "int main(void) { CSR |= 1; IWDG(0) = 0x5555; IWDG(8) = 3; while (IWDG(12)) ; found[0] = IWDG(8); found[1] = CSR; return 0; }"
    machine = ran(text, tmp_path, 0.01)
    assert came_to_its_end(machine)
    assert found(machine, 2) == [3, 0x0E000003]


@pytest.mark.parametrize(("stops", "resets"), [(0, 1), (1, 0)])
def test_a_debugger_holds_it_where_the_program_wants_that(stops, resets, tmp_path):
    """A stall of 0.3 s, a period of 0.1 s, reloaded each millisecond."""
    text = f"""
    int main(void)
    {{
        if ({stops}) REG(0xE0042008) |= 1u << 12;
        systick(168000);
        watched(3, 99);
        for (;;) {{ WFI(); IWDG(0) = 0xAAAA; }}
    }}"""
    assert ran(text, tmp_path, 0.5, stalls=[(0.1, 0.3)]).watchdog_resets == resets


def test_a_reset_cuts_what_is_sent_and_leaves_nothing_of_before(tmp_path):
    """What DMA has sent up to the reset has been sent; the rest is not, and its end comes to nobody."""
    text = """
    static uint8_t text[1000];
    int main(void)
    {
        usart_on();
        if (found[0]++) return 0;
        for (int n = 0; n < 1000; n++) text[n] = (uint8_t)n;
        USART1(0x14) = 0x80;
        STREAM(7, 8) = 0x40011004;
        STREAM(7, 12) = (uint32_t)text;
        STREAM(7, 4) = 1000;
        STREAM(7, 0) = 4u << 25 | 1u << 10 | 1u << 6 | 1;
        for (volatile int n = 0; n < 20000; n++) ;
        REG(0xE000ED0C) = 0x05FA0004;
        for (;;) ;
    }"""
    machine = ran(text, tmp_path, 0.05)
    sent = machine.usart1.take()
    assert machine.resets == 1
    assert 50 < len(sent) < 500
    assert sent == bytes(n & 0xFF for n in range(len(sent)))
    assert found(machine)[0] == 2


# The firmware


@pytest.fixture(scope="module")
def recorder(tmp_path_factory):
    if trouble := measure.tools_missing():
        pytest.skip(trouble)
    folder = tmp_path_factory.mktemp("watched")
    return measure.build("recorder.elf", folder, folder, ODR_HZ=str(RATE_HZ))


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
        machine.core.write(AIRCR, 4, RESET_KEY | RESET_REQUEST)

    for n, upset in enumerate((ask, lambda: machine.cpu.set("PC", 0x30000001), ask, lambda: hang(machine), ask)):
        upset()
        machine.run_until(1.0 + 2.0 * (n + 1))
        said.append(state(machine))
        assert machine.resets == n + 1
    assert said == [RUNS, RUNS | BY_FAULT, RUNS, RUNS | BY_WATCHDOG, RUNS]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(60))
def test_a_bit_of_the_memory_that_changes_ends_no_stream(recorder, seed):
    """Any variable but the switch of the stream, which the host may have set: samples come again, each once."""
    rng = np.random.default_rng(seed)
    variables = [symbol for symbol in measure.symbols(recorder) if symbol.kind in "bdBD" and symbol.size and symbol.name != "off"]
    variable = variables[rng.integers(len(variables))]
    machine = started(recorder, 32e3, 1.0 + 0.01 * rng.random(), hard_faults=True)
    flip(machine, variable.address + variable.size - 1 - int(rng.integers(min(variable.size, 64))), int(rng.integers(8)))
    machine.run_until(4.0)
    decoder = StreamDecoder()
    machine.usart1.take()
    machine.run_until(5.2)
    chunks = [chunk for chunk in decoder.feed(machine.usart1.take()) if isinstance(chunk, SampleChunk)]
    assert sum(len(chunk.t_us) for chunk in chunks) == pytest.approx(1.2 * RATE_HZ, rel=0.05)
    assert decoder.resets == 0


@pytest.mark.parametrize("place", [8192 + 4 + 3, 8192 + 20 + 2])  # out, which the end of DMA moves on; next_baud
def test_what_the_ring_cannot_hold_is_not_sent(recorder, place):
    """A count of the ring with a bit too many: old frames would go out again for as long as it takes to send 4 GB."""
    (waiting,) = [symbol.address for symbol in measure.symbols(recorder) if symbol.name == "waiting"]
    machine = started(recorder, 32e3)
    flip(machine, waiting + place, 6)
    machine.run_until(2.5)
    assert 0.4 * RATE_HZ < samples(machine.usart1.take()) <= 0.5 * RATE_HZ + 1
    machine.run_until(3.7)
    assert samples(machine.usart1.take()) == pytest.approx(1.2 * RATE_HZ, rel=0.05)


def test_a_recording_goes_on_behind_a_reset(recorder):
    """The decoder of ``record`` takes it for what it is, and loses what was on its way."""
    machine, decoder = started(recorder, 32e3), StreamDecoder()
    for t_s in np.arange(2.1, 5.5, 0.1):
        machine.run_until(t_s)
        decoder.feed(machine.usart1.take())
        if abs(t_s - 2.5) < 0.01:
            hang(machine)
    assert decoder.resets == 1
    assert decoder.samples > 1.4 * RATE_HZ
    assert decoder.lost == 0
    assert decoder.garbage <= 100


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


def test_without_a_sensor_it_starts_in_time_too(recorder):
    machine = Machine(recorder, lsi_hz=47e3)
    machine.run_until(3.0)
    assert machine.resets == 0


def test_it_can_be_left_out(tmp_path):
    """For a debugger without DBG_IWDG_STOP."""
    if trouble := measure.tools_missing():
        pytest.skip(trouble)
    elf = measure.build("recorder.elf", tmp_path, tmp_path, ODR_HZ="104", WATCHDOG="0")
    machine = started(elf, 32e3)
    hang(machine)
    machine.run_until(6.0)
    assert (machine.resets, machine.iwdg.running) == (0, False)
