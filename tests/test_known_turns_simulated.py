"""Known turns in simulated sessions: what ``simulate`` writes, and what ``explain``, ``plan`` and mends make of them."""

from dataclasses import replace

import numpy as np
import pytest

from session.detect.first_look import check_folder
from session.io.units import DEG
from tinygc import CalibrationError, SimulationOptions, explain, read_session, simulate
from tinygc.closure.build import build_problem
from tinygc.closure.prepared import prepare
from tinygc.explanation.evidence import selection_of
from tinygc.noise.channels import unknown_rows
from tinygc.noise.refit import refit
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener
from tinygc.simulation.write import write_session

CHOICES = {"segments": 14, "closure_s": 0.0, "odr_hz": 104.0, "stop_sigma_deg": 0.02}


@pytest.fixture(scope="module")
def made():
    return simulate(seed=5, **CHOICES)


@pytest.fixture(scope="module")
def problem(made):
    return prepare(made.session).problem


def test_the_file_holds_what_the_session_holds(made, tmp_path):
    folder = made.save(tmp_path / "s")
    read = read_session(folder).turns
    assert len(read) == len(made.session.turns) > 2
    for one, other in zip(read, made.session.turns, strict=True):
        assert (one.turn, one.sigma_rad) == (other.turn, pytest.approx(other.sigma_rad))
        assert one.angle_rad == pytest.approx(other.angle_rad, abs=1e-8)
        np.testing.assert_allclose(one.axis, other.axis, atol=1e-12)
    assert {finding.level for finding in check_folder(folder) if finding.what == "known turn"} == {"ok"}


def test_stops_err_as_they_are_asked_to_and_change_nothing_else(tmp_path):
    """The registers are the same bytes with a stop or without; stated angles scatter by its sigma, on the seed's own stream."""
    folders = {
        sigma: write_session(SimulationOptions(seed=5, **CHOICES | {"stop_sigma_deg": sigma}), tmp_path / str(sigma))
        for sigma in (0.0, 0.02, 2.0)
    }
    logs = {folder.joinpath("log0001.csv.gz").read_bytes() for folder in folders.values()}
    assert len(logs) == 1
    assert not (folders[0.0] / "turns.csv").exists()
    fine, coarse = (np.array([turn.angle_rad for turn in read_session(folders[sigma]).turns]) for sigma in (0.02, 2.0))
    errors = (coarse - fine) / (1.98 * DEG)
    assert 0.3 < np.sqrt(np.mean(errors**2)) < 2
    write_session(SimulationOptions(seed=5, **CHOICES | {"stop_sigma_deg": 0.0}), folders[2.0], force=True)
    assert not (folders[2.0] / "turns.csv").exists()
    with pytest.raises(CalibrationError, match="--stop-sigma-deg is -1"):
        SimulationOptions(stop_sigma_deg=-1.0)


def test_columns_of_the_twin_are_its_residuals_derivatives(problem):
    """Of the rows of known angles too: what explain looks for in them is what would be there."""
    twin = Twin(problem)
    state = twin.start()
    rates = twin.rates(state)
    earth, known = twin.earth_columns().closure @ state.axes.T, problem.batch.turns.known
    here = twin.residuals(state, rates).closure
    for axis in range(2):
        there = twin.residuals(replace(state, horizontal=1e-6 * np.eye(2)[axis]), rates).closure
        np.testing.assert_allclose((there - here) / 1e-6, earth[..., axis], atol=0.02 * np.abs(earth).max())
    assert np.abs(earth[known, 2]).max() > 0.1
    assert np.all(earth[~known, 2] == 0)
    there = twin.residuals(state, [rate + 1e-6 for rate in rates]).closure
    np.testing.assert_allclose((there - here) / 1e-6, twin.sensitivity(state, rates).sum(axis=(1, 3)), atol=5e-3)


def test_angles_that_nobody_sees_are_no_data_of_explain(problem):
    twin = Twin(problem)
    whiten = Whitener(twin)
    fit = refit(twin, whiten, [], twin.start())
    unknown = int((~problem.batch.turns.known).sum())
    assert unknown_rows(twin, "closure") == unknown
    assert unknown_rows(twin, "still") == 0
    selection = selection_of(twin, whiten, fit, [], seed=0)
    assert len(selection._rows) == whiten.parts["still"].stop - unknown
    rows = np.flatnonzero(~problem.batch.known)
    assert np.abs(fit.r[whiten.parts["closure"]][rows]).max() < 1e-9
    assert np.abs(fit.J[rows]).max() < 1e-6


def test_a_still_that_is_none_takes_its_known_turns_with_it(made):
    """Numbers stay those of ``check``, whatever a mend makes of stills; the two turns at it become one, of no known angle."""
    turn = made.session.turns[1]
    whole = build_problem(made.session)
    after = build_problem(made.session, moving=(turn.turn + 1,))
    lost = {found.known.turn for found in after.known_turns if found.problem}
    assert turn.turn in lost
    assert lost <= {turn.turn, turn.turn + 1}
    kept = [found for found in after.known_turns if not found.problem]
    before = {found.known.turn: found for found in whole.known_turns}
    for found in kept:
        assert found.segment.start_s == before[found.known.turn].segment.start_s
    left_out = build_problem(made.session, exclude=(turn.turn,))
    assert [found.known.turn for found in left_out.known_turns if found.problem] == [turn.turn]


@pytest.mark.slow
def test_explain_finds_nothing_where_nothing_is_and_a_name_where_it_is():
    nothing = explain(simulate(seed=6, **CHOICES).session)
    assert nothing.verdict == "no_mismatch"
    hidden = simulate(seed=6, **CHOICES | {"segments": 24}, effects={"gyro.scale_asymmetry": {"half_difference": [0.003, -0.002, 0.004]}})
    found = explain(hidden.session)
    assert [effect.id for effect in found.effects] == ["gyro.scale_asymmetry"]
