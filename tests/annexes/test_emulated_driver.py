"""The driver's own ELF file on the emulated STM32F405 beside the register model: ``benchmarks/driver.py`` in small."""

from __future__ import annotations

import sys
from functools import cache

import pytest
from conftest import ROOT
from f405_programs import tools_missing

from session.bench import frames
from tinygc.annexes.emulated.readings import (
    ACCEL,
    CHIPS,
    CTRL1_XL,
    CTRL2_G,
    CTRL3_C,
    FIFO_CTRL3,
    GYRO,
    JITTERS,
    TEMPERATURE,
    TIMESTAMP,
    Fault,
    Silicon,
)

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

sys.path.insert(0, str(ROOT / "benchmarks"))
import emulated_driver
import measure
from emulated_driver import Driven, Verdict

pytestmark = pytest.mark.emulation

if MISSING := measure.tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

NOMINAL_PPM = 51  #: between 6667 Hz and 40000/6 Hz: no source says which of them INTERNAL_FREQ_FINE is of


@pytest.fixture(scope="module")
def elf(tmp_path_factory):
    return emulated_driver.built(tmp_path_factory.mktemp("driver"))


def running(elf, odr_hz: float, **how) -> Driven:
    """At a data rate; what came before does not count."""
    driven = Driven(elf, **how)
    driven.run(0.3)
    driven.ask(frames.DATA_RATE, odr_hz)
    driven.run(0.3)
    driven.forget()
    return driven


@cache
def started(elf) -> Driven:
    return running(elf, 6667.0)


def assert_clean(found: Verdict) -> None:
    """Nothing is lost, and nothing is wrong."""
    assert (found.missing, found.said_lost, found.doubled, found.falsified, found.unsettled) == (0, 0, 0, 0, 0)


def assert_said(found: Verdict) -> None:
    """What is lost is said, to the sample, and nothing is wrong."""
    assert found.missing == found.said_lost
    assert (found.doubled, found.falsified, found.unsettled) == (0, 0, 0)


def test_it_starts_in_order_and_streams_6667_hz_without_a_loss(elf):
    driven = started(elf)
    written = driven.sensor.written
    reset = written.index((CTRL3_C, 0x05))
    assert {(CTRL1_XL, 0x00), (CTRL2_G, 0x00)} <= set(written[:reset])  # both off, before the reset
    assert written[reset + 1][0] == CTRL3_C  # BDU and IF_INC, before anything that they protect
    load = driven.load(1.2)
    found = driven.verdict()
    assert found.streamed > 7500
    assert_clean(found)
    assert driven.info.odr_hz == pytest.approx(found.true_hz, rel=1e-6 * NOMINAL_PPM)
    assert found.odr_hz == pytest.approx(found.true_hz, rel=10e-6)
    assert load < 0.15
    assert driven.objections == []
    assert set(driven.counts.values()) <= {0, driven.counts["lost"]}  # what setting it anew has cost


@pytest.mark.parametrize("odr_hz", [104.0, 6667.0])
@pytest.mark.parametrize("ticks", [1, 2])
def test_a_stamp_that_is_off_by_a_tick_or_two_costs_nothing(elf, odr_hz, ticks):
    driven = running(elf, odr_hz, silicon=Silicon(stamp_jitter_ticks=ticks))
    before = dict(driven.counts)
    driven.run(2.5)
    assert_clean(driven.verdict())
    assert driven.counts == before


@pytest.mark.parametrize("ticks", [40000 / 6667, 6.0, 6.0003])
def test_an_absence_costs_what_the_fifo_could_not_hold_and_no_restart(elf, ticks):
    """1.6 s at 6667 Hz are 10 800 samples, over which a period of 6 ticks and one of 5.9997 differ by three ticks."""
    driven = running(elf, 6667.0, faults=[Fault("hang", 1.2, 1.6)], silicon=Silicon(ticks))
    before = driven.counts["starts"]
    driven.run(3.2 - driven.t_s + 0.6)
    found = driven.verdict()
    assert_said(found)
    assert 10_500 < found.missing < 10_900
    assert driven.counts["starts"] == before


@pytest.mark.parametrize("capacity", [416, 438, 512])
def test_a_full_fifo_costs_what_it_could_not_hold(elf, capacity):
    driven = running(elf, 3333.0, silicon=Silicon(fifo_words=capacity), stalls=[(1.2, 0.1)])
    before = driven.counts["overrun"]
    driven.run(2.0)
    found = driven.verdict()
    assert_said(found)
    assert found.missing == pytest.approx(0.1 * 3368 - capacity / 3, abs=40)
    assert driven.counts["overrun"] == before + 1


