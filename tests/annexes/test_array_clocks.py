"""Clocks and mountings of an array's units: injected and recovered with their sigmas, and refused where there is no rigid body."""

from dataclasses import replace

import numpy as np
import pytest
from array_twins import DEG, Body, Unit, any_unit, array_of, samples_of
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from session.annexes.arrays.recording import ArraySession
from tinygc import CalibrationError
from tinygc.annexes.arrays.clocks import Rates, interpolated_variance, rates_of, rough_clock
from tinygc.annexes.arrays.extrinsics import TRIADS_RAD, clock_fits, fit_mounting, places_of

ABOUT_S = 14.5  #: half of the body's time


@pytest.fixture(scope="module")
def body() -> Body:
    return Body(turns=9, seed=1)


def read(body: Body, unit: Unit, seed: int, odr_hz: float = 100.0) -> Rates:
    return rates_of(samples_of(body, unit, odr_hz, seed), 2000.0)


def injected(unit: Unit, first: Unit, about_s: float) -> tuple[float, float]:
    """Offset and rate of a unit's clock against the first's, exactly: both are known against the body's."""
    rate = (1 + unit.rate) / (1 + first.rate) - 1
    moment = about_s + unit.offset_s + unit.rate * (about_s - ABOUT_S)  # of the body
    on_first = (moment - first.offset_s + first.rate * ABOUT_S) / (1 + first.rate)
    return on_first - about_s, rate


def test_variance_of_an_interpolated_reading_is_what_a_spline_through_noise_has():
    random = np.random.default_rng(3)
    spline = CubicSpline(np.arange(40_000.0), random.normal(size=40_000))
    for phase in (0.0, 0.25, 0.5, 0.9):
        variance, _ = interpolated_variance(np.array([phase]))
        assert variance[0] == pytest.approx(np.var(spline(np.arange(100.0, 39_900.0) + phase)), rel=0.03)


def test_the_rough_clock_needs_no_mounting(body):
    first, unit = any_unit(1), any_unit(2, offset_s=-2.5, rate=0.008)
    rough = rough_clock(read(body, first, 1), read(body, unit, 2))
    offset_s, rate = injected(unit, first, rough.about_s)
    assert rough.likeness > 0.97
    assert abs(rough.offset_s - offset_s) < 0.1
    assert abs(rough.rate - rate) < 0.005


@pytest.mark.parametrize("turned", ["not at all", "any"])
def test_a_mounting_is_recovered_within_its_covariance(body, turned):
    vectors = {"not at all": [0, 0, 0], "any": [60, -110, 35]}
    rotation = Rotation.from_rotvec(np.array(vectors[turned]) * DEG)
    pulls = []
    for seed in range(6):
        # A gyroscope that is misaligned by a degree, which the mounting must not take for its own.
        gyro = np.eye(3) + np.array([[0, 0.02, 0], [-0.02, 0, 0.01], [0, -0.01, 0]])
        unit = Unit(rotation.as_matrix(), gyro, offset_s=0.4)
        place = places_of(array_of(body, [Unit(), unit], seed=seed))[1]
        miss = (Rotation.from_matrix(place.mounting) * rotation.inv()).as_rotvec()
        assert np.abs(miss).max() < 0.2 * DEG
        pulls.append(miss @ np.linalg.solve(place.mounting_covariance, miss))
    assert 0.5 < np.mean(pulls) < 8.0  # chi-square of 3, six of them: 3 ± 1


def test_rates_tell_the_turn_about_the_vertical_where_gravity_stays():
    """With gravity along one axis in all stills, only the rates know the rest, and the covariance says so."""
    down = np.tile([0.0, 0.0, -1.0], (10, 1))
    found = fit_mounting(down, down, Rotation.from_rotvec([0.001, 0.002, 0.01]).as_matrix().T)
    sigma = np.sqrt(np.diag(found.covariance))
    assert sigma[2] == pytest.approx(TRIADS_RAD, rel=0.01)
    assert sigma[:2].max() < 0.5 * TRIADS_RAD
    assert Rotation.from_matrix(found.matrix).as_rotvec() == pytest.approx([0, 0, 0.01], abs=3e-4)


def test_a_unit_that_felt_another_motion_is_named(body):
    array = array_of(body, [any_unit(1), any_unit(2), any_unit(3)])
    other = array_of(Body(turns=9, seed=8), [any_unit(4)])
    with pytest.raises(
        CalibrationError, match=r"unit 2 did not feel the motion of the array's first unit: .* correlation of their speeds is 0\."
    ):
        clock_fits(replace(array, units=(*array.units[:2], other.units[0])))


def test_the_first_unit_is_named_where_it_is_the_odd_one(body):
    array = array_of(body, [any_unit(1), any_unit(2), any_unit(3)])
    other = array_of(Body(turns=9, seed=8), [any_unit(4)])
    with pytest.raises(CalibrationError, match=r"unit 0 did not feel the motion of the others"):
        clock_fits(replace(array, units=(other.units[0], *array.units[1:])))


