"""The firmware on the test kit's STM32F405 beside the model of its sensor, whose every sample is known; and the kit itself."""

import re
from functools import cache

import numpy as np
import pytest
from conftest import ROOT
from emulator import driven as kit
from emulator.build import build, tools_missing
from emulator.core import AIRCR, RESET_KEY, RESET_REQUEST, SYSTICK_CSR
from emulator.cpu import CCM, missing
from emulator.driven import NOMINAL_HZ, Driven
from emulator.machine import Machine
from emulator.sensor import CTRL1_XL, CTRL2_G, CTRL3_C, Asm330lhh, AtRest, Fault, SensorPort

from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import SENSOR
from session.bench.logwriter import LogWriter

if MISSING := tools_missing() or missing():
    pytest.skip(MISSING, allow_module_level=True)


pytestmark = pytest.mark.emulation


@pytest.fixture(scope="session")
def elf(tmp_path_factory):
    """The driver with the board's program around it."""
    return kit.built(tmp_path_factory.mktemp("driver"))


@pytest.fixture(scope="session")
def recorder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorder")
    return build("recorder.elf", folder, folder, ODR_HZ=str(RATE_HZ))


# The driver and the board around it.


NOMINAL_PPM = 51  #: between 6667 Hz and 40000/6 Hz: no source says which of them INTERNAL_FREQ_FINE is of


def running(elf, odr_hz, **how):
    """At a data rate; what came before does not count."""
    driven = Driven(elf, **how)
    driven.run(0.3)
    driven.ask(frames.DATA_RATE, odr_hz)
    driven.run(0.3)
    driven.forget()
    return driven


@cache
def streaming(elf):
    driven = running(elf, 6667.0)
    driven.run(0.5)
    return driven


def assert_clean(found):
    """Nothing is lost, and nothing is wrong."""
    assert (found.missing, found.skipped, found.doubled, found.falsified, found.unsettled) == (0, 0, 0, 0, 0)


def test_it_starts_in_order_and_streams_6667_hz_without_a_loss(elf):
    driven = streaming(elf)
    written = driven.sensor.written
    reset = written.index((CTRL3_C, 0x05))
    assert {(CTRL1_XL, 0x00), (CTRL2_G, 0x00)} <= set(written[:reset])  # both off, before the reset
    assert written[reset + 1][0] == CTRL3_C  # BDU and IF_INC, before anything that they protect
    found = driven.verdict()
    assert found.streamed > 3300
    assert_clean(found)
    assert driven.info.odr_hz == pytest.approx(found.true_hz, rel=1e-6 * NOMINAL_PPM)
    assert found.odr_hz == pytest.approx(found.true_hz, rel=10e-6)
    assert driven.machine.slept > 0.85 * driven.machine.clock.now()
    assert driven.objections == []
    assert set(driven.counts.values()) <= {0, driven.counts["lost"]}  # what setting it anew has cost


def test_a_fault_costs_what_it_must_and_is_counted(elf):
    kind = "reset"
    driven = running(elf, 1667.0, faults=[Fault(kind, 1.2, 0.02)])
    before = dict(driven.counts)
    driven.run(1.5)
    found = driven.verdict()
    risen = {name for name, count in driven.counts.items() if count > before[name]}
    assert {"reset"} < risen <= {"reset", "zeros", "starts", "lost"}
    assert (found.doubled, found.falsified, found.unsettled) == (0, 0, 0)
    assert 0 < found.missing <= 300


def test_a_sensor_that_answers_within_two_seconds_gets_no_stand_in(elf):
    driven = Driven(elf, faults=[Fault("late", 1.5)])
    driven.run(1.5)
    assert (driven.board, driven.bytes) == (None, 0)  # nothing is said before it is known who speaks
    driven.run(0.5)
    assert (driven.board.source, driven.board.runs) == (SENSOR, True)
    assert driven.made_up == 0
    found = driven.verdict()
    assert found.streamed > 100
    assert (found.doubled, found.falsified, found.unsettled) == (0, 0, 0)


