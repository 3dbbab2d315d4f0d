"""Mean, drift, spread and repeatability of a lot: each against a Gaussian or a Student's t with every entry written out."""

import dataclasses

import numpy as np
import pytest
from scipy import optimize, stats
from simulated_lots import COUNT, simulated_lot
from small_lots import Dense, believed, small_lot

from tinygc import CalibrationError
from tinygc.annexes.lots import hierarchy as subject
from tinygc.annexes.lots.hierarchy import OFF_SCALES, Sums, add, hierarchy, in_si, tails_of, updated
from tinygc.annexes.lots.lot import LotSessions, lot_sessions

KNOWN = [0, 10]
TWICE = [0, 10, 21, 31]  # of mean and drift
S = np.array([[0.8, 0.3], [0.3, 0.5]])
V = np.array([[0.2, -0.05], [-0.05, 0.1]])


def passed(lot, belief, units=3):
    """Sums of one pass."""
    sums = Sums()
    for _, chunk in lot.chunks():
        add(sums, chunk, belief, units)
    return sums


def with_gls(lot, spread, repeatability, **more):
    """A belief whose mean and drift are those of generalised least squares, with their covariance."""
    found, covariance = Dense(lot, spread, repeatability).solved()
    whole = np.zeros((2 * COUNT,) * 2)
    whole[np.ix_(TWICE, TWICE)] = covariance
    return believed(spread, repeatability, mean=found[:2], drift=found[2:], beta_covariance=whole, **more)


def slope(of, spread, i, j, step=1e-5):
    """Derivative of a function of the spread, along a symmetric change of one of its entries."""
    change = np.zeros((2, 2))
    change[i, j] += step / 2
    change[j, i] += step / 2
    return (of(spread + change) - of(spread - change)) / (2 * step)


# One pass, against generalised least squares and the gradient of the restricted likelihood


def test_mean_and_drift_are_generalised_least_squares():
    lot = small_lot([1, 2, 3, 1])
    belief = believed(S, V)
    sums = passed(lot, belief)
    found = in_si(lot, updated(lot, belief, sums, 3), sums, True)
    dense, s = Dense(lot, S, V), lot.scale[KNOWN]
    beta, covariance = dense.solved()
    pair = np.ix_(KNOWN, KNOWN)
    assert found.mean[KNOWN] == pytest.approx(lot.centre[KNOWN] + s * beta[:2], rel=1e-6)
    assert found.drift[KNOWN] == pytest.approx(s * beta[2:], rel=1e-6)
    assert found.mean_covariance[pair] == pytest.approx(covariance[:2, :2] * np.outer(s, s), rel=1e-6)
    assert found.drift_covariance[pair] == pytest.approx(covariance[2:, 2:] * np.outer(s, s), rel=1e-6)
    # Without a drift that shows, the next unit's mean is that of a fit without one.
    without, of_without = dense.solved(slice(0, 2))
    assert not found.drifts
    assert found.next_mean[KNOWN] == pytest.approx(lot.centre[KNOWN] + s * without, rel=1e-6)
    assert found.next_covariance[pair] == pytest.approx(of_without * np.outer(s, s), rel=1e-6)
    z = np.abs(beta[2:]) / np.sqrt(np.diag(covariance[2:, 2:]))
    assert found.drift_p == pytest.approx(min(1, 2 * 2 * stats.t.sf(z.max(), 4 - 2)))
    hidden = np.setdiff1d(np.arange(COUNT), KNOWN)
    for part in (found.mean, found.drift, found.next_mean, np.diag(found.spread), np.diag(found.repeatability)):
        assert np.isnan(part[hidden]).all()
        assert np.isfinite(part[KNOWN]).all()


