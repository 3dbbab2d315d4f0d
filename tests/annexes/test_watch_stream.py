"""The watch of a stream: rests, alarms in words, gaps, restarts, garbage, commands, files that cannot be written."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import socket
import sys

import numpy as np
import processes
import pytest
from formats_page import strangers
from watched import G, csv, joined, known, model_file, of_kind, samples, turning, watched

import calibrate
import tinygc
from session.io.errors import CalibrationError, DataError, StorageError
from session.io.results import json_line
from tinygc.annexes.watch import library, source
from tinygc.annexes.watch.alarm_command import AlarmCommand, words_of
from tinygc.annexes.watch.lines import JsonLines
from tinygc.annexes.watch.source import Readings, Remark, Restart, SourceOptions, _decoded
from tinygc.annexes.watch.watch import Watch
from tinygc.cli.arguments import duration
from tinygc.deploy.calibration import Surroundings
from tinygc.models.model import KnownSensor

posix_only = pytest.mark.skipif(os.name != "posix", reason="signals and select of POSIX")
STEP = joined(samples(40, 1), samples(30, 2, zero_dps=(0.0, 0.05, 0.0)))


def test_a_rest_holds():
    _, events = watched(samples(60, 3, zero_dps=(0.01, 0.0, -0.005)))
    assert [event.kind for event in events] == ["start", "rest", "end"]
    rest, end = events[1].table, events[-1].table
    assert rest["zero_dps"] == pytest.approx([0.01, 0.0, -0.005], abs=0.003)
    assert end["held"] is True
    assert end["windows"] == rest["windows"] == int((60 * 16 / events[0].table["window_s"] - 2) / 16)


@pytest.mark.parametrize(("dps", "held"), [(0.01, True), (0.4, None)])
def test_the_last_line_has_the_zero_its_cost_and_what_a_switch_on_may_move(dps, held):
    """A zero that a switch-on allows is no alarm, and yet a minute may not bear it: as ``verify`` says it, it is undecided."""
    _, events = watched(samples(60, 3, zero_dps=(dps, 0.0, 0.0)))
    end = events[-1]
    assert not of_kind(events, "alarm")
    assert end.table["held"] is held
    assert end.table["zero_dps"] == pytest.approx([dps, 0.0, 0.0], abs=5 * max(end.table["zero_sigma_dps"]))
    assert end.table["zero_cost_deg"] == pytest.approx(60 * np.linalg.norm(end.table["zero_dps"]), rel=1e-9)
    assert end.words.startswith("HELD" if held else f"UNDECIDED: no alarm, but a zero of +{end.table['zero_dps'][0]:.4f}")
    allowed = np.sqrt(2) * 0.1  # of then and of today, 0.1 dps each
    assert f"a switch-on may move each axis by 0.14 dps ({60 * allowed:.1f}°, one sigma)" in end.words


@pytest.mark.parametrize("dps", [4.0, 6.0, 7.0])
def test_the_cost_of_a_zero_is_not_wrapped_round_the_circle(dps):
    (alarm,) = of_kind(watched(samples(20, 3, zero_dps=(dps, 0.0, 0.0)))[1], "alarm")
    assert alarm.table["cost_deg"] == pytest.approx(60 * dps, rel=0.05)
    assert alarm.table["zero_cost_deg"] == pytest.approx(60 * dps, rel=0.01)


def test_a_step_is_described():
    """Channel, sign, moment, size with its sigma, and what it costs in a minute."""
    _, events = watched(STEP)
    (alarm,) = of_kind(events, "alarm")
    table = alarm.table
    assert (table["channel"], table["sign"]) == ("zero y", 1)
    assert table["size_dps"] == pytest.approx(0.05, abs=5 * table["sigma_dps"])
    assert table["sigma_dps"] < 0.01
    assert table["began_s"] == pytest.approx(40, abs=2.5)
    assert 40 < alarm.t_s < 48
    assert table["cost_deg"] == pytest.approx(60 * table["size_dps"], rel=1e-6)
    assert events[-1].table["held"] is False


def test_a_drift_is_told_from_a_step():
    drift = joined(*(samples(10, k, zero_dps=(0.0004 * max(0, 10 * k - 100 + 5), 0, 0)) for k in range(40)))
    alarm = of_kind(watched(drift)[1], "alarm")[0]
    assert alarm.table["channel"] == "zero x"
    assert alarm.table["kind"] in ("ramp", "step or ramp")
    step = of_kind(watched(joined(samples(400, 5), samples(30, 6, zero_dps=(0.02, 0, 0))))[1], "alarm")[0]
    assert step.table["kind"] in ("step", "step or ramp")
    assert step.table["began_s"] == pytest.approx(400, abs=8)


def test_a_step_of_three_axes_is_one_alarm():
    """One line, one run of a command; the table is of the largest, the cost of all."""
    step = joined(samples(40, 1), samples(30, 2, zero_dps=(0.1, -0.2, 0.15)))
    (alarm,) = of_kind(watched(step)[1], "alarm")
    assert (alarm.table["channel"], alarm.table["sign"]) == ("zero y", -1)
    assert alarm.table["channels"] == ["zero x", "zero y", "zero z"]
    assert alarm.table["size_dps"] == pytest.approx(-0.2, abs=0.01)
    assert alarm.table["cost_deg"] == pytest.approx(60 * np.linalg.norm([0.1, 0.2, 0.15]), rel=0.05)
    assert "zero y: a step of -0.2" in alarm.words
    assert "zero x: a step of +0.1" in alarm.words
    assert "a rest does not test E" in alarm.words


@pytest.mark.parametrize("factor", [9.80665, 2.0, 0.5])
def test_an_accelerometer_whose_unit_is_wrong_is_said(factor):
    readings = samples(20, 1)
    _, events = watched(dataclasses.replace(readings, accel=readings.accel * factor))
    assert events[-1].table["held"] is None
    assert f"the accelerometer reads {factor * 9.80665:.3g} m/s^2 on average, expected about 9.81: check its unit" in events[-1].words


def test_gravity_is_described():
    heavier = joined(samples(40, 7), samples(30, 8, force=(0, 0, -G * 1.002)))
    (alarm,) = of_kind(watched(heavier)[1], "alarm")
    assert (alarm.table["channel"], alarm.table["sign"]) == ("gravity", 1)
    assert alarm.table["size_mg"] == pytest.approx(2.0, abs=0.3)
    assert alarm.table["cost_deg"] == pytest.approx(np.degrees(0.002), rel=0.2)


def test_pieces_do_not_matter():
    """But for when it is said, and what of."""
    short = joined(samples(12, 1), samples(8, 2, zero_dps=(0.0, 0.05, 0.0)))
    expected = [(event.kind, round(event.t_s, 3)) for event in watched(short)[1]]
    assert len(expected) == 4
    for piece in (7, 50, 10_000):
        assert [(event.kind, round(event.t_s, 3)) for event in watched(short, piece=piece)[1]] == expected


def test_a_gap_is_said_and_ends_the_rest():
    later = samples(20, 2)
    readings = joined(samples(20, 1), later)
    readings.t_ns[len(readings.t_ns) // 2 :] += 5 * 10**9
    _, events = watched(readings)
    assert [event.kind for event in events] == ["start", "remark", "rest", "rest", "end"]
    assert events[1].words.startswith("a gap of 5.01 s")


def test_a_clock_that_goes_back_is_said_and_nothing_is_lost():
    readings = joined(samples(20, 1), samples(20, 2))
    readings.t_ns[len(readings.t_ns) // 2 :] -= 15 * 10**9
    _, events = watched(readings)
    assert events[-1].table["windows"] >= 18
    assert events[-1].t_s == pytest.approx(40, abs=0.2)
    assert any("the clock" in event.words for event in of_kind(events, "remark"))


def test_readings_that_are_none_are_left_out():
    readings = samples(30, 1)
    readings.gyro[[5, 700, 701]], readings.accel[1500, 2] = np.nan, np.inf
    _, events = watched(readings)
    assert events[-1].table["held"] is True
    assert events[-1].table["counts"]["not a number"] == 4


def test_a_restart_is_another_switch_on():
    live = Watch(known(spread_dps=0.3))
    events = [*live.take(samples(30, 1))]
    events += live.take(Restart("the device's clock began again"))
    events += live.take(samples(30, 2, zero_dps=(0.4, 0, 0)))  # 0.3 sqrt(2) dps is one sigma
    events += live.end()
    assert not of_kind(events, "alarm")
    assert events[-1].t_s == pytest.approx(60, abs=0.2)
    assert len(of_kind(events, "rest")) == 2


def test_a_stream_that_never_rests_is_undecided_and_says_so():
    readings = samples(900, 1)
    rate = readings.gyro + 0.3 * np.sin(np.arange(len(readings.gyro)))[:, None]
    _, events = watched(dataclasses.replace(readings, gyro=rate), piece=5000)
    assert events[-1].table["held"] is None
    assert [event.table["what"] for event in of_kind(events, "remark")] == ["no rest"]


def test_memory_does_not_grow():
    live, part = Watch(known()), samples(60, 1)
    for k in range(6):
        list(live.take(Readings(part.t_ns + k * 60 * 10**9, part.gyro, part.accel, None)))
    assert len(live._records) == live.windows
    assert live._records.maxlen is not None
    assert sum(len(each) for each in live._left) < 3 * 12
    assert len(live._waiting) == 0
    assert len(live._here) <= 2


# The command


def run(*words) -> int:
    return calibrate.main(["watch", *map(str, words)])


@pytest.fixture
def model(tmp_path):
    return model_file(tmp_path / "model.json")


def test_a_log_with_a_step_exits_with_1_and_says_why(tmp_path, model, capsys):
    (tmp_path / "log.csv").write_text(csv(STEP))
    assert run(model, tmp_path / "log.csv", "--json", tmp_path / "out.jsonl") == 1
    said = capsys.readouterr().out
    assert "ALARM zero y" in said
    assert "  rest" not in said
    tables = [json.loads(line) for line in (tmp_path / "out.jsonl").read_text().splitlines()]
    assert {table["schema"] for table in tables} == {"tinygc-watch/1"}
    assert [table["event"] for table in tables if table["event"] != "remark"] == ["start", "alarm", "rest", "end"]


def test_a_log_that_holds_exits_with_0_and_one_without_rest_with_5(tmp_path, model, capsys):
    (tmp_path / "log.csv").write_text(csv(samples(20, 1)))
    assert run(model, tmp_path / "log.csv", "--verbose", "--false-alarm-every", "100000d") == 0
    assert "rest of" in capsys.readouterr().out
    readings = samples(10, 1)
    (tmp_path / "log.csv").write_text(csv(dataclasses.replace(readings, gyro=readings.gyro + np.sin(np.arange(1000))[:, None])))
    assert run(model, tmp_path / "log.csv") == 5
    assert "UNDECIDED" in capsys.readouterr().out


def test_until_alarm_ends_there(tmp_path, model):
    (tmp_path / "log.csv").write_text(csv(joined(STEP, samples(600, 9))))
    assert run(model, tmp_path / "log.csv", "--quiet", "--until-alarm", "--json", tmp_path / "out.jsonl") == 1
    last = json.loads((tmp_path / "out.jsonl").read_text().splitlines()[-1])
    assert (last["event"], last["alarms"]) == ("end", 1)


def test_damage_and_restarts_of_a_stream_are_items():
    """Lines that a board sends, with what went wrong between."""
    lines = csv(samples(4, 1)).splitlines(keepends=True)
    lines[200:200] = ["what is this\n"] * 3
    again = csv(samples(2, 2)).splitlines(keepends=True)[1:]  # its clock begins again
    sensor = Surroundings(KnownSensor(), None, "none", "")
    found = list(_decoded(iter(["".join(lines).encode(), b"", "".join(again).encode()]), SourceOptions(), sensor, "a test"))
    assert sum(len(item.t_ns) for item in found if isinstance(item, Readings)) >= 598
    assert "garbage" in {item.kind for item in found if isinstance(item, Remark)} <= {"garbage", "lost"}
    assert sum(isinstance(item, Restart) for item in found) == 1
    assert sum(item is None for item in found) == 1
    with pytest.raises(DataError, match="no sample in what came"):
        list(_decoded(iter([b"hello\n" * 100]), SourceOptions(), sensor, "a test"))


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


class Datagrams:
    """Items of a watched UDP port, and senders of loopback's addresses, each with a port of its own."""

    def __init__(self, monkeypatch):
        monkeypatch.setattr(source, "SILENT_S", 0.3)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = probe.getsockname()[1]
        sensor = Surroundings(KnownSensor(), None, "none", "")
        self.name = f"udp:127.0.0.1:{self._port}"
        self.items = source.items_of(self.name, SourceOptions(), sensor)
        assert next(self.items) is None  # it listens

    def send(self, address: str, seed: int, start_s: float = 0.0) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.bind((address, 0))
            sender.sendto(csv(samples(1, seed, start_s=start_s)).encode(), ("127.0.0.1", self._port))

    def until_idle(self) -> list:
        return list(itertools.takewhile(lambda item: item is not None, self.items))


