"""What moves a table, and what stops it: makes against their virtual tables, confirmed plans, limits, faults, threads, signals."""

import re
import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from processes import refused, until
from virtual_tables import HOMED, MAKES, OWN, Bench, VirtualLink, axis, description

from session.base.errors import CalibrationError, FormatError
from session.base.units import DEG
from session.bench.clocks import Clock
from tinygc.features.tables.machines.description import Description, read_description
from tinygc.features.tables.machines.link import TableFault, TableLimit
from tinygc.features.tables.machines.makefile import LONGEST_LINE, Pattern, read_make
from tinygc.features.tables.machines.makes import make_of, makes, open_table, template
from tinygc.features.tables.machines.safety import Guarded, Move, plan_lines
from tinygc.features.tables.machines.virtual import VirtualTable
from tinygc.features.tables.machines.virtual_motion import FAULTS, Fault


@pytest.mark.parametrize("make", MAKES)
def test_the_five_verbs(make):
    bench = Bench(description(make))
    bench.confirm()
    with bench.guarded as table:
        table.home()
        assert table.where().moving
        assert table.settle().angles[0] == pytest.approx(HOMED.get(make, 0) * DEG, abs=0.02 * DEG)
        begin_s = bench.clock.now_s()
        table.turn_to(0, 90 * DEG, 30 * DEG)
        assert table.settle().angles[0] == pytest.approx(90 * DEG, abs=0.02 * DEG)
        assert bench.motor()[0] == pytest.approx(90 * DEG, abs=0.02 * DEG)
        assert 3.25 <= bench.clock.now_s() - begin_s < 4.5  # 90 deg at 30 dps with 0.3 s of ramp: the rate has the right unit
        table.turn_at(0, -20 * DEG)
        bench.clock.sleep(2.0)
        assert bench.motor()[1] == pytest.approx(-20 * DEG, rel=1e-3)
        assert table.where().moving
        table.stop()
        assert bench.motor()[1] == 0
        angle = table.where().angles[0]
        assert angle == pytest.approx(bench.motor()[0], abs=0.02 * DEG)
        assert 40 * DEG < angle < 55 * DEG
        assert not table.settle().moving


def test_grbl_hears_its_documented_grammar_and_nothing_else():
    """Jogs of at most 80 characters, real-time characters, and $H: interface and jogging pages of GRBL 1.1."""
    bench = Bench(description("grbl"))
    bench.confirm()
    with bench.guarded as table:
        table.home()
        table.settle()
        table.turn_to(0, 12.3456 * DEG, 10 * DEG)
        table.settle()
        table.turn_at(0, 7.5 * DEG)
        bench.clock.sleep(1)
        table.stop()
    reported = re.sub(rb"\x85+$", b"\x85", bench.link.sent.replace(b"?", b""))  # it is written again until it is heard
    assert reported == b"$$\n$H\n$J=G53 G90 G21 X-12.346 F600.000\n$J=G53 G90 G21 X-270.000 F450.000\n\x85"


def test_units_of_the_make_and_its_sense():
    """A table whose motor turns the other way, with ten units to a degree."""
    bench = Bench(description("line", per_deg=-10.0, rate_per_dps=10.0), virtual=description("line", (-1e4, 1e4)))
    bench.driver.turn_to(0, 3 * DEG, 5 * DEG)
    bench.clock.sleep(30)
    assert bench.driver.where().angles[0] == pytest.approx(3 * DEG)
    bench.driver.turn_at(0, 2 * DEG)
    assert bench.link.sent.endswith(b"RATE outer -20.0000\n")
    assert b"TURN outer -30.0000 50.0000\n" in bench.link.sent


