"""Each term of the variance of a turn's angle, by itself, against an exact answer."""

import dataclasses
import math

import numpy as np
import pytest
from annex import annex
from scipy.stats import norm
from turntables import Turned, turn_session

import tinygc
from session.detect import rounding
from session.io.units import DEG

folder = annex("session.annexes.turntable.folder")
angles = annex("tinygc.annexes.turntable.angles")
clock = annex("session.annexes.turntable.clock")
rests = annex("session.annexes.turntable.rests")


def fitted(t_ns, gyro, known):
    return tinygc.fit_turns(turn_session([folder.GyroLog("log", t_ns, gyro)], known))


@pytest.mark.parametrize("sigma", [0.0, 0.05, 0.2, 0.4])
def test_rounding_leaves_the_mean_square_of_what_rounded_normal_readings_are_off(sigma):
    means, steps = (np.arange(2000) + 0.5) / 2000, np.arange(-5, 7)
    if sigma:
        upper, lower = (norm.cdf((steps + half - means[:, None]) / sigma) for half in (0.5, -0.5))
        off = (upper - lower) @ steps - means
    else:
        off = np.round(means) - means
    assert rounding.rounding_variance(1.0, np.array(sigma)) == pytest.approx(np.mean(off**2), rel=1e-5)
    assert rounding.rounding_variance(0.01, np.array(0.01 * sigma)) == pytest.approx(1e-4 * np.mean(off**2), rel=1e-5)


def test_rounding_without_noise_is_a_rectangle_and_no_step_rounds_nothing():
    assert rounding.rounding_variance(0.3, np.array(0.0)) == pytest.approx(0.3**2 / 12, rel=1e-14)
    assert rounding.rounding_variance(0.0, np.array(0.1)) == 0
    assert rounding.rounding_variance(1.0, np.array(0.7)) < 1e-9


def test_a_bias_that_wanders_between_two_rests_is_a_brownian_bridge():
    assert angles.bridge_variance(2.0, 0.0, 3.0, 3.0) == pytest.approx(2.0 * 3.0**3 / 12, rel=1e-14)
    lead, duration, apart = 0.7, 2.0, 4.0
    t = lead + (np.arange(1000) + 0.5) / 1000 * duration
    covariance = np.minimum.outer(t, t) - np.outer(t, t) / apart
    assert angles.bridge_variance(1.0, lead, duration, apart) == pytest.approx(covariance.mean() * duration**2, rel=1e-5)


def step(rate_dps=60.0, turning=120, noise=0.0, seed=0):
    """A turn about x that begins and ends between two samples, at 100 Hz."""
    gyro = np.zeros((500, 3))
    gyro[200 : 200 + turning, 0] = rate_dps * DEG
    gyro += noise * np.random.default_rng(seed).normal(size=gyro.shape)
    turned = Turned(((0, rate_dps * turning / 100, rate_dps),))
    return np.arange(500) * 10_000_000, gyro, turned.known()


def test_two_steps_between_samples_are_rectangles_of_one_interval():
    (angle,) = fitted(*step()).angles
    assert angle.variance["ends"] == pytest.approx(2 * (60 * DEG * 0.01) ** 2 / 12, rel=1e-12)
    assert angle.measured_rad == pytest.approx(72 * DEG, rel=1e-12)
    for name in ("rests", "drift", "white", "vibration"):
        assert angle.variance[name] == 0


def test_white_noise_and_rests_are_those_of_the_readings():
    white, means = [], []
    for seed in range(12):
        found = fitted(*step(noise=0.003, seed=seed))
        (angle,) = found.angles
        assert angle.variance["white"] == pytest.approx(found.noise.white[0] * angle.duration_s, rel=1e-6)
        white += list(found.noise.white / (0.003**2 * 0.01))
        late = 0.5  # nearly
        samples = [rest[2] for rest in angle.rests]
        weights = [rest[1] for rest in angle.rests]
        assert angle.variance["rests"] == pytest.approx(sum(w**2 * v for w, v in zip(weights, samples, strict=True)), rel=1e-9)
        assert np.sum(weights) == pytest.approx(-angle.duration_s, rel=1e-12)
        assert abs(weights[0] / np.sum(weights) - late) < 0.1
        means.append(samples[0] / (0.003**2 / 200))
    assert np.mean(white) == pytest.approx(1, abs=0.17)  # 3 of its sigmas
    assert np.mean(means) == pytest.approx(1, abs=0.3)


