"""The gyro's axes and sensitivity against gravity: 48 orders, the usual mistakes, and what cannot be seen."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from looks import IDENTITY, X_Y_EXCHANGED, look, name_of, of, serious

from session.detect import axes as axes_module
from session.detect.axes import SIGNED_PERMUTATIONS, agreement, axes_in_words
from session.detect.stills import find_stills


@pytest.mark.slow
def test_each_wrong_order_of_the_gyros_axes_is_found(good):
    right = good.calibrated(good.logs[0])
    stills, _ = find_stills(right)
    for axes in SIGNED_PERMUTATIONS:
        # m = axes^T omega, so omega = axes m; the gyro's means in the stills turn with it.
        wrong = replace(right, gyro=right.gyro @ axes)
        found = agreement(wrong, [replace(still, gyro_mean=still.gyro_mean @ axes) for still in stills])
        np.testing.assert_array_equal(found.axes, axes, err_msg=name_of(axes))
        assert found.scale == pytest.approx(1, abs=0.05)
        assert found.misfit < 0.1


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        (np.diag([1, 1, -1.0]), "the gyro's z has the wrong sign; its triad is left-handed"),
        (np.diag([-1, -1, 1.0]), "the gyro's x and y have the wrong sign"),
        (-IDENTITY, "all three axes of the gyro have the wrong sign; its triad is left-handed"),
        (
            X_Y_EXCHANGED,
            "the gyro's x and y are exchanged; true x is the logged +y, y is the logged +x, z is the logged +z; its triad is left-handed",
        ),
        (
            np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]),
            "the gyro's x and y are exchanged; true x is the logged -y, y is the logged +x, z is the logged +z",
        ),
        (
            X_Y_EXCHANGED @ np.diag([1, 1, -1.0]),
            "the gyro's x and y are exchanged; z has the wrong sign; true x is the logged +y, y is the logged +x, z is the logged -z",
        ),
        (
            np.roll(IDENTITY, 1, axis=1),
            "the gyro's axes are in a wrong order; true x is the logged +y, y is the logged +z, z is the logged +x",
        ),
    ],
    ids=name_of,
)
def test_the_mistake_of_axes_is_said_in_words(good, axes, words):
    assert axes_in_words(axes) == words
    findings = look(good, gyro=good.logs[0].samples.gyro @ axes)
    finding = of(findings, "axes")
    assert finding.level == "error"
    assert finding.says.startswith(words + ":")
    assert serious(findings) == {("axes", "error")}


def test_a_mirrored_gyro_is_not_blamed_on_the_mounting_but_a_turned_one_can_be_the_accelerometer():
    made = session_of(Table().tumble(16, seed=5).samples())
    samples = made.logs[0].samples
    assert "a rotation of the board cannot" in of(look(made, gyro=samples.gyro * [1, 1, -1]), "axes").do
    # Of the accelerometer one wrong sign is the same, to gravity's movement, as two of the gyro.
    advice = of(look(made, accel=samples.accel * [1, 1, -1]), "axes").do
    assert "or it is the accelerometer: the accelerometer's z has the wrong sign" in advice
    advice = of(look(made, accel=samples.accel[:, [1, 0, 2]]), "axes").do
    assert "the accelerometer's x and y are exchanged" in advice


def test_gravity_turned_over_does_not_show():
    """Axes forward-left-up for both, or +g at rest: the movement is the same, and nothing is claimed."""
    made = session_of(Table().tumble(16, seed=5).samples())
    samples = made.logs[0].samples
    assert serious(look(made, accel=-samples.accel)) == set()
    assert serious(look(made, accel=samples.accel * [1, -1, -1], gyro=samples.gyro * [1, -1, -1])) == set()


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0)])
def test_turns_about_one_axis_accuse_nobody(axis):
    """Only one axis is seen: what its neighbours do stays unknown, and the least changed order is as logged."""
    table = Table().rest(2)
    for i in range(14):
        table.turn((120 + 10 * i) * (-1) ** i, axis).rest(2)
    findings = look(session_of(table.samples()))
    assert of(findings, "axes").level == "ok"
    assert of(findings, "gyro scale").level == "ok"


@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_turns_of_more_than_a_circle_know_their_scale(factor):
    """At 1000 dps gravity goes round three corners in a quarter of a second."""
    table, rng = Table().rest(2), np.random.default_rng(2)
    for _ in range(16):
        table.turn(rng.uniform(500, 1100) * rng.choice([-1, 1]), rng.normal(size=3), 2.0).rest(2)
    samples = table.samples(odr_hz=416, registers=False)
    assert np.abs(samples.gyro).max() > 800 * DEG
    found = agreement(samples, find_stills(samples)[0])
    assert agreement(replace(samples, gyro=factor * samples.gyro), find_stills(samples)[0]).scale == pytest.approx(1 / factor, rel=0.02)
    assert found.residual < 4 * DEG


def test_turns_about_the_vertical_say_that_nothing_is_seen():
    table = Table().rest(2)
    for i in range(14):
        table.turn(90 * (-1) ** i, (0, 0, 1)).rest(2)
    findings = look(session_of(table.samples()))
    assert of(findings, "gyro against gravity").level == "note"
    assert not [finding for finding in findings if finding.what in ("axes", "gyro scale")]


def test_a_gyro_of_another_board_agrees_with_nothing():
    made = session_of(Table().tumble(16, seed=5).samples())
    other = Table().tumble(16, seed=6).samples()
    findings = look(made, gyro=other.gyro)
    assert ("gyro against gravity", "warning") in serious(findings)
    assert not [finding for finding in findings if finding.what in ("axes", "gyro scale")]


def test_a_closure_run_that_returns_to_its_start_is_no_argument_for_a_scale_of_zero():
    table = Table().rest(3)
    for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)):
        table.turn(400, axis, 4).turn(-400, axis, 4)
    made = session_of(table.rest(3).samples())
    findings = look(made)
    assert of(findings, "axes").level == "ok"
    assert of(findings, "gyro scale").level == "ok"
    assert "deg/s" in of(look(made, gyro=made.logs[0].samples.gyro / DEG), "gyro scale").do


# A hand that pushes: gravity within the turns is hidden, and only how they end from still to still tells.


def flat_turns(share, seed=4, turns=12, push_g=0.16, odr_hz=83.0):
    """Turns about axes in the sensor's level plane, z with this share, the hand pushing by so much: (session, its samples)."""
    rng, table = np.random.default_rng(seed), Table().rest(2.2)
    for _ in range(turns):
        table.turn(rng.uniform(90, 260) * rng.choice([-1, 1]), rng.normal(size=3) * [1, 1, share], 2.0).rest(2.2)
    made = session_of(table.samples(odr_hz=odr_hz, registers=False), odr_hz=odr_hz)
    samples = made.logs[0].samples
    push = np.apply_along_axis(np.convolve, 0, rng.normal(size=(len(samples), 3)), np.hanning(40) / 20, mode="same")
    moves = np.linalg.norm(samples.gyro - np.median(samples.gyro, axis=0), axis=1) > 8 * DEG
    return made, samples.with_accel(samples.accel + moves[:, None] * push * push_g * 9.80665 / push.std())


