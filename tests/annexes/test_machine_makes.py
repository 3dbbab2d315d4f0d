"""Each make against its virtual table, whose side was written from the make's documentation: the five verbs, bytes, units."""

import hashlib
import re
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from virtual_line import SimulatedClock, VirtualLink
from virtual_tables import HOMED, MAKES, OWN, Bench, description

from session.annexes.machines.description import read_description
from session.annexes.machines.dialogue import Dialogue, example
from session.annexes.machines.makefile import read_make
from session.annexes.machines.makes import MODULES, make_of, makes, open_table
from session.annexes.machines.makes.hand import Hand
from session.annexes.machines.proof import require_fit
from session.annexes.machines.safety import Guarded, Move
from session.annexes.machines.template import template
from session.annexes.machines.verbs import TableFault
from session.io.errors import CalibrationError, FormatError
from session.io.units import DEG


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


@pytest.mark.parametrize("make", MAKES)
def test_two_axes_move_by_themselves(make):
    bench = Bench(description(make, axes=2))
    bench.confirm()
    with bench.guarded as table:
        table.home()
        table.settle()
        table.turn_to(1, 45 * DEG, 60 * DEG)
        table.settle()
        table.turn_to(0, 120 * DEG, 60 * DEG)
        assert table.settle().angles == pytest.approx(np.array([120, 45]) * DEG, abs=0.02 * DEG)
    assert [bench.motor(number)[0] / DEG for number in (0, 1)] == pytest.approx([120, 45], abs=0.02)


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
    said = re.sub(rb"\x85+$", b"\x85", bench.link.sent.replace(b"?", b""))  # it is written again until it is heard
    assert said == b"$$\n$H\n$J=G53 G90 G21 X-12.346 F600.000\n$J=G53 G90 G21 X-270.000 F450.000\n\x85"
    jog = rb"\$J=(?:G53 )?G9[01] G2[01] [XYZABC]-?\d+\.\d+ F\d+(?:\.\d+)?"
    assert all(len(line) < 80 and re.fullmatch(rb"\$[$H]|" + jog, line) for line in said.rstrip(b"\x85").splitlines())


def test_a_grbl_jog_that_is_not_cancelled_is_held_and_reset():
    bench = Bench(description("grbl"))
    bench.driver.stop()
    bench.driver.stop()
    bench.driver.stop()
    assert bench.link.sent.replace(b"?", b"") == b"\x85!\x18!\x18"


def test_units_of_the_make_and_its_sense():
    """A table whose motor turns the other way, with ten units to a degree."""
    bench = Bench(description("line", per_deg=-10.0, rate_per_dps=10.0), virtual=description("line", (-1e4, 1e4)))
    bench.driver.turn_to(0, 3 * DEG, 5 * DEG)
    bench.clock.sleep(30)
    assert bench.driver.where().angles[0] == pytest.approx(3 * DEG)
    bench.driver.turn_at(0, 2 * DEG)
    assert bench.link.sent.endswith(b"RATE outer -20.0000\n")
    assert b"TURN outer -30.0000 50.0000\n" in bench.link.sent


@pytest.mark.parametrize("make", ["scpi", "line"])
def test_the_own_clock_is_read(make):
    bench = Bench(description(make))
    bench.clock.sleep(12.5)
    assert bench.driver.where().table_s == pytest.approx(bench.clock.now_s() - bench.virtual.mechanics.begin_s, abs=0.1)


def test_a_locked_grbl_says_so_and_is_homed():
    bench = Bench(description("grbl"))
    with pytest.raises(TableFault, match=r"state Alarm: locked.*home it"):
        bench.driver.where()
    with pytest.raises(TableFault, match=r"error:9.*home it first"):
        bench.driver.turn_to(0, DEG, DEG)
    bench.driver.home()
    bench.driver.where()
    bench.clock.sleep(5)
    assert not bench.driver.where().moving


