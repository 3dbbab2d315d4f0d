"""A truth file as reference: segments between its moments, how it is written, and what is wrong with such a file; gravity's sign."""

import gzip
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, SESSION_TOML
from truth_sessions import BIAS_DPS, Wrong, made, write

from session.base.errors import CalibrationError, DataError, FormatError
from session.base.units import G
from session.detect.first_look import check_session
from session.detect.repair import repair
from session.log.config import read_config
from tinygc import Protocol, Session, read_session, simulate
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.prepared import prepare
from tinygc.closure.residual import closure_angles
from tinygc.closure.uncertainty import covariance_parts
from tinygc.features.truth.check import with_aligned_truth
from tinygc.features.truth.reading import TruthGiven, changed, read_truth
from tinygc.models.linear import LinearModel

ARRAYS = (np.arange(5) / 100, np.zeros((5, 3)), np.tile([0, 0, -G], (5, 1)))
FEW = Wrong(turns=16, every_s=0.5)
SHORT = Wrong(turns=10, frame="enu")


def true_model(E):
    return LinearModel(E, -E @ np.multiply(BIAS_DPS, DEG))


def test_the_errors_are_recovered_within_their_sigmas_without_a_single_still():
    session, E = made(FEW)
    problem = build_problem(session)
    assert problem.batch.angles == 3
    fit = fit_least_squares(problem.batch, problem.floor.sigma, problem.first)
    sigma = np.sqrt(np.diag(sum(covariance_parts(problem.batch, problem.floor, fit.model, problem.earth).values())))
    z = (fit.model.vector - true_model(E).vector) / sigma
    assert np.abs(z).max() < 3.5
    assert 2 < z @ z < 30  # twelve of them
    # Moments between two samples are carried to the nearest: half a sample at 100 dps would be 0.2 deg.
    session, E = made(replace(FEW, sigma_deg=0.001, late_s=0.0))
    assert np.sqrt(np.mean(closure_angles(build_problem(session).batch, true_model(E)) ** 2)) < 0.02 * DEG


def test_windows_bound_their_own_segments_and_missing_samples_leave_one_out():
    session, _ = made(FEW)
    (log,), (truth,) = session.logs, session.reference.truths
    windows = replace(truth, window=np.arange(len(truth.t_ns)) // 5)
    problem = build_problem(changed(session, truths=(windows,)))
    assert {round(segment.duration_s, 1) for segment in problem.segments[:-1]} == {2.0}  # from a window's first moment to its last
    np.testing.assert_allclose(np.diff([segment.start_s for segment in problem.segments]), 2.5, atol=0.01)
    kept = np.r_[0:2000, 2100 : len(log.samples)]
    problem = build_problem(replace(session, logs=(replace(log, samples=log.samples.pick(kept)),)))
    (why,) = [segment.problem for segment in problem.segments if segment.problem]
    assert "missing" in why


@pytest.mark.filterwarnings("error")
def test_rows_without_an_accelerometer_are_a_note_and_no_clipping():
    session, _ = made(FEW)
    (log,) = session.logs
    count = len(log.samples) // 4
    accel = np.where(np.arange(len(log.samples))[:, None] < count, 0.0, log.samples.accel)
    findings = check_session(replace(session, logs=(replace(log, samples=log.samples.with_accel(accel)),)))
    said = {finding.what: finding for finding in findings}
    assert said["accelerometer"].level == "note"
    assert f"{count} of {len(log.samples)} rows" in said["accelerometer"].description
    assert not [finding for finding in findings if finding.level in ("warning", "error")]


# The file


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda lines: ["t,w,x,y,z", *lines[1:]], "header must be"),
        (lambda lines: lines[:2], "a segment needs two"),
        (lambda lines: [*lines[:3], "7,1,0", *lines[4:]], "line 4"),
        (lambda lines: [*lines[:3], "20,2,0,0,0", *lines[4:]], "length 1"),
        (lambda lines: [*lines[:3], lines[2], *lines[4:]], "does not go on"),
    ],
)
def test_a_broken_truth_file_is_one_line(tmp_path, change, says):
    path = tmp_path / "truth0001.csv"
    path.write_text("\n".join(change(["t_ns,qw,qx,qy,qz", *(f"{t},1,0,0,0" for t in range(0, 90, 10))])))
    with pytest.raises(FormatError, match=says):
        read_truth(path)


def test_a_header_may_have_the_scalar_last_and_a_broken_archive_is_one_line(tmp_path):
    path, packed = tmp_path / "truth0001.csv", tmp_path / "truth0002.csv.gz"
    path.write_text("t_s,qx,qy,qz,qw\n0,0.6,0,0,0.8\n1,0,0.6,0,0.8\n")
    np.testing.assert_allclose(read_truth(path).q_nb, [[0.8, 0.6, 0, 0], [0.8, 0, 0.6, 0]])
    packed.write_bytes(gzip.compress(path.read_bytes())[:-5])
    with pytest.raises(FormatError, match="broken"):
        read_truth(packed)