@pytest.mark.skipif(sys.platform != "linux", reason="other addresses of loopback")
def test_a_sender_of_datagrams_is_an_address_and_behind_its_silence_another_one(monkeypatch):
    """A board that starts anew sends from another port; what others send meanwhile is counted."""
    udp = Datagrams(monkeypatch)
    udp.send("127.0.0.1", 1)
    udp.send("127.0.0.2", 2)
    udp.send("127.0.0.1", 3, start_s=1.0)  # from another port
    udp.send("127.0.0.1", 4)  # and with a clock that begins again
    first = udp.until_idle()
    said = [item.words for item in first if isinstance(item, Remark) and item.kind == "stranger"]
    assert said == [f"{udp.name}: datagrams came from another sender than 127.0.0.1: left out"]
    assert sum(isinstance(item, Restart) for item in first) == 1
    assert sum(len(item.t_ns) for item in first if isinstance(item, Readings)) >= 295

    def is_followed() -> bool:
        udp.send("127.0.0.2", 5)
        return any(isinstance(item, Restart) and "127.0.0.2 is followed" in item.why for item in udp.until_idle())

    processes.until(is_followed)
    udp.send("127.0.0.2", 6, start_s=1.0)
    assert [type(item) for item in udp.until_idle()] == [Readings]
    udp.send("127.0.0.1", 7)
    assert [item.kind for item in udp.until_idle()] == ["stranger"]


