"""The parts of an explanation: covariance, selection, twin, refit, gravity during the turns, gauge."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from session.common.units import DEG, DEG_PER_HOUR, EARTH_RATE_RPS, MG, G
from session.log.folder import read_session
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.bias_wander import wander_covariance
from tinygc.effects import AppliedEffect, catalogue
from tinygc.explanation.naming.forward import candidates
from tinygc.explanation.naming.selection import Selection
from tinygc.explanation.naming.unknown import slow_candidates, unknown_candidates
from tinygc.explanation.truth.truth_effects import wander
from tinygc.explanation.twin.common_delay import in_gauge
from tinygc.explanation.twin.refit import refit
from tinygc.explanation.twin.turn_gravity import turn_gravity
from tinygc.explanation.twin.twin import Channels, State, Twin
from tinygc.explanation.twin.whitening import ACCEL_INSTABILITY_MPS2, PRECALIBRATION_MPS2, UNIT_INSTABILITY, Whitener
from tinygc.problem.build import build_problem
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

LEVER_M = (0.02, -0.015, 0.01)


def late(t_s: np.ndarray, rate: np.ndarray, seconds) -> np.ndarray:
    """Each axis shows the rate of ``seconds`` (3,) ago, by a straight line on the simulation's fine grid."""
    return np.stack([np.interp(t_s - shift, t_s, rate[:, axis]) for axis, shift in enumerate(seconds)], axis=-1)


@pytest.fixture(scope="module")
def twin_of(tmp_path_factory):
    """``twin_of(distort, segments=12, …)``: a simulated session, ready to be replayed, with its whitener."""
    made = {}

    def make(distort=None, **options) -> tuple[Twin, Whitener]:
        chosen = SimulationOptions(**{"segments": 12, "closure_s": 0.0, "seed": 3, "odr_hz": 104.0, **options})
        if (distort, chosen) not in made:
            folder = write_session(chosen, tmp_path_factory.mktemp("twin") / "session", distort=distort)
            twin = Twin(build_problem(read_session(folder)))
            made[distort, chosen] = twin, Whitener(twin)
        return made[distort, chosen]

    return make


# The covariance


class Noise:
    """What the whitener's covariance claims to describe, drawn sample by sample and force by force."""

    def __init__(self, twin: Twin, seed: int):
        self.twin, self.rng = twin, np.random.default_rng(seed)
        self.state = twin.start()
        self.rates = twin.rates(self.state)
        (log,) = twin.problem.logs
        self.gyro_std = log.noise.angle_random_walk / np.sqrt(log.samples.period_s)
        (movement,) = twin.movements
        self.t_s = movement.t_s
        self.knots_s = np.arange(0, movement.t_s[-1] + 0.5, 0.5)
        self.wander = np.linalg.cholesky(wander_covariance(self.knots_s, instability_rps=UNIT_INSTABILITY * 3 * DEG_PER_HOUR))

    def residuals(self, noisy: bool) -> np.ndarray:
        """Stacked (n,)."""
        twin, rng = self.twin, self.rng
        rates, force, length = self.rates, twin.force, np.zeros(len(twin.stills))
        if noisy:
            bias = self.wander @ rng.standard_normal((len(self.knots_s), 3))
            wander = np.stack([np.interp(self.t_s, self.knots_s, axis) for axis in bias.T], axis=-1)
            rates = [rates[0] + self.gyro_std * rng.standard_normal(rates[0].shape) + wander]
            walk = np.array([twin.problem.logs[log].noise.velocity_random_walk for log, _ in twin.stills])
            duration = np.array([still.duration_s for _, still in twin.stills])
            down = force / np.linalg.norm(force, axis=1, keepdims=True)
            left = PRECALIBRATION_MPS2 * (rng.standard_normal(3) + down @ rng.standard_normal((3, 3)).T)
            length = ACCEL_INSTABILITY_MPS2 * rng.standard_normal(len(twin.stills))
            force = force + walk / np.sqrt(duration)[:, None] * rng.standard_normal(force.shape) + left
        tilts = rotation.from_gravity(force)
        q = np.array([closure.nearest_yaw(there, tilt) for there, tilt in zip(twin.q_tb, tilts, strict=True)])
        batch = replace(twin.batch, start=q[twin.first], end=q[twin.last])
        angles = closure.error_angles(closure.residual(closure.end_attitude(batch, twin.padded(rates)), batch.end, batch.yaw_known))
        still = np.array([rates[log][s.start : s.stop].mean(axis=0) for log, s in twin.stills])
        return Channels(angles, still, np.linalg.norm(force, axis=1) + length).stacked()


