"""A truth's clock and mounting with their sigmas, on half a minute of smooth motion: beside numeric derivatives and scipy's rotations."""

from dataclasses import replace
from itertools import combinations_with_replacement, pairwise
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG
from numpy.testing import assert_allclose
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from session.log.config import Accelerometer, Config, Protocol, Sensor, Site
from session.log.folder import Session
from session.log.logfile import Log
from session.log.samples import Samples
from tinygc.features.truth.alignment import (
    AlignedLog,
    Spans,
    _best_way,
    _frame_of,
    _rough_offset,
    _solved,
    _spans_of,
    _Way,
    _within,
    align,
    alignment_table,
    carried,
    refined,
    ways,
)
from tinygc.features.truth.points import TruthFiles
from tinygc.features.truth.reading import FRAMES, ORDERS, SENSES, Truth, TruthGiven, TruthReading, changed, down_of

E = np.eye(3) + 0.01 * np.array([[1, -1, 0.5], [0.3, -0.5, 1], [-0.7, 0.2, 0.7]])


BIAS = np.array([0.5, -0.3, 0.6]) * DEG


HZ, FINE = 100, 8


def rate_at(t_s):
    """(N, 3) rad/s: slow waves, none of which is another's."""
    waves = [np.sin(2 * np.pi * f * t_s + p) for f, p in ((0.31, 0.2), (0.23, 1.1), (0.41, 2.0), (0.17, 0.5), (0.13, 2.5), (0.29, 1.9))]
    return np.stack([1.2 * waves[0] + 0.5 * waves[3], 1.0 * waves[1] - 0.6 * waves[4], 0.9 * waves[2] + 0.4 * waves[5]], axis=1)


def rotation(q):
    return Rotation.from_quat(q, scalar_first=True)


@pytest.fixture(scope="module")
def moved():
    """t_s and attitudes q_nb at fine steps of half a minute, from the rate in their middle."""
    t_s = np.arange(30 * HZ * FINE) / (HZ * FINE)
    q = [Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()]
    for step in Rotation.from_rotvec(rate_at(t_s[:-1] + 0.5 / (HZ * FINE)) / (HZ * FINE)).as_matrix():
        q.append(q[-1] @ step)
    return t_s, Rotation.from_matrix(q)


def made(moved, late_s=0.0, mounting=(0, 0, 0), noise_deg=0.02, seed=0, reading=TruthReading(), given=TruthGiven(), every=40, E=E):  # noqa: B008
    """A session whose truth has a moment each ``every`` fine steps, with stamps that are late and a noise of its angles."""
    rng, (t_s, q) = np.random.default_rng(seed), moved
    own = slice(None, None, FINE)
    gyro = np.linalg.solve(E, (rate_at(t_s[own]) - BIAS).T).T
    samples = Samples(np.rint(t_s[own] * 1e9).astype(np.int64) + 5_000_000_000, gyro, q[own].inv().apply([0, 0, -9.8]))
    moments = np.arange(every, len(t_s) - every, every)
    truth = q[moments] * Rotation.from_rotvec(noise_deg * DEG * rng.normal(size=(len(moments), 3)))
    truth = truth * Rotation.from_rotvec(np.multiply(mounting, DEG)).inv()
    written = reading.written(truth.as_quat(scalar_first=True))
    stamps = samples.t_ns[0] + np.rint((t_s[moments] + late_s) * 1e9).astype(np.int64)
    cells = Truth(Path("truth0001.csv"), stamps, TruthReading.of(given).read(written))
    return Session(Path("made"), made_config(given), (Log(Path("log0001.csv"), samples),), (), reference=TruthFiles((cells,), 0.1))


def made_config(given=TruthGiven()):  # noqa: B008
    sensor = Sensor("unknown", "", HZ, 500.0, 4.0)
    return Config(sensor, Accelerometer(), Site(), Protocol(segment_s=2.0, reference="truth"), sections={"truth": given})


def seen_of(session):
    (log,), (truth,) = session.logs, session.reference.truths
    spans = _spans_of(log.samples, truth)
    return AlignedLog(carried(log.samples, log.samples.gyro), spans, truth.q_nb, log.samples.accel), log.samples