def test_where_no_sample_comes_that_is_said_whatever_else_comes(model, monkeypatch):
    monkeypatch.setattr(library, "SILENT_S", 0.0)
    monkeypatch.setattr(library, "items_of", lambda *given: iter([None, Remark("stranger", "left out"), None]))
    said = [event.table["what"] for event in library.events_of(model, "udp:127.0.0.1:9", SourceOptions()) if event.kind == "remark"]
    assert sorted(said) == ["silent", "stranger"]


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
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, model, capsys, words, code):
    (tmp_path / "log.csv").write_text(csv(samples(5, 1)))
    filled = [word.format(tmp=tmp_path, log=tmp_path / "log.csv") for word in words]
    assert run(model, *filled) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("calibrate: ")


def test_a_model_without_an_accelerometer_is_refused(tmp_path, model, capsys):
    table = json.loads(model.read_text())
    del table["accelerometer"]
    model.write_text(json.dumps(table))
    (tmp_path / "log.csv").write_text(csv(samples(5, 1)))
    assert run(model, tmp_path / "log.csv") == 2
    assert "no calibration of the accelerometer" in capsys.readouterr().err


def test_python_gives_the_same(tmp_path, model):
    (tmp_path / "log.csv").write_text(csv(STEP))
    found = tinygc.watch(model, tmp_path / "log.csv")
    assert found.held is False
    assert [event.table["channel"] for event in found.alarms] == ["zero y"]
    assert found.to_json()[0]["event"] == "start"
    with pytest.raises(CalibrationError, match="source is 3, expected a path"):
        tinygc.watch(model, 3)