def test_an_emergency_stop_is_cleared_by_a_person_alone():
    bench = Bench(description("grbl"), "estop@6")
    bench.confirm()
    table = bench.guarded
    table.home()
    table.settle()
    table.turn_to(0, 200 * DEG, 30 * DEG)
    with pytest.raises(TableFault, match="ALARM:3"):
        table.settle()
    for verb in (table.home, lambda: table.turn_to(0, DEG, DEG), table.where):
        with pytest.raises(TableFault, match="ALARM:3"):
            verb()
    assert not bench.link.sent.endswith((b"$X\n", b"$H\n"))
    with pytest.raises(TableFault, match="error:13"):
        table.clear()  # it is still pressed
    with pytest.raises(TableFault, match="ALARM:3"):
        table.where()
    bench.virtual.mechanics.release()
    table.clear()
    table.home()
    assert table.settle().angles[0] == pytest.approx(DEG)


@pytest.mark.parametrize("make", sorted(makes()))
@pytest.mark.parametrize("axes", [1, 3])
def test_each_make_has_a_first_description_of_more_axes(make, axes, tmp_path):
    """Perpendicular axes with words of their own, which its requests take."""
    (tmp_path / "table.toml").write_text(template(make, axes))
    table = read_description(tmp_path / "table.toml")
    directions = np.array([axis.direction for axis in table.axes])
    assert np.array_equal(directions @ directions.T, np.eye(axes))
    assert table.axes[0].name == "outer"
    Bench(table)


def refused_once_changed(read, path, text, before, after, expected):
    """In one line; as it is, it is read."""
    path.write_text(text)
    read()
    assert text.count(before) == 1
    path.write_text(text.replace(before, after))
    with pytest.raises(FormatError) as error:
        read()
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


GOOD = """schema = "tinygc-make/1"
title = "t"
[requests]
turn_to = ["GO {angle}"]
stop = [["STOP"]]
where = [{ send = "W", answers = ["{angles}"] }]
"""


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ('"{angles}"', '"{angels}"', "expected fields among"),
        ('"{angles}"', '"****{angles}"', "at most 3 *"),
        ('"{angles}"', '"{angle} {angle}"', "each once"),
        ('send = "W"', 'send = "W", raw = "W"', "needs send or raw, and not both"),
        ("[requests]", "[settings]\nanswer_s = 0\n[requests]", "settings.answer_s is 0"),
        ("[requests]", "[settings]\nx = []\n[requests]", "settings.x is a list of 0"),
        ('["STOP"]', "[]", "requests.stop has an empty list, or a hardest without"),
        ('"STOP"', '{ send = "STOP", states = ["Jog"] }', "requests.stop has an empty list, or a hardest without a request that has no"),
    ],
)
def test_a_wrong_make_file_is_refused_in_one_line(before, after, expected, tmp_path):
    path = tmp_path / "mine.toml"
    refused_once_changed(lambda: read_make(path), path, GOOD, before, after, expected)


def test_no_pattern_makes_a_reader_wait():
    """The worst that a file may hold, on the longest line."""
    begin_s = time.process_time()
    for line in ("a" * 10_000, "1," * 5000, "1.1e1" * 2000, "1" * 10_000, ":" * 10_000):
        assert Pattern("*{state}*{angles}*{code}!").match(line) is None
        assert Pattern("*{angles}*{state}{code}{fault}!").match(line) is None
        assert Pattern("*a*a*b").match(line) is None
    assert time.process_time() - begin_s < 5  # with numbers that may be split at any digit: minutes
    assert LONGEST_LINE <= 200


# Nothing moves that nobody confirmed, and nothing beyond its limits.


TABLE = description("line")


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
    reported = []

    def ask(question):
        reported.append(question)
        return False

    moves = [Move.home(), Move.to(0, 30 * DEG, 10 * DEG), Move.anywhere(TABLE, 0, 60 * DEG), Move.at(0, 20 * DEG, 8.0)]
    with pytest.raises(TableLimit, match="not confirmed; nothing was moved"):
        Guarded(Bench(TABLE).driver).confirm(moves, ask, reported.append)
    assert reported == [*plan_lines(TABLE, moves), "Move it?"]
    assert reported[2:5] == [
        "  2. outer to 30 deg at up to 10 dps (limits -90 to 270 deg)",
        "  3. outer to any angle from -90 to 270 deg at up to 60 dps (limits -90 to 270 deg)",
        "  4. outer turns at 20 dps, in either sense, for at most 8 s, which is 160 deg (limits -90 to 270 deg)",
    ]


