"""How a GRBL is stopped in each of its states, and what ends its silence: on the virtual one, which does as its sources say."""

import errno
import re
import signal
import threading
import time
from dataclasses import replace

import pytest
from virtual_tables import Bench, axis, description

from session.annexes.machines.makefile import FOLDER, read_make
from session.annexes.machines.makes import make_of, open_table
from session.annexes.machines.safety import Guarded, Move
from session.annexes.machines.template import template
from session.annexes.machines.verbs import TableFault, TableLimit
from session.annexes.machines.wire import LineLost, SerialLink
from session.bench.port import serial
from session.io.errors import FormatError
from session.io.units import DEG

WITHOUT_SWITCHES = description("grbl", homing=False)


def turning(faults="", **more):
    """A GRBL without switches whose moves are confirmed."""
    bench = Bench(WITHOUT_SWITCHES, faults, **more)
    bench.confirm()
    return bench


FORMER = 'stop = [[{ raw = "\\u0085" }], [{ raw = "!", pause_s = 0.5 }, { raw = "\\u0018" }]]\n'


def own(table, before, after, folder):
    """A bench of a make's file of one's own, which has ``after`` for ``before`` of the one that comes with the tool."""
    text = (FOLDER / f"{table.make}.toml").read_text()
    assert before in text
    (folder / "own.toml").write_text(text.replace(before, after))
    mine = replace(table, make="./own.toml", make_sha256=read_make(folder / "own.toml").sha256)
    bench = Bench(mine, folder=folder, virtual=table)
    bench.confirm()
    return bench


@pytest.mark.parametrize("former", [False, True])
def test_a_stop_right_behind_a_move_is_not_lost(former, tmp_path):
    """0x85 is dropped before the line is read: it is written again until the line's ok has come, and no jog is said.

    former: a copy of the file of a former version, whose stop has no states.
    """
    stops = re.search(r"stop = \[\n.*?\n\]\n", (FOLDER / "grbl.toml").read_text(), re.DOTALL)[0]
    bench = own(WITHOUT_SWITCHES, stops, FORMER, tmp_path) if former else turning()
    write = bench.link.write

    def interrupted(data):
        write(data)
        if data.startswith(b"$J"):
            signal.raise_signal(signal.SIGINT)

    bench.link.write = interrupted
    with pytest.raises(KeyboardInterrupt), bench.guarded:
        bench.guarded.turn_to(0, 200 * DEG, 0.1 * DEG)  # so slow that two looks see the same angle
    assert bench.comes_to_rest()
    assert bench.motor()[0] < 0.1 * DEG
    assert bench.link.sent.count(b"\x85") > 1
    assert b"\x18" not in bench.link.sent
    assert not bench.driver.where().moving  # and its angles are not lost


def test_a_stop_of_another_thread_right_behind_a_move_is_not_lost():
    bench = turning()
    read, stopping = bench.link.read, []

    def stopped(longest_s):
        if b"$J" in bench.link.sent and not stopping:
            stopping.append(threading.Thread(target=bench.driver.stop))
            stopping[0].start()
        return read(longest_s)

    bench.link.read = stopped
    bench.guarded.turn_to(0, 200 * DEG, 30 * DEG)
    stopping[0].join()
    assert bench.comes_to_rest()
    assert bench.motor()[0] < 10 * DEG


def test_a_list_of_requests_is_written_at_once(tmp_path):
    """The answer to its first is not awaited before the second, which stops it."""
    bench = own(description("line"), '[[{ send = "STOP" }]]', '[[{ send = "HALT", answers = ["HALTED"] }, { send = "STOP" }]]', tmp_path)
    bench.guarded.home()
    bench.guarded.settle()
    bench.guarded.turn_to(0, 200 * DEG, 30 * DEG)
    bench.clock.sleep(2)
    before = bench.motor()[0]
    bench.driver.stop()
    assert bench.comes_to_rest()
    assert bench.motor()[0] - before < 6 * DEG


