"""``plan``: which movement to record next, and what the last explanation asked for."""

import hashlib
import json

import numpy as np
import pytest

import calibrate
from session.log.folder import read_session
from tinygc.closure.uncertainty import parameter_covariance
from tinygc.models import linear
from tinygc.plan.proposals import TARGETS, parameter_words, propose
from tinygc.plan.requested import requested_by_explain
from tinygc.problem.build import build_problem
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

CONFIG = 'schema = "tinygc-session/1"\n[sensor]\nodr_hz = 208.0\ngyro_fs_dps = 500\naccel_fs_g = 4\n'
WORDS = "record five fast turns both ways about z"


def explained(folder, words):
    (folder / "explain").mkdir(parents=True, exist_ok=True)
    (folder / "explain" / "explain.json").write_text(json.dumps({"schema": "tinygc-explain/1", "next": words}))


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return write_session(SimulationOptions(segments=9, closure_s=0.0, seed=3, odr_hz=104.0), tmp_path_factory.mktemp("plan") / "short")


def test_the_first_turn_is_for_what_is_known_worst_and_each_helps(short):
    problem = build_problem(read_session(short))
    sigma = np.sqrt(np.diag(parameter_covariance(problem.batch, problem.floor, problem.first, problem.earth, wander=problem.wander)))
    proposals, words = propose(short, 4)
    assert words is None
    assert proposals[0].parameter == parameter_words(linear.NAMES[int(np.argmax(sigma / TARGETS))])
    assert proposals[0].now == pytest.approx((sigma / TARGETS).max(), rel=1e-6)
    assert all(proposal.after < proposal.now for proposal in proposals)
    assert [proposal.now for proposal in proposals] == sorted((proposal.now for proposal in proposals), reverse=True)


def test_what_explain_asked_for_comes_first(short, tmp_path, capsys):
    explained(short, WORDS)
    assert calibrate.main(["plan", str(short), "--json", str(tmp_path / "plan.json")]) == 0
    assert capsys.readouterr().out.splitlines()[0] == f"explain asks: {WORDS}"
    assert json.loads((tmp_path / "plan.json").read_text())["asked"] == WORDS


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
    (tmp_path / "explain" / "explain.json").write_text(json.dumps({"next": WORDS, "logs": logs}))
    assert requested_by_explain(tmp_path) == WORDS
    (tmp_path / "log0002.csv").write_text("what was recorded since, and not explained\n")
    assert requested_by_explain(tmp_path) == WORDS
    (tmp_path / "log0001.csv").write_text("another log\n")
    assert requested_by_explain(tmp_path) is None


@pytest.mark.parametrize("text", ["", "[]", "{", '{"next": null}', '{"next": 3}', '{"next": ""}'])
def test_a_damaged_explanation_asks_for_nothing(tmp_path, text):
    assert requested_by_explain(tmp_path) is None
    (tmp_path / "explain").mkdir()
    (tmp_path / "explain" / "explain.json").write_text(text)
    assert requested_by_explain(tmp_path) is None


def test_a_folder_without_a_log_is_one_line(tmp_path, capsys):
    (tmp_path / "session.toml").write_text(CONFIG)
    assert calibrate.main(["plan", str(tmp_path)]) == 2
    assert capsys.readouterr().err.splitlines() == [f"calibrate: {tmp_path}: no log; expected log*.csv or log*.csv.gz beside session.toml"]
