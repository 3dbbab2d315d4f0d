"""What moves a table: confirmed plans, limits, stops from any thread, signals."""

import signal
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest
from processes import CALIBRATE, DEVNULL, PIPE, calibrate, heard, started, until
from virtual_line import VirtualLink
from virtual_tables import MAKES, Bench, description

from session.annexes.machines.clocks import HostClock
from session.annexes.machines.makes import open_table
from session.annexes.machines.safety import HUNG_S, Guarded, Move, plan_lines
from session.annexes.machines.template import template
from session.annexes.machines.verbs import TableFault, TableLimit
from session.annexes.machines.virtual import VirtualTable
from session.annexes.machines.virtual_motion import Fault
from session.io.units import DEG

TABLE = description("line")


def test_a_hand_is_told_of_no_emergency_stop():
    (_, move) = plan_lines(replace(TABLE, make="hand"), [Move.to(0, 1.0, 0.2)])
    assert "deg" in move


def test_nothing_moves_that_was_not_confirmed():
    bench = Bench(TABLE)
    table = bench.guarded
    with pytest.raises(TableLimit, match="in no plan that was confirmed; nothing was moved"):
        table.home()
    bench.confirm(Move.to(0, 30 * DEG, 10 * DEG))
    for verb in (
        table.home,
        lambda: table.turn_to(0, 31 * DEG, 10 * DEG),
        lambda: table.turn_to(0, 30 * DEG, 11 * DEG),
        lambda: table.turn_at(0, 5 * DEG),
    ):
        with pytest.raises(TableLimit, match="in no plan that was confirmed"):
            verb()
    assert b"TURN" not in bench.link.sent
    table.turn_to(0, 30 * DEG, 10 * DEG)
    assert b"TURN outer 30.0000 10.0000\n" in bench.link.sent


def test_a_plan_is_shown_before_it_is_asked_about():
    said = []

    def ask(question):
        said.append(question)
        return False

    moves = [Move.home(), Move.to(0, 30 * DEG, 10 * DEG), Move.anywhere(TABLE, 0, 60 * DEG), Move.at(0, 20 * DEG, 8.0)]
    with pytest.raises(TableLimit, match="not confirmed; nothing was moved"):
        Guarded(Bench(TABLE).driver).confirm(moves, ask, said.append)
    assert said == [*plan_lines(TABLE, moves), "Move it?"]
    assert said[2:5] == [
        "  2. outer to 30 deg at up to 10 dps (limits -90 to 270 deg)",
        "  3. outer to any angle from -90 to 270 deg at up to 60 dps (limits -90 to 270 deg)",
        "  4. outer turns at 20 dps, in either sense, for at most 8 s, which is 160 deg (limits -90 to 270 deg)",
    ]


@pytest.mark.parametrize(
    "move",
    [
        Move.to(0, 271 * DEG, DEG),
        Move.to(0, -91 * DEG, DEG),
        Move.to(0, 0.0, 61 * DEG),
        Move.at(0, 61 * DEG, 8.0),
        Move.to(0, np.nan, np.nan),
    ],
)
def test_a_plan_beyond_the_limits_is_refused(move):
    with pytest.raises(TableLimit, match="nothing was moved"):
        Bench(TABLE).confirm(move)


@pytest.mark.parametrize(("angle", "rate"), [(271, 10), (-91, 10), (float("nan"), 10), (0, 61), (0, 0), (0, float("nan"))])
def test_limits_hold_for_each_move(angle, rate):
    bench = Bench(TABLE)
    bench.confirm()
    with pytest.raises(TableLimit):
        bench.guarded.turn_to(0, angle * DEG, rate * DEG)
    assert b"TURN" not in bench.link.sent


@pytest.mark.parametrize("make", MAKES)
def test_no_limit_is_ever_passed(make):
    """Moves and rates at random, waits at random: the motor stays within the limits, whatever the program does meanwhile."""
    rng = np.random.default_rng(sorted(MAKES).index(make))
    limits = (1, 81) if make == "grbl" else (-30, 50)
    bench = Bench(description(make, limits))
    bench.confirm()
    table = bench.guarded
    table.home()
    table.settle()
    begin_s = bench.clock.now_s()
    for _ in range(25):
        try:
            if rng.random() < 0.5:
                table.turn_at(0, rng.uniform(-60, 60) * DEG)
            else:
                table.turn_to(0, rng.uniform(limits[0] - 30, limits[1] + 30) * DEG, rng.uniform(1, 70) * DEG)
        except TableLimit:
            pass
        bench.clock.sleep(rng.exponential(2.0))
        if rng.random() < 0.7:
            table.settle()
    t_s = np.linspace(begin_s, bench.clock.now_s(), 20_000) - bench.virtual.mechanics.begin_s
    said = np.sign(bench.table.settings.get("per_deg", 1)) * bench.virtual.tracks[0].said_and_sense(t_s)[0]
    assert said.min() >= limits[0] * DEG - 1e-6
    assert said.max() <= limits[1] * DEG + 1e-6
    assert np.ptp(said) > 60 * DEG  # it did move