def test_a_stop_while_another_thread_reads_slowly_goes_no_further():
    """No state is heard meanwhile, which is another thing than that none is said."""
    bench = turning()
    bench.guarded.turn_to(0, 200 * DEG, 30 * DEG)
    bench.clock.sleep(1)
    read, looks = bench.link.read, threading.Event()

    def slow(longest_s):
        if threading.current_thread() is looking and not looks.is_set():
            looks.set()
            time.sleep(0.2)
        return read(longest_s)

    looking = threading.Thread(target=bench.driver.where)
    bench.link.read = slow
    looking.start()
    looks.wait(5)
    sent = len(bench.link.sent)
    bench.driver.stop()
    looking.join()
    assert not {b"!", b"\x18"} & {bytes([byte]) for byte in bench.link.sent[sent:]}
    assert not bench.driver.where().moving


def seen_while_stopping(bench, stop):
    """Where the table is to one thread that reads while another's stop is about to write ``stop``."""
    read, write, stops, looks = bench.link.read, bench.link.write, threading.Event(), threading.Event()

    def told(data):
        if data == stop:
            stops.set()
            looks.wait(5)
        write(data)

    def looked(longest_s):
        if stops.is_set() and threading.current_thread() is threading.main_thread():
            looks.set()
        return read(longest_s)

    bench.link.write, bench.link.read = told, looked
    stopping = threading.Thread(target=bench.driver.stop)
    stopping.start()
    stops.wait(5)
    seen = bench.driver.where()
    stopping.join()
    return seen


def test_a_hold_of_our_own_stop_is_no_fault(monkeypatch):
    """Another thread asks where it is, and hears the state that the stop has led to."""
    bench = turning()
    monkeypatch.setattr(bench.virtual._firmware, "_state", lambda: "Hold:0")
    assert seen_while_stopping(bench, b"\x85").moving
    with pytest.raises(TableFault, match="Hold:0"):
        bench.driver.where()


def test_a_reset_of_our_own_stop_loses_no_angles_while_another_thread_looks():
    """It hears the greeting instead of the stop that has asked for it."""
    bench = turning()
    bench.guarded.turn_to(0, 20 * DEG, 30 * DEG)
    bench.guarded.settle()
    bench.driver.stop()
    assert seen_while_stopping(bench, b"\x18").angles[0] == pytest.approx(20 * DEG)
    assert not bench.driver.angles_lost


@pytest.mark.parametrize("heard", [b"ALARM:2\r\n", b"\r\nGrbl 1.1h ['$' for help]\r\n", b""])
def test_a_motion_that_was_not_taken_is_not_waited_for(heard):
    """An alarm, a restart, or a stop before its line was sent: later stops of a table at rest are short."""
    bench = turning()
    write, drain = bench.link.write, bench.driver._drain

    def refused(data):
        if data.startswith(b"$J"):
            bench.link._received += heard
        else:
            write(data)

    bench.link.write = refused
    if not heard:
        bench.driver._drain = lambda: (drain(), bench.driver.stop())
    with pytest.raises(TableFault):
        bench.driver.turn_to(0, 30 * DEG, 30 * DEG)
    bench.driver._drain = drain
    begin_s = bench.clock.now_s()
    bench.driver.stop()
    assert bench.clock.now_s() - begin_s < 1.5


@pytest.mark.parametrize("opened", [True, False])
def test_a_motion_that_is_no_jog_is_held_at_once(opened):
    """`Run`, of another program: 0x85 does nothing there.  At rest the reset keeps the angles, and frees it."""
    bench = turning()
    bench.link.write(b"G1 X200 F1800\n")
    bench.clock.sleep(0.1)
    bench.link.read(0.0)
    bench.clock.sleep(2)
    before = bench.motor()[0]
    bench.driver.stop() if opened else bench.guarded.stop()
    assert bench.motor()[1] == 0
    assert bench.motor()[0] - before < 8 * DEG
    assert not bench.virtual.mechanics.releases
    assert not bench.driver.where().moving


def test_a_reset_amid_braking_is_waited_with():
    """The reset comes behind the braking time of table.toml, and the motors hold."""
    heavy = replace(WITHOUT_SWITCHES, axes=(axis("outer", "X", acceleration_rps2=10 * DEG),))
    bench = Bench(heavy)
    bench.confirm()
    bench.guarded.turn_to(0, 250 * DEG, 50 * DEG)
    bench.clock.sleep(4)
    write = bench.link.write
    bench.link.write = lambda data: None if data in (b"\x85", b"?") else write(data)
    bench.driver.stop()
    assert b"\x18" in bench.link.sent
    assert bench.motor()[1] == 0
    assert not bench.virtual.mechanics.releases


