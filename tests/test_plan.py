"""``plan``: which movement to record next, and what the last explanation asked for."""

import hashlib
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import broad

import calibrate
import tinygc
from session.detect.accelerometer import NAMES
from session.detect.check_references import with_own_accelerometer
from session.io.errors import FormatError
from tinygc import SimulationOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.prior import vague
from tinygc.models import linear
from tinygc.planning.proposals import Known, _moves, _rows, best_turns, known_of, parameter_words, propose, requested_by_explain
from tinygc.simulation.write import write_session

CONFIG = 'schema = "tinygc-session/1"\n[sensor]\nodr_hz = 208.0\ngyro_fs_dps = 500\naccel_fs_g = 4\n'
WORDS = "record five fast turns both ways about z"


def explained(folder, words):
    (folder / "explain").mkdir(parents=True, exist_ok=True)
    (folder / "explain" / "explain.json").write_text(json.dumps({"schema": "tinygc-explain/2", "next": words}))


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return write_session(SimulationOptions(segments=9, closure_s=0.0, seed=3, odr_hz=104.0), tmp_path_factory.mktemp("plan") / "short")


@pytest.mark.broad
def test_the_first_turn_is_for_what_is_known_worst_and_each_helps(short):
    """Both sensors' numbers count, with the sigmas that a fit states: all noise, the accelerometer, and what is given of it."""
    fit = tinygc.fit(short, methods=("least_squares",), bias="ends").result
    sigma = (
        np.sqrt(np.diag(fit.joint_covariance) / fit.widened)
        / known_of(build_problem(with_own_accelerometer(read_session(short))[0])).targets
    )
    plan = propose(short, 4)
    proposals = plan.proposals
    assert plan.asked is None
    assert plan.enough is None or plan.enough >= len(proposals)
    names = [*(f"accelerometer {name}" for name in NAMES), *map(parameter_words, linear.NAMES)]
    assert proposals[0].parameter == names[int(np.argmax(sigma))]
    assert proposals[0].now == pytest.approx(sigma.max(), rel=0.01)
    assert all(proposal.after < proposal.now for proposal in proposals)
    assert [proposal.now for proposal in proposals] == sorted((proposal.now for proposal in proposals), reverse=True)


@pytest.mark.parametrize("number", ["nonorthogonality xy", broad("nonorthogonality yz"), broad("scale z"), "bias x"])
def test_what_the_accelerometer_lacks_is_asked_for(short, number):
    """A number that is known badly is the first that a turn is proposed for, and the turn's ends tell it."""
    problem = build_problem(with_own_accelerometer(read_session(short))[0])
    known, which = known_of(problem), NAMES.index(number)
    vague = known.covariance.copy()
    vague[which, which] += (100 * known.targets[which]) ** 2
    (proposal,) = best_turns(replace(known, covariance=vague), 1)
    assert proposal.parameter == f"accelerometer {number}"
    assert proposal.now == pytest.approx(np.sqrt(vague[which, which]) / known.targets[which])
    assert proposal.after < 0.2 * proposal.now
    (move,) = (move for move in _moves() if move.words == proposal.words)
    wrong = 0.01 if "bias" not in number else 0.01 * 9.8
    assert np.linalg.norm(_rows(move, known)[:, which]) * wrong > 20  # sigmas of its closure and its stills' lengths


@pytest.mark.parametrize("with_noise", [True, False])
def test_directions_that_few_turns_leave_open_are_known_as_the_prior_knows_them(short, with_noise, monkeypatch):
    """Four turns give eight angles for twelve parameters: along the other four directions the variance is the prior's, exactly."""
    if not with_noise:
        monkeypatch.setattr("tinygc.planning.proposals.stated_noise", lambda problem: None)
    session = with_own_accelerometer(read_session(short))[0]
    known = known_of(build_problem(session, exclude=(4, 5, 6, 7, 8), prior=vague))
    assert len(known.covariance) == (21 if with_noise else 12)
    variance = np.linalg.eigvalsh(known.covariance[-12:, -12:] / np.outer(linear.PRIOR_SIGMA, linear.PRIOR_SIGMA))
    np.testing.assert_allclose(variance[-4:], 1, atol=1e-3)
    assert (variance[:-4] < 1e-3).all()


def test_an_accelerometer_that_nobody_calibrated_counts_as_it_is_known(short, tmp_path):
    """Without [accelerometer] the same log knows less in all, and the plan says so."""
    bare = shutil.copytree(short, tmp_path / "bare")
    head, rest = (bare / "session.toml").read_text().split("[accelerometer]")
    (bare / "session.toml").write_text(head + "[" + rest.split("\n[", 1)[1])
    given, own = (known_of(build_problem(with_own_accelerometer(read_session(folder))[0])) for folder in (short, bare))
    assert own.with_gravity
    assert not given.with_gravity
    shears = [i for i, name in enumerate(NAMES) if "nonorthogonality" in name]
    assert np.diag(own.covariance)[shears].sum() > 1.2 * np.diag(given.covariance)[shears].sum()


