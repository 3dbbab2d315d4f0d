"""Still detection on logs whose blocks have given means and scatters, to the last digit: each threshold below and above."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import Table, session_of
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from session.base.units import DEG, NS
from session.detect import stills
from session.detect.stills import (
    _CHUNK_BLOCKS,
    AT_ONCE,
    Noise,
    SessionStills,
    _mean_as_a_slope_weighs,
    _trend_of,
    _usual_rate,
    block_moments,
    block_size,
    find_stills,
    noise_floor,
    noise_variance,
    unused_rests,
)
from session.log.config import Accelerometer
from session.log.samples import Samples

#: within a block of eight: neither mean nor slope, and a variance of 8/7
PATTERN = np.array([1, -1, -1, 1, 1, -1, -1, 1])


G = 9.8


#: of single samples, rad/s and m/s^2, and of block means, which go up and down by it
GYRO, ACCEL, WANDER = 1e-3, 1e-2, 1e-4


#: what noise alone scatters the mean of a block by, from steps of twice the wander
SPREAD = 2 * WANDER / 0.6745 / np.sqrt(2)


class Blocks:
    """A log of blocks of 0.1 s: gyro_mean, gyro, force, accel (B, 3), of which a test changes some."""

    def __init__(self, count=40):
        up_down = np.where(np.arange(count) % 2, -1.0, 1.0)
        self.gyro_mean, self.gyro = np.tile(WANDER * up_down[:, None], 3), np.full((count, 3), GYRO)
        self.force, self.accel = np.tile([0.0, 0.0, -G], (count, 1)), np.full((count, 3), ACCEL)

    def loud(self, *blocks):
        self.gyro[list(blocks)] = 10 * GYRO
        return self

    def samples(self, period_s=0.0125, more=0):
        t_ns = np.rint(np.arange(8 * len(self.gyro) + more) * period_s / NS).astype(np.int64)
        gyro, accel = (
            (mean[:, None] + size[:, None] * PATTERN[:, None]).reshape(-1, 3)
            for mean, size in ((self.gyro_mean, self.gyro), (self.force, self.accel))
        )
        rest = np.zeros((more, 3))
        return Samples(t_ns, np.concatenate([gyro, rest]), np.concatenate([accel, rest]), 20 + t_ns * NS)

    def stills(self, still_s=1.0, period_s=0.0125):
        return find_stills(self.samples(period_s), still_s)[0]


def test_a_block_is_a_tenth_of_a_second_or_eight_samples():
    assert [block_size(period_s) for period_s in (0.0125, 0.0118, 0.0117, 0.1, 0.001)] == [8, 8, 9, 8, 100]
    blocks = block_moments(Blocks(3).samples(more=7))
    assert (len(blocks), blocks.duration_s) == (3, pytest.approx(0.1))
    assert_allclose(block_moments(Blocks(3).samples(), 12).gyro_mean[:, 0], WANDER / 3)


def test_moments_are_those_of_all_blocks_together_however_they_are_cut():
    rng, count = np.random.default_rng(0), _CHUNK_BLOCKS + 2
    samples = Samples(np.arange(8 * count + 3) * 10_000_000, *rng.normal(size=(2, 8 * count + 3, 3)))
    found, (gyro, accel) = block_moments(samples, 8), (x[: 8 * count].reshape(count, 8, 3) for x in (samples.gyro, samples.accel))
    assert_allclose(found.gyro_mean, gyro.mean(axis=1))
    assert_allclose(found.gyro_var, gyro.var(axis=1, ddof=1))
    assert_allclose(found.accel_var, accel.var(axis=1, ddof=1))


@pytest.fixture(params=[50, AT_ONCE])
def at_once(request, monkeypatch):
    """More readings than are taken at once, and fewer."""
    monkeypatch.setattr(stills, "AT_ONCE", request.param)


@pytest.mark.parametrize("spans", [[(5, 205)], [(5, 60), (70, 200)]])
def test_a_trend_is_the_straight_line_through_the_readings(spans, at_once):
    rng, count = np.random.default_rng(1), spans[-1][1] + 5
    t_ns = np.cumsum(rng.integers(4_000_000, 6_000_000, count))
    values = rng.normal(size=(count, 3)) + np.linspace(0, 25, count)[:, None] * [1, 0, -2]
    rows = np.concatenate([np.arange(*span) for span in spans])
    mean, std, slope = _trend_of(values, t_ns, spans)
    assert_allclose(slope, np.polyfit(t_ns[rows] * NS, values[rows], 1)[0], rtol=1e-9)
    assert_allclose(mean, values[rows].mean(axis=0))
    assert_allclose(std, values[rows].std(axis=0, ddof=1))


def test_a_rate_counts_as_the_slope_of_its_integral_does(at_once):
    """The straight line through the angle at the samples' ends: its slope is the mean of the rates, each with its weight."""
    count, rate = 120, np.random.default_rng(2).normal(size=(200, 3))
    angle = np.concatenate([np.zeros((1, 3)), np.cumsum(rate[40 : count + 40], axis=0)])
    # The line's weights are t (T - t) at the ends of a sample; at its middle a 4 n^2-th more.
    assert_allclose(_mean_as_a_slope_weighs(rate, [(40, count + 40)]), np.polyfit(np.arange(count + 1), angle, 1)[0], atol=2e-4)
    weight = (np.arange(count) + 0.5) / count * (1 - (np.arange(count) + 0.5) / count)
    part = np.r_[0:30, 50:count]
    expected = weight[part] @ rate[40 + part] / weight[part].sum()
    assert_allclose(_mean_as_a_slope_weighs(rate, [(40, 70), (90, count + 40)]), expected, atol=1e-12)


