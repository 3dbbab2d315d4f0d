"""A gyroscope alone on a turntable: terms of the variance, and the estimate against dense densities."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import logsumexp
from scipy.stats import chi2, multivariate_normal
from turntables import Turned, turn_session

import tinygc
from session.base.units import DEG
from session.detect.rounding import rounding_variance
from tinygc.features.turns import rests
from tinygc.features.turns.angles import (
    TERMS,
    LogOfTurns,
    OtherReading,
    TurnAngle,
    _better,
    _bridge_variance,
    _mean_variance,
    measured_turns,
)
from tinygc.features.turns.clock import sample_times
from tinygc.features.turns.estimate import _component, _data, _fits, _Grid, _posterior, estimate
from tinygc.features.turns.folder import GyroLog, write_turn_session

#: x both ways, z one way only
PLAN = tuple((axis, sign * angle, 90.0) for angle in (90, 180, 360) for axis, sign in ((0, 1), (0, -1), (2, 1), (2, 1)))


ERRORS = {"plus": (0.01, 0.0, -0.004), "minus": (0.013, 0.0, 0.0), "bias": (0.01, -0.02, 0.005)}


EXACT = Turned(PLAN, **ERRORS, stop_deg=1e-9)


def fitted(t_ns, gyro, known, **more):
    return tinygc.fit_turns(turn_session([GyroLog("log", t_ns, gyro)], known, **more))


def step(rate_dps=60.0, noise=0.0, seed=0):
    """A turn about x of 1.2 s that begins and ends between two samples, at 100 Hz."""
    gyro = noise * np.random.default_rng(seed).normal(size=(500, 3))
    gyro[200:320, 0] += rate_dps * DEG
    return np.arange(500) * 10_000_000, gyro, Turned(((0, rate_dps * 1.2, rate_dps),)).known()


# Exact angles and scales.


def test_turns_without_noise_give_the_scales_and_the_bias_exactly():
    found = tinygc.fit_turns(EXACT.session())
    assert [(scale.axis, scale.sense) for scale in found.scales] == [(0, 1), (0, -1), (2, 1)]
    assert [scale.value for scale in found.scales] == pytest.approx([0.01, 0.013, -0.004], abs=1e-8)
    assert_allclose(found.bias.mean, EXACT.bias, rtol=0, atol=1e-15)
    for angle in found.angles:
        gain = 1 + (EXACT.plus if angle.sense > 0 else EXACT.minus)[angle.axis]
        assert angle.measured_rad == pytest.approx(gain * angle.stated_rad, rel=1e-11)
        assert angle.rate_rps == pytest.approx(gain * 90 * DEG)
    value, _ = found.asymmetry[0]
    assert value == pytest.approx((0.01 - 0.013) / 1.0115, abs=1e-9)


def test_a_lean_of_the_table_does_not_enter_the_scale():
    lean = 10 * DEG
    found = tinygc.fit_turns(dataclasses.replace(EXACT, plus=(0.01,) * 3, minus=(0.01,) * 3, lean=(0.0, lean, 0.0)).session())
    for scale in found.scales:
        assert scale.value == pytest.approx(0.01, abs=1e-8)  # by components it would be short by lean^2 / 2: 1.5 %
        assert scale.axis_bound == pytest.approx(np.sqrt(2) * lean**2, rel=1e-6)
    assert all(angle.lean_rad == pytest.approx(lean, abs=1e-6) for angle in found.angles)
    assert dataclasses.replace(turn(360.0), direction=np.array([0, 0, 1 + 1e-15])).lean_rad == 0  # of a rounded cosine


# Terms of the variance.


def test_a_bias_that_wanders_between_two_rests_is_a_brownian_bridge():
    assert _bridge_variance(2.0, 0.0, 3.0, 3.0) == pytest.approx(2.0 * 3.0**3 / 12, rel=1e-14)
    lead, duration, apart = 0.7, 2.0, 4.0
    t = lead + (np.arange(1000) + 0.5) / 1000 * duration
    covariance = np.minimum.outer(t, t) - np.outer(t, t) / apart
    assert _bridge_variance(1.0, lead, duration, apart) == pytest.approx(covariance.mean() * duration**2, rel=1e-5)


def test_two_steps_between_samples_are_rectangles_of_one_interval():
    (angle,) = fitted(*step()).angles
    assert angle.variance["ends"] == pytest.approx(2 * (60 * DEG * 0.01) ** 2 / 12, rel=1e-12)
    assert angle.measured_rad == pytest.approx(72 * DEG, rel=1e-12)
    for name in ("rests", "drift", "white", "vibration"):
        assert angle.variance[name] == 0


def test_white_noise_and_rests_are_those_of_the_readings():
    white, means = [], []
    for seed in range(4):
        found = fitted(*step(noise=0.003, seed=seed))
        (angle,) = found.angles
        assert angle.variance["white"] == pytest.approx(found.noise.white[0] * angle.duration_s, rel=1e-6)
        white += list(found.noise.white / (0.003**2 * 0.01))
        _, weights, samples = np.transpose(angle.rests)
        assert angle.variance["rests"] == pytest.approx(weights**2 @ samples, rel=1e-9)
        assert np.sum(weights) == pytest.approx(-angle.duration_s, rel=1e-12)
        assert weights[0] / np.sum(weights) == pytest.approx(0.5, abs=0.1)
        means.append(samples[0] / (0.003**2 / 200))
    assert np.mean(white) == pytest.approx(1, abs=0.17)
    assert np.mean(means) == pytest.approx(1, abs=0.3)


def test_a_rest_has_the_noise_of_all_unless_it_scatters_beyond_chance():
    """Of five blocks and a thousandth; the third axis has no noise elsewhere."""
    pooled = np.array([1e-6, 2e-6, 0.0])
    own = np.array([0.99e-6, 2.02e-6, 1e-9]) * chi2.isf(1e-3, 4) / 4
    rest = SimpleNamespace(count=200, blocks=np.arange(-2, 3)[:, None] * np.sqrt(2 * own))  # whose mean has a variance of 1 / 2
    found = _mean_variance(rest, pooled * 200 * 0.01, SimpleNamespace(times=SimpleNamespace(period_s=0.01)))
    assert_allclose(found, [pooled[0], own[1], own[2]])


def test_what_shakes_too_fast_to_be_followed_is_counted_sample_by_sample():
    shares = []
    for seed in range(4):
        t_ns, gyro, known = step(noise=0.001, seed=seed)
        gyro[205:315, 0] += 0.2 * np.random.default_rng(100 + seed).normal(size=110)
        (angle,) = fitted(t_ns, gyro, known).angles
        shares.append(angle.variance["vibration"] / (0.2**2 * 0.01**2 * 120))
    assert np.mean(shares) == pytest.approx(1, abs=0.25)
    t_ns, gyro, known = step()
    gyro[200:320, 0] += np.resize([0.2, -0.2], 120)  # second differences of 0.8, of each sample and one on either side
    (angle,) = fitted(t_ns, gyro, known).angles
    assert angle.variance["vibration"] == pytest.approx(0.8**2 / 6 / chi2(1).median() * 0.01**2 * 122, rel=1e-3)


def test_counted_samples_make_all_scales_as_uncertain_as_their_rate(tmp_path):
    turned = Turned(((0, 360, 90.0), (2, 360, 90.0)), noise=1e-4)
    out = write_turn_session(tmp_path / "s", [GyroLog("log1", *turned.arrays())], turned.known("log1.csv.gz"))
    before = tinygc.fit_turns(out)
    toml = out / "session.toml"
    toml.write_text(toml.read_text().replace("[protocol]", "odr_sigma = 0.01\n\n[protocol]"))
    after = tinygc.fit_turns(out)
    gains = 1 + before.estimate.scale
    assert_allclose(after.covariance - before.covariance, 1e-4 * np.outer(gains, gains), rtol=1e-9, atol=1e-15)
    assert "Hz is not measured, so all scales are known to ±" in after.summary()


def test_a_rest_that_two_turns_share_counts_once():
    """Turned forth and back at once, an error of the bias of the rest between adds to one angle what it takes from the other."""
    found = tinygc.fit_turns(Turned(((0, 90, 90.0), (0, -90, 90.0)), noise=0.02, rest_s=0.4, stop_deg=1e-4).session())
    (a,), (b,) = ([rest for rest in angle.rests if rest[0] == 1] for angle in found.angles)
    shared = a[1] * b[1] * a[2]
    assert shared < 0
    one, two = (angle.gyro_variance + angle.turn.sigma_rad**2 + angle.variance["vibration"] for angle in found.angles)
    assert_allclose(found.covariance, np.array([[one, shared], [shared, two]]) / (90 * DEG) ** 2, rtol=1e-3)


def test_half_of_what_rounding_hides_is_alike_in_all_turns_and_half_is_not():
    """Rests that read 0.00 throughout: 0.01 / sqrt(12) times the duration, as a whole, of a single turn."""
    t_ns, gyro, known = step()
    gyro[195:325, 0] = np.round(np.interp(np.arange(195, 325), [199, 219, 300, 320], [0, 60 * DEG, 60 * DEG, 0]), 2)
    gyro[200:320, 1] = np.round(0.02 * np.sin(np.arange(120)), 2)
    found = fitted(t_ns, gyro, [dataclasses.replace(known[0], angle_rad=60.6 * DEG)])
    (angle,) = found.angles
    whole = 1e-4 / 12
    assert angle.shared_rps2 == pytest.approx(whole / 2, rel=1e-9)
    of_turn = angle.duration_s**2 * whole  # a turn that does not shake hides as much
    assert angle.variance["rounding"] == pytest.approx(1.5 * of_turn, rel=1e-9)
    total = angle.gyro_variance + angle.variance["vibration"] + angle.turn.sigma_rad**2 + of_turn / 2
    assert found.scales[0].sigma == pytest.approx(np.sqrt(total) / angle.stated_rad, rel=1e-3)
    assert_allclose(found.bias.sigma, np.sqrt(whole), rtol=1e-9)


def test_rests_that_differ_are_a_bias_that_wanders():
    t_ns, gyro, known = step()
    gyro[320:] += [0.0, 0.0, 0.004]
    found = fitted(t_ns, gyro, known)
    first, second = found.logs[0].rests
    assert found.noise.drift == pytest.approx([0, 0, 0.004**2 / (second.middle_s - first.middle_s)], rel=1e-9)
    assert_allclose(found.bias.mean, [0, 0, 0.004 * 180 / 380], atol=1e-12)
    assert found.bias.wander[2] == pytest.approx(0.004 / np.sqrt(2), rel=2e-2)
    assert found.bias.sigma[2] == pytest.approx(0.004 / 2, rel=2e-2)
    (angle,) = found.angles
    expected = _bridge_variance(found.noise.drift[2], 1.99 - first.middle_s, angle.duration_s, second.middle_s - first.middle_s)
    x, _, z = angle.direction**2
    assert angle.variance["drift"] == pytest.approx(z * expected, rel=1e-9)
    across, length = (1 - z) * expected + (1 / x - 1) * angle.variance["ends"], 72 * DEG / np.sqrt(x)
    assert angle.measured_rad == pytest.approx(length - across / (2 * length), rel=1e-9)  # noise across makes a sum of squares larger


def test_the_covariance_of_the_model_is_that_of_scales_and_bias():
    """Other numbers of the matrix are known to 0.2."""
    turned = Turned(((0, 360, 90.0), (0, -360, 90.0), (2, 90, 90.0)), plus=(0.1, 0, -0.1), minus=(0.1, 0, 0), noise=0.01)
    found = tinygc.fit_turns(turned.session())
    x, z = found.axis_scales
    assert (x.sense, z.sense, x.turns) == (0, 1, 2)
    assert x.sigma**2 == pytest.approx(found.covariance[:2, :2].sum() / 4, rel=1e-12)
    E, sigma = 1 / (1 + np.array([x.value, 0, z.value])), np.full((3, 3), 0.2)
    sigma[[0, 2], [0, 2]] = np.array([x.sigma, z.sigma]) * E[[0, 2]] ** 2
    assert_allclose(found.model.E, np.diag(E), rtol=1e-12)
    assert_allclose(found.model.B, -E * found.bias.mean, rtol=1e-12)
    assert_allclose(found.model_covariance, np.diag(np.append(sigma, E * found.bias.sigma) ** 2), rtol=1e-12)


# Stamps.


def bursts(count):
    """Stamps of samples, one each 2 ms, that are handed on five at a time, 0.2 ms apart, none before it was taken."""
    n = np.arange(count)
    return (n // 5 * 5 + 4) * 2_000_000 + n % 5 * 200_000 + np.random.default_rng(0).integers(0, 50_000, count)


def test_bursts_are_spaced_evenly_and_a_delay_that_is_caught_up_is_no_gap():
    stamps = bursts(2000)
    stamps[1000:1010] += 12_000_000  # handed on late
    stamps[1010:1025] = np.maximum(stamps[1010:1025], stamps[1009] + 100_000 * np.arange(1, 16))
    times = sample_times(stamps)
    assert times.bursts
    assert times.period_s == pytest.approx(0.002, rel=1e-3)
    assert len(times.gap_rows) == 0
    assert_allclose(times.t_s, 0.002 * np.arange(2000), rtol=0, atol=1.5e-3)
    assert_allclose(np.diff(times.t_s), 0.002, rtol=0, atol=1e-5)


def test_samples_lost_between_bursts_are_a_gap_of_that_length():
    times = sample_times(np.delete(bursts(2100), slice(1000, 1100)))
    assert times.bursts
    assert times.lost_s == pytest.approx([0.2], abs=2e-3)
    assert times.gap_rows == pytest.approx([999], abs=1)
    assert times.lost_between(900, 1100) == pytest.approx(0.2, abs=2e-3)
    assert times.lost_between(0, 900) == 0
    assert times.t_s[-1] == pytest.approx(0.002 * 2099, abs=0.01)


def lossy(t_ns, gyro, seed=3):
    """Four of five samples are lost, one at a time, for most of the time: the stamps of the others are right."""
    rng = np.random.default_rng(seed)
    edges = np.cumsum(rng.uniform(2, 6, 99) * np.resize([1, 4], 99))
    thin = np.searchsorted(edges, t_ns * 1e-9) % 2 == 1
    kept = ~thin | (rng.random(len(t_ns)) < 0.2)
    return t_ns[kept], gyro[kept]


def test_lost_samples_that_look_like_bursts_are_told_by_how_turns_repeat():
    """Spaced evenly, turns of 1800 degrees are tens of degrees off; as stamped, by the ramps that gaps cut short."""
    turned = Turned(tuple((2, 1800 * sign, 200.0) for sign in (1, -1) * 3), noise=0.002, odr_hz=200.0)
    t_ns, gyro = lossy(*turned.arrays())
    assert sample_times(t_ns).bursts
    found = fitted(t_ns, gyro, turned.known())
    (log,) = found.logs
    assert not log.times.bursts
    assert log.other.worse > 5
    assert log.other.apart_rad > 20 * DEG
    for angle in found.angles:
        assert angle.measured_rad == pytest.approx(1800 * DEG, abs=3 * DEG)
    assert "samples are lost, none came in bursts" in found.summary()


def reading(name="log1"):
    return LogOfTurns(SimpleNamespace(path=SimpleNamespace(name=name)), *[None] * 5)


def test_of_two_readings_of_stamps_the_one_whose_turns_repeat_better_is_taken():
    """By the squares about the mean of each axis and sense; each turn has a sigma of 0.2 deg."""
    even, stamped, elsewhere = reading(), reading(), [turn(999.0, log="log2"), turn(5.0, problem="no rest")]
    close, far = ([*map(turn, both), turn(one, 9.0, axis=0), *elsewhere] for both, one in (((360.1, 360.3), 7.0), ((363.0, 360.0), 7.1)))
    for evenly, as_written, taken in ((close, far, even), (far, close, stamped)):
        found = _better(even, stamped, evenly, as_written)
        assert found.log is taken.log
        assert (found.other.apart_rad, found.other.apart_sigmas) == pytest.approx((2.9 * DEG, 2.9 / 0.2))
        assert found.other.worse == pytest.approx(3.0**2 / 0.2**2)
        assert not found.other.is_open
    single = _better(even, stamped, [turn(360.0)], [turn(361.0)])
    assert (single.log is even.log, single.other.worse, single.other.is_open) == (True, 1.0, True)
    assert _better(even, stamped, elsewhere, elsewhere) is even
    assert [OtherReading(1.0, *of).is_open for of in ((1.01, 4.99), (1.0, 1.0), (9.0, 5.0))] == [True, False, False]


# The estimate.


def turn(measured_deg, stated_deg=360.0, axis=2, log="log1", problem=None, **variance):
    """A measured turn with 0.2 deg of the gyroscope and 0.1 deg of the stop."""
    (known,) = Turned(((axis, stated_deg, 90.0),)).known()
    variance = dict.fromkeys(TERMS, 0.0) | {"white": (0.2 * DEG) ** 2} | variance
    angles = (stated_deg * DEG, measured_deg * DEG)
    return TurnAngle(known, log, axis, 1, *angles, np.eye(3)[axis], 4.0, 90 * DEG, 0.01, variance, problem=problem)


KNOWN = np.hypot(0.2, 0.1) * DEG


def evidence(turns, good):
    """log of the probability of the data where the turns of ``good`` are good: dense covariances, and a grid of its own."""
    A = np.array([each.stated_rad for each in turns])
    r = np.array([each.measured_rad for each in turns]) - A
    vibration = np.array([each.variance["vibration"] for each in turns])
    size, share = np.geomspace(0.1, 200, 60), np.geomspace(0.03, 1, 12)
    even = [np.gradient(np.log(x)) / (1 + (x / 10) ** 2) for x in (size, share)]
    even = [each / each.sum() for each in even]
    play, repeat = (np.concatenate([[1 - there], there * even[0]]) for there in (0.8, 0.2))
    part = np.concatenate([[0.2], 0.8 * even[1]]) if vibration.any() else np.ones(1)
    size, share = np.concatenate([[0], size]), np.concatenate([[0], share])[: len(part)]
    groups = [(each.axis, each.sense) for each in turns]
    J = np.array([[a * (group == g) for g in dict.fromkeys(groups)] for a, group in zip(A, groups, strict=True)]) * 0.2
    i, j, k = (each.ravel() for each in np.meshgrid(*map(np.arange, (len(size), len(size), len(share))), indexing="ij"))
    sigmas = [size[i][:, None] * KNOWN, size[j][:, None] * np.median(KNOWN / A) * A, share[k][:, None] * np.sqrt(vibration)]
    C = (KNOWN**2 + sum(sigma**2 for sigma in sigmas))[:, good, None] * np.eye(good.sum()) + (J @ J.T)[np.ix_(good, good)]
    square = np.linalg.solve(C, np.broadcast_to(r[good, None], (len(C), good.sum(), 1)))[..., 0] @ r[good]
    density = -0.5 * (square + np.linalg.slogdet(C)[1] + good.sum() * np.log(2 * np.pi))
    return logsumexp(density + np.log(play[i] * repeat[j] * part[k])) + np.sum(np.log(0.01 / 0.99) - np.log(2 * A[~good]))


@pytest.mark.parametrize(
    ("measured", "lost"),
    [((360.4, 360.2, 360.1, 362.0), 0), ((360.4, 360.2, 360.1, 340.0), 1), ((360.4, 360.2, 330.1, 340.0, 360.3, 360.2), 2)],
)
def test_the_lost_turns_are_the_most_probable_set_of_all(measured, lost):
    turns = [turn(each) for each in measured]
    found = estimate(turns)
    sets = [np.array(good) for good in itertools.product((True, False), repeat=len(turns))]
    values = [evidence(turns, good) for good in sets]
    assert_array_equal(found.used, sets[int(np.argmax(values))])
    assert np.count_nonzero(~found.used) == lost
    assert found.chi2 == pytest.approx(estimate([each for each, used in zip(turns, found.used, strict=True) if used]).chi2, rel=1e-6)
    at = {tuple(good): value for good, value in zip(sets, values, strict=True)}
    for i in range(len(turns)):
        good, bad = (at[*found.used[:i], is_good, *found.used[i + 1 :]] for is_good in (True, False))
        assert found.lost[i] == pytest.approx(1 / (1 + np.exp(good - bad)), rel=0.05)
        beside = 1 if found.used[i] else -1  # the scale follows a turn that is used
        error = found.predicted_rad[i] ** 2 + beside * (360 * DEG) ** 2 * found.covariance.item()
        assert KNOWN**2 < error == pytest.approx(found.predicted_rad[0] ** 2 + (360 * DEG) ** 2 * found.covariance.item())


def test_a_point_of_the_grid_has_the_dense_density_of_the_good_turns():
    """And all turns the residual and the leverage of the scales' posterior, which has a prior of 20 %."""
    turns = [turn(360.4), turn(721.5, 720.0, axis=0), turn(359.0, vibration=(0.3 * DEG) ** 2), turn(330.0)]
    data, good, points = _data(turns, ((0, 1), (2, 1))), np.array([True, True, True, False]), np.array([[2e-3, 1e-3, 0.5], [0, 0, 0]])
    A, r = np.array([[each.stated_rad, each.measured_rad - each.stated_rad] for each in turns]).T
    prior = np.outer(0.2 * A, 0.2 * A) * [[1, 0, 1, 1], [0, 1, 0, 0], [1, 0, 1, 1], [1, 0, 1, 1]]
    for (play, repeat, share), variance, value, residual, leverage in zip(points, *_fits(data, good, points), strict=True):
        expected = KNOWN**2 + play**2 + (repeat * A) ** 2 + share**2 * np.array([0, 0, (0.3 * DEG) ** 2, 0])
        assert_allclose(variance, expected, rtol=1e-12)
        C = (np.diag(expected) + prior)[:3, :3]
        gain = prior[:, :3] @ np.linalg.inv(C)
        assert value == pytest.approx(multivariate_normal.logpdf(r[:3], cov=C), rel=1e-9)
        assert_allclose(residual, r - gain @ r[:3], rtol=1e-6)
        assert_allclose(leverage, np.diag(prior - gain @ prior[:3]), rtol=1e-6)
    grid = _Grid.whole(data)  # of which the points that count are averaged over
    weight = np.exp(grid.prior + _fits(data, good, grid.points)[1])
    counted = weight > 1e-6 * weight.sum()
    points, weights, *_ = _posterior(data, good, grid)
    assert_array_equal(points, grid.points[counted])
    assert_allclose(weights, weight[counted] / weight[counted].sum(), rtol=1e-9)


