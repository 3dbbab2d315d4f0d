"""The guide on simulated streams: its stages, what it accepts and what it waits for; no clock, no port, no terminal."""

from itertools import pairwise

import numpy as np
import pytest
from coached_hand import guide_of, offline, play, simulated, with_hand
from conftest import Table, broad

from session.bench.messages import Advice, Kind, Stage, face_up


@pytest.mark.parametrize(("odr_hz", "seed"), [(104.0, 3), (208.0, 0), broad(208.0, 1), broad(416.0, 2), broad(1667.0, 0)])
def test_what_the_guide_accepts_the_log_holds(odr_hz, seed):
    """Each segment that is accepted live is found, accepted, at the same place by the offline detection of the whole log."""
    samples = simulated(12, odr_hz=odr_hz, seed=seed)
    guide = guide_of(100, odr_hz)
    taken = [change.accepted for change in play(guide, samples) if change.accepted]
    segments = [segment for segment in offline(samples, odr_hz) if segment.accepted]
    assert len(taken) == len(segments) == 12
    for mine, theirs in zip(taken, segments, strict=True):
        first_s = (mine.samples.t_ns[0] - samples.t_ns[0]) * 1e-9
        assert abs(first_s - theirs.start_s) < 0.6  # a still that lasts longer moves its middle
        assert abs(mine.segment.turn_s - theirs.turn_s) < 0.25
        assert abs(mine.segment.turn_deg - theirs.turn_deg) < 1.5


def test_it_goes_through_all_stages_and_ends():
    guide = guide_of(2)
    assert guide.instruction.stage is Stage.FIND_PORT
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).turn(150, (0, 1, 0), 3).rest(2.5).samples()
    stages = []
    for first in range(0, len(samples), 10):
        guide.feed(samples.between(first, first + 10))
        if not stages or guide.stage is not stages[-1]:
            stages.append(guide.stage)
    hold, turn = Stage.HOLD_STILL, Stage.TURN
    assert stages == [Stage.CHECK_STREAM, hold, turn, hold, turn, hold, Stage.DONE]
    assert guide.accepted == 2
    assert guide.feed(samples) == []


def test_the_countdown_runs_down_and_says_what_is_missing():
    guide = guide_of()
    samples = Table().rest(4).samples()
    left = []
    for first in range(0, len(samples), 21):
        guide.feed(samples.between(first, first + 21))
        if guide.stage is Stage.HOLD_STILL:
            now = guide.instruction
            left.append(now.remaining_s)
            assert now.good == (now.remaining_s < guide.hold_s)
    assert left[0] > 0.3  # the first second was looked at as well
    assert left[-1] == pytest.approx(0.0, abs=0.11)
    assert all(a >= b for a, b in pairwise(left))
    assert guide.stage is Stage.TURN


def test_a_hand_on_the_table_is_named_with_number_bar_and_axis():
    guide = guide_of()
    samples = with_hand(Table().rest(12).samples(), 0, 8)
    play(guide, samples.between(0, 6 * 208))
    now = guide.instruction
    assert guide.stage is Stage.HOLD_STILL
    assert not now.good
    words = now.why.split()
    assert " ".join(words[:2]) in ("rate scatter", "it trembles:")
    assert float(words[2]) > float(words[4]) > 0
    assert words[-2:] == ["hands", "off?"]
    play(guide, samples.between(6 * 208, len(samples)))
    assert guide.stage is Stage.TURN


def test_a_hand_that_stays_on_the_table_after_the_turn_is_named():
    """It must not wait in silence for the turn to end: 0.3 s after it has stopped turning it asks for hands off."""
    samples = with_hand(Table().rest(3).turn(120, (1, 0, 0), 3).rest(6).samples(), 5.5, 8.5)
    guide = guide_of()
    play(guide, samples.between(0, 7 * 208))
    now = guide.instruction
    assert now.stage is Stage.HOLD_STILL
    assert "rate scatter" in now.why
    assert now.why.endswith("s: hands off?")
    assert 0.5 < float(now.why.split(" s: hands")[0].split()[-1]) < 1.6
    play(guide, samples.between(7 * 208, len(samples)))
    assert guide.accepted == 1


def test_a_table_that_always_trembles_is_no_dead_end():
    """Four times the sensor's noise, from a fan: after a minute its own calmest blocks are the yardstick."""
    guide = guide_of()
    play(guide, Table().rest(66).samples(gyro_mdps=20.0, accel_ug=60.0))
    assert guide.stage is Stage.TURN


def test_a_steady_turn_is_no_still():
    guide = guide_of()
    play(guide, Table().steady(15, (0, 0, 1), 8).samples())
    assert guide.stage is Stage.HOLD_STILL
    assert "turning at 1" in guide.instruction.why
    assert "about z" in guide.instruction.why


def test_a_creeping_table_is_said_to_creep():
    guide = guide_of()
    play(guide, Table().rest(3).turn(90, (1, 0, 0), 3).steady(0.5, (1, 0, 0), 6).samples())
    assert guide.accepted == 0
    assert "creeps" in guide.instruction.why
    assert "about x" in guide.instruction.why


def test_advice_is_shown_and_ends_the_session_where_asked():
    guide = guide_of(40, stop_at_target=True)
    play(guide, Table().rest(3).samples())
    guide.advise(Advice("turn left about the vertical", "scale of z is known worst, 3.0 times its target"))
    assert guide.instruction.do == "turn left about the vertical"
    assert "3.0 times its target" in guide.instruction.why
    (change,) = guide.advise(Advice("", "every parameter has reached its target", reached=True))
    assert change.kind is Kind.DONE
    assert guide.stage is Stage.DONE


def test_coverage_says_what_was_turned_and_what_was_up():
    guide = guide_of()
    play(guide, Table().rest(3).turn(180, (1, 0, 0), 3).rest(2.5).turn(-90, (0, 1, 0), 3).rest(2.5).samples())
    turned, stills = guide.taken.coverage.turned_deg, guide.taken.coverage.stills
    assert turned["+x"] == pytest.approx(180, abs=1)
    assert turned["-y"] == pytest.approx(90, abs=1)
    assert turned["-x"] + turned["+y"] + turned["+z"] + turned["-z"] < 1
    assert stills == {"+x": 1, "-x": 0, "+y": 0, "-y": 0, "+z": 1, "-z": 1, "slanted": 0}
    assert face_up(np.array([1.0, 1.0, 0.0])) is None
