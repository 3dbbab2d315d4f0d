"""Units that do not belong to a lot, and the number that is to blame; p-values by hand, at their thresholds."""

import dataclasses

import numpy as np
import pytest
from scipy import stats
from simulated_lots import SPREAD, simulated_lot, truth
from small_lots import believed, small_lot

from tinygc.annexes.lots.hierarchy import Hierarchy, hierarchy
from tinygc.annexes.lots.lot import COUNT, OWN, SENSOR_ERRORS, jacobian, lot_sessions
from tinygc.annexes.lots.outliers import outliers

B_Y = 10  # of NAMES
S = np.array([[0.8, 0.3], [0.3, 0.5]])
V = np.array([[0.2, -0.05], [-0.05, 0.1]])
KNOWN = [0, B_Y]
BLAMED = [int(np.flatnonzero(n == OWN)[0]) for n in KNOWN]


def believing(lot, spread=S, again=V, known=KNOWN, freedom=8.0, drifts=False, **more):
    """A lot's hierarchy, made by hand: mean and drift of each number, their spread and repeatability in scales."""
    belief = believed(spread, again, known, **more)
    nothing = np.full(COUNT, np.nan)
    sizes = np.where(np.isin(np.arange(COUNT), known), freedom, np.nan)
    mean = np.where(np.isin(np.arange(COUNT), known), lot.centre + lot.scale * belief.beta[0], np.nan)
    fields = {each.name: nothing for each in dataclasses.fields(Hierarchy)}
    given = {"mean": mean, "drifts": drifts, "spread_freedom": sizes, "tails": belief.tails, "belief": belief}
    return Hierarchy(**{**fields, **given})


def of_unit(lot, unit, far):
    """The lot with one unit's sessions at a distance (k,) of the belief's mean, in scales, along one direction."""
    values = lot.values.copy()
    values[:, KNOWN] = lot.centre[KNOWN]
    values[np.ix_(lot.unit == unit, KNOWN)] += lot.scale[KNOWN] * far
    return dataclasses.replace(lot, values=values)


def p_of_unit(lot, spread=S, again=V, unit=0, tails=np.inf, freedom=8.0, combined=True):
    """A unit's p-value over the whole lot, with every entry written out: its sessions as one, then each number, and all of them."""
    rows = np.flatnonzero(lot.unit == unit)
    noise = [C[np.ix_(KNOWN, KNOWN)] + again for C in lot.covariance(rows)]
    N = np.linalg.inv(sum(map(np.linalg.inv, noise)))
    y = ((lot.values - lot.centre) / lot.scale)[rows][:, KNOWN]
    r = N @ sum(np.linalg.solve(C, each) for C, each in zip(noise, y, strict=True))
    J = (jacobian(np.where(np.isin(np.arange(COUNT), KNOWN), lot.centre, np.nan)) * lot.scale)[:, KNOWN]
    sigma = np.sqrt(np.diag(J @ (N + spread) @ J.T))
    z = (J @ r)[BLAMED] / sigma[BLAMED]
    each = 2 * stats.t.sf(np.abs(z), 1 / (1 / tails + 1 / freedom))
    whole = stats.f.sf(r @ np.linalg.solve(N + spread, r) / 2, 2, min(tails, max(lot.units - 1 - 2, 1))) if combined else 1.0
    return 2 * lot.units * min(2 * each.min(), whole), (J @ r)[BLAMED], z


@pytest.mark.parametrize(("tails", "counts"), [(np.inf, [1] * 8), (5.0, [2, 3, 1, 1, 1, 1]), (4.0, [2, 1, 1, 1, 1])])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.7, -0.7)])
def test_a_units_p_value_is_over_all_units_and_numbers(tails, counts, direction):
    """Reported just below one percent, and not just above; of fewer than three units a number, combinations are not looked at."""
    lot = small_lot(counts)
    with_all = len(counts) >= 6

    def at(size):
        moved = of_unit(lot, 0, size * np.array(direction))
        return moved, p_of_unit(moved, tails=tails, combined=with_all)

    low, high = 0.5, 4000.0
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if at(middle)[1][0] > 0.01 else (low, middle)
    below, (p, value, z) = at(low * 1.001)
    above, (missed, *_) = at(low / 1.001)
    (each,) = outliers(below, believing(lot, tails=tails))
    assert each.p_value == pytest.approx(p, rel=1e-6)
    assert (each.serial, each.session) == ("u00", "" if counts[0] > 1 else "s0-0")
    if each.reasons[0].what != "combination":
        k = int(np.argmax(np.abs(z)))
        assert each.reasons[0].what == SENSOR_ERRORS[BLAMED[k]].key
        assert (each.reasons[0].value, each.reasons[0].sigmas) == pytest.approx((value[k], z[k]))
    assert 0.01 < missed < 0.0101
    assert outliers(above, believing(lot, tails=tails)) == []


def test_a_drift_is_taken_off_where_it_shows():
    lot = small_lot([1] * 8)
    moved = of_unit(lot, 7, np.array([8.0, 0.0]))
    drift = np.array([16.0, 0.0])
    assert len(outliers(moved, believing(lot))) == 1
    found = believing(lot, drift=drift)
    assert outliers(moved, dataclasses.replace(found, drifts=True))[0].serial == "u00"  # where the drift begins, it is 8 the other way
    assert all(each.serial != "u07" for each in outliers(moved, dataclasses.replace(found, drifts=True)))
    assert [each.serial for each in outliers(moved, found)] == ["u07"]
    about = believing(lot, mean=np.array([8.0, 0.0]))
    assert "u07" not in {each.serial for each in outliers(moved, about)}


def found_of(results):
    lot = lot_sessions(results)
    return outliers(lot, hierarchy(lot))


@pytest.mark.slow
def test_a_clean_lot_has_none():
    """20 lots, one in a hundred by chance: two at most, p = 0.001."""
    assert sum(len(found_of(simulated_lot(80, seed, [1, 2]))) > 0 for seed in range(20)) <= 2


def test_an_odd_unit_of_a_lot_is_said_with_the_number_to_blame():
    by = 12 * (np.arange(COUNT) == B_Y)
    odd = [
        dataclasses.replace(r, values=r.values + by * SPREAD) if r.serial == "serial 00011" else r for r in simulated_lot(100, 1, [1, 3])
    ]
    (each,) = found_of(odd)
    assert (each.serial, each.session, each.reasons[0].what) == ("serial 00011", "", "gyro_bias_y_mdps")
    assert each.reasons[0].value == pytest.approx(-12 * 600, rel=0.4)


@pytest.mark.broad
def test_a_combination_that_is_odd_although_no_number_is():
    """Along the direction in which the lot spreads least: far in sigmas of the whole, near in those of each number."""
    mean, covariance = truth()
    size, direction = np.linalg.eigh(covariance / np.outer(SPREAD, SPREAD))
    by = 9 * np.sqrt(size[0]) * direction[:, 0]
    results = [
        dataclasses.replace(r, values=mean + by * SPREAD) if r.serial == "serial 00017" else r for r in simulated_lot(400, 3, 1, noise=0.02)
    ]
    (each,) = found_of(results)
    assert (each.serial, each.reasons[0].what) == ("serial 00017", "combination")
    assert each.reasons[0].sigmas == pytest.approx(9, rel=0.25)
