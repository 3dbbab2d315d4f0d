"""Clocks, mountings, reading ages and shared noise of an array's units: injected and recovered, refused where there is no rigid body."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from benchmarks.public import mikov
from session.base.units import DEG, NS, G
from session.log.config import Accelerometer, Config, Protocol, Sensor, Site
from session.log.folder import Session
from session.log.logfile import Log
from session.log.samples import Samples
from tinygc import CalibrationError
from tinygc.features.arrays.checks import BODY, OPEN, SENSORS, _noise_of_fits, correlated, shared_noise
from tinygc.features.arrays.clocks import rates_of
from tinygc.features.arrays.extrinsics import clock_fits, places_of
from tinygc.features.arrays.latency import AgeReadings, ages_of, corrected, find_beat
from tinygc.features.arrays.recording import ArraySession, read_array
from tinygc.inference.choose import Standing

FINE_S = 1e-3


class Body:
    """Turns of 30 to 90 degrees about any axes, a second each, with stills between them; then, if asked, as much shaking."""

    def __init__(self, turns, seed, still_s=2.0, shaken_s=0.0):
        random = np.random.default_rng(seed)
        self.duration_s = turns * (still_s + 1.0) + still_s + shaken_s
        t = np.arange(0, self.duration_s, FINE_S)
        rate = np.zeros((len(t), 3))
        for turn in range(turns):
            begin, angle = still_s + turn * (still_s + 1.0), random.uniform(30, 90) * DEG
            axis = random.normal(size=3)
            phase = np.clip(t - begin, 0, 1)
            rate += angle * (1 - np.cos(2 * np.pi * phase))[:, None] * axis / np.linalg.norm(axis)
        if shaken_s:
            begin = self.duration_s - shaken_s
            window = np.clip((t - begin) / 0.5, 0, 1) ** 2
            for axis in range(3):
                for hertz in random.uniform(0.8, 3.0, 4):
                    rate[:, axis] += window * 120 * DEG * np.sin(2 * np.pi * hertz * (t - begin) + random.uniform(0, 6))
        self.rate = CubicSpline(t, rate)
        steps = Rotation.from_rotvec((rate[1:] + rate[:-1]) / 2 * FINE_S)
        attitudes = [np.eye(3)]
        for step in steps.as_matrix():
            attitudes.append(attitudes[-1] @ step)
        self.force = CubicSpline(t, np.array(attitudes)[:, 2] * -G)  # level and still: (0, 0, -g)


@dataclass(frozen=True, eq=False)
class Unit:
    """rotation: of the unit's axes against the body's (mounting); gyro (3, 3): what the gyroscope makes of a rate in the unit's axes; the
    unit's time is (t - offset_s - …)/(1 + rate) of the body's; noise_dps of a reading; beat_hz and period_s of its readings' ages."""

    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    gyro: np.ndarray = field(default_factory=lambda: np.eye(3))
    offset_s: float = 0.0
    rate: float = 0.0
    noise_dps: float = 0.1
    accel_noise_mps2: float = 0.02
    beat_hz: float = 0.0
    phase: float = 0.0
    period_s: float = 0.0

    def age_s(self, t_s):
        cycles = self.phase + self.beat_hz * t_s
        return np.asarray(self.period_s * (cycles - np.floor(cycles)))


def samples_of(body, unit, odr_hz, seed):
    """Its log, from second 1 of its own clock to as near the end as all clocks can be."""
    random = np.random.default_rng(seed)
    t_unit = 1.0 + np.arange(int((body.duration_s - 2.0) * odr_hz)) / odr_hz
    about = body.duration_s / 2
    made = t_unit + unit.offset_s + unit.rate * (t_unit - about) - unit.age_s(t_unit)
    inside = (made > 0) & (made < body.duration_s - FINE_S)
    t_unit, made = t_unit[inside], made[inside]
    gyro = body.rate(made) @ unit.rotation @ unit.gyro.T + random.normal(0, unit.noise_dps * DEG, (len(made), 3)) + random.normal(0, DEG, 3)
    accel = body.force(made) @ unit.rotation + random.normal(0, unit.accel_noise_mps2, (len(made), 3))
    return Samples(np.rint(t_unit * 1e9).astype(np.int64), gyro, accel)


def array_of(body, units, odr_hz=100.0, seed=0):
    """With accelerometers that are right, and said to be."""
    config = Config(Sensor("unknown", "", odr_hz, 2000.0, 16.0), Accelerometer(), Site(), Protocol())
    sessions = []
    for number, unit in enumerate(units):
        log = Log(Path(f"log0001.unit{number}"), samples_of(body, unit, odr_hz, 100 * seed + number), raw=False, in_memory=True)
        sessions.append(Session(Path("twins"), config, (log,), ()))
    return ArraySession(Path("twins"), tuple(range(len(units))), tuple(sessions))


