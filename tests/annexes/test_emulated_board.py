"""The emulated board at the end of a cable, and the session that its sensor feels."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading

import numpy as np
import pytest
from conftest import ROOT
from exported_models import MODELS
from f405_programs import compiled, tools_missing
from processes import CALIBRATE, PIPE, calibrate, started, until

from session.bench.events import Info
from session.bench.recorder import Recorder
from tinygc.annexes.emulated.board import Replayed, oscillator_of
from tinygc.annexes.emulated.readings import CLOCK_HZ, AtRest, Fault
from tinygc.annexes.emulated.sensor import Asm330lhh
from tinygc.deploy.embedded.program import Registers, program
from tinygc.deploy.embedded.source import source_files
from tinygc.simulation.terminal import Terminal
from tinygc.simulation.virtual_board import BoardSource

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

sys.path.insert(0, str(ROOT / "firmware"))
import measure

from tinygc.annexes.emulated.board import EmulatedBoard

pytestmark = pytest.mark.emulation


def source(rows: np.ndarray, odr_hz: float) -> BoardSource:
    return BoardSource(rows, Info(500.0, 4.0, odr_hz, "1", "ASM330LHH"))


@pytest.mark.parametrize("odr_hz", [104.0, 416.7, 1667.0, 1702.3, 6400.0])
def test_the_oscillator_of_a_unit_has_its_data_rate(odr_hz):
    oscillator = oscillator_of(odr_hz)
    coefficient = round(CLOCK_HZ / odr_hz)
    assert oscillator.clock_hz() / 2 ** round(np.log2(coefficient)) == pytest.approx(odr_hz, rel=1e-12)
    assert abs(oscillator.residual_ppm) < 800


def test_another_rate_reads_what_lies_between():
    """Half a turn of a sine at 100 Hz, read at 833 Hz: on the lines between its samples."""
    rows = np.zeros((100, 7), np.int16)
    rows[:, 0] = np.rint(20000 * np.sin(np.pi * np.arange(100) / 99))
    motion = Replayed(source(rows, 100.0))
    motion(np.array([0.0]))
    motion.start(1.0)
    t_s = 1.0 + np.arange(0, 0.99, 1 / 833)
    rate, _, _ = motion(t_s)
    expected = np.interp((t_s - 1.0) * 100, np.arange(100), rows[:, 0]) * np.radians(0.0175)
    np.testing.assert_allclose(rate[:, 0], expected, atol=1e-3 * np.radians(20000 * 0.0175))


def test_the_firmware_is_recorded_through_a_pseudo_terminal(tmp_path):
    """The repository's own: its stand-in streams at its pace, and the recorder loses nothing."""
    if trouble := measure.tools_missing():
        pytest.skip(trouble)
    for file, text in source_files(program(MODELS["linear"]), Registers(), "A test.", {}).items():
        (tmp_path / file).write_text(text)
    elf = measure.build("tinygc.elf", tmp_path, tmp_path / "build", SERIAL="12")
    with Terminal(tmp_path / "port", 10**8) as terminal:
        board = EmulatedBoard(elf, Asm330lhh(AtRest()), terminal, speed=None, lead_s=0.0, tail_s=3.0)
        thread = threading.Thread(target=board.run, daemon=True)
        thread.start()
        recorder = Recorder(tmp_path / "session", str(tmp_path / "port"))
        until(lambda: recorder.decoder.samples >= 400, recorder.poll, "400 samples")
        recorder.close()
        thread.join(60)
    assert not thread.is_alive()
    assert (recorder.decoder.lost, recorder.decoder.resets) == (0, 0)
    assert recorder.decoder.info.serial == "12"
    assert board.machine.bus.objections == {}


def test_what_the_host_sends_arrives(tmp_path):
    """Through the cable and back, byte by byte."""

    class Cable:
        waiting = 0
        has_reader = True
        sent, heard = bytearray(), [b"abc", b"", bytes(range(250))]

        def write(self, data):
            self.sent += data
            return True

        def read(self):
            return self.heard.pop(0) if self.heard else b""

    text = """
    void USART1_Handler(void) { if (USART1(0) & 0x20) USART1(4) = USART1(4); }
    int main(void) { usart_on(); USART1(0x0C) |= 0x20; irq(37); for (;;) WFI(); }"""
    board = EmulatedBoard(compiled(text, tmp_path), Asm330lhh(AtRest()), Cable(), speed=None, lead_s=0.0, tail_s=0.05)
    board.run()
    assert bytes(Cable.sent) == b"abc" + bytes(range(250))