def test_a_harder_stop_is_warned_of(run, tmp_path, monkeypatch):
    """An axis that is not balanced falls: the plan says it, and the check."""
    monkeypatch.chdir(tmp_path)
    said = []
    turning().guarded.confirm([Move.to(0, 30 * DEG, 10 * DEG)], None, said.append)
    assert "switches its motors off" in said[1]
    (tmp_path / "table.toml").write_text(template("grbl"))
    assert [line for line in run("table", "check")[1].splitlines() if line.startswith("warning: ") and "falls" in line]


# Silence.


@pytest.mark.parametrize("stopped_by", ["limit", "hold", "estop"])
def test_what_ends_its_silence_is_said_and_clear_sends_it(stopped_by):
    """Behind a limit switch GRBL answers nothing at all, in a hold no line; a program that opens the port then has heard no alarm."""
    bench = turning()
    bench.guarded.turn_to(0, 100 * DEG, 30 * DEG)
    bench.guarded.settle()
    mechanics = bench.virtual.mechanics
    if stopped_by == "hold":
        bench.link.write(b"!")
    else:
        mechanics.stopped_by = stopped_by
    bench.link.read(0.1)
    other = Guarded(open_table(WITHOUT_SWITCHES, None, bench.link, bench.clock), bench.clock)
    plan = [Move.anywhere(WITHOUT_SWITCHES, 0, 60 * DEG)]
    for verb in (other.where, *[lambda: other.confirm(plan, None, print)] * (stopped_by != "estop")):
        with pytest.raises(TableFault, match=r"`table clear`"):
            verb()
    mechanics.release()
    other.clear()
    mechanics.clear()
    assert other.where().angles[0] == pytest.approx(100 * DEG)
    other.confirm(plan, None, print)
    other.turn_to(0, 90 * DEG, 30 * DEG)  # nor are its angles lost


def test_what_moves_is_not_cleared():
    bench = turning()
    bench.guarded.turn_to(0, 100 * DEG, 10 * DEG)
    with pytest.raises(TableFault, match="it moves; stop it before"):
        bench.driver.clear()
    assert b"\x18" not in bench.link.sent


@pytest.mark.parametrize("number", [0, 1])
def test_no_axis_that_moves_is_cleared(number):
    bench = Bench(description("scpi", axes=2))
    bench.confirm()
    bench.guarded.turn_to(number, 100 * DEG, 10 * DEG)
    with pytest.raises(TableFault, match="it moves; stop it before"):
        bench.driver.clear()


@pytest.mark.parametrize(("code", "meaning"), [(10, "emergency stop is pressed"), (11, "homed"), (17, "motor"), (22, "overflowed")])
def test_alarms_of_its_relatives_are_named(code, meaning):
    bench = turning()
    bench.link._received += f"ALARM:{code}\r\n".encode()
    with pytest.raises(TableFault, match=f"ALARM:{code}'.*{meaning}"):
        bench.driver.where()
    assert {str(each) for each in range(1, 23)} <= set(make_of(WITHOUT_SWITCHES).alarms.words)


def test_a_rate_that_its_decimals_make_zero_is_refused():
    """0.001 mm/min is the least that three decimals say: 1.7e-5 dps."""
    bench = turning()
    with pytest.raises(TableLimit, match=r"at 5e-06 dps would be sent as 0, expected 1\.67e-05 dps or more; nothing was moved"):
        bench.guarded.confirm([Move.to(0, DEG, 5e-6 * DEG)], None, print)
    for verb in (lambda rate: bench.guarded.turn_to(0, DEG, rate), lambda rate: bench.guarded.turn_at(0, -rate)):
        with pytest.raises(TableLimit, match="would be sent as 0"):
            verb(5e-6 * DEG)
    assert b"$J" not in bench.link.sent


