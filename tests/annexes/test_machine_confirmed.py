"""Nothing moves that nobody confirmed: an opened port, ``begin``, a make's file of a stranger, a stage that is not homed."""

from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
from commandline import refused
from virtual_line import SimulatedClock
from virtual_tables import OWN, Bench, Own, axis, description

from session.annexes.machines.description import Description
from session.annexes.machines.makefile import FOLDER
from session.annexes.machines.makes import make_of
from session.annexes.machines.makes import ximc as make_ximc
from session.annexes.machines.makes.ximc import Ximc
from session.annexes.machines.safety import Guarded, Move
from session.annexes.machines.template import template
from session.annexes.machines.verbs import TableFault, TableLimit
from session.io.errors import FormatError
from session.io.units import DEG
from tinygc.annexes.machines.recording import TurnedRecording

# ``begin``: what a drive wants before its first motion.


def test_an_opened_port_switches_nothing_on():
    bench = Bench(description(OWN))
    assert bench.link.sent == b""
    bench.guarded.where()
    bench.guarded.clear()
    bench.guarded.stop()
    said = []
    bench.guarded.confirm([Move.to(0, 30 * DEG, 10 * DEG)], None, said.append)
    assert said[1] == "  before the first move it is sent: EN"
    assert b"EN" not in bench.link.sent
    bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    assert bench.link.sent.index(b"EN\r") < bench.link.sent.index(b"SP 1 10.00000\rPA 1 30.00000\r")
    bench.guarded.settle()
    bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    assert bench.link.sent.count(b"EN") == 1


def test_the_plan_of_a_recording_shows_what_switches_it_on(tmp_path, capsys):
    (tmp_path / "table.toml").write_text(template("line"))
    bench = Bench(description(OWN))
    with closing(TurnedRecording(tmp_path / "table.toml", opened=lambda *of: bench.guarded)) as machine:
        machine.confirmed_rates([5.0], 1.0, None, yes=True)
    assert "  before the first move it is sent: EN" in capsys.readouterr().err.splitlines()
    assert b"EN" not in bench.link.sent


@pytest.mark.parametrize("verb", [lambda table: table.home(), lambda table: table.turn_at(0, 5 * DEG)])
def test_each_motion_is_one_that_it_is_switched_on_for(verb):
    bench = Bench(description(OWN))
    bench.confirm()
    assert b"EN" not in bench.link.sent
    verb(bench.guarded)
    assert bench.link.sent.count(b"EN\r") == 1
    bench.clock.sleep(0.5)
    bench.guarded.stop()


def test_a_controller_that_restarted_is_switched_on_again(tmp_path):
    (tmp_path / "own.toml").write_text((FOLDER / "line.toml").read_text().replace("[requests]\n", '[requests]\nbegin = ["CLEAR"]\n'))
    table = description("line")
    sent = make_of(Description("table", "./own.toml", table.axes), tmp_path)
    bench = Bench(Description("table", "./own.toml", table.axes, make_sha256=sent.sha256), "restart@8", folder=tmp_path, virtual=table)
    bench.confirm()
    bench.guarded.home()
    bench.guarded.settle()
    bench.clock.sleep(8)
    with pytest.raises(TableFault, match="has restarted"):
        bench.guarded.where()
    bench.guarded.home()
    bench.guarded.settle()
    assert bench.link.sent.count(b"CLEAR\n") == 2


@pytest.mark.parametrize("axes", [1, 2])
def test_a_begin_that_turns_an_axis_is_stopped(axes, monkeypatch):
    answer = Own._answer

    def turning(self, word, number, value):
        if word == "EN":
            self.mechanics.turn_to(axes - 1, 140 * DEG, 20 * DEG)
        return answer(self, word, number, value)

    monkeypatch.setattr(Own, "_answer", turning)
    bench = Bench(description(OWN, axes=axes))
    bench.confirm()
    with pytest.raises(TableFault, match=r"turns, and was not asked to: it is at [2-5]\.\d+ deg; it was stopped, and rests"):
        bench.guarded.turn_to(0, 30 * DEG, 10 * DEG)
    assert b"PA" not in bench.link.sent
    assert bench.comes_to_rest()
    assert bench.motor(axes - 1)[0] < 8 * DEG


