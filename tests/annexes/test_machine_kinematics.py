"""A table's attitudes, its errors, and the motion of its axes: exact cases."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from session.annexes.machines.description import Axis, Description
from session.annexes.machines.kinematics import attitudes, body_axes, roll_pitch_yaw
from session.annexes.machines.mechanics import AxisErrors, AxisTrack, TableErrors, true_attitudes
from session.io.units import DEG


def axis(name, direction, backlash_deg=0.0):
    return Axis(name, np.array(direction, dtype=float), None, None, 90 * DEG, 200 * DEG, 0.01 * DEG, backlash_deg * DEG, name)


TABLE = Description("three", "virtual", (axis("outer", (0, 0, 1)), axis("middle", (0, 1, 0)), axis("inner", (1, 0, 0))))


def test_three_axes_are_yaw_pitch_and_roll():
    angles = np.array([[30.0, 20.0, 10.0], [-170.0, -50.0, 120.0]]) * DEG
    found = attitudes(TABLE, angles)
    assert np.allclose(found, Rotation.from_euler("ZYX", angles).as_matrix(), atol=1e-12)
    assert np.allclose(roll_pitch_yaw(found), angles[:, ::-1], atol=1e-12)


def test_the_rate_of_each_axis_is_the_derivative_of_the_attitude():
    angles = np.array([[0.4, -0.7, 1.1]])
    for k, about in enumerate(body_axes(TABLE, angles)[0]):
        later = angles + 1e-6 * np.eye(3)[k]
        step = Rotation.from_matrix(attitudes(TABLE, angles)[0]).inv() * Rotation.from_matrix(attitudes(TABLE, later)[0])
        assert step.as_rotvec() / 1e-6 == pytest.approx(about, abs=1e-5)


def test_a_table_without_errors_is_where_it_says():
    angles = np.random.default_rng(1).uniform(-3, 3, (5, 3))
    assert np.allclose(true_attitudes(TABLE, TableErrors.none(TABLE), angles, np.ones((5, 3))), attitudes(TABLE, angles), atol=1e-12)


@pytest.mark.parametrize(
    ("errors", "said", "sense", "expected"),
    [
        (AxisErrors(index=np.array([1e-3, 0, 0, 0])), 0.5, 0, 0.5 + 1e-3 * np.sin(0.5)),
        (AxisErrors(index=np.array([0, 0, 0, 1e-3])), 0.5, 0, 0.5 + 1e-3 * np.cos(1.0)),
        (AxisErrors(backlash=2e-3), 0.5, 1, 0.499),
        (AxisErrors(backlash=2e-3), 0.5, -1, 0.501),
        (AxisErrors(lost=4e-3), 0.5, 0, 0.504),
        (AxisErrors(ripple=1e-3, ripple_cycles=3, ripple_phase=0.2), 0.5, 0, 0.5 + 1e-3 * np.sin(1.7)),
    ],
)
def test_each_error_moves_the_true_angle(errors, said, sense, expected):
    assert errors.true_angle(np.array([said]), np.array([sense]))[0] == pytest.approx(expected, abs=1e-15)


def test_an_axis_goes_from_rest_to_rest_at_its_rate():
    track = AxisTrack(0.2)
    track.turn_to(1.0, 2.2, 1.0, 4.0)
    assert track.busy_until_s == pytest.approx(1.0 + 2.0 + 0.25)
    t = np.linspace(0, 4, 4001)
    said, sense = track.said_and_sense(t)
    rate = np.gradient(said, t)
    assert said[0] == 0.2
    assert said[-1] == pytest.approx(2.2, abs=1e-12)
    assert rate.max() == pytest.approx(1.0, abs=1e-9)
    assert np.abs(np.diff(rate)).max() <= 4.0 * 1e-3 + 1e-9
    assert sense[0] == 0
    assert sense[-1] == 1


def test_a_short_way_never_reaches_the_rate():
    track = AxisTrack()
    track.turn_to(0.0, -0.04, 1.0, 4.0)
    assert track.busy_until_s == pytest.approx(0.2)
    assert track.state(0.1) == pytest.approx((-0.02, -0.4))


def test_play_is_taken_up_before_the_stage_moves():
    track = AxisTrack(backlash=0.1)
    track.turn_to(0.0, 1.0, 1.0, 100.0)
    track.turn_to(10.0, 0.9, 0.1, 100.0)
    track.turn_to(20.0, 0.5, 1.0, 100.0)
    said, sense = track.said_and_sense(np.array([10.0, 10.5, 15.0, 25.0]))
    assert sense.tolist() == pytest.approx([1.0, 0.0, -1.0, -1.0], abs=0.02)
    stage = said - sense * 0.05
    assert stage == pytest.approx([0.95, 0.95, 0.95, 0.55], abs=1e-3)


def test_a_rate_is_reversed_through_rest():
    track = AxisTrack()
    track.turn_at(0.0, 1.0, 2.0)
    assert track.busy_until_s == np.inf
    track.turn_at(3.0, -1.0, 2.0)
    track.turn_at(6.0, 0.0, 2.0)
    assert track.state(2.0) == pytest.approx((1.75, 1.0))
    assert track.state(3.5) == pytest.approx((3.0, 0.0))
    assert track.state(4.0)[1] == pytest.approx(-1.0)
    assert track.busy_until_s == pytest.approx(6.5)


def test_what_a_table_says_is_read_back(tmp_path):
    from session.annexes.machines.angles import header, read_angles, row

    text = [header(TABLE), row("log0001.csv", 1000, 0.5, True, np.array([0.1, -0.2, 3.0])), row("log0002.csv", 5, None, False, np.zeros(3))]
    (tmp_path / "table.csv").write_text("\n".join(text) + "\n")
    found = read_angles(tmp_path / "table.csv", TABLE)
    assert list(found) == ["log0001.csv", "log0002.csv"]
    first = found["log0001.csv"]
    assert first.angles[0] == pytest.approx([0.1, -0.2, 3.0], abs=2e-8)
    assert (first.t_ns[0], first.table_s[0], first.moving[0]) == (1_000_000, 0.5, True)
    assert np.isnan(found["log0002.csv"].table_s[0])


def test_a_description_is_read(tmp_path):
    from session.annexes.machines.description import read_description

    (tmp_path / "table.toml").write_text(
        'schema = "tinygc-table/1"\nmake = "grbl"\nport = "/dev/ttyUSB0"\n[[axis]]\nname = "outer"\ndirection = [0, 0, 2]\n'
        'least_deg = -90\nmost_deg = 270\nfastest_dps = 60\nacceleration_dps2 = 100\nsigma_deg = 0.05\nbacklash_deg = 0.1\nword = "X"\n'
    )
    table = read_description(tmp_path / "table.toml")
    (outer,) = table.axes
    assert (table.name, table.make, outer.word) == ("table", "grbl", "X")
    assert outer.direction.tolist() == [0, 0, 1]
    assert outer.allows(-90 * DEG)
    assert not outer.allows(271 * DEG)
    assert outer.backlash_rad == pytest.approx(0.1 * DEG)
