"""The coach: what a turn tells is mechanics, its words and its movement are one turn, its advice ends where all is known."""

import re
from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
from coached_hand import guide_of, play
from conftest import DEG, GRAVITY, Table
from numpy.testing import assert_allclose
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation
from scipy.special import j1

from session.base import rotation
from session.base.units import MG
from session.bench.messages import Progress
from session.bench.progress import LiveAccelerometerFit
from session.detect.accelerometer import PARAMETERS, UPPER
from session.detect.stills import Noise, Still
from session.log.config import Accelerometer
from tinygc.effects.movement import Movement
from tinygc.estimation.accelerometer import JOINT_NAMES
from tinygc.models import linear
from tinygc.planning import turns
from tinygc.planning.coach import PLANNED_SIGMA_RAD, PLANNED_TURN_S, UNKNOWN, Coach
from tinygc.planning.proposals import TARGETS
from tinygc.planning.turns import EIGHTHS, columns, ends, turns_from


def test_what_a_turn_tells_is_what_mechanics_says():
    """A full turn about the level x axis shows its scale by 2 pi; half a turn about the vertical z axis shows E_xz and E_yz by 2."""
    up = np.array([0.0, 0.0, 9.8])
    turns = {turn.words: turn for turn in turns_from(up)}
    full = turns["turn 360° about the board's x axis (level), y up first, until z is up (3 s)"]
    half = turns["turn 180° to the left about the board's z axis, z stays up (3 s)"]
    J = columns(up, [full, half])
    at = {name: i for i, name in enumerate(linear.NAMES)}
    assert np.linalg.norm(J[0][:, at["E_xx"]]) == pytest.approx(2 * np.pi, rel=1e-3)
    assert np.linalg.norm(J[0][:, at["E_yx"]]) < 1e-2
    for name in ("E_xz", "E_yz"):
        assert np.linalg.norm(J[1][:, at[name]]) == pytest.approx(2.0, rel=1e-2)
    assert np.linalg.norm(J[1][:, at["E_zz"]]) < 1e-2  # gravity does not see a turn about itself
    # A zero about y tilts for as long as y is level: for three seconds around the turn, and in it by the cosine of its angle.
    t_s = np.linspace(0, 3, 3001)
    angle = cumulative_trapezoid(np.clip(np.minimum(t_s, 3 - t_s) / 0.5, 0, 1) * 2 * np.pi / 2.5, t_s, initial=0)
    ramps = replace(full, parts=(replace(full.parts[0], ramp_s=0.5),))
    for found, seconds in zip(columns(up, [full, ramps]), (3 * j1(1), np.mean(np.cos(angle)) * 3), strict=True):
        assert np.linalg.norm(found[:, at["B_y"]]) == pytest.approx(3 + seconds, abs=0.06)


RAW = Accelerometer(np.array([[1.011, 0.004, -0.003], [0, 0.992, 0.005], [0, 0, 1.006]]), np.array([0.2, -0.15, 0.1]))


def read_by(accelerometer, force):
    """What an accelerometer reads that its calibration brings to force."""
    return force @ np.linalg.inv(accelerometer.matrix).T + accelerometer.bias_mps2


def forces(count, seed):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    return GRAVITY * direction / np.linalg.norm(direction, axis=1, keepdims=True)


def test_its_columns_are_the_derivatives():
    """Of the length, and of the end attitude that a turn predicts less the one that gravity shows: by differences."""
    own, step = turns.OwnAccelerometer(RAW, 0.0), 1e-6
    first, last = forces(2, 5)[:, None]
    q_first, q_last = rotation.from_gravity(first), rotation.from_gravity(last)
    turn = rotation.multiply(rotation.conjugate(q_first), q_last)[0]
    (lengths,) = own.length_rows(first)
    (tilts,) = own.tilt_rows(first, last, q_first, q_last)
    measured = read_by(RAW, np.concatenate([first, last]))
    for k in range(PARAMETERS):
        matrix, bias = RAW.matrix.copy(), RAW.bias_mps2.copy()
        if k < 6:
            matrix[UPPER[0][k], UPPER[1][k]] += step
        else:
            bias[k - 6] += step
        moved = Accelerometer(matrix, bias).correct(measured)
        assert (np.linalg.norm(moved[0]) - GRAVITY) / step == pytest.approx(lengths[k], abs=1e-5)
        predicted = rotation.multiply(rotation.from_gravity(moved[0]), turn)
        error = rotation.multiply(predicted, rotation.conjugate(rotation.from_gravity(moved[1])))
        assert_allclose(2 * error[1:3] / error[0] / step, tilts[:, k], atol=1e-4)


