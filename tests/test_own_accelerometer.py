"""A session whose session.toml gives no accelerometer: its own stills give it, and what cannot be known is said."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from session.detect.check_references import with_own_accelerometer
from session.detect.findings import worst
from session.detect.first_look import check_folder
from session.detect.stills import SessionStills
from session.io.units import MG
from tinygc import FitOptions, read_session
from tinygc.estimation.fit import fit_session
from tinygc.explanation.decision import tilt_rms

SESSION1 = Path(__file__).resolve().parent.parent / "data" / "session1"

#: put on top of what the sensor of data/session1 has: 1 %, 5 mrad, 30 mg
MORE = np.eye(3) + np.array([[0.01, 0.005, 0], [0, -0.01, 0.005], [0, 0, 0.01]])
MORE_MPS2 = 30 * MG * np.array([1.0, -1.0, 1.0])


@pytest.fixture
def bare(tmp_path):
    """``data/session1`` without ``[accelerometer]``."""
    folder = shutil.copytree(SESSION1, tmp_path / "bare", ignore=shutil.ignore_patterns("fit", "explain"))
    text = (folder / "session.toml").read_text()
    before, rest = text.split("[accelerometer]")
    (folder / "session.toml").write_text(before + "[" + rest.split("\n[", 1)[1])
    return folder


@pytest.mark.broad
def test_its_own_stills_make_the_reference_that_the_given_one_was(bare):
    plain, own = (fit_session(folder, FitOptions(methods=("least_squares",))) for folder in (SESSION1, bare))
    held_out = [tilt_rms(result.linear.held_out) for result in (plain, own)]
    assert held_out[1] < 1.05 * held_out[0]
    said = [w for w in own.warnings if w.what == "accelerometer"]
    assert len(said) == 1
    assert "41 stills" in said[0].says
    assert not [w for w in plain.warnings if w.what == "accelerometer"]


def test_check_says_so_and_finds_nothing_wrong_with_gravity(bare):
    findings = check_folder(bare)
    assert worst(findings) != "error"
    levels = {f.what: f.level for f in findings}
    assert levels["accelerometer"] == "note"
    assert levels["gravity"] == "ok"
    assert levels["gravity spread"] in ("ok", "note")


def test_more_of_the_same_errors_change_nothing(bare):
    session = read_session(bare)
    logs = tuple(replace(log, samples=log.samples.with_accel(log.samples.accel @ MORE.T + MORE_MPS2)) for log in session.logs)
    spoilt = replace(session, logs=logs)
    one, other = (with_own_accelerometer(each)[0] for each in (session, spoilt))
    for log, more in zip(one.logs, other.logs, strict=True):
        stills = [still for still in SessionStills(one).of(log).stills if still.problem is None]

        def means(samples, stills=stills):
            return np.array([samples.accel[still.start : still.stop].mean(axis=0) for still in stills])

        assert len(stills) == 41
        assert np.linalg.norm(means(log.samples) - means(more.samples), axis=1).min() > 30 * MG
        # The errors on top are upper triangular, so the body frame that the triad defines stays: direction and length come out the same.
        assert np.linalg.norm(means(one.calibrated(log)) - means(other.calibrated(more)), axis=1).max() < 1e-3 * MG
