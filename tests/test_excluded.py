"""Turns that session.toml leaves out: found by a moment in which they moved, and left out wherever a session is read."""

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import Table, session_of, write_session

import calibrate
from session.detect.first_look import check_session
from session.detect.segments import EXCLUDED
from session.io.config import LeftOut
from tinygc import FitOptions
from tinygc.closure.build import build_problem
from tinygc.closure.problem import LEFT_OUT
from tinygc.estimation.held_out import run_method


@pytest.fixture(scope="module")
def session():
    return session_of(Table().tumble(12, seed=3).samples(seed=3))


def leaving_out(session, *rows):
    return replace(session, config=replace(session.config, exclude=rows))


def test_the_turn_of_that_moment_is_left_out_as_if_its_number_had_been_given(session):
    """The fifth turn moves from 22 to 25 s: 2 s of rest, then five times 3 s of turn and 2 s of rest."""
    name = session.logs[0].path.name
    by_moment, by_number = build_problem(leaving_out(session, LeftOut(name, 23.5))), build_problem(session, exclude=(4,))
    assert [segment.problem for segment in by_moment.segments] == [EXCLUDED if i == 4 else None for i in range(12)]
    assert [segment.problem for segment in by_number.segments] == [LEFT_OUT if i == 4 else None for i in range(12)]
    options = FitOptions(folds=2)
    fits = [run_method("least_squares", problem, options).model.vector for problem in (by_moment, by_number)]
    np.testing.assert_array_equal(*fits)


@pytest.mark.parametrize("name_at_s", [("log0009.csv", 23.5), (None, 21.0), (None, 500.0)])
def test_a_moment_of_another_log_or_of_rest_leaves_nothing_out(session, name_at_s):
    name, at_s = name_at_s
    problem = build_problem(leaving_out(session, LeftOut(name or session.logs[0].path.name, at_s)))
    assert all(segment.accepted for segment in problem.segments)


def test_a_moment_that_cannot_be_is_said(session):
    name = session.logs[0].path.name

    def said(*rows):
        return [finding.says for finding in check_session(leaving_out(session, *rows)) if finding.what == "exclude"]

    assert said(LeftOut(name, 23.5)) == []
    assert said(LeftOut(name, 500.0)) == [f"{name} at 500 s is left out, which lies outside of it"]
    assert said(LeftOut("log0009.csv", 3.0)) == ["log0009.csv at 3 s is left out, which is no log of this session"]


@pytest.mark.parametrize("row", ["log = 3\nat_s = 1", 'log = "log0001.csv"', 'log = "a"\nat_s = true', 'log = "a"\nat_s = nan'])
def test_an_entry_that_says_nothing_is_one_line(tmp_path, capsys, row):
    folder = write_session(tmp_path / "s", Table().tumble(2).samples())
    with (folder / "session.toml").open("a") as file:
        file.write(f"\n[[exclude]]\n{row}\n")
    assert calibrate.main(["fit", str(folder)]) == 2
    said = capsys.readouterr().err
    assert re.search(r"session\.toml: exclude\[0\]\.(log|at_s) is .*, (which is not finite; )?expected .*; correct it there", said)
    assert len(said.splitlines()) == 1
