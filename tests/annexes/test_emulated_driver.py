"""The driver's own ELF file on the emulated STM32F405 beside the register model: ``benchmarks/driver.py`` in small."""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
import pytest
from conftest import ROOT
from f405_programs import tools_missing

from session.bench import frames
from tinygc.annexes.emulated.readings import Fault

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

sys.path.insert(0, str(ROOT / "benchmarks"))
import emulated_driver
import measure
from emulated_driver import NOMINAL_HZ, Driven

pytestmark = pytest.mark.emulation

if MISSING := measure.tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

WRITTEN_FIRST = [(0x10, 0x00), (0x11, 0x00), (0x12, 0x05), (0x12, 0x44)]  # both sensors off, reset, then BDU and IF_INC


#: bytes on the wire, with CRC, COBS and delimiter: a frame for each sample, and three frames once a second
SAMPLE_WIRE_BYTES, EACH_SECOND_BYTES = 25, 19 + 32 + 71
#: start bit, eight, stop bit
BITS_A_BYTE = 10
BAUDS = (115_200, 230_400, 460_800, 921_600, 2_000_000)
#: INTERNAL_FREQ_FINE reaches 127 steps of 0.15 %
HIGHEST_FACTOR = 1 + 127 * 0.0015


def bits_per_second(true_odr_hz: float) -> float:
    """Of a stream without faults."""
    return BITS_A_BYTE * (SAMPLE_WIRE_BYTES * true_odr_hz + EACH_SECOND_BYTES)


def share(nominal_odr_hz: float, baud: int) -> float | None:
    """The part of a port that a stream takes; None where the board refuses the quickest unit of that nominal rate."""
    return None if frames.least_baud(HIGHEST_FACTOR * nominal_odr_hz) > baud else bits_per_second(nominal_odr_hz) / baud


def table_of_ports() -> str:
    """The table of docs/firmware.md."""
    lines = ["| data rate, Hz | kbit/s | at most | " + " | ".join(map(str, BAUDS)) + " |", "| ---: " * (3 + len(BAUDS)) + "|"]
    for rate_hz in NOMINAL_HZ:
        bits, most = bits_per_second(rate_hz), bits_per_second(HIGHEST_FACTOR * rate_hz)
        cells = ["–" if (part := share(rate_hz, baud)) is None else f"{100 * part:.1f} %" for baud in BAUDS]
        lines.append(f"| {rate_hz:g} | {bits / 1000:.1f} | {most / 1000:.1f} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


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


def test_what_is_sent_is_what_the_table_of_ports_counts_on(elf):
    driven = started(elf, 6667.0)
    before, seconds = driven.bytes, 1.0
    driven.run(seconds)
    bits = BITS_A_BYTE * (driven.bytes - before) / seconds
    assert bits == pytest.approx(bits_per_second(driven.info.odr_hz), rel=0.004)  # a burst more or less
    text = (ROOT / "docs" / "firmware.md").read_text()
    assert table_of_ports() in text


def test_a_port_that_carries_a_rate_carries_its_quickest_unit():
    for baud in BAUDS:
        rates = [hz for hz in NOMINAL_HZ if share(hz, baud) is not None]
        assert bits_per_second(rates[-1] * HIGHEST_FACTOR) < baud
        assert frames.least_baud(rates[-1]) < baud
    assert share(6667.0, 921_600) is None
    assert share(6667.0, 2_000_000) == pytest.approx(0.834, abs=0.001)


@pytest.mark.slow
def test_faults_cost_what_they_must_and_falsify_nothing(elf):
    """One after the other within two seconds, at 1667 Hz; at the end a sensor that resets itself."""
    kinds = [("parity", {}), ("tag_count", {}), ("tag_unknown", {}), ("missing", {}), ("swapped", {})]
    faults = [Fault(kind, 1.2 + 0.1003 * n, **how) for n, (kind, how) in enumerate(kinds)]
    faults += [Fault("ones", 1.75, 0.02), Fault("zeros", 1.85, 0.02), Fault("hang", 1.95, 0.02), Fault("ones", 2.052, 1e-4)]
    faults.append(Fault("reset", 2.2))
    driven = Driven(elf, faults=faults)
    driven.run(0.3)
    driven.ask(frames.DATA_RATE, 1667.0)
    driven.run(1.1 - driven.t_s)
    driven.forget()
    before = driven.counts["lost"]
    driven.run(2.18 - driven.t_s)
    found = driven.verdict()
    assert found.falsified == 0
    assert found.said_lost == found.missing <= 4 * 2 + 4 * 17  # a slot or two for a word; a burst where the bus fails amid one
    assert found.restart_off_us == 0.0  # it was never started again
    driven.run(0.5)
    found = driven.verdict()
    assert found.falsified == 0
    assert found.restart_off_us < 1e6 / 1667  # of the board's clock, to a period
    counts = driven.counts
    assert counts["starts"] == counts["reset"] == 1
    assert (counts["parity"], counts["tag"] >= 1, counts["order"], counts["silent"]) == (1, True, 2, 0)
    assert counts["ones"] + counts["zeros"] >= 3
    assert 150 < counts["lost"] - before < 350
    assert np.isfinite(found.off_us)
    assert found.off_us < emulated_driver.STAMP_US