@pytest.mark.parametrize(
    ("signs", "words"),
    [
        ([-1, -1, -1], "all three axes of the gyro have the wrong sign"),
        ([-1, 1, -1], "the gyro's x and z have the wrong sign:"),
        ([-1, -1, 1], "the gyro's x and y have the wrong sign:"),
    ],
)
def test_axes_are_decided_by_how_turns_end_and_not_by_a_hands_pushes(signs, words):
    """Within the turns several orders leave as much of gravity's movement; from still to still the right one closes ten times better."""
    made, samples = flat_turns(0.12)
    finding = of(look(made, gyro=samples.gyro * signs, accel=samples.accel), "axes")
    assert finding.level == "error"
    assert finding.says.startswith(words)
    (gyro, *_) = finding.corrections
    assert np.diag(gyro.axes).tolist() == signs
    assert of(look(made, gyro=samples.gyro, accel=samples.accel), "axes").level == "ok"


def test_where_two_orders_fit_none_is_chosen():
    """z never turns: its sign is open, so nothing is named, corrected, or said of the scale; as logged, it stays."""
    made, samples = flat_turns(0.0)
    findings = look(made, gyro=samples.gyro * [-1, -1, 1], accel=samples.accel)
    finding = of(findings, "axes")
    assert finding.level == "error"
    assert finding.corrections == ()
    assert "the gyro's x and y have the wrong sign" in finding.says
    assert "all three axes of the gyro have the wrong sign" in finding.says
    assert "2 orders fit alike, and none is chosen" in finding.says
    assert not [each for each in findings if each.what == "gyro scale"]
    assert of(look(made, gyro=samples.gyro, accel=samples.accel), "axes").level == "ok"


