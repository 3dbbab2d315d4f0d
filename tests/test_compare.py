"""Sessions of one unit, compared by their uncertainties: what moved is found, and called by its name."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import calibrate
from session.io.errors import FormatError
from tinygc.estimation.compare import agreement, compare, read_calibrated


def test_two_sessions_are_judged_by_their_difference():
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(2, 5, 5)) * np.array([1e-6, 1e-3, 1, 1, 10])[None, :, None]
    covariances, vectors = roots @ roots.transpose(0, 2, 1), rng.normal(size=(2, 5))
    found, d = agreement(vectors, covariances), vectors[0] - vectors[1]
    assert found.chi_square == pytest.approx(d @ np.linalg.solve(covariances.sum(axis=0), d), rel=1e-6)
    assert found.freedom == 5
    assert found.p_value == pytest.approx(stats.chi2.sf(found.chi_square, 5))


# The command


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two days of one unit, and one of another, simulated and fitted by the command line."""
    top = tmp_path_factory.mktemp("days")
    for name, seed, unit_seed in (("monday", 1, 9), ("tuesday", 2, 9), ("other", 3, 10)):
        options = ["--segments", "14", "--closure", "0", "--odr-hz", "104", "--quiet"]
        assert calibrate.main(["simulate", "--out", str(top / name), "--seed", str(seed), "--unit-seed", str(unit_seed), *options]) == 0
        assert calibrate.main(["fit", str(top / name), "--methods", "least_squares", "--folds", "2", "--quiet"]) == 0
    return top


def run(folders, *names_and_options):
    return calibrate.main(["compare", *[str(folders / word) if not word.startswith("-") else word for word in names_and_options]])


@pytest.mark.broad
def test_command_says_whether_and_what(folders, capsys):
    assert run(folders, "monday", "tuesday", "--strict") == 0
    said = capsys.readouterr().out
    assert "misalignments agree" in said
    assert "Note" not in said
    assert run(folders, "monday", "other") == 0
    assert run(folders, "monday", "other", "--strict") == 1
    said = capsys.readouterr().out
    assert "DIFFER" in said
    assert "scale factor error" in said
    assert "another sensor by its session.toml" in said


def test_bad_input_gets_one_line(folders, tmp_path, capsys):
    unfitted = tmp_path / "unfitted"
    shutil.copytree(folders / "monday", unfitted, ignore=shutil.ignore_patterns("fit"))
    without = tmp_path / "without"
    shutil.copytree(folders / "tuesday", without)
    path = without / "fit" / "model_least_squares.json"
    table = json.loads(path.read_text())
    for covariance, word in ((None, "12 x 12"), ((-np.eye(12)).tolist(), "positive")):
        path.write_text(json.dumps({**table, "covariance": covariance}))
        assert calibrate.main(["compare", str(folders / "monday"), str(without)]) == 2
        assert word in capsys.readouterr().err
    for arguments, word in (
        ([str(folders / "monday")], "two sessions"),
        ([str(folders / "monday"), str(tmp_path / "none")], "session.toml"),
        ([str(folders / "monday"), str(unfitted)], "calibrate.py fit"),
        ([str(folders / "monday"), str(folders / "monday")], "same log"),
    ):
        assert calibrate.main(["compare", *arguments]) == 2
        said = capsys.readouterr().err.strip()
        assert word in said
        assert len(said.splitlines()) == 1


def test_what_a_session_does_not_observe_is_said(folders, tmp_path):
    path = tmp_path / "flat"
    shutil.copytree(folders / "monday", path)
    model = path / "fit" / "model_least_squares.json"
    model.write_text(json.dumps({**json.loads(model.read_text()), "unobserved": ["E_xy"]}))
    found = compare([replace(read_calibrated(path), hashes=("x",)), read_calibrated(folders / "tuesday")])
    assert any("E_xy" in note for note in found.notes)
    (path / "fit" / "fit.json").write_text("{")
    with pytest.raises(FormatError, match=r"fit\.json"):
        read_calibrated(path)
