"""Explaining beside a truth file: the twin's columns against its own residuals, the truth's noise, clock and wrong moments."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from formats_page import strangers
from scipy.spatial.transform import Rotation, Slerp
from truth_sessions import Wrong, made, write

import calibrate
from tinygc.closure.prepared import prepare
from tinygc.effects import AppliedEffect, catalogue
from tinygc.explanation.claims import common_delays
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.result import truth_to_json
from tinygc.explanation.truth_engine import _chance_of, explain_truth
from tinygc.explanation.truth_evidence import neighbours_correlation, noises, truth_claim
from tinygc.explanation.truth_names import _SMOOTHING, OFFSET, TruthTwin
from tinygc.noise.channels import in_gauge
from tinygc.noise.components import TRUTH, WANDER
from tinygc.noise.refit import refit
from tinygc.reporting.explanation_text import refusals


def twin_of(wrong: Wrong) -> TruthTwin:
    return TruthTwin(prepare(made(wrong)[0]).problem)


@pytest.fixture(scope="module")
def twin() -> TruthTwin:
    return twin_of(Wrong())


def at(twin, *claims):
    return replace(twin.start(), claims=claims)


def column(twin, effect, *claims):
    state = at(twin, *claims)
    rates = twin.rates(state)
    return twin.effect_columns(effect, state, twin.sensitivity(state, rates), rates).closure[..., 0]


def claim(effect, *theta):
    return AppliedEffect(effect, np.array(theta))


# The twin.


def test_no_still_is_a_row_and_the_clock_has_a_column(twin):
    def residuals(seconds):
        return twin.residuals(at(twin, claim(OFFSET, seconds))).closure

    assert twin.residuals(at(twin)).stacked().shape == (3 * len(twin.segments),)
    apart = (residuals(0.0021) - residuals(0.0019)) / 2e-4
    assert np.abs(column(twin, OFFSET, claim(OFFSET, 0.002)) - apart).max() < 0.03 * np.abs(apart).max()


def test_the_truths_noise_is_what_it_is_and_not_what_is_stated():
    """30 segments' three angles know a sigma to 8 %; three of that."""
    session, _ = made(Wrong(sigma_deg=0.02))
    protocol = replace(session.config.protocol, truth_sigma_deg=0.1)
    problem = prepare(replace(session, config=replace(session.config, protocol=protocol))).problem
    noise = Evidence(TruthTwin(problem)).nothing.noise
    assert noise.size(TRUTH) / DEG == pytest.approx(0.02, rel=0.25)
    assert noise.size(WANDER) / DEG < 0.02


def smoothed(width_s: float) -> TruthTwin:
    """A truth without noise, each attitude a mean over ``width_s``, by Slerp and Rotation.mean; beside the gyro's true matrix and bias."""
    session, _ = made(Wrong(turns=10, every_s=0.02, sigma_deg=1e-4, misaligned=0.0))
    (truth,) = session.truths
    t_s = truth.t_ns * 1e-9
    at = Slerp(t_s, Rotation.from_quat(truth.q_nb, scalar_first=True))
    inside = (t_s > t_s[0] + 0.1) & (t_s < t_s[-1] - 0.1)
    seen = at((t_s[inside][:, None] + width_s * (np.arange(40) / 40 - 0.4875)).ravel())
    q = np.array([seen[40 * i : 40 * i + 40].mean().as_quat(scalar_first=True) for i in range(inside.sum())])
    session = replace(session, truths=(replace(truth, t_ns=truth.t_ns[inside], q_nb=q),))
    # 1.7 s: at the same phase of every turn of 2 s, smoothing and delay were one.
    session = replace(session, config=replace(session.config, protocol=replace(session.config.protocol, segment_s=1.7)))
    return TruthTwin(prepare(session).problem)


def test_a_smoothed_truth_errs_by_half_its_windows_variance_times_the_change_of_the_rate():
    """T^2 / 12; over 120 ms of a bell of 2 s the next term is 1 % of it.  A clock beside it has its own place."""
    twin = smoothed(0.12)
    plain = replace(twin.start(), model=smoothed(0.0).problem.first)

    def residuals(variance):
        return twin.residuals(replace(plain, claims=(claim(_SMOOTHING, variance),))).closure.ravel()

    state = replace(plain, claims=(claim(_SMOOTHING, 1e-3),))
    rates = twin.rates(state)
    own = twin.effect_columns(_SMOOTHING, state, twin.sensitivity(state, rates), rates).closure[..., 0].ravel()
    np.testing.assert_allclose(own, (residuals(1.1e-3) - residuals(0.9e-3)) / 2e-4, atol=0.02 * np.abs(own).max())
    variance = -float(own @ residuals(0.0)) / float(own @ own)
    assert variance == pytest.approx(0.12**2 / 12, rel=0.06)
    assert np.linalg.norm(residuals(variance)) < 0.3 * np.linalg.norm(residuals(0.0))
    both = claim(OFFSET, 0.002), claim(_SMOOTHING, 1e-3)
    clock, smooth = (column(twin, effect, *both).ravel() for effect in (OFFSET, _SMOOTHING))
    assert abs(clock @ smooth) < 0.5 * np.linalg.norm(clock) * np.linalg.norm(smooth)


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