def test_commands_wait_their_turn_and_none_is_lost(elf):
    """A self-test takes 1.3 s; what is asked for meanwhile is answered behind it, in its order."""
    driven = Driven(elf, motion=AtRest(), fine=0)
    driven.run(0.2)
    asked = [(frames.SELF_TEST,), (frames.DATA_RATE, 1667.0), (frames.RANGES, 250, 2), (frames.RANGES, 300, 2), (frames.IDENTIFY,)]
    for number, command in enumerate(asked, 1):
        driven.machine.usart1.feed(frames.encode_command(command[0], number, *command[1:]))
    driven.run(0.5)
    assert list(driven.answers.items()) == []
    driven.run(1.2)
    assert list(driven.answers.items()) == [(1, 0), (2, 0), (3, 0), (4, 2), (5, 0)]
    (result,) = driven.tested
    assert result.numbers[0] == 0
    assert list(result.numbers[1:4]) == pytest.approx([400.0] * 3, abs=0.1)
    assert (driven.board.odr_hz, driven.info.gyro_fs_dps, driven.info.accel_fs_g) == (1667.0, 250.0, 2.0)
    assert driven.counts["starts"] == 0
    assert driven.objections == []


def test_settling_is_said_and_takes_what_the_filters_need(elf):
    """The accelerometer's narrowest filter at 417 Hz: 597 slots, 1.43 s.  The answer does not wait for that."""
    driven = Driven(elf)
    driven.run(0.2)
    driven.ask(frames.FILTERS, 0xFF, 800, within_s=0.1)
    assert (driven.board.runs, driven.board.settles) == (True, True)
    driven.forget()
    driven.run(1.3)
    assert not driven.streamed
    driven.run(1.2)
    assert (driven.board.runs, driven.board.settles) == (True, False)
    found = driven.verdict()
    assert (found.doubled, found.falsified, found.unsettled) == (0, 0, 0)
    assert found.streamed == pytest.approx(417 * 1.0105 * 1.07, abs=60)


# The clock of the sensor's bus, and what is not built.


DIVIDERS = (16, 32, 64, 128, 256)


WORD_BITS, POLLS_HZ, BURSTS_HZ, PROOF_BYTES = 56, 1000, 300, 21


SHARE = 0.8  #: of the clock


def carried_bits(odr_hz):
    """Bits a second on the bus: words, looks at the level, addresses and registers behind a burst."""
    return 3 * WORD_BITS * odr_hz + 13 * WORD_BITS + 3 * 8 * POLLS_HZ + 8 * PROOF_BYTES * BURSTS_HZ


def least_mhz(odr_hz):
    """The clock that carries the quickest unit of a nominal rate."""
    return carried_bits(1.19 * odr_hz) / SHARE / 1e6


def test_the_table_of_the_boards_page_is_that_of_the_formula():
    page = (ROOT / "docs" / "boards.md").read_text()
    rows = re.findall(r"^\| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \| (\d+) \|$", page.split("## The sensor's bus")[1], re.M)
    assert [float(row[0]) for row in rows] == [hz for hz in NOMINAL_HZ if hz >= 833]
    for hz, kbit, least, divider in rows:
        assert float(kbit) == pytest.approx(carried_bits(float(hz)) / 1e3, abs=0.5)
        assert float(least) == pytest.approx(least_mhz(float(hz)), abs=0.005)
        assert int(divider) == max(d for d in DIVIDERS if 84 / d >= least_mhz(float(hz)))


# The watchdog.


RATE_HZ = 208


RUNS, SETTLES, BY_WATCHDOG, BY_FAULT = 0b11, 1 << 2, 1 << 3, 1 << 4  #: of the board's state; the first: it streams its sensor's samples


def bodies(stream):
    """The good frames of a stream, without their CRC."""
    decoded = (frames.decode_blocks(np.frombuffer(token, np.uint8)[None]) for token in stream.split(b"\0") if 6 <= len(token) < 254)
    return [body.tobytes() for body, good in decoded if good[0]]


def states(stream):
    """The board's own states."""
    return [body[4] for body in bodies(stream) if body[0] == 0x05]


def state(machine):
    """The one that it has said last, but for whether its filters settle."""
    return states(machine.usart1.take())[-1] & ~SETTLES


def samples(stream):
    return sum(body[0] == 0x01 for body in bodies(stream))


def stop_time(machine):
    """An upset of SysTick's register: nobody ever wakes."""
    machine.core.ticks.write(SYSTICK_CSR, 0)


def hang(machine):
    """The loop comes to a place that it never leaves, while interrupts go on."""
    machine.cpu.set_memory(CCM + 0x8000, b"\xfe\xe7")  # b .
    machine.cpu.set("PC", CCM + 0x8001)


def watched(elf, lsi_hz, seconds=2.0, **how):
    machine = Machine(elf, SensorPort(Asm330lhh(AtRest())), lsi_hz=lsi_hz, **how)
    machine.run_until(seconds)
    assert state(machine) == RUNS
    return machine