@pytest.mark.parametrize(
    ("best_deg", "other", "fits"),
    [
        (4.0, lambda way: 7.9, True),
        (4.0, lambda way: 8.1, False),
        (0.1, lambda way: 0.0098 * way, True),
        (0.1, lambda way: 0.0102 * way, False),
    ],
)
def test_an_order_fits_too_within_twice_the_best_or_a_hundredth_of_the_way(best_deg, other, fits, monkeypatch):
    """How far each order misses is given here: the first two of those that turn the rates' way, and all others by far."""
    _, samples = flat_turns(0.5, push_g=0.0)
    stills = find_stills(samples)[0]
    scales, _ = axes_module._regress(axes_module.cut_turns(samples, list(pairwise(stills))))
    first, second = [i for i in np.flatnonzero(scales > 0) if i != axes_module.IDENTITY][:2]
    missed = np.full(48, 50 * DEG)
    missed[first] = best_deg * DEG
    number = lambda axes: next(i for i, each in enumerate(SIGNED_PERMUTATIONS) if (each == axes).all())  # noqa: E731
    monkeypatch.setattr(axes_module, "_closures", lambda turns, factors: missed)
    ways = {}

    def sharpened(turns, axes, scale):
        ways[number(axes)] = np.median(np.linalg.norm(scale * turns.angle, axis=-1).sum(axis=1)) / DEG
        return scale, missed[number(axes)]

    monkeypatch.setattr(axes_module, "_refine_scale", sharpened)
    agreement(samples, stills)
    missed[second] = other(ways[first]) * DEG
    found = agreement(samples, stills)
    np.testing.assert_array_equal(found.axes, SIGNED_PERMUTATIONS[first])
    assert len(found.others) == fits


def test_whole_circles_tell_the_scale_by_where_they_end():
    """They end as they began, so they tell no axes; a scale that is 12 % off ends 43 degrees away, and is no push of the hand."""
    table, rng = Table().rest(2.2), np.random.default_rng(1)
    for _ in range(6):
        axis = rng.normal(size=3) * [1, 1, 0.1]
        table.turn(360 * rng.choice([-1, 1]), axis, 3.0).rest(2.2)
    made = session_of(table.samples(registers=False))
    samples = made.logs[0].samples
    for factor in (1.0, 1.12):
        found = agreement(replace(samples, gyro=samples.gyro * factor), find_stills(samples)[0])
        assert found.ends == 0
        assert (found.scale, found.scale_std) == (pytest.approx(1 / factor, abs=0.006), 0.03)


def test_gravity_within_the_turns_alone_accuses_no_scale_that_pushes_can_make():
    """Out and back, no end tells a scale: 0.888 is twice what pushes usually make, and a half is not."""
    table = Table().rest(2.2)
    for i in range(8):
        table.turn(120, (1, i % 3 - 1, 0), 2.0).turn(-120, (1, i % 3 - 1, 0), 2.0).rest(2.2)
    made = session_of(table.samples(registers=False))
    gyro = made.logs[0].samples.gyro
    for scale, level in ((0.888, "ok"), (0.82, "ok"), (0.78, "error"), (1.18, "ok"), (1.22, "error"), (0.5, "error")):
        assert of(look(made, gyro=gyro / scale), "gyro scale").level == level


@pytest.mark.parametrize(("lsb_dps", "named"), [(500 / 32768, False), (17.5e-3, True)])
def test_the_step_of_the_readings_refutes_a_sensitivity(lsb_dps, named):
    """Rates that are 15 % too large, in ST's steps: converted with these.  In steps of 500 dps / 32768 they were not."""
    table = Table().tumble(12, seed=5)
    samples = table.samples(registers=False)
    made = session_of(samples, raw=False, model="unknown")
    gyro = np.round(samples.gyro * 1.147 / (lsb_dps * DEG)) * lsb_dps * DEG
    finding = of(look(made, gyro=gyro), "gyro scale")
    assert finding.says.startswith("gravity requires rates x 0.87")
    assert ("sensitivity" in finding.do) == named
    assert finding.level == ("error" if named else "warning")
