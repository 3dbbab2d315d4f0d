"""Explaining beside a truth file: the twin's columns against its own residuals, the truth's noise, clock and wrong moments."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from conftest import DEG
from formats_page import strangers
from linear_twin import effect, linear_twin
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from scipy.spatial.transform import Rotation
from small_sessions import DPH, EARTH_T, small_session
from truth_sessions import Wrong, made, write

import calibrate
from session.base import rotation
from session.base.numeric import sigma_of
from session.base.units import G
from session.detect.segments import Segment
from session.log.samples import Samples
from tinygc.closure.floor import BiasInstability, Floor
from tinygc.closure.least_squares import StillRates
from tinygc.closure.prepared import prepare
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch, closure_angles
from tinygc.effects import AppliedEffect, Movement, catalogue
from tinygc.effects.movement import vibration
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation import result
from tinygc.explanation.checked import named_in, predicted
from tinygc.explanation.claims import claim_of, common_delays
from tinygc.explanation.decision import Naming, decide, rather_slow, with_slow_bias
from tinygc.explanation.engine import explain_session
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.result import rejected_words
from tinygc.explanation.search import NamedEffect
from tinygc.features.truth import errors, shown
from tinygc.features.truth.errors import (
    FRAME,
    LIKE_AN_OUTAGE,
    MOUNTED,
    OFFSET,
    SMOOTHING,
    TRUTH,
    WRONG_MOMENTS,
    chance_of,
    neighbours,
    repaired,
    wander,
    without_wrong_moments,
)
from tinygc.features.truth.reading import FOUND, GIVEN, Truth, changed
from tinygc.features.truth.shown import (
    TruthShown,
    _again,
    _frame_claim,
    _stands_and_turned,
    force_against_truth,
    growth,
    neighbours_correlation,
    outage_claims,
    zero_at_rest,
)
from tinygc.features.truth.twin import TruthTwin, offset_columns
from tinygc.fitting.bias_of_day import _first_attitude
from tinygc.library.explanations import Why
from tinygc.noise.channels import in_gauge
from tinygc.noise.components import TURN, WANDER, first_noise, undersampling
from tinygc.noise.refit import refit
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener
from tinygc.reporting.html.sections.explanation import section


@pytest.fixture(scope="module")
def twin():
    """Of a truth that is 0.02 degrees off, and said to be 0.1."""
    session, _ = made(Wrong())
    protocol = replace(session.config.protocol, truth_sigma_deg=0.1)
    return TruthTwin(prepare(replace(session, config=replace(session.config, protocol=protocol))).problem)


def at(twin, *claims):
    return replace(twin.start(), claims=claims)


def column(twin, effect, *claims):
    state = at(twin, *claims)
    rates = twin.rates(state)
    return twin.effect_columns(effect, state, twin.sensitivity(state, rates), rates).closure[..., 0]


def claim(effect, *theta):
    return AppliedEffect(effect, np.array(theta))


# The twin.


@pytest.mark.parametrize(("effect", "size"), [(OFFSET, 0.002), (SMOOTHING, 1e-3)])
def test_no_still_is_a_row_and_the_clock_and_smoothing_have_a_column(twin, effect, size):
    def residuals(share):
        return twin.residuals(at(twin, claim(effect, share * size))).closure

    assert twin.residuals(at(twin)).stacked().shape == (3 * len(twin.segments),)
    apart = (residuals(1.05) - residuals(0.95)) / (0.1 * size)
    assert np.abs(column(twin, effect, claim(effect, size)) - apart).max() < 0.03 * np.abs(apart).max()


def test_the_truths_noise_is_what_it_is_and_not_what_is_stated(twin):
    """30 segments' three angles know a sigma to 8 %; three of that."""
    noise = Evidence(twin).nothing.noise
    assert noise.size(TRUTH) / DEG == pytest.approx(0.02, rel=0.25)
    assert noise.size(WANDER) / DEG < 0.02


@pytest.mark.parametrize("name", ["gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew"])
def test_what_all_axes_share_looks_like_the_clock_and_goes_there(twin, name):
    assert set(common_delays()) == {"gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew"}
    effect = catalogue()[name]
    delays, late = list(effect.gauge_convention.delays), getattr(effect.gauge_convention, "late", 1.0)
    theta = np.zeros(effect.parameter.size)
    theta[delays] = 0.002

    def residuals(*claims):
        return twin.residuals(at(twin, *claims)).closure - twin.residuals(at(twin)).closure

    delayed, clock = residuals(AppliedEffect(effect, theta)), residuals(claim(OFFSET, late * 0.002))
    # To first order one column; two milliseconds of a turn's bell bend it by some percent.
    assert np.linalg.norm(delayed - clock) < 0.05 * np.linalg.norm(clock)
    theta[delays[1]] += 0.001
    whiten = Evidence(twin).first_whiten
    fit = refit(twin, whiten, [OFFSET, effect], at(twin, claim(OFFSET, 0.001), AppliedEffect(effect, theta)), max_steps=0)
    gauged = in_gauge(twin, whiten, fit)
    moved, kept = (each.theta for each in gauged.state.claims)
    shared = np.mean if name == "gyro.angular_acceleration" else np.min
    assert shared(kept[delays]) == pytest.approx(0, abs=1e-12)
    assert np.ptp(kept[delays]) == pytest.approx(0.001)
    assert moved[0] == pytest.approx(0.001 + late * shared(theta[delays]))
    assert gauged.chi_square == pytest.approx(fit.chi_square, rel=0.02)
    # The clock's sigma is that of the sum, which the recording knows, not of a share of it, which nothing tells.
    assert np.sqrt(gauged.theta_covariance(0)[0, 0]) < 0.3 * np.sqrt(fit.theta_covariance(0)[0, 0]) < 0.05