@pytest.mark.slow
def test_whitened_noise_has_unit_covariance(twin_of):
    """Monte Carlo from samples and forces; 800 draws: variances to 5 %, covariances to 3.5 % (1 sigma)."""
    twin, whiten = twin_of(segments=10)
    noise, draws = Noise(twin, 0), 800
    quiet = noise.residuals(False)
    white = np.array([whiten(noise.residuals(True) - quiet) for _ in range(draws)])
    covariance = white.T @ white / draws
    off = covariance - np.diag(np.diag(covariance))
    assert np.abs(np.diag(covariance) - 1).max() < 5 * np.sqrt(2 / draws)
    assert np.abs(off).max() < 5.5 / np.sqrt(draws)
    for part in whiten.parts.values():
        assert np.diag(covariance)[part].mean() == pytest.approx(1, abs=5 * np.sqrt(2 / draws / (part.stop - part.start)))


def test_the_same_noise_unwhitened_has_correlated_channels(twin_of):
    """What the covariance is for: a segment's ends are parts of stills, and neighbouring segments share a reference."""
    twin, whiten = twin_of(segments=10)
    noise = Noise(twin, 0)
    quiet = noise.residuals(False)
    raw = np.array([noise.residuals(True) - quiet for _ in range(300)]) / whiten.sigma
    correlation = raw.T @ raw / len(raw)
    assert np.abs(correlation - np.diag(np.diag(correlation))).max() > 0.3


def test_whitening_some_rows_is_whitening_of_their_own_covariance(twin_of):
    _, whiten = twin_of(segments=10)
    n = whiten.parts["length"].stop
    backward = whiten(np.eye(n))
    covariance = np.linalg.inv(backward.T @ backward)
    rows = np.random.default_rng(1).random(n) < 0.7
    part = whiten.only(rows)
    forward = part(np.eye(n))
    assert forward.shape == (rows.sum(), n)
    assert not forward[:, ~rows].any()
    np.testing.assert_allclose(forward @ covariance @ forward.T, np.eye(rows.sum()), atol=1e-6)
    np.testing.assert_allclose(whiten.only(np.ones(n, dtype=bool))(np.eye(n)), backward, rtol=1e-9)
    np.testing.assert_allclose(part.sigma, np.sqrt(np.diag(covariance))[rows], rtol=1e-6)


# Selection


def design(seed: int = 0, n: int = 90, groups: int = 9) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    rng = np.random.default_rng(seed)
    shared = rng.normal(size=(n, 3))  # groups that resemble one another, as delays and lags do
    return rng.normal(size=(n, 7)), {
        f"g{i}": rng.normal(size=(n, 1 + i % 4)) + (shared[:, : 1 + i % 4] if i % 4 < 3 else 0) for i in range(groups)
    }


def test_family_wise_p_is_uniform_when_nothing_is_missing():
    selection, draws = Selection(*design(), seed=1), 600
    r = np.random.default_rng(2).standard_normal((90, draws))
    p = [selection.p_value(one) for one in r.T]
    assert stats.kstest(p, "uniform").pvalue > 0.01
    assert np.mean(np.array(p) <= 0.05) == pytest.approx(0.05, abs=3 * np.sqrt(0.05 * 0.95 / draws))


def test_the_smallest_of_many_p_values_is_no_p_value():
    """Why the Monte Carlo: the raw one is far too often small."""
    selection = Selection(*design(), seed=1)
    r = np.random.default_rng(2).standard_normal((90, 600))
    assert np.mean(np.exp(selection.log_p(r).min(axis=0)) <= 0.05) > 0.2


def test_family_wise_p_falls_with_the_p_value_into_the_far_tail():
    selection = Selection(*design(), seed=1)
    log_p = -np.concatenate([np.linspace(0.01, 20, 400), np.geomspace(21, 690, 30)])
    p = np.array([selection.family_wise(value) for value in log_p])
    assert (np.diff(p) <= 0).all()
    assert (p > 0).all()
    assert p[0] == pytest.approx(1)
    # Between the raw p-value and that of as many independent tests as there are groups.
    far = log_p < -15
    assert (p[far] >= np.exp(log_p[far]) * (1 - 1e-9)).all()
    assert (p[far] <= len(selection.groups) * np.exp(log_p[far]) * 1.5).all()