def test_a_rate_at_the_limit_is_refused():
    bench = Bench(TABLE)
    bench.confirm()
    bench.guarded.turn_at(0, 60 * DEG)
    assert bench.guarded.settle().angles[0] == pytest.approx(270 * DEG)
    with pytest.raises(TableLimit, match="is at its limit of 270 deg"):
        bench.guarded.turn_at(0, 60 * DEG)


def test_a_second_move_waits_for_the_first():
    bench = Bench(TABLE)
    bench.confirm()
    bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    with pytest.raises(TableLimit, match="still moves"):
        bench.guarded.turn_to(0, 0.0, 10 * DEG)


@pytest.mark.parametrize("make", MAKES)
def test_a_table_that_somebody_else_moves_is_left_alone(make):
    bench = Bench(description(make, limits=None))
    if bench.driver.make.clear:
        bench.driver.clear()
    bench.confirm()
    bench.virtual.mechanics.turn_at(0, 10 * DEG)
    bench.clock.sleep(0.5)
    with pytest.raises(TableLimit, match="it moves, and not from here"):
        bench.guarded.turn_to(0, 0.0, 10 * DEG)
    bench.guarded.stop()
    bench.guarded.turn_to(0, 5 * DEG, 10 * DEG)
    assert bench.guarded.settle().angles[0] == pytest.approx(5 * DEG, abs=0.02 * DEG)


def test_a_motor_slower_than_described_is_stopped():
    """The controller has a lower rate of its own: the move would take six times as long as computed."""
    table = description("grbl", homing=False)
    slow = replace(table, axes=(replace(table.axes[0], fastest_rps=5 * DEG),))
    bench = Bench(table, virtual=slow)
    bench.confirm()
    bench.guarded.turn_to(0, 150 * DEG, 30 * DEG)
    with pytest.raises(TableFault, match=r"still moves 1\d\.\d s after its move began; computed were 5\.3 s; it was stopped, and rests"):
        bench.guarded.settle()
    assert bench.motor()[1] == 0


def test_a_stop_that_is_not_heard_is_asked_for_harder():
    """The first byte is lost on the way."""
    bench = Bench(description("grbl", homing=False))
    bench.confirm()
    bench.guarded.turn_to(0, 200 * DEG, 10 * DEG)
    bench.clock.sleep(1)
    write = bench.link.write
    bench.link.write = lambda data: None if data == b"\x85" else write(data)
    bench.guarded.stop()
    assert b"!" in bench.link.sent
    assert bench.motor()[1] == 0
    assert bench.motor()[0] < 25 * DEG
    assert not bench.virtual.mechanics.releases  # the reset came once it had braked


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_second_signal_does_not_break_the_stop(number):
    bench = Bench(TABLE)
    bench.confirm()
    bench.guarded.turn_to(0, 200 * DEG, 10 * DEG)
    bench.clock.sleep(1)
    stop = bench.driver.stop

    def disturbed():
        signal.raise_signal(number)
        stop()

    bench.driver.stop = disturbed
    with pytest.raises(KeyboardInterrupt), bench.guarded:
        raise KeyboardInterrupt
    assert bench.motor()[1] == 0


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_exception_stops_the_table(error):
    bench = Bench(TABLE)
    bench.confirm()
    bench.guarded.turn_to(0, 200 * DEG, 10 * DEG)
    bench.clock.sleep(2)
    with pytest.raises(error), bench.guarded:
        raise error
    assert b"STOP\n" in bench.link.sent
    assert bench.motor()[1] == 0
    assert bench.motor()[0] < 25 * DEG