def test_a_size_is_none_or_alike_on_a_logarithmic_scale_up_to_ten_and_a_finer_grid_is_about_what_weighs():
    fine = _Grid((2.0, 3.0, 1.0), (np.geomspace(0.1, 200.0, 4001), np.array([1.0, 2.0]), np.array([0.5, 1.0])))
    prior = np.exp(fine.prior).reshape(4002, 3, 3)
    assert_allclose(fine.points.reshape(4002, 3, 3, 3)[[0, 1, -1], 0, 0, 0], [0.0, 0.2, 400.0])
    play = prior[:, 0, 0] / (0.8 * 0.2)  # neither a repeat nor a share
    assert (play[0], np.trapezoid(play[1:], dx=1)) == pytest.approx((0.2, 0.8), rel=1e-6)
    assert play[2:-1] / play[2] == pytest.approx((1 + (fine.sizes[0][1] / 10) ** 2) / (1 + (fine.sizes[0][1:-1] / 10) ** 2))
    coarse = _Grid((1.0, 1.0, 1.0), (10.0 ** np.arange(6), np.array([1.0, 2.0]), np.array([0.5, 1.0])))
    for weights, low, high in (((9, 0, 0, 1, 2e-4, 0.9e-4, 0), 1, 4), ((0, 1, 0, 0, 0, 0, 1), 0, 5)):
        cube = np.array(weights)[:, None, None] * np.ones((3, 3)) / 9
        found = coarse.finer(cube.ravel())
        assert_allclose(found.sizes[0], np.geomspace(10.0**low, 10.0**high, 6))
        assert_allclose(found.sizes[1], [1.0, 2.0])
    whole = _Grid.whole(_data([turn(90.0, 90.0), turn(360.0), turn(360.0)], ((2, 1),)))
    assert_allclose(whole.units, (KNOWN, KNOWN / (360 * DEG), 1.0))
    assert [(*own[[0, -1]], len(own)) for own in whole.sizes] == [
        pytest.approx(each) for each in ((0.1, 200, 12), (0.1, 200, 12), (0.03, 1, 6))
    ]


