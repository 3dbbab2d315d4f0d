"""What a table should not do: a lost zero, a late begin, a wrong sense or rate, motion that nobody asked for.  How it is stopped."""

import contextlib
import os
import signal
import sys
import threading
from collections import deque

import pytest
from commandline import refused
from processes import until
from virtual_line import SimulatedClock, VirtualLink
from virtual_tables import MAKES, OWN, Bench, description

from session.annexes.machines import safety, wire
from session.annexes.machines.clocks import HostClock
from session.annexes.machines.description import read_description
from session.annexes.machines.driver import AngleFile, TableDriver
from session.annexes.machines.makes import open_table
from session.annexes.machines.makes.hand import Hand
from session.annexes.machines.safety import Guarded, Move
from session.annexes.machines.template import template
from session.annexes.machines.verbs import TableFault, TableLimit
from session.annexes.machines.virtual import VirtualTable
from session.annexes.machines.wire import LineLost, SerialLink
from session.bench.messages import AxisMove
from session.io.errors import FormatError
from session.io.units import DEG


def turning(make="line", limits=(-90, 270), **more):
    """A bench whose moves are confirmed, and which is ready to move."""
    bench = Bench(description(make, limits), **more)
    if bench.driver.make.clear:
        bench.driver.clear()
    bench.confirm()
    return bench


def followed(bench, seconds, every_s=0.05):
    """Look at it for so long, as a program does."""
    for _ in range(round(seconds / every_s)):
        bench.clock.sleep(every_s)
        bench.guarded.where()


# A lost zero.


@pytest.mark.parametrize("make", ["grbl", "line"])
def test_a_table_that_restarted_on_opening_is_not_turned(make):
    """An Uno without switches: it takes the angle where it stands for zero, so that its limits mean nothing."""
    settings = {"homing": False} if make == "grbl" else {}
    bench = Bench(description(make, **settings), greets=True)
    plan = [Move.to(0, 30 * DEG, 10 * DEG), Move.at(0, 10 * DEG, 2.0)]
    with pytest.raises(TableLimit, match=r"has restarted.*--home.*--at-zero.*nothing was moved"):
        bench.confirm(*plan)
    bench.confirm(Move.home(), *plan)  # which a plan that begins with homing may be, but not without it
    for verb in (lambda: bench.guarded.turn_to(0, 30 * DEG, 10 * DEG), lambda: bench.guarded.turn_at(0, 10 * DEG)):
        with pytest.raises(TableLimit, match="has restarted"):
            verb()
    bench.guarded.stands_at_zero()
    bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    assert bench.guarded.settle().angles[0] == pytest.approx(30 * DEG, abs=0.02 * DEG)


def test_a_restart_on_the_way_loses_the_zero_though_its_alarm_was_cleared():
    bench = turning("grbl")
    bench.virtual.mechanics.restart()
    with pytest.raises(TableFault, match="has restarted"):
        bench.guarded.where()
    bench.guarded.clear()
    assert not bench.guarded.where().moving
    with pytest.raises(TableLimit, match="has restarted"):
        bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)


def test_homing_to_its_end_finds_the_zero_again():
    bench = Bench(description("line"), greets=True)
    bench.confirm(Move.home(), Move.to(0, 30 * DEG, 10 * DEG))
    bench.virtual.mechanics.turn_to(0, 90 * DEG, 60 * DEG)
    bench.clock.sleep(5)
    bench.guarded.home()
    bench.clock.sleep(1)
    bench.guarded.stop()
    with pytest.raises(TableLimit, match="has restarted"):
        bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    bench.guarded.home()
    bench.guarded.settle()
    bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    assert bench.guarded.settle().angles[0] == pytest.approx(30 * DEG)


