"""The verdict of ``benchmarks/emulated_driver.py`` on a stream whose faults are planted: it must find each."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from asm330lhh_wire import Wire
from conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
from emulated_driver import STAMP_US, judged, numbered

from session.bench import frames
from tinygc.annexes.emulated.readings import Fault, Oscillator, Silicon
from tinygc.annexes.emulated.sensor import Asm330lhh

SILICON, OSCILLATOR = Silicon(settling=0.0), Oscillator()
CLOCK_HZ = OSCILLATOR.clock_hz(SILICON.ticks_per_period)
COUNT, STEP = 3000, 8  # at 833 Hz


def made(faults=()) -> list:
    sensor = Asm330lhh(numbered(CLOCK_HZ), OSCILLATOR, faults, keep=True, silicon=SILICON)
    link = Wire(sensor)
    for begin_s in (0.02, 2.02) if faults else (0.02,):
        link.t_s = begin_s
        for address, value in ((0x12, 0x44), (0x10, 0x78), (0x11, 0x74)):
            link.write(address, value)
    sensor.advance(0.02 + (COUNT + 0.5) * STEP / CLOCK_HZ)
    return sensor.kept


@pytest.fixture(scope="module")
def kept() -> list:
    return made()


def true_stream(kept: list) -> np.ndarray:
    """All of it, as a driver without a fault streams it."""
    registers = np.frombuffer(b"".join(row.registers for row in kept), "<i2").reshape(-1, 7)
    stream = np.zeros(len(kept), frames.SAMPLE)
    stream["sequence"] = np.arange(len(kept))
    stream["t_us"] = np.rint([1e6 * row.t_s for row in kept]) + 12_345
    stream["registers"][:, :6] = registers[:, 1:]
    of_word = np.arange(1, len(kept) + 1) // (512 // STEP) * (512 // STEP)  # the temperature comes at 13 Hz
    stream["registers"][:, 6] = registers[(of_word - 1).clip(0), 0]
    return stream


def found(stream: np.ndarray, kept: list):
    return judged(stream, kept, kept[-1].t_s, CLOCK_HZ, SILICON, OSCILLATOR)


def faults_of(verdict) -> tuple[int, int, int, int, int]:
    return verdict.missing, verdict.said_lost, verdict.doubled, verdict.falsified, verdict.unsettled


def test_a_true_stream_is_clean(kept):
    verdict = found(true_stream(kept), kept)
    assert len(kept) == verdict.made == verdict.streamed == pytest.approx(COUNT, abs=1)
    assert faults_of(verdict) == (0, 0, 0, 0, 0)
    assert verdict.off_us <= 1
    assert verdict.restart_off_us == 0
    assert verdict.odr_hz == pytest.approx(CLOCK_HZ / STEP, rel=1e-6)


@pytest.mark.parametrize("jump_us", [-50_000, -100, 50, 1000, 10_000, 50_000])
def test_a_time_that_jumps_for_good_is_false_from_there_on(kept, jump_us):
    stream = true_stream(kept)
    stream["t_us"][2000:] += np.array(jump_us, np.int64).astype(np.uint32)
    assert faults_of(found(stream, kept)) == (0, 0, 0, len(kept) - 2000, 0)


@pytest.mark.parametrize("off_us", [-30_000, -40, 40, 500, 30_000])
def test_a_single_time_that_is_off_is_false(kept, off_us):
    stream = true_stream(kept)
    stream["t_us"][1500] += np.array(off_us, np.int64).astype(np.uint32)
    assert faults_of(found(stream, kept)) == (0, 0, 0, 1, 0)
    assert found(stream, kept).off_us == pytest.approx(abs(off_us), abs=1)


def test_a_time_within_the_stated_limit_is_not(kept):
    stream = true_stream(kept)
    stream["t_us"][::2] += int(STAMP_US) - 2
    assert found(stream, kept).falsified == 0


def test_a_run_that_a_restart_began_may_be_off_and_its_jump_is_said():
    kept = made([Fault("reset", 2.0)])
    stream = true_stream(kept)
    second = np.flatnonzero(np.diff([row.grid for row in kept]))[0] + 1
    assert 0 < second < len(kept) - 100
    stream["t_us"][second:] += 1500
    stream["registers"][second:, 6] = np.frombuffer(b"".join(row.registers for row in kept[second:]), "<i2")[::7]
    verdict = found(stream, kept)
    assert faults_of(verdict) == (0, 0, 0, 0, 0)
    assert verdict.restart_off_us == pytest.approx(1500, abs=1)
    stream["t_us"][second + 50 :] += 100
    assert found(stream, kept).falsified == 50


def test_a_temperature_that_is_stuck_is_false(kept):
    stream = true_stream(kept)
    stream["registers"][1000:, 6] = stream["registers"][1000, 6]
    assert found(stream, kept).falsified > len(kept) - 1000 - 2 * 512 // STEP


@pytest.mark.parametrize("steps", [-20, 1, 300])
def test_a_single_false_temperature_is_false(kept, steps):
    """One step above the newest, or 20, 0.2 s, below."""
    stream = true_stream(kept)
    stream["registers"][1471, 6] += steps  # the temperature's word came with this sample
    assert faults_of(found(stream, kept)) == (0, 0, 0, 1, 0)


def test_a_temperature_may_be_older_by_what_is_missing(kept):
    stream = true_stream(kept)
    word = 20 * 512 // STEP - 1
    stream["registers"][word : word + 64, 6] = stream["registers"][word - 1, 6]  # it was in a slot that is lost
    assert found(stream, kept).falsified > 50
    assert faults_of(found(np.delete(stream, word), kept)) == (1, 1, 0, 0, 0)


def test_a_sample_that_comes_twice_is_doubled(kept):
    stream = np.insert(true_stream(kept), 700, true_stream(kept)[699])
    stream["sequence"] = np.arange(len(stream))
    verdict = found(stream, kept)
    assert (verdict.missing, verdict.doubled, verdict.falsified) == (0, 1, 0)


def test_values_that_the_sensor_did_not_make_are_false(kept):
    stream = true_stream(kept)
    stream["registers"][700, 3] += 1
    verdict = found(stream, kept)
    assert (verdict.missing, verdict.falsified) == (1, 1)
