"""What does not belong to a lot, and why: units, sessions, and the number that is to blame."""

import dataclasses

import numpy as np
import pytest
from simulated_lots import SPREAD, simulated_lot, truth

from tinygc.annexes.lots.hierarchy import hierarchy
from tinygc.annexes.lots.lot import lot_sessions
from tinygc.annexes.lots.outliers import SESSION, UNIT, UNKNOWN, outliers

B_Y = 10  # of NAMES


def found(results):
    lot = lot_sessions(results)
    return outliers(lot, hierarchy(lot))


def moved(results, serial, by, session=None):
    """Results with a vector (21,), in spreads, added to a unit's sessions, or to one of them."""
    chosen = [r.serial == f"serial {serial:05d}" and (session is None or r.session.endswith(f"-{session}")) for r in results]
    return [dataclasses.replace(r, values=r.values + by * SPREAD) if yes else r for r, yes in zip(results, chosen, strict=True)]


def one_number(sigmas):
    by = np.zeros(21)
    by[B_Y] = sigmas
    return by


@pytest.mark.slow
def test_a_clean_lot_has_none():
    """20 lots, one in a hundred by chance: two at most, p = 0.001."""
    assert sum(len(found(simulated_lot(80, seed, [1, 2]))) > 0 for seed in range(20)) <= 2


@pytest.mark.parametrize(("serial", "kind"), [(11, UNIT), (10, UNKNOWN)])
def test_an_odd_unit_is_said_with_the_number_to_blame(serial, kind):
    """Unit 11 has three sessions, unit 10 one: that one cannot tell who is odd."""
    (each,) = found(moved(simulated_lot(100, 1, [1, 3]), serial, one_number(12)))
    assert (each.serial, each.kind) == (f"serial {serial:05d}", kind)
    assert each.reasons[0].what == "gyro_bias_y_mdps"
    assert each.reasons[0].value == pytest.approx(-12 * 600, rel=0.4)
    assert abs(each.reasons[0].sigmas) == pytest.approx(12, rel=0.4)
    assert each.p_value < 1e-6
    assert "gyro bias y" in each.says


def test_a_bad_session_of_a_good_unit():
    (each,) = found(moved(simulated_lot(100, 1, [1, 3]), 11, one_number(6), session=1))
    assert (each.serial, each.session, each.kind) == ("serial 00011", "00011-1", SESSION)
    assert each.reasons[0].what == "gyro_bias_y_mdps"


def test_a_combination_that_is_odd_although_no_number_is():
    """Along the direction in which the lot spreads least: far in sigmas of the whole, near in those of each number."""
    mean, covariance = truth()
    size, direction = np.linalg.eigh(covariance / np.outer(SPREAD, SPREAD))
    results = simulated_lot(400, 3, 1, noise=0.02)
    by = 9 * np.sqrt(size[0]) * direction[:, 0]
    at = [r for r in results if r.serial == "serial 00017"]
    results = [dataclasses.replace(r, values=mean + by * SPREAD) if r in at else r for r in results]
    (each,) = found(results)
    assert each.serial == "serial 00017"
    assert each.reasons[0].what == "combination"
    assert each.reasons[0].sigmas == pytest.approx(9, rel=0.25)


def test_a_session_that_does_not_close():
    rng = np.random.default_rng(0)
    results = [
        dataclasses.replace(r, closure_deg=0.02 * float(np.exp(0.2 * rng.normal())), floor_deg=0.02) for r in simulated_lot(60, 2, [1, 2])
    ]
    results[30] = dataclasses.replace(results[30], closure_deg=0.2)
    (each,) = found(results)
    assert each.kind == SESSION
    assert each.session == results[30].session
    assert "its closure is 10 times its floor" in each.says


def test_an_odd_unit_whose_session_does_not_close_is_laid_to_the_session():
    rng = np.random.default_rng(0)
    results = []
    for r in moved(simulated_lot(60, 2, 1), 7, one_number(12)):
        times = 20.0 if r.serial == "serial 00007" else 1.0
        results.append(dataclasses.replace(r, closure_deg=0.02 * times * float(np.exp(0.2 * rng.normal())), floor_deg=0.02))
    (each,) = found(results)
    assert each.kind == SESSION
    assert "mistrust the session first" in each.says