def still(seconds, force):
    return Still(0, 1, 0.0, seconds, *[np.zeros(3)] * 2, read_by(RAW, force), *[np.zeros(3)] * 2, 25.0)


@pytest.mark.parametrize("gravity_mps2", [0.0, 1e-3, 0.1])
def test_each_still_counts_by_its_white_noise_and_what_the_accelerometer_wanders(gravity_mps2):
    """Of 2 and 8 s: half the mean square density by the seconds, and the square of the rest; an error of gravity is common to both."""
    noise, force = Noise(np.full(3, 1e-4), np.array([1e-3, 2e-3, 3e-3])), forces(2, 1)
    known = turns.OwnAccelerometer(RAW, 4e-4)
    rows, variance = known.length_rows(force), np.mean([1e-6, 4e-6, 9e-6]) / 2 / np.array([2.0, 8.0]) + 1.6e-7
    expected = rows.T @ np.linalg.inv(np.diag(variance) + gravity_mps2**2) @ rows
    found = turns.length_information(known, (still(2.0, force[0]), still(8.0, force[1])), noise, gravity_mps2)
    assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


G = 9.80665


UPRIGHT = r"(\d+)° to the (left|right) about (?:(?:the board's|its) ([xyz]) axis|the vertical), (\S+)(?: and (\S+))? stays? up"


LEVEL = r"(\d+)° about (?:the board's|its) ([xyz]) axis \(level\)(?:, (\S+) up first,)? until (\S+)(?: and (\S+))? (?:is|are) up"


#: the 24 ways in which a box can stand on a table: board to a frame with z up
STANDING = [
    Rotation.from_matrix(matrix)
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
    if np.linalg.det(matrix := np.eye(3)[list(order)] * np.array(signs)[:, None]) > 0
]


def arrow(name):
    return np.eye(3)["xyz".index(name[-1])] * (-1 if name[0] == "-" else 1)


def done(words, lies):
    """What a person does who reads the words beside a board that lies so.  Knows nothing of how they were made."""
    (said,) = re.fullmatch(r"turn (.+) \([34] s\)", words).groups()
    for movement in said.split(", then at once "):
        if found := re.fullmatch(UPRIGHT, movement):
            degrees, side, axis, *stay = found.groups()
            assert not axis or abs(lies.apply(arrow(axis))[2]) == pytest.approx(1)
            about, sense = np.array([0, 0, 1]), 1 if side == "left" else -1
        else:
            degrees, axis, first, *stay = re.fullmatch(LEVEL, movement).groups()
            about = lies.apply(arrow(axis))
            assert about[2] == pytest.approx(0, abs=1e-9)
            sense = np.cross(about, lies.apply(arrow(first or stay[0])))[2]
            assert abs(sense) > 0.7
        lies = Rotation.from_rotvec(about * np.sign(sense) * int(degrees), degrees=True) * lies
        up = sum(arrow(name) for name in stay if name)
        assert_allclose(lies.apply(up / np.linalg.norm(up)), [0, 0, 1], atol=1e-9)
    return lies


def meant(turn, lies):
    for part in turn.parts:
        lies = lies * Rotation.from_rotvec(part.axis * part.angle_rad)
    return lies


def same(a, b, within_rad=1e-9):
    return (a.inv() * b).magnitude() < within_rad


def test_the_words_and_the_movement_are_one_turn():
    """Beside a board that stands so, and by quarter turns about an axis of it that is upright or level, none of which hurries a hand."""
    assert len({tuple(np.round(lies.as_matrix().ravel()).astype(int)) for lies in STANDING}) == 24
    for lies in STANDING[::13]:
        turns = turns_from(lies.inv().apply([0, 0, G]))
        assert len({turn.words for turn in turns}) == len(turns) > 100
        for turn in turns:
            told = done(turn.words, lies)
            assert same(told, meant(turn, lies))
            assert_allclose(told.inv().apply([0, 0, G]), turn.carries(np.array([0, 0, G])), atol=1e-9)
            assert len(turn.parts) in (1, 2)
            assert 3 <= sum(part.seconds for part in turn.parts) <= 4
            for part in turn.parts:
                assert_allclose(sorted(np.abs(part.axis)), [0, 0, 1], atol=1e-12)
                assert part.angle_rad / (np.pi / 2) == pytest.approx(round(part.angle_rad / (np.pi / 2)))
                assert 2 * part.angle_rad / part.seconds < np.deg2rad(245)  # peak of a smooth turn


