"""Rate steps of a machine: both senses, even rates for as long as asked, within the limits of the axis."""

from __future__ import annotations

import numpy as np
import pytest
from processes import PATIENCE_S
from table_recordings import Bench, table_toml

from session.annexes.machines.angles import read_angles
from session.annexes.machines.rates import steps_of
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
    assert np.ptp(angles.angles[:, 0]) < 1e-9  # it rests where its homing ended


def test_an_axis_with_limits_begins_at_one_of_them(tmp_path):
    bench = Bench(tmp_path, table_toml("inner", make="line", limits={"inner": (-170, 170)}))
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
