"""Fifteen kinds of faults on every make: the table ends at rest, within its limits, and one line says what happened (exit code 3)."""

import contextlib
import re

import pytest
from virtual_tables import MAKES, Bench, description

from session.annexes.machines.verbs import TableFault
from session.annexes.machines.virtual_motion import FAULTS, LOST_RAD, Fault
from session.io.errors import CalibrationError
from session.io.units import DEG

#: faults that the machine does not know of, and that a driver can live with
HARMLESS = ("late", "doubled", "lost_steps")
#: what the line names, on any make; a controller that restarts without a word is seen by its angle
NAMED = {
    "estop": "emergency stop|ALARM:3|ALARM 1",
    "limit": "limit|ALARM",
    "cable": "line to the table is lost",
    "silence": "does not (answer|say)",
    "garbled": "does not (answer|say)|refuse|reports|turned by|wrong way|beyond|state|rests at",
    "stall": r"rests at [01]\.\d+ deg, asked for was 90",
    "wrong_angle": "turned by|rests at 120",
    "home_fails": "home|homing",
    "disabled": "amplifier|error:7|motors",
    "endless": r"beyond the 90\.00 that it was sent to",
    "restart": "restarted|turned by",
    "unknown_error": "the make's file does not know",
}


def session(make, faults):
    """Home, a turn to 90 deg (the second move), a turn at a rate; the bench behind it, and what was said."""
    bench = Bench(description(make), faults)
    bench.confirm()
    try:
        with bench.guarded as table:
            table.home()
            table.settle()
            table.turn_to(0, 90 * DEG, 30 * DEG)
            table.settle()
            table.turn_at(0, -20 * DEG)
            for _ in range(20):
                table.where()
                bench.clock.sleep(0.1)
            table.stop()
    except TableFault as fault:
        return bench, fault
    return bench, None


@pytest.mark.parametrize("make", MAKES)
@pytest.mark.parametrize("kind", FAULTS)
def test_each_fault_ends_safe(kind, make):
    bench, fault = session(make, f"{kind}@move{1 if kind == 'home_fails' else 2}")
    said_rest = bench.guarded.is_at_rest
    assert said_rest <= (bench.motor()[1] == 0)  # what is said to rest does
    assert bench.comes_to_rest()  # without anybody: also where nothing could be sent any more
    of = bench.table.axes[0]
    assert of.least_rad - DEG <= bench.motor()[0] <= of.most_rad + DEG
    assert (fault is None) == (kind in HARMLESS)
    if fault is not None:
        assert fault.exit_code == 3
        assert "\n" not in str(fault)
        assert re.search(NAMED[kind], str(fault)), str(fault)
        assert said_rest or "not seen at rest" in str(fault)


def test_silence_stops_it_though_nothing_is_heard():
    """The controller still hears: the stop arrives, and the motor rests before the move would have ended."""
    bench = Bench(description("line"), "silence@move1")
    bench.confirm()
    bench.guarded.turn_to(0, 200 * DEG, 10 * DEG)
    with pytest.raises(TableFault, match="not seen at rest"):
        bench.guarded.settle()
    assert bench.motor()[1] == 0
    assert 100 * DEG < bench.motor()[0] < 125 * DEG  # silent from 100 deg on, for 2 s


def test_lost_steps_are_the_sensor_s_to_see():
    bench, fault = session("line", "lost_steps@move2")
    assert fault is None
    assert bench.virtual.mechanics.said(0) - bench.motor()[0] == pytest.approx(LOST_RAD)


def test_a_turn_at_a_rate_that_stalls_is_seen():
    bench = Bench(description("line", limits=None), "stall@move1")
    bench.confirm()
    bench.guarded.turn_at(0, 20 * DEG)
    with pytest.raises(TableFault, match="says that it rests, asked for was a turn at a rate"):
        bench.guarded.settle()


@pytest.mark.parametrize("text", ["estop", "estop@3", "stall@move2,cable@1.5", ""])
def test_faults_are_parsed(text):
    assert len(Fault.parse(text)) == len(list(filter(None, text.split(","))))


@pytest.mark.parametrize("text", ["nothing", "estop@", "estop@x", "estop@move", "estop@-1", "ESTOP@1"])
def test_a_wrong_fault_is_named(text):
    with pytest.raises(CalibrationError, match="expected NAME@SECONDS or NAME@moveN"):
        Fault.parse(text)


@pytest.mark.parametrize("make", MAKES)
def test_an_alarm_that_was_cleared_at_the_machine_is_not_repeated(make):
    """Pressed and released there: as long as nobody says so the alarm stands, and afterwards the table is moved again."""
    bench = Bench(description(make), "estop@move2")
    bench.confirm()
    table, mechanics = bench.guarded, bench.virtual.mechanics
    table.home()
    table.settle()
    with contextlib.suppress(TableFault):
        table.turn_to(0, 30 * DEG, 30 * DEG)
    with pytest.raises(TableFault, match=NAMED["estop"]):
        table.settle()
    mechanics.release()
    for step in bench.driver.make.clear:  # at its panel
        bench.virtual.feed((step.raw or f"{step.send}{bench.driver.make.end}").encode())
        bench.clock.sleep(0.1)
    mechanics.clear()
    with pytest.raises(TableFault, match=NAMED["estop"]):
        table.where()
    table.forget_alarm()
    with contextlib.suppress(TableFault):  # once it may say that it rests elsewhere than it was sent to
        table.settle()
    with contextlib.suppress(TableFault):  # SCPI keeps its last error until it is asked
        table.turn_to(0, 10 * DEG, 30 * DEG)
    table.settle()
    table.turn_to(0, 20 * DEG, 30 * DEG)
    assert table.settle().angles[0] == pytest.approx(20 * DEG, abs=0.2 * DEG)