@pytest.mark.parametrize("segments", [12, 40])
def test_the_chance_of_a_wrong_moment_bounds_what_normal_errors_do(segments):
    """Neighbours that share a moment's noise, as a truth's do, and segments whose scale is taken from their median."""
    moments = np.random.default_rng(segments).standard_normal((2000, segments + 1, 3))
    size = np.linalg.norm(np.diff(moments, axis=1), axis=2)
    most = np.minimum(size[:, :-1], size[:, 1:]).max(axis=1) / np.median(size, axis=1)
    p = np.array([_chance_of(float(each), segments - 1, segments) for each in most])
    for level in (0.05, 0.01):
        assert np.mean(p < level) <= level + 3 * np.sqrt(level / 2000)
    assert _chance_of(10.0, segments - 1, segments) < _chance_of(5.0, segments - 1, segments) < p.max() == 1.0


def test_growth_tells_the_truths_noise_from_the_gyros(twin):
    """Variance 2 truth^2 + walk^2 T + drift^2 T^2; of neighbours whose errors are a moment's noise, the correlation is -1/2."""
    T = np.array([1.0, 2.0, 5.0, 10.0])
    variance = 2 * 3e-4**2 + 1e-4**2 * T + 2e-5**2 * T**2
    assert noises(T, np.sqrt(np.outer(variance, [1, 1, 1]))) == pytest.approx((3e-4, 1e-4))
    assert np.isnan(noises(T[:2], np.ones((2, 3)))).all()
    noise = np.random.default_rng(0).standard_normal((len(twin.segments) + 1, 3))
    assert neighbours_correlation(twin.problem, np.diff(noise, axis=0)) == pytest.approx(-0.5, abs=0.15)
    slow = np.ones((len(twin.segments), 3)) + 0.1 * noise[1:]
    assert neighbours_correlation(twin.problem, slow) == pytest.approx(1.0, abs=0.05)


def test_a_size_that_no_gyroscope_has_is_implausible():
    effect = catalogue()["gyro.g_sensitivity"]
    size = effect.parameter.plausible * np.eye(9)[1]
    assert [truth_claim(effect, k * size, None, 0.01).implausible for k in (1.99, -2.01)] == [False, True]
    assert [truth_claim(_SMOOTHING, np.array([k]), None, 0.01).implausible for k in (1e-6, -1e-6)] == [False, True]


FORCE_BIAS = np.array([0.3, -0.2, 0.25])  # m/s^2


@pytest.fixture(scope="module")
def whole():
    """A gyro with 0.3 dps/g, an accelerometer with a bias, a truth that is 6 ms late and wrong at two moments, explained."""
    session, _ = made(Wrong(turns=24, late_s=0.006))
    (log,), (truth,) = session.logs, session.truths
    gyro = log.samples.gyro + 0.3 * DEG * log.samples.accel[:, [1, 2, 0]] / 9.80665
    q, jump = truth.q_nb.copy(), Rotation.from_rotvec([15 * DEG, 0, -10 * DEG])
    cut = prepare(session).problem
    moments = [cut.used[number].start_s for number in (8, 16)]
    for moment in moments:
        row = int(np.argmin(np.abs(cut.session.truths[0].t_ns * 1e-9 - moment)))
        q[row] = (Rotation.from_quat(q[row], scalar_first=True) * jump).as_quat(scalar_first=True)
    accel = log.samples.accel + FORCE_BIAS
    log, truth = replace(log, samples=replace(log.samples, gyro=gyro, accel=accel)), replace(truth, q_nb=q)
    return explain_truth(replace(session, logs=(log,), truths=(truth,))), moments


def test_sensor_clock_and_wrong_moments_are_told_apart(whole):
    e, moments = whole
    named = {each.effect.id: each for each in e.claimed}
    assert {"reference.truth_jump", "timing.truth_offset", "gyro.g_sensitivity"} <= set(named)
    assert sorted(at for _, at in e.jumps) == pytest.approx(moments, abs=0.2)
    clock = named["timing.truth_offset"]
    assert clock.theta[0] == pytest.approx(-0.006, abs=4 * clock.sigma[0])
    assert clock.sigma[0] < 5e-4
    own = named["gyro.g_sensitivity"]
    sizes, sigmas = (x.reshape(3, 3)[[0, 1, 2], [1, 2, 0]] / DEG for x in (own.theta, own.sigma))
    assert np.abs((sizes - 0.3) / sigmas).max() < 4
    assert np.abs((e.force.bias - FORCE_BIAS) / e.force.sigma).max() < 4
    assert e.force.sigma.max() < 0.03
    assert e.closure_rms[1] < 0.6 * e.closure_rms[0]
    assert e.held_out_rms[1] < 0.6 * e.held_out_rms[0]
    assert e.verdict in ("explained", "partly_explained")
    assert (refusals(e), e.refused) == ([], [])
    table = truth_to_json(e)
    assert strangers(json.loads(json.dumps(table, allow_nan=False))) == []
    jump = next(effect for effect in table["effects"] if effect["id"] == "reference.truth_jump")
    np.testing.assert_allclose(sorted(jump["parameters"]["at_s"]), moments, atol=0.2)
    assert (jump["std"], jump["share"]) == ({"at_s": None}, None)
    # By the largest: some hundred times the usual miss, in the tail of Fisher's F with 1.58 x 24 degrees of freedom.
    assert 1e-60 < jump["p_value"] < 1e-8


def test_a_still_effect_beside_a_truth_is_refused_in_one_line(tmp_path, capsys):
    folder = write(tmp_path, Wrong(turns=8))
    assert calibrate.main(["fit", str(folder), "--physics", "earth.rotation", "--methods", "least_squares", "--quiet"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "earth.rotation cannot be fitted beside a truth file" in said