def test_f_carries_the_scale_of_the_residuals():
    selection = Selection(*design(), seed=1)
    r = np.random.default_rng(3).standard_normal(90)
    np.testing.assert_allclose(selection.log_p(7.3 * r), selection.log_p(r), rtol=1e-9)


def test_what_the_calibration_fits_is_not_seen():
    nuisance, groups = design()
    selection = Selection(nuisance, groups, seed=1)
    r = np.random.default_rng(3).standard_normal(90)
    np.testing.assert_allclose(selection.log_p(r + 1e3 * nuisance @ np.arange(7)), selection.log_p(r), rtol=1e-6, atol=1e-9)


def test_what_the_covariance_allows_does_not_move_the_p_value():
    """Directions that it is wide along, of which most recordings use nothing: p is the same with much of them and with none."""
    nuisance, groups = design()
    allowances = np.random.default_rng(8).normal(size=(90, 5))
    selection = Selection(nuisance, groups, seed=1, allowances=allowances)
    draws = np.random.default_rng(9).standard_normal((90, 300))
    basis = np.linalg.qr(allowances)[0]
    p = np.array([selection.p_value(r - basis @ (basis.T @ r)) for r in draws.T])
    assert stats.kstest(p, "uniform").pvalue > 0.01
    moved = [selection.p_value(r + 50 * allowances @ np.arange(5)) for r in draws.T[:20]]
    np.testing.assert_allclose(moved, p[:20], rtol=1e-6)


def test_the_gain_is_what_least_squares_takes_up():
    nuisance, groups = design()
    selection = Selection(nuisance, groups, seed=1)
    r = np.random.default_rng(3).standard_normal(90)

    def left(columns):
        return np.sum((r - columns @ np.linalg.lstsq(columns, r, rcond=None)[0]) ** 2)

    for name, gain in selection.gains(r).items():
        assert gain == pytest.approx(left(nuisance) - left(np.hstack([nuisance, groups[name]])), rel=1e-9)


def test_a_strong_group_has_the_smallest_p_value():
    nuisance, groups = design()
    selection = Selection(nuisance, groups, seed=1)
    for number, name in enumerate(groups):
        r = np.random.default_rng(number).standard_normal(90) + 3 * groups[name].sum(axis=1)
        log_p = selection.log_p(r)
        assert selection.groups[int(np.argmin(log_p))].name == name
        assert selection.p_value(r) < 1e-6


def test_unobservable_groups_vanish():
    nuisance, _ = design()
    rng = np.random.default_rng(5)
    free = rng.normal(size=(90, 2))
    hidden = nuisance @ rng.normal(size=(7, 3))
    groups = {"hidden": hidden, "nothing": np.zeros((90, 3)), "half": np.hstack([hidden[:, :1], free]), "twice": np.hstack([free, free])}
    selection = Selection(nuisance, groups, seed=0)
    assert {group.name: group.basis.shape[1] for group in selection.groups} == {"half": 2, "twice": 2}
    assert Selection(nuisance, {"hidden": hidden}, seed=0).groups == []


def test_units_of_the_columns_do_not_matter():
    nuisance, groups = design()
    r = np.random.default_rng(3).standard_normal(90)
    scaled = {name: columns * 1e-7 for name, columns in groups.items()}
    np.testing.assert_allclose(Selection(nuisance * 1e5, scaled, 0).log_p(r), Selection(nuisance, groups, 0).log_p(r), rtol=1e-6)


# The twin's columns


def slope(twin: Twin, state: State, direction: np.ndarray, step: float) -> np.ndarray:
    """Central difference of the exact residuals along a direction of ``State.vector``."""
    there, back = (state.with_vector(state.vector + sign * step * direction) for sign in (1, -1))
    return (twin.residuals(there).stacked() - twin.residuals(back).stacked()) / (2 * step)


def errors(columns: np.ndarray, exact: np.ndarray) -> np.ndarray:
    return np.linalg.norm(columns - exact, axis=0) / np.linalg.norm(exact, axis=0)


def along(twin: Twin, state: State, first: int, count: int, step: float) -> np.ndarray:
    directions = np.eye(len(state.vector))[first : first + count]
    return np.stack([slope(twin, state, direction, step) for direction in directions], axis=-1)


