"""``record --series``: one board after the other at one port, each in a folder of its own serial number."""

import json
import os
import re
import signal

import pytest
from formats_page import strangers
from processes import CALIBRATE, DEVNULL, PIPE, calibrate, heard, started, until

from session.bench.session_file import BoardListener, BoardSeries, SeriesEntry, folder_name
from session.io.errors import FormatError
from tinygc import SimulationOptions, read_session
from tinygc.simulation.write import write_session

SEGMENTS = 1


def board_folder(folder, serial, seed):
    """A simulated session of a board with this serial number, to be streamed."""
    write_session(SimulationOptions(segments=2, closure_s=0.0, seed=seed, odr_hz=104.0), folder)
    text = (folder / "session.toml").read_text()
    (folder / "session.toml").write_text(re.sub(r"^serial = .*", f'serial = "{serial}"', text, flags=re.M))
    return folder


def plugged(folder, port):
    """A virtual board that streams it, many times faster than real."""
    command = [*CALIBRATE, "board", folder, "--link", port, "--speed", 12, "--lead", 2, "--memory", 10**9]
    return started(command, text=True, stdout=PIPE, stderr=DEVNULL)


@pytest.mark.slow
def test_three_boards_in_a_row(tmp_path):
    """The third is the first again, which is said and not recorded; Ctrl-C ends the row, and all is kept."""
    first, second = (board_folder(tmp_path / name, name, seed) for seed, name in enumerate(("SN1", "SN2"), 1))
    port, row = tmp_path / "port", tmp_path / "row"
    words = ["record", "--series", "--out", row, "--port", port, "--segments", SEGMENTS, "--no-coach", "--json", tmp_path / "row.json"]
    with started([*CALIBRATE, *words], text=True, stderr=PIPE, stdout=DEVNULL) as process:
        heard(process.stderr, lambda line: "plug in the next board" in line)
        for folder, said in ((first, "done: 1 segments"), (second, "done: 1 segments"), (first, "board SN1 is done already")):
            with plugged(folder, port):
                heard(process.stderr, lambda line, said=said: said in line)
                heard(process.stderr, lambda line: "unplug it, plug in the next board" in line)
        process.send_signal(signal.SIGINT)
        process.communicate()
    assert process.returncode == 0
    told = json.loads((tmp_path / "row.json").read_text())
    assert told["schema"] == "tinygc-series/1"
    assert strangers(told) == strangers(json.loads((row / "series.json").read_text())) == []
    assert [(board["serial"], board["session"], board["done"], board["segments"]) for board in told["boards"]] == [
        ("SN1", "SN1", True, 1),
        ("SN2", "SN2", True, 1),
    ]
    assert json.loads((row / "series.json").read_text())["boards"] == told["boards"]
    for name in ("SN1", "SN2"):
        session = read_session(row / name)
        assert session.config.sensor.serial == name
        assert len(session.logs[0].samples) > 200


@pytest.mark.slow
def test_a_board_that_was_cut_short_goes_on(tmp_path):
    """Interrupted within its session: 130; the row begun again goes on with the same board."""
    folder, port, row = board_folder(tmp_path / "SN9", "SN9", 3), tmp_path / "port", tmp_path / "row"
    words = ["record", "--series", "--out", row, "--port", port, "--segments", 2, "--no-coach"]
    with plugged(folder, port):
        with started([*CALIBRATE, *words], text=True, stderr=PIPE, stdout=DEVNULL) as process:
            heard(process.stderr, lambda line: "turn 1 accepted" in line)
            process.send_signal(signal.SIGINT)
            process.communicate()
        assert process.returncode == 130
    before = (row / "SN9" / "raw.bin").read_bytes()
    assert [entry.done for entry in BoardSeries(row).entries] == [False]
    with plugged(folder, port), started([*CALIBRATE, *words], text=True, stderr=PIPE, stdout=DEVNULL) as process:
        heard(process.stderr, lambda line: "which goes on" in line)
        heard(process.stderr, lambda line: "done: 2 segments" in line)
        process.send_signal(signal.SIGINT)
        process.communicate()
    assert (row / "SN9" / "raw.bin").read_bytes().startswith(before)
    assert [entry.done for entry in BoardSeries(row).entries] == [True]