def test_chi_square_is_that_of_a_weighted_fit_of_a_scale():
    measured = np.array([90.5, 180.9, 361.0, 1804.5, 90.1])
    A = np.array([90, 180, 360, 1800, 90.0])
    found = estimate(list(map(turn, measured, A)))
    r = (measured - A) * DEG / KNOWN
    expected = r @ r - (A @ r) ** 2 / (A @ A)
    assert found.chi2 == pytest.approx(expected, rel=1e-4)  # the prior of 20 % bends it by no more
    assert found.dof == 4
    assert found.p_value == pytest.approx(chi2.sf(expected, 4), rel=1e-4, abs=0)


def test_chi_square_knows_of_rests_that_turns_share():
    """An error of 0.05 deg/s of a mean, over 2 s of either turn."""
    r, A = np.array([1.0, -0.5, 0.2]) * DEG, np.full(3, 360 * DEG)
    rests = [tuple((number, -2.0, (0.05 * DEG) ** 2) for number in (i, i + 1)) for i in range(3)]
    found = estimate([dataclasses.replace(turn(360 + x / DEG), rests=own) for x, own in zip(r, rests, strict=True)])
    C = KNOWN**2 * np.eye(3) + (0.1 * DEG) ** 2 * (np.eye(3, k=1) + np.eye(3, k=-1))
    one, two, three = (x @ np.linalg.solve(C, y) for x, y in ((r, r), (A, r), (A, A)))
    assert found.chi2 == pytest.approx(one - two**2 / three, rel=1e-4)