# What is told apart from it.


def of(log, start, stop, began_s=0.0):
    return Segment(10 * log + start, log, None, None, start, stop, began_s, 0.5, 0.5, 90.0)


def log_of(gyro, period_s=0.01, accel=None):
    t_ns = np.rint(np.arange(len(gyro)) * period_s * 1e9).astype(np.int64)
    return SimpleNamespace(samples=Samples(t_ns, gyro, 0 * gyro if accel is None else accel))


def chain(count):
    return SimpleNamespace(used=[of(0, 10 * i, 10 * i + 11) for i in range(count)])


def test_thechance_of_a_wrong_moment_is_fishers_f_with_the_freedom_of_a_median():
    """A median m of N lengths with density f scatters by 1 / (4 N f^2): as the root of chi-square with 2 N (f m)^2 does."""
    length = stats.chi(3)
    share = 2 * (length.pdf(length.median()) * length.median()) ** 2
    for times, pairs, segments in ((5.0, 9, 12), (10.0, 30, 40)):
        expected = pairs * stats.f.sf((times * length.median()) ** 2 / 3, 3, share * segments)
        assert chance_of(times, pairs, segments) == pytest.approx(expected, rel=0.03)
    assert chance_of(1.0, 9, 12) == 1.0


def test_neighbours_share_a_moment():
    used = [of(0, 0, 11), of(0, 10, 21), of(0, 21, 30), of(1, 29, 40), of(1, 39, 50)]
    assert neighbours(SimpleNamespace(used=used)).tolist() == [0, 3]
    assert neighbours(SimpleNamespace(used=used[:1])).dtype == int


def test_neighbours_correlate_with_what_is_large_cut_to_three_medians():
    angles = np.random.default_rng(0).normal(size=(7, 3))
    angles[2], angles[3] = 0.0, [40.0, -30.0, 20.0]
    cut = angles.copy()
    cut[3] *= 3 * np.median(np.linalg.norm(angles, axis=1)) / np.linalg.norm(angles[3])
    expected = np.sum(cut[1:] * cut[:-1]) / np.sqrt(np.sum(cut[1:] ** 2) * np.sum(cut[:-1] ** 2))
    assert neighbours_correlation(chain(7), angles) == pytest.approx(expected)
    assert np.isfinite([neighbours_correlation(chain(count), angles[:count]) for count in (6, 5)]).tolist() == [True, False]


def test_growth_is_of_whole_segments_within_those_that_are_used(twin):
    lengths, closures = growth(twin.problem, twin.problem.first)
    assert lengths.tolist() == [0.5, 1.0, 2.0, 4.0]
    angles = closure_angles(twin.problem.batch, twin.problem.first)
    assert_allclose(closures[2], sigma_of(angles - np.median(angles, axis=0)))
    assert np.mean(closures) == pytest.approx(np.sqrt(2) * 0.02 * DEG, rel=0.15)
    gone = twin.problem.used[10]
    fewer = replace(twin.problem, segments=[replace(s, problem=None if s is not gone else "left out") for s in twin.problem.used])
    left, every = ({(s.start, s.stop) for s, _ in _again(problem, 1.0)} for problem in (fewer, twin.problem))
    assert left == {(start, stop) for start, stop in every if stop - 1 <= gone.start or start >= gone.stop - 1}
    assert len(left) < len(every)


def test_the_clocks_column_turns_both_ends_by_their_rates():
    """A rate less the Earth's, at the first sample and at the last that a segment has."""
    rng = np.random.default_rng(1)
    rate, earth = rng.normal(size=(2, 4, 3)), 0.1 * rng.normal(size=(2, 4, 3))
    start, end = Rotation.random(2, rng), Rotation.random(2, rng)
    dt = np.array([[0.1, 0.1, 0.1], [0.1, 0.1, 0.0]])
    batch = Batch(rate, dt, earth, start.as_quat(scalar_first=True), end.as_quat(scalar_first=True), True)
    true = 1.1 * rate - earth
    expected = end.apply([true[0, 3], true[1, 2]]) - start.apply(true[:, 0])
    assert_allclose(offset_columns(batch, lambda measured: 1.1 * measured), expected)


def test_the_change_of_a_rate_is_its_difference_over_20_ms_to_either_side():
    """Not beyond an end of the log."""
    rng = np.random.default_rng(2)
    rates = rng.normal(size=(2, 40, 3))
    movements = [Movement(0.01 * np.arange(40), 0.01, rate, rate, *[np.zeros(40)] * 2, 0.4, 10.0, 20.0) for rate in rates]
    found = TruthTwin._changes.func(SimpleNamespace(segments=[of(0, 5, 21), of(1, 1, 12), of(0, 20, 40)], movements=movements))
    for ends, spans in zip(found, (((3, 7), (0, 3), (18, 22)), ((18, 22), (9, 13), (37, 39))), strict=True):
        for change, log, (low, high) in zip(ends, (0, 1, 0), spans, strict=True):
            assert_allclose(change, (rates[log][high] - rates[log][low]) / ((high - low) * 0.01), atol=1e-9)


