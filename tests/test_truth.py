"""A truth file as reference: segments between moments of truth, and what is wrong with such a file."""

import gzip
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, SESSION_TOML, Table, broad

import calibrate
from session.detect.first_look import check_session
from session.io.errors import DataError, FormatError, SegmentError
from session.io.logfile import read_truth
from tinygc import read_session
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import closure_angles
from tinygc.closure.uncertainty import parameter_covariance
from tinygc.models.linear import LinearModel

E = np.array([[1.010, 0.004, -0.003], [-0.002, 0.992, 0.005], [0.003, -0.004, 1.006]])
B = np.array([0.6, -0.4, 0.3]) * DEG


@pytest.fixture
def folder(tmp_path):
    """A sensor that never rests, with known errors, seen by something that knows its attitude every 0.5 s, off the samples' instants."""
    return make(tmp_path)


def make(tmp_path, sigma_deg=0.02, every_s=0.5, late_s=0.0017, seed=3, window=None):
    table, rng = Table(), np.random.default_rng(seed)
    for _ in range(30):
        table.turn(rng.uniform(60, 170), rng.normal(size=3), 2.0)
    samples = table.samples(seed=seed, bias_dps=(0, 0, 0), registers=False)
    gyro = (samples.gyro - B) @ np.linalg.inv(E).T
    moments = np.arange(0.2, table.duration_s - 0.2, every_s) + late_s
    _, attitude = table.truth(moments)
    q = attitude.as_quat(scalar_first=True)
    noise = rng.normal(size=(len(q), 3)) * sigma_deg * DEG / 2
    q = np.column_stack([q[:, 0] - np.sum(q[:, 1:] * noise, axis=1), q[:, 1:] + q[:, :1] * noise + np.cross(q[:, 1:], noise)])
    header = 'reference = "truth"\ntruth_sigma_deg = ' + f"{sigma_deg}"
    (tmp_path / "session.toml").write_text(SESSION_TOML.split("[site]")[0] + f"[protocol]\nsegment_s = 2.0\n{header}\n")
    rows = [
        f"{t},{','.join(map(repr, g))},{','.join(map(repr, a))}"
        for t, g, a in zip(samples.t_ns.tolist(), gyro.tolist(), samples.accel.tolist(), strict=True)
    ]
    (tmp_path / "log0001.csv").write_text("t_ns,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2\n" + "\n".join(rows) + "\n")
    stamps = np.rint(moments * 1e9).astype(np.int64).tolist()
    lines = [f"{t},{','.join(map(repr, row))}" for t, row in zip(stamps, q.tolist(), strict=True)]
    if window is not None:
        lines = [f"{line},{number}" for line, number in zip(lines, window(len(lines)), strict=True)]
    (tmp_path / "truth0001.csv").write_text("t_ns,qw,qx,qy,qz" + (",window" if window else "") + "\n" + "\n".join(lines) + "\n")
    return tmp_path


@pytest.mark.broad
def test_the_errors_are_recovered_within_their_sigmas_without_a_single_still(folder):
    problem = build_problem(read_session(folder))
    assert len(problem.used) == 29
    assert problem.batch.angles == 3
    fit = fit_least_squares(problem.batch, problem.floor.sigma, problem.first)
    covariance = parameter_covariance(problem.batch, problem.floor, fit.model, problem.earth)
    z = (fit.model.vector - LinearModel(E, B).vector) / np.sqrt(np.diag(covariance))
    assert np.abs(z).max() < 3.5
    assert 2 < z @ z < 30  # twelve of them
    assert np.sqrt(np.diag(covariance))[9:].max() < 0.03 * DEG


def test_moments_between_two_samples_are_carried_to_the_nearest(tmp_path):
    """Half a sample at 100 dps is 0.2 deg; carried, it is nothing."""
    problem = build_problem(read_session(make(tmp_path, sigma_deg=0.001, late_s=0.0024)))
    angles = closure_angles(problem.batch, LinearModel(E, B))
    assert np.sqrt(np.mean(angles**2)) < 0.02 * DEG