def test_columns_of_the_linear_model(twin_of):
    twin, _ = twin_of()
    state = twin.start()
    columns = twin.linear_columns(twin.sensitivity(state, twin.rates(state))).stacked()
    assert errors(columns[:, :9], along(twin, state, 0, 9, 1e-6)).max() < 2e-3
    assert errors(columns[:, 9:], along(twin, state, 9, 3, 1e-3 * DEG)).max() < 2e-3


def test_columns_of_gravity_and_of_the_earth(twin_of):
    twin, _ = twin_of()
    state = twin.start()
    np.testing.assert_allclose(twin.gravity_columns().stacked(), along(twin, state, 14, 1, 1e-3), atol=1e-9)
    horizontal = twin.earth_columns().stacked() @ state.axes.T
    assert errors(horizontal, along(twin, state, 12, 2, 0.1 * EARTH_RATE_RPS)).max() < 2e-3


def test_shapes_without_a_name_read_only_what_they_declare(twin_of):
    """What they do not declare is not shown to them."""
    twin, _ = twin_of(warm_up_c=6.0)
    tried = [*unknown_candidates(twin), wander(np.linspace(0, twin.movements[0].duration_s, 5))]
    assert {effect.id for effect in tried} >= {"unknown.curve_over_temperature", "unknown.attitude", "unknown.slow_bias"}
    for effect in tried:
        theta = np.full(effect.parameter.size, 1e-3)
        assert np.isfinite(effect.correct(twin.movements[0].rate, twin.movements[0], theta)).all()


@pytest.mark.parametrize("name", sorted(set(catalogue()) - {n for n, e in catalogue().items() if e.kind == "register"}))
def test_columns_of_each_effect(twin_of, name):
    """At zero, where naming looks at them."""
    twin, _ = twin_of(warm_up_c=6.0)
    effect = catalogue()[name]
    if effect.scan:
        effect = effect.variants(np.array([twin.movements[0].duration_s * 0.4]))[0]
    state = replace(twin.start(), claims=(AppliedEffect(effect, np.zeros(effect.parameter.size)),))
    rates = twin.rates(state)
    bare = replace(state, claims=())
    columns = twin.effect_columns(effect, bare, twin.sensitivity(state, rates), rates).stacked()
    step = {"earth.rotation": 1e-2 * EARTH_RATE_RPS, "reference.accelerometer": 0.1 * MG}.get(name, 1e-4 * effect.parameter.plausible)
    exact = along(twin, state, 15, effect.parameter.size, step)
    assert errors(columns, exact).max() < 1e-2, errors(columns, exact)


def test_a_basis_is_its_columns_and_undoes_what_it_adds(twin_of):
    """The short way, which sums each curve once for all axes, and the long one; and the exact rate, which needs no repetition."""
    twin, _ = twin_of()
    state = twin.start()
    rates = twin.rates(state)
    sensitivity = twin.sensitivity(state, rates)
    effects = {str(e.equation): e for e in slow_candidates(twin) + candidates(twin) if e.basis is not None}
    assert len(effects) > 40
    for effect in effects.values():
        short = twin.effect_columns(effect, state, sensitivity, rates)
        long = twin.effect_columns(replace(effect, basis=None), state, sensitivity, rates)
        np.testing.assert_allclose(short.stacked(), long.stacked(), atol=1e-12 * np.abs(long.stacked()).max())
        theta = np.random.default_rng(1).normal(0, 0.1, effect.parameter.size)
        movement = twin.movements[0].with_rate(rates[0])
        np.testing.assert_allclose(effect.distort(movement, theta), replace(effect, basis=None).distort(movement, theta), atol=1e-13)
        np.testing.assert_allclose(effect.correct(effect.distort(movement, theta), movement, theta), rates[0], atol=1e-13)


def test_columns_of_a_claimed_lag_are_those_where_it_stands(twin_of):
    """A lag's linear columns, taken from the corrected rate, would not see what all axes have in common."""
    twin, _ = twin_of()
    effect = catalogue()["gyro.bandwidth"]
    state = replace(twin.start(), claims=(AppliedEffect(effect, np.array([0.01, 0.02, 0.015])),))
    rates = twin.rates(state)
    columns = twin.effect_columns(effect, state, twin.sensitivity(state, rates), rates).stacked()
    exact = along(twin, state, 15, 3, 1e-5)
    assert errors(columns, exact).max() < 1e-2