@pytest.mark.parametrize(("angle", "rate"), [(271, 10), (-91, 10), (float("nan"), 10), (0, 61), (0, 0), (0, float("nan"))])
def test_limits_hold_for_each_move(angle, rate):
    bench = turning()
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
    reported = np.sign(bench.table.settings.get("per_deg", 1)) * bench.virtual.tracks[0].reported(t_s)
    assert reported.min() >= limits[0] * DEG - 1e-6
    assert reported.max() <= limits[1] * DEG + 1e-6
    assert np.ptp(reported) > 60 * DEG  # it did move


def test_a_second_move_waits_for_the_first():
    bench = turning()
    bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    with pytest.raises(TableLimit, match="still moves"):
        bench.guarded.turn_to(0, 0.0, 10 * DEG)


@pytest.mark.parametrize("make", MAKES)
def test_a_table_that_somebody_else_moves_is_left_alone(make):
    bench = turning(make, limits=None)
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


def test_an_opened_port_switches_nothing_on():
    bench = Bench(description(OWN))
    assert bench.link.sent == b""
    bench.guarded.where()
    bench.guarded.clear()
    bench.guarded.stop()
    reported = []
    bench.guarded.confirm([Move.to(0, 30 * DEG, 10 * DEG)], None, reported.append)
    assert reported[1] == "  before the first move it is sent: EN"
    assert b"EN" not in bench.link.sent
    bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    assert bench.link.sent.index(b"EN\r") < bench.link.sent.index(b"SP 1 10.00000\rPA 1 30.00000\r")
    bench.guarded.settle()
    bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    assert bench.link.sent.count(b"EN") == 1


MAKE = """schema = "tinygc-make/1"
title = "of a stranger"
[settings]
rate_per_dps = 60.0
foo = "G0 Y140"
[line]
done = ["ok"]
[requests]
begin = ["M17", "G21 G90"]
home = ["$H"]
turn_to = ["$J=G53 G90 G21 {word}{angle} F{rate}"]
turn_at = ["RATE {axis} {signed_rate}"]
stop = [[{ raw = "\\u0085" }], ["RATE {axis} 0"]]
clear = ["$X"]
where = [{ raw = "?", answers = ["<{state}|MPos:{angles}|*>"] }]
[states]
order = "XYZ"
rest = ["Idle"]
moving = ["Jog"]
[errors]
ask = [{ send = "ERR", answers = ["{code}"] }]
"""


