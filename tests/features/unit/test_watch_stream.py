"""The watch of a stream: rests, alarms in words, gaps, restarts, garbage, commands, files that cannot be written."""

import dataclasses
import json
import os
import sys

import numpy as np
import processes
import pytest
from conftest import DEG
from failing_calls import Writer, hold_whole
from formats_page import strangers
from watched import RATE_HZ, G, csv, joined, known, model_file, of_kind, samples, turning, watched

import calibrate
import tinygc
from session.base.errors import CalibrationError
from session.base.texts import significant
from tinygc.features.unit.watch.alarms import JsonLines
from tinygc.features.unit.watch.source import Remark
from tinygc.features.unit.watch.watch import Watch

posix_only = pytest.mark.skipif(os.name != "posix", reason="signals and select of POSIX")
STEP = joined(samples(20, 1), samples(14, 2, zero_dps=(0.0, 0.05, 0.0)))


@pytest.mark.parametrize(("dps", "held"), [(0.01, True), (0.4, None)])
def test_the_last_line_has_the_zero_its_cost_and_what_a_switch_on_may_move(dps, held):
    """A zero that a switch-on allows is no alarm, and yet a minute may not bear it: as ``verify`` says it, it is undecided."""
    readings = samples(60, 3, zero_dps=(dps, 0.0, 0.0))
    readings.gyro[[5, 700]], readings.accel[1500, 2] = np.nan, np.inf
    *before, end = watched(readings)[1]
    assert [event.kind for event in before if event.kind != "remark"] == ["start", "rest"]
    assert (end.table["held"], end.table["counts"]["not a number"]) == (held, 3)
    assert end.table["zero_dps"] == pytest.approx([dps, 0.0, 0.0], abs=5 * max(end.table["zero_sigma_dps"]))
    assert end.table["zero_cost_deg"] == pytest.approx(60 * np.linalg.norm(end.table["zero_dps"]), rel=1e-9)
    cost = f"zero error {significant(end.table['zero_cost_deg'], 2)}°/min"
    assert end.words.startswith("HOLDS: no alarm in 1 rest, 0 turns, 0.02 h; " if held else "UNDECIDED: no alarm, but ")
    assert (cost in end.words, "advice" in end.table) == (True, not held)


def test_a_step_of_three_axes_is_one_alarm():
    """One line, one run of a command; the table is of the largest, the cost of all, however far round the circle."""
    step = np.array([1.0, -2.0, 1.5])
    (alarm,) = of_kind(watched(joined(samples(40, 1), samples(30, 2, zero_dps=step)))[1], "alarm")
    assert (alarm.table["channel"], alarm.table["sign"]) == ("zero y", -1)
    assert alarm.table["channels"] == ["zero x", "zero y", "zero z"]
    assert alarm.table["size_dps"] == pytest.approx(-2.0, abs=0.02)
    assert (alarm.table["began_s"], 40 < alarm.t_s < 48) == (pytest.approx(40, abs=2.5), True)
    assert alarm.table["cost_deg"] == pytest.approx(60 * np.linalg.norm(step), rel=0.05)
    for words in ("ALARM zero y: step of -2", "zero x: step of +1", "°/min"):
        assert words in alarm.words


def test_an_accelerometer_whose_unit_is_wrong_is_said():
    readings = samples(20, 1)
    end = watched(dataclasses.replace(readings, accel=readings.accel * G))[1][-1]
    assert end.table["held"] is None
    assert "force 96.2 m/s², expected 9.81: check its unit" in end.words


def test_pieces_do_not_matter():
    """But for when it is said, and what of."""
    short = joined(samples(12, 1), samples(8, 2, zero_dps=(0.0, 0.05, 0.0)))
    expected = [(event.kind, round(event.t_s, 3)) for event in watched(short)[1]]
    assert len(expected) == 4
    for piece in (97, 10_000):
        assert [(event.kind, round(event.t_s, 3)) for event in watched(short, piece=piece)[1]] == expected