def test_the_state_is_its_vector(twin_of):
    twin, _ = twin_of()
    effects = [catalogue()["gyro.g_sensitivity"], catalogue()["gyro.thermal_bias"]]
    state = replace(twin.start(), claims=tuple(AppliedEffect(effect, np.arange(effect.parameter.size, dtype=float)) for effect in effects))
    np.testing.assert_array_equal(state.with_vector(state.vector).vector, state.vector)
    assert len(state.vector) == 15 + 9 + 3
    with pytest.raises(ValueError, match=r"gyro\.thermal_bias: theta has shape \(2,\)"):
        AppliedEffect(effects[1], np.zeros(2))


# Refit


G_SENSITIVITY = np.array([[0.03, -0.02, 0.01], [0.02, 0.04, -0.03], [-0.04, 0.01, 0.02]])
THERMAL = np.array([0.014, -0.02, 0.01])


def g_and_thermal(t_s, rate, force, temp_c):
    return rate + force / G @ (G_SENSITIVITY * DEG).T + np.outer(temp_c - 25, THERMAL * DEG)


@pytest.fixture(scope="module")
def pulls(twin_of):
    """(seeds, 9 + 3): (fitted - injected) / reported std of g-sensitivity and thermal bias together."""
    effects = [catalogue()["gyro.g_sensitivity"], catalogue()["gyro.thermal_bias"]]
    truth = np.concatenate([G_SENSITIVITY.ravel(), THERMAL]) * DEG
    found = []
    for seed in range(30):
        twin, whiten = twin_of(g_and_thermal, seed=seed, segments=14, warm_up_c=8.0)
        fit = refit(twin, whiten, effects, twin.start())
        sigma = np.sqrt(np.diag(fit.covariance)[15:])
        found.append((fit.state.vector[15:] - truth) / sigma)
    return np.array(found)


@pytest.mark.slow
def test_reported_uncertainties_hold(pulls):
    """68 % within one sigma; the effects' parameters are estimated from the same stills, so they are not independent."""
    for part in (pulls[:, :9], pulls[:, 9:]):
        assert np.mean(np.abs(part) < 1) == pytest.approx(0.68, abs=0.12)
        assert np.abs(part).max() < 5


@pytest.mark.slow
def test_recovered_parameters_have_no_bias(pulls):
    """Means over 30 seeds, in sigmas of a mean."""
    assert np.abs(pulls.mean(axis=0) * np.sqrt(len(pulls))).max() < 4


def test_refit_leaves_noise(twin_of):
    twin, whiten = twin_of(g_and_thermal, seed=0, segments=14, warm_up_c=8.0)
    effects = [catalogue()["gyro.g_sensitivity"], catalogue()["gyro.thermal_bias"]]
    without, fit = refit(twin, whiten, [], twin.start()), refit(twin, whiten, effects, twin.start())
    assert without.chi_square > 20 * fit.chi_square
    freedom = len(fit.r) - 12 - 12
    assert stats.chi2.cdf(fit.chi_square, freedom) < 0.9999
    # From where it ended it goes nowhere, and rows that do not count change nothing in those that do.
    again = refit(twin, whiten, effects, fit.state)
    assert again.chi_square == pytest.approx(fit.chi_square, abs=0.05)
    rows = np.ones(len(fit.r), dtype=bool)
    rows[:4] = False
    part = refit(twin, whiten, effects, fit.state, rows=rows)
    assert len(part.r) == rows.sum()
    assert part.chi_square < fit.chi_square


# Gravity during the turns


def test_gravity_during_the_turns_tells_the_lever_arm(twin_of):
    twin, whiten = twin_of()
    gravity = turn_gravity(twin, refit(twin, whiten, [], twin.start()))
    np.testing.assert_allclose(gravity.lever_m, LEVER_M, atol=5e-4)
    assert gravity.after_mps2 < 0.1 * gravity.before_mps2
    assert not gravity.is_offset


@pytest.mark.parametrize("seconds", [0.015, -0.02])
def test_gravity_during_the_turns_tells_a_late_gyro(twin_of, seconds):
    """Beyond the delay of the sensors' filters, which the same session has without it."""
    plain, plain_whiten = twin_of()
    twin, whiten = twin_of(lambda t, rate, force, temp: late(t, rate, [seconds] * 3))
    before = turn_gravity(plain, refit(plain, plain_whiten, [], plain.start()))
    gravity = turn_gravity(twin, refit(twin, whiten, [], twin.start()))
    assert gravity.offset_s - before.offset_s == pytest.approx(seconds, abs=2e-4)
    assert gravity.is_offset
    np.testing.assert_allclose(gravity.lever_m, LEVER_M, atol=1e-3)