def test_a_single_turn_has_the_sum_of_its_known_errors_and_all_of_its_vibration():
    found = estimate([turn(361.0, vibration=(0.5 * DEG) ** 2)])
    assert found.scale == pytest.approx([1 / 360], rel=1e-4)
    assert np.sqrt(found.covariance) == pytest.approx(np.sqrt(KNOWN**2 + (0.5 * DEG) ** 2) / (360 * DEG), rel=1e-4)
    error = KNOWN**2 + (0.5 * DEG) ** 2  # of which the scale, which the turn itself tells, leaves next to nothing
    assert found.predicted_rad == pytest.approx([error / np.sqrt(error + (0.2 * 360 * DEG) ** 2)], rel=1e-3)
    assert not found.play.estimated
    assert (found.chi2, found.dof) == (0, 0)
    assert np.isnan(found.p_value)


def test_a_group_of_which_every_turn_is_lost_is_not_claimed():
    turns = [turn(360.0 + 0.1 * i, log=f"log{i}") for i in range(6)] + [turn(20.0, axis=0), turn(-300.0 + 60.0, axis=0, log="log8")]
    found = estimate(turns)
    assert found.groups == ((2, 1),)
    assert list(found.used) == [True] * 6 + [False] * 2
    assert np.isnan(found.residual_rad[6:]).all()
    assert (found.lost[6:] > 0.5).all()


