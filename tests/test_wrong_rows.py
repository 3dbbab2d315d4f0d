"""One wrong row of dial readings, or one turn without its movement, is found, named and left out; the others stand."""

import numpy as np
import pytest
from conftest import SESSION_TOML, Table, broad, write_session
from looks import serious

from session.detect.first_look import check_folder, check_session
from session.io.samples import Samples
from tinygc import FitOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.estimation.fit import fit_session

TOML = f'{SESSION_TOML}[protocol]\nreference = "table"\n'
#: of the made sensor, which the fit must give back: rows x, y, z
E_TRUE = np.eye(3) + np.array([[0.03, 0.01, -0.004], [-0.006, -0.02, 0.008], [0.002, -0.01, 0.015]])
TURNS = 16


@pytest.fixture(scope="module")
def plan():
    return Table().tumble(TURNS, seed=5)


@pytest.fixture(scope="module")
def dialled(plan, tmp_path_factory):
    """A session with dial readings to 0.05°, of a gyroscope that is 1 to 3 % off."""
    made = plan.samples(odr_hz=104)
    samples = Samples(made.t_ns, made.gyro @ np.linalg.inv(E_TRUE).T, made.accel, made.temp_c)
    folder = write_session(tmp_path_factory.mktemp("dials") / "s", samples, toml=TOML.replace("208.0", "104.0"))
    _, attitude = plan.truth(np.array([(start + stop) / 2 for start, stop in plan.rests]))
    angles = attitude.as_euler("ZYX", degrees=True)[:, ::-1]
    return folder, angles + np.random.default_rng(3).normal(size=angles.shape) * 0.05


def with_rows(folder, angles):
    rows = "".join(f"{i},{','.join(f'{angle:.2f}' for angle in row)}\n" for i, row in enumerate(angles))
    (folder / "attitudes.csv").write_text("still,roll_deg,pitch_deg,yaw_deg\n" + rows)
    return folder


def typo(row, column, by=90.0):
    def spoil(angles):
        angles[row, column] += by

    return spoil


def twice(angles):
    angles[6] = angles[5]


def exchanged(angles):
    angles[[6, 7]] = angles[[7, 6]]


def nothing(angles):
    pass


@pytest.mark.broad
@pytest.mark.parametrize(
    ("spoil", "rows"),
    [
        (nothing, []),
        broad(typo(4, 0), [4]),
        (typo(4, 1, 10.0), [4]),
        (typo(4, 2), [4]),
        broad(typo(9, 2, 2.0), [9]),
        broad(typo(0, 2), [0]),
        broad(typo(TURNS, 2, -90.0), [TURNS]),
        (twice, [6]),
        (exchanged, [6, 7]),
    ],
    ids=["none", "roll", "pitch", "yaw", "yaw by little", "first", "last", "twice", "exchanged"],
)
def test_a_wrong_row_is_named_and_left_out_in_check_and_fit(spoil, rows, dialled):
    folder, angles = dialled
    angles = angles.copy()
    spoil(angles)
    findings = [f for f in check_folder(with_rows(folder, angles)) if f.what == "dial reading"]
    assert [f.where for f in findings] == [f"attitudes.csv line {row + 2}" for row in rows]
    assert all(f.level == "warning" and "left out" in f.says for f in findings)
    problem = build_problem(read_session(folder))
    without = {s for row in rows for s in (row - 1, row) if 0 <= s < TURNS}
    assert {s.number for s in problem.segments if not s.accepted} == without
    np.testing.assert_allclose(problem.first.E, E_TRUE, atol=1e-3)


def test_many_wrong_rows_are_another_convention_and_stay(dialled):
    """Which another line says: no row of many is taken out by the others."""
    folder, angles = dialled
    looked = check_folder(with_rows(folder, np.roll(angles, 1, axis=0)))
    assert not [f for f in looked if f.what == "dial reading"]
    assert ("dials against gravity", "warning") in serious(looked)


@pytest.mark.broad
@pytest.mark.parametrize("turn", [broad(0), 6, broad(TURNS - 1)])
@pytest.mark.parametrize("part", [1.0, 0.6])
def test_a_turn_without_its_movement_is_named_and_left_out(turn, part, plan, tmp_path):
    """Rows of the turn, all or from its middle, are gone, and the stamps have closed up."""
    made = plan.samples(odr_hz=104)
    start, stop = plan.rests[turn][1], plan.rests[turn + 1][0]
    edge = (1 - part) / 2 * (stop - start)
    keep = (made.t_s < start + edge) | (made.t_s > stop - edge)
    t_ns = made.t_ns[: np.count_nonzero(keep)]
    samples = Samples(t_ns, made.gyro[keep], made.accel[keep], made.temp_c[keep])
    folder = write_session(tmp_path / "s", samples, toml=SESSION_TOML.replace("208.0", "104.0"))
    (finding,) = [f for f in check_session(read_session(folder)) if f.what == "movement"]
    assert finding.level == "warning"
    assert f"turn {turn}: gravity leaps by" in finding.says
    result = fit_session(read_session(folder), FitOptions(methods=("least_squares",)))
    assert [s.number for s in result.problem.segments if not s.accepted] == [turn]
    assert any("gravity leaps" in warning.says for warning in result.warnings)
    np.testing.assert_allclose(result.linear.model.E, np.eye(3), atol=5e-4)


@pytest.mark.broad
@pytest.mark.parametrize("factor", [0.25, 0.5, 1e-6])
def test_rates_of_another_scale_are_no_missing_movement(factor, plan, tmp_path):
    """Then every turn moves gravity by more than the rates say: the axes' line says that, or that the gyroscope is dead."""
    made = plan.samples(odr_hz=104)
    folder = write_session(tmp_path / "s", Samples(made.t_ns, made.gyro * factor, made.accel, made.temp_c), toml=SESSION_TOML)
    assert not [f for f in check_session(read_session(folder)) if f.what == "movement"]
