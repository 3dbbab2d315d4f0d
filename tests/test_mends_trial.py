"""Events on trial: what the body really did is not mended, what only the readings did is."""

import numpy as np
import pytest
from conftest import DEG, GRAVITY, Table, session_of
from scipy.spatial.transform import Rotation
from spoilt_registers import closed_up, rows_in_turns, with_losses

from session.io.registers import accel_mps2_per_lsb, gyro_rps_per_lsb
from session.io.samples import Samples
from tinygc.closure.build import build_problem
from tinygc.explanation.data_repair import repair
from tinygc.explanation.faulty_readings import FALSE, LOST, RegisterFault, proposed

ODR_HZ, SAMPLES = 208.0, 3


@pytest.fixture(scope="module")
def table() -> Table:
    return Table().tumble(18, seed=11)


@pytest.fixture(scope="module")
def rows(table) -> np.ndarray:
    """One in every third turn: twelve turns are left from which to learn the physics."""
    return rows_in_turns(table, table.samples(odr_hz=ODR_HZ), 1, 5)[::3]


def sensed(table: Table, pushes: dict[int, tuple[np.ndarray, np.ndarray]], seed: int = 3) -> Samples:
    """Readings where at each of the rows the rate has (true, shown) (k, 3) rad/s on top: what it turns the body by, and what is written.

    The attitude is integrated step by step, and gravity follows it.
    """
    rng = np.random.default_rng(seed)
    t_ns = np.rint(np.arange(0, table.duration_s, 1 / ODR_HZ) * 1e6).astype(np.int64) * 1000
    rate, smooth = table.truth(t_ns * 1e-9)
    true, shown = np.zeros_like(rate), np.zeros_like(rate)
    for row, (turned, written) in pushes.items():
        true[row : row + len(turned)] += turned
        shown[row : row + len(written)] += written
    pushed = Rotation.from_rotvec((true[1:] + true[:-1]) / 2 * np.diff(t_ns)[:, None] * 1e-9)
    attitude = [smooth[0]]
    for own, push in zip(smooth[:-1].inv() * smooth[1:], pushed, strict=True):
        attitude.append(attitude[-1] * own * push)
    nyquist = np.sqrt(ODR_HZ / 2)
    gyro = rate + shown + np.multiply((0.5, -0.3, 0.6), DEG) + rng.normal(size=rate.shape) * 5e-3 * DEG * nyquist
    accel = Rotation.concatenate(attitude).inv().apply([0, 0, -GRAVITY]) + rng.normal(size=rate.shape) * 6e-4 * nyquist
    registers = ((gyro, gyro_rps_per_lsb(500)), (accel, accel_mps2_per_lsb(4)))
    return Samples(t_ns, *(np.rint(values / lsb) * lsb for values, lsb in registers), 25 + np.rint(rng.normal(size=len(t_ns)) * 20) / 256)


def excursions(rows: np.ndarray, dps: float, back: bool = False, seed: int = 4) -> dict[int, np.ndarray]:
    """A rate of so much about a random axis for three samples; back: there and back, so that little of it is left in the end."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(len(rows), 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    shape = np.array([1.0, -0.3, -0.5] if back else [1.0, 1.0, 1.0])
    return {int(row): dps * DEG * np.outer(shape, axis) for row, axis in zip(rows, axes, strict=True)}


def mended(table: Table, pushes) -> tuple[list[RegisterFault], object]:
    problem = build_problem(session_of(sensed(table, pushes)))
    return proposed(problem.session), repair(problem)


# False readings


@pytest.mark.parametrize(
    ("dps", "back"), [(60, False), *(pytest.param(*each, marks=pytest.mark.slow) for each in ((8, False), (60, True)))]
)
def test_a_real_knock_is_not_mended_and_the_same_readings_without_one_are(table, rows, dps, back):
    """To the readings of the gyro, both are the same; gravity at the turn's end was turned by the one alone."""
    shown = excursions(rows, dps, back)
    events, knocked = mended(table, {row: (rate, rate) for row, rate in shown.items()})
    assert {(e.id, e.row) for e in events} == {(FALSE, row) for row in rows.tolist()}  # the registers alone propose them
    assert knocked.found == {}
    (verdict,) = knocked.verdicts
    assert verdict.tried_rad > 1.4 * verdict.before_rad
    events_too, spoilt = mended(table, {row: (0 * rate, rate) for row, rate in shown.items()})
    assert events_too == events
    assert list(spoilt.found) == [FALSE]
    assert spoilt.found[FALSE][0] == {"at": rows.tolist(), "samples": SAMPLES}
    (verdict,) = spoilt.verdicts
    assert verdict.before_rad > 1.4 * verdict.tried_rad
    assert spoilt.p_value[FALSE] < 1e-6


# Losses


@pytest.mark.parametrize("count", [4, pytest.param(9, marks=pytest.mark.slow)])
def test_the_same_turns_with_samples_lost_are_mended(table, rows, count):
    lost = with_losses(sensed(table, {}), rows, count)
    found = repair(build_problem(session_of(lost)))
    assert list(found.found) == [LOST]
    assert found.found[LOST][0]["length"] == count
    (verdict,) = (v for v in found.verdicts if v.id == LOST)
    np.testing.assert_allclose([e.row for e in verdict.accepted], closed_up(rows, count), atol=1)
    assert verdict.tried_rad < 0.3 * verdict.before_rad
