"""``turns.csv``: how it is read, what is refused, what the gyro says to it, and a Ferraris session from end to end."""

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, SESSION_TOML, Table, write_session

from session.detect.first_look import check_folder
from session.io.errors import FormatError, SegmentError
from session.io.folder import input_hashes
from tinygc import FitOptions, read_session
from tinygc.closure.prepared import prepare
from tinygc.estimation.fit import fit_session
from tinygc.estimation.results import to_json
from tinygc.reporting.fit_text import fit_report

#: the table of these tests stands in a room that does not turn
NO_EARTH = SESSION_TOML.replace("latitude_deg = 31.03\n", "")
HEADER = "turn,axis,angle_deg,sigma_deg\n"
E = np.eye(3) + np.array([[10, 4, -3], [2, -15, 5], [-6, 1, 20]]) * 1e-3
B = np.array([0.3, -0.5, 0.2]) * DEG
QUICK = FitOptions(methods=("least_squares",))
#: to lie on its six sides, one after the other, from level: axis and angle of each move, and the axis that is vertical then
SIDES = [((1, 0, 0), 90, 1), ((1, 0, 0), -180, 1), ((0, 0, 1), 90, 0), ((0, 0, 1), -180, 0), ((0, 1, 0), 90, 2), ((0, 1, 0), -180, 2)]


def measured(samples):
    """Of a gyro whose true calibration is E and B."""
    return replace(samples, gyro=(samples.gyro - B) @ np.linalg.inv(E).T)


def read(samples, **settings):
    return measured(samples(bias_dps=(0, 0, 0), **settings))


def ferraris(seed=0, **settings):
    """Six sides and three whole circles about the axis that is vertical there, in one log; turns 1, 4 and 7 are the circles."""
    table = Table().rest(6)
    for number, (axis, angle, vertical) in enumerate(SIDES):
        table.turn(angle, axis, 3.0).rest(6)
        if number % 2 == 0:
            table.turn(-360 if number == 2 else 360, np.eye(3)[vertical], 4.0).rest(6)
    return read(table.samples, seed=seed, **settings)


CIRCLES = HEADER + "1,y,360,0.05\n4,x,-360,0.05\n7,z,360,0.05\n"


def with_turns(folder, text):
    (folder / "turns.csv").write_text(text)
    return folder


@pytest.fixture(scope="module")
def ferraris_folder(tmp_path_factory):
    return write_session(tmp_path_factory.mktemp("ferraris") / "one", ferraris(), toml=NO_EARTH)


def of_turns(findings):
    return [finding for finding in findings if finding.what == "known turn"]