def test_beside_a_board_that_lies_askew_it_is_set_straight_or_brought_to_the_end_that_is_named():
    rng = np.random.default_rng(0)
    straight = STANDING[7]
    for askew_deg in (10, 28):
        axis = np.append(rng.normal(size=2), 0.0)
        lies = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.deg2rad(askew_deg)) * straight
        force = lies.inv().apply([0, 0, G])
        turns = turns_from(force)
        for turn, *q in list(zip(turns, *ends(force, turns), strict=True))[::9]:
            words = turn.words
            assert words.startswith("with ") == (askew_deg > 20)
            told = done(words.split("up, ", 1)[1] if askew_deg > 20 else words, straight)
            began, ended = (Rotation.from_quat(each, scalar_first=True) for each in q)
            assert_allclose((began.inv() * ended).inv().apply(force), turn.carries(force), atol=1e-9)
            assert same(lies * began.inv() * ended, told)


@pytest.fixture(scope="module")
def taken():
    """A session's segments as the guide hands them over."""
    samples = Table().tumble(6, turn_s=1.5, seed=3).samples(104.0)
    return [change.accepted for change in play(guide_of(odr_hz=104.0), samples) if change.accepted]


def test_what_it_says_is_a_turn_from_where_the_board_lies_and_it_ends_when_all_is_reached(taken):
    """One by one or all at once it says the same; two segments leave most of twelve parameters where the prior had them."""
    one_by_one, few = Coach(), Coach()
    few(Progress(tuple(taken[:2])))
    assert np.sum(few.sigma > 100) >= 6
    for count in range(1, len(taken) + 1):
        advice = one_by_one(Progress(tuple(taken[:count])))
    assert Coach()(Progress(tuple(taken))) == advice
    assert not advice.reached
    assert advice.reason == f"it helps the {advice.missing[0]}"
    (turn,) = (turn for turn in turns_from(taken[-1].segment.stills[1].accel_mean) if turn.words == advice.words)
    moved = [(movement.axis, movement.angle_rad) for movement in advice.movements]
    assert moved == [(tuple(part.axis), part.angle_rad) for part in turn.parts]
    content = Coach(1000 * one_by_one.sigma.max() * TARGETS)(Progress(tuple(taken)))
    assert (content.reached, content.words, content.missing) == (True, "", ())


class Machine:
    """One that can make these turns, and lies as before when it has made one."""

    turns = turns_from(np.array([0.0, 0.0, -G]))[::10]

    def turns_from(self, angles, most_rps):
        return self.turns


def test_a_rehearsal_adds_turn_after_turn_what_each_tells():
    """By the data sheet's noise, which grows with a turn's time; until all targets are met, or so many turns are made."""
    rehearsal = Coach(machine=Machine()).rehearse(False, 3)
    information = np.diag((TARGETS / linear.PRIOR_SIGMA) ** 2)
    for turn, sigma in zip(rehearsal.turns, rehearsal.sigmas, strict=True):
        angle_rad = PLANNED_SIGMA_RAD * np.sqrt(turn.cost_s / PLANNED_TURN_S)
        rows = columns(turn.up * G, Machine.turns)[Machine.turns.index(turn)] / angle_rad * TARGETS
        information += rows.T @ rows
        assert_allclose(sigma, np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-6)
    assert (len(rehearsal.turns), len(Coach(1e9 * TARGETS, machine=Machine()).rehearse(False).turns)) == (3, 1)
    own, most = Coach(machine=Machine()).rehearse(True, 1).sigmas[0], [linear.PRIOR_SIGMA / TARGETS, turns.PRIOR_SIGMA / turns.TARGETS]
    assert (own <= np.concatenate(most) * (1 + 1e-9)).all()


@pytest.mark.parametrize(("machine", "times", "stuck"), [(None, 3, False), (object(), 3, True), (object(), 2, False)])
def test_turns_of_a_machine_that_has_been_everywhere_may_show_no_more(taken, machine, times, stuck):
    coach = Coach(machine=machine)
    coach.look(Progress(tuple(replace(turn) for turn in taken[:5] * times + taken[:1])))
    assert coach._stuck.any() == stuck