#: of what the file says: what stands there instead, and why it is refused
STRANGE = {
    '"$J=G53 G90 G21 {word}{angle} F{rate}"': {
        '"$J=G53 G90 G21 Y8000 F90000 ({word}{angle} F{rate})"': "may hide or change a number",
        '"$J=G53 {word}{angle} F{rate}\\n$J=G91 Y9"': "may hide or change a number",
        '"$J=G53 {word}{angle}*{axis} F{rate}"': "may hide or change a number",
        '"$J=G53 G90 G20 {word}{angle} F{rate}"': "has the number 20",
        '"$J=G53 {word}{angle}0 F{rate}"': "has the number 73010",
        '"$J=G53 {word}-{angle} F{rate}"': "has the number -7301",
        '"$J=G53 {word}- {angle} F{rate}"': "has a sign or a point before a value",
        '"$h ", "$J=G53 {word}{angle} F{rate}"': "has the request '$h ', which home has",
        '"$J=G53 {word}{angle}E{axis} F{rate}"': "has the number 7301E83",
        '"$J=G53 {word}{angle} X{angle} F{rate}"': "needs {angle} once",
        '"$J=G53 {word}{rate} F{angle}"': "takes F{rate} per minute",
        '"$J=G53 Y{angle} F{rate}"': "names no axis",
        '"$J=G53 {word}{angle} F{rate} {foo}"': "has {foo}",
        '"$J=G53 Y140 F900", "$J=G53 {word}{angle} F{rate}"': "has the number 140",
        '{ raw = "$J=Y140F9" }, "$J=G53 {word}{angle} F{rate}"': "raw, or for each axis",
    },
    "rate_per_dps = 60.0": {"rate_per_dps = 6e4": "settings.rate_per_dps is 60000"},
    'done = ["ok"]': {'done = ["ok"]\nend = "\\n$J=G91 Y9 F9\\n"': "line.end is"},
    '"M17"': {
        '"$J=G53 G90 G21 Y140 F1500"': "begin has a turn",
        '"{foo}"': "begin has a turn",
        '"' + "$J=" * 70 + '"': "has more than 200 characters",
    },
    "where = [": {
        'where = [{ send = "G0 Y140", answers = ["{state}"] }, ': "where has a turn",
        'where = [{ send = "?\\nRUN", answers = ["{state}"] }, ': "more than one line",
        'where = [{ send = "PA {angle}", answers = ["{state}"] }, ': "turn_to and turn_at alone may have",
        'where = ["RUN", ': "is no question",
    },
    '"RATE {axis} 0"': {'"RATE {axis} 7"': "stop has a turn"},
    '"$H"': {'"MOVE Y 140"': "home has a turn"},
    '"ERR"': {'"G0 Y=.5"': "ask has a turn"},
}


@pytest.mark.parametrize(("before", "after", "why"), [(before, *row) for before, rows in STRANGE.items() for row in rows.items()])
def test_requests_that_say_more_than_the_plan_are_refused(before, after, why, tmp_path):
    table = Description("table", "./mine.toml", (axis("outer", "Y"),))
    refused_once_changed(lambda: make_of(table, tmp_path), tmp_path / "mine.toml", MAKE, before, after, why)


STRANGERS = """schema = "tinygc-table/1"
name = "own"
make = "./mine.toml"
port = "none"
[[axis]]
name = "outer"
word = "Y"
direction = [0, 0, 1]
least_deg = -180
most_deg = 180
fastest_dps = 25
acceleration_dps2 = 80
sigma_deg = 0.1
"""