# Reading


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
        ("turn,axis,angle,sigma\n0,x,360,0.1\n", "the header must be"),
        ("turn,turn,axis,angle_deg,sigma_deg\n", "the header must be"),
        (HEADER, "a header but no turns"),
        (HEADER + "0,x,360\n", r"line 2: '0,x,360', expected 4 cells"),
        (HEADER + "0,x,360,0.1,5\n", "line 2: .* expected 4 cells"),
        (HEADER + "# said\n\none,x,360,0.1\n", "line 4: turn is 'one', expected a whole number"),
        (HEADER + "-1,x,360,0.1\n", "line 2: turn is '-1'"),
        (HEADER + "1.5,x,360,0.1\n", "line 2: turn is '1.5'"),
        (HEADER + "1e99,x,360,0.1\n", "line 2: turn is '1e99'"),
        (HEADER + "0,w,360,0.1\n", "line 2: axis is 'w', expected x, y or z"),
        (HEADER + "0,--x,360,0.1\n", "line 2: axis is '--x'"),
        (HEADER + "0,0;0;0,360,0.1\n", "line 2: axis is '0;0;0'"),
        (HEADER + "0,1;2,360,0.1\n", "line 2: axis is '1;2'"),
        (HEADER + "0,nan;0;1,360,0.1\n", "line 2: axis is 'nan;0;1'"),
        (HEADER + "0,,360,0.1\n", "line 2: axis is ''"),
        (HEADER + "0,x,full,0.1\n", "line 2: angle_deg is 'full', expected degrees"),
        (HEADER + "0,x,inf,0.1\n", "line 2: angle_deg is 'inf'"),
        (HEADER + "0,x,0,0.1\n", "line 2: angle_deg is '0', expected degrees, not 0"),
        (HEADER + "0,x,1e9,0.1\n", "line 2: angle_deg is '1e9', expected degrees, not 0 and within 36000"),
        (HEADER + "0,x,360,\n", "line 2: sigma_deg is '', expected degrees"),
        (HEADER + "0,x,360,0\n", "line 2: sigma_deg is '0', expected one sigma"),
        (HEADER + "0,x,360,-0.1\n", "line 2: sigma_deg is '-0.1'"),
        (HEADER + "0,x,360,11\n", "line 2: sigma_deg is '11', expected one sigma of the stop, above 0 and up to 10"),
        (HEADER + "0,x,360,0.1\n0,y,360,0.1\n", "line 3: turn 0 is given twice"),
        ("turn,log,axis,angle_deg,sigma_deg\n0,log2,x,360,0.1\n", "line 2: log is 'log2', expected one of log0001.csv"),
        (HEADER + '0,"x,360,0.1\n', "line 2"),
        (HEADER + '0,"' + "1" * 200_000 + '",0,0\n', "line 2"),
    ],
)
def test_a_bad_line_says_where_and_what(tmp_path, samples, text, said):
    with_turns(write_session(tmp_path, samples), text)
    with pytest.raises(FormatError, match=said) as error:
        read_session(tmp_path)
    assert len(str(error.value).splitlines()) == 1
    assert len(str(error.value)) < 300


def test_a_file_that_is_no_text_is_refused(tmp_path, samples):
    write_session(tmp_path, samples)
    (tmp_path / "turns.csv").write_bytes(HEADER.encode() + "0,x,360°,0.1\n".encode("latin-1"))
    with pytest.raises(FormatError, match="not UTF-8"):
        read_session(tmp_path)
    (tmp_path / "turns.csv").unlink()
    (tmp_path / "turns.csv").mkdir()
    with pytest.raises(FormatError, match="cannot be read"):
        read_session(tmp_path)


@pytest.mark.parametrize("reference", ["table", "truth"])
def test_beside_dials_or_a_truth_file_it_is_refused(tmp_path, samples, reference):
    write_session(tmp_path, samples, toml=SESSION_TOML + f'[protocol]\nreference = "{reference}"\n')
    (tmp_path / "attitudes.csv").write_text("still,roll_deg,pitch_deg,yaw_deg\n0,0,0,0\n")
    (tmp_path / "truth0001.csv").write_text("t_s,qw,qx,qy,qz\n0,1,0,0,0\n1,1,0,0,0\n")
    with_turns(tmp_path, HEADER + "0,x,360,0.1\n")
    with pytest.raises(FormatError, match="sees all three angles of every turn; remove the file"):
        read_session(tmp_path)


def test_a_result_depends_on_the_file(ferraris_folder):
    before = input_hashes(read_session(with_turns(ferraris_folder, CIRCLES)))
    after = input_hashes(read_session(with_turns(ferraris_folder, CIRCLES.replace("0.05", "0.06"))))
    assert before["turns.csv"] != after["turns.csv"]
    assert {name for name in before if before[name] != after[name]} == {"turns.csv"}


# What the gyro says


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("1,y,360,0.05", None),
        ("1,y,-360,0.05", "the gyro reads 36.* deg about y: the other way round"),
        ("3,z,450,0.05", "the gyro reads 8.* deg about z: 1 full circle fewer than stated"),
        ("9,x,360,0.05", "there is no such turn: 9 turns, counted from 0"),
    ],
)
def test_a_turn_that_contradicts_the_gyro_is_said_and_not_used(ferraris_folder, row, says):
    """The sense is the right hand's about the sensor's own axis, as a gyro's positive rate is."""
    (finding,) = of_turns(check_folder(with_turns(ferraris_folder, HEADER + row + "\n")))
    problem = prepare(ferraris_folder).problem
    if says is None:
        assert finding.level == "ok"
        assert "the gyro reads" in finding.says
        np.testing.assert_array_equal(np.flatnonzero(problem.batch.turns.known), [1])
        return
    assert finding.level == "warning"
    assert re.search(says, finding.says), finding.says
    assert "not used" in finding.do
    assert problem.batch.turns is None
    assert problem.known_turns[0].problem


