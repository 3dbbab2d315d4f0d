"""Pictures of explanations: each cause has a panel of its own that shows it, with numbers that are those of the claim."""

from functools import cache

import numpy as np
import pytest
from explained_sessions import FALSE_ROWS, make_explained, make_session
from matplotlib.figure import Figure

from session.io.units import DEG
from tinygc.effects import Effect, Parameter, catalogue, diagonal
from tinygc.explanation.engine import explain_session
from tinygc.noise.turn_gravity import velocity_equations
from tinygc.noise.twin import READ, Variable, variable_of
from tinygc.reporting.pictures.canvas import BEFORE, PALE
from tinygc.reporting.pictures.panels import PAIRS, draw_claim, in_stills
from tinygc.reporting.pictures.values import per_parameter, strongest

session = pytest.fixture(make_session, scope="module", name="session")
explained = pytest.fixture(make_explained, scope="module", name="explained")


def drawn(explanation, number: int):
    """The axes of a claim's first (0) or second (1) panel."""
    (claim,) = [*explanation.claimed, *explanation.findings]
    panels = Figure().subplots(1, 2)
    draw_claim(explanation, claim, *panels)
    return panels[number]


def line(axes, label: str) -> np.ndarray:
    """(n, 2)"""
    (found,) = [each for each in axes.lines if each.get_label() == label]
    return found.get_xydata()


def test_every_effect_that_is_no_rate_names_its_panels():
    assert all(effect.picture in PAIRS for effect in catalogue().values() if effect.kind != "rate")


@pytest.mark.slow
def test_a_clipped_turn_shows_the_readings_at_the_level(explained):
    explanation, _ = explained("saturation")
    axes = drawn(explanation, 0)
    (stuck,) = [each.get_xydata() for each in axes.lines if each.get_label().endswith("at the level")]
    assert len(stuck) >= 10
    assert np.abs(stuck[:, 1]) == pytest.approx(180, abs=0.5)
    axes = drawn(explanation, 1)
    used, left_out = line(axes, "used"), line(axes, "left out")
    assert used[:, 0].max() < 180 < left_out[:, 0].min() + 0.5
    assert np.median(left_out[:, 1]) > 20 * np.median(used[:, 1])


@pytest.mark.slow
def test_a_false_reading_is_drawn_with_its_bridge(explained):
    explanation, _ = explained("glitches")
    axes = drawn(explanation, 0)
    false, bridge = line(axes, "false"), line(axes, "bridge")
    assert len(false) == 3
    assert false[0, 0] in FALSE_ROWS
    assert false[:, 1] - bridge[1:-1, 1] == pytest.approx(2600 * 17.5e-3, abs=1.0)
    t_s = explanation.session.logs[0].samples.t_s
    every = line(drawn(explanation, 1), "x")
    assert every[:, 0] == pytest.approx(t_s[FALSE_ROWS])
    assert every[:, 1] == pytest.approx(2600 * 17.5e-3, abs=1.0)


@pytest.mark.broad
def test_gravitys_misfit_is_least_at_the_offset(explained):
    explanation, _ = explained("gyro_accel_offset")
    curve = drawn(explanation, 0).lines[0].get_xydata()
    assert curve[np.argmin(curve[:, 1]), 0] == pytest.approx(1e3 * explanation.gravity.offset_s, abs=0.5)
    axes = drawn(explanation, 1)
    before, after = (np.sqrt(np.mean(each.get_xydata()[:, 1] ** 2)) for each in axes.lines)
    assert after < 0.8 * before
    equations = velocity_equations(explanation.twin, explanation.naming.fit)
    assert equations.square_at(explanation.gravity.offset_s).sum() == pytest.approx(equations.left(equations.solve()).sum())


@pytest.mark.slow
def test_gravitys_length_is_straightened(explained):
    """Points of each axis lie on a line whose slope is the bias; and level once it is taken off."""
    explanation, _ = explained("accelerometer")
    axes = drawn(explanation, 0)
    for number, bias in enumerate(explanation.claimed[0].parameters["bias_mg"]):
        before, after = (each.get_xydata() for each in axes.lines[3 * number : 3 * number + 2])
        assert np.polyfit(*before.T, 1)[0] == pytest.approx(-bias, abs=0.1)
        assert after[:, 1].std() < 0.2
    assert max(map(abs, explanation.claimed[0].parameters["bias_mg"])) > 2


@pytest.mark.slow
def test_the_earth_gathers_in_the_table(explained):
    explanation, _ = explained("earth")
    axes = drawn(explanation, 0)
    ((north, down),) = line(axes, "mean before")
    assert np.hypot(north, down) == pytest.approx(15.04 / 3.6, abs=1.0)
    assert np.abs(line(axes, "mean after")).max() < 1.0


