"""A chamber: set, wait until it is stable, limits, and one that answers nothing."""

import pytest

from session.annexes.machines.chamber import ChamberDialogue, VirtualChamber, read_chamber, wait_until_stable
from session.annexes.machines.clocks import SimulatedClock
from session.annexes.machines.verbs import TableFault, TableLimit
from session.annexes.machines.wire import VirtualLink
from session.io.errors import FormatError

TEXT = """schema = "tinygc-chamber/1"
set = "SOUR:TEMP {temperature}"
read = "MEAS:TEMP?"
answer = "{temperature}"
least_c = -40
most_c = 85
stable_s = 120
rest_c = 25
"""


@pytest.fixture
def opened(tmp_path):
    def open_(text=TEXT, tau_s=300.0):
        (tmp_path / "chamber.toml").write_text(text)
        clock = SimulatedClock()
        virtual = VirtualChamber(clock, 25.0, tau_s)
        return ChamberDialogue(read_chamber(tmp_path / "chamber.toml"), VirtualLink(virtual, clock), clock), virtual, clock

    return open_


def test_it_is_stable_when_it_has_stayed(opened):
    """35 degC of way with one time constant come within 0.5 degC after tau ln 70; then two minutes."""
    chamber, virtual, clock = opened()
    assert wait_until_stable(chamber, 60.0, clock)
    assert virtual.temperature() == pytest.approx(60, abs=0.5)
    assert clock.now_s() == pytest.approx(300 * 4.2485 + 120, abs=12)
    chamber.close()
    clock.sleep(5000)
    assert virtual.temperature() == pytest.approx(25, abs=0.01)


def test_beyond_its_limits_nothing_is_sent(opened):
    chamber, virtual, clock = opened()
    with pytest.raises(TableLimit, match="expected -40 to 85; nothing was sent"):
        chamber.set(86.0)
    clock.sleep(1000)
    assert virtual.temperature() == 25


def test_one_that_never_arrives_is_said(opened):
    chamber, _, clock = opened(TEXT + "longest_s = 600\n", tau_s=1e5)
    with pytest.raises(TableFault, match="after 10 min, asked for was 60"):
        wait_until_stable(chamber, 60.0, clock)


def test_a_wait_can_be_ended(opened):
    chamber, _, clock = opened()
    assert not wait_until_stable(chamber, 60.0, clock, lambda: clock.now_s() > 50)


def test_silence_is_said(opened):
    chamber, _, _ = opened(TEXT.replace("MEAS", "MEASURE"))
    with pytest.raises(TableFault, match=r"sent 'MEASURE:TEMP\?', heard nothing"):
        chamber.read()


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ("SOUR:TEMP {temperature}", "SOUR:TEMP", "set and answer need {temperature}"),
        ("least_c = -40", "least_c = 90", "the smaller first"),
        ('"{temperature}"\nleast', '"{angle"\nleast', "expected fields"),
        ("most_c = 85", "", "most_c is missing"),
        ("MEAS", "\u2192", "more than one byte"),
    ],
)
def test_a_wrong_file_is_refused(before, after, expected, opened):
    with pytest.raises(FormatError) as error:
        opened(TEXT.replace(before, after))
    assert expected in str(error.value)