@pytest.mark.parametrize(("seconds", "steps"), [(0.05, 3), (-0.05, 3), (0.04, 2), (0.0, 1), (2.5, 100)])
def test_the_truth_is_carried_back_along_the_rates_at_midpoints_of_two_samples(seconds, steps):
    """The latest first.  Beyond the log its last rate holds."""
    rng = np.random.default_rng(3)
    logs = [log_of(3 * rng.normal(size=(40, 3)), period) for period in (0.01, 0.03)]
    used = [of(0, 5, 21), of(1, 1, 12), of(0, 20, 39)]
    earth, start, end = 0.1 * rng.normal(size=(3, 4, 3)), Rotation.random(3, rng), Rotation.random(3, rng)
    dt = np.array([[0.1, 0.1, 0.1], [0.1, 0.1, 0.0], [0.1, 0.0, 0.0]])
    batch = Batch(0 * earth, dt, earth, start.as_quat(scalar_first=True), end.as_quat(scalar_first=True), True)
    own = SimpleNamespace(problem=SimpleNamespace(logs=logs), segments=used, batch=batch)
    own._gyro = lambda *where: TruthTwin._gyro(own, *where)
    found = TruthTwin.later(own, batch, SimpleNamespace(model=lambda measured: 1.1 * measured), seconds)
    for before, after, at, last in ((start, found.start, (5, 1, 20), (0, 0, 0)), (end, found.end, (20, 11, 38), (3, 2, 1))):
        for number, (log, period) in enumerate(((0, 0.01), (1, 0.03), (0, 0.01))):
            q, step = before[number], seconds / steps
            for half in (np.arange(steps)[::-1] + 0.5) * step:
                where = np.clip(at[number] + half / period, 0, 38.999)
                rate = [np.interp(where, np.arange(40), axis) for axis in logs[log].samples.gyro.T]
                q = q * Rotation.from_rotvec(-step * (1.1 * np.array(rate) - earth[number, last[number]]))
            assert_allclose(rotation.matrix(after[number]), q.as_matrix(), atol=1e-6)


def test_a_smoothed_truth_errs_by_half_its_windows_variance_times_the_change_of_the_rate(twin):
    """A mean of a t^2 / 2 over a window is higher by a / 2 times its variance: that is taken off both ends."""
    plain = twin.batch_at(at(twin))
    found = twin.batch_at(at(twin, claim(SMOOTHING, 1e-3)))
    for before, after, change in zip((plain.start, plain.end), (found.start, found.end), twin._changes, strict=True):
        assert_allclose(after, rotation.multiply(before, rotation.exp(-5e-4 * change)), atol=1e-12)
    problem = twin.original
    for source, free in ((GIVEN, False), (FOUND, True)):
        alignment = replace(problem.session.reference.alignment, source={"offset_s": source})
        twin = TruthTwin(replace(problem, session=changed(problem.session, alignment=alignment)))
        assert (twin.clock, twin.errors) == (OFFSET if free else None, (OFFSET, SMOOTHING))


# Wrong moments, outages, frames and the clock.


def missing(angles):
    """A problem whose segments, neighbours all, miss by these angles (S, 3); a floor with what neighbours share."""
    count, rng = len(angles), np.random.default_rng(4)
    zero = np.zeros((count, 2, 3))
    same = np.tile([1.0, 0, 0, 0], (count, 1))
    root = rng.normal(size=(count, 3, 3))
    floor = Floor(root @ root.transpose(0, 2, 1) + np.eye(3), 0.1 * root[1:], wider=0.5 * np.tile(np.eye(3), (count, 1, 1)))
    segments = [of(0, 10 * i, 10 * i + 11, 3.0 * i) for i in range(count)]
    batch = Batch(zero, np.full((count, 1), 0.01), zero, same, rotation.exp(-angles), True)
    return Problem(None, segments, batch, floor, {}, [], lambda rate: rate, StillRates(*np.zeros((3, 0, 3))), None)


@pytest.mark.parametrize(("times", "cosine", "found"), [(5.01, -0.71, True), (4.99, -0.71, False), (5.01, -0.69, False)])
def test_a_moment_is_wrong_where_both_sides_miss_by_five_medians_in_opposite_directions(times, cosine, found):
    rng = np.random.default_rng(5)
    angles = rng.normal(size=(16, 3))
    angles *= 0.01 / np.linalg.norm(angles, axis=1)[:, None]
    angles[4], angles[5] = 0.09 * np.array([1.0, 0, 0]), 0.01 * times * np.array([cosine, np.sqrt(1 - cosine**2), 0])
    angles[9], angles[10] = [0, 0.06, 0], [0, -0.07, 0]
    problem, fitted = missing(angles), []

    def fit(batch, sigma, model):
        fitted.append((len(batch), sigma))
        return SimpleNamespace(model=model)

    with patch.object(errors, "fit_least_squares", fit):
        mended, sound = without_wrong_moments(problem), missing(angles[:4])
        none = without_wrong_moments(sound)
        assert (none.problem, none.found) == (sound, {})
    kept, claim = mended.problem, mended.found[WRONG_MOMENTS]
    gone = [4, 5, 9, 10] if found else [9, 10]
    index = np.delete(np.arange(16), gone)
    assert [segment.number for segment in kept.used] == [10 * i for i in index]
    assert [count for count, _ in fitted[:3]] == [16, len(index), len(index)]
    assert_array_equal(fitted[2][1], problem.floor.sigma[index])
    assert claim.parameters == {"at_s": [3.0 * i + 0.5 for i in gone[::2]]}
    assert claim.p_value == pytest.approx(chance_of(6.0, 15, 16))
    rows = (3 * index[:, None] + np.arange(3)).ravel()
    assert_array_equal(kept.floor.dense(), problem.floor.dense()[np.ix_(rows, rows)])
    assert_array_equal(kept.floor.wider, problem.floor.wider[index])
    assert_array_equal(kept.batch.end, problem.batch.end[index])


