"""Selection: p-values over a family of candidates that resemble one another."""

import numpy as np
import pytest
from scipy import stats

from tinygc.explanation.evidence import Selection


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