def test_what_shakes_too_fast_to_be_followed_is_counted_sample_by_sample():
    shares = []
    for seed in range(12):
        t_ns, gyro, known = step(noise=0.001, seed=seed)
        rng = np.random.default_rng(100 + seed)
        gyro[205:315, 0] += 0.2 * rng.normal(size=110)
        (angle,) = fitted(t_ns, gyro, known).angles
        shares.append(angle.variance["vibration"] / (0.2**2 * 0.01**2 * 120))
    assert np.mean(shares) == pytest.approx(1, abs=0.25)


def test_noise_across_the_axis_is_taken_off_the_length():
    """Of a sum of squares: E |theta + e| = theta + (variance across) / (2 theta)."""
    lengths = []
    t_ns, _, known = step()
    for seed in range(60):
        _, gyro, _ = step(noise=0.05, seed=seed, rate_dps=1200.0)
        known = [dataclasses.replace(known[0], angle_rad=1440 * DEG)]
        lengths.append(fitted(t_ns, gyro, known).angles[0])
    theta = np.mean([angle.measured_rad for angle in lengths])
    sigma = np.sqrt(lengths[0].gyro_variance / len(lengths))
    assert abs(theta - 1440 * DEG) < 3 * sigma


def test_counted_samples_make_all_scales_as_uncertain_as_their_rate(tmp_path):
    turned = Turned(((0, 360, 90.0), (2, 360, 90.0)), noise=1e-4)
    out = folder.write_turn_session(tmp_path / "s", [folder.GyroLog("log1", *turned.arrays())], turned.known("log1.csv.gz"))
    before = tinygc.fit_turns(out)
    toml = out / "session.toml"
    toml.write_text(toml.read_text().replace("[protocol]", "odr_sigma = 0.01\n\n[protocol]"))
    after = tinygc.fit_turns(out)
    gains = 1 + before.estimate.scale
    np.testing.assert_allclose(after.covariance - before.covariance, 1e-4 * np.outer(gains, gains), rtol=1e-9, atol=1e-15)
    assert "no better known" in after.summary()


def test_a_rest_that_two_turns_share_counts_once():
    """Turned forth and back at once, an error of the bias of the rest between adds to one angle what it takes from the other."""
    found = tinygc.fit_turns(Turned(((0, 90, 90.0), (0, -90, 90.0)), noise=0.02, rest_s=0.4, stop_deg=1e-4).session())
    first, second = found.angles
    (a,), (b,) = ([rest for rest in angle.rests if rest[0] == 1] for angle in (first, second))
    shared = a[1] * b[1] * a[2]
    assert shared < 0
    variances = [angle.gyro_variance + angle.turn.sigma_rad**2 for angle in (first, second)]
    total = [v + angle.variance["vibration"] for v, angle in zip(variances, (first, second), strict=True)]
    expected = np.array([[total[0], shared], [shared, total[1]]]) / (first.stated_rad * second.stated_rad)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-3)