#: just below and just above a threshold
ACROSS = pytest.mark.parametrize(("past", "share"), [(False, 0.999), (True, 1.001)])


@pytest.mark.parametrize(("which", "axes", "ratio"), [("gyro", 3, 3.0), ("gyro", 1, 6.0), ("accel", 3, 6.0), ("accel", 1, 12.0)])
@ACROSS
def test_a_block_is_quiet_up_to_a_ratio_of_variances(which, axes, ratio, past, share):
    """Of all axes together, and of one alone up to twice that."""
    blocks = Blocks()
    getattr(blocks, which)[20, :axes] *= np.sqrt(ratio * share)
    (still,) = blocks.stills()
    assert (still.bumps, still.start, still.stop) == (int(past), 0, 320)


@ACROSS
def test_a_blocks_rate_may_leave_its_stills_by_six_of_its_sigmas(past, share):
    blocks = Blocks()
    blocks.gyro_mean[20, 1] = 6 * SPREAD * share
    (still,) = blocks.stills()
    assert still.bumps == past
    # What is measured leaves the bump out; at its ends, the still ends there.
    assert still.gyro_mean[0] == pytest.approx(-WANDER / 39 if past else 0.0, abs=1e-12)
    blocks.gyro_mean[[0, 20], 1] = blocks.gyro_mean[[20, 0], 1]
    assert blocks.stills()[0].start == 8 * past


def test_the_noises_variance_is_the_median_of_the_quiet_blocks():
    """Quiet: below three times the median, found from four times the quietest twentieth; what never moves does not count."""
    rng = np.random.default_rng(3)
    variance = rng.gamma(7, 1 / 7, (400, 3))
    variance[:40] = 0.0
    variance[100:200] *= 50
    calm = variance[40:][variance[40:].sum(axis=1) < 4 * np.quantile(variance[40:].sum(axis=1), 0.05)]
    for _ in range(50):  # to its end
        bar = 3 * np.median(calm.sum(axis=1))
        calm = variance[40:][variance[40:].sum(axis=1) < bar]
    assert_allclose(noise_variance(variance), np.median(calm, axis=0), rtol=1e-12)
    assert_array_equal(noise_variance(np.zeros((5, 3))), np.finfo(float).tiny)
    for louder, found in ((3.99, 3.99), (4.01, 1.0)):
        assert noise_variance(np.repeat([[1.0] * 3, [louder] * 3], [20, 80], axis=0)) == pytest.approx(found)


@pytest.mark.parametrize(("count", "still_s", "found"), [(7, 1.0, True), (6, 1.0, False), (7, 1.001, False), (3, 0.42, True)])
def test_a_still_lasts_seven_tenths_of_the_protocols(count, still_s, found):
    blocks = Blocks(60).loud(*range(20, 25), *range(25 + count, 40))
    stills = blocks.stills(still_s)
    assert [(still.start, still.stop) for still in stills] == [(0, 160)] + [(200, 200 + 8 * count)] * found + [(320, 480)]
    assert stills[1].start_s == pytest.approx(stills[1].start * 0.0125)
    assert stills[1].duration_s == pytest.approx((stills[1].stop - stills[1].start) * 0.0125)
    assert stills[1].temp_c == pytest.approx(20 + (stills[1].start + stills[1].stop - 1) / 2 * 0.0125)
    assert ([len(Blocks(short).stills(0.1)) for short in (2, 3)]) == [0, 1]
    assert stills[1].middle == (stills[1].start + stills[1].stop) // 2


