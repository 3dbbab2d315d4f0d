"""What lies at rest in the inputs of ``noise``: every reading at rest comes once, in SI, whatever the file; what is no rest is refused."""

import shutil

import numpy as np
import pytest
from conftest import DEG, SESSION_TOML, Table, write_session

import tinygc
from session.base.errors import CalibrationError
from session.base.units import G
from session.log.samples import Samples, joined
from tinygc.features.noise import inputs
from tinygc.features.noise.inputs import read_inputs


class Kept:
    """Keeps what the statistics would sum."""

    def __init__(self, rate_hz):
        self.rate_hz, self.parts = rate_hz, []

    def add(self, samples):
        self.parts.append(samples)

    @property
    def samples(self):
        return joined(self.parts)


@pytest.fixture(autouse=True)
def kept(monkeypatch):
    monkeypatch.setattr(inputs, "RestSums", Kept)


def read(*given):
    return read_inputs(given)


def rest(seconds=20.0, seed=0, **more):
    return Table().rest(seconds).samples(seed=seed, **more)


def written(path, samples, header="t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g", t_s=None):
    """A text log in the units of a telephone's program."""
    rows = np.column_stack([samples.t_ns * 1e-9 if t_s is None else t_s, samples.gyro / DEG, samples.accel / G])
    columns = rows if header.startswith("t_s") else rows[:, 1:]
    np.savetxt(path, columns, fmt="%.9f", delimiter=",", header=header, comments="")
    return path


def assert_same(found, true):
    assert len(found) == len(true)
    assert np.diff(found.t_ns) == pytest.approx(np.diff(true.t_ns), abs=2)
    assert found.gyro[:] == pytest.approx(true.gyro, abs=1e-7)
    assert found.accel[:] == pytest.approx(true.accel, abs=1e-5)


def test_a_session_gives_its_rest_logs_whole_and_the_stills_of_its_log(tmp_path):
    table = Table().tumble(4, rest_s=3.0, seed=2)
    write_session(tmp_path, table.samples())
    still = rest(seed=5)
    write_session(tmp_path, still, "rest0001.csv")
    found = read(tmp_path)
    assert found.logs == ["rest0001.csv", "log0001.csv"]
    assert (found.sensor, found.serial) == ("ASM330LHH", "42")
    assert_same(found.sums[0].samples, still)
    assert len(found.sums) == 6  # and five stills
    for sums, (start, stop) in zip(found.sums[1:], table.rests, strict=True):
        times = sums.samples.t_ns * 1e-9
        assert start - 0.2 < times[0]
        assert times[-1] < stop + 0.2
        assert len(times) > 0.7 * 208 * (stop - start)
    assert any("5 stills" in remark for remark in found.remarks)


def test_a_text_log_comes_in_pieces_and_each_reading_once(tmp_path, monkeypatch):
    monkeypatch.setattr(inputs.Reader.pieces, "__defaults__", (2000,))
    still = rest(registers=False)
    found = read(written(tmp_path / "phone.csv", still))
    (sums,) = found.sums
    assert len(sums.parts) > 1
    assert_same(sums.samples, still)
    assert sums.rate_hz == pytest.approx(208, rel=1e-3)


def test_stamps_coarser_than_the_samples_lose_none(tmp_path):
    """Whole milliseconds at 3200 Hz: three samples in four share a stamp, which a rest log of ours would leave out."""
    still = rest(4.0, registers=False, odr_hz=3200.0)
    found = read(written(tmp_path / "coarse.csv", still, t_s=np.floor(still.t_ns * 1e-6) * 1e-3))
    (sums,) = found.sums
    assert len(sums.samples) == len(still)
    assert sums.rate_hz == pytest.approx(3200, rel=1e-3)
    assert any("share a stamp" in remark for remark in found.remarks)


def test_a_gyroscope_alone_and_a_log_of_a_session_that_lies_still_are_rests(tmp_path):
    still = rest(registers=False)
    rows = np.column_stack([still.t_ns * 1e-9, still.gyro / DEG])
    np.savetxt(tmp_path / "gyro.csv", rows, fmt="%.9f", delimiter=",", header="t_s,gx_dps,gy_dps,gz_dps", comments="")
    (alone,) = read(tmp_path / "gyro.csv").sums
    assert np.isnan(alone.samples.accel).all()
    assert alone.samples.gyro == pytest.approx(still.gyro, abs=1e-7)
    tinygc.import_log(written(tmp_path / "phone.csv", still), tmp_path / "made")
    (sums,) = read(tmp_path / "made").sums
    assert_same(sums.samples, still)


