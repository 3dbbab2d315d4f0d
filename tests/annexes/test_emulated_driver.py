"""The driver's own ELF file on the emulated STM32F405 beside the register model: ``benchmarks/driver.py`` in small."""

from __future__ import annotations

import sys
from functools import cache

import pytest
from conftest import ROOT
from f405_programs import tools_missing

from session.bench import frames

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

sys.path.insert(0, str(ROOT / "benchmarks"))
import emulated_driver
import measure
from emulated_driver import Driven

pytestmark = pytest.mark.emulation

if MISSING := measure.tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

WRITTEN_FIRST = [(0x10, 0x00), (0x11, 0x00), (0x12, 0x05), (0x12, 0x44)]  # both sensors off, reset, then BDU and IF_INC


@pytest.fixture(scope="module")
def elf(tmp_path_factory):
    return emulated_driver.built(tmp_path_factory.mktemp("driver"))


@cache
def started(elf, odr_hz: float) -> Driven:
    driven = Driven(elf)
    driven.run(0.3)
    driven.ask(frames.DATA_RATE, odr_hz)
    driven.run(0.1)
    driven.forget()
    return driven


def test_it_starts_in_order_and_streams_6667_hz_without_a_loss(elf):
    driven = started(elf, 6667.0)
    assert driven.sensor.written[:4] == WRITTEN_FIRST
    assert driven.sensor.written[-1] == (0x0A, 0x66)
    load = driven.load(1.2)
    found = driven.verdict()
    assert found.streamed > 7500
    assert (found.missing, found.said_lost, found.falsified) == (0, 0, 0)
    assert driven.info.odr_hz == pytest.approx(found.true_hz, rel=1e-6)
    assert found.odr_hz == pytest.approx(found.true_hz, rel=10e-6)
    assert load < 0.15
    assert driven.objections == []
    assert set(driven.counts.values()) <= {0, driven.counts["lost"]}  # what setting it anew has cost