@pytest.mark.parametrize(("period_s", "count"), [(0.0437, 1), (0.0438, 2)])
def test_a_bump_may_last_a_third_of_a_second(period_s, count):
    """Its one block: 0.3496 and 0.3504 s."""
    stills = Blocks().loud(20).stills(period_s=period_s)
    assert [still.bumps for still in stills] == [2 - count] * count


@pytest.mark.parametrize(("between", "bumps"), [(1, [0, 0]), (2, [2])])
def test_a_single_block_joins_nothing(between, bumps):
    assert [still.bumps for still in Blocks().loud(18, 19 + between).stills()] == bumps


@pytest.mark.parametrize("blocks_of_bump", [1, 3])
@ACROSS
def test_a_bump_may_turn_by_a_tenth_of_a_degree_and_four_sigmas(blocks_of_bump, past, share):
    """Beyond the rate of the rest before it: 1 mrad/s here."""
    blocks, bump = Blocks(), np.arange(20, 20 + blocks_of_bump)
    limit = 0.1 * DEG + 4 * SPREAD * 0.1 * np.sqrt(blocks_of_bump)
    blocks.gyro_mean += 1e-3
    turned = np.array([0.6, 0.0, 0.8]) * limit * share / (0.1 * blocks_of_bump)
    blocks.loud(*bump).gyro_mean[bump] = 1e-3 + turned
    assert [still.bumps for still in blocks.stills()] == ([0, 0] if past else [1])


@ACROSS
def test_a_bump_may_leave_gravity_a_tenth_of_a_degree_off(past, share):
    blocks = Blocks(400).loud(200)
    angle = 0.1 * DEG * share
    blocks.force[200:] = G * 1.5 * np.array([np.sin(angle), 0, -np.cos(angle)])
    assert len(blocks.stills()) == 1 + past
    blocks.force[:] = 0.0  # an accelerometer that was not recorded joins nothing
    assert len(blocks.stills()) == 2


def test_the_noise_is_the_allan_deviation_over_three_blocks():
    """Means that go up and down by w: spans of three differ by 2 w / 3, at every start; shorter stills have shorter spans; of single blocks
    it is the scatter of the samples, as if it were white."""
    samples = Blocks(41).samples()
    noise = find_stills(samples)[1]
    assert_allclose(noise.gyro, 2 * WANDER / 3 * np.sqrt(0.3), rtol=1e-9)
    assert_allclose(noise.angle_random_walk, noise.gyro / np.sqrt(2))
    assert_allclose(noise.accel, 0, atol=1e-12)
    steps = Blocks(40).loud(*range(5, 10), *range(15, 40))  # spans of two are of one height
    steps.gyro_mean[:] = WANDER * np.where(np.arange(40) % 4 < 2, 1.0, -1.0)[:, None]
    still, noise = find_stills(steps.samples(), 0.5)
    assert len(still) == 2
    means = steps.gyro_mean[:5, 0]
    pairs = [means[i + 2 : i + 4].mean() - means[i : i + 2].mean() for i in range(2)]
    other = [steps.gyro_mean[i + 2 : i + 4, 0].mean() - steps.gyro_mean[i : i + 2, 0].mean() for i in range(10, 12)]
    assert_allclose(noise.gyro, np.sqrt(np.mean(np.square(pairs + other)) * 0.2), rtol=1e-9)
    single = Blocks(12).loud(*range(1, 11))
    single.accel[:] *= 2
    noise = find_stills(single.samples(), 0.1)[1]
    assert_allclose(noise.accel, 2 * ACCEL * np.sqrt(8 / 7 * 2 * 0.0125), rtol=1e-9)
    walk = Noise(np.array([1.0, 3.0, 2.0]), np.array([4.0, 5.0, 6.0]))
    assert_allclose(walk.velocity_random_walk, np.array([4.0, 5.0, 6.0]) / np.sqrt(2))
    assert noise_floor(walk, 8.0) == pytest.approx(3 / np.sqrt(2) * np.sqrt(8))
    assert noise_floor(None, 8.0) == np.inf


def test_a_still_turns_as_gravity_does_in_it():
    """0.01 deg/s about a slanted axis: seen but for what is about the vertical."""
    blocks, omega = Blocks(40), 0.01 * DEG * np.array([0.6, -0.5, 0.3])
    t_s = (np.arange(40) - 19.5) * 0.1
    tilted = Rotation.from_rotvec([0.5, 0.2, 0]).inv().apply([0, 0, -G])
    blocks.force = Rotation.from_rotvec(t_s[:, None] * omega).inv().apply(tilted)
    (still,) = blocks.stills()
    down = tilted / G
    assert_allclose(still.tilt_rate, omega - down * (down @ omega), atol=1e-4 * 0.01 * DEG + 1e-7)
    assert still.gravity_mps2 == pytest.approx(G)
    assert still.problem is None


