"""A virtual board that is started again: the same sensor under another movement, so that a recording which goes on holds no copy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import calibrate
from session.detect.check_samples import check_copies
from session.io.logfile import Log
from session.io.samples import Samples
from tinygc import SimulationOptions
from tinygc.simulation.simulator import simulate_session
from tinygc.simulation.virtual_board import VirtualBoard, next_take, remember, simulated, taken

OPTIONS = SimulationOptions(segments=2, closure_s=0.0, odr_hz=104.0, seed=7)


def log(options, name):
    recording = simulate_session(options).log
    return Log(Path(name), Samples(recording.t_us * 1000, recording.gyro.astype(float), recording.accel.astype(float)), raw=True)


def test_takes_are_of_one_sensor_and_no_copies_of_each_other():
    assert taken(OPTIONS, 1) == OPTIONS  # what a seed has always streamed
    takes = [taken(OPTIONS, take) for take in (1, 2, 3)]
    first, *others = (simulate_session(options).unit for options in takes)
    for unit in others:
        assert all(np.array_equal(getattr(unit, name), getattr(first, name)) for name in ("E", "B", "accel_matrix", "accel_bias", "odr_hz"))
    logs = tuple(log(options, f"log000{number}.csv") for number, options in enumerate(takes, 1))
    assert not check_copies(logs)
    assert check_copies((logs[0], replace(logs[0], path=Path("again.csv"))))  # as a board without takes would have it
    assert {simulated(options).info for options in takes} == {simulated(OPTIONS).info}  # serial number and rate: no other board
    assert taken(OPTIONS, 2) == taken(OPTIONS, 2) != taken(OPTIONS, 3)
    assert taken(replace(OPTIONS, seed=8), 2).seed != taken(OPTIONS, 2).seed


def test_a_link_remembers_the_takes_of_each_seed(tmp_path):
    link = tmp_path / "port"
    assert next_take(link, 0) == 1
    remember(link, 0, 1)
    remember(link, 5, 3)
    remember(link, 5, 2)  # asked for again
    assert (next_take(link, 0), next_take(link, 5), next_take(link, 6)) == (2, 4, 1)
    assert next_take(tmp_path / "other", 0) == 1
    for nonsense in ("0 x\n", "0 -5\n", "1 2 3\n", "\x00", "0 " + "9" * 5000):
        (tmp_path / "port.takes").write_text(nonsense)
        assert next_take(link, 0) == 1
    (tmp_path / "port.takes").unlink()
    (tmp_path / "port.takes").mkdir()
    remember(link, 0, 1)  # cannot be written: the board streams all the same
    assert next_take(link, 0) == 1


def test_the_command_goes_on_with_the_next_take_and_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(VirtualBoard, "run", lambda self: None)
    words = ["board", "--segments", "1", "--rate", "104", "--link", str(tmp_path / "port"), "--config", str(tmp_path / "bench.toml")]

    def said(*more):
        assert calibrate.main([*words, *more]) == 0
        return capsys.readouterr().err.splitlines()[0]

    assert said() == "simulating a session, take 1 of seed 0 …"
    own = (tmp_path / "bench.toml").read_text().split("\n", 1)[1]
    assert "take 2 of seed 0 (the same sensor, turned anew; --take 1 streams the first again)" in said()
    assert (tmp_path / "bench.toml").read_text().split("\n", 1)[1] == own  # which belongs to both
    assert "take 1 of seed 0 …" in said("--take", "1")
    assert "take 3 of seed 0" in said()
    assert "take 1 of seed 4" in said("--seed", "4")


def test_a_folder_has_no_takes(tmp_path, capsys):
    assert calibrate.main(["board", str(tmp_path), "--take", "2"]) == 2
    assert "a folder is streamed as it was recorded" in capsys.readouterr().err
