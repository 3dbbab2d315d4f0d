"""The board's program around the driver, on the test kit's STM32F405: what it says and does while the sensor is late, settles or fails."""

from __future__ import annotations

import re

import pytest
from conftest import ROOT
from f405_programs import tools_missing

from session.bench import frames
from session.bench.events import SENSOR, STANDIN

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

from emulator import driven as kit
from emulator.driven import Driven
from emulator.sensor import ASM330LHH, LSM6DSO, AtRest, Fault, Silicon

pytestmark = pytest.mark.emulation

LOOKS_S = 2.0  #: so long the board looks for its sensor
# FREQ_FINE is 0 where it lies still: with 7 an output at 52 Hz comes each 19.0005 ms, and may meet the look of each ms time and again.


@pytest.fixture(scope="module")
def elf(tmp_path_factory):
    return kit.built(tmp_path_factory.mktemp("driver"))


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


def test_one_that_answers_later_is_found_by_a_command(elf):
    """It is not looked for all the time: one that is plugged in then is fed through its data lines."""
    driven = Driven(elf, faults=[Fault("late", LOOKS_S + 0.5)])
    driven.run(LOOKS_S + 2.0)
    assert driven.board.source == STANDIN
    assert driven.made_up > 500
    assert driven.counts["zeros"] == 1  # once, however often it was looked for
    driven.ask(frames.DATA_RATE, 833.0)
    driven.run(0.5)
    assert driven.board.source == SENSOR
    assert driven.verdict().streamed > 200


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
    assert result.failed == 0
    assert list(result.gyro_dps) == pytest.approx([400.0] * 3, abs=0.1)
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


def test_a_model_whose_range_the_chip_has_not_begins_with_another(tmp_path):
    """An option of make, or a model's own; the info frame says what it is.  Where the chip has it, it may come late."""
    elf = kit.built(tmp_path, GYRO_FS_DPS="4000")
    for chip, dps in ((ASM330LHH, 4000.0), (LSM6DSO, 500.0)):
        for late_s in (0.01, 0.5):
            driven = Driven(elf, silicon=Silicon(chip=chip), faults=[Fault("late", late_s)])
            driven.run(0.3 + late_s)
            assert (driven.board.source, driven.board.runs, driven.info.gyro_fs_dps) == (SENSOR, True, dps)


@pytest.mark.parametrize("row", [2, 5])
def test_the_port_carries_what_the_page_says(elf, row):
    """In kbit/s, at the nominal rate: samples, and the frames that come once a second."""
    page = (ROOT / "docs" / "firmware.md").read_text(encoding="utf-8")
    section = page.split("### What the port must carry")[1].split("\n### ")[0]
    nominal_hz, stated = (float(cell) for cell in re.findall(r"^\| ([\d.]+) \| ([\d.]+) \|", section, re.M)[row])
    driven = Driven(elf)
    driven.run(0.2)
    driven.ask(frames.DATA_RATE, nominal_hz)
    driven.run(1.0)
    driven.forget()
    before = driven.bytes
    driven.run(4.0)
    samples = driven.streamed
    assert samples > 4 * nominal_hz
    other = (driven.bytes - before) - frames.SAMPLE_BYTES * samples
    assert 10 * (frames.SAMPLE_BYTES * nominal_hz + other / 4) / 1e3 == pytest.approx(stated, abs=0.06)