def creeping(rate, wander, count=40):
    """Gravity that moves evenly through a still, and force means that go up and down along gravity by a wander."""
    blocks = Blocks(count)
    t_s = (np.arange(8 * count) - (8 * count - 1) / 2) * 0.0125
    samples = blocks.samples()
    along = np.repeat(np.where(np.arange(count) % 2, -wander, wander), 8)
    return replace(samples, accel=samples.accel + np.stack([0 * t_s, rate * G * t_s, along], axis=1))


@ACROSS
@pytest.mark.parametrize("wander", [0.0, 0.03])
def test_gravity_may_move_by_six_sigmas_of_its_slope_and_by_a_fiftieth_of_a_degree(past, share, wander):
    """The sigma of a slope over T is the walk x sqrt(12 / T^3); the walk is that of the worst axis."""
    walk = 2 * wander / 3 * np.sqrt(0.3) / np.sqrt(2)
    limit = max(0.02 * DEG, 6 * walk * np.sqrt(12 / 4.0**3) / G)
    assert (limit > 0.021 * DEG) == (wander > 0)
    (still,) = find_stills(creeping(limit * share, wander))[0]
    assert (still.stop - still.start == 320 and still.problem is None) != past
    (still,) = find_stills(creeping(1.1 * limit, wander))[0]
    assert still.problem == f"creeps {1.1 * limit / DEG:.3f} dps about x (gravity moves in it)"