@pytest.fixture
def commanded(tmp_path, monkeypatch):
    """A table.toml in the present folder, and the bench that the command opens instead of a port."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "table.toml").write_text(template("line"))
    bench = Bench(read_description(tmp_path / "table.toml"), greets=True)
    monkeypatch.setattr("session.annexes.machines.makes.open_table", lambda *of, stops: bench.driver)
    return bench


def test_yes_does_not_say_that_it_stands_at_zero(commanded, run):
    refused(run("table", "turn", "outer", "30", "--yes"), "has restarted")
    assert b"TURN" not in commanded.link.sent


# A motion that is not the one that was asked for.


@pytest.mark.parametrize("make", ["scpi", "line"])  # the others ask the mechanics otherwise
def test_a_move_that_begins_late_is_stopped(make):
    """It says that it rests, and would turn 0.8 s after the request, watched by nobody."""
    bench = turning(make)
    mechanics = bench.virtual.mechanics
    turn_to = mechanics.tracks[0].turn_to
    mechanics.tracks[0].turn_to = lambda begin_s, *of: turn_to(begin_s + 0.8, *of)
    mechanics.is_moving = lambda axis=None: abs(mechanics.tracks[0].state(mechanics.now_s())[1]) > 1e-9
    bench.guarded.turn_to(0, 100 * DEG, 20 * DEG)
    with pytest.raises(TableFault, match=r"rests at 0\.00 deg, asked for was 100\.00; it was stopped, and rests"):
        bench.guarded.settle()
    bench.clock.sleep(5)
    assert abs(bench.motor()[0]) < DEG


@pytest.mark.parametrize("rate", [20, -20])
def test_a_table_beyond_its_limits_is_stopped_whoever_moved_it(rate):
    bench = turning()
    bench.guarded.where()
    bench.virtual.mechanics.turn_at(0, rate * DEG)
    with pytest.raises(TableFault, match=r"beyond its limits; it was stopped, and rests"):
        followed(bench, 20)
    assert bench.motor()[1] == 0
    assert -95 * DEG < bench.motor()[0] < 275 * DEG  # it braked from 20 dps


def test_a_jump_behind_a_move_is_seen():
    """The last answer of a move is what the next one is compared with."""
    bench = turning()
    bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    bench.guarded.settle()
    bench.virtual.mechanics.unknown[0] += 30 * DEG
    with pytest.raises(TableFault, match=r"it turned by 30\.0 deg"):
        bench.guarded.where()


def test_an_axis_that_was_not_asked_to_turn_is_stopped_at_once():
    """The motor of the other axis turns, which was not asked for."""
    bench = Bench(description("line", axes=2))
    bench.confirm()
    bench.guarded.turn_to(0, 200 * DEG, 10 * DEG)
    bench.virtual.mechanics.turn_at(1, -20 * DEG)
    with pytest.raises(TableFault, match=r"inner turns, and was not asked to: it is at -[34]\.\d+ deg; it was stopped, and rests"):
        followed(bench, 20)


@contextlib.contextmanager
def driven(bench, tmp_path):
    """A driver whose rounds the test makes; it has seen where the table is."""
    driver = TableDriver(bench.guarded, AngleFile(tmp_path / "table.csv", bench.table), bench.clock.now_s, in_thread=False)
    driver.tick()
    yield driver
    driver.close()


def test_a_recording_stops_a_table_that_moves_by_itself(tmp_path):
    bench = turning(limits=None)
    with driven(bench, tmp_path) as driver:
        bench.virtual.mechanics.turn_at(0, 2 * DEG)
        for _ in range(100):
            bench.clock.sleep(0.05)
            driver.tick()
    assert "it moves though nothing was asked of it" in driver.fault
    assert bench.motor()[1] == 0


def test_a_person_who_has_not_confirmed_a_stop_is_waited_for(tmp_path):
    typed, clock = threading.Event(), SimulatedClock()
    hand = Hand(description("hand"), lambda text: "12" if typed.wait(10) else "")
    table = Guarded(hand, clock)
    table.confirm([Move.to(0, 30 * DEG, 10 * DEG)], None, lambda line: None)
    driver = TableDriver(table, AngleFile(tmp_path / "table.csv", table.description), clock.now_s, in_thread=False)
    driver.tick()
    driver.make([AxisMove(0, 30 * DEG, 10 * DEG)])
    driver.tick()
    driver.stop()
    for _ in range(100):
        clock.sleep(0.05)
        driver.tick()
    assert driver.busy
    assert not driver.fault
    typed.set()
    hand._thread.join()
    driver.tick()
    assert not driver.busy
    driver.close()


@pytest.mark.parametrize("to", [90, -60])
def test_a_turn_in_the_wrong_sense_is_stopped(to):
    bench = turning(limits=None)
    track = bench.virtual.tracks[0]
    turn_to = track.turn_to
    track.turn_to = lambda begin_s, angle, *of: turn_to(begin_s, -50 * angle, *of)
    bench.guarded.turn_to(0, to * DEG, 20 * DEG)
    with pytest.raises(TableFault, match=rf"turns the wrong way: .*asked for was {'-' if to < 0 else '.'}20 dps; it was stopped"):
        followed(bench, 12)
    assert abs(bench.motor()[0]) < 5 * DEG


@pytest.mark.parametrize(("factor", "expected"), [(-8, "turns the wrong way"), (8, "it turned by"), (2, "it turned by")])
@pytest.mark.parametrize("before", [0, 30])
def test_a_rate_that_was_not_asked_for_is_stopped(before, factor, expected):
    """From rest, and behind another rate."""
    bench = turning(limits=None)
    if before:
        bench.guarded.turn_at(0, before * DEG)
        followed(bench, 3)
    begin = bench.motor()[0]
    track = bench.virtual.tracks[0]
    turn_at = track.turn_at
    track.turn_at = lambda begin_s, rate, *of: turn_at(begin_s, rate * factor, *of)
    bench.guarded.turn_at(0, 5 * DEG)
    with pytest.raises(TableFault, match=rf"{expected}.*asked for was \+5 dps; it was stopped, and rests"):
        followed(bench, 12)
    assert abs(bench.motor()[0] - begin) < (140 if before else 50) * DEG


def test_a_rate_that_turns_round_is_stopped():
    """Behind a hundred degrees in the right sense, it does not first turn all of them back."""
    bench = turning(limits=None)
    bench.guarded.turn_at(0, 20 * DEG)
    followed(bench, 5)
    begin = bench.motor()[0]
    bench.virtual.mechanics.turn_at(0, -20 * DEG)
    with pytest.raises(TableFault, match="turns the wrong way"):
        followed(bench, 12)
    assert begin - bench.motor()[0] < 5 * DEG


@pytest.mark.parametrize("make", MAKES)
def test_the_rates_that_were_asked_for_are_not_stopped(make):
    bench = turning(make, limits=None)
    for rate in (5, -40, 60, -60, 1):
        bench.guarded.turn_at(0, rate * DEG)
        followed(bench, 4)
    bench.guarded.turn_at(0, 0.0)
    assert not bench.guarded.settle().moving


def test_a_move_that_does_not_end_is_stopped_in_time():
    """The angle creeps, and neither its sense nor its rate is wrong."""
    bench = turning(limits=None)
    track = bench.virtual.tracks[0]
    turn_to = track.turn_to
    track.turn_to = lambda begin_s, angle, rate, *of: turn_to(begin_s, angle, rate / 50, *of)
    bench.guarded.turn_to(0, 100 * DEG, 20 * DEG)
    begin_s = bench.clock.now_s()
    with pytest.raises(TableFault, match="it still moves"):
        followed(bench, 60)
    assert bench.clock.now_s() - begin_s < 1.5 * 5.2 + 5.0 + 1.0


# A turn at a rate has an end.


@pytest.mark.parametrize("make", ["grbl", OWN])
@pytest.mark.parametrize("rate", [20, -20])
def test_without_a_rate_mode_the_machine_ends_it_by_itself(make, rate):
    """The program is killed, and nobody stops it."""
    bench = turning(make, limits=None)
    bench.confirm(Move.at(0, 20 * DEG, 8.0))
    bench.guarded.turn_at(0, rate * DEG)
    assert bench.comes_to_rest()
    assert bench.motor()[0] == pytest.approx(8 * rate * DEG, abs=0.02 * DEG)


def test_with_a_rate_mode_it_is_stopped_behind_its_longest_time():
    bench = turning(limits=None)
    bench.confirm(Move.at(0, 20 * DEG, 2.0))
    bench.guarded.turn_at(0, 20 * DEG)
    with pytest.raises(TableFault, match="it still moves"):
        followed(bench, 12)
    assert bench.motor()[1] == 0


def test_no_rate_above_the_confirmed_one():
    bench = turning(limits=None)
    bench.confirm(Move.at(0, 20 * DEG, 8.0), Move.anywhere(bench.table, 0, 60 * DEG))
    for rate in (21, -21):
        with pytest.raises(TableLimit, match="in no plan that was confirmed"):
            bench.guarded.turn_at(0, rate * DEG)
    assert b"RATE" not in bench.link.sent


# How it is stopped.


@pytest.mark.parametrize("make", MAKES)
def test_a_stop_is_the_first_that_is_written(make):
    """`table stop`: nothing is waited for, also where the controller answers nothing at all."""
    opened = Bench(description(make))
    begun = len(opened.link.sent)
    opened.driver.stop()
    assert Bench(description(make), "silence@0", stops=True).link.sent.startswith(opened.link.sent[begun:])
    assert len(opened.link.sent) > begun


def real():
    """A table at the host's clock, and a turn that would last 20 s."""
    table, clock = description("line", open_s=0.1), HostClock()
    virtual = VirtualTable(table, None, clock)
    virtual.feed()
    machine = Guarded(open_table(table, None, VirtualLink(virtual, clock), clock))
    machine.confirm([Move.to(0, 200 * DEG, 10 * DEG)], None, lambda line: None)
    return machine, virtual