def test_a_stranger_s_file_is_confirmed_by_its_hash(run, tmp_path, monkeypatch):
    """The check shows all that can be sent, and the line that confirms it; a file that has changed is asked for anew."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(MAKE)
    (tmp_path / "table.toml").write_text(STRANGERS)
    for words in (["where"], ["stop"], ["clear", "--yes"], ["turn", "outer", "5", "--yes", "--at-zero"]):
        refused(run("table", *words), "does not come with the tool, and no one has confirmed it: nothing was sent")
    code, out, _ = run("table", "check")
    assert code == 0
    *sent, line = out.splitlines()
    assert [each.removeprefix("sent for ") for each in sent if each.startswith("sent for ")] == [
        "where it is: ?",
        "the first motion, before it: M17; G21 G90",
        "homing: $H",
        "outer to 30 deg at 10 dps: $J=G53 G90 G21 Y30.0000 F600.0000",
        "outer at 10 dps: RATE 1 600.0000",
        "whether it takes a motion: ERR",
        r"stop: '\x85'",
        "stop, harder: RATE 1 0",
        "clear: $X",
    ]
    written = line[line.index("make_sha256 = ") :]
    (tmp_path / "table.toml").write_text(STRANGERS.replace("port", f"{written}\nport"))
    assert run("table", "check")[1].splitlines()[-1] == "./mine.toml is confirmed as it is"
    assert "cannot be opened" in run("table", "where")[2]  # it came as far as the port
    (tmp_path / "mine.toml").write_text(MAKE.replace("M17", "M18"))
    refused(run("table", "where"), "has changed since it was confirmed")


# Faults.


#: faults that the machine does not know of, and that a driver can live with
HARMLESS = ("late", "doubled", "lost_steps")


#: what the line names, on any make; a controller that restarts without a word is seen by its angle
NAMED = {
    "estop": "emergency stop|ALARM:3|ALARM 1",
    "limit": "limit|ALARM",
    "cable": "line to the table is lost",
    "silence": "does not (answer|say)",
    "garbled": "does not (answer|say)|refuse|reports|turned by|wrong way|beyond|state|rests at",
    "stall": r"rests at [01]\.\d+ deg, requested was 90",
    "wrong_angle": "turned by|rests at 120",
    "home_fails": "home|homing",
    "disabled": "amplifier|error:7|motors",
    "endless": r"beyond the 90\.00 that it was sent to",
    "restart": "restarted|turned by",
    "unknown_error": "the make's file does not know",
}


def led(make, faults):
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
    bench, fault = led(make, f"{kind}@move{1 if kind == 'home_fails' else 2}")
    said_rest = bench.guarded.is_at_rest
    assert said_rest <= (bench.motor()[1] == 0)  # what is reported to rest does
    assert bench.comes_to_rest()  # without anybody: also where nothing could be sent any more
    of = bench.table.axes[0]
    assert of.least_rad - DEG <= bench.motor()[0] <= of.most_rad + DEG
    assert (fault is None) == (kind in HARMLESS)
    if fault is not None:
        assert fault.exit_code == 3
        assert "\n" not in str(fault)
        assert re.search(NAMED[kind], str(fault)), str(fault)
        assert said_rest or "not seen at rest" in str(fault)


@pytest.mark.parametrize("text", ["nothing", "estop@", "estop@x", "estop@move", "estop@-1", "ESTOP@1"])
def test_a_wrong_fault_is_named(text):
    with pytest.raises(CalibrationError, match="expected NAME@SECONDS or NAME@moveN"):
        Fault.parse(text)


def turning(make="line", limits=(-90, 270), **more):
    """A bench whose moves are confirmed, and which is ready to move."""
    bench = Bench(description(make, limits), **more)
    if bench.driver.make.requests.clear:
        bench.driver.clear()
    bench.confirm()
    return bench


def followed(bench, seconds):
    """Look at it for so long, as a program does."""
    for _ in range(20 * seconds):
        bench.clock.sleep(0.05)
        bench.guarded.where()


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


@pytest.mark.parametrize("make", ["scpi", "line"])  # the others ask the mechanics otherwise
def test_a_move_that_begins_late_is_stopped(make):
    """It reports that it rests, and would turn 0.8 s after the request, watched by nobody."""
    bench = turning(make)
    mechanics = bench.virtual.mechanics
    turn_to = mechanics.tracks[0].turn_to
    mechanics.tracks[0].turn_to = lambda begin_s, *of: turn_to(begin_s + 0.8, *of)
    mechanics.is_moving = lambda axis=None: abs(mechanics.tracks[0].state(mechanics.now_s())[1]) > 1e-9
    bench.guarded.turn_to(0, 100 * DEG, 20 * DEG)
    with pytest.raises(TableFault, match=r"rests at 0\.00 deg, requested was 100\.00; it was stopped, and rests"):
        bench.guarded.settle()
    bench.clock.sleep(5)
    assert abs(bench.motor()[0]) < DEG


def test_states_of_grbl():
    bench = Bench(description("grbl"))
    for state, moves in {"Run": True, "Hold:1": True, "Idle": False}.items():
        bench.virtual._firmware._state = lambda state=state: state
        assert bench.driver.where().moving is moves
    for state, expected in {"Hold:0": "feed hold", "Door:1": "safety door is open", "Sleep": "asleep", "Foo": "heard '<Foo"}.items():
        bench.virtual._firmware._state = lambda state=state: state
        with pytest.raises(TableFault, match=expected):
            bench.driver.where()


def test_a_table_beyond_its_limits_is_stopped_whoever_moved_it():
    bench = turning()
    bench.guarded.where()
    bench.virtual.mechanics.turn_at(0, -20 * DEG)
    with pytest.raises(TableFault, match=r"beyond its limits; it was stopped, and rests"):
        followed(bench, 20)
    assert bench.motor()[1] == 0
    assert -95 * DEG < bench.motor()[0] < -90 * DEG  # it braked from 20 dps


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
    with pytest.raises(TableFault, match=r"inner turns without a command: it is at -[34]\.\d+ deg; it was stopped, and rests"):
        followed(bench, 20)


@pytest.mark.parametrize(
    ("before", "factor", "expected"), [(0, -8, "turns the wrong way"), (0, 2, "it turned by"), (30, 8, "it turned by")]
)
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
    with pytest.raises(TableFault, match=rf"{expected}.*requested was \+5 dps; it was stopped, and rests"):
        followed(bench, 12)
    assert abs(bench.motor()[0] - begin) < (140 if before else 50) * DEG


@pytest.mark.parametrize("make", MAKES)
def test_the_rates_that_were_asked_for_are_not_stopped(make):
    bench = turning(make, limits=None)
    for rate in (5, -40, 60, -60, 1):
        bench.guarded.turn_at(0, rate * DEG)
        followed(bench, 4)
    bench.guarded.turn_at(0, 0.0)
    assert not bench.guarded.settle().moving


@pytest.mark.parametrize(("make", "rate"), [("grbl", 20), (OWN, -20)])
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


# How it is stopped.


@pytest.mark.parametrize("make", MAKES)
def test_a_stop_is_the_first_that_is_written(make):
    """`table stop`: nothing is waited for, also where the controller answers nothing at all."""
    opened = Bench(description(make))
    begun = len(opened.link.sent)
    opened.driver.stop()
    assert Bench(description(make), "silence@0", stops=True).link.sent.startswith(opened.link.sent[begun:])
    assert len(opened.link.sent) > begun


def test_a_stop_of_another_thread_right_behind_a_move_is_not_lost():
    bench = jogging()
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


def test_the_end_of_the_program_stops_it(monkeypatch):
    """Without ``__exit__``: what is registered for the end of the program."""
    registered = []
    monkeypatch.setattr("atexit.register", registered.append)
    bench = turning()
    bench.guarded.__enter__()
    bench.guarded.turn_to(0, 200 * DEG, 10 * DEG)
    bench.clock.sleep(1)
    (at_exit,) = registered
    at_exit()
    assert bench.comes_to_rest()
    assert bench.motor()[0] < 12 * DEG
    bench.guarded.__exit__(None, None, None)


class FastClock(Clock):
    """60 s in each second."""

    def now_s(self):
        return 60 * super().now_s()

    def sleep(self, seconds):
        super().sleep(seconds / 60)


def test_a_program_that_does_not_look_any_more_is_stopped_for():
    clock = FastClock()
    virtual = VirtualTable(TABLE, clock)
    virtual.feed()  # it was switched on before its port is opened
    table = Guarded(open_table(TABLE, None, VirtualLink(virtual, clock), clock), clock)
    table.confirm([Move.to(0, 200 * DEG, 0.1 * DEG)], None, print)
    with table:
        table.turn_to(0, 200 * DEG, 0.1 * DEG)
        until(lambda: virtual.tracks[0].busy_until_s < 1500)  # without a stop it would turn for 2000 s
        table.stop()
    assert virtual.tracks[0].state(clock.now_s() - virtual.mechanics.begin_s)[1] == 0


def test_signals_wait_until_it_has_stopped():
    """The first stop is told to a table that is still turning."""
    bench = turning()
    stop, told = bench.driver.stop, []

    def disturbed():
        signal.raise_signal(signal.SIGINT)
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


def test_stop_does_not_wait_for_an_answer():
    """In real time: one thread waits for an answer that does not come, another stops."""
    clock, table = Clock(), description("line", answer_s=0.8)
    virtual = VirtualTable(table, clock, Fault.parse("silence@0.3"))
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


WITHOUT_SWITCHES = description("grbl", homing=False)


def jogging():
    """A GRBL without switches whose moves are confirmed."""
    bench = Bench(WITHOUT_SWITCHES)
    bench.confirm()
    return bench


def test_a_stop_right_behind_a_move_is_not_lost():
    """0x85 is dropped before the line is read: it is written again until the line's ok has come, and no jog is said."""
    bench = jogging()
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


