"""The yaw is carried where it can be, and begins anew where it cannot."""

import gzip
import shutil

import numpy as np
import pytest

from session.io.units import DEG
from tinygc import SimulationOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.runs import read_closure_runs
from tinygc.simulation.write import write_session


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A session without bias instability, its log as lines."""
    folder = write_session(SimulationOptions(seed=1, bias_instability_dph=0.0), tmp_path_factory.mktemp("yaw") / "whole")
    lines = gzip.decompress((folder / "log0001.csv.gz").read_bytes()).decode().splitlines(keepends=True)
    return folder, lines[:2], lines[2:]


def rebuilt(whole, path, *pieces):
    """The session with its log made of other pieces."""
    folder, head, _ = whole
    shutil.copytree(folder, path)
    (path / "log0001.csv.gz").unlink()
    for number, piece in enumerate(pieces, start=1):
        (path / f"log{number:04d}.csv").write_text("".join([*head, *piece]))
    return build_problem(read_session(path))


def run_rmse_deg(problem):
    model = fit_least_squares(problem.batch, problem.floor.sigma, problem.first).model
    return float(np.sqrt(np.mean(read_closure_runs(problem)[0].errors(model) ** 2))) / DEG


def middle_of(problem, number, still=True):
    """A row in the middle of a still, or of the turn after it."""
    log = problem.logs[0].stills
    return log[number].middle if still else (log[number].stop + log[number + 1].start) // 2


def test_a_log_cut_inside_a_still_goes_on(whole, tmp_path):
    problem = build_problem(read_session(whole[0]))
    cut = middle_of(problem, 20)
    split = rebuilt(whole, tmp_path / "s", whole[2][:cut], whole[2][cut:])
    assert list(split.earths) == [0]
    assert run_rmse_deg(split) < 0.08


def test_samples_lost_in_a_turn_begin_a_new_group(whole, tmp_path):
    problem = build_problem(read_session(whole[0]))
    cut = middle_of(problem, 18, still=False)
    gap = rebuilt(whole, tmp_path / "g", whole[2][: cut - 150] + whole[2][cut + 150 :])
    assert len(gap.earths) == 2
    assert any("missing" in (segment.problem or "") for segment in gap.segments)
    assert run_rmse_deg(gap) < 0.1


def test_leaving_a_segment_out_does_not_break_the_chain(whole):
    session = read_session(whole[0])
    assert len(build_problem(session, exclude=(5,)).earths) == 1