def test_turns_with_a_problem_change_nothing():
    good, bad = [turn(360.2), turn(360.5), turn(360.1)], turn(100.0, problem="no rest")
    one, other = estimate(good), estimate([good[0], bad, *good[1:]])
    assert_array_equal(one.scale, other.scale)
    assert list(other.used) == [True, False, True, True]
    assert np.isnan(other.lost[1])


def test_lost_turns_that_agree_with_each_other_are_found():
    """From all turns as good, a play as large as the miss explains them; from those near the median of each axis, nothing has to."""
    good = [turn(360.0 * 1.1 + x, axis=0, log=f"log{i}") for i, x in enumerate((0.1, -0.2, 0.3, 0.0, -0.1))]
    good += [turn(360.0 * 0.9 + x, axis=2, log=f"log{i + 5}") for i, x in enumerate((0.2, -0.1, 0.0, 0.1, -0.3))]
    lost = [turn(360.0 * 1.1 - 60 + x, axis=0, log=f"log{i + 10}") for i, x in enumerate((0.1, 0.2, -0.1))]
    found = estimate([*good, *lost])
    assert list(found.used) == [True] * 10 + [False] * 3
    assert found.scale == pytest.approx([0.1, -0.1], abs=0.003)


# What is injected comes back, and what is wrong is named.