def test_the_next_unit_comes_one_step_after_the_last_of_a_drift():
    lot = small_lot([1] * 8)
    at = lot.place[:, None] / 7
    lot = dataclasses.replace(lot, values=lot.values + 20 * lot.scale * at)
    belief = believed(S, V)
    sums = passed(lot, belief)
    found = in_si(lot, updated(lot, belief, sums, 3), sums, True)
    beta, covariance = Dense(lot, S, V).solved()
    s, ahead = lot.scale[KNOWN], np.hstack([np.eye(2), (0.5 + 1 / 7) * np.eye(2)])
    assert found.drifts
    assert found.drift_p == pytest.approx(4 * stats.t.sf((beta[2:] / np.sqrt(np.diag(covariance)[2:])).max(), 6), rel=1e-5)
    assert found.next_mean[KNOWN] == pytest.approx(lot.centre[KNOWN] + s * (ahead @ beta), rel=1e-6)
    assert found.next_covariance[np.ix_(KNOWN, KNOWN)] == pytest.approx(ahead @ covariance @ ahead.T * np.outer(s, s), rel=1e-6)


@pytest.mark.parametrize(("counts", "freedom"), [([1, 2, 3, 2], 2), ([1, 2], 1)])
def test_the_spread_moves_along_the_restricted_likelihoods_gradient(counts, freedom):
    """S (outer - weight) S / units is a step of EM, and outer - weight twice the gradient; the uncertainty of mean and drift is in it."""
    lot = small_lot(counts)
    belief = with_gls(lot, S, V)
    sums = passed(lot, belief)
    gradient = (sums.outer - sums.weight)[np.ix_(KNOWN, KNOWN)] / 2
    of = lambda spread: Dense(lot, spread, V).restricted()  # noqa: E731
    for i, j in ((0, 0), (0, 1), (1, 1)):
        assert gradient[i, j] == pytest.approx(slope(of, S, i, j), rel=1e-5, abs=1e-9)  # two units tell no spread
    after = updated(lot, belief, sums, 3).spread[np.ix_(KNOWN, KNOWN)]
    step = S + S @ (2 * gradient) @ S / len(counts)
    keep = freedom**2 / (freedom**2 + 3**2)  # freedom of the units less mean and drift, but at least one, against two numbers and one
    assert np.diag(after) == pytest.approx(np.diag(step), rel=1e-6)
    assert after[0, 1] == pytest.approx(after[1, 0])
    assert after[0, 1] == pytest.approx(keep * step[0, 1], rel=1e-6)


def test_repeatability_is_the_mean_square_of_what_a_session_adds_given_all():
    """Conditional on the unit's sessions, mean and drift known: mean and covariance of every session's own part."""
    lot = small_lot([1, 2, 3])
    belief = believed(S, V, mean=0.2, drift=-0.3)
    sums = passed(lot, belief)
    dense = Dense(lot, S, V)
    r = dense.y - dense.design @ [0.2, 0.2, -0.3, -0.3]
    gain = dense.again @ np.linalg.inv(dense.C)
    left, moved = gain @ r, dense.again - gain @ dense.again
    expected = np.zeros((2, 2))
    for row in range(2, 12, 2):  # of the units with several sessions
        at = slice(row, row + 2)
        expected += np.outer(left[at], left[at]) + moved[at, at]
    assert sums.repeats == 5
    pair = np.ix_(KNOWN, KNOWN)
    assert sums.repeated[pair] == pytest.approx(expected, rel=1e-6)
    after = updated(lot, belief, sums, 3).repeatability[pair]
    assert np.diag(after) == pytest.approx(np.diag(expected) / 5, rel=1e-6)
    assert after[0, 1] == pytest.approx(expected[0, 1] / 5 * 5**2 / (5**2 + 3**2), rel=1e-6)


# Student's t, and units that do not belong