@pytest.mark.parametrize(("text", "seconds"), [("30d", 2592000), ("12 h", 43200), ("90min", 5400), ("3600", 3600), ("1e3s", 1000)])
def test_times(text, seconds):
    assert duration(text) == seconds


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


@posix_only
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["/no/such/program"], "cannot be run"),
        ([sys.executable, "-c", "raise SystemExit(7)"], "ended with code 7"),
        ([sys.executable, "-c", "import time; time.sleep(1000)"], "did not end within 0.3 s"),
    ],
)
def test_a_command_that_fails_or_hangs_is_said(words, expected):
    said: list[str] = []
    at_alarm = AlarmCommand(words, said.append, most_s=0.3 if "sleep" in words[-1] else 30.0)
    at_alarm("{}")
    at_alarm.wait()
    (line,) = said
    assert expected in line
    assert "the watch goes on" in line


@pytest.mark.parametrize("text", ["", "  ", "'", '"a', "a\0b"])
def test_a_command_that_is_none_is_refused(text):
    with pytest.raises(CalibrationError, match="--command"):
        words_of(text)


class Full:
    """A file on a disk that is full after so many bytes."""

    def __init__(self, file, room: int):
        self.file, self.room = file, room

    def write(self, data: bytes) -> int:
        fits = data[: self.room]
        self.room -= len(fits)
        return self.file.write(fits) if fits else 0

    def __getattr__(self, name):
        return getattr(self.file, name)