def test_a_board_that_hangs_is_reset_and_streams_again(recorder):
    """Within 32000 cycles of the low-speed oscillator; then it says so, and samples come."""
    lsi_hz = 32e3
    machine = watched(recorder, lsi_hz, 1.0)
    stop_time(machine)
    machine.run_until(1.0 + 32032 / lsi_hz)
    assert (machine.resets, machine.watchdog_resets) == (1, 1)
    machine.usart1.take()
    machine.run_until(machine.clock.now_s() + 1.5)
    stream = machine.usart1.take()
    assert states(stream)[-1] & ~SETTLES == RUNS | BY_WATCHDOG
    assert samples(stream) > 1.0 * RATE_HZ
    assert machine.watchdog_resets == 1


def test_a_core_that_runs_astray_is_reset_and_streams_again(recorder):
    """Its stack is no memory: neither has the handler of a fault one, and the core locks up."""
    machine = watched(recorder, 32e3, 1.0, hard_faults=True)
    machine.cpu.set("SP", 0x60000F00)
    machine.run_until(1.9)
    assert machine.resets == 0
    machine.run_until(3.0)
    assert (machine.resets, machine.watchdog_resets) == (1, 1)
    assert state(machine) == RUNS | BY_WATCHDOG
    machine.run_until(4.2)
    assert samples(machine.usart1.take()) == pytest.approx(1.2 * RATE_HZ, rel=0.05)
    assert machine.resets == 1


def test_a_board_names_the_cause_of_its_last_reset_alone(recorder):
    """A reset that somebody asks for, as a flasher does, is none of its own; neither is one behind a fault that was said before."""
    machine, said = watched(recorder, 32e3, 1.0, hard_faults=True), []

    def ask():
        machine.core.write(AIRCR, RESET_KEY | RESET_REQUEST)

    for n, upset in enumerate((lambda: machine.cpu.set("PC", 0x30000001), ask, lambda: hang(machine), ask)):
        upset()
        machine.run_until(1.0 + 1.7 * (n + 1))
        said.append(state(machine))
        assert machine.resets == n + 1
    assert said == [RUNS | BY_FAULT, RUNS, RUNS | BY_WATCHDOG, RUNS]


def test_a_board_that_works_is_never_reset(recorder):
    """The quickest oscillator, its least period 0.68 s: a start, three seconds, a command; a millisecond or two between reloads.  Then a
    debugger holds the core for 2 s."""
    machine = watched(recorder, 47e3, stalls=[(4.5, 2.0)])
    machine.iwdg.longest_s = 0.0
    machine.run_until(3.0)
    assert machine.iwdg.longest_s < 0.005
    machine.usart1.feed(frames.encode_command(frames.DATA_RATE, 1, 12.5))
    machine.run_until(4.0)
    assert machine.resets == 0
    assert machine.iwdg.longest_s < 0.1
    machine.run_until(7.5)
    assert machine.resets == 0
    assert state(machine) == RUNS
    assert machine.bus.objections == {}


# A board without a sensor.


ABSENT = Fault("hang", 0.0, 3.5)  # longer than the board looks for it


def logs_of(streams, folder):
    decoder, logs = StreamDecoder(), LogWriter(folder)
    for stream in streams:
        logs.write(decoder.feed(stream))
    logs.write(decoder.finish())
    logs.close()
    return [path.read_text() for path in logs.paths]


def assert_apart(texts):
    """Two logs: the stand-in's, whose gravity is 8197 upside down, and the sensor's; each says whose it is."""
    first, second = texts
    assert "source=stand-in" in first
    assert "source=sensor" not in first
    assert "source=sensor" in second
    assert "source=stand-in" not in second
    rows = [np.array([line.split(",") for line in text.splitlines() if line[0].isdigit()], int) for text in texts]
    assert min(map(len, rows)) > 200
    assert np.abs(rows[0][:, 6] + 8197).max() <= 8
    assert np.all(rows[1][:, 6] == 8197)


def test_a_sensor_that_comes_late_begins_a_log_of_its_own(recorder, tmp_path):
    """Until then all is made up.  It is found by the next command that sets something, within one count of samples and of microseconds."""
    machine = Machine(recorder, SensorPort(Asm330lhh(AtRest(), faults=(ABSENT,))))
    machine.run_until(4.0)
    made_up = machine.usart1.take()
    machine.usart1.feed(frames.encode_command(frames.RANGES, 1, 500, 4))
    machine.run_until(6.0)
    assert machine.bus.objections == {}
    assert_apart(logs_of([made_up, machine.usart1.take()], tmp_path))
