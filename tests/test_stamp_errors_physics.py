"""Errors of stamps: what rounding and jitter make of a turn, and what the readings say of them; and rates that change within a log."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from session.base.units import DEG, NS
from session.detect.stamp_errors import (
    StampErrors,
    _about_lines,
    _even_pieces,
    angle_rms,
    moved_by_stamps,
    rate_pieces,
    stamp_errors,
)
from session.log.samples import Samples
from tinygc.closure import residual
from tinygc.closure.floor import stamp_variance
from tinygc.closure.residual import Batch

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def turn(rate_hz=100.0, seconds=2.0):
    """A turn of some 200 degrees about an axis that moves, from rest to rest, as a batch of one segment."""
    share = np.arange(round(seconds * rate_hz) + 1) / round(seconds * rate_hz)
    speed = 200 * DEG / seconds * (1 - np.cos(2 * np.pi * share))
    axis = np.stack([np.cos(share), np.sin(share), 0.3 * share], axis=1)
    rate = (speed[:, None] * axis)[None]
    return Batch(rate, np.full((1, len(share) - 1), 1 / rate_hz), np.zeros_like(rate), IDENTITY[None], IDENTITY[None], yaw_known=True)


def end_of(batch, late_s):
    """Rotation vector (3,) rad, table axes, by which the end moves where each stamp is late by (T,) s."""
    moved = residual.end_attitude(replace(batch, dt=batch.dt + np.diff(late_s)), batch.rate)[0]
    right = Rotation.from_quat(residual.end_attitude(batch, batch.rate)[0], scalar_first=True)
    return (Rotation.from_quat(moved, scalar_first=True) * right.inv()).as_rotvec()


def white(sigma_s):
    return StampErrors(0.01, 0.0, np.array([sigma_s**2]), 0.0, 0.0)


def test_a_late_stamp_moves_the_end_by_the_change_of_the_rate_around_it():
    batch = turn()
    at = residual.attitudes(batch, batch.rate)
    late = np.zeros(batch.rate.shape[1])
    for sample in (0, 37, 100, 163, 200):
        late[:] = 0.0
        late[sample] = 1e-5
        variance = stamp_variance(batch, at, [white(1e-5)])[0]
        steps = Rotation.from_quat(at[0, :-1], scalar_first=True).apply((batch.rate[0, 1:] + batch.rate[0, :-1]) / 2)
        assert_allclose(end_of(batch, late), 1e-5 * moved_by_stamps(steps)[sample], atol=2e-9)
        assert_allclose(variance, 1e-10 * moved_by_stamps(steps).T @ moved_by_stamps(steps), rtol=1e-3, atol=1e-14)


def test_the_variance_is_the_sum_over_all_pairs_of_samples():
    moved, lags = np.random.default_rng(2).normal(size=(2, 30, 3)), 0.7 ** np.arange(40)
    pairs = lags[np.abs(np.subtract.outer(np.arange(30), np.arange(30)))]
    errors = StampErrors(0.01, 0.0, lags, 0.25, 0.0)
    assert_allclose(errors.variance(moved), 0.75 * np.einsum("ski,kl,slj->sij", moved, pairs, moved), rtol=1e-6)


@pytest.mark.parametrize(
    ("followed", "sigma", "grid_s", "share"),
    [
        (-0.5, 0.0, 0.0, 1.0),
        (0.25, 0.0, 0.0, 0.75),
        (1.5, 0.0, 0.0, 0.0),
        (0.25, np.inf, 0.0, 0.0),
        (0.9, 0.0, 0.01, 0.25),
        (0.9, 0.0, 1.0, 1.0),
    ],
)
def test_the_share_in_error_is_what_the_readings_did_not_follow_and_no_less_than_the_grids(followed, sigma, grid_s, share):
    assert StampErrors(0.01, grid_s, np.array([1e-4 / 3]), followed, sigma).share == pytest.approx(share)


def moving(moments_s, seed=1, noise_dps=0.05):
    """Readings (N, 3) rad/s at these moments of a hand that turns and rests."""
    share = np.clip(moments_s % 4 / 2, 0, 1)
    speed = 100 * (1 - np.cos(2 * np.pi * share))[:, None] * [1.0, -0.5, 0.3]
    return (speed + np.random.default_rng(seed).normal(size=(len(moments_s), 3)) * noise_dps) * DEG


def of(stamps_s, gyro):
    return Samples(np.rint(stamps_s * 1e9).astype(np.int64), gyro, np.zeros_like(gyro))


@pytest.mark.parametrize("rate_hz", [50.0, 104.2])
def test_the_readings_tell_stamps_that_err_from_samples_that_were_uneven(rate_hz):
    rng, true_s = np.random.default_rng(3), np.arange(round(120 * rate_hz)) / rate_hz
    jitter_s = np.abs(rng.normal(0, 0.1 / rate_hz, len(true_s)))
    late = stamp_errors(of(true_s + jitter_s, moving(true_s)), 5.0)
    uneven = stamp_errors(of(true_s + jitter_s, moving(true_s + jitter_s)), 5.0)
    assert late.resolved
    assert uneven.resolved
    assert late.share == pytest.approx(1, abs=4 * late.sigma + 0.01)
    assert uneven.share == pytest.approx(0, abs=4 * uneven.sigma + 0.01)
    assert late.scatter_s == pytest.approx(jitter_s.std(), rel=0.02)


def test_a_clock_that_wanders_slowly_does_not_scatter_and_one_that_rounds_does():
    true_s = np.arange(12_000) / 100.3
    wanders = stamp_errors(of(true_s + 0.05 * np.sin(true_s / 60), moving(true_s)), 5.0)
    assert wanders.scatter_s < 1e-3 * 0.05
    rounds = stamp_errors(of(np.rint(true_s * 1e3) / 1e3, moving(true_s)), 5.0)
    assert rounds.grid_s == pytest.approx(1e-3)
    assert rounds.scatter_s == pytest.approx(1e-3 / np.sqrt(12), rel=0.02)
    assert rounds.share == pytest.approx(1, abs=0.1)
    unmoved = stamp_errors(of(np.rint(true_s * 1e3) / 1e3, moving(true_s) * 0), 5.0)
    assert not unmoved.resolved
    assert unmoved.share == pytest.approx(1, abs=0.05)  # what the grid makes is error, whatever the readings tell


def test_lost_samples_are_no_scatter():
    true_s = np.arange(12_000) / 100.0
    kept = np.random.default_rng(4).random(len(true_s)) > 0.03
    kept[5000:5100] = False
    errors = stamp_errors(of(true_s[kept], moving(true_s)[kept]), 5.0)
    assert errors.scatter_s * errors.share**0.5 < 1e-5


def test_off_lines_of_a_bent_clock():
    """Stamps a k^2 are off a line through r rows on either side by a r (r + 1) / 3, whatever their rate."""
    count, reach = np.arange(60), np.minimum(7, np.minimum(np.arange(60), np.arange(60)[::-1]))
    off = _about_lines(5_000 + 2_000_000 * count + 300 * count**2, count, 7)
    assert_allclose(off, -300e-9 * reach * (reach + 1) / 3, atol=1e-15)


def test_scatter_and_what_the_readings_followed_by_numpy_and_scipy():
    """A slope over nine rows, fourth differences, sums of sixteen rows and three axes; rows behind the last whole sixteen do not count."""
    rng, count = np.random.default_rng(8), np.arange(127)
    stamps = 10_000_000 * count + 2000 * rng.integers(-500, 500, 127)
    gyro = np.cumsum(rng.normal(size=(127, 3)), axis=0) * np.clip(np.minimum(count, count[::-1]) / 20, 0, 1)[:, None]
    samples = of(stamps * NS, gyro)
    errors, period_s = stamp_errors(samples, 0.2), samples.period_s
    off = _about_lines(stamps, count, 20)
    assert_allclose(errors.covariance, np.correlate(off, off, "full")[126:147] / 127, rtol=1e-9, atol=1e-15)
    assert (errors.grid_s, errors.scatter_s) == (pytest.approx(2e-6), pytest.approx(np.sqrt(np.mean(off**2))))
    slope = savgol_filter(gyro, 9, 1, deriv=1, delta=period_s, axis=0, mode="constant")
    went, read = (np.diff(each, 4, axis=0) / 6 for each in (slope * off[:, None], gyro))
    power, product = ((each[:112] * went[:112]).reshape(7, -1).sum(axis=1) for each in (went, read))
    followed = product.sum() / power.sum()
    assert (errors.followed, errors.sigma) == (
        pytest.approx(followed, rel=1e-6),
        pytest.approx(np.linalg.norm(product - followed * power) / power.sum(), rel=1e-6),
    )


@pytest.mark.parametrize(("period_ns", "tick_ns"), [(10**7, 1), (1_200_000, 10**6)])
def test_even_pieces_end_at_gaps_and_at_changes_and_count_single_losses(period_ns, tick_ns):
    """Of a coarse clock a single loss is a gap; a second on either side of a change is left out."""
    kept = np.ones(6000, dtype=bool)
    kept[500], kept[3000:3100], coarse = False, False, tick_ns > 1
    t_ns = (period_ns * np.arange(6000))[kept] // tick_ns * tick_ns
    samples = of(t_ns * NS, np.zeros((len(t_ns), 3)))
    assert samples.pace.coarse == coarse

    def ends(*rates):
        return [(piece.start, piece.stop, count[0], count[-1] - len(count) + 1) for piece, count in _even_pieces(samples, rates)]

    whole, margin = len(t_ns), round(1 / samples.period_s)
    first = [(0, 500, 0, 0), (500, 2999, 0, 0)] if coarse else [(0, 2999, 0, 1)]
    assert ends((0, whole)) == [*first, (2999, whole, 0, 0)]
    assert ends((0, 2500), (2500, whole)) == [
        *[(start, min(stop, 2500 - margin), *counts) for start, stop, *counts in first],
        *([(2500 + margin, 2999, 0, 0)] if 2500 + margin < 2999 else []),
        (max(2999, 2500 + margin), whole, 0, 0),
    ]
    assert ends((0, margin + 19)) == []
    assert ends((0, margin + 20)) == [(0, 20, 0, 0)]


def test_the_rate_of_a_log_is_that_of_parallel_lines():
    """By numpy: one slope, a start for each of two pieces; the sigma is that of errors that go together."""
    rng, count = np.random.default_rng(9), np.r_[:400, 450:700]
    t_s = 0.01 * count + rng.normal(0, 2e-4, len(count))
    samples = of(t_s - t_s[0], np.zeros((len(count), 3)))
    (piece,) = rate_pieces(samples)
    design = np.column_stack([count, count < 400, count >= 400]).astype(float)
    (slope, *_), (left,), *_ = np.linalg.lstsq(design, t_s, rcond=None)
    square = sum(np.var(part) * len(part) for part in (count[:400], count[400:]))
    assert (piece.start, piece.stop, piece.hz) == (0, 650, pytest.approx(1 / slope, rel=1e-8))
    assert piece.sigma_hz == pytest.approx(np.sqrt(left / square) / slope**2, rel=1e-5)
    (short,) = rate_pieces(of(np.arange(10) * 0.01, np.zeros((10, 3))))
    assert (short.hz, short.sigma_hz) == (pytest.approx(100), np.inf)


def test_a_change_of_a_log_of_a_few_rows_a_minute_is_found_to_the_row():
    slow, slower = rate_pieces(of(np.cumsum([0.0] + [4.0] * 149 + [5.0] * 150), np.zeros((300, 3))))
    assert (slow.hz, slower.hz, slow.stop, slower.start) == (pytest.approx(0.25), pytest.approx(0.2), 149, 149)


def test_the_angle_of_a_log_is_that_of_its_turns():
    """White jitter: by the sums of squares of the changes of the rate, of the worst axis."""
    gyro = np.random.default_rng(5).normal(size=(25, 3)) * [1, 2, 1]
    change = (gyro[2:] - gyro[:-2]) / 2
    expected = 1e-3 * np.sqrt((change**2).sum(axis=0).max() / 0.25 * 5.0)
    assert angle_rms(of(np.arange(25) * 0.01, gyro), white(1e-3), 5.0) == pytest.approx(expected)


@pytest.mark.parametrize(("rate_hz", "slower", "jitter_s"), [(100.0, 0.08, 0.0), (52.0, 0.002, 0.0), (93.4, 0.03, 2e-3)])
def test_a_rate_that_changes_is_found_with_its_times(rate_hz, slower, jitter_s):
    count = np.arange(round(150 * rate_hz))
    between = (count > 50 * rate_hz) & (count < 100 * rate_hz)
    stamps_s = np.cumsum(np.where(between, 1 + slower, 1.0)) / rate_hz
    stamps_s = stamps_s + np.abs(np.random.default_rng(5).normal(0, jitter_s, len(count)))
    found = rate_pieces(samples := of(stamps_s, np.zeros((len(count), 3))))
    assert rate_pieces(samples.with_accel(samples.accel + 1)) is found  # of the stamps alone, and once
    assert [piece.hz for piece in found] == pytest.approx([rate_hz, rate_hz / (1 + slower), rate_hz], rel=5e-4)
    assert [piece.start / rate_hz for piece in found] == pytest.approx([0, 50, 100], abs=1.5)


def test_pieces_whose_lines_agree_are_one():
    """A rate that is 0.06 % less in the last fifteen seconds, by stamps that scatter by 1 ms."""
    count = np.arange(15_000)
    stamps_s = np.cumsum(np.where(count > 13_500, 1.0006, 1.0)) / 100 + np.random.default_rng(5).normal(0, 1e-3, 15_000)
    samples = of(np.sort(stamps_s), np.zeros((15_000, 3)))
    (whole,) = rate_pieces(samples)
    slope = np.polyfit(count, samples.t_s, 1)[0]
    assert (whole.start, whole.stop, whole.hz) == (0, 15_000, pytest.approx(1 / slope, rel=1e-9))


def test_a_rate_that_wanders_or_rounds_does_not_change():
    true_s = np.arange(20_000) / 100.01
    for stamps_s in (true_s * (1 + 1e-5 * true_s), np.rint(true_s * 1e3) / 1e3, true_s + 0.02 * np.random.default_rng(6).random(20_000)):
        assert len(rate_pieces(of(np.sort(stamps_s), moving(true_s)))) == 1