@pytest.mark.parametrize("stopped_by", ["limit", "hold"])
def test_what_ends_its_silence_is_said_and_clear_sends_it(stopped_by):
    """Behind a limit switch GRBL answers nothing at all, in a hold no line; a program that opens the port then has heard no alarm."""
    bench = jogging()
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
    for verb in (other.where, lambda: other.confirm(plan, None, print)):
        with pytest.raises(TableFault, match=r"`table clear`"):
            verb()
    mechanics.release()
    other.clear()
    mechanics.clear()
    assert other.where().angles[0] == pytest.approx(100 * DEG)
    other.confirm(plan, None, print)
    other.turn_to(0, 90 * DEG, 30 * DEG)  # nor are its angles lost


@pytest.mark.parametrize("number", [0, 1])
def test_no_axis_that_moves_is_cleared(number):
    bench = Bench(description("scpi", axes=2))
    bench.confirm()
    bench.guarded.turn_to(number, 100 * DEG, 10 * DEG)
    with pytest.raises(TableFault, match="it moves; stop it before"):
        bench.driver.clear()


def test_a_rate_that_its_decimals_make_zero_is_refused():
    """0.001 mm/min is the least that three decimals say: 1.7e-5 dps."""
    bench = jogging()
    with pytest.raises(TableLimit, match=r"at 5e-06 dps would be sent as 0, expected 1\.67e-05 dps or more; nothing was moved"):
        bench.guarded.confirm([Move.to(0, DEG, 5e-6 * DEG)], None, print)
    for verb in (lambda rate: bench.guarded.turn_to(0, DEG, rate), lambda rate: bench.guarded.turn_at(0, -rate)):
        with pytest.raises(TableLimit, match="would be sent as 0"):
            verb(5e-6 * DEG)
    assert b"$J" not in bench.link.sent