@pytest.mark.parametrize("first", [True, False])
def test_what_settles_at_an_end_is_cut_off_tenth_by_tenth(first):
    """Gravity comes to rest after 3 s, or leaves it then.  The accelerometer must see no more of it, nor the gyro, whose zero is what it
    read in all less the turn of gravity in all."""
    moving = (np.arange(60) < 30)[:: 1 if first else -1]
    turned = np.repeat(np.where(moving, 0.06 * DEG * (1 if first else -1), 0.0), 8)
    samples = Blocks(60).samples()
    force, gyro = samples.accel.copy(), samples.gyro.copy()
    gyro += [3e-3, -2e-3, 1e-3]
    gyro[:, 0] += turned
    force[:, 1] -= G * np.cumsum(turned) * 0.0125
    (still,), noise = find_stills(replace(samples, gyro=gyro, accel=force))
    t_s, part = np.arange(480) * 0.0125, (np.arange(480) + 0.5) / 480
    whole = -np.polyfit(t_s, force[:, 1], 1)[0] / G
    zero = np.average(gyro, axis=0, weights=part * (1 - part)) - [whole, 0, 0]
    slope_sigma = noise.velocity_random_walk.max() * np.sqrt(12) / G
    length = 60
    while True:
        rows, seconds = slice(480 - 8 * length, 480) if first else slice(0, 8 * length), length * 0.1
        by_force = abs(np.polyfit(t_s[rows], force[rows, 1], 1)[0]) / G
        by_gyro = np.linalg.norm((gyro[rows].mean(axis=0) - zero)[:2])
        sigma = np.hypot(slope_sigma / 6.0**1.5, noise.angle_random_walk.max() / np.sqrt(seconds))
        moves = by_force > max(6 * slope_sigma / seconds**1.5, 0.02 * DEG) or by_gyro > max(6 * sigma, 0.02 * DEG)
        if length < 60 and not moves:
            break
        length -= max(1, length // 10)
    assert still.problem is None
    assert (still.start, still.stop) == (rows.start, rows.stop)


@pytest.mark.parametrize(("dps", "count"), [(2.997, 2), (3.003, 1)])
def test_a_still_may_read_three_dps_more_than_most_of_the_time(dps, count):
    blocks = Blocks(60).loud(*range(20, 25))
    blocks.gyro_mean[:20, 2] += dps * DEG
    assert len(blocks.stills()) == count
    assert len(blocks.stills()[-1].gyro_mean) == 3
    assert_array_equal(_usual_rate(np.array([[1.0, 5, 2], [3, 4, 1], [2, 6, 9]]), np.array([1.0, 1.5, 3.0])), [2, 6, 9])


@pytest.mark.parametrize(("period_s", "count"), [(0.25 / 16, 1), (0.249 / 16, 0)])
def test_a_rest_of_a_quarter_second_is_named_and_a_shorter_pause_is_part_of_a_turn(period_s, count):
    blocks = Blocks(60).loud(*range(20, 35), *range(37, 52))
    samples = blocks.samples(period_s)
    rests = unused_rests(samples, find_stills(samples)[0], 1.0)
    assert [rest.cause for rest in rests] == ["too short"] * count
    for rest in rests:
        assert (rest.start_s, rest.duration_s) == pytest.approx((35 * 8 * period_s, 16 * period_s))
        assert str(rest) == "at 4.4 s (0.2 s): too short, expected 0.7 s"


@pytest.mark.parametrize(
    ("apart", "angle_deg", "cause"), [(10, 0.499, "knocked"), (11, 0.499, "too short"), (10, 0.501, "too short"), (10, -0.499, "knocked")]
)
@pytest.mark.parametrize("before", [True, False])
def test_a_rest_of_a_neighbours_attitude_within_a_second_was_knocked(apart, angle_deg, cause, before):
    """The other neighbour lies elsewhere."""
    blocks = Blocks(80)
    short = np.arange(30, 34) if before else np.arange(46, 50)
    moving = np.r_[30 - apart : 30, 34:50] if before else np.r_[30:46, 50 : 50 + apart]
    blocks.loud(*moving)
    blocks.force[:] = [0, G, 0]
    blocks.force[: 40 - 5 * before] = [0, 0, -G]
    blocks.force[short] = 0.5 * G * np.array([np.sin(angle_deg * DEG), 0, -np.cos(angle_deg * DEG)])
    if not before:
        blocks.force[short] = 0.5 * G * np.array([np.sin(angle_deg * DEG), np.cos(angle_deg * DEG), 0])
    samples = blocks.samples()
    (rest,) = unused_rests(samples, find_stills(samples)[0], 1.0)
    assert (rest.cause, rest.start_s) == (cause, pytest.approx(short[0] * 0.1))
    assert cause == "too short" or "1.0 s of movement part it from a rest in the same attitude" in rest.why


@pytest.mark.parametrize(("dps", "long", "cause"), [(3.003, True, "turns"), (2.997, False, "too short"), (3.003, False, None)])
def test_a_rest_at_another_rate_is_a_steady_turn_or_the_middle_of_a_slow_one(dps, long, cause):
    blocks = Blocks(80)
    blocks.gyro_mean += 0.04  # of the bias
    turning = np.arange(25, 32 if long else 31)
    blocks.loud(*range(20, 25), *range(turning[-1] + 1, 40), *range(44, 55)).gyro_mean[turning, 1] -= dps * DEG
    blocks.force[turning], blocks.force[40:44] = [G, 0, 0], [0, G, 0]
    samples = blocks.samples(1 / 64)  # seven blocks are 0.875 s and seven tenths of the protocol's, to the last digit
    found = unused_rests(samples, find_stills(samples, 1.25)[0], 1.25)
    assert [rest.cause for rest in found] == [cause, "too short"][cause is None :]
    assert cause != "turns" or found[0].why == "turns at a steady 3.0 dps"


def test_under_another_calibration_means_and_scatters_follow_it():
    """What was found of the session is kept where its forces change by less than 1 %; scatters of independent axes add by squares."""
    session = session_of(Blocks(40).samples())
    found = SessionStills(session)
    (still,) = found.of(session.logs[0]).stills
    assert found.of(session.logs[0]).unused == []
    shear = np.array([[1.0, 0.009, 0], [0, 1.0, -0.0], [0.005, 0, 0.995]])
    moved = replace(session, config=replace(session.config, accelerometer=Accelerometer(shear, np.array([0.1, 0.2, 0.3]))))
    other = found.under(moved)
    assert len(other.samples()) == 1
    (now,) = other.of(session.logs[0]).stills
    assert_allclose(now.accel_mean, shear @ (still.accel_mean - [0.1, 0.2, 0.3]))
    assert_allclose(now.accel_std, np.sqrt(shear**2 @ still.accel_std**2))
    assert_allclose(other.of(session.logs[0]).samples.accel, moved.calibrated(session.logs[0]).accel)
    assert other.of(session.logs[0]).unused is found.of(session.logs[0]).unused
    far = replace(session, config=replace(session.config, accelerometer=Accelerometer(np.diag([1.0, 1.0, 0.98]), np.zeros(3))))
    assert found.under(far).samples() == []


def test_a_sensor_without_noise_does_not_answer_and_a_few_samples_hold_no_still():
    samples = Table().rest(10).samples()
    frozen = Samples(samples.t_ns, np.zeros_like(samples.gyro), np.zeros_like(samples.accel) + np.array([0, 0, -9.8]))
    for none in (frozen, samples.between(0, 2), samples.between(0, 30)):
        assert find_stills(none) == ([], None)