@pytest.mark.parametrize(("jump_s", "says"), [(5, "a gap of 5.01 s"), (-15, "the clock")])
def test_a_gap_and_a_clock_that_goes_back_are_said_and_nothing_is_lost(jump_s, says):
    readings = joined(samples(20, 1), samples(20, 2))
    readings.t_ns[len(readings.t_ns) // 2 :] += jump_s * 10**9
    _, events = watched(readings)
    assert len(of_kind(events, "rest")) == 2
    assert events[-1].table["windows"] >= 18
    assert events[-1].t_s == pytest.approx(40 + max(jump_s, 0), abs=0.2)
    assert any(says in event.words for event in of_kind(events, "remark"))


def test_a_restart_is_another_switch_on():
    live = Watch(known(spread_dps=0.3))
    events = [*live.take(samples(30, 1))]
    events += live.take(Remark("restart", "the device's clock began again"))
    events += live.take(samples(30, 2, zero_dps=(0.4, 0, 0)))  # 0.3 sqrt(2) dps is one sigma
    events += live.end()
    assert not of_kind(events, "alarm")
    assert events[-1].t_s == pytest.approx(60, abs=0.2)
    assert len(of_kind(events, "rest")) == 2


# The command


def run(*words):
    return calibrate.main(["watch", *map(str, words)])


@pytest.fixture
def model(tmp_path):
    return model_file(tmp_path / "model.json")


def test_a_log_with_a_step_exits_with_1_and_says_why(tmp_path, model, capsys):
    (tmp_path / "log.csv").write_text(csv(STEP))
    assert run(model, tmp_path / "log.csv", "--json", tmp_path / "out.jsonl") == 1
    said, error = capsys.readouterr()
    assert error == ""  # without --command, no program runs at the alarm
    assert (said.startswith("DOES NOT HOLD: 1 alarm in "), "ALARM zero y" in said, "  rest" in said) == (True, True, False)
    tables = [json.loads(line) for line in (tmp_path / "out.jsonl").read_text().splitlines()]
    assert [table["event"] for table in tables if table["event"] != "remark"] == ["start", "alarm", "rest", "end"]
    found = tinygc.watch(model, tmp_path / "log.csv")
    assert (found.held, [event.table["channel"] for event in found.alarms]) == (False, ["zero y"])
    with pytest.raises(CalibrationError, match="source is 3, expected a path"):
        tinygc.watch(model, 3)


def test_a_live_alarm_has_its_next_step_at_once(tmp_path, model, capsys, monkeypatch):
    (tmp_path / "log.csv").write_text(csv(STEP))
    with (tmp_path / "log.csv").open() as stream:
        monkeypatch.setattr("sys.stdin", stream)
        assert run(model, "-") == 1
    lines = capsys.readouterr().out.splitlines()
    (alarm,) = (number for number, line in enumerate(lines) if "ALARM" in line)
    assert lines[alarm + 1] == lines[-1] == "next: use the new bias (verify --write)"
    assert lines[-2].startswith("DOES NOT HOLD: 1 alarm in ")


def test_a_log_that_holds_exits_with_0_and_one_without_rest_with_5(tmp_path, model, capsys):
    readings = samples(20, 1)
    (tmp_path / "log.csv").write_text(csv(readings))
    assert run(model, tmp_path / "log.csv", "--verbose", "--false-alarm-every", "100000d") == 0
    assert "rest of" in capsys.readouterr().out
    (tmp_path / "log.csv").write_text(csv(dataclasses.replace(readings, gyro=readings.gyro + np.sin(np.arange(2000))[:, None])))
    assert run(model, tmp_path / "log.csv") == 5
    assert "UNDECIDED: no rest" in capsys.readouterr().out


def test_of_a_stream_that_never_rests_it_is_said_after_ten_minutes():
    """Samples of four minutes, three times over."""
    part, live, events = samples(240, 1), Watch(known()), []
    for k in range(3):
        rate = part.gyro + 0.3 * np.sin(np.arange(len(part.gyro)))[:, None]
        events += live.take(dataclasses.replace(part, t_ns=part.t_ns + k * 240 * 10**9, gyro=rate))
    (remark,) = of_kind(events, "remark")
    assert (remark.table["what"], remark.t_s) == ("no rest", pytest.approx(600, abs=0.2))
    assert remark.words.startswith("no rest of 2.2 s for 10 min")


@posix_only
@pytest.mark.broad
def test_a_growing_log_is_followed_until_ctrl_c(tmp_path, model):
    log = tmp_path / "log.csv"
    whole = csv(STEP)
    cut = len(whole) // 2
    log.write_text(whole[:cut])
    command = [*processes.CALIBRATE, "watch", model, log, "--follow", "--json", tmp_path / "out.jsonl"]
    with processes.started(command, stdout=processes.PIPE, stderr=processes.PIPE) as process:
        processes.until(lambda: (tmp_path / "out.jsonl").exists() and (tmp_path / "out.jsonl").read_text())
        with log.open("a") as file:
            file.write(whole[cut:])
        processes.until(lambda: '"alarm"' in (tmp_path / "out.jsonl").read_text())
        process.send_signal(2)
        assert process.wait(60) == 1
    assert json.loads((tmp_path / "out.jsonl").read_text().splitlines()[-1])["event"] == "end"


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("udp:nowhere",), 2),
        (("udp:127.0.0.1:99999",), 2),
        (("/dev/no-such-port",), 3),
        (("{tmp}/no-such-log.csv",), 2),
        (("{tmp}",), 2),
        (("{log}", "--false-alarm-every", "1s"), 2),
        (("{log}", "--command", "'"), 2),
        (("{log}", "--noise", "{tmp}"), 2),
        (("-", "--follow"), 2),
        (("{log}", "--json", "{tmp}/none/out.jsonl"), 2),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, model, capsys, words, code):
    (tmp_path / "log.csv").write_text(csv(samples(5, 1)))
    filled = [word.format(tmp=tmp_path, log=tmp_path / "log.csv") for word in words]
    assert run(model, *filled) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("calibrate: ")