def test_outages_are_claimed_where_they_were_with_what_is_sure_of_them_apart():
    def outage(*of):
        return SimpleNamespace(**dict(zip(("from_s", "to_s", "sure", "times_usual", "spans", "size_rps"), of, strict=True)))

    first = SimpleNamespace(outages=[outage(1.0004, 2.0, True, 6.0, 40, 3.2104 * DEG), outage(5.0, 7.5, False, 9.0, 50, 4.0 * DEG)])
    second = SimpleNamespace(outages=[outage(1.5, 2.5, True, 7.0, 30, 5.0 * DEG)])
    problem = SimpleNamespace(
        began_s=np.array([0.0, 100.0, 150.0]), session=SimpleNamespace(reference=SimpleNamespace(truths=(first, second)))
    )
    sure, unsure = outage_claims(problem)
    assert sure.parameters["spans_s"] == [[1.0, 2.0], [101.5, 102.5]]
    assert (sure.p_value, sure.parameters["size_dps"], sure.equivalent) == (chance_of(7.0, 30, 30), [3.21, 5.0], ())
    assert (unsure.parameters["spans_s"], unsure.p_value, unsure.equivalent) == ([[5.0, 7.5]], chance_of(9.0, 50, 50), LIKE_AN_OUTAGE)
    assert "the truth has lost the body" in sure.description
    assert "the truth or the gyro is wrong there" in unsure.description


def aligned(turned, sigma, mounting_deg=(0, 0, 0), source="assumed"):
    """The truth's alignment: turned and its sigma in degrees."""
    mounting = Rotation.from_rotvec(np.multiply(mounting_deg, DEG)).as_matrix()
    return SimpleNamespace(
        turned=np.multiply(turned, DEG),
        turned_sigma=np.full(3, sigma * DEG),
        reading=SimpleNamespace(mounting=mounting),
        source={"mounting": source},
    )


@pytest.mark.parametrize(
    ("turned", "sigma", "left", "p"),
    [
        ([0, 0.51, 0], 0.1, 0.69, stats.chi2.sf(5.1**2, 3)),
        ([0, 0.49, 0], 0.09, 0.69, None),
        ([0.6, 0.8, 0], 0.199, 0.69, stats.chi2.sf(0.199**-2, 3)),
        ([0.6, 0.8, 0], 0.201, 0.69, None),
        ([0, 0.51, 0], 0.1, 0.71, None),
        ([0, 0.51, 0], 0.1, None, None),
        ([0, np.nan, 0], 0.1, 0.69, None),
    ],
)
def test_a_frame_is_claimed_if_it_is_large_and_sure_and_the_accelerometer_agrees(turned, sigma, left, p):
    """Beside a mounting that the file states; one that was found is claimed whatever the accelerometer says."""
    force = None if left is None else SimpleNamespace(bias=np.array([0.6, 0.8, 0]), turned=left * np.array([0, 0.6, 0.8]))
    found = _frame_claim(aligned(turned, sigma), force)
    assert [(claim.effect, claim.p_value) for claim in found] == ([] if p is None else [(FRAME, pytest.approx(p))])
    found = _frame_claim(aligned([0.3, 0, 0], 0.1, (0.3, 0, 0), FOUND), None)
    assert [(claim.effect, claim.p_value) for claim in found] == [(MOUNTED, pytest.approx(stats.chi2.sf(9.0, 3)))]
    assert _frame_claim(aligned(np.full(3, np.nan), 0.1), force) == _frame_claim(aligned([0, 9.0, 0], 0.1, (0, 9.0, 0)), force) == []
    stands, asked = _stands_and_turned(aligned([0, 9.0, 0], 0.1, (0, 7.0, 0), FOUND))
    assert_allclose(stands, Rotation.from_rotvec([0, -7 * DEG, 0]).as_matrix(), atol=1e-12)
    assert_allclose(asked, Rotation.from_rotvec([0, 2 * DEG, 0]).as_matrix(), atol=1e-12)
    for alignment, turned in ((aligned(np.full(3, np.nan), 0.1), 0), (aligned([0, 9.0, 0], 0.1), 9)):
        stands, asked = _stands_and_turned(alignment)
        assert_array_equal(stands, np.eye(3))
        assert_allclose(asked, Rotation.from_rotvec([0, turned * DEG, 0]).as_matrix(), atol=1e-12)


def fit_of(*claims, variance=1e-6):
    """A fit with these claims, each number with a variance, larger by one for each claim."""
    state = SimpleNamespace(claims=claims)
    return SimpleNamespace(state=state, theta_covariance=lambda number: (number + 1) * variance * np.eye(len(claims[number].theta)))


LEAN = catalogue()["gyro.g_sensitivity"]


def named(effect, share=0.5, p_value=1e-3):
    size = np.full(effect.parameter.size, 1e-3)
    return claim_of(AppliedEffect(effect, size), np.diag(size**2), p_value, share=share)


def shown_with(fit, found_s=0.0, sigma_s=np.nan):
    """What a truth shows whose clock was set by ``found_s``, after a fit; nothing else of it."""
    alignment = SimpleNamespace(
        source={"offset_s": FOUND if found_s else GIVEN, "mounting": GIVEN},
        reading=SimpleNamespace(offset_s=found_s),
        offset_s=found_s,
        offset_sigma_s=sigma_s,
        turned=np.full(3, np.nan),
        turned_sigma=np.ones(3),
    )
    own = object.__new__(TruthShown)
    problem = SimpleNamespace(began_s=np.zeros(1), session=SimpleNamespace(reference=SimpleNamespace(truths=())))
    own.twin, own.fit, own.alignment, own.force = SimpleNamespace(problem=problem), fit, alignment, None
    return own