def test_a_stop_that_is_not_sent_says_how_to_stop(tmp_path):
    bench = own(description("line"), "[requests]", "\n[requests]", tmp_path)
    changed = replace(bench.table, make_sha256="0" * 64)
    for stops in (True, False):
        with pytest.raises(FormatError, match="has changed since it was confirmed") as error:
            open_table(changed, tmp_path, bench.link, bench.clock, stops)
        assert ("Ctrl-C in the program that moves it" in str(error.value)) == ("emergency stop" in str(error.value)) == stops


def test_a_port_that_another_program_holds_says_how_to_stop(run, tmp_path, monkeypatch):
    def busy(name, baud):
        raise serial.SerialException(errno.EAGAIN, "Could not exclusively lock port")

    monkeypatch.setattr("session.annexes.machines.wire.open_serial", busy)
    with pytest.raises(LineLost, match=r"another program holds .*Ctrl-C there stops the table; .*emergency stop"):
        SerialLink("port", 9600, None)
    (tmp_path / "table.toml").write_text(template("grbl"))
    code, _, err = run("table", "stop", tmp_path / "table.toml")
    assert (code, err.count("\n"), "Ctrl-C there stops the table" in err) == (3, 1, True)


def test_a_port_that_its_user_may_not_open_is_held_by_nobody(monkeypatch):
    def denied(name, baud):
        raise serial.SerialException(errno.EACCES, "could not open port")

    monkeypatch.setattr("session.annexes.machines.wire.open_serial", denied)
    with pytest.raises(LineLost, match=r"cannot be opened .*join the group that owns it, usually dialout"):
        SerialLink("port", 9600, None)


# Its own settings.

SETTINGS = [
    ({13: 1.0}, "angles in inches: set $13 to 0"),
    ({130: 200.0}, "from 1 to 270 deg by table.toml, and from 1 to 200 by its controller ($130, $27, $23): beyond is its switch"),
    ({27: 3.0}, "from 3 to 400 by its controller"),
    ({27: 3.0, 23: 1.0, 130: 272.0}, "from 0 to 269 by its controller"),
    ({130: 200.0, 20: 1.0, 21: 1.0}, "from 1 to 200 by its controller"),
]


@pytest.mark.parametrize(("numbers", "why"), SETTINGS)
def test_settings_that_do_not_fit_table_toml_are_refused_before_anything_moves(numbers, why):
    bench = Bench(description("grbl"))
    bench.virtual._firmware._numbers.update(numbers)
    with pytest.raises(TableLimit) as error:
        bench.guarded.confirm([Move.home(), Move.to(0, 60 * DEG, 20 * DEG)], None, print)
    assert why in str(error.value)
    assert not {b"$H", b"$J"} & {bench.link.sent[at : at + 2] for at in range(len(bench.link.sent))}


def test_a_setting_without_a_number_ends_no_list_of_settings():
    bench = Bench(description("grbl"))
    bench.virtual._firmware._numbers = {"N0": 1.0} | bench.virtual._firmware._numbers | {13: 1.0}
    with pytest.raises(TableLimit, match="angles in inches"):
        bench.confirm()


def test_the_other_side_of_the_switch_is_refused():
    """Homed, it rests at -1 deg; a turn to 60 would drive through the switch."""
    bench = Bench(description("grbl", (-180, 180), per_deg=1.0))
    with pytest.raises(TableLimit, match=r"from 1 to 180 deg by table.toml, and from -400 to -1 by its controller"):
        bench.guarded.confirm([Move.home(), Move.to(0, 60 * DEG, 20 * DEG)], None, print)


@pytest.mark.parametrize(("numbers", "refused"), [({}, False), ({20: 1.0}, True), ({21: 1.0}, True), ({22: 9.0, 21: 1.0}, False)])
def test_an_axis_without_end_passes_a_switch_that_stops_nothing(numbers, refused):
    """$22 = 9, of grblHAL: its zero is forced, and its travel is not below it."""
    bench = Bench(description("grbl", None))
    bench.virtual._firmware._numbers.update(numbers)
    if refused:
        with pytest.raises(TableLimit, match=rf"turns without end by table.toml, and \${min(numbers)} stops it at -400 and -1 deg"):
            bench.confirm()
    else:
        bench.confirm()


def test_a_grbl_without_homing_has_no_travel_to_hold_against():
    bench = turning()
    assert bench.link.sent.startswith(b"$$\n")
