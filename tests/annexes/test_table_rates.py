"""Rate steps of a machine: both senses, even rates for as long as asked, within the limits of the axis."""

from __future__ import annotations

from threading import Event

import numpy as np
import pytest
from commandline import refused
from processes import PATIENCE_S
from table_recordings import Bench, table_toml

from session.annexes.machines.angles import read_angles
from session.annexes.machines.chamber import ChamberDialogue, VirtualChamber
from session.annexes.machines.clocks import SimulatedClock
from session.annexes.machines.rates import steps_of
from session.annexes.machines.verbs import TableFault
from session.annexes.machines.wire import VirtualLink
from session.bench.messages import Stage
from session.io.registers import gyro_rps_per_lsb
from session.io.units import DEG
from tinygc import CalibrationError


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """However busy the machine is: nothing is silent."""
    monkeypatch.setattr("session.bench.guided_session.SILENT_S", PATIENCE_S)


def rates_of(bench, log="rates0001.csv") -> np.ndarray:
    """(N,) dps of the gyroscope's x, its true calibration applied."""
    rows = np.genfromtxt(bench.folder / log, delimiter=",", comments="#", skip_header=2)
    gyro = rows[:, 1:4] * gyro_rps_per_lsb(500) @ bench.bench.unit.E.T + bench.bench.unit.B
    return gyro[:, 0] / DEG


def test_steps_in_both_senses(tmp_path):
    bench = Bench(tmp_path, table_toml("middle", "inner"))
    guide, said = bench.record(rates=(20, 60), dwell_s=4.0)
    assert guide.stage is Stage.DONE
    assert [text for text in said.texts if text.startswith("step")] == [
        "step 1 of 4: +20 dps for 4 s",
        "step 2 of 4: -20 dps for 4 s",
        "step 3 of 4: +60 dps for 4 s",
        "step 4 of 4: -60 dps for 4 s",
    ]
    rate, odr_hz = rates_of(bench), bench.bench.unit.odr_hz
    for dps in (20, -20, 60, -60):
        even = np.abs(rate - dps) < 0.5
        assert 4.0 <= even.sum() / odr_hz < 6.5
    assert np.abs(rate[-round(odr_hz / 4) :]).max() < 0.5
    angles = read_angles(bench.folder / "table.csv", bench.description)["rates0001.csv"]
    said_dps = np.diff(angles.angles[:, 1]) / np.diff(angles.t_ns * 1e-9) / DEG
    assert np.quantile(said_dps, 0.99) == pytest.approx(60, rel=0.05)
    assert (np.abs(angles.angles[:, 0]) < 1e-9).all()


def test_an_axis_with_limits_begins_at_one_of_them(tmp_path):
    bench = Bench(tmp_path, table_toml("inner", limits={"inner": (-170, 170)}))
    guide, _ = bench.record(rates=(40,), dwell_s=4.0)
    assert guide.made == 2
    angles = read_angles(bench.folder / "table.csv", bench.description)["rates0001.csv"].angles / DEG
    assert angles.min() == pytest.approx(-170, abs=1e-3)
    assert angles.max() == pytest.approx(170, abs=1e-3)
    with pytest.raises(CalibrationError, match=r"inner at 80 dps for 4 s turns by 43\d deg, its limits leave 340: a shorter --dwell"):
        steps_of(bench.description, 0, [80 * DEG], 4.0)
    with pytest.raises(CalibrationError, match=r"inner at 100 dps: expected above 0 and at most 90, its fastest"):
        steps_of(bench.description, 0, [100 * DEG], 1.0)


def test_a_step_that_was_stopped_is_made_again(tmp_path):
    bench, rounds = Bench(tmp_path, table_toml("inner")), []

    def each(guide, mover):
        if guide.made == 1 and mover._phase == "turn" and not rounds:
            bench.press("s")
        if guide.stage is Stage.PAUSED:
            rounds.append(bench.bench.virtual.mechanics.is_moving())
            if len(rounds) == 50:
                bench.press("p")

    guide, said = bench.record(rates=(30,), dwell_s=2.0, each=each)
    assert not any(rounds[10:])
    assert guide.made == 2
    assert "the table is stopped; p goes on with the next move" in said.texts
    assert (bench.folder / "rates0002.csv").exists()


CHAMBER = """schema = "tinygc-chamber/1"
set = "SOUR:TEMP {temperature}"
read = "MEAS:TEMP?"
answer = "{temperature}"
least_c = -40
most_c = 85
stable_s = 120
rest_c = 25
"""