@pytest.mark.parametrize(("sigmas", "said"), [(3.01, True), (2.99, False)])
def test_a_clock_fitted_beside_a_delay_is_said_from_three_sigmas_on(sigmas, said):
    fit, other = fit_of(claim(LEAN, *np.zeros(9)), claim(OFFSET, -sigmas * 0.001), variance=0.5e-6), named(LEAN)
    after = shown_with(fit).all_claims([other])
    assert [each.effect for each in after] == [LEAN, OFFSET][: 1 + said]
    if said:
        clock, p = after[1], float(stats.chi2.sf(sigmas**2, 1))
        assert (clock.parameters["seconds"], clock.std["seconds"], clock.p_value) == pytest.approx((-sigmas * 0.001, 0.001, p))
        assert (clock.share, clock.equivalent) == (None, common_delays())
    assert shown_with(fit_of()).all_claims([other]) == [other]


@pytest.mark.parametrize(("own", "p_value"), [(0.5, stats.chi2.sf(3.5**2, 1)), (1e-9, 1e-9)])
def test_a_clock_found_before_the_fit_is_claimed_whole(own, p_value):
    """With what the fit leaves of it, and the sigma of that; where nothing is left to fit, with its own."""
    fit, weighed = fit_of(claim(OFFSET, 0.001), variance=0.002**2), replace(named(OFFSET, 0.2, own), probability=0.9, rivals={"x": 0.1})
    clock, lean = shown_with(fit, 0.006).all_claims([weighed, named(LEAN)])
    assert (clock.effect, lean.effect) == (OFFSET, LEAN)
    assert (clock.parameters["seconds"], clock.std["seconds"], clock.p_value) == pytest.approx((0.007, 0.002, p_value))
    assert (clock.share, clock.probability, clock.rivals, clock.equivalent) == (0.2, 0.9, {"x": 0.1}, common_delays())
    alone = shown_with(fit_of(), 0.006, 0.001)
    (clock,) = alone.all_claims([])
    assert (clock.parameters["seconds"], clock.std["seconds"], clock.p_value) == pytest.approx((0.006, 0.001, stats.chi2.sf(36.0, 1)))
    assert [float(np.ravel(part)[0]) for part in alone.measured[OFFSET.id]] == pytest.approx([0.006, 1e-6])
    assert shown_with(fit_of()).measured == {OFFSET.id: None}


# The accelerometer, and the rests.


def windows(t_s, turn, force, g):
    """Bias and sigma by rows of least squares: windows of 20 s, every 10 s, without gaps of more than 2 s and without lost readings."""
    weight = np.sin(np.pi * np.arange(40) / 39) ** 2 / 19.5
    rows, values = [], []
    for start in range(0, len(t_s) - 40, 20):
        part = slice(start, start + 40)
        if t_s[part][-1] - t_s[start] < 22 and force[part].any(axis=1).all():
            rows.append(np.hstack([np.tensordot(weight, turn[part], 1), [[0, g], [-g, 0], [0, 0]]]))
            values.append(weight @ np.einsum("tij,tj->ti", turn[part], force[part]) + [0, 0, g])
    A, y = np.concatenate(rows), np.concatenate(values)
    prior = 0.05 * np.diag([1e-3] * 3 + [1 / (0.5 * DEG)] * 2)
    x = np.linalg.lstsq(np.vstack([A, prior]), np.r_[y, np.zeros(5)])[0]
    sigma = np.sqrt(np.diag(np.linalg.inv(A.T @ A + prior.T @ prior)) * np.sum((y - A @ x) ** 2) / (len(y) - 5))
    return x[:3], sigma[:3], len(rows)


def test_the_accelerometers_bias_is_what_the_truths_vertical_leaves():
    """Beside a tilt of the truth's world, with the sensor's axes as recorded, and turned as the gyro shows."""
    rng, g = np.random.default_rng(6), 9.81
    t_s = np.delete(np.arange(300) * 0.5, [*range(50, 53), *range(120, 128)])
    true = Rotation.from_rotvec(np.cumsum(rng.normal(size=(300, 3)) * 0.2, axis=0)[np.rint(2 * t_s).astype(int)])
    force = np.zeros((300, 3))
    rows = np.rint(2 * t_s).astype(int)
    force[rows] = (true.inv() * Rotation.from_rotvec([0.01, -0.02, 0])).apply([0, 0, -g]) + FORCE_BIAS
    force[rows] += 0.05 * rng.normal(size=(len(rows), 3))
    force[230] = 0
    log = log_of(np.zeros((300, 3)), 0.5, force)
    truth = Truth(None, log.samples.t_ns[rows], true.as_quat(scalar_first=True))
    site = SimpleNamespace(expected_gravity_mps2=g)
    session = SimpleNamespace(config=SimpleNamespace(site=site), reference=SimpleNamespace(truths=(truth,)))
    axes = [Rotation.from_rotvec(each).as_matrix() for each in ([0, 0, 0.1], [0.05, 0, 0.1])]
    found = force_against_truth(SimpleNamespace(session=session, logs=[log]), *axes)
    own, turned = (windows(t_s, true.as_matrix(), force[rows] @ each.T, g) for each in axes)
    assert_allclose(found.bias, own[0], atol=1e-9)
    assert_allclose(found.sigma, own[1], rtol=1e-9)
    assert_allclose(found.turned, turned[0], atol=1e-9)
    for count in (81, 80):  # three windows are enough
        session.reference.truths = (replace(truth, t_ns=truth.t_ns[:count], q_nb=truth.q_nb[:count]),)
        assert (force_against_truth(SimpleNamespace(session=session, logs=[log]), *axes) is None) == (count == 80)