def test_a_gap_is_bridged_and_explains_only_what_it_lacks():
    turned = Turned(((2, 360, 90.0),) * 8, noise=0.002)
    t_ns, gyro = turned.arrays()
    first = int(np.flatnonzero(gyro[:, 2] > 1)[0])
    gap = slice(first + 100, first + 140)

    def without(stamps, readings):
        return fitted(np.delete(stamps, gap), np.delete(readings, gap, axis=0), turned.known())

    bridged = without(t_ns, gyro)
    assert bridged.estimate.used.all()  # at a constant rate the trapezoid takes in what is missing
    assert [angle.lost_s for angle in bridged.angles] == pytest.approx([0.4] + [0.0] * 7, abs=1e-9)
    stopped = gyro.copy()
    stopped[[gap.start - 1, gap.stop], 2] = 0  # the rate on either side tells nothing of the rate within
    unseen = without(t_ns, stopped)
    assert list(np.flatnonzero(~unseen.estimate.used)) == [0]
    assert "gaps in its stamps lack 0.40 s: lost samples" in unseen.to_json()["remarks"][0]
    hidden = t_ns.copy()
    hidden[gap.stop :] -= 350_000_000  # stamps that show 0.05 of 0.4 s
    short = without(hidden, gyro)
    assert list(np.flatnonzero(~short.estimate.used)) == [0]
    assert "gaps in its stamps lack only 0.050 s: lost samples or lost steps" in short.to_json()["remarks"][0]


def test_a_turn_that_the_log_begins_or_ends_in_is_named():
    turned = Turned(PLAN[:4], noise=0.002)
    found = fitted(*(each[200:-200] for each in turned.arrays()), turned.known())
    assert list(found.estimate.used) == [False, True, True, False]
    assert "no rest before it" in found.angles[0].problem
    assert "no rest behind it" in found.angles[3].problem


