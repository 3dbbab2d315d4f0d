"""Rests that are no reference: each is listed with its place and its reason, and a rest that serves is not."""

from dataclasses import replace
from pathlib import Path

from conftest import Table, session_of

from session.detect.first_look import check_session


def test_check_says_where_and_why():
    table = Table().tumble(13).turn(90, (1, 0, 0)).rest(0.5).turn(80, (0, 1, 0)).rest(2)
    (finding,) = (f for f in check_session(session_of(table.samples())) if f.what == "rests not used")
    assert f"at {table.rests[-2][0]:.0f}" in finding.says.replace(".1", "").replace(".2", "")
    assert "too short" in finding.says


def test_attitudes_that_are_all_one_are_not_called_many():
    """Seven stills within a third of a degree: their lengths agree, and tell nothing of an accelerometer."""
    table = Table().rest(2)
    for number in range(6):
        table.turn(40, (0, 0, 1)).turn(0.05 * (-1) ** number, (1, 0, 0)).rest(2)
    (finding,) = (f for f in check_session(session_of(table.samples())) if f.what == "gravity spread")
    assert finding.level == "note"
    assert "7 stills that are all one attitude (within 0." in finding.says
    assert "attitudes" not in finding.says.split("one attitude")[0]


def test_a_closure_run_rests_in_one_attitude_and_is_not_asked_for_more():
    """The same samples as a log and as a closure run: only the log is asked for other attitudes."""
    session = session_of(Table().rest(2).turn(90, (0, 0, 1)).turn(-90, (0, 0, 1)).rest(2).samples())
    run = replace(session.logs[0], path=Path("closure0001.csv"))
    as_log, as_run = (f for f in check_session(replace(session, closures=(run,))) if f.what == "gravity spread")
    assert (as_log.level, as_run.level) == ("note", "ok")
    assert "6 or more" in as_log.do
    assert as_run.where == "closure0001.csv"
    assert as_run.do == ""
    assert as_run.says == as_log.says


def test_attitudes_that_lie_apart_are_counted():
    table = Table().rest(2)
    for _ in range(6):  # 0, 40, 80, … degrees about x, and twice the same in between
        table.turn(40, (1, 0, 0)).rest(2).turn(2, (0, 1, 0)).rest(2)
    (finding,) = (f for f in check_session(session_of(table.samples())) if f.what == "gravity spread")
    assert "13 stills in 7 attitudes" in finding.says