def test_the_zero_at_rest_is_weighed_by_the_samples_of_each(monkeypatch):
    rng = np.random.default_rng(7)
    accel, means = rng.normal(size=(2, 400, 3)) * [[[1.0]], [[3.0]]], rng.normal(size=(3, 3))
    spans = ((0, 50, 80), (0, 200, 300), (1, 100, 140))
    rests = [(slice(a, b), mean) for (_, a, b), mean in zip(spans, means, strict=True)]
    logs = [log_of(np.zeros((400, 3)), 0.01, each) for each in accel]
    of = {id(logs[0].samples): rests[:2], id(logs[1].samples): rests[2:]}
    monkeypatch.setattr(shown, "find_rests", lambda samples: of[id(samples)])
    sensor = SimpleNamespace(sensor=SimpleNamespace(gyro_fs_dps=500))
    problem = SimpleNamespace(logs=logs, began_s=np.array([0.0, 4.0, 8.0]), session=SimpleNamespace(config=sensor))
    found = zero_at_rest(problem, lambda rate: 2 * rate)
    assert found.seconds == pytest.approx(1.7)
    assert_allclose(found.difference, 2 * (30 * means[0] + 100 * means[1] + 40 * means[2]) / 170)
    assert_allclose(found.sigma, 2 * np.std(means, axis=0, ddof=1) / np.sqrt(3))
    shaken = [vibration(log.samples.accel / G, 0.01) for log in logs]
    quiet = (shaken[0][50:80].sum() + shaken[0][200:300].sum() + shaken[1][100:140].sum()) / 170
    moving = np.delete(shaken[0], [*range(50, 80), *range(200, 300)]), np.delete(shaken[1], range(100, 140))
    assert found.vibration_g2 == pytest.approx((quiet, np.mean([np.median(each) for each in moving])))
    of[id(logs[0].samples)] = []
    assert np.isnan(zero_at_rest(problem, lambda rate: rate).sigma).all()
    of[id(logs[1].samples)] = []
    assert zero_at_rest(problem, lambda rate: rate) is None


# What is claimed.


def test_a_slow_bias_is_straight_between_knots_and_shrinks_to_its_own_size():
    slow = wander(np.array([0.0, 10.0, 20.0]))
    theta = np.array([1.0, -2.0, 0.0, 3.0, 1.0, 0.0]) * 0.1 * DEG
    rate = slow.columns(SimpleNamespace(t_s=np.array([0.0, 5.0, 12.0, 30.0]))) @ theta
    assert_allclose(rate / (0.1 * DEG), [[0, 0, 0], [0.5, -1, 0], [1.4, -1.4, 0], [3, 1, 0]], atol=1e-12)
    assert "wanders by 0.300 dps (most on x)" in slow.describe(theta)
    assert (slow.parameter.shape, slow.parameter.plausible, slow.shape) == ((2, 3), DEG, {"knots_s": [0.0, 10.0, 20.0]})
    assert slow.basis is not None
    assert wander(np.arange(4.0)).basis is None


A, C, SLOW = effect("a", 2), effect("c"), effect("slow")
object.__setattr__(SLOW, "id", "unknown.slow_bias")


def weighed(*spoilt):
    """The evidence of twelve turns without stills."""
    twin = linear_twin(seed=5, turns=12, resting=False)
    for each, theta in spoilt:
        twin.spoil(each, theta)
    twin.problem.instability = SimpleNamespace(rps=0.0)
    return twin.evidence()


def test_a_slow_bias_stands_for_names_that_do_hardly_better_and_are_more():
    evidence = weighed((A, [6.0, -4.0]), (C, [9.0]))
    evidence.twin.slow = (SLOW,)
    both = evidence.of((A, C), evidence.nothing)
    for beside, expected in (
        ([((SLOW, A), 9.9)], {SLOW, A}),
        ([((SLOW, A), 10.1)], {A, C}),
        ([((SLOW, A, C), 1.0)], {A, C}),
        ([((SLOW, A), 1.0), ((SLOW,), 9.9)], {SLOW}),
        ([((SLOW, A), 5.0), ((SLOW, C), 4.0)], {SLOW, C}),
    ):
        evidence._known |= {number: replace(both, effects=some, score=both.score + off) for number, (some, off) in enumerate(beside)}
        assert set(rather_slow(evidence, both).effects) == expected
        evidence._known = {key: known for key, known in evidence._known.items() if not isinstance(key, int)}
    slow = evidence.of((SLOW, A), evidence.nothing)
    assert rather_slow(evidence, slow) is slow


def test_a_wander_more_probable_than_none_is_a_slow_bias_and_what_it_makes_idle_goes():
    """By its odds, one in thirty before: where no wander costs names that much."""
    evidence = weighed((A, [6.0, -4.0]), (SLOW, [9.0]))
    names = evidence.of((A, C), evidence.nothing)
    named = [NamedEffect(each, 1e-4, 9.0, 0.9) for each in (A, C)]
    naming = Naming(evidence.nothing.fit, 0.5, names.fit, named, names.whiten, names.noise, p_value=0.5)

    def with_slow(odds, slow=(SLOW,), naming=naming):
        def of(some, begin):
            found = evidence.of(some, evidence.nothing)
            return replace(found, score=found.score + 2 * (np.log(30) + odds)) if some == (A, C) else found

        steady = SimpleNamespace(nothing=None, of=of, weighed=[])
        evidence.without = lambda name: steady if name == WANDER else None
        evidence.twin.slow = slow
        return with_slow_bias(evidence, naming)

    assert with_slow(-0.01) is naming
    assert with_slow(1.0, ()) is naming
    found = with_slow(1.0)
    best = evidence.of((A, SLOW), evidence.nothing)
    assert (found.fit, found.whiten.covariance, found.noise) == (best.fit, pytest.approx(best.whiten.covariance), best.noise)
    assert ([each.effect for each in found.named], [each.effect for each in found.beyond]) == ([A], [SLOW])
    (slow,) = found.beyond
    assert (slow.probability, found.p_value) == (pytest.approx(1 / (1 + np.exp(-1.0))), slow.p_value)
    number = best.effects.index(SLOW)
    theta = best.fit.state.claims[number].theta
    assert slow.gain == pytest.approx(theta @ np.linalg.solve(best.fit.theta_covariance(number), theta))
    assert not found.first.state.claims
    assert with_slow(1.0, naming=found) is found
    evidence.twin.problem.instability.rps = 1e-9
    assert with_slow(1.0) is naming