def test_windows_bound_their_own_segments(tmp_path):
    """Five moments a window: the segment is from its first to its last, and none runs from window to window."""
    problem = build_problem(read_session(make(tmp_path, window=lambda count: [k // 5 for k in range(count)])))
    assert {round(segment.duration_s, 1) for segment in problem.segments[:-1]} == {2.0}
    starts = [segment.start_s for segment in problem.segments]
    assert np.allclose(np.diff(starts), 2.5, atol=0.01)


def test_a_segment_over_missing_samples_is_left_out(folder):
    path = folder / "log0001.csv"
    lines = path.read_text().split("\n")
    path.write_text("\n".join(lines[:2000] + lines[2100:]))
    problem = build_problem(read_session(folder))
    assert [segment.problem is not None for segment in problem.segments].count(True) == 1
    assert "missing" in next(segment.problem for segment in problem.segments if segment.problem)


def test_an_inverse_attitude_is_named(folder):
    path = folder / "truth0001.csv"
    header, *lines = path.read_text().strip().split("\n")
    cells = [line.split(",") for line in lines]
    path.write_text("\n".join([header] + [",".join([t, w] + [repr(-float(v)) for v in xyz]) for t, w, *xyz in cells]))
    errors = [finding for finding in check_session(read_session(folder)) if finding.level == "error"]
    assert len(errors) == 1
    assert "inverse" in errors[0].do


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda lines: ["t,w,x,y,z", *lines[1:]], "header must be"),
        (lambda lines: lines[:2], "a segment needs two"),
        (lambda lines: [*lines[:3], "7,1,0", *lines[4:]], "line 4"),
        (lambda lines: [*lines[:3], lines[3].split(",")[0] + ",2,0,0,0", *lines[4:]], "length 1"),
        (lambda lines: [*lines[:3], lines[3].split(",")[0] + ",nan,0,0,0", *lines[4:]], "length 1"),
        (lambda lines: [*lines[:3], lines[2], *lines[4:]], "does not go on"),
        (lambda lines: [*lines[:3], "9" * 5000 + ",1,0,0,0", *lines[4:]], "line 4"),
    ],
)
def test_a_broken_truth_file_is_one_line(tmp_path, change, says):
    path = tmp_path / "truth0001.csv"
    path.write_text("\n".join(change(["t_ns,qw,qx,qy,qz", *(f"{t},1,0,0,0" for t in range(0, 90, 10))])))
    with pytest.raises(FormatError, match=says):
        read_truth(path)


def test_a_broken_archive_and_a_missing_truth_are_one_line(folder):
    text = (folder / "truth0001.csv").read_bytes()
    (folder / "truth0001.csv").unlink()
    with pytest.raises(FormatError, match=r'protocol.reference is "truth"'):
        read_session(folder)
    (folder / "truth0001.csv.gz").write_bytes(gzip.compress(text)[:-20])
    with pytest.raises(FormatError, match="broken"):
        read_session(folder)


def test_a_truth_of_another_time_or_too_short_is_refused(folder):
    session = read_session(folder)
    truth = session.truths[0]
    with pytest.raises(DataError, match="on the log's clock"):
        build_problem(replace(session, truths=(replace(truth, t_ns=truth.t_ns + 10**15),)))
    with pytest.raises(SegmentError, match="expected at least"):
        build_problem(replace(session, truths=(replace(truth, t_ns=truth.t_ns[:9], q_nb=truth.q_nb[:9]),)))


@pytest.mark.broad
def test_rates_of_stills_are_refused_where_there_is_no_still(folder, capsys):
    assert calibrate.main(["fit", str(folder), "--still-rates", "--methods", "tinygc", "--quiet"]) == 2
    said = capsys.readouterr().err
    assert "--still-rates" in said
    assert said.count("\n") == 1


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("missing", [0.25, broad(1.0)])
def test_rows_without_an_accelerometer_are_a_note_and_no_clipping(folder, missing):
    path = folder / "log0001.csv"
    head, *rows = path.read_text().splitlines()
    cut = round(len(rows) * missing)
    rows[:cut] = [",".join([*row.split(",")[:4], "0", "0", "0"]) for row in rows[:cut]]
    path.write_text("\n".join([head, *rows]) + "\n")
    findings = check_session(read_session(folder))
    said = {finding.what: finding for finding in findings if "accelerometer" in finding.what}
    assert said["accelerometer"].level == "note"
    assert f"{cut} of {len(rows)} rows" in said["accelerometer"].says
    assert ("accelerometer clipping" in said) == (missing < 1)
    assert not [finding for finding in findings if finding.level in ("warning", "error")]
    assert build_problem(read_session(folder)).batch.angles == 3