@pytest.mark.parametrize("with_gravity", [True, False])
def test_rows_of_a_move_are_those_of_the_joint_estimation(with_gravity):
    """A wrong accelerometer's closure and lengths, computed by the turn itself, are what the rows predict."""
    from scipy.spatial.transform import Rotation

    from session.detect.accelerometer import IDENTITY, PARAMETERS, corrected, units

    known = Known(np.eye(PARAMETERS + linear.PARAMETERS), 1.0, 1.0, with_gravity)
    rng = np.random.default_rng(0)
    for move in _moves()[::7]:
        J = _rows(move, known)
        assert J.shape == (4 if with_gravity else 3, PARAMETERS + linear.PARAMETERS)
        # The force in the still at the end is the one at the start, seen after the turn.
        R = [Rotation.from_quat(q, scalar_first=True).as_matrix() for q in move.q_tb]
        np.testing.assert_allclose(R[1].T @ R[0] @ move.up[0], move.up[1], atol=1e-12)
        d = 1e-6 * rng.normal(size=PARAMETERS) * units(9.8)
        force = corrected(IDENTITY + d, move.up * 9.80665)
        lengths = np.linalg.norm(force, axis=1) - 9.80665
        told = J[2:, :PARAMETERS] @ d
        expected = lengths if with_gravity else [(lengths[0] - lengths[1]) / np.sqrt(2)]
        np.testing.assert_allclose(told, expected, atol=1e-9)


def test_what_explain_asked_for_comes_first(short, tmp_path, capsys):
    asked = shutil.copytree(short, tmp_path / "asked")  # what explain leaves in a folder is for this test alone
    explained(asked, WORDS)
    assert calibrate.main(["plan", str(asked), "--json", str(tmp_path / "plan.json")]) == 0
    assert capsys.readouterr().out.splitlines()[0] == f"explain asks: {WORDS}"
    assert json.loads((tmp_path / "plan.json").read_text())["requested"] == WORDS


def test_the_guided_recording_says_what_explain_asked_of_a_session_like_it(tmp_path, capsys):
    explained(tmp_path, WORDS)
    (tmp_path / "session.toml").write_text(CONFIG)
    words = ["record", "--port", str(tmp_path / "no-port"), "--out", str(tmp_path / "new"), "--like", str(tmp_path / "session.toml")]
    assert calibrate.main(words) == 3
    assert f"explain asks ({tmp_path}): {WORDS}" in capsys.readouterr().err


def test_an_explanation_of_other_logs_asks_for_nothing(tmp_path):
    (tmp_path / "log0001.csv").write_text("the log\n")
    (tmp_path / "explain").mkdir()
    logs = {"log0001.csv": hashlib.sha256(b"the log\n").hexdigest()}
    (tmp_path / "explain" / "explain.json").write_text(json.dumps({"schema": "tinygc-explain/2", "next": WORDS, "logs": logs}))
    assert requested_by_explain(tmp_path) == WORDS
    (tmp_path / "log0002.csv").write_text("what was recorded since, and not explained\n")
    assert requested_by_explain(tmp_path) == WORDS
    (tmp_path / "log0001.csv").write_text("another log\n")
    assert requested_by_explain(tmp_path) is None


@pytest.mark.parametrize(
    "text", ['{"schema": "tinygc-explain/2", "next": null}', '{"schema": "tinygc-explain/2", "next": ""}', '{"schema": "tinygc-explain/2"}']
)
def test_an_explanation_may_ask_for_nothing(tmp_path, text):
    assert requested_by_explain(tmp_path) is None
    (tmp_path / "explain").mkdir()
    (tmp_path / "explain" / "explain.json").write_text(text)
    assert requested_by_explain(tmp_path) is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "broken JSON"),
        ("[]", "it is a list of 0, expected a table"),
        ("{", "broken JSON"),
        ("{}", "schema is missing, expected "),
        ('{"schema": "tinygc-explain/2", "next": 3}', "next is 3, expected text"),
        ('{"next": "turn", "next": "rest"}', 'the key "next" stands twice'),
        ('{"schema": "tinygc-explain/2", "next": "turn", "logs": []}', "logs is a list of 0, expected a table"),
        ('{"schema": "tinygc-explain/2", "next": "turn", "logs": {"log0001.csv": null}}', "logs.log0001.csv is null, expected text"),
        ('{"next": "turn", "schema": "tinygc-explain/3"}', 'schema is "tinygc-explain/3", expected one of tinygc-explain/2'),
    ],
)
def test_a_damaged_explanation_is_said_in_one_line_by_plan_and_does_not_stop_a_recording(tmp_path, text, says, capsys):
    (tmp_path / "explain").mkdir()
    (tmp_path / "explain" / "explain.json").write_text(text)
    with pytest.raises(FormatError, match=r"explain\.json: .*; explain again, or remove it$") as caught:
        requested_by_explain(tmp_path)
    assert says in str(caught.value)
    (tmp_path / "session.toml").write_text(CONFIG)
    words = ["record", "--port", str(tmp_path / "no-port"), "--out", str(tmp_path / "new"), "--like", str(tmp_path / "session.toml")]
    assert calibrate.main(words) == 3
    first, second = capsys.readouterr().err.splitlines()
    assert says in first
    assert "no-port" in second


@pytest.mark.parametrize("name", ["../session.toml", "/etc/hostname", "a\u0000b", ""])
def test_an_explanation_names_only_logs_of_its_own_folder(tmp_path, name):
    (tmp_path / "explain").mkdir()
    (tmp_path / "explain" / "explain.json").write_text(json.dumps({"schema": "tinygc-explain/2", "next": "turn", "logs": {name: "0" * 64}}))
    assert requested_by_explain(tmp_path) is None


def test_a_folder_without_a_log_is_one_line(tmp_path, capsys):
    (tmp_path / "session.toml").write_text(CONFIG)
    assert calibrate.main(["plan", str(tmp_path)]) == 2
    assert capsys.readouterr().err.splitlines() == [f"calibrate: {tmp_path}: no log; expected log*.csv or log*.csv.gz next to session.toml"]