class Chambers:
    """Opens a virtual chamber that answers only while ``answers`` is set.  asked: what it was set to; silent: it is switched off."""

    def __init__(self, folder):
        self.file, self.clock, self.answers, self.asked, self.silent = folder / "chamber.toml", SimulatedClock(), Event(), [], False
        self.file.write_text(CHAMBER)
        self.answers.set()

    def heated(self, *temperatures_c):
        """For ``Bench.record``."""
        return self.file, temperatures_c, self._open, self.clock

    def _open(self, description, clock):
        chambers = self

        class Opened(ChamberDialogue):
            def set(self, temperature_c):
                super().set(temperature_c)
                chambers.asked.append(temperature_c)

            def read(self):
                assert chambers.answers.wait(PATIENCE_S)
                if chambers.silent:
                    raise TableFault("chamber: heard nothing")
                return super().read()

        return Opened(description, VirtualLink(VirtualChamber(clock, 25.0, 60.0), clock), clock)


def test_in_a_chamber_all_steps_are_made_at_each_temperature(tmp_path):
    """The table rests while the chamber is not stable, no sample of that time is in a log, and each temperature has a log."""
    bench, chambers, waited = Bench(tmp_path, table_toml("inner")), Chambers(tmp_path), []

    def each(guide, mover):
        if guide.soak:
            waited.append((guide.made, bench.bench.virtual.mechanics.is_moving(), guide.stage))
            chambers.answers.set() if len(waited) % 50 == 49 else chambers.answers.clear()
        else:
            chambers.answers.clear()

    guide, said = bench.record(rates=(60,), dwell_s=2.0, heated=chambers.heated(10.0, 40.0), each=each)
    assert guide.made == 4
    assert chambers.asked == [10.0, 40.0, 25.0]
    assert {made for made, *_ in waited} == {0, 2}
    assert not any(moving for _, moving, _ in waited)
    assert "the chamber goes to 40 degC, and has to be stable there" in said.texts
    assert sorted(path.name for path in bench.folder.glob("rates*.csv")) == ["rates0001.csv", "rates0002.csv"]
    for log in ("rates0001.csv", "rates0002.csv"):
        rate, odr_hz = rates_of(bench, log), bench.bench.unit.odr_hz
        for dps in (60, -60):
            assert 2.0 <= (np.abs(rate - dps) < 0.5).sum() / odr_hz < 4.5
        assert len(rate) / odr_hz < 25


@pytest.mark.broad
def test_a_chamber_that_falls_silent_pauses_the_recording(tmp_path):
    bench, chambers, rounds = Bench(tmp_path, table_toml("inner")), Chambers(tmp_path), []

    def each(guide, mover):
        chambers.silent = guide.made == 2 and len(rounds) < 50
        if guide.made == 2 and guide.stage is Stage.PAUSED and not guide.soak:
            rounds.append(bench.bench.virtual.mechanics.is_moving())
            if len(rounds) == 50:
                chambers.silent = False
                bench.press("p")

    guide, said = bench.record(rates=(60,), dwell_s=2.0, heated=chambers.heated(10.0, 40.0), each=each)
    assert guide.made == 4
    assert not any(rounds)
    assert said.texts.count("chamber: heard nothing; put it right, then p goes on") == 1
    assert chambers.asked == [10.0, 40.0, 40.0, 25.0]


def test_temperatures_beyond_the_chamber_are_refused_before_anything_is_set(tmp_path):
    bench, chambers = Bench(tmp_path, table_toml("inner")), Chambers(tmp_path)
    with pytest.raises(CalibrationError, match="chamber: 90 degC, expected -40 to 85; nothing was sent"):
        bench.record(rates=(60,), heated=chambers.heated(10.0, 90.0))
    assert chambers.asked == []


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--chamber", "chamber.toml", "--temperatures", "10"], "are of a table; add --table FILE"),
        (["--table", "table.toml", "--rates", "50", "--temperatures", "10"], "belong together, and to --rates: give all three"),
        (["--table", "table.toml", "--rates", "50", "--chamber", "chamber.toml"], "belong together, and to --rates: give all three"),
        (["--table", "table.toml", "--chamber", "chamber.toml", "--temperatures=-10,25"], "belong together, and to --rates"),
        (["--temperatures", "warm"], "'warm': expected temperatures in degC, such as 10,25,40"),
        (["--temperatures", "10,-300"], "expected temperatures in degC"),
    ],
)
def test_a_chamber_belongs_to_rate_steps(words, expected, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "table.toml").write_text(table_toml("inner"))
    (tmp_path / "chamber.toml").write_text(CHAMBER)
    refused(run("record", "--port", "none", "--out", tmp_path / "s", *words), expected)
