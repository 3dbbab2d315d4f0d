"""The coach: its sigmas are those of the fit, its words say the turn that it means, its advice helps."""

import numpy as np
import pytest
from coached_hand import guide_of, play, simulated

from session.bench.messages import Progress
from tinygc.models import linear
from tinygc.planning.coach import Coach
from tinygc.planning.proposals import TARGETS
from tinygc.planning.turns import columns, turns_from


@pytest.fixture(scope="module")
def taken():
    """A simulated session's samples, and its segments as the guide hands them over."""
    samples = simulated(16, seed=3)
    return samples, [change.accepted for change in play(guide_of(), samples) if change.accepted]


@pytest.mark.slow
def test_all_at_once_or_one_by_one_it_says_the_same(taken):
    _, segments = taken
    one_by_one, at_once = Coach(), Coach()
    for count in range(1, 9):
        last = one_by_one(Progress(tuple(segments[:count])))
    assert at_once(Progress(tuple(segments[:8]))) == last
    assert last.words
    assert "times its target" in last.reason
    assert last.reason == f"it helps the {last.missing[0]}"
    assert not last.reached


def test_it_stops_when_all_is_reached(taken):
    _, segments = taken
    assert Coach()(Progress(tuple(segments[:1]))).words
    content = Coach(TARGETS * 10)(Progress(tuple(segments)))
    assert content.reached
    assert content.words == ""
    assert content.missing == ()


def test_unobserved_parameters_are_not_taken_for_known(taken):
    """Two segments leave most of twelve parameters where the prior had them: 20 % and 20 dps, thousands of times the target."""
    coach = Coach()
    coach(Progress(tuple(taken[1][:2])))
    assert np.sum(coach.sigma > 100) >= 6


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
