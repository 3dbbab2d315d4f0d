"""One recording twice in a folder: never twice the evidence."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import Table, session_of

import calibrate
from session.detect.check_samples import check_copies
from session.detect.first_look import check_session
from session.io.samples import Samples
from tinygc import SimulationOptions
from tinygc.simulation.write import write_session


def copies(findings):
    return [finding for finding in findings if finding.what == "copy"]


@pytest.fixture(scope="module")
def session():
    return session_of(Table().tumble(8, seed=5).samples())


def test_a_copy_is_an_error_whatever_its_stamps_and_its_length(session):
    (log,) = session.logs
    samples, half = log.samples, len(log.samples) // 2
    late = replace(log, path=log.path.with_name("late.csv"), samples=replace(samples, t_ns=samples.t_ns + 7))
    cut = replace(log, path=log.path.with_name("cut.csv"), samples=samples.between(0, half))
    for other in (late, cut):
        (finding,) = copies(check_session(replace(session, logs=(log, other))))
        assert (finding.level, finding.where) == ("error", other.path.name)
        assert log.path.name in finding.says
    assert len(copies(check_session(replace(session, logs=(log, late, cut))))) == 3
    assert copies(check_session(replace(session, closures=(late,))))  # a run that judges must not be what was fitted


def test_two_recordings_of_the_same_movement_are_no_copies(session):
    (log,) = session.logs
    other = replace(log, samples=Table().tumble(8, seed=5).samples(seed=9))
    assert not copies(check_session(replace(session, logs=(log, other))))


def test_nothing_and_silence_are_no_copies(session):
    (log,) = session.logs
    still = Samples(log.samples.t_ns, np.zeros_like(log.samples.gyro), log.samples.accel)
    for samples in (log.samples.between(0, 20), still):
        assert check_copies((replace(log, samples=samples), replace(log, samples=samples))) == []


def test_fit_stops_at_a_copy(tmp_path, capsys):
    folder = write_session(SimulationOptions(segments=8, closure_s=0.0, odr_hz=104.0), tmp_path / "twice")
    shutil.copy(folder / "log0001.csv.gz", folder / "log0001 (1).csv.gz")
    assert calibrate.main(["fit", str(folder), "--methods", "raw", "--quiet"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "the same readings" in line
    assert "remove one" in line