def test_time_passes_as_the_clock_says(tmp_path):
    """Paced: as many slices as the clock allows; what cannot be made up for is given up and counted."""

    class Host:
        def __init__(self, slow_s):
            self.t_s, self.slow_s, self.slept_s = 0.0, slow_s, 0.0

        def now_s(self):
            self.t_s += self.slow_s
            return self.t_s

        def sleep(self, seconds):
            self.t_s += seconds
            self.slept_s += seconds

    class Cable:
        waiting = 0
        has_reader = True
        write = read = staticmethod(lambda *data: b"")

    elf = compiled("int main(void) { return 0; }", tmp_path)
    for slow_s, late in ((0.001, False), (0.05, True)):
        host = Host(slow_s)
        board = EmulatedBoard(elf, Asm330lhh(AtRest()), Cable(), lead_s=0.0, tail_s=1.0, clock=host)
        board.run()
        assert (board.late_s > 0) == late
        assert (host.slept_s > 0) != late
        if not late:
            assert host.t_s == pytest.approx(1.0, abs=0.02)


def test_at_its_own_pace_it_waits_for_its_reader(tmp_path):
    """A reader that takes its time loses nothing: the board's time stands still meanwhile."""

    class Slow:
        has_reader, waiting, waited = True, 0, 0

        def write(self, data):
            self.waiting = max(0, self.waiting + len(data) - 3)
            self.waited += not data
            return True

        def read(self):
            return b""

    text = """
    int main(void) { usart_on(); for (int n = 0; n < 500; n++) { while (!(USART1(0) & 0x80)) ; USART1(4) = 'a'; } for (;;) WFI(); }"""
    cable = Slow()
    board = EmulatedBoard(compiled(text, tmp_path), Asm330lhh(AtRest()), cable, speed=None, lead_s=0.0, tail_s=0.02)
    board.run()
    assert cable.waiting == 0
    assert cable.waited > 100
    assert board.late_s == 0


# The command


@pytest.fixture(scope="module")
def firmware(tmp_path_factory):
    """One that sends a line each second and echoes what it hears."""
    text = """
    static void say(const char *text) { for (; *text; text++) { while (!(USART1(0) & 0x80)) ; USART1(4) = (uint8_t)*text; } }
    int main(void)
    {
        spi_on();
        usart_on();
        systick(168000);
        for (uint32_t second = 0;; second++) {
            while (milliseconds < 100 * second) WFI();
            say(read_register(0x0F) == 0x6B ? "a sensor\\r\\n" : "none\\r\\n");
        }
    }"""
    return compiled(text, tmp_path_factory.mktemp("firmware"))


def test_the_command_runs_a_program_until_its_tail_is_over(firmware, tmp_path):
    where = ["--firmware", firmware, "--link", tmp_path / "port", "--json", tmp_path / "told.json", "--faults", "identity@3"]
    how = ["--segments", 1, "--rate", 104, "--speed", 1000, "--lead", 0.5, "--tail", 0.1]
    with started([*CALIBRATE, "board", *where, *how], stderr=PIPE, stdout=PIPE, text=True) as board:
        assert board.stdout.readline() == f"{tmp_path / 'port'}\n"
        port = os.open(tmp_path / "port", os.O_RDONLY | os.O_NOCTTY)
        heard = bytearray()
        with contextlib.suppress(OSError):  # the cable is gone at the end
            while part := os.read(port, 4096):
                heard += part
        os.close(port)
        _, said = board.communicate()
    assert board.returncode == 0, said
    assert {b"a sensor", b"none"} <= set(bytes(heard).split(b"\r\n"))
    assert "0 samples made, 0 words overrun" in said
    assert json.loads((tmp_path / "told.json").read_text())["starts"] == 1


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--frames"], "leave --frames out"),
        (["--faults", "lost=0.1"], "no fault; expected KIND@S"),
        (["--faults", "fire@3"], "no fault 'fire'"),
        ([], "no program for ARM"),
        (["--sensor", "BMI270"], "with --firmware there are ASM330LHH and LSM6DSO"),
    ],
)
def test_what_cannot_be_run_is_one_line(more, said, tmp_path):
    (tmp_path / "x.elf").write_bytes(bytes(100))
    done = calibrate("board", "--firmware", tmp_path / "x.elf", "--segments", 1, "--rate", 104, "--link", tmp_path / "port", *more)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_faults_are_said_in_a_word():
    assert Fault.parse("hang@20+0.5") == Fault("hang", 20.0, 0.5)
    assert Fault.parse(" parity@10x3") == Fault("parity", 10.0, words=3)