def test_the_row_remembers_and_finds_places(tmp_path):
    row = BoardSeries(tmp_path / "row")
    assert row.place("A1") == (tmp_path / "row" / "A1", False)
    assert row.place("")[0].name == "board1"
    (tmp_path / "row" / "board1").mkdir(parents=True)
    assert row.place("")[0].name == "board2"
    row.add(SeriesEntry("A1", "A1", False, 3, "2026-01-01T00:00:00+00:00"))
    row.add(SeriesEntry("A1", "A1", True, 8, "2026-01-01T00:10:00+00:00"))
    row.add(SeriesEntry("", "board2", True, 8, "2026-01-01T00:20:00+00:00"))
    again = BoardSeries(tmp_path / "row")
    assert again.entries == row.entries
    assert len(again.entries) == 2
    assert again.done("A1").segments == 8
    assert again.done("") is None
    (tmp_path / "row" / "series.json").write_text('{"schema": "tinygc-series/1", "boards": [{"serial": 3}]}')
    with pytest.raises(FormatError, match=r"series\.json"):
        BoardSeries(tmp_path / "row")


@pytest.mark.parametrize(
    ("serial", "name"),
    [("SN-0.1", "SN-0.1"), ("../up", "board_.._up"), ("a/b c", "a_b_c"), (".hidden", "board_.hidden"), ("-x", "board_-x")],
)
def test_a_serial_number_is_a_harmless_folder(serial, name):
    assert folder_name(serial) == name


def test_two_numbers_never_share_a_folder(tmp_path):
    (tmp_path / "row").mkdir()
    row = BoardSeries(tmp_path / "row")
    row.add(SeriesEntry("A/1", "A_1", False, 3, "2026-01-01T00:00:00+00:00"))
    assert row.place("A/1")[0].name == "A_1"
    assert row.place("A_1")[0].name == "A_1_2"
    assert row.place("a_1")[0].name == "a_1_2"
    assert row.place("series.json")[0].name == "series.json_2"


@pytest.mark.broad
def test_the_same_board_is_the_next_only_after_it_was_away(tmp_path):
    """A pseudo-terminal that says the last one's number, is away, and says it again."""
    pty = pytest.importorskip("pty")
    import threading
    import tty

    info = b"# gyro_fs_dps=500 accel_fs_g=4 odr_hz=104.0000 serial=A\nt_us,gx,gy,gz,ax,ay,az,temp\n"
    plugs: list[str] = []
    looks, absences, heard_one, stop = [], [], [], threading.Event()

    def port():
        if not plugs:
            absences.append(True)
        return plugs[0] if plugs else None

    def wanted():
        looks.append(True)
        return stop.is_set()

    def plug_in():
        master, slave = pty.openpty()
        tty.setraw(slave)
        plugs[:] = [os.ttyname(slave)]
        return master, slave

    def speak(times, looked=6):
        """The board says who it is; the listener looks several times for each."""
        for _ in range(times):
            os.write(master, info)
            before = len(looks)
            until(lambda before=before: heard_one or len(looks) >= before + looked, what="the listener's next looks")

    master, slave = plug_in()
    listening = threading.Thread(target=lambda: heard_one.append(BoardListener(port, 115200, None).next_board("A", wanted)), daemon=True)
    listening.start()
    speak(5)
    assert not heard_one  # it is the last one still
    plugs.clear()
    os.close(slave)
    os.close(master)
    until(lambda: absences, what="a look at a port that is gone")
    master, slave = plug_in()
    until(lambda: heard_one or speak(1), what="the board that came back")
    assert heard_one == ["A"]
    stop.set()
    listening.join()
    os.close(slave)
    os.close(master)


def test_what_a_row_cannot_be_is_refused(tmp_path):
    done = calibrate("record", "--series", "--resume", "--out", tmp_path / "row", "--port", tmp_path / "none", "--quiet")
    assert done.returncode == 2
    assert "--resume: a series goes on with each board that was begun" in done.stderr
