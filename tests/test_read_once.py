"""A session is read once, and each of its logs and closure runs looked through for stills once, whatever is made of it."""

import sys
from collections import Counter

import pytest
from conftest import broad

from session.detect import stills, truth_segments
from session.detect.first_look import check_session
from session.detect.stills import SessionStills
from session.io import logfile
from tinygc import FitOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.runs import read_closure_runs
from tinygc.estimation.fit import fit_session
from tinygc.explanation.engine import explain_session
from tinygc.planning.proposals import propose
from tinygc.reporting.html.evidence import gather

pytestmark = pytest.mark.broad

OPTIONS = FitOptions(methods=("least_squares",), folds=2)


@pytest.fixture
def calls(monkeypatch):
    """How often each of the costly functions was called, by whatever module and under whatever name."""
    count = Counter()
    for function in (stills.find_stills, truth_segments.find_rests, logfile.read_log):

        def counted(*args, function=function, **more):
            count[function.__name__] += 1
            return function(*args, **more)

        for module in list(sys.modules.values()):
            if getattr(module, function.__name__, None) is function:
                monkeypatch.setattr(module, function.__name__, counted)
    return count


@pytest.mark.parametrize(
    ("job", "looked_at"),
    [
        (lambda folder: fit_session(folder, OPTIONS), 2),
        (lambda folder: explain_session(folder), 2),
        broad(lambda folder: gather(folder, OPTIONS), 2),
        broad(lambda folder: gather(folder, FitOptions(methods=("least_squares",), folds=2, exclude=(1,))), 2),
        (lambda folder: propose(folder), 1),
    ],
    ids=["fit", "explain", "report", "report without a segment", "plan"],
)
def test_each_log_and_closure_run_is_looked_at_once(job, looked_at, calls, simulated):
    """One log and one closure run, both read; a plan has no use for the run's stills."""
    job(simulated())
    assert calls["read_log"] == 2
    assert calls["find_stills"] == looked_at


@pytest.mark.broad
def test_a_report_explains_what_its_fit_leaves_out(simulated):
    evidence = gather(simulated(), FitOptions(methods=("least_squares",), folds=2, exclude=(1,)))
    assert [segment.number for segment in evidence.fit.problem.segments if not segment.accepted] == [1]
    assert all(segment.accepted for segment in evidence.explanation.problem.segments)


def test_shared_stills_change_nothing(simulated):
    session = read_session(simulated())
    found = SessionStills(session)
    assert check_session(session, found) == check_session(session)
    shared, alone = build_problem(session, found=found), build_problem(session)
    assert (shared.batch.rate == alone.batch.rate).all()
    assert (shared.floor.sigma == alone.floor.sigma).all()
    (first,), (second,) = read_closure_runs(shared), read_closure_runs(alone)
    assert (first.floor_rad == second.floor_rad).all()
    assert first.rows == second.rows


def test_only_a_mended_log_is_looked_at_again(calls, simulated):
    from dataclasses import replace

    session = read_session(simulated())
    found = SessionStills(session)
    log, run = session.logs[0], session.closures[0]
    assert found.of(log) is found.of(log)
    found.of(run)
    mended = replace(log, samples=log.samples.between(0, len(log.samples) // 2))
    again = SessionStills(replace(session, logs=(mended,)), found)
    assert len(again.of(mended).samples) == len(mended.samples)
    assert again.of(run) is found.of(run)
    assert calls["find_stills"] == 3