@pytest.mark.parametrize(
    ("order", "slots"), [(Silicon.order, False), (Silicon.order, True), ((GYRO, ACCEL, TEMPERATURE, TIMESTAMP), False)]
)
def test_bursts_that_wait_amid_their_words_cost_what_the_fifo_lost(elf, order, slots):
    """The core is held with them.  A FIFO of 438 words holds 146 slots; a few more are lost with the burst, and when it is read anew."""
    driven = running(elf, 6667.0, silicon=Silicon(order=order, overrun_slots=slots), held=(40, 0.8))
    before = driven.counts["overrun"]
    driven.run(3.0)
    found = driven.verdict()
    assert_said(found)
    assert driven.port.holds > 8
    assert driven.counts["overrun"] - before >= driven.port.holds - 2
    assert found.missing == pytest.approx(found.true_hz * driven.port.held_s - 146 * driven.port.holds, rel=0.5)
    assert driven.objections == []


@pytest.mark.parametrize("kind", JITTERS[1:])
def test_a_tick_of_jitter_of_any_kind_costs_nothing(elf, kind):
    driven = running(elf, 6667.0, silicon=Silicon(stamp_jitter_ticks=1, jitter=kind))
    before = dict(driven.counts)
    driven.run(1.5)
    assert_clean(driven.verdict())
    assert driven.counts == before


def test_an_oscillator_that_drifts_costs_nothing(elf):
    driven = running(elf, 6667.0, drift_ppm_s=50.0)
    driven.run(1.5)
    assert_clean(driven.verdict())


@pytest.mark.parametrize(("odr_hz", "filters"), [(208.0, (7, 2)), (833.0, (7, 2)), (833.0, (0xFF, 200)), (6667.0, (4, 10))])
@pytest.mark.parametrize("covers_all", [False, True])
def test_no_sample_comes_before_the_filters_have_settled(elf, odr_hz, filters, covers_all):
    driven = running(elf, odr_hz, silicon=Silicon(mask_covers_all=covers_all))
    driven.ask(frames.FILTERS, *filters)
    driven.run(1.1)
    found = driven.verdict()
    assert (found.doubled, found.falsified, found.unsettled) == (0, 0, 0)
    assert found.streamed > 0.8 * odr_hz
    assert driven.objections == []


def test_a_sensor_that_settles_more_slowly_is_waited_for_by_its_mask(elf):
    driven = running(elf, 833.0, silicon=Silicon(settling=1.5))
    driven.ask(frames.FILTERS, 0xFF, 2)
    driven.run(1.0)
    assert driven.verdict().unsettled == 0


@pytest.mark.parametrize(
    "fault",
    [
        Fault("register", 1.2),
        Fault("register", 1.2, address=FIFO_CTRL3, mask=0x70),
        Fault("register", 1.2, address=FIFO_CTRL3, mask=0x07),
        Fault("register", 1.2, address=FIFO_CTRL3, mask=0x11),
        Fault("rate", 1.2, 1.0),
    ],
    ids=["stamps cease", "gyroscope ceases", "accelerometer ceases", "half the rate", "half the rate, registers as set"],
)
def test_a_fifo_that_fills_otherwise_than_set_is_noticed_and_set_anew(elf, fault):
    driven = running(elf, 833.0, faults=[fault])
    before = dict(driven.counts)
    driven.run(3.0)
    found = driven.verdict()
    assert (found.doubled, found.falsified, found.unsettled) == (0, 0, 0)
    risen = {name for name, count in driven.counts.items() if count > before[name]}
    assert risen & {"changed", "rate", "silent"}
    streamed = found.streamed
    driven.run(1.0)
    assert driven.verdict().streamed - streamed == pytest.approx(842, abs=10)


@pytest.mark.parametrize("late_s", [0.05, 0.3, 1.5])
def test_a_late_sensor_is_found_without_a_command(elf, late_s):
    driven = Driven(elf, faults=[Fault("late", late_s)])
    driven.run(late_s + 1.5)
    found = driven.verdict()
    assert_clean(found)
    assert found.streamed > 400
    assert driven.objections == []


@pytest.mark.parametrize("chip", CHIPS.values(), ids=CHIPS)
def test_each_chip_of_the_family_streams(elf, chip):
    driven = running(elf, 833.0, silicon=Silicon(chip=chip))
    driven.run(1.5)
    assert_clean(driven.verdict())
    assert driven.board.who_am_i == chip.identity
    assert driven.objections == []