@pytest.mark.slow
def test_a_shape_without_a_name_is_there_before_and_gone_after(explained):
    """The fit holds it as it holds a name: what it leaves is after, and its curve lies on what was before."""
    explanation, _ = explained("oscillating")
    assert (explanation.claimed, [claim.effect.id for claim in explanation.findings]) == ([], ["unknown.periodic"])
    axes = drawn(explanation, 0)
    curves = [each.get_xydata() for each in axes.lines if len(each.get_xydata()) == in_stills.GRID]
    points = [each.get_xydata() for each in axes.lines if len(each.get_xydata()) == len(explanation.twin.stills)]
    for curve, before, after in zip(curves, points[::2], points[1::2], strict=True):
        off = before[:, 1] - np.interp(before[:, 0], *curve.T)
        assert np.std(before[:, 1]) > 30 > 10 > np.std(after[:, 1])  # mdps; an amplitude of 50 to 80
        assert off == pytest.approx(after[:, 1], abs=3)
    says, recorded = np.concatenate([each.get_xydata() for each in drawn(explanation, 1).lines[:3]]).T
    assert np.polyfit(says, recorded, 1)[0] == pytest.approx(1, abs=0.05)
    (claim,) = explanation.findings
    for entry in strongest(explanation, claim):  # turn by turn as well
        of = per_parameter(explanation, claim, entry)
        assert np.std(of.before - of.law) < 0.5 * np.std(of.before)
        assert np.std(of.after) < 0.5 * np.std(of.before)


def test_an_effect_of_a_matrix_is_drawn_along_its_strongest_column():
    effect = catalogue()["gyro.g_sensitivity"]
    matrix = np.array([[0.01, 0.03, 0.0], [0.0, 0.15, 0.02], [0.04, -0.09, 0.0]]) * DEG
    assert variable_of(effect, matrix.ravel()) == Variable("attitude", 1)
    assert variable_of(effect, matrix.ravel()).words == "gravity along y"


@pytest.mark.broad
def test_a_variable_that_no_movement_holds_is_not_what_the_axis_is_named(explained):
    """Its place is taken by time, and the label says so."""
    effect = Effect(
        id="gyro.humidity",
        equation="ω += k h",
        parameter=Parameter("dps_per_percent", (3,), "dps/%", DEG),
        observable_in=("still", "turn"),
        columns=lambda movement: diagonal(movement.temp_c),
        describe=lambda theta: "",
        discriminating_motion="",
        conditions=("humidity", "%"),
    )
    found = variable_of(effect, np.ones(3))
    assert (found.words, found.units) == ("time", "s")
    twin = explained("nothing")[0].twin
    t_s = found.of_stills(twin)
    starts = np.array([twin.movements[log].t_s[still.start] for log, still in twin.stills])
    assert (t_s > starts).all()
    assert (np.diff(t_s) > 0).all()


@pytest.mark.broad
def test_gravity_along_an_axis_is_positive_where_it_points_down(explained):
    twin = explained("nothing")[0].twin
    for axis in range(3):
        np.testing.assert_allclose(Variable("attitude", axis).of_stills(twin), -twin.force[:, axis] / 9.80665, atol=0.01)
    assert READ["attitude"][1] == "g"


@pytest.fixture(scope="module")
def recorded(shared):
    """``recorded(name)``: the explanation of a recording of the other bench."""
    return cache(lambda name: explain_session(shared / "concealed" / name))


@pytest.mark.slow
def test_a_loss_is_filled_where_the_stamps_had_no_gap(recorded):
    explanation = recorded("case019")
    count = explanation.claimed[0].parameters["length"]
    axes = drawn(explanation, 0)
    stamped, put = line(axes, "as stamped"), line(axes, "put between")
    assert len(put) == count
    assert np.diff(stamped[:, 0]) == pytest.approx(1e3 / 208, rel=0.05)
    assert put[:, 0].min() > 0
    axes = drawn(explanation, 1)
    as_recorded = line(axes, "as recorded")
    whole = as_recorded[:, 0] < 0.5
    assert np.median(as_recorded[~whole, 1]) > 20 * np.median(as_recorded[whole, 1])
    assert np.median(line(axes, "filled")[:, 1]) < 0.03


@pytest.mark.slow
def test_stills_that_were_none_run_away(recorded):
    explanation = recorded("case022")
    axes = drawn(explanation, 0)
    ends = {colour: [each.get_ydata()[-1] for each in axes.lines if each.get_color() == colour] for colour in (BEFORE, PALE)}
    assert len(ends[BEFORE]) == len(explanation.claimed[0].parameters["stills"])
    assert min(ends[BEFORE]) > 5 * max(ends[PALE])
