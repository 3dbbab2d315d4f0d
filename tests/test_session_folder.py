"""Session folders: which logs they hold, dial readings by number of the still; each file is read and looked through once."""

import gzip
from dataclasses import replace

import numpy as np
import pytest
from conftest import SESSION_TOML, Table, write_session

from session.base.errors import FormatError
from session.detect.first_look import check_session
from session.detect.stills import SessionStills
from tinygc import read_session
from tinygc.closure.build import build_problem


@pytest.fixture(scope="module")
def samples():
    return Table().rest(1).turn(90, (1, 0, 0), 1).rest(1).samples()


def test_a_folder_gives_its_logs_and_closure_runs_in_name_order(tmp_path, samples):
    for name in ("log0002.csv", "log0001.csv", "closure0001.csv", "notes.csv"):
        write_session(tmp_path, samples, name)
    (tmp_path / "log0003.csv.gz").write_bytes(gzip.compress((tmp_path / "log0001.csv").read_bytes()))
    session = read_session(tmp_path)
    assert [log.path.name for log in session.logs] == ["log0001.csv", "log0002.csv", "log0003.csv.gz"]
    assert [log.path.name for log in session.closures] == ["closure0001.csv"]
    assert session.attitudes is None
    for log in session.logs:
        np.testing.assert_array_equal(log.samples.t_ns, samples.t_ns)
        np.testing.assert_allclose(log.samples.gyro, samples.gyro, atol=1e-12)
        np.testing.assert_allclose(log.samples.accel, samples.accel, atol=1e-12)


def test_missing_folders_logs_and_settings_are_told_apart(tmp_path, samples):
    with pytest.raises(FormatError, match="no such folder"):
        read_session(tmp_path / "nowhere")
    with pytest.raises(FormatError, match=r"session\.toml"):
        read_session(tmp_path)
    (tmp_path / "session.toml").write_text(SESSION_TOML)
    with pytest.raises(FormatError, match="no log"):
        read_session(tmp_path)
    with pytest.raises(FormatError, match="a file; give the session folder"):
        read_session(tmp_path / "session.toml")
    (tmp_path / "log.csv").mkdir()
    with pytest.raises(FormatError, match="cannot be read"):
        read_session(tmp_path)


def test_dial_readings_belong_to_the_stills_by_number(tmp_path, samples):
    write_session(tmp_path, samples, toml=SESSION_TOML + '[protocol]\nreference = "table"\n')
    with pytest.raises(FormatError, match=r"attitudes\.csv: not found"):
        read_session(tmp_path)
    (tmp_path / "attitudes.csv").write_text("still,roll_deg,pitch_deg,yaw_deg\n0,0,0,0\n2,90,-45,180\n")
    attitudes = read_session(tmp_path).attitudes
    np.testing.assert_allclose(np.rad2deg(attitudes), [[0, 0, 0], [np.nan] * 3, [90, -45, 180]])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("still,roll_deg,pitch_deg,yaw_deg\n0,0,0\n", "line 2"),
        ("still,roll_deg,pitch_deg,yaw_deg\n0,0,0,0\n0,1,1,1\n", "line 3"),
        ("still,roll_deg,pitch_deg,yaw_deg\n0,0,0,0\n99999999999999,0,0,0\n", "line 3: still '99999999999999' is beyond 100000"),
    ],
)
def test_malformed_dial_readings_say_where(tmp_path, samples, text, said):
    write_session(tmp_path, samples)
    (tmp_path / "attitudes.csv").write_text(text)
    with pytest.raises(FormatError, match=said):
        read_session(tmp_path)


def test_what_would_count_twice_or_is_no_text_is_refused(tmp_path, samples):
    write_session(tmp_path, samples)
    (tmp_path / "attitudes.csv").write_bytes("still,roll_deg,pitch_deg,yaw_deg\n0,1°,0,0\n".encode("latin-1"))
    with pytest.raises(FormatError, match="not UTF-8"):
        read_session(tmp_path)
    (tmp_path / "log0001.csv.gz").write_bytes(gzip.compress((tmp_path / "log0001.csv").read_bytes()))
    with pytest.raises(FormatError, match=r"log0001\.csv and log0001\.csv\.gz"):
        read_session(tmp_path)


def test_stills_are_found_once_and_shared_stills_change_nothing(simulated):
    session = read_session(simulated())
    found = SessionStills(session)
    log, run = session.logs[0], session.closures[0]
    assert found.of(log) is found.of(log)
    assert check_session(session, found) == check_session(session)
    shared, alone = build_problem(session, found=found), build_problem(session)
    assert shared.logs[0].stills[0] is found.of(log).stills[0]
    assert (shared.batch.rate == alone.batch.rate).all()
    assert (shared.floor.sigma == alone.floor.sigma).all()
    mended = replace(log, samples=log.samples.between(0, len(log.samples) // 2))
    again = SessionStills(replace(session, logs=(mended,)), found)
    assert len(again.of(mended).samples) == len(mended.samples)
    assert again.of(run) is found.of(run)  # only a mended log is looked at again