# A make's file of a stranger.

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
TURN, WHERE = '"$J=G53 G90 G21 {word}{angle} F{rate}"', "where = ["
STRANGE = [
    (TURN, '"$J=G53 G90 G21 Y8000 F90000 ({word}{angle} F{rate})"', "may hide or change a number"),
    (TURN, '"$H ;{word}{angle} F{rate}"', "may hide or change a number"),
    (TURN, '"$J=G53 {word}{angle} F{rate}\\n$J=G91 Y9"', "may hide or change a number"),
    (TURN, '"$J=G53 {word}{angle}*{axis} F{rate}"', "may hide or change a number"),
    (TURN, '"$J=G91 G21 {word}{angle} F{rate}"', "has the number 91"),
    (TURN, '"$J=G53 G90 G20 {word}{angle} F{rate}"', "has the number 20"),
    (TURN, '"$J=G53 {word}{angle}0 F{rate}"', "has the number 73010"),
    (TURN, '"$J=G53 {word}-{angle} F{rate}"', "has the number -7301"),
    (TURN, '"$J=G53 {word}- {angle} F{rate}"', "has a sign or a point before a value"),
    (TURN, '"$J=G53 {word}.  {angle} F{rate}"', "has a sign or a point before a value"),
    (TURN, '"$J=G53 {word}{angle} F- {rate}"', "has a sign or a point before a value"),
    (TURN, '"$h ", "$J=G53 {word}{angle} F{rate}"', "has the request '$h ', which home has"),
    (TURN, '"$J=G53 {axis}{angle} F{rate}"', "has the number 837301"),
    (TURN, '"$J=G53 {word}{angle}E{axis} F{rate}"', "has the number 7301E83"),
    (TURN, '"$J=G53 {word}{angle} X{angle} F{rate}"', "needs {angle} once"),
    (TURN, '"$J=G53 {word}{rate} F{angle}"', "wants F{rate} per minute"),
    (TURN, '"$J=G53 Y{angle} F{rate}"', "names no axis"),
    (TURN, '"$J=G53 {word}{angle} F{rate} {foo}"', "has {foo}"),
    (TURN, '"$J=G53 Y140 F900", "$J=G53 {word}{angle} F{rate}"', "has the number 140"),
    (TURN, '{ raw = "$J=Y140F9" }, "$J=G53 {word}{angle} F{rate}"', "raw, or for each axis"),
    (TURN, '{ send = "$J=G53 {word}{angle} F{rate}", each = true }', "raw, or for each axis"),
    ("{signed_rate}", "{signed_rate}0", "turn_at has the number 60110"),
    ("rate_per_dps = 60.0", "rate_per_dps = 6e4", "settings.rate_per_dps is 60000"),
    ('done = ["ok"]', 'done = ["ok"]\nend = "\\n$J=G91 Y9 F9\\n"', "line.end is"),
    ('"M17"', '"$J=G53 G90 G21 Y140 F1500"', "begin has a turn"),
    ('"M17"', '"RATE 1 0"', "begin has a turn"),
    ('"M17"', '"{foo}"', "begin has a turn"),
    ('"M17"', '"' + "$J=" * 70 + '"', "has more than 200 characters"),
    (WHERE, WHERE + '{ send = "G0 Y140", answers = ["{state}"] }, ', "where has a turn"),
    (WHERE, WHERE + '{ raw = "$J=X0F99\\n", answers = ["{state}"] }, ', "where has a turn"),
    (WHERE, WHERE + '{ send = "?\\nRUN", answers = ["{state}"] }, ', "more than one line"),
    (WHERE, WHERE + '{ send = "PA {angle}", answers = ["{state}"] }, ', "turn_to and turn_at alone may have"),
    (WHERE, WHERE + '"RUN", ', "is no question"),
    ('"RATE {axis} 0"', '"RATE {axis} 7"', "stop has a turn"),
    ('"$X"', '"$J=G91 Z-9 F9"', "clear has a turn"),
    ('"$H"', '"MOVE Y 140"', "home has a turn"),
    ('"ERR"', '"G0 Y=.5"', "ask has a turn"),
]


@pytest.mark.parametrize(("before", "after", "why"), STRANGE)
def test_requests_that_say_more_than_the_plan_are_refused(before, after, why, tmp_path):
    assert MAKE.count(before) == 1
    table = Description("table", "./mine.toml", (axis("outer", "Y"),))
    (tmp_path / "mine.toml").write_text(MAKE)
    assert make_of(table, tmp_path).begin
    (tmp_path / "mine.toml").write_text(MAKE.replace(before, after))
    with pytest.raises(FormatError) as error:
        make_of(table, tmp_path)
    assert why in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("word", ["Y8000 F90000", "Y9(", "Y;"])