def test_columns_follow_an_accelerometer_that_is_known_better(taken):
    stills, coach, anew = tuple(still(2.0, force) for force in forces(14, 9)), Coach(), Coach()
    for accelerometer in (Accelerometer(RAW.matrix, RAW.bias_mps2 + 0.5), RAW):
        coach.look(Progress(tuple(taken), stills, True, accelerometer))
    anew.look(Progress(tuple(taken), stills, True, RAW))
    assert_allclose(coach.sigma, anew.sigma, rtol=1e-9)


def test_a_zero_of_the_gyroscope_moves_nothing_that_a_turn_tells_of_it(taken):
    turn, zero = taken[0], np.array([0.05, -0.1, 0.08])
    first, last = (replace(one, gyro_mean=one.gyro_mean + zero) for one in turn.segment.stills)
    segment, samples = replace(turn.segment, first=first, last=last), replace(turn.samples, gyro=turn.samples.gyro + zero)
    moved = replace(turn, segment=segment, samples=samples)
    of_bias = [Coach()._of(each).columns[:, linear.BIAS] for each in (turn, moved)]
    assert_allclose(*of_bias, atol=1e-9)


@pytest.mark.parametrize(("directions", "asked"), [(4, "all"), (14, "its worst")])
def test_an_accelerometer_that_nobody_calibrated_is_in_its_advice(taken, directions, asked):
    """By eighths of a turn: where its parameters are unknown by the determinant of all, then by the sigma of its worst."""
    stills = tuple(still(2.0, force) for force in forces(directions, 9))
    coach = Coach(1e6 * TARGETS)
    advice = coach(Progress(tuple(taken), stills, True, RAW))
    sigma = coach.sigma
    assert [each for _, each in advice.sigmas] == sigma.tolist()
    assert (sigma.max() > UNKNOWN) == (asked == "all")
    assert np.argmax(sigma) >= linear.PARAMETERS
    assert not advice.reached
    assert {text.split(" (")[0] for text in advice.missing} == {JOINT_NAMES[i] for i in np.flatnonzero(sigma > 1) - linear.PARAMETERS}
    force = RAW.correct(stills[-1].accel_mean)
    turns = turns_from(force, EIGHTHS)
    rows, covariance = coach._rows(force, turns), coach.covariance
    last = np.array([turn.carries(force) for turn in turns])
    white = np.mean(taken[-1].noise.velocity_random_walk ** 2) / 2.0  # of a still of two seconds
    lengths = coach._own.length_rows(last) / np.sqrt(white + coach._own.sigma_mps2**2)
    assert_allclose(rows[:, 2, linear.PARAMETERS :], lengths, rtol=1e-9, atol=1e-12)
    angle = np.sqrt(np.mean([np.trace(seen.own) / 2 for seen in coach._seen.values()]))
    tilts = coach._own.tilt_rows(np.broadcast_to(force, last.shape), last, *ends(force, turns)) / angle
    assert_allclose(rows[:, :2, linear.PARAMETERS :], tilts, rtol=1e-9, atol=1e-9)
    left = [np.linalg.inv(np.linalg.inv(covariance) + row.T @ row) for row in rows]
    if asked == "all":
        rating = [np.linalg.slogdet(each)[1] for each in left]
    else:
        rating = [(np.sqrt(np.diag(each)) / coach.targets)[linear.PARAMETERS :].max() for each in left]
    assert advice.words == turns[int(np.argmin(rating))].words


def test_a_turn_lasts_as_a_hand_and_the_full_scale_allow():
    for turn in turns_from(np.array([0.0, 0.0, G]), most_rps=100 * DEG):
        peak_s = 2 * sum(part.angle_rad for part in turn.parts) / (100 * DEG)
        assert sum(part.seconds for part in turn.parts) == pytest.approx(max(2 + len(turn.parts), peak_s))