def log_of(t_s, rate):
    return carried(Samples(np.rint(t_s * 1e9).astype(np.int64), rate, rate), rate)


def test_a_log_is_carried_by_mean_rates_with_the_coning_of_a_straight_one():
    rate = rate_at(np.arange(4) * 0.2)
    log = log_of(np.arange(4) * 0.2, rate)
    first, second, third = (Rotation.from_rotvec(0.1 * (a + b) + 0.04 / 12 * np.cross(a, b)) for a, b in pairwise(rate))
    later = Rotation.from_rotvec(0.05 * rate[2] + 0.05**2 / 2 * (rate[3] - rate[2]) / 0.2)
    for t_s, expected in ((0.6, first * second * third), (0.45, first * second * later)):
        assert (rotation(log.at(np.array([t_s]))) * expected.inv()).magnitude() < 1e-12


def test_a_rate_is_straight_between_samples_and_holds_beyond_the_first_and_the_last():
    """About one axis, where the angle is an integral."""
    knots_s, knots, axis = np.arange(4.0), np.array([0.3, 1.0, 0.5, -1.2]), [0.0, 0.6, 0.8]
    log = log_of(knots_s, np.outer(knots, axis))
    fine = np.linspace(-0.6, 3.6, 42001)
    angle = np.concatenate([[0.0], np.cumsum(np.interp((fine[1:] + fine[:-1]) / 2, knots_s, knots)) * 1e-4])
    at = np.array([-0.5, 0.0, 0.2, 0.4, 0.6, 1.3, 2.0, 2.7, 3.0, 3.5])
    expected = np.outer(np.interp(at, fine, angle) - np.interp(0.0, fine, angle), axis)
    assert_allclose(rotation(log.at(at)).as_rotvec(), expected, atol=1e-7)
    assert_allclose(log.rate_at(at), np.outer(np.interp(at, knots_s, knots), axis), atol=1e-12)
    begin, end = np.array([-0.99, -1.01, 0.4, 0.4, 2.6, 2.1]), np.array([3.99, 2.0, 0.6, 0.45, 4.01, 2.9])
    assert log.whole(begin, end).tolist() == [True, False, True, False, False, True]  # by a period beyond; between two samples at least


@pytest.mark.parametrize(("periods", "share"), [(1.4, 0.4), (1.6, 0.0)])
def test_in_a_gap_of_more_than_one_and_a_half_periods_there_is_no_rate_and_no_span_across(periods, share):
    rate, row = np.random.default_rng(0).normal(size=(200, 3)), np.arange(200)
    log = log_of(0.01 * (row + (periods - 1) * (row > 100)), rate)
    assert log.whole(np.array([0.5]), np.array([1.5]))[0] == (share > 0)
    assert_allclose(log.rate_at(np.array([1 + 0.004 * periods]))[0], rate[100] + share * (rate[101] - rate[100]), atol=1e-9)


def truth_between(truth, first, stop):
    return replace(truth, t_ns=truth.t_ns[first:stop], q_nb=truth.q_nb[first:stop])


def test_a_span_is_half_a_second_from_every_moment_within_a_window():
    samples = Samples(np.arange(100) * 10**9, np.zeros((100, 3)), np.zeros((100, 3)))
    stamps = np.array([0.0, 0.2, 0.4, 0.4996, 0.7, 1.0, 11.1, 21.0, 21.1, 21.7])  # 10.1 and 9.9 s without a moment
    truth = Truth(Path("t"), np.rint((stamps + 3) * 1e9).astype(np.int64), np.tile([1.0, 0, 0, 0], (10, 1)))
    spans = _spans_of(samples, truth)
    assert [*zip(spans.first, spans.last, strict=True)] == [(0, 3), (1, 4), (2, 5), (3, 5), (6, 7), (7, 9), (8, 9)]
    assert_allclose(spans.begin_s, stamps[spans.first] + 3)
    assert_allclose(spans.end_s, stamps[spans.last] + 3)
    windows = _spans_of(samples, replace(truth, window=np.array([0] * 4 + [1] * 6)))
    assert [*zip(windows.first, windows.last, strict=True)] == [(0, 3), (6, 7), (7, 9), (8, 9)]
    assert len(_spans_of(samples, truth_between(truth, 0, 1))) == 0
    assert _spans_of(samples, truth, most=3).first.tolist() == [0, 3, 8]
    assert _spans_of(samples, truth, most=7).first.tolist() == spans.first.tolist()