def any_unit(seed, **more):
    """Any mounting, scales and misalignments of some percent."""
    random = np.random.default_rng(seed)
    rotation = Rotation.random(rng=random).as_matrix()
    return Unit(rotation, np.eye(3) + random.normal(0, 0.015, (3, 3)), **more)


ABOUT_S = 14.5  #: half of the body's time


@pytest.fixture(scope="module")
def body():
    return Body(turns=9, seed=1)


THREE = [any_unit(1), any_unit(2, offset_s=0.5, rate=0.003), any_unit(3)]


@pytest.fixture(scope="module")
def three(body):
    return array_of(body, THREE)


def injected(unit, first, about_s):
    """Offset and rate of a unit's clock against the first's, exactly: both are known against the body's."""
    rate = (1 + unit.rate) / (1 + first.rate) - 1
    moment = about_s + unit.offset_s + unit.rate * (about_s - ABOUT_S)  # of the body
    on_first = (moment - first.offset_s + first.rate * ABOUT_S) / (1 + first.rate)
    return on_first - about_s, rate


def test_a_mounting_is_recovered_within_its_covariance(body):
    """Of a gyroscope that is misaligned by a degree, which the mounting must not take for its own; chi-square of 3, four times: 3 ± 1.2."""
    rotation, pulls = Rotation.from_rotvec(np.array([60, -110, 35]) * DEG), []
    for seed in range(4):
        unit = Unit(rotation.as_matrix(), np.eye(3) + np.array([[0, 0.02, 0], [-0.02, 0, 0.01], [0, -0.01, 0]]), offset_s=0.4)
        place = places_of(array_of(body, [Unit(), unit], seed=seed))[1]
        miss = (Rotation.from_matrix(place.mounting) * rotation.inv()).as_rotvec()
        assert np.abs(miss).max() < 0.2 * DEG
        pulls.append(miss @ np.linalg.solve(place.mounting_covariance, miss))
    assert 0.5 < np.mean(pulls) < 8.0


def altered(array, number, change):
    """With other rates of one unit: change of (N, 3)."""
    unit = array.units[number]
    samples = unit.logs[0].samples
    log = replace(unit.logs[0], samples=replace(samples, gyro=change(np.array(samples.gyro))))
    return replace(array, units=tuple(replace(unit, logs=(log,)) if i == number else each for i, each in enumerate(array.units)))


def dead(rate):
    rate[:] = rate[0]
    return rate


def without_y(rate):
    rate[:, 1] = 0.0
    return rate