def test_the_word_of_an_axis_is_one_word(word):
    with pytest.raises(FormatError, match="the word of an axis is"):
        make_of(Description("table", "line", (axis("outer", word),)))


def test_a_word_that_ends_with_a_digit_makes_no_other_angle(tmp_path):
    (tmp_path / "mine.toml").write_text(MAKE.replace('order = "XYZ"\n', ""))
    with pytest.raises(FormatError, match="has the number 17301"):
        make_of(Description("table", "./mine.toml", (axis("outer", "A1"),)), tmp_path)


def test_a_word_that_ends_with_a_sign_makes_no_other_angle(tmp_path):
    text = MAKE.replace('order = "XYZ"\n', "").replace("{word}{angle}", "{word} {angle}")
    (tmp_path / "mine.toml").write_text(text)
    make_of(Description("table", "./mine.toml", (axis("outer", "A"),)), tmp_path)
    with pytest.raises(FormatError, match="has a sign or a point before a value"):
        make_of(Description("table", "./mine.toml", (axis("outer", "A-"),)), tmp_path)


TABLE = """schema = "tinygc-table/1"
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
    (tmp_path / "table.toml").write_text(TABLE)
    for words in (["where"], ["stop"], ["clear", "--yes"], ["turn", "outer", "5", "--yes", "--at-zero"]):
        refused(run("table", *words), "does not come with the tool, and nobody has confirmed it: nothing was sent")
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
    (tmp_path / "table.toml").write_text(TABLE.replace("port", f"{written}\nport"))
    assert run("table", "check")[1].splitlines()[-1] == "./mine.toml is confirmed as it is"
    assert "cannot be opened" in run("table", "where")[2]  # it came as far as the port
    (tmp_path / "mine.toml").write_text(MAKE.replace("M17", "M18"))
    refused(run("table", "where"), "has changed since it was confirmed")


# Stages on 8SMC controllers.


class Controller:
    """A controller as libximc shows it: flags and the name of the last command, at a clock that waits for nobody.

    homed: whether it says so; finds: whether its homing ends as homed; taken_up_s, lasts_s: until homing begins, and ends.
    """

    def __init__(self, clock, homed=False, finds=True, at=500.0, taken_up_s=0.5, lasts_s=3.0):
        self.clock, self.homed, self.finds, self.at, self.name, self.moves = clock, homed, finds, at, 1, []
        self.begin_s, self.end_s, self._times = np.inf, np.inf, (taken_up_s, lasts_s)
        self.open_device = self.close_device = lambda: None
        self.set_calb = lambda *of: None
        self.get_engine_settings = lambda: SimpleNamespace(MicrostepMode=9)
        self.get_move_settings_calb = lambda: SimpleNamespace()
        self.set_move_settings_calb = lambda settings: None

    def get_status_calb(self):
        now_s = self.clock.now_s()
        running = self.begin_s <= now_s < self.end_s
        if now_s >= self.begin_s:
            self.name = 6
        if now_s >= self.end_s:
            self.begin_s = self.end_s = np.inf
            self.homed, self.at = self.finds, -40.0
        return SimpleNamespace(Flags=0x20 * self.homed, MvCmdSts=self.name + 0x80 * running, CurPosition=self.at)

    def command_home(self):
        self.begin_s = self.clock.now_s() + self._times[0]
        self.end_s = self.begin_s + self._times[1]

    def command_zero(self):
        self.at = 0.0

    def command_move_calb(self, deg):
        self.at, self.name = deg, 1
        self.moves.append(deg)

    def command_sstp(self):
        self.begin_s = self.end_s = np.inf
        self.name = 8


def stage(*controllers, clock):
    library = pytest.importorskip("libximc.highlevel", exc_type=ImportError, reason="libximc is not installed, or not for this system")
    axes = [axis(name, name, (-1000, 1000)) for name in ("outer", "inner")[: len(controllers)]]
    library = SimpleNamespace(
        Axis=dict(zip(("outer", "inner"), controllers, strict=False)).get, StateFlags=library.StateFlags, MvcmdStatus=library.MvcmdStatus
    )
    table = Guarded(Ximc(Description("stage", "ximc", tuple(axes), settings={"steps_per_deg": 100}), library, clock), clock)
    moves = [Move.anywhere(table.description, number, 60 * DEG) for number in range(len(axes))]
    return table, lambda: table.confirm([Move.home(), *moves], None, lambda line: None)


def test_a_stage_that_is_not_homed_does_not_move_by_angles():
    controller = Controller(clock := SimulatedClock())
    table, confirm = stage(controller, clock=clock)
    assert np.isnan(table.where().angles[0])
    with pytest.raises(TableLimit, match="is not homed"):
        table.confirm([Move.to(0, 0.1, 0.1)], None, lambda line: None)
    confirm()
    with pytest.raises(TableLimit, match="is not homed"):
        table.turn_to(0, 30 * DEG, 10 * DEG)
    table.stop()  # it is seen at rest, whatever its angle means
    assert not controller.moves
    table.home()
    assert table.settle().angles[0] == 0  # where homing ends, at -40 deg of its count
    table.turn_to(0, 30 * DEG, 10 * DEG)
    assert controller.moves == [pytest.approx(30)]


def test_a_homing_is_not_taken_for_ended_before_it_has_begun():
    """The controller takes it up 1.9 s later; until then its flags are those of the homing before."""
    controller = Controller(clock := SimulatedClock(), homed=True, taken_up_s=1.9, at=70.0)
    table, confirm = stage(controller, clock=clock)
    assert table.where().angles[0] == pytest.approx(70 * DEG)
    confirm()
    table.home()
    clock.sleep(1.5)
    assert table.where().moving
    assert controller.at == 70
    assert table.settle().angles[0] == 0
    assert clock.now_s() == pytest.approx(4.9, abs=0.2)


def test_a_homing_that_finds_no_mark_or_is_stopped_sets_no_zero_that_counts():
    for finds, stopped in ((False, ""), (True, "here"), (True, "there")):
        controller = Controller(clock := SimulatedClock(), finds=finds)
        table, confirm = stage(controller, clock=clock)
        confirm()
        table.home()
        clock.sleep(1.0)
        table.where()
        if stopped == "here":
            table.stop()
        else:
            if stopped:
                controller.command_sstp()  # at its panel
            why = "was ended by another command" if stopped else r"does not say that it is homed \(STATE_IS_HOMED\)"
            with pytest.raises(TableFault, match=why):
                table.settle()
        assert controller.at == (500 if stopped else 0)
        assert np.isnan(table.where().angles[0])
        with pytest.raises(TableLimit, match="is not homed"):
            table.turn_to(0, 30 * DEG, 10 * DEG)


def test_steps_that_the_controller_has_lost_end_its_angles():
    controller = Controller(clock := SimulatedClock(), homed=True)
    table, confirm = stage(controller, clock=clock)
    confirm()
    controller.homed = False
    with pytest.raises(TableFault, match="is not homed any more"):
        table.where()
    assert np.isnan(table.where().angles[0])


def test_an_axis_that_stands_at_zero_counts_from_there():
    """Its count may be any; that of an axis that is homed stays."""
    homed, other = Controller(clock := SimulatedClock(), homed=True, at=12.0), Controller(clock, at=137.0)
    table, confirm = stage(homed, other, clock=clock)
    table.stands_at_zero()
    confirm()
    assert table.where().angles == pytest.approx(np.array([12, 0]) * DEG)


def test_the_library_s_own_controller_is_homed_by_no_mark(tmp_path, monkeypatch):
    """It counts from where homing ended, and says no STATE_IS_HOMED."""
    pytest.importorskip("libximc.highlevel", exc_type=ImportError, reason="libximc is not installed, or not for this system")
    from session.annexes.machines.makes import open_table

    monkeypatch.setattr(make_ximc, "TAKEN_UP_S", 0.05)
    of = axis("outer", f"xi-emu:///{tmp_path / 'stage.bin'}", fastest_rps=1000 * DEG, acceleration_rps2=50_000 * DEG)
    with Guarded(open_table(Description("stage", "ximc", (of,), settings={"steps_per_deg": 10.0}))) as table:
        table.stands_at_zero()
        table.confirm([Move.home(), Move.to(0, 60 * DEG, 1000 * DEG)], None, lambda line: None)
        table.turn_to(0, 60 * DEG, 1000 * DEG)
        table.settle()
        table.home()
        with pytest.raises(TableFault, match="does not say that it is homed"):
            table.settle()
        assert table._table.look()[0] == 0