# What runs at an alarm, and where lines go


@posix_only
def test_a_command_gets_the_alarm_without_a_shell(tmp_path, model):
    (tmp_path / "log.csv").write_text(csv(STEP))
    program = tmp_path / "tell.py"
    program.write_text(f"import sys; open({str(tmp_path / 'told')!r}, 'w').write(sys.stdin.read() + repr(sys.argv[1:]))")
    command = f"{sys.executable} {program} 'a b' ; touch {tmp_path / 'shell'} $HOME"
    assert run(model, tmp_path / "log.csv", "--quiet", "--command", command) == 1
    line, arguments = (tmp_path / "told").read_text().splitlines()
    assert json.loads(line)["channel"] == "zero y"
    assert "'$HOME'" in arguments
    assert not (tmp_path / "shell").exists()


def test_every_event_is_of_its_format():
    """Of every kind: no key that the page lacks, and what the schema asks for."""
    gravity = joined(samples(20, 1), samples(20, 2, force=(0, 0, -G * 1.002)))
    events = [event for readings in (STEP, gravity, turning(3, 1, scale=(1.05, 0.95, 1.02))) for event in watched(readings)[1]]
    events += Watch(known()).take(Remark("crc", "frames failed their check"))
    tables = [json.loads(json.dumps(event.to_json())) for event in events]
    assert {table["event"] for table in tables} == {"start", "rest", "turn", "alarm", "remark", "end"}
    assert {table["channel"] for table in tables if table["event"] == "alarm"} == {"zero y", "gravity", "closure"}
    (heavier,) = (table for table in tables if table.get("channel") == "gravity")
    assert (heavier["size_mg"], heavier["cost_deg"]) == (pytest.approx(2.0, abs=0.3), pytest.approx(np.degrees(0.002), rel=0.2))
    assert not any(strangers(table) for table in tables)


# Turns


def test_a_hand_that_begins_and_ends_softly_closes():
    """Blocks in which it turns slower than a rest may: they are of the turn, not of the rests beside it.  A zero is taken off."""
    readings = turning(2, 4, turn_s=20.0, rest_s=4.0)
    turns = of_kind(watched(dataclasses.replace(readings, gyro=readings.gyro + 0.05 * DEG))[1], "turn")
    assert [event.table["angle_deg"] for event in turns] == pytest.approx([180] * 2, abs=2)
    assert all(event.table["chi_square"] < 14 and event.table["tilt_deg"] < 0.1 for event in turns)
    assert not of_kind(watched(turning(2, 5, angle_deg=5.0))[1], "turn")  # what hardly turns is none


def test_a_zero_that_jumps_within_a_turn_is_no_closure():
    readings = turning(4, 1)
    rate = readings.gyro.copy()
    rate[round(22.5 * RATE_HZ) :] += 1.0 * DEG  # within the third turn
    _, events = watched(dataclasses.replace(readings, gyro=rate))
    assert all(event.table["chi_square"] < 14 for event in of_kind(events, "turn"))
    assert {event.table["channel"] for event in of_kind(events, "alarm")} <= {"zero x", "zero y", "zero z"}
    assert len(of_kind(events, "alarm")) == 1


@pytest.mark.parametrize("more", ["", " --json -"])
def test_the_verdict_stands_though_nobody_reads(more, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "step.csv").write_text(csv(joined(samples(40, 1), samples(30, 2, zero_dps=(0.0, 0.05, 0.0)))))
    model_file(tmp_path / "model.json")
    assert processes.unread(monkeypatch, *f"watch model.json step.csv{more}".split()) == 1


def lines(folder):
    written = JsonLines(folder / "watch.jsonl", lambda said: None)
    for number in range(3):
        written.write({"schema": "tinygc-watch/1", "number": number})
    written.end()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")  # the killed close nothing
def test_whichever_call_fails_the_lines_are_whole(tmp_path):
    hold_whole(Writer(lines, grows=True), "watch.jsonl", tmp_path)