@pytest.mark.parametrize("tails", [4.0, np.inf])
def test_a_units_density_is_the_multivariate_t(tails):
    lot = small_lot([1, 2, 1])
    belief = believed(S, V, mean=0.3, drift=0.4, tails=tails)
    sums = passed(lot, belief)
    y, noise = joined_units(lot)
    along = lot.place / 2 - 0.5

    def of(theta, spread=S):
        return sum(
            stats.multivariate_t(theta[:2] + a * theta[2:], N + spread, df=tails).logpdf(each)
            for a, N, each in zip(along, noise, y, strict=True)
        )

    at, step = np.array([0.3, 0.3, 0.4, 0.4]), 1e-5
    numeric = [(of(at + step * e) - of(at - step * e)) / (2 * step) for e in np.eye(4)]
    assert (sums.right - sums.information @ belief.beta.ravel())[TWICE] == pytest.approx(numeric, rel=1e-5)
    gradient = (sums.outer - sums.weight)[np.ix_(KNOWN, KNOWN)] / 2
    for i, j in ((0, 0), (0, 1), (1, 1)):
        assert gradient[i, j] == pytest.approx(slope(lambda spread: of(at, spread), S, i, j), rel=1e-4)
    # The density of the distances, less the determinant, which belongs to the spread.
    delta, told = np.concatenate(sums.delta), np.concatenate(sums.told)
    logs = subject.log_density(delta, told, tails) - [0.5 * np.linalg.slogdet(N + S)[1] for N in noise]
    assert told.tolist() == [2, 2, 2]
    assert logs.sum() == pytest.approx(of(at), rel=1e-9)


def joined_units(lot):
    """The sessions of each unit as one, by least squares with their own covariances and V: y (U, 2), noise (U, 2, 2)."""
    y, noise = [], []
    for unit in range(lot.units):
        rows = np.flatnonzero(lot.unit == unit)
        weights = [np.linalg.inv(C) for C in lot.covariance(rows)[:, KNOWN][:, :, KNOWN] + V]
        values = ((lot.values - lot.centre) / lot.scale)[rows][:, KNOWN]
        noise.append(np.linalg.inv(sum(weights)))
        y.append(noise[-1] @ sum(w @ v for w, v in zip(weights, values, strict=True)))
    return np.array(y), np.array(noise)


@pytest.mark.parametrize("tails", [5.0, np.inf])
def test_a_unit_belongs_by_bayes_theorem(tails):
    """Against one number, or all, being 5, 15 or 50 times as far off, all alike probable; in all, 3 in 100."""
    lot = small_lot([1, 2, 1])
    lot = dataclasses.replace(lot, values=lot.values + np.where(np.arange(COUNT) == 10, 9.0, 0.0) * lot.scale * (lot.unit == 1)[:, None])
    belief = believed(S, V, tails=tails, off=0.03)
    sums = passed(lot, belief, subject.FEWEST_JUDGED)
    member = np.concatenate(sums.member)
    for u, (y, N) in enumerate(zip(*joined_units(lot), strict=True)):
        pdf = lambda C: stats.multivariate_t(np.zeros(2), C, df=tails).pdf(y)  # noqa: B023, E731
        # Of the 21 numbers, 19 are unknown: being off leaves the known ones alone.
        one = np.mean(
            [[pdf(N + S + k**2 * np.diag(S * np.eye(2)[n]) * np.eye(2)[n][:, None]) for k in OFF_SCALES] for n in range(2)], axis=1
        )
        none = pdf(N + S)
        every = np.mean([pdf(k**2 * (N + S)) for k in OFF_SCALES])
        off = 0.5 * (one.sum() + 19 * none) / COUNT + 0.5 * every
        assert member[u] == pytest.approx(0.97 * none / (0.97 * none + 0.03 * off), rel=1e-5)
    assert member[1] < 0.5 < member[0]
    # Each counts by this probability, and the share of those that do not belong has the prior of 0.2 in 20.
    assert sums.belongs == pytest.approx(member.sum())
    assert updated(lot, belief, sums, 3).off == pytest.approx((3 - member.sum() + 0.2) / 23)
    alone = passed(lot, believed(S, V, tails=tails), subject.FEWEST_JUDGED - 1)
    assert np.concatenate(alone.member).tolist() == [1, 1, 1]
    assert list(OFF_SCALES) == [5, 15, 50]