@pytest.mark.skipif(sys.platform == "win32", reason="Windows suspends no program")
def test_ctrl_z_stops_it_before_the_program_is_suspended(monkeypatch):
    if signal.getsignal(signal.SIGTSTP) is not signal.SIG_DFL:
        pytest.skip("Ctrl-Z is ignored here")
    machine, virtual = real()
    suspended = []
    monkeypatch.setattr(safety.os, "kill", lambda pid, number: suspended.append((pid, number, virtual.tracks[0].busy_until_s)))
    with machine:
        machine.turn_to(0, 200 * DEG, 10 * DEG)
        signal.raise_signal(signal.SIGTSTP)
        until(lambda: suspended)
    ((pid, number, busy_until_s),) = suspended
    assert (pid, number) == (os.getpid(), signal.SIGSTOP)
    assert busy_until_s < 5.0  # without a stop it would turn for 20 s
    assert signal.getsignal(signal.SIGTSTP) is signal.SIG_DFL


def test_the_end_of_the_program_stops_it(monkeypatch):
    """Without ``__exit__``: what is registered for the end of the program."""
    registered = []
    monkeypatch.setattr(safety.atexit, "register", registered.append)
    bench = turning()
    bench.guarded.__enter__()
    bench.guarded.turn_to(0, 200 * DEG, 10 * DEG)
    bench.clock.sleep(1)
    (at_exit,) = registered
    at_exit()
    assert bench.comes_to_rest()
    assert bench.motor()[0] < 12 * DEG
    bench.guarded.__exit__(None, None, None)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_wait_until_it_has_stopped(number):
    """The first stop is told to a table that is still turning."""
    bench = turning()
    stop, told = bench.driver.stop, []

    def disturbed():
        signal.raise_signal(number)
        told.append(bench.motor()[1])
        stop()

    bench.driver.stop = disturbed
    try:
        with bench.guarded:
            bench.guarded.turn_to(0, 200 * DEG, 10 * DEG)
            bench.clock.sleep(1)
    except KeyboardInterrupt:
        pytest.fail("the stop was interrupted")
    assert told
    assert told[0] != 0
    assert bench.motor()[1] == 0