def test_soft_limits_of_grbl_that_were_set_since_are_named():
    bench = Bench(description("grbl", (1, 180)))
    bench.confirm()
    bench.guarded.home()
    bench.guarded.settle()
    bench.link.write(b"$20=1\n$130=120\n")
    bench.clock.sleep(0.1)
    bench.link.read(0.0)
    with pytest.raises(TableFault, match=r"error:15.*-\$130 to 0"):
        bench.guarded.turn_to(0, 121 * DEG, 30 * DEG)
    bench.guarded.turn_to(0, 119 * DEG, 30 * DEG)
    assert bench.guarded.settle().angles[0] == pytest.approx(119 * DEG)


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


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        ("Run", True),
        ("Hold:1", True),
        ("Idle", False),
        ("Hold:0", "feed hold"),
        ("Door:1", "safety door is open"),
        ("Sleep", "asleep"),
        ("Foo", "heard '<Foo"),
    ],
)
def test_states_of_grbl(state, expected, monkeypatch):
    bench = Bench(description("grbl"))
    monkeypatch.setattr(bench.virtual._firmware, "_state", lambda: state)
    if isinstance(expected, bool):
        assert bench.driver.where().moving is expected
    else:
        with pytest.raises(TableFault, match=expected):
            bench.driver.where()


def test_an_acknowledgement_that_is_left_over_is_not_the_next_one_s():
    bench = Bench(description("line"), "disabled@0")
    bench.link._received += b"OK\nOK\n"
    with pytest.raises(TableFault, match="ERROR 3"):
        bench.driver.turn_to(0, DEG, DEG)


def test_a_restart_does_not_end_an_emergency_stop():
    """A stop that is wired to the reset: the alarm, then the start-up message."""
    bench = Bench(description("grbl", homing=False))
    assert not bench.driver.where().moving
    bench.link._received += b"ALARM:3\r\n\r\nGrbl 1.1h ['$' for help]\r\n"
    for verb in (bench.driver.where, bench.driver.home):
        with pytest.raises(TableFault, match="ALARM:3"):
            verb()
    assert b"$H" not in bench.link.sent


def test_a_controller_that_restarted_is_homed_again():
    bench = Bench(description("grbl"), "restart@5")
    bench.confirm()
    bench.guarded.home()
    bench.guarded.settle()
    bench.clock.sleep(6)
    for verb in (bench.guarded.where, lambda: bench.guarded.turn_to(0, DEG, DEG)):
        bench.guarded.forget_alarm()  # which does not bring the angles back
        with pytest.raises(TableFault, match=r"has restarted.*home it"):
            verb()
    bench.guarded.home()
    assert bench.guarded.settle().angles[0] == pytest.approx(DEG)


def test_an_axis_that_was_left_beyond_its_limits_comes_back():
    bench = Bench(description("line"), virtual=description("line", (-1e4, 1e4)))
    bench.virtual.tracks[0].turn_to(0.0, 300 * DEG, 60 * DEG, 100 * DEG)
    bench.clock.sleep(10)
    bench.confirm()
    bench.guarded.turn_to(0, 100 * DEG, 60 * DEG)
    assert bench.guarded.settle().angles[0] == pytest.approx(100 * DEG)


@pytest.mark.parametrize("make", sorted(makes()))
def test_each_make_has_a_first_description(make, tmp_path):
    (tmp_path / "table.toml").write_text(template(make))
    table = read_description(tmp_path / "table.toml")
    assert table.make == make
    if make not in MODULES:
        sent = dict(example(table, make_of(table)))
        assert any(what.startswith(f"outer to {-1 if make == 'grbl' else 30} deg") for what in sent)
        assert all("{" not in text for text in sent.values())


@pytest.mark.parametrize("make", sorted(makes()))
@pytest.mark.parametrize("axes", [2, 3])
def test_each_make_has_a_first_description_of_more_axes(make, axes, tmp_path):
    """Perpendicular axes with words of their own, which its requests take."""
    (tmp_path / "table.toml").write_text(template(make, axes))
    table = read_description(tmp_path / "table.toml")
    directions = np.array([axis.direction for axis in table.axes])
    assert np.array_equal(directions @ directions.T, np.eye(axes))
    assert table.axes[0].name == "outer"
    assert table.axes[-1].name == "inner"
    if make not in MODULES:
        Bench(table)