def test_tails_are_those_of_the_largest_likelihood():
    """Against a fine grid, with SciPy's t; each unit by its probability of belonging."""
    delta = stats.f.ppf((np.arange(60) + 0.5) / 60, 2, 4) * 2
    told, member = np.full(60, 2), np.linspace(0.5, 1, 60)

    def logs(tails):
        return member @ stats.multivariate_t([0, 0], df=tails).logpdf(np.column_stack([np.sqrt(delta), 0 * delta]))

    best = optimize.minimize_scalar(lambda tails: -logs(tails), bounds=(2.5, 30), method="bounded").x
    assert tails_of(delta, told, member) == pytest.approx(best, rel=1e-3)
    # Heavier tails than any covariance has.
    assert tails_of(stats.f.ppf((np.arange(60) + 0.5) / 60, 2, 1) * 2, told, member) == pytest.approx(2.5, rel=1e-3)


def test_few_units_have_no_tails():
    """More than three units for each number."""
    far = [0.1] * 6 + [400.0]
    for count, finite in ((6, False), (7, True)):
        lot = small_lot([1] * count)
        belief = believed(S, V)
        sums = passed(lot, belief)
        sums.delta = [np.array(far[-count:])]
        assert np.isfinite(updated(lot, belief, sums, count).tails) == finite


# What is said of it, in SI


def test_tails_widen_the_mean_and_the_spread():
    """Spread is the covariance, tails / (tails - 2) times the scale; Fisher's information of a mean is (tails + p) / (tails + p + 2) of the
    normal one."""
    lot = small_lot([1, 2, 3, 1])
    belief = believed(S, V)
    sums = passed(lot, belief)
    after = updated(lot, belief, sums, 3)
    normal, heavy = (in_si(lot, dataclasses.replace(after, tails=tails), sums, True) for tails in (np.inf, 6.0))
    for name, factor in (("spread", 6 / 4), ("mean_covariance", 10 / 8), ("drift_covariance", 10 / 8), ("next_covariance", 10 / 8)):
        np.testing.assert_allclose(getattr(heavy, name), factor * getattr(normal, name), rtol=1e-12)
    np.testing.assert_array_equal(heavy.repeatability, normal.repeatability)
    s = lot.scale
    assert normal.spread[0, 10] == pytest.approx(after.spread[0, 10] * s[0] * s[10])
    assert normal.repeatability[0, 10] == pytest.approx(after.repeatability[0, 10] * s[0] * s[10])
    assert normal.off == pytest.approx(0.0)
    sums.belongs = 3.0
    assert in_si(lot, after, sums, True).off == pytest.approx(0.25)


@pytest.mark.parametrize("tails", [np.inf, 5.0])
def test_freedom_is_fishers_information_of_the_variance(tails):
    """2 variance^2 times the information of each unit by quadrature, less a share for mean and drift; of an exact session, with tails."""
    lot = small_lot([1, 1, 2, 1], known=(10,))
    if np.isfinite(tails):
        lot = dataclasses.replace(lot, covariances=lot.covariances * 1e-9)
    belief = believed([[0.7]], [[0.2 if np.isinf(tails) else 1e-9]], known=(10,), tails=tails, beta_covariance=np.eye(2 * COUNT))
    found = in_si(lot, belief, passed(lot, belief), True)
    noise = [1 / sum(1 / (lot.covariance(np.flatnonzero(lot.unit == u))[:, 10, 10] + belief.repeatability[10, 10])) for u in range(4)]

    y = np.linspace(-200, 200, 200_001)

    def information(N):
        logs = lambda variance: stats.t.logpdf(y, tails, scale=np.sqrt(N + variance))  # noqa: E731
        score = (logs(0.7 + 1e-5) - logs(0.7 - 1e-5)) / 2e-5
        return np.sum(score**2 * np.exp(logs(0.7))) * 2e-3

    assert found.spread_freedom[10] == pytest.approx(2 * 0.7**2 * sum(map(information, noise)) * (4 - 2) / 4, rel=1e-3)
    assert np.isnan(found.spread_freedom[0])


