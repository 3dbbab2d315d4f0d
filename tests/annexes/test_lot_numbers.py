"""A lot's numbers as sensor errors, its sessions as arrays in the order of production, by hand."""

import numpy as np
import pytest

from session.io.units import DEG, G
from tinygc import CalibrationError
from tinygc.annexes.lots.lot import (
    COUNT,
    NAMES,
    OWN,
    SENSOR_ERRORS,
    UNITS,
    UnitResult,
    error_sigmas,
    jacobian,
    lot_sessions,
    sensor_errors,
)
from tinygc.models.linear import field_vector

NONE = np.where(np.isin(NAMES, ("E_xx", "E_yy", "E_zz")), 1.0, 0.0)


def test_sensor_errors_are_those_that_a_sensor_is_made_of():
    """Large errors, so that every second-order term shows: rows of given lengths that lean by given angles, and a bias in the reading."""
    scale, bias = np.array([0.2, -0.1, 0.3]), np.array([0.02, -0.03, 0.05])
    lean = {(0, 1): 0.1, (0, 2): -0.2, (1, 0): 0.3, (1, 2): -0.15, (2, 0): 0.25, (2, 1): -0.05}
    rows = np.array([[1.0 if i == j else np.tan(lean[i, j]) for j in range(3)] for i in range(3)])
    M = rows / np.linalg.norm(rows, axis=1)[:, None] * (1 + scale)[:, None]
    E = np.linalg.inv(M)
    # The triad's rows: along z, in the plane of y and z, and free, with given cosines between them.
    xy, xz, yz = 0.1, -0.2, 0.3
    second = np.array([0, np.cos(yz), np.sin(yz)])
    first = np.array([0, (np.sin(xy) - np.sin(xz) * np.sin(yz)) / np.cos(yz), np.sin(xz)])
    first[0] = np.sqrt(1 - first @ first)
    own, force_bias = np.array([0.1, 0.05, -0.2]), np.array([0.3, -0.4, 0.5])
    T = np.linalg.inv(np.array([first, second, [0, 0, 1]]) * (1 + own)[:, None]) - np.eye(3)
    values = np.concatenate([E.ravel(), -E @ bias, T[np.triu_indices(3)], force_bias])
    expected = [*scale / 1e-6, *(lean[key] / 1e-3 for key in sorted(lean)), *bias / (1e-3 * DEG), *own / 1e-6]
    expected += [xy / 1e-3, xz / 1e-3, yz / 1e-3, *force_bias / (1e-3 * G)]
    assert sensor_errors(values) == pytest.approx(expected, rel=1e-9)
    assert sensor_errors(np.stack([NONE, values])) == pytest.approx(np.array([np.zeros(COUNT), expected]), rel=1e-9)
    assert (sensor_errors(values) * UNITS)[:9] == pytest.approx(field_vector(values[:12])[:9], rel=1e-9)
    names = [each.key for each in SENSOR_ERRORS]
    assert (names[0], names[3]) == ("gyro_scale_factor_error_x_ppm", "gyro_misalignment_x_to_y_mrad")
    assert (names[11], names[20]) == ("gyro_bias_z_mdps", "accel_bias_z_mg")


def test_sigmas_go_over_by_the_derivative():
    rng = np.random.default_rng(1)
    at, sigmas = NONE + 0.05 * rng.normal(size=COUNT), 1e-4 * rng.uniform(1, 2, size=COUNT)
    J = jacobian(at)
    for n in range(COUNT):
        step = 1e-4 * (np.arange(COUNT) == n)
        assert J[:, n] == pytest.approx(
            (sensor_errors(at + step) - sensor_errors(at - step)) / 2e-4, rel=1e-5, abs=1e-4 / UNITS.min() * 1e-4
        )
    expected = np.sqrt(np.diag(J @ np.diag(sigmas**2) @ J.T))
    np.testing.assert_allclose(error_sigmas(sigmas, J), expected, rtol=1e-9)
    sigmas[4] = np.nan
    found = error_sigmas(np.stack([sigmas, sigmas]), J)[1]
    lost = int(np.flatnonzero(OWN == 4)[0])
    assert np.isnan(found[lost])
    np.testing.assert_allclose(np.delete(found, lost), np.delete(expected, lost), rtol=0.1)


def result(key, serial, order, sigma=0.1, values=(1.0,), known=(10,)):
    x, covariance = np.full(COUNT, np.nan), np.full((COUNT, COUNT), np.nan)
    x[list(known)] = values
    covariance[np.ix_(known, known)] = np.diag(np.full(len(known), sigma**2))
    return UnitResult(key, serial, f"session {key}", x, covariance, order=order)


def test_sessions_lie_by_unit_and_units_by_their_first_session():
    """A unit's sessions in the order of time; one without a serial number is a unit of its own; a key counts once, and a result without
    any number not at all."""
    lot = lot_sessions(
        [
            result("c", "B", 3.0),
            result("a", "A", 2.0, values=(2.0,)),
            result("b", "B", 1.0, values=(4.0,)),
            result("b", "B", 1.0, values=(9.0,)),
            result("d", "", 0.5, values=(8.0,)),
            result("e", "", 5.0, values=(16.0,)),
            result("f", "F", 0.0, values=(np.nan,)),
            result("g", "G", 0.0, sigma=0.0),
        ]
    )
    assert lot.serials == ["", "B", "A", ""]
    assert lot.names == ["session d", "session b", "session c", "session a", "session e"]
    assert lot.values[:, 10].tolist() == [8, 4, 1, 2, 16]
    assert lot.count.tolist() == [1, 2, 1, 1]
    assert lot.first.tolist() == [0, 1, 3, 4]
    assert lot.unit.tolist() == [0, 1, 1, 2, 3]
    assert (lot.units, lot.sessions) == (4, 5)
    assert lot.place == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert lot.variances[:, 10] == pytest.approx([0.01] * 5)
    assert np.flatnonzero(lot.known.any(axis=0)).tolist() == [10]


def test_a_value_without_error_is_none_and_one_unit_is_no_lot():
    lot = lot_sessions([result("a", "A", 0.0), result("d", "D", 3.0, known=(3, 10), sigma=np.array([0.1, 0.0]))])
    assert (lot.known[:, 3].tolist(), lot.known[:, 10].tolist()) == ([False, True], [True, False])
    for results, units in (([result("a", "A", 0.0), result("b", "A", 1.0)], 1), ([], 0)):
        with pytest.raises(CalibrationError, match=f"two units or more, got {units}"):
            lot_sessions(results)