def test_stop_does_not_wait_for_an_answer():
    """In real time: one thread waits for an answer that does not come, another stops."""
    clock, table = HostClock(), description("line", answer_s=0.8)
    virtual = VirtualTable(table, None, clock, Fault.parse("silence@0.3"))
    link = VirtualLink(virtual, clock)
    driver = open_table(table, None, link, clock)
    driver.turn_to(0, 200 * DEG, 60 * DEG)
    clock.sleep(0.3)

    def ask():
        with pytest.raises(TableFault):
            driver.where()

    asked = threading.Thread(target=ask)
    asked.start()
    until(lambda: link.sent.endswith(b"WHERE\n"))
    begin_s = clock.now_s()
    driver.stop()
    assert asked.is_alive()
    assert clock.now_s() - begin_s < 0.6
    assert link.sent.endswith(b"WHERE\nSTOP\n")
    asked.join()
    assert virtual.tracks[0].state(clock.now_s() - virtual.mechanics.begin_s)[1] == 0


def test_a_move_that_is_half_sent_when_it_is_stopped_is_not_sent_on():
    """Rate first, then the angle: a stop between them."""
    bench = Bench(description("scpi"))
    read = bench.link.read

    def read_and_stop(longest_s):
        if bench.link.sent.endswith(b"VEL 10.00000\n"):
            stopping = threading.Thread(target=bench.driver.stop)
            stopping.start()
            stopping.join()
        return read(longest_s)

    bench.link.read = read_and_stop
    with pytest.raises(TableFault, match=r"stopped before 'AXIS1:POS 30\.00000' was sent"):
        bench.driver.turn_to(0, 30 * DEG, 10 * DEG)
    assert b"POS " not in bench.link.sent
    assert bench.link.sent.endswith(b"ABOR\n")


def test_a_program_that_does_not_look_any_more_is_stopped_for(monkeypatch):
    from session.annexes.machines import safety

    assert HUNG_S > 1
    monkeypatch.setattr(safety, "HUNG_S", 0.2)
    clock = HostClock()
    virtual = VirtualTable(TABLE, None, clock)
    virtual.feed()  # it was switched on before its port is opened
    table = Guarded(open_table(TABLE, None, VirtualLink(virtual, clock), clock))
    table.confirm([Move.to(0, 200 * DEG, 10 * DEG)], None, lambda line: None)
    with table:
        table.turn_to(0, 200 * DEG, 10 * DEG)
        until(lambda: virtual.tracks[0].busy_until_s < 3.0)  # without a stop it would turn for 20 s


def fill_in(tmp_path, link):
    text = template("line").replace("/dev/ttyUSB0", str(link)).replace("# One [[axis]]", "[settings]\nopen_s = 0.1\n# One [[axis]]")
    (tmp_path / "table.toml").write_text(text)
    return tmp_path / "table.toml"


@pytest.mark.skipif(sys.platform == "win32", reason="a pseudo-terminal is POSIX's")
@pytest.mark.broad
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_the_table(number, tmp_path):
    """The command is interrupted while the table turns; afterwards it rests, far from where it was going."""
    table = fill_in(tmp_path, tmp_path / "port")
    with started([*CALIBRATE, "table", "virtual", table, "--link", tmp_path / "port"], stdout=PIPE, stderr=DEVNULL, text=True) as virtual:
        heard(virtual.stdout, lambda line: "port" in line)
        with started(
            [*CALIBRATE, "table", "turn", "outer", "180", "--rate", "10", "--yes", "--table", table], stderr=PIPE, text=True
        ) as turning:
            heard(turning.stderr, lambda line: line.startswith("outer "))
            turning.send_signal(number)
            rest = turning.stderr.read()
            assert turning.wait() == 130, rest
        asked = [calibrate("table", "where", table).stdout for _ in range(2)]
    assert asked[0] == asked[1]
    assert "it rests" in asked[0]
    assert 5 < float(asked[0].split()[1]) < 60


@pytest.mark.skipif(sys.platform == "win32", reason="a pseudo-terminal is POSIX's")
@pytest.mark.broad
def test_a_cable_that_drops_at_a_port(tmp_path):
    table = fill_in(tmp_path, tmp_path / "port")
    words = [*CALIBRATE, "table", "virtual", table, "--link", tmp_path / "port", "--faults", "cable@move1"]
    with started(words, stdout=PIPE, stderr=DEVNULL, text=True) as virtual:
        heard(virtual.stdout, lambda line: "port" in line)
        run = calibrate("table", "turn", "outer", "60", "--rate", "20", "--yes", "--table", table)
    assert run.returncode == 3
    assert "press its own emergency stop" in run.stderr
    assert len([line for line in run.stderr.splitlines() if line.startswith("calibrate:")]) == 1