def test_a_make_of_ones_own(tmp_path):
    """A file beside table.toml, a copy of a shipped one with another word: as it was confirmed, and no other."""
    text = (make_file := template("line")) and make_of(description("line")).name
    assert text == "line"
    from session.annexes.machines.makefile import FOLDER

    (tmp_path / "mine.toml").write_text((FOLDER / "line.toml").read_text().replace('"HOME"', '"HOME", "HOME"'))
    table = read_description(_written(tmp_path / "table.toml", make_file.replace('make = "line"', 'make = "./mine.toml"')))
    for hash_, why in (("", "does not come with the tool, and nobody has confirmed it"), ("0" * 64, "has changed since it was confirmed")):
        with pytest.raises(FormatError, match=rf"mine\.toml {why}: nothing was sent; .*table check shows all that it can send"):
            open_table(replace(table, make_sha256=hash_, port=str(tmp_path / "none")), tmp_path)
    table = replace(table, make_sha256=hashlib.sha256((tmp_path / "mine.toml").read_bytes()).hexdigest())
    bench = Bench(table, folder=tmp_path, virtual=description("line"))
    bench.driver.home()
    assert bench.link.sent == b"HOME\nHOME\n"


def _written(path, text):
    path.write_text(text)
    return path


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
        ("{angle}", "{angel}", "{angel}"),
        ('"{angles}"', '"{angels}"', "expected fields among"),
        ('"{angles}"', '"{state}"', "needs stop, turn_to, and a where"),
        ('"{angles}"', '"****{angles}"', "at most 3 *"),
        ('"{angles}"', '"{angle} {angle}"', "each once"),
        ('"{angles}"', '"{angle}"', "answered with one angle"),
        ('"{angles}"', '"{angles"', "expected fields among"),
        ('send = "W"', 'send = "W", raw = "W"', "needs send or raw, and not both"),
        ("[requests]", "[settings]\nanswer_s = 0\n[requests]", "settings.answer_s is 0"),
        ("[requests]", "[settings]\ndecimals = 12\n[requests]", "settings.decimals is 12"),
        ("[requests]", "[settings]\nx = []\n[requests]", "settings.x is a list of 0"),
        ('[["STOP"]]', "[]", "needs stop"),
        ('["STOP"]', "[]", "requests.stop has an empty list, or a hardest without"),
        ('"STOP"', '{ send = "STOP", states = ["Jog"] }', "requests.stop has an empty list, or a hardest without a request that has no"),
        ("GO", "\u2192", "more than one byte"),
        ("tinygc-make/1", "tinygc-make/2", "tinygc-make/1"),
        ("title", "titel", "title is missing"),
    ],
)
def test_a_wrong_make_file_is_refused_in_one_line(before, after, expected, tmp_path):
    assert read_make(_written(tmp_path / "good.toml", GOOD)).where
    with pytest.raises(FormatError) as error:
        read_make(_written(tmp_path / "bad.toml", GOOD.replace(before, after)))
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


def test_no_pattern_makes_a_reader_wait():
    """The worst that a file may hold, on the longest line."""
    from session.annexes.machines.makefile import LONGEST_LINE, Pattern

    begin_s = time.process_time()
    for line in ("a" * 10_000, "1," * 5000, "1.1e1" * 2000, "1" * 10_000, ":" * 10_000):
        assert Pattern("*{state}*{angles}*{code}!").match(line) is None
        assert Pattern("*{angles}*{state}{code}{fault}!").match(line) is None
        assert Pattern("*a*a*b").match(line) is None
    assert time.process_time() - begin_s < 5  # with numbers that may be split at any digit: minutes
    assert LONGEST_LINE <= 200


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        (description("grbl", steps=3.0), "no such setting"),
        (description("nothing"), "no make 'nothing'"),
        (description("grbl", count_per_deg=0), "expected a number that is not 0"),
    ],
)
def test_a_description_that_does_not_fit_its_make(table, expected):
    with pytest.raises(FormatError, match=re.escape(expected)):
        open_table(table, link=Bench(description("line")).link, clock=SimulatedClock())


def test_the_latency_of_a_tables_angles_is_a_setting_of_every_make():
    """For ``rates`` (docs/rate-steps.md): no make sends anything else for it."""
    for late in (0, 0.02):
        require_fit(description("line", latency_s=late), make_of(description("line")))
    with pytest.raises(FormatError, match='latency_s is "late", expected a number'):
        require_fit(description("line", latency_s="late"), make_of(description("line")))


def test_braking_that_a_stop_would_wait_hours_for_is_refused(tmp_path):
    text = re.sub(r"(?m)^acceleration_dps2 = .*$", "acceleration_dps2 = 0.01", template("line"))
    with pytest.raises(FormatError, match=r"axis\[0\]: fastest_dps / acceleration_dps2 is \S+ s, .* expected 60 or less"):
        read_description(_written(tmp_path / "table.toml", text))