# Its port and its own settings.


@pytest.mark.parametrize(
    ("numbers", "why"),
    [
        ({13: 1.0}, "angles in inches: set $13 to 0"),
        ({130: 200.0}, "from 1 to 270 deg by table.toml, and from 1 to 200 by its controller ($130, $27, $23): beyond is its switch"),
        ({27: 3.0, 23: 1.0, 130: 272.0}, "from 0 to 269 by its controller"),
        ({27: 3.0, 20: 1.0, 21: 1.0}, "from 3 to 400 by its controller"),
    ],
)
def test_settings_that_do_not_fit_table_toml_are_refused_before_anything_moves(numbers, why):
    bench = Bench(description("grbl"))
    bench.virtual._firmware._numbers.update(numbers)
    with pytest.raises(TableLimit) as error:
        bench.guarded.confirm([Move.home(), Move.to(0, 60 * DEG, 20 * DEG)], None, print)
    assert why in str(error.value)
    assert not {b"$H", b"$J"} & {bench.link.sent[at : at + 2] for at in range(len(bench.link.sent))}


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ("least_deg", "leastdeg", "axis[0].leastdeg: an axis has no such key, expected name, direction"),
        ('word = "outer"', 'word = "outer 10 10\\nTURN outer"', "axis[0].word is"),
        ('word = "outer"', 'word = "outer\\u0085"', "axis[0].word is"),
    ],
)
def test_a_wrong_axis_is_refused_in_one_line(before, after, expected, tmp_path):
    path = tmp_path / "table.toml"
    refused_once_changed(lambda: read_description(path), path, template("line"), before, after, expected)