# To the end


def test_one_number_ends_at_the_largest_restricted_likelihood():
    lot = small_lot([2, 3, 1, 2, 2, 1, 3, 2], known=(10,), seed=4)

    def cost(logs):
        return -Dense(lot, np.exp(logs[:1, None]), np.exp(logs[1:, None]), (10,)).restricted()

    best = np.exp(optimize.minimize(cost, [-1.0, -1.0], method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-9}).x)
    found = hierarchy(lot)
    assert found.settled
    # Settled within a tenth of its own sigma.
    off = found.spread[10, 10] / lot.scale[10] ** 2 / best[0] - 1
    assert abs(off) < 0.1 * np.sqrt(2 / found.spread_freedom[10])
    beta, covariance = Dense(lot, best[:1, None], best[1:, None], (10,)).solved()
    assert found.mean[10] == pytest.approx(lot.centre[10] + lot.scale[10] * beta[0], abs=0.1 * np.sqrt(covariance[0, 0]) * lot.scale[10])


def test_a_large_lot_begins_with_a_part_of_it_and_ends_the_same(monkeypatch):
    """Parts of eight and then of 64 units, up to half of them with several sessions."""
    lot, parts = small_lot([1, 2, 1] * 50, known=(10,)), []
    whole = hierarchy(lot)
    chunks = LotSessions.chunks
    monkeypatch.setattr(LotSessions, "chunks", lambda self, units=None: parts.append(units) or chunks(self, units))
    monkeypatch.setattr(subject, "BEGIN_UNITS", 8)
    found = hierarchy(lot)
    sizes = {len(units) for units in parts if units is not None}
    assert sizes == {8, 64}
    assert all(len(set(units)) == len(units) for units in parts if units is not None)
    assert {np.count_nonzero(lot.count[units] > 1) for units in parts if units is not None} == {4, 32}
    assert parts[-1] is None
    sigma = np.sqrt(whole.mean_covariance[10, 10])
    assert found.mean[10] == pytest.approx(whole.mean[10], abs=0.2 * sigma)
    assert found.spread[10, 10] == pytest.approx(whole.spread[10, 10], rel=0.2 * np.sqrt(2 / whole.spread_freedom[10]))
    # What never settles ends after so many passes over each part, and nine over all.
    parts.clear()
    monkeypatch.setattr(subject, "SETTLED", 0.0)
    monkeypatch.setattr(subject, "MOST_PASSES", 4)
    found = hierarchy(lot)
    assert not found.settled
    assert len(parts) == 4 + 4 + 9


def test_without_a_repeated_session_or_an_accelerometer_neither_is_told():
    none = hierarchy(lot_sessions(simulated_lot(40, 5, 1, without_accelerometer=1.0)))
    assert np.isnan(none.repeatability).all()
    assert not none.belief.repeatability.any()
    assert np.isnan(none.mean[12:]).all()
    assert np.isfinite(none.spread[:12, :12]).all()


def test_order_of_the_records_copies_and_units_do_not_matter():
    results = simulated_lot(20, 6, [1, 2])
    large = [dataclasses.replace(r, values=1e3 * r.values, covariance=1e6 * r.covariance) for r in [*results[::-1], *results[:5]]]
    once, again = (hierarchy(lot_sessions(each)) for each in (results, large))
    assert again.mean == pytest.approx(1e3 * once.mean, rel=1e-6)
    assert np.allclose(again.spread, 1e6 * once.spread, rtol=1e-6, atol=0)


def test_two_units_are_a_lot_and_one_is_none():
    each = hierarchy(lot_sessions(simulated_lot(2, 0, 2)))
    assert np.isfinite(each.spread).all()
    assert each.drift_p == 1.0
    for units in (1, 0):
        with pytest.raises(CalibrationError, match=f"two units or more, got {units}"):
            lot_sessions(simulated_lot(units, 0, 5))