def test_a_full_disk_loses_nothing(tmp_path):
    said: list[str] = []
    lines = JsonLines(tmp_path / "out.jsonl", said.append)
    lines._file = Full(lines._file, 30)  # type: ignore[assignment]
    for k in range(5):
        lines.write({"k": k})
    lines.end()
    assert [json.loads(line)["k"] for line in (tmp_path / "out.jsonl").read_text().splitlines()] == list(range(5))
    assert len(said) == 2
    assert "its lines are kept" in said[0]
    assert "0 lines were lost" in said[1]


@posix_only
def test_a_file_that_cannot_be_written_is_an_error(tmp_path):
    with pytest.raises(StorageError, match="give --json another path"):
        JsonLines(tmp_path / "none" / "out.jsonl", print)


def test_every_event_is_of_its_format():
    """Of every kind: no key that the page lacks, and what the schema asks for."""
    gravity = joined(samples(20, 1), samples(20, 2, force=(0, 0, -G * 1.002)))
    events = [event for readings in (STEP, gravity, turning(8, 1, scale=(1.02, 0.98, 1.01))) for event in watched(readings)[1]]
    live = Watch(known())
    events += live.take(Remark("crc", "frames failed their check"))
    tables = [json.loads(json_line(event.to_json())) for event in events]
    assert {table["event"] for table in tables} == {"start", "rest", "turn", "alarm", "remark", "end"}
    assert {table["channel"] for table in tables if table["event"] == "alarm"} == {"zero y", "gravity", "closure"}
    for table in tables:
        assert not strangers(table)
