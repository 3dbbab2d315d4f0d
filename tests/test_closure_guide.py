"""The closure run as the guide leads through it: what it waits for, what it refuses, what it wants done with the files."""

from dataclasses import replace

import numpy as np
import pytest
from coached_hand import guide_of, play, said
from conftest import DEG, Table, broad, session_of

from session.bench.messages import Kind, Stage
from session.bench.rawfile import RecordingDecision
from session.io.logfile import Log
from session.io.samples import Samples
from tinygc.closure.build import build_problem
from tinygc.closure.runs import read_closure_runs

pytestmark = pytest.mark.broad

PLANNED_S = 20.0
WAY = (90, (0, 1, 0), 3)


def to_the_mark(rest_s=9.0) -> Table:
    """A segment, then onto the mark."""
    return Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).turn(*WAY).rest(rest_s)


def run(table: Table, turns=6, away_deg=0.0, rest_s=0.0) -> Table:
    """Out and back again."""
    axes = [(1, 0.3, 0), (0, 1, 0.4), (0.2, 0, 1)]
    out = [(110, axes[i % 3]) for i in range(turns // 2)]
    for degrees, axis in [*out, *((-degrees, axis) for degrees, axis in reversed(out))]:
        table.turn(degrees, axis, PLANNED_S / turns)
        if rest_s:
            table.rest(rest_s)
    return table.turn(away_deg, (0, 1, 0), 1.0) if away_deg else table


def led(samples: Samples, closure_s=PLANNED_S, segments=1):
    """The guide, its changes, and what was decided at which second: as a recording does it."""
    guide = guide_of(segments, closure_s=closure_s)
    changes, decided = [], []
    for first in range(0, len(samples), 50):
        changes += play(guide, samples.between(first, first + 50))
        if guide.wants:
            decided.append((guide.wants.text, round(float(samples.t_s[min(first + 50, len(samples) - 1)]), 1)))
            changes += guide.decided(guide.wants)
    return guide, changes, decided


def test_onto_the_mark_still_turn_back_still():
    samples = run(to_the_mark()).rest(4).samples()
    guide, changes, decided = led(samples)
    assert guide.stage is Stage.DONE
    assert [word for word, _ in decided] == ["begin unclosed", "keep closure"]
    assert guide.accepted == 1
    (whole,) = said(changes, Kind.ACCEPTED)[1:]
    assert whole.startswith("closure run: 20 s, back within 0.0")
    assert said(changes, Kind.DONE) == ["done: 1 segments and a closure run"]
    assert not said(changes, Kind.WARNING)
    # The file begins in the still, and the still goes on in it for as long as is asked.
    begun_s = decided[0][1]
    assert 11.5 + guide.closure.hold_s <= begun_s < 20.5 - guide.closure.hold_s


def test_a_table_that_stands_on_its_mark_is_left_alone():
    """Nobody touches it for 8 s: that is the mark."""
    table = Table().rest(3).turn(120, (1, 0, 0), 3).rest(14)
    guide, _, decided = led(run(table).rest(4).samples())
    assert guide.stage is Stage.DONE
    assert [word for word, _ in decided] == ["begin unclosed", "keep closure"]
    assert 14.0 < decided[0][1] < 17.0


def test_or_the_person_says_so():
    guide = guide_of(1, closure_s=PLANNED_S)
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(4).samples()
    play(guide, samples)
    assert guide.stage is Stage.CLOSURE
    assert guide.wants is None
    guide.closure.on_the_mark()
    more = Table().rest(0.5).samples()
    play(guide, Samples(more.t_ns + samples.t_ns[-1] + 4_807_692, more.gyro, samples.accel[-1] + 0 * more.accel, more.temp_c))
    assert guide.wants == RecordingDecision("begin", "unclosed")


def test_away_from_the_mark_is_said_and_may_be_set_right():
    table = run(to_the_mark(), away_deg=4.0).rest(4)
    samples = table.samples()
    guide, changes, _ = led(samples)
    assert guide.stage is Stage.CLOSURE
    (warning,) = said(changes, Kind.WARNING)
    before, after = (samples.accel[(samples.t_s > s) & (samples.t_s < s + 3)].mean(axis=0) for s in (16.0, table.duration_s - 3.5))
    away = np.arccos(before @ after / np.linalg.norm(before) / np.linalg.norm(after)) / DEG
    assert warning == f"{away:.1f}° from where the run began, 0.5° at most: set it back onto the mark"
    assert "from where the run began" in guide.instruction.why
    guide, changes, decided = led(table.turn(-4.0, (0, 1, 0), 1.0).rest(4).samples())
    assert guide.stage is Stage.DONE
    assert [word for word, _ in decided] == ["begin unclosed", "keep closure"]


def test_a_mark_that_was_none_is_given_up():
    """The person was not on the mark before, and is now: the table stays, and the run is made again from there."""
    table = run(to_the_mark(), away_deg=4.0).rest(18)
    guide, changes, decided = led(run(table).rest(4).samples())
    assert guide.stage is Stage.DONE
    assert [word for word, _ in decided] == ["begin unclosed", "begin unclosed", "keep closure"]
    assert "it stays there: that is the mark now, and the run restarts" in said(changes, Kind.WARNING)


def test_who_moves_too_early_begins_again():
    table = to_the_mark(rest_s=2.2).turn(60, (1, 0, 0), 2)
    guide, changes, decided = led(run(table.rest(9)).rest(4).samples())
    assert any("too short a still" in text for text in said(changes, Kind.WARNING))
    assert [word for word, _ in decided][-2:] == ["begin unclosed", "keep closure"]
    assert guide.stage is Stage.DONE


@pytest.mark.parametrize("fault", ["gap", "clip"])
def test_a_run_that_cannot_be_integrated_begins_again(fault):
    samples = run(run(to_the_mark()).rest(9)).rest(4).samples()
    if fault == "gap":
        keep = (samples.t_s < 30.0) | (samples.t_s > 30.2)
        samples = Samples(samples.t_ns[keep], samples.gyro[keep], samples.accel[keep], samples.temp_c[keep])
    else:
        samples.gyro[(samples.t_s > 30.0) & (samples.t_s < 30.1), 0] = 573 * DEG
    guide, changes, decided = led(samples)
    (rejected,) = said(changes, Kind.REJECTED)
    assert rejected.startswith("this closure run is not complete: ")
    assert [word for word, _ in decided] == ["begin unclosed", "begin unclosed", "keep closure"]
    assert guide.stage is Stage.DONE


@pytest.mark.parametrize("at_s", [broad(13.0), 19.0, broad(30.0), broad(41.5)])
def test_a_new_log_or_a_pause_at_any_moment_of_it(at_s):
    """On the way, in the first still, in the run, in the last still: what was accepted stays, and the run is made again."""
    whole = run(to_the_mark()).rest(4).samples()
    first = whole.between(0, int(at_s * 208))
    for word in ("new log", "pause"):
        guide = guide_of(1, closure_s=PLANNED_S)
        for start in range(0, len(first), 50):
            play(guide, first.between(start, start + 50))
            if guide.wants:
                guide.decided(guide.wants)
        assert guide.stage is Stage.CLOSURE
        if word == "pause":
            guide.decided(RecordingDecision("pause"))
            assert guide.instruction.do.startswith("paused")
            assert play(guide, whole) == []
            guide.decided(RecordingDecision("begin", "unclosed"))
        else:
            guide.new_log()
        assert guide.stage is Stage.CHECK_STREAM
        again = run(Table().rest(14)).rest(4).samples(seed=2)
        for start in range(0, len(again), 50):
            play(guide, again.between(start, start + 50))
            if guide.wants:
                guide.decided(guide.wants)
        assert guide.stage is Stage.DONE
        assert guide.accepted == 1


def test_what_is_whole_here_is_whole_for_fit():
    """The samples between ``begin`` and ``keep`` are a closure run that the problem takes, with the floor's size of error."""

    table = Table().tumble(10, seed=4).turn(*WAY).rest(9)
    began_s = table.duration_s - 9
    samples = run(table).rest(4).samples(accel_ug=20.0)
    guide, _, decided = led(samples, segments=10)
    (_, begin_s), (_, keep_s) = decided
    assert guide.stage is Stage.DONE
    cut = [int(np.searchsorted(samples.t_s, s)) for s in (begin_s, keep_s)]
    session = session_of(samples.between(0, cut[0]))
    path = session.logs[0].path.with_name("closure0001.csv")
    session = replace(session, closures=(Log(path, samples.between(*cut)),))
    problem = build_problem(session)
    (found,) = read_closure_runs(problem)
    assert found.yaw_carried  # the table was not touched between the log's end and the run
    assert abs(found.duration_s - PLANNED_S) < 0.5
    assert begin_s > began_s