def test_check_says_all_that_is_found_and_what_it_says_can_be_kept(tmp_path):
    folder = write(tmp_path, replace(SHORT, late_s=0.00406, sense="world_to_body", mounting_deg=(0, 0, 90)))
    said = {finding.what: finding for finding in with_aligned_truth(read_session(folder))[1]}
    assert {finding.level for finding in said.values()} == {"note"}
    for what, words in (("clock", "late"), ("frame", "z up (found)"), ("attitudes", "inverse"), ("mounting", "taken off")):
        assert words in said[f"truth's {what}"].description
    keeps = [finding.do.split(" in session.toml")[0].removeprefix("truth.") for finding in said.values()]
    with (folder / "session.toml").open("a") as file:
        file.write("[truth]\n" + "\n".join(keeps) + "\n")
    assert {finding.level for finding in with_aligned_truth(read_session(folder))[1]} == {"ok"}
    with pytest.raises(DataError, match=r"a truth file has its own clock and axes \(see check\)"):
        repair(folder, tmp_path / "repaired")
    (folder / "truth0001.csv").unlink()
    with pytest.raises(FormatError, match=r'protocol.reference is "truth"'):
        read_session(folder)


# An accelerometer with all axes negated: turns are blind to it, the Earth's rotation is not


def test_the_earth_tells_an_accelerometer_that_is_upside_down():
    session = simulate(segments=20, closure_s=0.0, seed=7, odr_hz=62.5).session
    triad, site = session.config.accelerometer, session.config.site
    logs = tuple(replace(log, samples=log.samples.with_accel(-log.samples.accel)) for log in session.logs)
    negated = replace(session.config, accelerometer=replace(triad, bias_mps2=-triad.bias_mps2))
    south = replace(session.config, site=replace(site, latitude_deg=-site.latitude_deg))
    for tried, advice in (
        (session, None),
        (replace(session, logs=logs, config=negated), "negate all axes of the accelerometer if the one that points up reads -1 g"),
        (replace(session, config=south), "is site.latitude_deg right (south is negative)?"),
    ):
        said = [finding for finding in prepare(tried).warnings if finding.what == "gravity's sign"]
        assert len(said) == (advice is not None)
        assert all(advice in finding.do and "the wrong way round" in finding.description for finding in said)


# Arrays, and session.toml.


@pytest.mark.parametrize(
    "given",
    [
        TruthGiven(),
        TruthGiven(offset_s=0.25, sense="world_to_body"),
        TruthGiven(order="xyzw", frame="enu", mounting=np.eye(3)[[1, 2, 0]]),
    ],
)
def test_a_truth_that_is_read_in_another_way_is_written_in_that_way(given, tmp_path):
    """Its file holds what the reading makes these very attitudes of, of length 1."""
    q = np.random.default_rng(3).normal(size=(20, 4))
    q *= 1.001 / np.linalg.norm(q, axis=1, keepdims=True)  # nearly of length 1
    made = Session.from_arrays(*ARRAYS, truth=[(np.arange(20) / 10, q, np.repeat([0, 1], 10))])
    assert made.config.protocol.reference == "truth"
    session = replace(made, config=replace(made.config, sections={"truth": given}))
    (mine,), (theirs,) = session.reference.truths, read_session(session.save(tmp_path / "s")).reference.truths
    np.testing.assert_array_equal(mine.t_ns, theirs.t_ns)
    np.testing.assert_array_equal(mine.window, theirs.window)
    np.testing.assert_allclose(mine.q_nb, theirs.q_nb, rtol=0, atol=4 * np.finfo(float).eps)
    np.testing.assert_allclose(np.linalg.norm(mine.q_nb, axis=1), 1, rtol=1e-15)


@pytest.mark.parametrize(
    ("more", "complaint"),
    [
        ({"truth": [(ARRAYS[0], np.ones((5, 4)))]}, r"^truth\[0\]: q_nb\[0\] has length 2, expected a quaternion"),
        ({"protocol": Protocol(reference="truth")}, 'reference is "truth"; arrays have "gravity", or "truth" with truth='),
    ],
)
def test_arrays_that_are_no_truth_are_refused_by_the_name_of_the_argument(more, complaint):
    with pytest.raises(CalibrationError, match=complaint):
        Session.from_arrays(*ARRAYS, **more)


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ('frame = "up"', "truth.frame"),
        ("order = 4", "truth.order"),
        ("offset_s = 1e9", "truth.offset_s"),
        ("mounting = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "truth.mounting is no rotation"),
        ("mounting = [[1e308, 0, 0], [0, 1, 0], [0, 0, 1]]", "truth.mounting[0][0] is 1e+308, expected a number within 10"),
    ],
)
def test_a_complaint_about_its_section_names_the_key(tmp_path, section, said):
    path = tmp_path / "session.toml"
    path.write_text(f"{SESSION_TOML}[truth]\n{section}\n")
    with pytest.raises(FormatError, match=f"session.toml.*{re.escape(said)}"):
        read_config(path)
