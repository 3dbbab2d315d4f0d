"""What the page is told: how the board lies against the simulator's own attitude, the ghost, the closure, the counts; always JSON."""

import numpy as np
import pytest
from coached_hand import CoachedHand, Kept, Silent, guide_of, play, simulated
from conftest import DEG, Table

from session.bench.messages import Advice, RequestedTurn
from session.bench.page.state import Attitude, PageView, closure_deg, exp, inverse, multiply, rotated


def watched(guide, samples, advice=None, portion=20):
    """A stream through the guide and the page, as the recording does it; all states."""
    server, states = Kept(), []
    page = PageView(Silent(), server)
    for first in range(0, len(samples), portion):
        part = samples.between(first, first + portion)
        for change in guide.feed(part):
            page.change(change)
            if change.accepted and advice:
                guide.advise(advice)
        page.watch(guide, part)
        page.show(guide)
        states.append(server.last["state"])
    return page, server, states


def angle_deg(a, b) -> float:
    a, b = np.array(a), np.array(b)
    return float(2 * min(np.linalg.norm(a - b), np.linalg.norm(a + b)) / DEG)


TURNED = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5)


def test_the_board_on_the_page_lies_as_the_table_does():
    """Before the first rest the heading is anyone's; from then on it is the table's."""
    samples, guide, lies = TURNED.samples(), guide_of(), []
    page = PageView(Silent(), Kept())
    for first in range(0, len(samples), 20):
        guide.feed(samples.between(first, first + 20))
        page._sent_s = 0.0  # here nobody waits 40 ms between two portions
        page.watch(guide, samples.between(first, first + 20))
        lies.append((len(guide.taken.stills), page._attitude.q))
    begun = next(q for stills, q in lies if stills == 1)
    assert angle_deg(multiply(inverse(begun), lies[-1][1]), exp(120 * DEG, 0.0, 0.0)) < 0.3


@pytest.mark.parametrize("turn", [(90, (0, 0, 1)), (270, (0, 1, 0)), (200, (0.6, 0.0, 0.8))])
def test_in_mid_turn_the_gyro_carries_it_at_any_portion(turn):
    samples = Table().rest(3).turn(*turn, 3).samples()
    found = []
    for portion in (1, 7, 208):
        attitude = Attitude()
        for first in range(0, len(samples), portion):
            part = samples.between(first, first + portion)
            at_s = (part.t_ns[-1] - samples.t_ns[0]) * 1e-9
            if at_s > 1.5:
                attitude.zero_rps = samples.gyro[:400].mean(axis=0)
            attitude.feed(part, resting=at_s < 2.5)
        found.append(attitude.q)
    assert angle_deg(found[0], found[1]) < 0.05
    assert angle_deg(found[0], found[2]) < 0.05
    axis = np.array(turn[1], float) / np.linalg.norm(turn[1])
    up = rotated(inverse(found[0]), np.array([0.0, 0.0, 1.0]))
    last = samples.accel[-1] / np.linalg.norm(samples.accel[-1])
    assert np.arccos(min(1.0, up @ last)) < 0.6 * DEG, axis  # no lever arm: at the turn's end it reads gravity again


def test_the_state_says_what_the_guide_says():
    guide = guide_of(3)
    samples = simulated(3)
    advice = Advice(
        "turn about x",
        "it helps",
        movements=(RequestedTurn((1.0, 0.0, 0.0), np.pi / 2),),
        sigmas=(("scale of x", 3.25), ("bias of x", 0.5)),
    )
    _, server, states = watched(guide, samples, advice)
    last = states[-1]
    assert last["stage"] == "done"
    assert last["accepted"] == last["wanted"] == 3
    assert last["do"] == guide.instruction.do
    assert last["sigmas"] == [{"name": "scale of x", "of_target": 3.25}, {"name": "bias of x", "of_target": 0.5}]
    assert len(last["up"]) == len(guide.taken.stills)
    np.testing.assert_allclose(np.linalg.norm(last["up"], axis=1), 1, atol=2e-3)
    assert last["closure_deg"] == pytest.approx(closure_deg(guide.taken.turns[-1]), abs=1e-3)
    assert 0.01 < last["closure_deg"] < 10  # an uncalibrated gyro of the simulator
    assert {state["stage"] for state in states} >= {"check stream", "hold still", "turn", "done"}
    held = [state["part"] for state in states if state["stage"] == "hold still"]
    assert max(held) > 0.8
    assert [each["kind"] for each in last["said"]].count("accepted") == 3
    assert server.last["pose"]["full_scale_dps"] == 500


def test_the_ghost_is_the_attitude_behind_the_coachs_turns():
    guide = guide_of()
    advice = Advice("do", "why", movements=(RequestedTurn((1.0, 0.0, 0.0), np.pi / 2), RequestedTurn((0.0, 0.0, 1.0), -np.pi)))
    page, _, states = watched(guide, TURNED.samples(), advice)
    target = states[-1]["target"]
    expected = multiply(multiply(page._still, exp(np.pi / 2, 0.0, 0.0)), exp(0.0, 0.0, -np.pi))
    assert angle_deg(target["q"], expected) < 0.05
    assert [turn["angle_deg"] for turn in target["turns"]] == [90.0, -180.0]
    assert all(state["target"] is None for state in states if state["stage"] != "turn")


def test_a_perfect_sensors_turn_closes():
    guide = guide_of(1)
    (change,) = [change for change in play(guide, TURNED.samples()) if change.accepted]
    assert closure_deg(change.accepted) < 0.05
    turn = change.accepted
    spoilt = turn.samples.gyro * 1.01
    worse = type(turn)(turn.segment, type(turn.samples)(turn.samples.t_ns, spoilt, turn.samples.accel), turn.noise, 1, 0.0)
    assert closure_deg(worse) == pytest.approx(1.2, abs=0.05)  # 1 % of 120°


def test_portions_that_are_followed_together_lead_to_the_same_attitude_and_a_reset_in_between_to_a_level_one():
    hand, samples = CoachedHand(), TURNED.samples()
    one, other = PageView(Silent(), Kept()), PageView(Silent(), Kept())
    for first in range(0, len(samples), 3):
        one._sent_s, other._sent_s = 0.0, np.inf
        for page in (one, other):
            page.watch(hand.guide, samples.between(first, first + 3))
        if first % 90 == 0:
            other._follow(hand.guide)
    other._follow(hand.guide)
    assert angle_deg(one._attitude.q, other._attitude.q) < 0.05
    one._sent_s = np.inf
    one.watch(hand.guide, samples.between(600, 700))
    one.watch(hand.guide, samples.between(0, 100))  # the clock has begun anew, and the board lies level
    one._follow(hand.guide)
    up = rotated(inverse(one._attitude.q), np.array([0.0, 0.0, 1.0]))
    assert up[2] < -0.999  # this table's z points down


def test_a_page_that_fails_ends_no_recording(monkeypatch):
    """It is said once, and the screen goes on being told."""
    from session.bench.page import state as view

    class Told(Silent):
        changes, shown = [], 0

        def change(self, change):
            self.changes.append(change)

        def show(self, guide):
            Told.shown += 1

    page = PageView(Told(), Kept())
    monkeypatch.setattr(view, "state_of", lambda *_: 1 / 0)
    for _ in range(3):
        page.show(guide_of())
    assert Told.shown == 3
    assert [change.text for change in Told.changes] == [
        "the page has failed (ZeroDivisionError: division by zero); the recording goes on without it"
    ]