# Conventions


def skewed(t_s, rate, force, temp_c):
    return late(t_s, rate, (0.006, 0.0, 0.012))


def lagging(t_s, rate, force, temp_c):
    """Euler's first-order filter on the fine grid, which is some 80 times finer than the shortest lag."""
    step = t_s[1] - t_s[0]
    share = 1 - np.exp(-step / np.array([0.004, 0.012, 0.008]))
    return np.stack([lfilter([k], [1, k - 1], rate[:, i], zi=[rate[0, i] * (1 - k)])[0] for i, k in enumerate(share)], axis=-1)


def test_skew_is_counted_from_the_earliest_axis(twin_of):
    twin, whiten = twin_of(skewed, segments=16)
    fit = refit(twin, whiten, [catalogue()["timing.axis_skew"]], twin.start())
    (claim,) = in_gauge(twin, whiten, fit).state.claims
    assert claim.theta.min() == 0
    np.testing.assert_allclose(claim.theta, (0.006, 0.0, 0.012), atol=2e-4)
    np.testing.assert_allclose(np.diff(claim.theta), np.diff(fit.state.claims[0].theta), atol=1e-12)


def test_the_gauge_costs_nothing(twin_of):
    twin, whiten = twin_of(skewed, segments=16)
    fit = refit(twin, whiten, [catalogue()["timing.axis_skew"]], twin.start())
    moved = in_gauge(twin, whiten, fit)
    assert moved.r @ moved.r == pytest.approx(fit.r @ fit.r, abs=4)
    np.testing.assert_array_equal(moved.state.vector[:15], fit.state.vector[:15])


def test_a_lag_is_never_negative(twin_of):
    """Axes that are late by different delays, fitted as lags: what they share has either sign as far as the closure goes."""
    twin, whiten = twin_of(skewed, segments=16)
    effect = catalogue()["gyro.bandwidth"]
    for begin in (-0.006, 0.006):
        start = replace(twin.start(), claims=(AppliedEffect(effect, np.full(3, begin)),))
        (claim,) = in_gauge(twin, whiten, refit(twin, whiten, [effect], start)).state.claims
        assert claim.theta.min() >= 0
        assert not turn_gravity(twin, in_gauge(twin, whiten, refit(twin, whiten, [effect], start))).is_offset


@pytest.mark.parametrize("seed", [3, 5, 8])
def test_a_lag_is_found_from_zero(twin_of, seed):
    """From a start at zero half of all searches ended at negative lags, with some 80 more of chi-square."""
    twin, whiten = twin_of(lagging, segments=16, seed=seed)
    effect = catalogue()["gyro.bandwidth"]
    fit = refit(twin, whiten, [effect], twin.start())
    sigma = np.sqrt(np.diag(fit.theta_covariance(0)))
    theta = fit.state.claims[0].theta
    assert (np.abs(theta - (0.004, 0.012, 0.008)) < 4 * sigma).all(), (theta, sigma)
    assert stats.chi2.cdf(fit.chi_square, len(fit.r) - 15) < 0.999


def test_what_all_axes_share_of_a_lag_is_taken_from_gravity(twin_of):
    twin, whiten = twin_of(lambda t, w, f, T: w + np.gradient(w, t, axis=0) @ CROSS.T, segments=16)
    fit = refit(twin, whiten, [catalogue()["gyro.angular_acceleration"]], twin.start())
    moved = in_gauge(twin, whiten, fit)
    matrix, sigma = moved.state.claims[0].theta.reshape(3, 3), np.sqrt(np.diag(moved.theta_covariance(0))).reshape(3, 3)
    assert (np.abs(matrix - CROSS) < 4 * sigma).all(), (matrix, sigma)
    off = ~np.eye(3, dtype=bool)
    assert sigma[off].max() < 1e-4  # the closure knows these
    assert sigma[~off].min() > 5e-4  # and not these: half a sample of the filters' own delay


CROSS = np.array([[0.004, 0.002, -0.002], [0.001, 0.006, 0.0008], [0.0007, 0.0006, 0.005]])
