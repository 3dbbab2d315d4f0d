"""``plan``: which movement to record next, by exact rows of each turn, and what the last explanation asked for."""

import hashlib
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import calibrate
from session.base.errors import FormatError
from session.detect.accelerometer import IDENTITY, NAMES, PARAMETERS, corrected, units
from session.detect.check_references import with_own_accelerometer
from tinygc import SimulationOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import vague
from tinygc.models import linear
from tinygc.planning.proposals import Known, _moves, _rows, best_turns, known_of, propose, requested_by_explain
from tinygc.simulation.write import write_session

CONFIG = 'schema = "tinygc-session/1"\n[sensor]\nodr_hz = 208.0\ngyro_fs_dps = 500\naccel_fs_g = 4\n'
WORDS = "record five fast turns both ways about z"


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return write_session(SimulationOptions(segments=9, closure_s=0.0, seed=3, odr_hz=62.5), tmp_path_factory.mktemp("plan") / "short")


def problem_of(folder, **options):
    return build_problem(with_own_accelerometer(read_session(folder))[0], **options)


@pytest.fixture(scope="module")
def known(short):
    return known_of(problem_of(short))


@pytest.mark.parametrize("with_gravity", [True, False])
def test_rows_of_a_move_are_those_of_the_joint_estimation(with_gravity):
    """A wrong accelerometer's closure and lengths, computed by the turn itself, are what the rows predict."""
    known = Known(np.eye(PARAMETERS + linear.PARAMETERS), 1.0, 1.0, with_gravity)
    rng = np.random.default_rng(0)
    for move in _moves()[::7]:
        J = _rows(move, known)
        assert J.shape == (4 if with_gravity else 3, PARAMETERS + linear.PARAMETERS)
        # The force in the still at the end is the one at the start, seen after the turn.
        R = [Rotation.from_quat(q, scalar_first=True).as_matrix() for q in move.q_tb]
        assert_allclose(R[1].T @ R[0] @ move.up[0], move.up[1], atol=1e-12)
        d = 1e-6 * rng.normal(size=PARAMETERS) * units(9.8)
        lengths = np.linalg.norm(corrected(IDENTITY + d, move.up * 9.80665), axis=1) - 9.80665
        expected = lengths if with_gravity else [(lengths[0] - lengths[1]) / np.sqrt(2)]
        assert_allclose(J[2:, :PARAMETERS] @ d, expected, atol=1e-9)


def test_turns_are_proposed_for_what_is_known_worst_and_each_helps(short, known):
    """Of both sensors' numbers; a number of the accelerometer that is known badly is the first, and the turn's ends tell it."""
    proposals, asked, _ = propose(short, 3)
    sigma = np.sqrt(np.diag(known.covariance)) / known.targets
    assert asked is None
    assert proposals[0].now == pytest.approx(sigma.max(), rel=0.01)
    assert all(proposal.after < proposal.now for proposal in proposals)
    assert [p.now for p in proposals] == sorted((p.now for p in proposals), reverse=True)
    for number in ("nonorthogonality xy", "bias x"):
        which, covariance = NAMES.index(number), known.covariance.copy()
        covariance[which, which] += (100 * known.targets[which]) ** 2
        (proposal,) = best_turns(replace(known, covariance=covariance), 1)
        assert proposal.parameter == f"accelerometer {number}"
        assert proposal.now == pytest.approx(np.sqrt(covariance[which, which]) / known.targets[which])
        assert proposal.after < 0.2 * proposal.now


def test_directions_that_few_turns_leave_open_are_known_as_the_prior_knows_them(short, known, tmp_path):
    """Four turns give eight angles for twelve parameters: along the other four directions the variance is the prior's, exactly.  An
    accelerometer that nobody calibrated counts as it is known."""
    few = known_of(problem_of(short, exclude=(4, 5, 6, 7, 8), prior=vague))
    variance = np.linalg.eigvalsh(few.covariance[-12:, -12:] / np.outer(linear.PRIOR_SIGMA, linear.PRIOR_SIGMA))
    assert_allclose(variance[-4:], 1, atol=1e-3)
    assert (variance[:-4] < 1e-3).all()
    bare = shutil.copytree(short, tmp_path / "bare")
    head, rest = (bare / "session.toml").read_text().split("[accelerometer]")
    (bare / "session.toml").write_text(head + "[" + rest.split("\n[", 1)[1])
    own = known_of(problem_of(bare))
    assert (known.with_gravity, own.with_gravity) == (False, True)
    shears = [i for i, name in enumerate(NAMES) if "nonorthogonality" in name]
    assert np.diag(own.covariance)[shears].sum() > 1.2 * np.diag(known.covariance)[shears].sum()


