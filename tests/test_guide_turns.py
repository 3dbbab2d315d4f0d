"""Turns that the guide rejects, and why; those that it accepts all the same."""

import numpy as np
import pytest
from coached_hand import guide_of, offline, play, said, with_hand
from conftest import DEG, Table

from session.bench.messages import Advice, Kind, RequestedTurn, Stage
from session.bench.rawfile import Mark, RecordingDecision, decision_of
from session.io.samples import Samples

pytestmark = pytest.mark.broad


def reject(samples: Samples) -> str:
    guide = guide_of()
    changes = play(guide, samples)
    assert guide.accepted == 0
    assert guide.rejected == 1
    (text,) = said(changes, Kind.REJECTED)
    segments = [segment for segment in offline(samples) if segment.accepted and segment.turn_deg > 30]
    assert segments == []
    return text


def test_a_clipped_turn_is_rejected():
    samples = Table().rest(3).turn(800, (0, 1, 0), 2.5).rest(2.5).samples()
    limit = 500 * DEG
    text = reject(Samples(samples.t_ns, np.clip(samples.gyro, -limit, limit), samples.accel))
    assert "clips at 500 dps on y" in text


def test_a_gap_in_a_turn_is_rejected_and_counted():
    samples = Table().rest(3).turn(180, (0, 1, 0), 3).rest(2.5).samples()
    lost = (samples.t_s > 4.0) & (samples.t_s < 4.1)
    kept = Samples(samples.t_ns[~lost], samples.gyro[~lost], samples.accel[~lost])
    assert f"{lost.sum()} samples are missing during the turn" in reject(kept)
    guide = guide_of()
    play(guide, kept)
    assert (guide.health.gaps, guide.health.missing) == (1, lost.sum())


def test_no_turn_is_rejected():
    assert "no turn: 10° < 30°" in reject(Table().rest(3).turn(10, (0, 1, 0), 1.5).rest(2.5).samples())


def test_a_turn_without_end_is_rejected():
    table = Table().rest(3)
    for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)):
        table.turn(500, axis, 9)
    assert "too long for a segment" in reject(table.rest(3).samples())


def test_too_short_a_still_joins_two_turns():
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(0.4).turn(90, (0, 1, 0), 3).rest(2.5).samples()
    guide = guide_of()
    changes = play(guide, samples)
    (text,) = said(changes, Kind.WARNING)
    assert "too short a still" in text
    assert "< 0.7 s" in text
    assert guide.accepted == 1
    assert [segment.accepted for segment in offline(samples)] == [True]


def test_a_bump_does_not_end_a_still():
    """A knock that leaves the attitude as it was: 0.2 s of shaking within the countdown."""
    samples = with_hand(Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.4).samples(), 6.6, 6.8, 1.0)
    guide = guide_of()
    changes = play(guide, samples)
    assert guide.accepted == 1
    assert not said(changes, Kind.WARNING)


def test_a_turn_that_nears_the_full_scale_is_said_to():
    guide = guide_of()
    play(guide, Table().rest(3).turn(700, (0, 1, 0), 3).samples().between(0, int(4.6 * 208)))
    now = guide.instruction
    assert not now.good
    assert "> 425 dps: slower, or it clips" in now.why


TWICE = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).turn(90, (0, 1, 0), 3).rest(2.5)
SIGMAS = (("scale of x", 3.25), ("bias of x", 0.5))


def test_turns_without_their_targets_are_not_done():
    guide = guide_of(2)
    guide.advise(Advice("turn on", "it helps", missing=("scale of x",), sigmas=SIGMAS))
    changes = play(guide, TWICE.samples())
    assert guide.stage is Stage.DONE  # what was asked for has been recorded
    assert said(changes, Kind.DONE) == ["ended, 1 of 2 targets are met: 2 segments"]
    assert guide.instruction.do == "the turns are made, the targets are not: 1 of 2 targets are met"
    assert not guide.instruction.good


def test_enough_is_said_and_the_operator_finishes():
    guide = guide_of(9)
    assert not guide.enough
    guide.advise(Advice("", "there", reached=True, sigmas=SIGMAS[1:]))
    play(guide, TWICE.samples())
    assert guide.stage is Stage.TURN
    assert guide.instruction.do == "enough: finish now"
    changes = guide.decided(decision_of(Mark(0, 0, RecordingDecision("finish").text)))
    assert said(changes, Kind.DONE) == ["done: 2 segments, finished by the operator"]
    assert guide.stage is Stage.DONE


def test_a_cable_that_was_pulled_is_plugged_in_again_and_one_that_never_was_is_connected():
    guide = guide_of(9)
    guide.waits(Stage.FIND_PORT, "no port")
    assert guide.instruction.do == "connect the board"
    play(guide, TWICE.samples())
    guide.waits(Stage.FIND_PORT, "device disconnected")
    assert guide.instruction.do == "plug it in, it goes on by itself"


def test_between_two_rotations_nobody_lets_go():
    guide = guide_of(9)
    play(guide, Table().rest(3).samples())
    quarter = RequestedTurn((1.0, 0.0, 0.0), np.pi / 2)
    guide.advise(Advice("two", "why", movements=(quarter, quarter)))
    samples, words = Table().rest(3).turn(180, (1, 0, 0), 6).samples(), []
    for first in range(0, len(samples), 50):
        guide.feed(samples.between(first, first + 50))
        if guide.turning:
            words.append((guide.turn.path_rad / DEG, guide.instruction.why))
    assert all(("at once the next" in why) == (turned < 0.85 * 90) for turned, why in words)
    assert len({why.split("; ")[1] for _, why in words}) == 2
