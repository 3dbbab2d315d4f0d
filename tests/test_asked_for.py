"""What the coach asked for is shown until it is done, and never again: with a coach that is slow, late, or faster than the eye."""

import io
import threading

import numpy as np
import pytest
from coached_hand import guide_of
from conftest import Table, broad
from processes import PATIENCE_S
from rich.console import Console
from test_page_state import Kept, Silent

from session.bench.guide import ANY_TURN
from session.bench.guided_session import CoachThread
from session.bench.messages import SETTLING_S, Advice, Kind, RequestedTurn, Stage
from session.bench.page.state import PageView
from session.bench.screen import PlainLines, view

pytestmark = pytest.mark.broad

THINKS = "one moment: the coach evaluates the last turn"
TABLE = Table().rest(3).turn(120, (1, 0, 0), 3).rest(5).turn(90, (0, 1, 0), 3).rest(5).turn(90, (0, 0, 1), 3).rest(5)
HZ = 208


class SlowCoach:
    """Answers when it is let, and names what it was asked about."""

    def __init__(self):
        self.may, self.asked = threading.Semaphore(0), []

    def __call__(self, progress):
        self.asked.append((len(progress.turns), len(progress.stills)))
        self.may.acquire()
        turn = RequestedTurn((1.0, 0.0, 0.0), np.pi / 2)
        return Advice(f"advice at still {len(progress.stills)}", "why", movements=(turn,), up=(0.0, 0.0, 1.0))


def followed(samples, answers_at_s, portion=20):
    """A session with a coach that answers at these moments: time, stage, instruction, the page's state, whether the table moves."""
    guide, coach, server = guide_of(), SlowCoach(), Kept()
    thread, page = CoachThread(coach), PageView(Silent(), server)
    guide.coached, answers, seen = True, list(answers_at_s), []
    console = Console(file=io.StringIO(), highlight=False, markup=False)
    lines = PlainLines(console)
    try:
        for first in range(0, len(samples), portion):
            part = samples.between(first, first + portion)
            at_s = (part.t_ns[-1] - samples.t_ns[0]) * 1e-9
            changes = guide.feed(part)
            page.watch(guide, part)
            for each in (page, lines):
                each.show(guide)  # before the coach is heard: what a screen may show between two steps of the loop
            seen.append((at_s, guide.instruction, server.last["state"], len(guide.taken.stills), guide.turn.moving))
            if answers and at_s >= answers[0]:
                answers.pop(0)
                coach.may.release()
                wait_for(thread)
            for change in [*changes, *thread.hear(guide)]:
                page.change(change)
                lines.change(change)
            page.show(guide)
            lines.show(guide)
            seen.append((at_s, guide.instruction, server.last["state"], len(guide.taken.stills), guide.turn.moving))
    finally:
        coach.may.release(100)
        thread.close()
    return guide, seen, coach, console.file.getvalue()


def wait_for(thread):
    thread._pending.result(timeout=PATIENCE_S)


def judged_s(seen, stills):
    return next(at_s for at_s, _, _, count, _ in seen if count == stills)


@pytest.fixture(scope="module")
def samples():
    return TABLE.samples()


@pytest.mark.parametrize("late_s", [broad(0.1), 1.0, broad(1.9), 3.0])
def test_advice_is_never_shown_for_another_still_than_its_own(samples, late_s):
    """At each moment, on the terminal and on the page: the advice for the present still, or none."""
    _, seen, coach, text = followed(samples, [8.0 + late_s, 16.0 + late_s, 24.0 + late_s])
    assert coach.asked == [(1, 2), (2, 3), (3, 4)]
    shown = [(at_s, now.do, state, stills) for at_s, now, state, stills, _ in seen if now.do.startswith("advice")]
    assert {do for _, do, _, _ in shown} == {f"advice at still {stills}" for stills in (2, 3, *([4] if late_s < 2 else []))}
    for at_s, now, state, stills, _ in seen:
        assert state["do"] == now.do
        if now.do.startswith("advice"):
            assert now.do == f"advice at still {stills}"
        assert (state["target"] is not None) == now.do.startswith("advice"), at_s
    lines = [line.strip() for line in text.splitlines() if line.strip().startswith("advice")]
    assert [line.split(" (")[0] for line in lines] == [f"advice at still {n}" for n in sorted({int(do[-1]) for _, do, _, _ in shown})]


def test_until_the_coach_answers_it_says_that_it_thinks_and_then_that_any_turn_will_do(samples):
    guide, seen, _, _ = followed(samples, [8.1])
    begins_s = judged_s(seen, 3)
    rests = [(at_s - begins_s, now.do) for at_s, now, _, stills, moving in seen if stills == 3 and not moving and now.stage is Stage.TURN]
    assert {do for after_s, do in rests if after_s < 1.9} == {THINKS}
    assert {do for after_s, do in rests if after_s > 2.1} == {ANY_TURN}
    assert guide.advice.words == "advice at still 2"  # its sigmas stay on the screen, its words do not
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system=None, highlight=False)
    console.print(view(guide, "title", []))
    assert "advice at still 2" not in console.file.getvalue()


def test_an_answer_that_comes_a_turn_too_late_is_not_shown(samples):
    """What it says of still 2 comes in still 3: its sigmas are shown, its words are not; the coach is asked again, about still 3."""
    guide, seen, coach, text = followed(samples.between(0, int(19 * HZ)), [16.0, 16.5])
    assert coach.asked == [(1, 2), (2, 3)]
    assert [now.do for _, now, state, _, _ in seen if now.do == "advice at still 2" or (state["target"] and now.do == THINKS)] == []
    assert "advice at still 2" not in text
    assert any(now.do == "advice at still 3" for at_s, now, _, _, _ in seen if 16.5 < at_s < 19)
    assert guide.advice.words == "advice at still 3"


def test_after_a_rejected_turn_the_coach_is_asked_for_where_the_board_lies_now(samples):
    """Too small a turn: the turns that count are the same, the board lies elsewhere."""
    table = Table().rest(3).turn(120, (1, 0, 0), 3).rest(5).turn(20, (0, 1, 0), 3).rest(5)
    guide, seen, coach, _ = followed(table.samples(), [8.2, 16.2])
    assert guide.rejected == 1
    assert coach.asked == [(1, 2), (1, 3)]
    assert seen[-1][1].do == "advice at still 3"


def test_between_two_movements_a_short_rest_does_not_end_the_turn():
    """The second movement stays on the screen for as long as a rest is no still; and after it the turn is over as always."""
    pair = (RequestedTurn((1.0, 0.0, 0.0), np.pi / 2), RequestedTurn((0.0, 0.0, 1.0), np.pi))
    table = Table().rest(3).turn(90, (1, 0, 0), 1.5).rest(0.5).turn(180, (0, 0, 1), 2).rest(3)
    samples = table.samples()
    ends = {}
    for movements in ((), pair):
        guide, stages = guide_of(), []
        for first in range(0, len(samples), 5):
            changes = guide.feed(samples.between(first, first + 5))
            if any(change.kind is Kind.READY for change in changes):
                guide.advise(Advice("first this; then that", "why", movements=movements))
            stages.append(((first + 5) / HZ, guide.stage, guide.instruction.do))
        assert guide.accepted == 1
        ends[len(movements)] = next(at_s for at_s, stage, _ in stages if stage is Stage.HOLD_STILL and at_s > 3)
        if movements:
            assert {do for at_s, _, do in stages if 3.5 < at_s < 6.9} == {"first this; then that"}
    assert ends[0] < 5  # in the rest between
    assert ends[2] == pytest.approx(7 + SETTLING_S, abs=0.25)