def test_a_size_that_nothing_has_is_refused_and_the_choice_is_made_again(twin):
    size = LEAN.parameter.plausible * np.eye(9)[1]
    assert [twin.is_impossible(AppliedEffect(LEAN, k * size)) for k in (1.99, -2.01)] == [False, True]
    assert [twin.is_impossible(claim(SMOOTHING, k)) for k in (0.0, -1e-6)] == [False, True]
    session, _ = made(Wrong())
    (log,) = session.logs
    gyro = log.samples.gyro + 0.5 * DEG * log.samples.accel[:, [1, 2, 0]] / G
    spoilt = TruthTwin(prepare(replace(session, logs=(replace(log, samples=replace(log.samples, gyro=gyro)),))).problem)
    with patch.object(TruthTwin, "is_impossible", lambda self, claim: claim.effect.id == LEAN.id):
        naming = decide(spoilt, 0)
    assert {each.effect.id for each in naming.refused} == {LEAN.id}
    assert LEAN.id not in {each.effect.id for each in naming.named}
    assert rejected_words(SimpleNamespace(naming=naming, considered=[])) == ["gyro.g_sensitivity (of a size that no sensor has)"]


FORCE_BIAS = np.array([0.3, -0.2, 0.25])  # m/s^2


@pytest.fixture(scope="module")
def whole():
    """A gyro with 0.3 dps/g, an accelerometer with a bias, a truth that is 6 ms late and wrong at two moments, explained."""
    session, _ = made(Wrong(turns=24, late_s=0.006))
    (log,), (truth,) = session.logs, session.reference.truths
    gyro = log.samples.gyro + 0.3 * DEG * log.samples.accel[:, [1, 2, 0]] / 9.80665
    q, jump = truth.q_nb.copy(), Rotation.from_rotvec([15 * DEG, 0, -10 * DEG])
    cut = prepare(session).problem
    moments = [cut.used[number].start_s for number in (8, 16)]
    for moment in moments:
        row = int(np.argmin(np.abs(cut.session.reference.truths[0].t_ns * 1e-9 - moment)))
        q[row] = (Rotation.from_quat(q[row], scalar_first=True) * jump).as_quat(scalar_first=True)
    accel = log.samples.accel + FORCE_BIAS
    log, truth = replace(log, samples=replace(log.samples, gyro=gyro, accel=accel)), replace(truth, q_nb=q)
    said = []
    e = explain_session(changed(replace(session, logs=(log,)), truths=(truth,)), progress=lambda *step: said.append(step))
    assert list(dict.fromkeys(step[1:] for step in said)) == [(number, 6) for number in range(6) if number != 2]
    return e, moments


def test_sensor_clock_and_wrong_moments_are_told_apart(whole):
    e, moments = whole
    named = {each.effect.id: each for each in e.claimed}
    assert {"reference.truth_jump", "timing.truth_offset", "gyro.g_sensitivity"} <= set(named)
    clock = named["timing.truth_offset"]
    assert clock.parameters["seconds"] == pytest.approx(-0.006, abs=4 * clock.std["seconds"])
    assert clock.std["seconds"] < 5e-4
    own = named["gyro.g_sensitivity"]
    sizes, sigmas = (np.array(x["matrix_dps_per_g"])[[0, 1, 2], [1, 2, 0]] for x in (own.parameters, own.std))
    assert np.abs((sizes - 0.3) / sigmas).max() < 4
    truth = e.shown
    assert np.abs((truth.force.bias - FORCE_BIAS) / truth.force.sigma).max() < 4
    assert truth.force.sigma.max() < 0.03
    assert tilt_rms(e.proof.after) < 1.3 * e.proof.floor_rms < 0.05 * tilt_rms(e.proof.before)
    assert (e.verdict, e.naming.refused, e.gravity, e.decision) == ("ambiguous", [], None, None)
    problem, fits = e.twin.original, (e.naming.first, e.naming.fit)
    assert truth.neighbours == pytest.approx([neighbours_correlation(problem, e.twin.residuals(fit.state).closure) for fit in fits])
    assert truth.truth_rad == e.noise.size(TRUTH)
    assert truth.gyro_rad == pytest.approx(np.mean(problem.noise.angle_random_walk))
    why = Why(e)
    with patch.object(result, "hash_of_log", lambda log: "0" * 64):
        table = why.to_json()
    html = section(SimpleNamespace(explanation=e)).html
    assert all(name in html for name in named)
    assert "frames" in html
    assert "fit as well" in why.summary()
    assert strangers(json.loads(json.dumps(table, allow_nan=False))) == []
    assert sorted(moment["at_s"] for moment in table["truth"]["wrong_moments"]) == pytest.approx(moments, abs=0.2)
    jump = next(effect for effect in table["effects"] if effect["id"] == "reference.truth_jump")
    assert_allclose(sorted(jump["parameters"]["at_s"]), moments, atol=0.2)
    assert jump["std"] == {"at_s": None}
    # By the largest: some hundred times the usual miss, in the tail of Fisher's F with 1.58 x 24 degrees of freedom.
    assert 1e-60 < jump["p_value"] < 1e-8


def test_as_recorded_the_clock_is_where_the_truths_stamps_have_it(whole):
    """What is proved is the clock, too: before, the attitudes are those of the stamps."""
    e, _ = whole
    found_s, mended, twin = e.shown.alignment.reading.offset_s, repaired(e.problem), TruthTwin(e.problem)
    expected = twin.later(e.problem.batch, twin.start(), -found_s)
    assert_array_equal(mended.recorded.batch.end, expected.end)
    assert (mended.problem.used, mended.recorded.used) == (e.twin.original.used, e.problem.used)
    given = replace(e.shown.alignment, source={**e.shown.alignment.source, "offset_s": GIVEN})
    assert repaired(replace(e.problem, session=changed(e.problem.session, alignment=given))).recorded is None