def test_words_of_axes_are_those_of_the_controller():
    from virtual_tables import axis

    from session.annexes.machines.description import Description

    with pytest.raises(FormatError, match="expected words of their own among X, Y, Z"):
        open_table(Description("t", "grbl", (axis("outer", "Q"),)), link=Bench(description("line")).link, clock=SimulatedClock())


def test_a_port_that_is_not_there(tmp_path):
    table = replace(description("grbl"), port=str(tmp_path / "none"))
    with pytest.raises(TableFault, match=r"cannot be opened"):
        open_table(table)
    with pytest.raises(FormatError, match="has no port"):
        open_table(description("grbl"))


def test_a_hand_confirms_each_verb():
    """The same verbs; what is typed is the dial's reading, Enter alone the angle that was asked for."""
    asked, typed = [], iter(["", "44.5", "", "31", "oops"])

    def ask(text):
        asked.append(text)
        return next(typed)

    table = description("hand")
    hand = Hand(table, ask)
    guarded = Guarded(hand)  # a person's clock is the host's
    guarded.confirm([Move.home(), Move.anywhere(table, 0, 60 * DEG)], None, lambda line: None)
    guarded.home()
    assert not guarded.settle().moving
    guarded.turn_to(0, 45 * DEG, 30 * DEG)
    assert guarded.settle().angles[0] == pytest.approx(44.5 * DEG)
    guarded.turn_to(0, 30 * DEG, 30 * DEG)
    assert guarded.settle().angles[0] == pytest.approx(30 * DEG)
    hand.turn_at(0, -10 * DEG)
    hand._thread.join()
    assert hand.where().angles[0] == pytest.approx(31 * DEG)
    hand.turn_to(0, 0.0, DEG)
    hand._thread.join()
    with pytest.raises(CalibrationError, match="no angle in degrees"):
        hand.where()
    assert "turn outer to 45 deg, at most at 30 dps" in asked[1]


def test_nobody_at_the_keyboard_is_said():
    def ask(text):
        raise EOFError

    hand = Hand(description("hand"), ask)
    hand.home()
    hand._thread.join()
    with pytest.raises(TableFault, match="nobody answers"):
        hand.where()


def test_a_stage_behind_libximc(tmp_path):
    """Its own virtual controller; real time, since the library keeps it."""
    pytest.importorskip("libximc.highlevel", exc_type=ImportError, reason="libximc is not installed, or not for this system")
    from virtual_tables import axis

    from session.annexes.machines.description import Description

    of = axis("outer", f"xi-emu:///{tmp_path / 'stage.bin'}", fastest_rps=1000 * DEG, acceleration_rps2=5000 * DEG)
    table = Description("stage", "ximc", (of,), settings={"steps_per_deg": 10.0})
    guarded = Guarded(open_table(table))
    assert np.isnan(guarded.where().angles[0])  # it is not homed, and finds no marks
    guarded.stands_at_zero()
    guarded.confirm([Move.anywhere(table, 0, 1000 * DEG), Move.at(0, 300 * DEG, 8.0)], None, lambda line: None)
    with guarded:
        guarded.turn_to(0, 60 * DEG, 500 * DEG)
        assert guarded.settle().angles[0] == pytest.approx(60 * DEG, abs=0.1 * DEG)
        guarded.turn_at(0, -300 * DEG)
        assert guarded.where().moving
        guarded.stop()
        assert not guarded.where().moving


def test_libximc_that_is_missing_is_one_line(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "libximc", None)
    monkeypatch.setitem(sys.modules, "libximc.highlevel", None)
    with pytest.raises(TableFault, match=r"pip install 'libximc"):
        open_table(description("ximc", steps_per_deg=10.0))


VISA_DEVICE = """spec: "1.1"
devices:
  table:
    eom:
      ASRL INSTR: {q: "\\n", r: "\\n"}
    dialogues:
      - {q: "AXIS1:MOV?", r: "0"}
      - {q: "STAT:STOP?", r: "0"}
      - {q: "SYST:ERR?", r: "0,No error"}
      - {q: "SYST:TIME?", r: "3.5"}
      - {q: "ABOR"}
      - {q: "HOME"}
    properties:
      position:
        default: 0.0
        getter: {q: "AXIS1:POS?", r: "{:.5f}"}
        setter: {q: "AXIS1:POS {:.5f}"}
        specs: {min: -360, max: 360, type: float}
      rate:
        default: 1.0
        getter: {q: "AXIS1:VEL?", r: "{:.5f}"}
        setter: {q: "AXIS1:VEL {:.5f}"}
        specs: {min: 0, max: 360, type: float}
resources:
  ASRL1::INSTR: {device: table}
"""