def test_of_a_log_that_moves_the_stills_are_taken(tmp_path):
    table = Table().tumble(4, rest_s=4.0, seed=2)
    found = read(written(tmp_path / "moves.csv", table.samples(registers=False)))
    assert len(found.sums) == 5
    assert max(np.ptp(sums.samples.t_ns) for sums in found.sums) < 4.5e9
    assert any("turned by" in remark for remark in found.remarks)


def test_a_knock_alone_is_no_movement(tmp_path):
    still = rest(120.0, registers=False)
    still.gyro[5000:5050] += 20 * DEG
    (sums,) = read(written(tmp_path / "knock.csv", still)).sums
    assert len(sums.samples) == len(still)


@pytest.mark.parametrize("plan", [Table().steady(90, (0, 0, 1), 20.0), Table().steady(8, (1, 0, 0), 20.0)], ids=["level", "tumbling"])
def test_what_turns_throughout_is_refused_in_one_line(plan, tmp_path):
    path = written(tmp_path / "turns.csv", plan.samples(registers=False))
    with pytest.raises(CalibrationError, match=r"turns\.csv: nothing lies still") as refused:
        read(path)
    assert "\n" not in str(refused.value)


# What is refused


def refused(*given):
    with pytest.raises(CalibrationError) as error:
        read(*given)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("change", "more", "says"),
    [
        (("ASM330LHH", "MPU-9250"), {}, "the sensor is MPU-9250, and of rest0001.csv it is ASM330LHH"),
        (('"42"', '"43"'), {}, "the serial number is 43, and of rest0001.csv it is 42"),
        (("x", "x"), {"odr_hz": 104.0}, "it has 104 Hz, and rest0001.csv has 208 Hz"),
    ],
)
def test_two_units_and_two_data_rates_are_refused(change, more, says, tmp_path):
    write_session(tmp_path / "a", rest(), "rest0001.csv")
    write_session(tmp_path / "b", rest(seed=1, **more), "rest0002.csv", SESSION_TOML.replace(*change))
    assert says in refused(tmp_path / "a", tmp_path / "b")
    with pytest.raises(CalibrationError, match="the serial number is 42, and it is given as 7; give the logs of one unit"):
        read_inputs([tmp_path / "a"], serial="7")


def test_two_clocks_are_one_rate_and_logs_of_one_name_are_told_by_their_folders(tmp_path):
    for day, hz in (("monday", 208.0), ("tuesday", 210.0)):
        write_session(tmp_path / day, rest(seed=len(day), odr_hz=hz), "rest0001.csv")
    assert read(tmp_path / "monday", tmp_path / "tuesday").logs == ["monday/rest0001.csv", "tuesday/rest0001.csv"]
    shutil.copytree(tmp_path / "monday", tmp_path / "copy")
    for other in ("monday", "copy"):
        assert "are the same recording" in refused(tmp_path / "monday", tmp_path / other)


def test_units_and_files_that_cannot_be(tmp_path):
    still = rest(registers=False)
    doubled = Samples(still.t_ns, still.gyro, 2 * still.accel)
    assert "1.998 g at rest" in refused(written(tmp_path / "doubled.csv", doubled))
    phone = written(tmp_path / "phone.csv", still, "t_s,wx,wy,wz,fx,fy,fz")
    assert f"import {phone}` reads another program's log" in refused(phone)
    (tmp_path / "empty").mkdir()
    assert "it holds no log" in refused(tmp_path / "empty")
    (tmp_path / "bytes.csv").write_bytes(bytes(range(256)) * 40)
    assert "bytes.csv" in refused(tmp_path / "bytes.csv")
    assert "nothing.csv: cannot be read" in refused(tmp_path / "nothing.csv")
    write_session(tmp_path / "none", still).joinpath("log0001.csv").unlink()
    assert "neither a rest log nor a log" in refused(tmp_path / "none")
    write_session(tmp_path / "other", still)
    with pytest.raises(CalibrationError, match="the sensor is ASM330LHH, and it is given as MPU-9250"):
        read_inputs([tmp_path / "other"], "MPU-9250")
    moved = Table().tumble(4, rest_s=3.0, seed=2).samples()
    write_session(tmp_path / "alone", moved, toml=SESSION_TOML + '[protocol]\nreference = "turns"\n')
    assert "gravity shows no still" in refused(tmp_path / "alone" / "log0001.csv")