@pytest.mark.parametrize("count", [14, 15])
def test_what_an_accelerometer_wanders_is_what_its_stills_leave_of_gravity(count):
    """Of its nine parameters and six stills more; before, what such sensors do."""
    off = 1e-3 * np.random.default_rng(1).normal(size=(count, 1))
    stills = tuple(still(2.0, force) for force in forces(count, 1) * (1 + off))
    scatter = GRAVITY * 1.4826 * np.median(np.abs(off - np.median(off))) * np.sqrt(count / (count - 9))
    expected = scatter if count == 15 else turns.WANDERS_MPS2
    assert turns.as_known(RAW, stills).sigma_mps2 == pytest.approx(expected, rel=1e-4)


def test_an_accelerometer_of_another_full_scale_is_calibrated():
    fit = LiveAccelerometerFit(GRAVITY)
    for force in forces(14, 9):
        one = still(2.0, force)
        fit.add(replace(one, accel_mean=2 * one.accel_mean))
    assert fit.known
    read = 2 * read_by(RAW, forces(14, 9))
    assert_allclose(fit.correct(read), forces(14, 9), atol=1e-3)
    assert fit.spread_mg == (pytest.approx(np.std(np.linalg.norm(read, axis=1)) / MG), pytest.approx(0, abs=0.05))
    assert fit.problem.startswith(f"gravity reads {2 / np.mean(np.diag(RAW.matrix)):.2f} g in all attitudes")


def test_the_columns_of_two_movements_are_the_derivatives_of_where_they_end():
    """By differences of E, whatever the speed's form: a hand's, or a machine's with its ramps."""
    force, step = np.array([0.0, 0.0, G]), 1e-6
    start = Rotation.from_quat(rotation.from_gravity(force), scalar_first=True)

    def end(turn, E):
        vectors = [(np.eye(3) + E) @ part.axis * part.angle_rad for part in turn.parts]
        return start * Rotation.from_rotvec(vectors[0]) * Rotation.from_rotvec(vectors[1])

    for turn in [turn for turn in turns_from(force) if len(turn.parts) == 2][::30]:
        ramps = replace(turn, parts=tuple(replace(part, ramp_s=0.5) for part in turn.parts))
        changes = [(end(turn, E) * end(turn, 0 * E).inv()).as_rotvec()[:2] / step for E in step * np.eye(9).reshape(9, 3, 3)]
        for found in columns(force, [turn, ramps]):
            assert_allclose(found[:, linear.MATRIX].T, changes, atol=0.02)


def test_the_turns_that_part_laws_are_the_movements_that_their_words_name():
    """From a still to a still, their closure's columns those of the same movement of the coach, which integrates it otherwise."""
    n = 50
    like = Movement(3 + np.arange(n), 1.0, *[np.zeros((n, 3))] * 2, np.arange(25.0, 25 + n), np.arange(n) * 1e-4, 600.0, 4.0, 24.0)
    found = turns.trials(like)
    assert {round(float(trial.movement.t_s[-1] - 3), 1) for trial in found} == {3.5, 5.0, 10.0}
    of_E = [i for i, name in enumerate(linear.NAMES) if name.startswith("E_")]
    for trial in found[::40]:
        moved, (before, after) = trial.movement, trial.stills
        assert np.abs(moved.rate).max() <= 0.8 * like.fs_rps
        assert not moved.rate[before].any()
        assert np.abs(moved.rate[after]).max() < 0.02
        assert (before.stop, after.stop - after.start, after.stop) == (25, 25, len(moved.t_s))
        assert (moved.t_s[0], moved.dt_s, moved.temp_c[0], moved.vibration_g2[-1]) == (3.0, 0.04, 49.5, pytest.approx(24.5e-4))
        seconds = round(moved.t_s[-1] - moved.t_s[0] - 2, 1)
        (up,) = (up for up in turns.SIDES if np.allclose(moved.force_g[0], up))
        parts = (part for degrees in turns.QUARTERS for part in turns.parts_from(up, degrees, seconds))
        part = next(part for part in parts if f"turn {part.words} (" in trial.words)
        assert_allclose(moved.rate.sum(axis=0) * 0.04, part.axis * part.angle_rad, atol=1e-3)
        assert_allclose(moved.force_g[-1], part.up, atol=2e-3)
        (turn,) = (turn for turn in turns_from(G * up) if [each.words for each in turn.parts] == [part.words])
        own = linear.columns(np.pad(trial.sensitivity, ((0, 0), (0, 1), (0, 0)))[None], moved.rate[None])[0, :2]
        assert_allclose(own[:, of_E], columns(G * up, [turn])[0][:, of_E], atol=0.02)