def test_an_instrument_behind_visa(tmp_path):
    """PyVISA's simulated instruments: no motion, but its real interface."""
    pytest.importorskip("pyvisa_sim", reason="pyvisa-sim is not installed")
    library = f"{_written(tmp_path / 'device.yaml', VISA_DEVICE)}@sim"
    table = replace(description("scpi", visa=library, answer_s=0.2), port="ASRL1::INSTR")
    driver = open_table(table)
    try:
        driver.turn_to(0, 33 * DEG, 20 * DEG)
        found = driver.where()
        assert found.angles[0] == pytest.approx(33 * DEG)
        assert (found.moving, found.table_s) == (False, 3.5)
        driver.stop()
    finally:
        driver.close()
    with pytest.raises(TableFault, match=r"lost|does not answer"):
        open_table(replace(table, port="ASRL7::INSTR")).where()


def test_pyvisa_that_is_missing_is_one_line(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pyvisa", None)
    with pytest.raises(TableFault, match="pip install pyvisa"):
        open_table(replace(description("scpi"), port="GPIB0::5::INSTR"))


def test_a_controller_that_says_nothing_while_it_homes():
    """GRBL answers no report before the marks are found; its acknowledgement is waited for."""
    bench = Bench(description("grbl"))
    bench.confirm()
    with bench.guarded as table:
        table.home()
        table.settle()
        table.turn_to(0, 180 * DEG, 60 * DEG)
        table.settle()
        begin_s = bench.clock.now_s()
        table.home()
        assert table.settle().angles == pytest.approx(DEG, abs=0.02 * DEG)
        assert bench.clock.now_s() - begin_s > 9.0  # 180 deg at 20 dps
        assert bench.motor()[0] == pytest.approx(DEG)


def test_each_axis_of_a_homing_is_awaited():
    """Each is acknowledged: behind the first it is not asked where it is."""
    bench = Bench(description(OWN, axes=2))
    bench.driver.begin()
    bench.driver.turn_to(0, 90 * DEG, 60 * DEG)
    bench.clock.sleep(4)
    bench.driver.home()
    while bench.clock.now_s() < 7:  # 4.5 s: the first was acknowledged at once
        assert bench.driver.where().moving
    assert bench.motor()[0] > 20 * DEG
    assert bench.link.sent.endswith(b"HM 1\rHM 2\r")


@pytest.mark.parametrize(("said", "moves"), [(b"30.0,2.5\n", True), (b"30.0,-2.5\n", True), (b"30.0,0.001\n", False)])
def test_a_rate_that_is_answered_says_whether_it_moves(said, moves, tmp_path):
    make = read_make(_written(tmp_path / "own.toml", GOOD.replace("{angles}", "{angle},{rate}").replace('"t"\n', '"t"\nmost_axes = 1\n')))
    clock, table = SimulatedClock(), description("line")
    device = SimpleNamespace(is_connected=True, feed=lambda data: said if data else b"")
    where = Dialogue(table, make, VirtualLink(device, clock), clock).where()
    assert (where.angles[0], where.moving) == (pytest.approx(30 * DEG), moves)


def test_homing_is_stopped_the_hard_way():
    bench = Bench(description("grbl"))
    bench.confirm()
    table = bench.guarded
    table.home()
    table.settle()
    table.turn_to(0, 180 * DEG, 60 * DEG)
    table.settle()
    table.home()
    table.where()
    bench.clock.sleep(3)
    assert bench.motor()[1] != 0
    begin_s, sent = bench.clock.now_s(), len(bench.link.sent)
    bench.driver.stop()
    assert bench.link.sent[sent:] == b"\x18"  # all else it would not hear
    assert not bench.virtual.mechanics.releases  # amid homing the motors hold, as in GRBL 1.1h
    assert bench.clock.now_s() - begin_s < 0.5
    bench.clock.sleep(1)
    assert bench.motor()[1] == 0
    assert bench.motor()[0] > 100 * DEG
