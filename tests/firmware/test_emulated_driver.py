"""The driver's own ELF file on the test kit's STM32F405 beside the model of its sensor: every sample is known."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from f405_programs import tools_missing

from session.bench import frames

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

from emulator import driven as kit
from emulator.driven import Driven, Verdict, judged
from emulator.sensor import CTRL1_XL, CTRL2_G, CTRL3_C, Fault

pytestmark = pytest.mark.emulation

NOMINAL_PPM = 51  #: between 6667 Hz and 40000/6 Hz: no source says which of them INTERNAL_FREQ_FINE is of


@pytest.fixture(scope="module")
def elf(tmp_path_factory):
    return kit.built(tmp_path_factory.mktemp("driver"))


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
    driven = running(elf, 6667.0)
    driven.run(1.2)
    return driven


def assert_clean(found: Verdict) -> None:
    """Nothing is lost, and nothing is wrong."""
    assert (found.missing, found.said_lost, found.doubled, found.falsified, found.unsettled) == (0, 0, 0, 0, 0)


def test_it_starts_in_order_and_streams_6667_hz_without_a_loss(elf):
    driven = started(elf)
    written = driven.sensor.written
    reset = written.index((CTRL3_C, 0x05))
    assert {(CTRL1_XL, 0x00), (CTRL2_G, 0x00)} <= set(written[:reset])  # both off, before the reset
    assert written[reset + 1][0] == CTRL3_C  # BDU and IF_INC, before anything that they protect
    found = driven.verdict()
    assert found.streamed > 7500
    assert_clean(found)
    assert driven.info.odr_hz == pytest.approx(found.true_hz, rel=1e-6 * NOMINAL_PPM)
    assert found.odr_hz == pytest.approx(found.true_hz, rel=10e-6)
    assert driven.machine.slept > 0.85 * driven.machine.clock.now()
    assert driven.objections == []
    assert set(driven.counts.values()) <= {0, driven.counts["lost"]}  # what setting it anew has cost


def test_the_verdict_finds_what_is_planted(elf):
    """A value, a time, a time for good, a sample twice, one that is gone."""
    driven = started(elf)
    bodies, _ = frames.decode_blocks(np.frombuffer(b"".join(driven._frames), np.uint8).reshape(driven.streamed, -1))
    true = np.ascontiguousarray(bodies).view(frames.SAMPLE).ravel()
    verdict = lambda stream: judged(stream, driven.sensor.kept, 0.0, driven.clock_hz, driven.silicon)  # noqa: E731
    assert_clean(verdict(true))
    for change, off in ((40, 1), (-1000, 1), (40, 2000)):
        stream = true.copy()
        stream["t_us"][len(true) - 2500 :][:off] += np.array(change, np.int64).astype(np.uint32)
        assert verdict(stream).falsified == off
    stream = true.copy()
    stream["registers"][700, 3] += 1
    assert (verdict(stream).falsified, verdict(stream).missing) == (1, 1)
    assert verdict(np.insert(true, 700, true[699])).doubled == 1
    assert (verdict(np.delete(true, 700)).missing, verdict(np.delete(true, 700)).said_lost) == (1, 1)


@pytest.mark.parametrize("kind", ["zeros", "ones", "hang", "identity", "reset", "parity", "tag_unknown", "missing"])
def test_a_fault_costs_what_it_must_and_is_counted(elf, kind):
    driven = running(elf, 1667.0, faults=[Fault(kind, 1.2, 0.02)])
    before = dict(driven.counts)
    driven.run(2.0)
    found = driven.verdict()
    risen = {name for name, count in driven.counts.items() if count > before[name]}
    names = {"hang": {"ones", "lost"}, "tag_unknown": {"tag", "lost"}, "missing": {"incomplete", "lost"}}
    names |= {"reset": {"reset", "zeros", "starts", "lost"}, "parity": {"parity", "incomplete", "lost"}}
    assert risen <= names.get(kind, {kind, "lost"})
    assert risen - {"lost"}
    assert (found.doubled, found.falsified, found.unsettled) == (0, 0, 0)
    assert found.missing == found.said_lost or kind == "reset"  # whose sensor made none meanwhile
    assert found.missing <= {"parity": 1, "tag_unknown": 18, "missing": 1, "reset": 300, "identity": 80}.get(kind, 40)