def test_the_turn_that_was_meant_is_proposed(ferraris_folder):
    (finding,) = of_turns(check_folder(with_turns(ferraris_folder, HEADER + "2,y,360,0.05\n")))
    assert "such a turn is 1, counted from 0" in finding.do


# Ferraris's protocol


def deviations(result):
    """Of each of the 12 parameters, in its sigmas."""
    truth = np.concatenate([E.ravel(), B])
    return (result.linear.model.vector - truth) / np.sqrt(np.diag(result.covariance))


def test_six_sides_and_three_circles_in_one_log(ferraris_folder):
    """Scale, nonorthogonality and bias: the circles give the scale factors, the moves from side to side the rest."""
    with_turns(ferraris_folder, CIRCLES)
    result = fit_session(ferraris_folder, QUICK)
    assert np.abs(deviations(result)).max() < 4
    assert np.sqrt(np.mean(deviations(result) ** 2)) < 1.6
    sigma = np.sqrt(np.diag(result.covariance))
    assert np.all(sigma[[0, 4, 8]] < 500e-6)
    assert np.all(sigma[:9] < 3e-3)
    assert not result.linear.notes["unobserved"]
    turns = to_json(result)["known_turns"]
    assert [(turn["segment"], turn["used"]) for turn in turns] == [(1, True), (4, True), (7, True)]
    assert all(abs(turn["error_deg"]) < 0.2 for turn in turns)
    assert to_json(result)["methods"]["least_squares"]["holdout"]["yaw_rms_deg"] is not None
    assert "turns of known angle: segments 1 (360" in str(fit_report(result).renderables[0])


def test_three_logs_of_one_circle_each(tmp_path):
    """The scale factors, and the bias; what turns by itself through a circle is named as not observed, and left alone."""
    rows = "turn,log,axis,angle_deg,sigma_deg\n"
    for number, (axis, angle) in enumerate([((0, 1, 0), 90), ((1, 0, 0), 90), ((1, 0, 0), 0)]):
        table = Table().turn(angle, axis, 2.0).rest(3).turn(360, np.eye(3)[number], 4.0).rest(3)
        write_session(tmp_path, read(table.samples, seed=number), f"log{number + 1:04}.csv", NO_EARTH)
        rows += f"0,log{number + 1:04},{'xyz'[number]},360,0.05\n"
    with pytest.raises(SegmentError, match="3 usable segments, expected at least 7"):
        fit_session(tmp_path, QUICK)
    result = fit_session(with_turns(tmp_path, rows), QUICK)
    assert set(result.linear.notes["unobserved"]) == {f"E_{i}{j}" for i in "xyz" for j in "xyz" if i != j}
    seen = [0, 4, 8, 9, 10, 11]
    assert np.abs(deviations(result)[seen]).max() < 4
    assert np.sqrt(np.diag(result.covariance))[[0, 4, 8]].max() < 500e-6
    assert np.abs(result.linear.model.E - np.diag(np.diag(result.linear.model.E))).max() < 0.05
    with pytest.raises(SegmentError, match=r"turns.csv, turn 0 of log0002.csv: the gyro reads .* the other way round"):
        fit_session(with_turns(tmp_path, rows.replace("y,360", "y,-360")), QUICK)


@pytest.mark.slow
def test_swarm_and_net_use_the_circles_too(ferraris_folder):
    with_turns(ferraris_folder, CIRCLES)
    result = fit_session(ferraris_folder, FitOptions(methods=("raw_bias_removed", "least_squares", "pso", "tinygc"), folds=2))
    left = {name: np.sqrt(np.mean(fit.angles[[1, 4, 7], 2] ** 2)) / DEG for name, fit in result.methods.items()}
    assert left["raw_bias_removed"] > 3
    assert max(left["least_squares"], left["pso"], left["tinygc"]) < 0.2
