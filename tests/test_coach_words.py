"""The coach's words, its picture and its estimate are one turn: whoever does what the words say ends where the picture shows."""

import json
import re
import shutil
from itertools import permutations, product
from pathlib import Path

import numpy as np
import pytest
from coached_hand import guide_of
from conftest import broad
from processes import run
from scipy.spatial.transform import Rotation

import session.bench.page
from session.bench.messages import Advice, RequestedTurn, Stage
from session.bench.page.state import _target
from tinygc.planning.coach import PLANNED_FULL_SCALE, Coach, _vector
from tinygc.planning.turns import EDGES, EIGHTHS, SIDES, ends, nearest_up, turns_from, up_words

G = 9.80665
GUIDE = guide_of()
UPRIGHT = r"(\d+)° to the (left|right) about (?:(?:the board's|its) ([xyz]) axis|the vertical), (\S+)(?: and (\S+))? stays? up"
LEVEL = r"(\d+)° about (?:the board's|its) ([xyz]) axis \(level\)(?:, (\S+) up first,)? until (\S+)(?: and (\S+))? (?:is|are) up"
#: the 24 ways in which a box can stand on a table: board to a frame with z up
STANDING = [
    Rotation.from_matrix(matrix)
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
    if np.linalg.det(matrix := np.eye(3)[list(order)] * np.array(signs)[:, None]) > 0
]


def arrow(name: str) -> np.ndarray:
    return np.eye(3)["xyz".index(name[-1])] * (-1 if name[0] == "-" else 1)


def done(words: str, lies: Rotation) -> Rotation:
    """What a person does who reads the words beside a board that lies so.  Knows nothing of how they were made."""
    (said,) = re.fullmatch(r"turn (.+) \([34] s\)", words).groups()
    for movement in said.split(", then at once "):
        if found := re.fullmatch(UPRIGHT, movement):
            degrees, side, axis, *stay = found.groups()
            if axis:
                assert abs(lies.apply(arrow(axis))[2]) == pytest.approx(1)
            lies = Rotation.from_rotvec([0, 0, int(degrees) * (1 if side == "left" else -1)], degrees=True) * lies
        else:
            degrees, axis, first, *stay = re.fullmatch(LEVEL, movement).groups()
            about = lies.apply(arrow(axis))
            assert about[2] == pytest.approx(0, abs=1e-9)
            rises = lies.apply(arrow(first or stay[0]))
            sense = np.cross(about, rises)[2]
            assert abs(sense) > 0.7
            lies = Rotation.from_rotvec(about * np.sign(sense) * int(degrees), degrees=True) * lies
        up = sum(arrow(name) for name in stay if name)
        np.testing.assert_allclose(lies.apply(up / np.linalg.norm(up)), [0, 0, 1], atol=1e-9)
    return lies


def meant(turn, lies: Rotation) -> Rotation:
    for part in turn.parts:
        lies = lies * Rotation.from_rotvec(part.axis * part.angle_rad)
    return lies


def same(a: Rotation, b: Rotation, within_rad=1e-9) -> bool:
    return (a.inv() * b).magnitude() < within_rad


def scipy_of(q) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


def ghost(advice: Advice, lies: Rotation) -> dict:
    GUIDE.stage = Stage.TURN
    GUIDE.asked_for.answered(advice)
    return _target(GUIDE, tuple(lies.as_quat(scalar_first=True).tolist()))


def advice_of(turn) -> Advice:
    return Advice(
        turn.words, "why", movements=tuple(RequestedTurn(_vector(part.axis), part.angle_rad) for part in turn.parts), up=_vector(turn.up)
    )


@pytest.mark.parametrize(
    "lies",
    [*STANDING[::6], *map(broad, STANDING[1::6] + STANDING[2::6] + STANDING[3::6] + STANDING[4::6] + STANDING[5::6])],
    ids=lambda lies: "".join(map(str, np.round(lies.as_matrix()).astype(int).ravel())),
)
def test_the_words_the_movement_and_the_ghost_are_one_turn(lies):
    turns = turns_from(lies.inv().apply([0, 0, G]))
    assert len(turns) > 100
    assert len({turn.words for turn in turns}) == len(turns)
    for turn in turns:
        told = done(turn.words, lies)
        assert same(told, meant(turn, lies))
        assert same(told, scipy_of(ghost(advice_of(turn), lies)["q"]), 1e-3)
        np.testing.assert_allclose(told.inv().apply([0, 0, G]), turn.carries(np.array([0, 0, G])), atol=1e-9)


def test_each_movement_is_about_an_upright_or_level_axis_of_the_board_by_quarter_turns():
    for up in SIDES:
        for turn in turns_from(up * G):
            assert len(turn.parts) in (1, 2)
            assert sum(part.angle_rad for part in turn.parts) <= 2 * np.pi + 1e-9
            for part in turn.parts:
                np.testing.assert_allclose(sorted(np.abs(part.axis)), [0, 0, 1], atol=1e-12)
                assert part.angle_rad / (np.pi / 2) == pytest.approx(round(part.angle_rad / (np.pi / 2)))
                assert 2 * part.angle_rad / part.seconds < np.deg2rad(245)  # peak of a smooth turn: no hand is hurried
            assert 3 <= sum(part.seconds for part in turn.parts) <= 4