def test_a_recording_confirms_its_own_numbers(whole):
    e, _ = whole
    nameless = replace(e, claimed=[named(wander(np.arange(3.0))), *e.claimed])
    numbers = {each.effect.id: each for each in named_in(nameless)}
    clock, own, jump = (numbers[name] for name in ("timing.truth_offset", "gyro.g_sensitivity", "reference.truth_jump"))
    assert (clock.theta[0], clock.covariance[0, 0]) == pytest.approx((e.shown.offset[0], e.shown.offset[1] ** 2))
    assert clock.lookalikes == set(common_delays())
    assert (jump.theta.size, jump.covariance.size) == (0, 0)
    (number,) = [number for number, each in enumerate(e.fit.state.claims) if each.effect is own.effect]
    assert_array_equal(own.covariance, e.fit.theta_covariance(number))
    found = predicted(own, e, Evidence(TruthTwin(e.twin.original)), 0)
    assert (found.outcome, found.same_p, found.size[0]) == ("confirmed", pytest.approx(1.0), pytest.approx(1.0, abs=0.01))
    before, after = found.closure_rad
    assert after == pytest.approx(tilt_rms(e.proof.after), rel=0.3)
    assert before > 5 * after


def test_a_still_effect_beside_a_truth_is_refused_in_one_line(tmp_path, capsys):
    folder = write(tmp_path, Wrong(turns=6))
    assert calibrate.main(["fit", str(folder), "--physics", "earth.rotation", "--methods", "least_squares", "--quiet"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "earth.rotation cannot be fitted against a truth file" in said


def test_an_error_of_a_moment_of_truth_is_shared_by_two_turns_and_grows_with_the_rate_and_its_change():
    """A segment ends at the sample where the next one of its log begins; between logs and behind a rejected one nothing is shared.  Of each
    turn itself, an error grows with the root of the length of its path."""
    problem = small_session(kind="yaw", truths=True)
    joined = [replace(s, stop=t.start + 1 if t.log == s.log else s.stop) for s, t in pairwise(problem.used)]
    problem = replace(problem, segments=[*joined, problem.used[-1]])
    problem.__dict__["instability"] = BiasInstability(20 * DPH, "given")
    used, twin = problem.used, Twin(problem)
    missed = replace(undersampling(twin), predicted_rad=np.zeros(7), exponent=2.0, rate_hz=100.0)
    found = {c.name: c for c in first_noise(twin, Whitener(twin), missed).components}
    assert set(found) == {WANDER, TRUTH, "noise.truth_rate", "noise.truth_acceleration", "noise.turned", TURN}  # no still is there
    assert found[TRUTH].prior == (problem.session.reference.sigma_deg * DEG, 1.5, None)
    moments = sorted({(s.log, row) for s in used for row in (s.start, s.stop - 1)})
    assert len(moments) == 9
    ends = np.array([[((s.log, s.stop - 1) == at) * 1.0 - ((s.log, s.start) == at) for s in used] for at in moments])
    rates = [np.asarray(problem.first(log.samples.gyro)) for log in problem.logs]
    # A sample is longer than the 8 ms over which a derivative is taken of faster logs.
    changes = [np.gradient(rate, log.samples.period_s, axis=0) for rate, log in zip(rates, problem.logs, strict=True)]
    ones = [np.ones((len(rate), 1)) for rate in rates]
    for name, values in ((TRUTH, ones), ("noise.truth_rate", rates), ("noise.truth_acceleration", changes)):
        squares = [values[log][row] @ values[log][row] for log, row in moments]
        expected = np.kron(ends.T @ np.diag(squares) @ ends, np.eye(3))
        assert_allclose(found[name].V.dense(), expected, rtol=1e-9, atol=1e-12 * expected.max())
    times = [log.samples.t_s for log in problem.logs]
    paths = [np.trapezoid(np.linalg.norm(rates[s.log][s.start : s.stop], axis=1), times[s.log][s.start : s.stop]) for s in used]
    assert_allclose(found["noise.turned"].V.dense(), np.diag(np.repeat(paths, 3)), rtol=1e-9)


def test_with_a_truth_a_run_begins_at_its_first_moment():
    problem = small_session(truths=True)
    log, rows = problem.logs[0], [3, 9, 15]
    truth = Truth(Path("truth0001.csv"), log.samples.t_ns[rows], np.eye(4)[:3])
    found = _first_attitude(replace(problem, session=changed(problem.session, truths=(truth, None))), 0)
    assert (found[0], found[1].tolist(), found[2].tolist()) == (3, [1, 0, 0, 0], EARTH_T.tolist())


def test_a_claim_says_the_axes_that_are_three_sigmas_off_zero_or_the_surest():
    drift, theta = catalogue()["gyro.bias_drift"], np.array([0.1, 0.2, 0.3]) * DEG
    for sigmas, said in (((3.01, 3.01, 2.99), [1, 1, 0]), ((2.5, 2.9, 2.8), [0, 1, 0]), ((9.0, 3.1, 2.9), [1, 1, 0])):
        assert claim_of(AppliedEffect(drift, theta), np.diag((theta / sigmas) ** 2), 0.01).description == drift.describe(theta * said)
    bare = claim_of(AppliedEffect(drift, theta), None, 0.01)
    assert (bare.description, bare.std, bare.probability) == (drift.describe(theta), {"dps_over_log": None}, 1.0)
