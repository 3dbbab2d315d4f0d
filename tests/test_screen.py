"""The screen fits a terminal of 80 x 24 in every state, says what it waits for, and rings; without a terminal it is lines."""

import io

import pytest
from coached_hand import guide_of, play
from conftest import Table
from rich.console import Console

from session.bench.messages import Advice, GuideMessage, Kind, Stage
from session.bench.screen import LiveScreen, PlainLines, view
from session.io.samples import Samples

LONG = Advice(
    "turn 180° about the board's y axis (level), -x up first, until -z is up, then at once 180° about its x axis (level), "
    "-y up first, until -z is up (4 s)",
    "it helps the misalignment of z towards y (12.3 times its target)",
)


def drawn(guide, changes=(), width=80) -> list[str]:
    console = Console(file=io.StringIO(), width=width, force_terminal=True, color_system=None, highlight=False)
    console.print(view(guide, "data/session2 · /dev/ttyACM0", changes))
    return console.file.getvalue().splitlines()


def states():
    """A guide in each of its states, by name."""
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).samples()
    waiting = guide_of()
    waiting.waits(Stage.FIND_PORT, "/dev/ttyACM0: No such file or directory; it is tried again and again, four times a second, for ever")
    yield "port", waiting
    for name, seconds in (("check", 0.5), ("hold", 1.3), ("turn", 2.5), ("turning", 4.5), ("hold again", 6.9), ("accepted", 8.4)):
        guide = guide_of()
        play(guide, samples.between(0, int(seconds * 208)))
        guide.advise(LONG)
        yield name, guide
    done = guide_of(1)
    play(done, samples)
    yield "done", done


@pytest.mark.parametrize("name_guide", list(states()), ids=lambda pair: pair[0])
def test_every_state_fits_80_by_24(name_guide):
    name, guide = name_guide
    changes = [
        GuideMessage(Kind.REJECTED, f"turn {i} rejected: the gyro clips at 573 dps on x, y: turn slower or choose a larger one", i)
        for i in range(4)
    ]
    lines = drawn(guide, changes)
    assert len(lines) <= 22
    assert max(map(len, lines)) <= 80
    text = " ".join(line.strip("│ ") for line in lines)
    now = guide.instruction
    assert now.do[:40] in text
    assert now.why[:40] in text
    if name in ("hold", "hold again"):
        assert "s left" in text
    assert f"{guide.accepted} of {guide.segments} accepted" in text


def test_why_it_waits_is_on_the_screen_with_number_and_bar():
    guide = guide_of()
    samples = Table().rest(4).samples()
    shaken = Samples(samples.t_ns, samples.gyro * 12, samples.accel, samples.temp_c)
    play(guide, shaken)
    assert guide.stage is Stage.HOLD_STILL
    text = " ".join(line.strip("│ ") for line in drawn(guide))
    assert "hold still: hands off the table" in text
    assert "rate scatter" in text
    assert " dps on " in text
    assert "hands off?" in text


def rung(mute: bool) -> int:
    console = Console(file=io.StringIO(), width=80, force_terminal=True)
    with LiveScreen("x", mute, console) as screen:
        for kind in Kind:
            screen.change(GuideMessage(kind, kind.value))
        screen.show(guide_of())
    return console.file.getvalue().count("\a")


def test_the_bell_rings_and_is_muted():
    assert rung(mute=False) == 1 + 1 + 2 + 2 + 3
    assert rung(mute=True) == 0


def test_without_a_terminal_there_are_lines_and_no_control_signs():
    console = Console(file=io.StringIO(), highlight=False, markup=False)
    lines, guide = PlainLines(console), guide_of(1)
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).samples()
    with lines:
        for first in range(0, len(samples), 20):
            for change in guide.feed(samples.between(first, first + 20)):
                lines.change(change)
            lines.show(guide)
    text = console.file.getvalue()
    assert "\x1b" not in text
    assert "\a" not in text
    said = [line.strip() for line in text.splitlines()]
    assert said[0].startswith("wait: the stream is being checked (0.1 of 1.0 s of samples seen")
    assert any("the stream is good: 208.0 Hz" in line for line in said)
    assert said.count("hold still: hands off the table") == 2
    assert any("turn 1 accepted: 120°" in line for line in said)
    assert said[-1].startswith("done: the table may be left")
    assert len(said) < 14