@pytest.mark.parametrize("when", ["before", "behind"])
def test_a_stop_that_comes_while_a_move_is_sent_is_the_last_word(when, tmp_path):
    """Another thread stops: once the move has left the queue, or while its request is written."""
    bench = turning()
    with driven(bench, tmp_path) as driver:
        write = bench.link.write

        class Queue(deque):
            def popleft(self):
                move = super().popleft()
                driver.stop()
                return move

        def stopped_behind(data):
            write(data)
            driver._halted = driver._halted or data.startswith(b"TURN")  # its bytes came before these

        if when == "before":
            driver._queue = Queue()
        else:
            bench.link.write = stopped_behind
        driver.make([AxisMove(0, 200 * DEG, 10 * DEG)])
        driver.tick()
        assert (b"TURN" in bench.link.sent) == (when == "behind")
        bench.clock.sleep(1)
        assert bench.motor()[1] == 0


@pytest.mark.parametrize("kind", ["unseen", "seen"])
def test_a_fault_keeps_that_it_was_not_seen_at_rest(kind, tmp_path, monkeypatch):
    """The reason, and what is left to do: both are said, and each once."""
    bench = turning()

    def stop():
        raise TableFault(f"table: it was told to stop and was not seen at rest; {wire.PRESS}")

    with driven(bench, tmp_path) as driver:
        if kind == "unseen":
            monkeypatch.setattr(bench.guarded, "stop", stop)
        driver._failed("table: something else")
        assert driver.fault.startswith("table: something else")
        assert driver.fault.count(wire.PRESS) == (kind == "unseen")
        assert driver.fault.count("table: ") == 1


