"""Readings that wait for their reader: their ages injected and recovered, none claimed where there is none."""

import numpy as np
import pytest
from array_twins import Body, Unit, any_unit, array_of
from turn_differences import turn_differences

from session.annexes.arrays.recording import ArraySession
from session.io.units import NS
from tinygc.annexes.arrays.extrinsics import clock_fits
from tinygc.annexes.arrays.latency import SampleAges, ages_of, corrected, sawtooth

READER_HZ = 62.5


@pytest.fixture(scope="module")
def body() -> Body:
    """Turns, then shaking: so that the phase has to be carried from turn to turn."""
    return Body(turns=8, seed=4, still_s=2.0, shaken_s=12.0)


def aged(body: Body, beats: dict[int, float], seed: int = 0, count: int = 4) -> tuple[ArraySession, list[Unit]]:
    """An array whose units of these numbers sample at 1 kHz and a beat more or less."""
    units = []
    for number in range(count):
        ages = {"beat_hz": beats[number], "phase": 0.3 * number, "period_s": 1e-3} if number in beats else {}
        units.append(any_unit(10 * seed + number, noise_dps=0.06, **ages))
    return array_of(body, units, READER_HZ, seed), units


@pytest.fixture(scope="module")
def found(body) -> tuple[ArraySession, list[Unit], tuple[SampleAges, ...]]:
    array, units = aged(body, {0: -2.4, 1: 0.8, 3: 1.9})
    return array, units, ages_of(array, clock_fits(array))


@pytest.mark.broad
def test_a_sawtooth_is_recovered_and_a_unit_without_one_has_none(found):
    _, units, ages = found
    assert [each.found for each in ages] == [True, True, False, True]
    for each, unit in zip(ages, units, strict=True):
        if each.found:
            assert each.beat_hz == pytest.approx(unit.beat_hz, abs=max(4 * each.beat_sigma_hz, 0.004))
            assert each.period_s == pytest.approx(1e-3, abs=max(4 * each.period_sigma_s, 5e-5))
            assert each.p_value < 1e-6


@pytest.mark.broad
def test_the_ages_are_those_of_the_truth_but_for_one_constant_of_all(found):
    array, units, ages = found
    for each, unit, session in zip(ages, units, array.units, strict=True):
        if not each.found:
            continue
        t_s = session.logs[0].samples.t_ns * NS
        miss = each.age_s(t_s) - unit.age_s(t_s)
        near_jump = np.abs(miss) > 0.5e-3  # a jump that is a reading early or late
        assert np.mean(near_jump) < 0.03
        assert np.std(miss[~near_jump]) < 0.06e-3


def test_stamps_less_their_ages_bring_the_units_together(found):
    array, _, ages = found
    fits = clock_fits(array)
    before, after = turn_differences(array, fits), turn_differences(array, fits, ages)
    assert len(before.log) == 8
    assert after.rms_rad.mean() < 0.75 * before.rms_rad.mean()
    assert after.rms_rad.mean() < 1.4 * np.sqrt(np.mean(after.white**2))
    moved = corrected(array, ages).units[0].logs[0].samples.t_ns - array.units[0].logs[0].samples.t_ns
    assert -1_000_000 <= moved.min() < -900_000
    assert moved.max() <= 0


def test_two_units_do_not_tell_whose_age_it_is(body):
    array, _ = aged(body, {0: 1.7}, count=2)
    assert not any(each.found for each in ages_of(array, clock_fits(array)))


def test_an_expected_sawtooth_is_exact_far_from_its_jump_and_half_where_nothing_is_known():
    cycles = np.array([-0.75, 0.25, 7.5, 0.999, 1.001])
    assert sawtooth(cycles, np.full(5, 1e-4)) == pytest.approx([0.25, 0.25, 0.5, 0.999, 0.001], abs=1e-3)
    assert sawtooth(np.array([3.0]), np.array([0.01])) == pytest.approx(0.5, abs=0.01)
    assert sawtooth(np.array([0.2, 0.9]), np.full(2, 0.6)) == pytest.approx(0.5, abs=0.05)