@pytest.mark.parametrize(
    ("axis", "angle_deg", "words"),
    [(1, 90, "about (1.00"), (0, -90, "about (1.00"), (0, 90, None)],
)
def test_a_turn_about_another_axis_or_the_other_way_is_named(axis, angle_deg, words):
    turned = Turned(((0, 90, 90.0), (0, 90, 90.0)), noise=0.002)
    first, second = turned.known()
    stated = dataclasses.replace(first, axis=np.eye(3)[axis], words="xyz"[axis], angle_rad=angle_deg * DEG)
    found = fitted(*turned.arrays(), [stated, second])
    assert found.estimate.used[0] == (words is None)
    assert words is None or words in found.angles[0].problem


def test_clipped_turns_and_turns_that_are_not_there_are_named():
    turned = Turned(((0, 90, 90.0), (0, 180, 150.0)), noise=0.002)
    found = fitted(*turned.arrays(), turned.known(), gyro_fs_dps=125)
    assert [angle.problem is None for angle in found.angles] == [True, False]
    assert "reaches the full scale of 125 dps" in found.angles[1].problem
    beyond = [dataclasses.replace(turn, turn=turn.turn + 1) for turn in turned.known()]
    assert "holds 2 turns" in fitted(*turned.arrays(), beyond).angles[1].problem
    with pytest.raises(tinygc.FitError, match="none of 1 stated turns can be used"):
        fitted(*turned.arrays(), beyond[1:])


def test_a_knock_parts_no_rest_and_is_no_turn():
    """What turned by less than a quarter of the smallest stated angle, 72 deg."""
    for angle_deg, spans, turns in ((17.9, [2, 1], 1), (18.1, [1, 1, 1], 2)):
        t_ns, gyro, known = step()
        gyro[100:110, 1] = angle_deg / 0.1 * DEG
        gyro += [0.0, 0.5, 0.0]  # the rests' own rate is no part of it
        _, (log,), _ = measured_turns(turn_session([GyroLog("log", t_ns, gyro)], known))
        assert [len(rest.spans) for rest in log.rests] == spans
        assert len(log.turns) == turns
    t_ns, gyro, known = step()
    gyro[100:110, 1], gyro[:5], gyro[-5:] = DEG, DEG, DEG
    (log,) = fitted(t_ns, gyro, known).logs
    rest, *_ = log.rests
    rows = np.concatenate([np.arange(*span) for span in rest.spans])
    assert (rest.count, rest.middle_s, len(log.turns)) == (len(rows), pytest.approx(rows.mean() * 0.01), 1)


@pytest.mark.parametrize(
    ("runs", "rate"),
    [
        (((0.01, 3), (1.0, 9), (0.03, 5)), 0.03),  # the longer one of two ends that are alike
        (((0.03, 5), (0.01, 3)), 0.03),
        (((0.03, 3), (1.0, 9), (0.01, 3)), 0.03),
        (((1.0, 3), (0.0, 3), (-1.0, 3), (0.01, 3)), 0.0),  # else what most read: the lowest, or an end
        (((0.3, 3), (0.5, 3), (0.1, 3), (0.5, 3)), 0.5),
        (((0.5, 3), (0.1, 3), (0.5, 3), (0.3, 3)), 0.5),
        (((0.02, 1), (0.01, 2)), 0.01),  # a block alone is no stretch, unless there is no other
        (((0.02, 1), (1.0, 1)), 0.02),
    ],
)
def test_the_rate_of_rests_is_of_a_log_s_ends_or_of_most_stretches(runs, rate):
    mean = np.concatenate([[*[rate] * count, 9.0] for rate, count in runs])  # a loud block behind each
    assert_array_equal(rests._rate_at_rest(np.outer(mean, [1, 0, 0]), mean < 9), [rate, 0, 0])


@pytest.mark.parametrize(("times", "spans"), [(0.99, [(0, 20), (21, 27)]), (1.01, [(0, 20), (21, 24), (25, 27)])])
def test_a_block_leaves_its_rest_beyond_six_sigmas_of_all_block_means(times, spans):
    """One rest whose means go to and fro by d, a loud block, and one that stands still but for a block."""
    size, d = 8, 1e-4
    beyond = times * 6 * 2 * d / (np.sqrt(2) * np.sqrt(chi2(1).median()))
    means, ripple = np.array([d, -d] * 10 + [0] * 4 + [beyond, 0, 0]), np.array([1e-6] * 20 + [0.5] + [1e-6] * 6)
    gyro = np.outer(np.repeat(means, size), [1, 0, 0]) + (np.repeat(ripple, size) * np.resize([1, -1], 27 * size))[:, None]
    assert rests._still_spans(gyro, size, 0.0) == [(size * a, size * b) for a, b in spans]


