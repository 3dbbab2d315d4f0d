"""``turns.csv``: how it is read, what is refused, what the gyro says to it, what ``simulate`` writes, and Ferraris's circles fitted."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import SESSION_TOML, Table, write_session

from session.base.errors import FormatError, SegmentError
from session.base.units import DEG
from tinygc import CalibrationError, SimulationOptions, fit, read_session, simulate

#: the table of these tests stands in a room that does not turn
NO_EARTH = SESSION_TOML.replace("latitude_deg = 31.03\n", "")
HEADER = "turn,axis,angle_deg,sigma_deg\n"
E = np.eye(3) + np.array([[10, 4, -3], [2, -15, 5], [-6, 1, 20]]) * 1e-3
B = np.array([0.3, -0.5, 0.2]) * DEG


def measured(samples):
    """Of a gyro whose true calibration is E and B."""
    return replace(samples, gyro=(samples.gyro - B) @ np.linalg.inv(E).T)


def read(samples, **settings):
    return measured(samples(bias_dps=(0, 0, 0), **settings))


def with_turns(folder, text):
    (folder / "turns.csv").write_text(text)
    return folder


def test_a_row_is_what_it_says(tmp_path, samples):
    write_session(tmp_path, samples)
    with_turns(
        tmp_path, "# stop\nsigma_deg, log,turn,angle_deg,axis\n0.05,,3,-720,-Z\n\n0.1,log0001,0,90,0;3;4\n.01,log0001.csv,1,45.5,+x\n"
    )
    down, slanted, x = read_session(tmp_path).turns
    assert (down.turn, down.log, down.words) == (3, None, "-Z")
    np.testing.assert_allclose([down.angle_rad, down.sigma_rad], np.multiply([-720, 0.05], DEG))
    np.testing.assert_array_equal(down.axis, [0, 0, -1])
    np.testing.assert_allclose(slanted.axis, [0, 0.6, 0.8])
    assert (slanted.log, x.log, x.angle_rad) == ("log0001.csv", "log0001.csv", pytest.approx(45.5 * DEG))


@pytest.fixture(scope="module")
def samples():
    return Table().tumble(2, seed=1).samples()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the header must be turn,axis,angle_deg,sigma_deg"),
        (HEADER, "a header but no turns"),
        (HEADER + "0,x,360\n", r"line 2: '0,x,360', expected 4 cells"),
        (HEADER + "# said\n\none,x,360,0.1\n", "line 4: turn is 'one', expected a whole number"),
        (HEADER + "0,w,360,0.1\n", "line 2: axis is 'w', expected x, y or z"),
        (HEADER + "0,0;0;0,360,0.1\n", "line 2: axis is '0;0;0'"),
        (HEADER + "0,x,inf,0.1\n", "line 2: angle_deg is 'inf'"),
        (HEADER + "0,x,1e9,0.1\n", "line 2: angle_deg is '1e9', expected degrees, not 0 and within 36000"),
        (HEADER + "0,x,360,11\n", "line 2: sigma_deg is '11', expected one sigma of the stop, above 0 and up to 10"),
        (HEADER + "0,x,360,0.1\n0,y,360,0.1\n", "line 3: turn 0 is given twice"),
        ("turn,log,axis,angle_deg,sigma_deg\n0,log2,x,360,0.1\n", "line 2: log is 'log2', expected one of log0001.csv"),
    ],
)
def test_a_bad_line_says_where_and_what(tmp_path, samples, text, said):
    with_turns(write_session(tmp_path, samples), text)
    with pytest.raises(FormatError, match=said) as error:
        read_session(tmp_path)
    assert len(str(error.value).splitlines()) == 1
    assert len(str(error.value)) < 300


def deviations(result):
    """Of each of the 12 parameters, in its sigmas."""
    truth = np.concatenate([E.ravel(), B])
    return (result.linear.model.vector - truth) / np.sqrt(np.diag(result.covariance))


def test_three_logs_of_one_circle_each(tmp_path):
    """The scale factors, and the bias; what turns by itself through a circle is named as not observed, and left alone."""
    rows = "turn,log,axis,angle_deg,sigma_deg\n"
    for number, (axis, angle) in enumerate([((0, 1, 0), 90), ((1, 0, 0), 90), ((1, 0, 0), 0)]):
        table = Table().turn(angle, axis, 2.0).rest(3).turn(360, np.eye(3)[number], 4.0).rest(3)
        write_session(tmp_path, read(table.samples, seed=number), f"log{number + 1:04}.csv", NO_EARTH)
        rows += f"0,log{number + 1:04},{'xyz'[number]},360,0.05\n"
    result = fit(with_turns(tmp_path, rows), methods="least_squares").result
    assert set(result.linear.notes["unobserved"]) == {f"E_{i}{j}" for i in "xyz" for j in "xyz" if i != j}
    seen = [0, 4, 8, 9, 10, 11]
    assert np.abs(deviations(result)[seen]).max() < 4
    assert np.sqrt(np.diag(result.covariance))[[0, 4, 8]].max() < 500e-6
    assert np.abs(result.linear.model.E - np.diag(np.diag(result.linear.model.E))).max() < 0.05
    for wrong, says in (
        ("y,-360", "36.* deg about y: the other way round"),
        ("y,720", "36.* deg about y: 1 full circle fewer than stated"),
    ):
        with pytest.raises(SegmentError, match=f"turns.csv, turn 0 of log0002.csv: the gyro reads {says}"):
            fit(with_turns(tmp_path, rows.replace("y,360", wrong)), methods="least_squares")


CHOICES = {"segments": 14, "closure_s": 0.0, "odr_hz": 104.0, "stop_sigma_deg": 0.02}


def test_stops_err_as_they_are_asked_to_and_change_nothing_else():
    """The readings are the same whatever the stop; stated angles scatter by its sigma, on the seed's own stream."""
    none, fine, coarse = (simulate(seed=5, **CHOICES | {"stop_sigma_deg": sigma}).session for sigma in (0.0, 0.02, 2.0))
    assert none.turns == ()
    np.testing.assert_array_equal(coarse.logs[0].samples.gyro, none.logs[0].samples.gyro)
    errors = np.subtract(*([turn.angle_rad for turn in session.turns] for session in (coarse, fine))) / (1.98 * DEG)
    assert 0.3 < np.sqrt(np.mean(errors**2)) < 2
    with pytest.raises(CalibrationError, match="stop_sigma_deg is -1"):
        SimulationOptions(stop_sigma_deg=-1.0)