def bursts(count, period_ns, size=5, late_ns=0, seed=0):
    """Stamps of samples that are handed on five at a time, 0.2 ms apart, none before it was taken."""
    rng = np.random.default_rng(seed)
    taken = np.arange(count) * period_ns
    handed = taken[np.minimum((np.arange(count) // size + 1) * size - 1, count - 1)]
    return handed + (np.arange(count) % size) * 200_000 + rng.integers(0, 50_000, count) + late_ns


def test_bursts_are_spaced_evenly_and_a_delay_that_is_caught_up_is_no_gap():
    stamps = bursts(2000, 2_000_000)
    stamps[1000:1010] += 12_000_000  # handed on late
    stamps[1010:1025] = np.maximum(stamps[1010:1025], stamps[1009] + 100_000 * np.arange(1, 16))
    times = clock.sample_times(stamps)
    assert times.bursts
    assert times.period_s == pytest.approx(0.002, rel=1e-3)
    assert len(times.gap_rows) == 0
    np.testing.assert_allclose(times.t_s, 0.002 * np.arange(2000), rtol=0, atol=1.5e-3)
    assert np.abs(np.diff(times.t_s) - 0.002).max() < 1e-5


def test_samples_lost_between_bursts_are_a_gap_of_that_length():
    stamps = bursts(2100, 2_000_000)
    stamps = np.delete(stamps, slice(1000, 1100))
    times = clock.sample_times(stamps)
    assert times.bursts
    assert times.lost_s == pytest.approx([0.2], abs=2e-3)
    assert abs(int(times.gap_rows[0]) - 999) <= 1
    assert times.lost_between(900, 1100) == pytest.approx(0.2, abs=2e-3)
    assert times.lost_between(0, 900) == 0
    assert times.t_s[-1] == pytest.approx(0.002 * 2099, abs=0.01)


def test_stamps_that_are_even_stay_as_they_are():
    stamps = np.arange(500) * 10_000_000 + np.random.default_rng(1).integers(0, 2_000_000, 500)
    times = clock.sample_times(stamps)
    assert not times.bursts
    np.testing.assert_allclose(times.t_s, (stamps - stamps[0]) * 1e-9, rtol=0, atol=1e-12)
    gone = clock.sample_times(np.delete(stamps, slice(200, 220)))
    assert gone.lost_s == pytest.approx([0.2], abs=3e-3)
    assert list(gone.gap_rows) == [199]


def test_turns_in_bursts_have_the_same_angles():
    turned = Turned(((2, 360, 100.0), (2, 180, 100.0)), noise=0.002, odr_hz=500.0)
    t_ns, gyro = turned.arrays()
    even, burst = (fitted(stamps, gyro, turned.known()) for stamps in (t_ns, bursts(len(t_ns), 2_000_000)))
    assert burst.logs[0].times.bursts
    for one, other in zip(even.angles, burst.angles, strict=True):
        assert one.measured_rad == pytest.approx(other.measured_rad, abs=0.02 * DEG)
    assert "spaced evenly between gaps" in burst.summary()


def test_no_rest_no_bias():
    gyro, known = 2 + np.random.default_rng(0).normal(size=(300, 3)).cumsum(axis=0), Turned(((0, 90, 90.0),)).known()
    with pytest.raises(tinygc.FitError, match="holds no rest"):
        fitted(np.arange(300) * 10_000_000, gyro, known)


def test_the_least_step_of_readings_is_found():
    rng = np.random.default_rng(2)
    assert rounding.lsb_of(np.round(rng.normal(size=(500, 3)), 2)) == pytest.approx(0.01, rel=1e-9)
    assert rounding.lsb_of(np.zeros((5, 3))) == 0
    assert math.isclose(rounding.lsb_of(DEG * np.round(rng.normal(size=(500, 3)), 1)), 0.1 * DEG, rel_tol=1e-9)


def test_what_rounding_leaves_in_a_rest_depends_on_how_many_values_it_reads():
    def of(*counts):
        column = np.repeat(np.arange(len(counts)), counts) * 0.01
        return rounding.rounding_of_mean(np.stack([column] * 3, axis=1), 0.01)

    np.testing.assert_allclose(of(50), 1e-4 / 12, rtol=1e-12)
    np.testing.assert_allclose(of(25, 25), 0, atol=1e-20)
    np.testing.assert_allclose(of(10, 40), (0.3 * 0.01) ** 2 / 3, rtol=1e-12)
    np.testing.assert_allclose(of(400, 100, 1), ((400 / 500 - 0.5) * 0.01) ** 2 / 3, rtol=1e-12)
    three = np.repeat([0.0, 0.01, 0.02], [30, 40, 30])
    expected = rounding.rounding_variance(0.01, np.sqrt(three.var() - 1e-4 / 12))
    np.testing.assert_allclose(of(30, 40, 30), expected, rtol=1e-12)
    np.testing.assert_array_equal(rounding.rounding_of_mean(np.zeros((9, 3)), 0.0), 0)


def test_half_of_what_rounding_hides_is_alike_in_all_turns_and_half_is_not():
    """Rests that read 0.00 throughout: 0.01 / sqrt(12) times the duration, as a whole, of a single turn."""
    t_ns, gyro, known = step()
    gyro[195:325, 0] = np.round(np.interp(np.arange(195, 325), [199, 219, 300, 320], [0, 60 * DEG, 60 * DEG, 0]), 2)
    gyro[200:320, 1] = np.round(0.02 * np.sin(np.arange(120)), 2)
    found = fitted(t_ns, gyro, [dataclasses.replace(known[0], angle_rad=60.6 * DEG)])
    (angle,) = found.angles
    whole = 1e-4 / 12
    assert angle.shared_rps2 == pytest.approx(whole / 2, rel=1e-9)
    assert angle.variance["rounding"] == pytest.approx(
        angle.duration_s**2 * whole * 1.5, rel=1e-9
    )  # a turn that does not shake hides as much
    total = angle.gyro_variance + angle.variance["vibration"] + angle.turn.sigma_rad**2 + angle.duration_s**2 * whole / 2
    assert found.scales[0].sigma == pytest.approx(np.sqrt(total) / angle.stated_rad, rel=1e-3)
    np.testing.assert_allclose(found.bias.sigma, np.sqrt(whole), rtol=1e-9)


def test_rests_that_differ_are_a_bias_that_wanders():
    t_ns, gyro, known = step()
    gyro[320:] += [0.0, 0.0, 0.004]
    found = fitted(t_ns, gyro, known)
    first, second = found.logs[0].rests
    assert found.noise.drift == pytest.approx([0, 0, 0.004**2 / (second.middle_s - first.middle_s)], rel=1e-9)
    np.testing.assert_allclose(found.bias.mean, [0, 0, 0.004 * 180 / 380], atol=1e-12)
    assert found.bias.wander[2] == pytest.approx(0.004 / np.sqrt(2), rel=2e-2)
    assert found.bias.sigma[2] == pytest.approx(0.004 / 2, rel=2e-2)
    (angle,) = found.angles
    z = angle.direction[2] ** 2
    lead = 1.99 - first.middle_s
    expected = angles.bridge_variance(found.noise.drift[2], lead, angle.duration_s, second.middle_s - first.middle_s)
    assert angle.variance["drift"] == pytest.approx(z * expected, rel=1e-9)


def test_white_noise_is_not_taken_for_a_bias_that_wanders():
    drift = [fitted(*step(noise=0.003, seed=seed)).noise.drift for seed in range(30)]
    chance = 0.003**2 / 200 * 2 / 2.5  # what two rests differ by, over the time between
    assert np.mean(drift) < 0.9 * chance  # a square with that mean, less the mean: what is above zero is 0.48 of it, more or less 0.13


def test_a_rest_that_scatters_beyond_chance_has_its_own_scatter():
    t_ns, gyro, known = step(noise=0.001)
    rough = gyro.copy()
    rough[:200] += np.repeat(0.002 * np.random.default_rng(3).normal(size=(20, 3)), 10, axis=0)
    logs = [folder.GyroLog(f"log{i}", t_ns, step(noise=0.001, seed=i)[1]) for i in range(8)] + [folder.GyroLog("log9", t_ns, rough)]
    turns = [dataclasses.replace(known[0], log=log.name) for log in logs]
    found = tinygc.fit_turns(turn_session(logs, turns))
    last = found.logs[-1].rests[0]
    own = last.blocks.var(axis=0, ddof=1) / len(last.blocks)
    assert found.angles[-1].rests[0][2] == pytest.approx(own @ found.angles[-1].direction ** 2, rel=1e-9)
    pooled = found.noise.white / (found.logs[0].rests[0].count * 0.01)
    assert found.angles[0].rests[0][2] == pytest.approx(pooled @ found.angles[0].direction ** 2, rel=1e-9)


def test_a_rest_that_hums_is_a_rest_and_one_that_shakes_is_none():
    t_ns, gyro, known = step(noise=0.0005)
    hum = np.sin(np.arange(500) * 2.0)
    quiet, loud = gyro.copy(), gyro.copy()
    quiet[320:, 1] += 2.5 * DEG * hum[320:]  # 1.8 dps rms, beside a turn at 60 dps
    loud[320:420, 1] += 6.0 * DEG * hum[320:420]
    ends = [fitted(t_ns, each, known).logs[0].rests[-1] for each in (quiet, loud)]
    assert ends[0].start in (320, 330)
    assert ends[1].start == 420
    slow = step(rate_dps=10.0, noise=0.0005)[1]  # of a slow turn less hum is a rest
    slow[320:420, 1] += 2.5 * DEG * hum[320:420]
    assert fitted(t_ns, slow, step(rate_dps=10.0)[2]).logs[0].rests[-1].start == 420


def test_the_rate_while_it_turns_is_its_usual_one():
    (angle,) = fitted(*step(noise=0.003)).angles
    assert angle.rate_rps == pytest.approx(60 * DEG, rel=0.01)
    found = tinygc.fit_turns(Turned(((2, 360, 80.0),), noise=0.002).session())
    assert found.angles[0].rate_rps == pytest.approx(80 * DEG, rel=0.01)


def test_the_covariance_of_the_model_is_that_of_scales_and_bias():
    found = tinygc.fit_turns(
        Turned(((0, 360, 90.0), (0, -360, 90.0), (2, 90, 90.0)), plus=(0.1, 0, -0.1), minus=(0.1, 0, 0), noise=0.01).session()
    )
    variance = np.diag(found.model_covariance)
    E = np.diag(found.model.E)
    np.testing.assert_allclose(variance[9:], (E * found.bias.sigma) ** 2, rtol=1e-12)
    x, z = found.axis_scales
    assert (x.sense, z.sense, x.turns) == (0, 1, 2)
    gains = found.covariance
    assert x.sigma**2 == pytest.approx((gains[0, 0] + gains[1, 1] + 2 * gains[0, 1]) / 4, rel=1e-12)
    assert variance[0] == pytest.approx((x.sigma / (1 + x.value) ** 2) ** 2, rel=1e-12)
    assert variance[8] == pytest.approx((z.sigma / (1 + z.value) ** 2) ** 2, rel=1e-12)
    np.testing.assert_allclose(variance[[1, 2, 3, 4, 5, 6, 7]], 0.2**2)
    assert np.count_nonzero(found.model_covariance) == 12


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
    assert clock.sample_times(t_ns).bursts
    found = fitted(t_ns, gyro, turned.known())
    (log,) = found.logs
    assert not log.times.bursts
    assert log.other.worse > 5
    assert log.other.apart_rad > 20 * DEG
    for angle in found.angles:
        assert angle.measured_rad == pytest.approx(1800 * DEG, abs=3 * DEG)
    assert "samples are lost, none came in bursts" in found.summary()


def test_where_no_turn_repeats_both_readings_are_stated():
    turned = Turned(((2, 1800, 300.0), (0, 1800, 300.0)), noise=0.002, odr_hz=200.0)
    found = fitted(*lossy(*turned.arrays()), turned.known())
    assert found.logs[0].times.bursts
    assert found.logs[0].other.is_open
    assert "its stamps are taken for those of bursts; as lost samples turns differ by up to" in found.summary()
