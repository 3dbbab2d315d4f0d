"""Units that do not belong to a lot are said with the number that is to blame."""

import dataclasses

import numpy as np
import pytest
from simulated_lots import SPREAD, simulated_lot

from tinygc.annexes.lots.estimate import estimate
from tinygc.annexes.lots.lot import COUNT, lot_sessions
from tinygc.annexes.lots.outliers import outliers


def moved(results, serial, by):
    return [dataclasses.replace(r, values=r.values + by * SPREAD) if r.serial == serial else r for r in results]


def test_odd_units_are_said_the_least_probable_first_with_the_numbers_to_blame():
    bias = 12.0 * (np.arange(COUNT) == 10)
    results = moved(simulated_lot(100, 1, [1, 3]), "serial 00011", bias)
    results = moved(results, "serial 00020", 16 * np.isin(np.arange(COUNT), [0, 2, 4, 6, 8, 10, 20]))
    lot = lot_sessions(results)
    first, second = outliers(lot, estimate(lot))
    assert (second.serial, second.session, [each.what for each in second.reasons]) == ("serial 00011", "", ["gyro_bias_y_mdps"])
    assert second.reasons[0].value == pytest.approx(-12 * 600, rel=0.4)  # the sensor's bias is minus the correction's
    assert second.reasons[0].sigmas == pytest.approx(second.reasons[0].value / 600, rel=0.4)
    assert (first.serial, first.session, len(first.reasons)) == ("serial 00020", "00020-0", 5)
    sizes = [abs(each.sigmas) for each in first.reasons]
    assert sizes == pytest.approx(sorted(sizes, reverse=True), rel=0.02)
    assert first.p_value < second.p_value < 0.01
    assert second.says.startswith("unit serial 00011 does not belong to the lot: gyro bias y -")
    assert first.says.startswith("unit serial 00020, of the single session 00020-0, does not belong to the lot: ")