# What explain asked for.


def explained(folder, text):
    (folder / "explain").mkdir(parents=True, exist_ok=True)
    (folder / "explain" / "explain.json").write_text(text)


def asking(**more):
    return json.dumps({"schema": "tinygc-explain/2", **more})


def test_what_explain_asked_for_comes_first_in_plan_and_in_a_recording_like_it(short, tmp_path, capsys):
    asked = shutil.copytree(short, tmp_path / "asked")
    explained(asked, asking(next=WORDS))
    assert calibrate.main(["check", str(asked), "--plan", "--json", str(tmp_path / "plan.json")]) == 0
    assert capsys.readouterr().out.splitlines()[0] == f"explain requests: {WORDS}"
    assert json.loads((tmp_path / "plan.json").read_text())["requested"] == WORDS
    words = ["record", "--port", str(tmp_path / "no-port"), "--out", str(tmp_path / "new"), "--like", str(asked / "session.toml")]
    assert calibrate.main(words) == 3
    assert f"explain requests ({asked}): {WORDS}" in capsys.readouterr().err


def test_an_explanation_of_other_logs_asks_for_nothing(tmp_path):
    assert requested_by_explain(tmp_path) is None
    logs = {"log0001.csv": hashlib.sha256(b"the log\n").hexdigest()}
    for name in ("log0001.csv", "log0002.csv"):  # the second recorded since, and not explained
        (tmp_path / name).write_text("the log\n")
        explained(tmp_path, asking(next=WORDS, logs=logs))
        assert requested_by_explain(tmp_path) == WORDS
    (tmp_path / "log0001.csv").write_text("another log\n")
    assert requested_by_explain(tmp_path) is None
    names = ("../session.toml", "/etc/hostname", "a\u0000b", "")  # only logs of its own folder
    for text in (asking(next=None), asking(next=""), asking(), *(asking(next="turn", logs={name: "0" * 64}) for name in names)):
        explained(tmp_path, text)
        assert requested_by_explain(tmp_path) is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "broken JSON"),
        ("{}", "schema is missing, expected "),
        (asking(next=3), "next is 3, expected text"),
        ('{"next": "turn", "next": "rest"}', 'the key "next" stands twice'),
        (asking(next="turn", logs={"log0001.csv": None}), "logs.log0001.csv is null, expected text"),
        ('{"next": "turn", "schema": "tinygc-explain/3"}', 'schema is "tinygc-explain/3", expected one of tinygc-explain/2'),
    ],
)
def test_a_damaged_explanation_is_said_in_one_line(tmp_path, text, says):
    explained(tmp_path, text)
    with pytest.raises(FormatError, match=r"explain\.json: .*; explain again, or remove it$") as caught:
        requested_by_explain(tmp_path)
    assert says in str(caught.value)


def test_a_damaged_explanation_does_not_stop_a_recording_and_a_folder_without_a_log_is_one_line(tmp_path, capsys):
    explained(tmp_path, "{")
    (tmp_path / "session.toml").write_text(CONFIG)
    words = ["record", "--port", str(tmp_path / "no-port"), "--out", str(tmp_path / "new"), "--like", str(tmp_path / "session.toml")]
    assert calibrate.main(words) == 3
    first, second = capsys.readouterr().err.splitlines()
    assert ("broken JSON" in first, "no-port" in second) == (True, True)
    assert calibrate.main(["check", str(tmp_path), "--plan"]) == 2
    assert capsys.readouterr().err.splitlines() == [f"calibrate: {tmp_path}: no log; expected log*.csv or log*.csv.gz next to session.toml"]