def elsewhere(rate):
    return np.roll(rate, len(rate) // 3, axis=1) * np.linspace(-1, 1, len(rate))[::-1, None]


@pytest.mark.parametrize(
    ("number", "change", "says"),
    [
        (2, elsewhere, r"unit 2 did not feel the motion of the array's first unit: .* correlation of their speeds is 0\."),
        (0, elsewhere, r"unit 0 did not feel the motion of the others"),
        (1, dead, r"unit 1 reads one and the same rate throughout: it is dead"),
        (1, lambda rate: rate * [1, 1, -1], r"unit 1 has mirrored axes"),
        (0, lambda rate: rate * [1, -1, 1], r"unit 0 has mirrored axes"),
        (0, without_y, r"unit 0 reads one and the same rate about y throughout"),
        (1, without_y, r"unit 1 reads one and the same rate about y throughout"),
    ],
)
def test_a_unit_that_cannot_be_of_the_body_is_named(three, number, change, says):
    with pytest.raises(CalibrationError, match=says):
        clock_fits(altered(three, number, change))


@pytest.mark.parametrize(("number", "share"), [(0, 0.5), (1, 0.4)])
def test_a_unit_that_dies_has_the_clock_that_it_had(three, number, share):
    def dies(rate):
        last = int(share * len(rate))
        rate[last:] = rate[last]
        return rate

    clock = clock_fits(altered(three, number, dies))[1].clock
    offset_s, rate = injected(THREE[1], THREE[0], clock.about_s)
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


def test_a_body_that_turns_about_one_axis_tells_clocks_but_no_mounting():
    """The map between rates about axes that nothing turned about is noise: no mirror is read in it, and no mounting."""
    one = Body(turns=9, seed=1)
    times = one.rate.x
    one.rate = CubicSpline(times, np.linalg.norm(one.rate(times), axis=1)[:, None] * [0.0, 0.0, 1.0])
    one.force = CubicSpline(times[[0, -1]], np.tile([0.0, 0.0, -G], (2, 1)))
    units = [any_unit(1), any_unit(2, offset_s=0.3)]
    fit = clock_fits(array_of(one, units))[1]
    assert not fit.map_is_known
    off_s = fit.clock.offset_s - injected(units[1], units[0], fit.clock.about_s)[0]
    assert abs(off_s) < min(0.01, 4 * fit.clock.offset_sigma_s)
    with pytest.raises(CalibrationError, match="the body turned about too few axes"):
        places_of(array_of(one, units))


def in_two_logs(array, again_s):
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
    with pytest.raises(CalibrationError, match=r"unit 1: its clock was reset between two logs: .* give each log an array's folder"):
        clock_fits(in_two_logs(array, 3.0))


# Readings that wait for their reader.


def test_noise_without_a_beat_has_one_by_chance_as_often_as_its_p_value_says():
    """Neighbouring frequencies are not independent, so that p is a little too large: uniform it would have a mean of 0.5."""
    t_s = np.arange(7500) / 62.5
    ages = (1e-3 * np.random.default_rng(seed).standard_normal(len(t_s)) for seed in range(30))
    p_values = [find_beat(AgeReadings(t_s, each, np.full(len(t_s), 1e-6), 1 / 62.5))[2] for each in ages]
    assert 0.5 < np.mean(p_values) < 0.8
    assert 0.05 < min(p_values) < 0.5


def test_a_sawtooth_of_ages_is_recovered_and_a_unit_without_one_has_none():
    """Turns, then shaking: so that the phase has to be carried from turn to turn; the ages are the truth's but for one constant of all."""
    body, beats = Body(turns=5, seed=4, shaken_s=10.0), {0: -2.4, 1: 0.8, 3: 1.9}
    aged = {number: {"beat_hz": hz, "phase": 0.3 * number, "period_s": 1e-3} for number, hz in beats.items()}
    units = [any_unit(number, noise_dps=0.06, **aged.get(number, {})) for number in range(4)]
    array = array_of(body, units, 62.5)
    ages = ages_of(array, clock_fits(array))
    assert [each.track is not None for each in ages] == [True, True, False, True]
    for each, unit, session in zip(ages, units, array.units, strict=True):
        if each.track is None:
            continue
        assert each.track.beat[0] == pytest.approx(unit.beat_hz, abs=max(4 * each.track.beat[1], 0.004))
        assert each.period_s == pytest.approx(1e-3, abs=max(4 * each.period_sigma_s, 5e-5))
        assert each.p_value < 1e-6
        t_s = session.logs[0].samples.t_ns * NS
        miss = each.age_s(t_s) - unit.age_s(t_s)
        near_jump = np.abs(miss) > 0.5e-3  # a jump that is a reading early or late
        assert np.mean(near_jump) < 0.03
        assert np.std(miss[~near_jump]) < 0.06e-3
    moved = corrected(array, ages).units[0].logs[0].samples.t_ns - array.units[0].logs[0].samples.t_ns
    assert -1_000_000 <= moved.min() < -900_000
    assert moved.max() <= 0
    two = array_of(body, [any_unit(0, noise_dps=0.06, **aged[1]), any_unit(1, noise_dps=0.06)], 62.5)
    assert not any(each.track for each in ages_of(two, clock_fits(two)))  # of two units nothing tells whose age it is


# Noise at rest that units share.


def groups(common, units=4, stills=20, blocks=40, seed=0, own=1.0):
    """Differences of neighbouring means: of a motion of the body, and of each unit's own noise, of these sigmas."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(stills):
        body = common * rng.normal(size=(blocks + 1, 3))
        found.append([np.diff(body + own * rng.normal(size=body.shape), axis=0) for _ in range(units)])
    return found


@pytest.mark.parametrize("common", [0.5, 1.0, 3.0])
def test_a_common_motion_is_found_at_its_share_of_the_power(common):
    shared = correlated(groups(common), "gyro")
    assert shared.value == pytest.approx(common**2 / (1 + common**2), abs=4 * shared.sigma)
    assert shared.standing is Standing.FOR
    assert (shared.figures["source"] == BODY) is (common == 3.0) or common == 1.0
    assert (shared.figures["source"] == SENSORS) is (common == 0.5)


def test_absence_is_stated_with_its_limit_only():
    shared = shared_noise(0.01, 0.02, "gyro")
    assert shared.upper == pytest.approx(0.01 + 1.6449 * 0.02, abs=1e-4)
    assert shared.words.startswith("motion of the body in the gyro noise at rest: below 4.3 % with 95 %")
    unknown = shared_noise(0.2, 0.3, "gyro")
    assert unknown.standing is Standing.UNDECIDED
    assert unknown.figures["source"] == OPEN


def test_the_mikov_body_moves_at_rest(shared, tmp_path):
    (folder,) = mikov.write_array(shared / "mikov", tmp_path / "mikov")
    array = read_array(folder)
    fits = clock_fits(array)
    noise = _noise_of_fits(array, fits)
    assert noise["gyro"].figures["source"] == BODY
    assert noise["accelerometer"].figures["source"] == SENSORS
    assert fits[1].clock.rate == pytest.approx(0.00220, abs=5e-5)  # slow, by a separate analysis