@pytest.mark.parametrize("full_scale_dps", [125, 250, 500])
def test_a_small_full_scale_is_given_time(full_scale_dps):
    """No turn that is asked for comes near the end of the gyroscope's range; what fits in the usual time is not slowed."""
    most = PLANNED_FULL_SCALE * np.deg2rad(full_scale_dps)
    for usual, turn in zip(turns_from(SIDES[0] * G), turns_from(SIDES[0] * G, most_rps=most), strict=True):
        peak = max(2 * part.angle_rad / part.seconds for part in turn.parts)
        assert peak <= most * (1 + 1e-12)
        seconds, before = (sum(part.seconds for part in each.parts) for each in (turn, usual))
        assert seconds == pytest.approx(before) if full_scale_dps == 500 else seconds >= before
        assert f"({seconds:.0f} s)" in turn.words


@pytest.mark.broad
def test_an_edge_is_said_as_well():
    """An accelerometer that nobody has calibrated is turned by eighths, too."""
    for up in (*SIDES, *EDGES):
        lies = Rotation.align_vectors([[0, 0, 1]], [up])[0]
        for turn in turns_from(up * G, EIGHTHS)[::9]:
            assert same(done(turn.words, lies), meant(turn, lies))


@pytest.mark.parametrize("seed", [0, broad(1), broad(2)])
def test_after_an_inexact_turn_both_ways_of_reading_lead_to_the_same_end(seed):
    """The board lies askew by up to 30°: set straight and turned as said, or simply brought to the end that is named."""
    rng = np.random.default_rng(seed)
    straight = STANDING[rng.integers(24)]
    axis = np.append(rng.normal(size=2), 0.0)
    lies = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.deg2rad(rng.uniform(2, 30))) * straight
    force = lies.inv().apply([0, 0, G])
    turns = turns_from(force)
    first, last = ends(force, turns)
    assert len(turns) == len(first) == len(last)
    for turn, began, ended in list(zip(turns, first, last, strict=True))[seed::3]:
        words = turn.words
        askew = words.startswith("with ")
        assert askew == ((lies * straight.inv()).magnitude() > np.deg2rad(20))
        if askew:
            assert words.split(" set straight")[0] == f"with {up_words(turn.up)}"
            words = words.split("up, ", 1)[1]
        told = done(words, straight)
        assert same(told, scipy_of(ghost(advice_of(turn), lies)["q"]), 1e-3)
        # The estimate's turn: from where it lies to the very end that the words name.
        carried = scipy_of(began).inv() * scipy_of(ended)
        np.testing.assert_allclose(carried.inv().apply(force), turn.carries(force), atol=1e-9)
        assert same(lies * carried, told, 1e-9)


def test_the_side_it_lies_on_is_the_nearest():
    assert up_words(nearest_up(np.array([1.0, -9.0, 2.0]))) == "-y"
    assert up_words(nearest_up(np.array([5.0, -9.0, 2.0]), with_edges=True)) == "x and -y"
    assert len(EDGES) == 12


@pytest.mark.skipif(shutil.which("node") is None, reason="no node here: turning.js is not run")
def test_the_pages_own_rotations_lead_to_the_ghost(tmp_path):
    """turning.js turns the board about each arrow's axis: it comes to lie where the next arrow begins, and at last on the ghost."""
    targets = [ghost(advice_of(turn), lies) for lies in STANDING for turn in turns_from(lies.inv().apply([0, 0, G]))[::19]]
    (tmp_path / "targets.json").write_text(json.dumps(targets))
    script = """
import { readFileSync } from "node:fs";
const { about, rotated } = await import(process.argv[2]);
let worst = 0, count = 0;
for (const { q, turns } of JSON.parse(readFileSync(process.argv[3])))
  turns.forEach(({ from, axis, angle_deg }, i) => {
    for (const arrow of [[1, 0, 0], [0, 1, 0]]) {
      const there = rotated(about(axis, angle_deg * Math.PI / 180), rotated(from, arrow)), wanted = rotated(turns[i + 1]?.from ?? q, arrow);
      worst = Math.max(worst, ...there.map((part, k) => Math.abs(part - wanted[k])));
      count++;
    }
  });
console.log(JSON.stringify([worst, count]));
"""
    (tmp_path / "check.mjs").write_text(script)
    turning = shutil.copy(Path(session.bench.page.__file__).parent / "files" / "turning.js", tmp_path / "turning.mjs")
    ran = run(["node", tmp_path / "check.mjs", turning, tmp_path / "targets.json"], capture_output=True, text=True, check=True)
    worst, count = json.loads(ran.stdout)
    assert count > 400
    assert worst < 1e-3


def test_what_the_coach_says_is_what_it_reckoned_with(monkeypatch):
    """Words, movements and the side that is up belong to the very turn that it chose."""
    (turn, *_) = [turn for turn in turns_from(np.array([0.3, 0.2, G])) if len(turn.parts) == 2]
    coach = Coach()
    monkeypatch.setattr(coach, "look", lambda progress: None)
    monkeypatch.setattr(Coach, "sigma", np.full(12, 3.0))
    asked = []
    monkeypatch.setattr(coach, "best_turn", lambda accel: asked.append(accel) or turn)

    class Lies:
        accel_mean = np.array([0.3, 0.2, G])

    class Session:
        stills, turns = (Lies,), ()

    advice = coach(Session)
    assert asked[0] is Lies.accel_mean
    assert advice.words == turn.words
    assert advice.movements == tuple(
        RequestedTurn(tuple(part.axis), part.angle_rad, words) for part, words in zip(turn.parts, turn.steps, strict=True)
    )
    assert all(part.words in words for part, words in zip(turn.parts, turn.steps, strict=True))
    assert advice.up == (0.0, 0.0, 1.0)