def test_a_dead_unit_and_a_mirrored_one_are_named(body):
    dead = Unit(gyro=np.zeros((3, 3)), noise_dps=0.0)
    with pytest.raises(CalibrationError, match=r"unit 1 reads one and the same rate throughout: it is dead"):
        clock_fits(array_of(body, [Unit(), dead]))
    with pytest.raises(CalibrationError, match=r"unit 1 has mirrored axes"):
        clock_fits(array_of(body, [Unit(), Unit(gyro=np.diag([1.0, 1.0, -1.0]))]))


def test_the_first_unit_is_named_where_it_is_the_mirrored_one(body):
    array = array_of(body, [Unit(gyro=np.diag([1.0, -1.0, 1.0])), any_unit(2), any_unit(3)])
    with pytest.raises(CalibrationError, match=r"unit 0 has mirrored axes"):
        clock_fits(array)


def altered(array: ArraySession, number: int, change) -> ArraySession:
    """With other rates of one unit: change of (N, 3)."""
    unit = array.units[number]
    samples = unit.logs[0].samples
    log = replace(unit.logs[0], samples=replace(samples, gyro=change(np.array(samples.gyro))))
    return replace(array, units=tuple(replace(unit, logs=(log,)) if i == number else each for i, each in enumerate(array.units)))


@pytest.mark.parametrize("number", [0, 1])
def test_a_dead_axis_is_refused_in_a_line(body, number):
    def without_y(rate):
        rate[:, 1] = 0.0
        return rate

    array = array_of(body, [any_unit(1), any_unit(2), any_unit(3)])
    with pytest.raises(CalibrationError, match=rf"unit {number} reads one and the same rate about y throughout"):
        clock_fits(altered(array, number, without_y))


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("share", [0.4, 0.5, 0.6])
def test_a_unit_that_dies_has_the_clock_that_it_had(body, number, share):
    def dies(rate):
        last = int(share * len(rate))
        rate[last:] = rate[last]
        return rate

    units = [any_unit(1), any_unit(2, offset_s=0.5, rate=0.003), any_unit(3)]
    clock = clock_fits(altered(array_of(body, units), number, dies))[1].clock
    offset_s, rate = injected(units[1], units[0], clock.about_s)
    assert abs(clock.offset_s - offset_s) < 5 * clock.offset_sigma_s
    assert abs(clock.rate - rate) < 5 * clock.rate_sigma


def test_a_register_that_sticks_is_no_measurement(body):
    samples = samples_of(body, Unit(), 100.0, 1)
    rate = np.array(samples.gyro)
    rate[1000:1049], rate[2000:2050] = rate[1000], rate[2000]
    good = rates_of(replace(samples, gyro=rate), 2000.0).good
    assert good[1000:1049].all()
    assert not good[2000:2050].any()
    assert np.count_nonzero(~good) < 60


@pytest.mark.broad
def test_a_body_that_turns_about_one_axis_tells_clocks_but_no_mounting():
    """The map between rates about axes that nothing turned about is noise: no mirror is read in it, and no mounting."""
    clocks, pulls = [], []
    for seed in range(6):
        one = Body(turns=9, seed=1)
        times = one.rate.x
        one.rate = CubicSpline(times, np.linalg.norm(one.rate(times), axis=1)[:, None] * [0.0, 0.0, 1.0])
        one.force = CubicSpline(times[[0, -1]], np.tile([0.0, 0.0, -9.80665], (2, 1)))
        array = array_of(one, [any_unit(1), any_unit(2, offset_s=0.3)], seed=seed)
        fit = clock_fits(array)[1]
        assert not fit.map_is_known
        clocks.append(fit.clock.offset_s - injected(any_unit(2, offset_s=0.3), any_unit(1), fit.clock.about_s)[0])
        pulls.append(clocks[-1] / fit.clock.offset_sigma_s)
        with pytest.raises(CalibrationError, match="the body turned about too few axes"):
            places_of(array)
    assert np.abs(clocks).max() < 0.01
    assert 0.3 < np.sqrt(np.mean(np.square(pulls))) < 2


def in_two_logs(array: ArraySession, again_s: float) -> ArraySession:
    """Each unit's log cut in two; the clock of the second unit set by so much between them."""
    units = []
    for number, unit in enumerate(array.units):
        samples = unit.logs[0].samples
        middle = len(samples) // 2
        parts = [samples.between(0, middle), samples.between(middle, len(samples))]
        parts[1] = replace(parts[1], t_ns=parts[1].t_ns + int(number * again_s * 1e9))
        units.append(replace(unit, logs=tuple(replace(unit.logs[0], samples=part) for part in parts)))
    return replace(array, units=tuple(units))


def test_one_clock_runs_through_all_logs(body):
    array = array_of(body, [any_unit(1), any_unit(2, offset_s=0.7, rate=0.004)])
    whole, parts = (clock_fits(each)[1].clock for each in (array, in_two_logs(array, 0.0)))
    at = np.array([parts.about_s])
    assert parts.array_time(at) == pytest.approx(whole.array_time(at), abs=5 * whole.offset_sigma_s)
    assert parts.rate == pytest.approx(whole.rate, abs=5 * whole.rate_sigma)
    with pytest.raises(CalibrationError, match=r"unit 1: its clock was set anew between two logs: .* give each log an array's folder"):
        clock_fits(in_two_logs(array, 3.0))