@pytest.mark.parametrize(("times", "spans"), [(0.99, [(0, 27)]), (1.01, [(0, 20), (21, 27)])])
def test_readings_that_stand_still_are_as_noisy_as_their_rounding(times, spans):
    """A block scatters on one axis by six times the variance of lsb / sqrt(12)."""
    size, lsb = 8, 0.01
    ripple = np.sqrt(times * 6 * lsb**2 / 12 * (size - 1) / size)
    gyro = np.outer(np.repeat(np.where(np.arange(27) == 20, ripple, 1e-6), size) * np.resize([1, -1], 27 * size), [1, 0, 0])
    assert rests._still_spans(gyro, size, lsb) == [(size * a, size * b) for a, b in spans]


def test_turns_without_a_log_are_counted_over_all_and_a_log_without_a_rest_has_none():
    turned, (t_ns, shaken, known) = Turned(PLAN[:2]), step()
    logs = [GyroLog(name, *turned.arrays()) for name in ("log1", "log2")]
    stated = [dataclasses.replace(turned.known()[k % 2], log=None, turn=k) for k in range(5)]
    angles, _, _ = measured_turns(turn_session(logs, stated))
    assert [(angle.log, angle.problem is None) for angle in angles] == [("log1", True)] * 2 + [("log2", True)] * 2 + [("", False)]
    assert "counts more turns than the logs hold (4)" in angles[-1].problem
    shaken[:, 0] = np.cumsum(np.random.default_rng(0).normal(size=500))
    (angle,), _, noise = measured_turns(turn_session([GyroLog("log", t_ns, shaken)], known))
    assert "holds no rest" in angle.problem
    assert angle.lost_s == 0
    assert not np.concatenate([noise.white, noise.drift, noise.single]).any()


def test_a_rest_that_hums_is_a_rest_and_one_that_shakes_is_none():
    for rate_dps, hum_dps, starts in ((60.0, 2.5, (320, 330)), (60.0, 6.0, (420,)), (10.0, 2.5, (420,))):  # less beside a slow turn
        t_ns, gyro, known = step(rate_dps, noise=0.0005)
        gyro[320:420, 1] += hum_dps * DEG * np.sin(np.arange(100) * 2.0)
        assert fitted(t_ns, gyro, known).logs[0].rests[-1].start in starts


def test_play_and_repeat_are_told_apart_by_many_turns():
    A, (own, draws) = np.tile([90, 180, 360, 1800.0], 20), np.random.default_rng(5).normal(size=(2, 80))
    play, repeat = (estimate(list(map(turn, A + KNOWN / DEG * own + size * draws, A))) for size in (1.0, 0.003 * A))
    assert play.play.low < draws.std() * DEG < play.play.upper
    assert play.repeat.upper < 0.002
    assert repeat.repeat.low < 0.003 * draws.std() < repeat.repeat.upper
    assert repeat.play.upper < 1.0 * DEG


def test_a_turn_that_is_only_probably_lost_is_named_and_used():
    others = [turn(360.0 + x, log=f"log{i}") for i, x in enumerate((0.3, -0.2, 0.1, 0.25, -0.3, 0.0, 0.1, -0.1))]
    probabilities = {True: [], False: []}
    for miss in np.arange(2.0, 3.2, 0.1):
        found = estimate([*others, turn(360.0 - miss)])
        probabilities[bool(found.used[-1])].append(found.lost[-1])
        assert found.used[:-1].all()
    assert 0.5 < max(probabilities[True]) < 10 / 11 < min(probabilities[False])


def test_rounding_of_rests_is_no_wander_and_what_shakes_hides_less():
    t_ns, gyro, known = step()
    gyro[200:320, 0] = np.round(1 + 0.01 * (np.arange(120) // 2 % 2 + np.arange(120) // 8), 2)  # most second differences are one step
    gyro[320:, 2] = 0.02
    found = fitted(t_ns, gyro, [dataclasses.replace(known[0], angle_rad=1.29)])
    first, second = found.logs[0].rests
    assert found.noise.drift[2] == pytest.approx((0.02**2 - 1e-4 / 12) / (second.middle_s - first.middle_s), rel=1e-9)
    (angle,) = found.angles
    shakes = rounding_variance(0.01, np.sqrt(1e-4 / (6 * chi2(1).median()) - 1e-4 / 12))
    x, z = angle.direction[[0, 2]] ** 2
    expected = angle.duration_s**2 * (1e-4 / 24 + x * shakes + z * 1e-4 / 12)
    assert angle.variance["rounding"] == pytest.approx(expected, rel=1e-6)


def test_an_interval_of_a_size_is_of_the_values_that_are_nearest_to_each():
    """Of weights at 0, 1 and 10, each for a decade about it."""
    found = _component(np.array([0.1, 0.5, 0.4]), np.array([0.0, 1.0, 10.0]), np.array([1.0, 10.0]), True)
    edges, below = np.sqrt(10.0) * np.array([0.1, 1, 10]), [0.1, 0.6, 1.0]
    assert (found.low, found.median, found.high, found.upper) == pytest.approx(np.interp([0.1587, 0.5, 0.8413, 0.95], below, edges))
    assert found.estimated
    none = _component(np.ones(1), np.zeros(1), np.array([1.0, 10.0]), True)
    assert dataclasses.astuple(none) == (0, 0, 0, 0, True)
    assert not _component(np.ones(1), np.zeros(1), None, False).estimated
