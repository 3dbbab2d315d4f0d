"""The coach with a lot: how many turns are enough for this board, and a board that is none of the lot's."""

import json
from functools import partial

import numpy as np
import pytest
from guided_streams import guide_of, play, said, simulated
from lots import MEAN, SIGMA, lot, session_of_unit
from processes import calibrate

from session.bench.messages import Advice, Kind, Progress
from tinygc.annexes.lots.explanation import board_prior
from tinygc.annexes.lots.report import write_lot
from tinygc.planning.coach import Coach
from tinygc.planning.proposals import propose

#: of the simulator's units: 50 ppm, 50 µrad, 20 mdps; their accelerometer is exact
UNIT = {
    "gyro_scale_error": SIGMA[0],
    "gyro_misalignment": SIGMA[1],
    "gyro_bias_dps": 0.02,
    "accel_scale_error": 0.0,
    "accel_misalignment": 0.0,
    "accel_bias_mg": 0.0,
}


def turns_of(**options):
    return [change.accepted for change in play(guide_of(), simulated(8, seed=3, **options)) if change.accepted]


@pytest.fixture(scope="module")
def turns():
    return turns_of(**UNIT)


def test_it_says_how_many_turns_are_enough_and_fewer_than_without_the_lot(turns):
    """The number that it says is what its own movements need, and comes true within two as they are made otherwise."""
    with_lot, without = Coach(beforehand=partial(board_prior, lot())), Coach()
    progress = Progress(tuple(turns[:2]))
    advice = with_lot(progress)
    assert without(progress).says == ""
    lies = turns[1].segment.last.accel_mean
    more, more_without = with_lot.turns_to_go(lies), without.turns_to_go(lies)
    assert advice.says == f"{2 + more} turns are enough for this one"
    assert more < more_without
    assert with_lot.sigma.max() < without.sigma.max()
    assert np.all(with_lot.sigma <= without.sigma * (1 + 1e-9))


@pytest.mark.broad
def test_a_lot_that_knows_all_leaves_nothing_to_turn_for():
    """Spreads below the targets: one turn, which shows that the board belongs, is enough."""
    alike = turns_of(**UNIT | {"gyro_scale_error": SIGMA[0] / 2, "gyro_misalignment": SIGMA[1] / 2, "gyro_bias_dps": 0.001})
    advice = Coach(beforehand=partial(board_prior, lot(SIGMA * np.where(np.arange(12) < 9, 0.5, 0.05))))(Progress(tuple(alike[:1])))
    assert advice.reached
    assert advice.says == "1 turn was enough for this one"


def test_a_board_that_is_none_of_the_lots_is_said_and_the_lot_is_not_reckoned_with():
    """The simulator's own boards, 1 % and 1 dps: hundreds of sigmas of this lot."""
    foreign = turns_of(**UNIT | {"gyro_scale_error": 0.01, "gyro_bias_dps": 1.0})
    coach, without = Coach(beforehand=partial(board_prior, lot())), Coach()
    advice = coach(Progress(tuple(foreign[:3])))
    without(Progress(tuple(foreign[:3])))
    assert advice.says.startswith("this board seems not to be of the lot (probability that it is: ")
    assert "the lot is not used" in advice.says
    np.testing.assert_array_equal(coach.sigma, without.sigma)


def test_the_guide_says_it_once():
    guide = guide_of()
    told = Advice("turn", "why", says="6 turns are enough for this one")
    assert said(guide.advise(told), Kind.STAGE) == ["6 turns are enough for this one"]
    assert said(guide.advise(told), Kind.STAGE) == []
    assert said(guide.advise(Advice("turn", "why", says="7 turns are enough for this one")), Kind.STAGE) == [
        "7 turns are enough for this one"
    ]


@pytest.mark.broad
def test_plan_needs_fewer_with_the_lot_and_takes_few_turns(tmp_path):
    rng = np.random.default_rng(5)
    path = tmp_path / "lot.json"
    write_lot(path, lot())
    vector = MEAN + SIGMA * rng.standard_normal(12)
    eight = session_of_unit(tmp_path / "eight", vector, 8)
    alone, known = propose(eight), propose(eight, lot=path)
    assert known.lot.used == "yes"
    assert known.enough < alone.enough
    four = session_of_unit(tmp_path / "four", vector, 4)
    done = calibrate("plan", four, "--lot", path, "--json", tmp_path / "plan.json")
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "plan.json").read_text())
    assert told["lot"]["belongs_probability"] > 0.95
    assert f"{told['enough']} more turn" in done.stdout


@pytest.mark.broad
def test_record_refuses_a_lot_that_it_could_not_use(tmp_path):
    path = tmp_path / "lot.json"
    write_lot(path, lot(units=3))
    port = ("--port", tmp_path / "none", "--out", tmp_path / "s")
    done = calibrate("record", "--lot", path, *port)
    assert done.returncode == 2
    assert "a lot of 3 units, expected at least 10" in done.stderr
    done = calibrate("record", "--lot", path, "--no-coach", *port)
    assert done.returncode == 2
    assert "--lot tells the coach how many turns are enough" in done.stderr
    assert not (tmp_path / "s").exists()