# Its line, and its file.


def test_a_port_that_takes_no_bytes_is_lost_and_waited_for_no_longer(monkeypatch):
    class Port:
        timeout = write_timeout = None

        def write(self, data):
            assert self.write_timeout == wire.WRITE_S
            raise OSError("it takes nothing")

        def flush(self):
            threading.Event().wait()  # as tcdrain does, without an end

    monkeypatch.setattr(wire, "open_serial", lambda name, baud: Port())
    link = SerialLink("port", 9600, HostClock())
    with pytest.raises(LineLost, match="it takes nothing"):
        link.write(b"STOP\n")
    monkeypatch.setattr(Port, "write", lambda self, data: len(data))
    writing = threading.Thread(target=link.write, args=(b"STOP\n",), daemon=True)
    writing.start()
    writing.join(5)
    assert not writing.is_alive()


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ("least_deg", "leastdeg", "axis[0].leastdeg: an axis has no such key, expected name, direction"),
        ('word = "outer"', 'word = "outer 10 10\\nTURN outer"', "axis[0].word is"),
        ('word = "outer"', 'word = "outer\\u0085"', "axis[0].word is"),
    ],
)
def test_a_wrong_axis_is_refused_in_one_line(before, after, expected, tmp_path):
    path, text = tmp_path / "table.toml", template("line")
    path.write_text(text)
    assert read_description(path).axes[0].least_rad is not None
    assert before in text
    path.write_text(text.replace(before, after))
    with pytest.raises(FormatError) as error:
        read_description(path)
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


def test_a_setting_sends_no_second_request():
    with pytest.raises(FormatError, match="a text without control characters"):
        open_table(description("line", visa="@py\nSTOP"), link=Bench(description("line")).link)