@pytest.mark.parametrize("wild", [False, True])
def test_clock_and_mounting_have_the_covariance_of_leaving_out_blocks(moved, wild):
    """At the end of Gauss-Newton the weighted errors stand at right angles to the numeric derivatives, and what they become without
    each block of 1.4 s (a twentieth of the session) scatters as the sigmas say.  A wild moment, one of forty, counts by Huber's weight."""
    session = made(moved, late_s=0.0123, mounting=(3, -2, 1))
    (truth,) = session.reference.truths
    if wild:
        q = truth.q_nb.copy()
        q[20::40] = (rotation(q[20::40]) * Rotation.from_rotvec([0.02, 0, 0])).as_quat(scalar_first=True)
        session = changed(session, truths=(replace(truth, q_nb=q),))
    one, samples = seen_of(session)
    start = TruthReading(mounting=Rotation.from_rotvec(np.multiply((3.3, -2.2, 0.8), DEG)).as_matrix(), offset_s=-0.01)
    found = refined([one], [samples], start)
    attitudes, spans = rotation(one.written), one.spans
    turned = attitudes[spans.first].inv() * attitudes[spans.last]
    # The gyro's matrix and bias at that offset and mounting: by least squares of what is left, robustly, as nuisance.
    symmetric = [np.outer(a, b) + np.outer(b, a) for a, b in combinations_with_replacement(np.eye(3), 2)]

    def of(theta):
        """The gyro's turns, against the truth's in the gyro's axes."""
        mounting = Rotation.from_matrix(found.mounting) * Rotation.from_rotvec(theta[1:4])
        matrix = np.eye(3) + np.tensordot(theta[4:10], symmetric, axes=1)
        log = carried(samples, samples.gyro @ matrix.T + theta[10:])
        begin, end = (rotation(log.at(t_s + found.offset_s + theta[0])) for t_s in (spans.begin_s, spans.end_s))
        return (begin.inv() * end * (mounting.inv() * turned * mounting).inv()).as_rotvec()

    def steps(slope, left, weight):
        return np.linalg.solve(np.einsum("kip,k,kiq->pq", slope, weight, slope), np.einsum("kip,k,ki->p", slope, weight, left))

    theta = np.zeros(13)
    for _ in range(2 + wild):
        left = of(theta)
        slope = np.stack([(of(theta + step) - left) / 1e-5 for step in 1e-5 * np.eye(13)], axis=-1)
        length = np.linalg.norm(left, axis=1)
        weight = 1 / (1 + (length / (3 * np.median(length))) ** 2)
        theta = theta - steps(slope, left, weight)
    begin = spans.begin_s + found.offset_s
    length = (begin[-1] - begin[0]) / 20
    block = ((begin - begin[0]) // length).astype(int)
    without = [steps(slope, left, weight * (block != number)) for number in range(block.max() + 1)]
    apart = without - steps(slope, left, weight)
    errors = left * np.sqrt(weight)[:, None]
    lags = sum(np.correlate(each, each, "full") for each in errors.T)[len(left) :] / np.sum(errors**2)
    T = (0.5 + lags[: np.flatnonzero(lags <= 0)[0]].sum()) * np.median(np.diff(begin)) / length
    covariance = apart.T @ apart * (len(apart) - 1) / len(apart) / (1 - T * (1 - np.exp(-1 / T)))
    sigma = np.sqrt(np.diag(covariance))
    assert np.abs(theta[:4] / sigma[:4]).max() < 0.1
    assert_allclose([found.offset_sigma_s, *found.mounting_sigma], sigma[:4], rtol=0.01)
    # And they hold what is off: the mounting that is to be found has the antisymmetric part of the gyro's own matrix in it.
    assert abs(found.offset_s + 0.0123) < 4 * found.offset_sigma_s < 4e-4


@pytest.mark.parametrize("lasts", [0.05, 2.0])
def test_errors_that_go_on_from_moment_to_moment_widen_the_sigma(lasts):
    """The mean of an autoregression of first order, whose variance is known, over many draws; blocks of ten seconds."""
    every, count, stated = 0.1, 2000, []
    keep = np.exp(-every / lasts)
    for seed in range(60):
        drawn = np.random.default_rng(seed).standard_normal((count, 3)) * np.sqrt(1 - keep**2)
        drawn[0] /= np.sqrt(1 - keep**2)
        errors = lfilter([1.0], [1.0, -keep], drawn, axis=0)
        errors[100::200] = 30 * (-1.0) ** np.arange(10)[:, None]  # a few wild ones say nothing of that
        _, covariance = _solved(errors, np.ones((count, 3, 1)), np.arange(count) // 100, 10.0, every)
        stated.append(covariance[0, 0])
    lag = np.arange(1, count)
    true = (1 + 2 * np.sum((1 - lag / count) * keep**lag)) / count / 3
    assert np.mean(stated) == pytest.approx(true, rel=0.12)  # of 60 draws with 19 degrees of freedom 4 %, and Huber's weights
    T = 0.25 * (0.5 + 3 / 4 + 2 / 4 + 1 / 4)
    assert _within(np.ones((4, 3)), 0.25) == pytest.approx(1 - T * (1 - np.exp(-1 / T)), rel=1e-12)


def test_what_one_block_alone_fixes_is_not_known():
    """A column that all but one block lack: without it there is nothing left."""
    columns = np.zeros((200, 3, 1))
    columns[:10] = 1.0
    assert _solved(np.random.default_rng(0).normal(size=(200, 3)), columns, np.arange(200) // 10, 1.0, 0.1) is None


def test_too_few_spans_or_a_motion_that_fixes_nothing_are_refused(moved):
    for seconds, enough in ((10.15, True), (10.1, False)):  # twenty spans that do not overlap, and nineteen
        count = round(seconds * HZ * FINE)
        one, samples = seen_of(made((moved[0][:count], moved[1][:count])))
        assert (refined([one], [samples], TruthReading()) is not None) == enough
    one, samples = seen_of(made(moved))
    still = replace(samples, gyro=np.zeros_like(samples.gyro))
    none = replace(one, gyro=carried(still, still.gyro), written=np.tile([1.0, 0, 0, 0], (len(one.written), 1)))
    assert refined([none], [still], TruthReading()) is None


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
@pytest.mark.parametrize("sense", ["body_to_world", "world_to_body"])
def test_every_way_is_tried_and_the_one_that_explains_all_is_best(moved, order, sense):
    """The gyro's turns are the truth's behind the mounting; of an upright world gravity is all of what the log feels."""
    reading = TruthReading(order, sense, "enu")
    one, _ = seen_of(made(moved, mounting=(10, -20, 5), noise_deg=0.0, reading=reading))
    found = ways([one], TruthGiven(frame="enu"), 0.0)
    assert [(way.reading.order, way.reading.sense) for way in found] == [
        (o, s) for o in ("wxyz", "xyzw") for s in ("body_to_world", "world_to_body")
    ]
    right = next(way for way in found if (way.reading.order, way.reading.sense) == (order, sense))
    assert right.misfit < 2e-3
    # Its matrix of 1 % is the rotation nearest to it; a constant bias is taken off.
    left = Rotation.from_matrix(right.reading.mounting) * Rotation.from_rotvec(np.multiply((10, -20, 5), DEG)).inv()
    assert left.magnitude() < 1.5 * DEG
    assert _frame_of(right) == "enu"
    assert right.mounted == pytest.approx(Rotation.from_matrix(right.reading.mounting).magnitude())
    assert [way.reading.sense for way in ways([one], TruthGiven(sense=sense, order=order), 0.0)] == [sense]
    kept = ways([one], TruthGiven(frame="enu", mounting=np.eye(3)), 0.0)
    assert all((way.reading.mounting == np.eye(3)).all() for way in kept)


def test_a_span_of_more_than_a_quarter_turn_is_not_looked_at():
    """Neither of the truth's nor of the gyro's: here about one axis at constant rates, the shares by hand, which no scale changes."""
    t_ns = np.arange(3001) * 10**7

    def turning(gyro, truth):
        """rad of each span of half a second"""
        rate, moments = np.outer(np.full(3001, 2 * gyro), [1, 0, 0]), np.arange(0, 30.0, 0.5)
        cells = Truth(
            Path("t"),
            np.rint(moments * 1e9).astype(np.int64),
            Rotation.from_rotvec(np.outer(2 * truth * moments, [1, 0, 0])).as_quat(scalar_first=True),
        )
        samples = Samples(t_ns, rate, np.zeros((3001, 3)))
        return AlignedLog(carried(samples, rate), _spans_of(samples, cells), cells.q_nb, samples.accel)

    given = TruthGiven(order="wxyz", sense="body_to_world", mounting=np.eye(3))
    for scale in (1.0, 0.01):
        logs = [turning(scale, scale)] * 3 + [turning(0.1 * scale, 0.3 * scale)]
        assert ways(logs, given, 0.0)[0].misfit == pytest.approx(0.2**2 / (3 + 0.3**2))
    plain, other = turning(1.0, 1.0), turning(0.1, 0.3)
    for gyro, truth, counts in ((1.57, 1.57, 1), (1.57, 1.5, 1), (1.58, 1.2, 0), (1.2, 1.58, 0)):
        (way,) = ways([plain, plain, plain, other, turning(gyro, truth)], given, 0.0)
        left, size = 0.2**2 + counts * (gyro - truth) ** 2, 3 + 0.3**2 + counts * truth**2
        assert way.misfit == pytest.approx(left / size)


def test_the_contracts_own_way_stands_unless_another_leaves_less_than_half():
    def way(misfit, up=(0, 0, 1), mounted=0.0):
        mounting = Rotation.from_rotvec([mounted, 0, 0]).as_matrix()
        return _Way(TruthReading(mounting=mounting), misfit, None if up is None else np.array(up))

    for up, more in ((None, 0.0), ((0, 0, 1), 0.0), ((0.6, 0, 0), 0.64), ((2.0, 0, 0), 0.0)):
        assert way(0.1, up).cost == pytest.approx(0.1 + more)
    own, turned, unknown = way(0.2), way(0.01, mounted=1.0), way(0.01, None)
    lying, upright, leaning = way(0.01, (0, 1.0, 0)), way(0.012, (0, 0, -1.0), 0.04), way(0.012, (0, 0, -1.0), 0.06)
    for others, best in (
        ([way(0.2 * 0.499)], 0),
        ([way(0.2 * 0.501)], -1),
        # Of those as good to 0.02, the least mounting, to a tenth of a rad; then the one whose up lies along its z axis.
        ([turned, way(0.01 + 0.0199)], 1),
        ([turned, way(0.01 + 0.0201)], 0),
        ([lying, upright], 1),
        ([unknown, upright], 1),
        ([unknown, lying], 0),  # an up that is not known counts as one that lies across
        ([lying, unknown], 0),
        ([lying, leaning], 0),
    ):
        assert _best_way([own, *others]) is [*others, own][best]


@pytest.mark.parametrize(("length", "tilt_deg", "known"), [(0.701, 0, True), (0.699, 0, False), (1.0, 25.8, True), (1.0, 25.9, False)])
def test_a_world_is_known_by_an_up_that_is_steady_and_near_an_axis(length, tilt_deg, known):
    """0.7 of the mean force's length, and a cosine of 0.9."""
    for frame in FRAMES:
        up = -down_of(frame)
        across = np.roll(up, 1)
        tilted = np.cos(tilt_deg * DEG) * up + np.sin(tilt_deg * DEG) * across
        assert _frame_of(_Way(TruthReading(), 0.0, length * tilted)) == (frame if known else None)
    assert _frame_of(_Way(TruthReading(), 0.0, None)) is None


def spinning(likeness, moments=120, samples=580):
    """A gyro that turns about one axis at random rates, and the spans of a truth that turns about another, of one and of two steps of
    10 ms by turns: its speeds have these coefficients of correlation with the gyro's, by steps of offset."""
    rng = np.random.default_rng(3)
    t_ms = np.arange(2 * samples - 1) * 5 + np.arange(2 * samples - 1) % 2  # 6 and 4 ms
    rate = np.outer(rng.uniform(0.5, 1.5, len(t_ms)), [0.6, 0.0, -0.8])
    angle = np.concatenate([[0.0], np.cumsum((rate[1:, 0] + rate[:-1, 0]) / 1.2 * np.diff(t_ms) * 1e-3)])[::2]
    first = np.arange(moments) + 250
    last = first + 1 + first % 2
    speed = [(angle[np.minimum(last + step, samples - 1)] - angle[first + step]) / ((last - first) * 0.01) for step in likeness]
    basis, _ = np.linalg.qr(np.column_stack([np.ones(moments), *speed, rng.normal(size=moments)]))
    theirs = np.array([x - x.mean() for x in speed])
    theirs /= np.linalg.norm(theirs, axis=1, keepdims=True)
    wanted = np.linalg.solve(theirs @ theirs.T, list(likeness.values())) @ theirs
    wanted += np.sqrt(max(1 - wanted @ wanted, 0.0)) * basis[:, -1]
    rates = (2.0 + 1.0 * wanted) * (last - first) * 0.01
    q = Rotation.from_rotvec(np.outer(rates, [0, 1, 0])).as_quat(scalar_first=True)
    log = carried(Samples(t_ms * 10**6, rate, rate), rate)
    return log, (Spans(first * 0.01, last * 0.01, first, last), q)


@pytest.mark.parametrize(
    ("likeness", "found"),
    [
        ({20: 0.7001}, 0.2),
        ({20: 0.6999}, None),
        ({-200: 0.75}, -2.0),
        ({201: 0.75}, None),
        # The nearer of two as good: of what is left of likeness, by half more at most.
        ({30: 0.75, -12: 0.626}, -0.12),
        ({30: 0.75, -12: 0.624}, 0.3),
        # A peak is the best of five steps on either side.
        ({16: 0.71, 10: 0.66}, 0.1),
        ({15: 0.71, 10: 0.66}, 0.15),
        ({-16: 0.71, -10: 0.66}, -0.1),
        ({-15: 0.71, -10: 0.66}, -0.15),
    ],
)
def test_the_nearest_of_the_peaks_that_are_as_good_is_the_clock(likeness, found):
    log, pair = spinning(likeness)
    offset_s = _rough_offset([log], [pair])
    assert offset_s == (found if found is None else pytest.approx(found))


def test_an_offset_is_adopted_from_six_of_its_sigmas_and_a_mounting_from_two_degrees(moved):
    none = align(made(moved)).reference.alignment
    for sigmas, adopted in ((5.95, "assumed"), (6.05, "found")):
        late_s = none.offset_s - sigmas * none.offset_sigma_s  # another truth of the same noise, later by so much
        found = align(made(moved, late_s=late_s)).reference.alignment
        assert found.source["offset_s"] == adopted, found.offset_s / found.offset_sigma_s
        assert found.reading.offset_s == (found.offset_s if adopted == "found" else 0)
        assert 0.99 < found.explained < 1
    for size, adopted in ((1.99, "assumed"), (2.01, "found")):
        extra = Rotation.from_rotvec([0, 0, size * DEG]) * Rotation.from_rotvec(none.turned).inv()
        found = align(made(moved, mounting=extra.as_rotvec() / DEG)).reference.alignment
        assert found.source["mounting"] == adopted, np.linalg.norm(found.turned) / DEG
    table = alignment_table(found)
    assert_allclose(table["gyro_to_truth_deg"], found.turned / DEG)
    assert_allclose(table["gyro_to_truth_std_deg"], found.turned_sigma / DEG)
    assert (table["offset_s"], table["offset_std_s"], table["up"] is found.up) == (found.offset_s, found.offset_sigma_s, True)


def test_a_truth_that_explains_less_than_half_of_the_turns_is_none_of_this_gyros(moved):
    upside_down = made(moved, mounting=(0, 0, 90), given=TruthGiven(mounting=np.eye(3)))  # as fast at each moment, about other axes
    found = align(upside_down).reference.alignment
    assert (np.isnan(found.explained), np.isnan(found.offset_s), alignment_table(found)["up"]) == (True, True, None)


def test_a_sample_without_a_force_does_not_tell_which_way_is_up(moved):
    """Not by the accelerometer's bias either; and a force is a force, however small."""
    session = made(moved)
    (log,) = session.logs
    bias = 1e-4 * np.array([3.0, -2.0, 4.0])
    accel = np.where(np.arange(len(log.samples))[:, None] % 3 > 0, 1e-4 * log.samples.accel + bias, 0.0)
    config = replace(session.config, accelerometer=Accelerometer(bias_mps2=bias))
    found = align(replace(session, config=config, logs=(replace(log, samples=replace(log.samples, accel=accel)),))).reference.alignment
    assert_allclose(found.up, [0, 0, -1], atol=2e-3)
    assert found.source["frame"] == "found"


def test_ten_spans_are_looked_at_and_a_given_clock_is_where_it_is_said(moved):
    session = made(moved, late_s=0.3)
    (truth,) = session.reference.truths
    assert np.isfinite(align(changed(session, truths=(truth_between(truth, 100, 120),))).reference.alignment.explained)
    # With too few spans for a sigma a given clock is kept as it is, unless the recording stands farther off than one step of the search.
    for off_ms, kept_ms in ((11, 11), (-9, -9), (21, 1), (-19, 1)):
        given, later = TruthGiven(offset_s=-0.3 + off_ms * 1e-3), replace(truth, t_ns=truth.t_ns + (off_ms - 300) * 10**6)
        few = changed(replace(session, config=replace(session.config, sections={"truth": given})), truths=(truth_between(later, 100, 120),))
        assert align(few).reference.alignment.offset_s == pytest.approx(-0.3 + kept_ms * 1e-3), off_ms
    given = TruthGiven(offset_s=-0.301)
    stated = replace(truth, t_ns=truth.t_ns - 301_000_000)
    found = align(
        changed(replace(session, config=replace(session.config, sections={"truth": given})), truths=(stated,))
    ).reference.alignment
    assert (found.source["offset_s"], found.reading.offset_s) == ("given", -0.301)
    assert abs(found.offset_s + 0.3) < 5 * found.offset_sigma_s


def matrix_of(q):
    return rotation(q).as_matrix()


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("sense", SENSES)
@pytest.mark.parametrize("frame", FRAMES)
def test_what_is_written_is_read_and_written_again(order, sense, frame):
    q = Rotation.random(20, random_state=1).as_quat(scalar_first=True)
    reading = TruthReading(order, sense, frame, Rotation.random(random_state=2).as_matrix(), 0.1)
    assert np.abs(np.abs(np.sum(reading.read(reading.written(q)) * q, axis=1)) - 1).max() < 1e-14
    # By matrices: the file's world has its down where the frame says, and the mounting is on the body's side.
    body_to_world = reading.written(q) if order == "wxyz" else np.roll(reading.written(q), 1, axis=1)
    body_to_world = matrix_of(body_to_world) if sense == "body_to_world" else matrix_of(body_to_world).transpose(0, 2, 1)
    down = np.einsum("kij,jl,kl->ki", body_to_world, reading.mounting, matrix_of(q)[:, 2, :])
    assert np.abs(down - down_of(frame)).max() < 1e-12
    assert abs(down_of(frame) @ (np.eye(3)["xyz".index(frame[0])] if frame[1] == "_" else [0, 0, 1])) == pytest.approx(1)
