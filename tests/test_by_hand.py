"""What a person changes of a recording in session.toml: a turn left out, a still left out, a still's ends moved; and taken back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import writable_copy

from calibrate import main
from session.base.errors import FormatError
from session.base.records import plain
from session.base.units import DEG, NS
from session.detect.first_look import check_folder
from session.detect.stills import SessionStills, _problem, measure
from session.log.config import LeftOut, StillByHand
from session.log.folder import add_by_hand, read_session, remove_by_hand
from tinygc.closure.prepared import prepare
from tinygc.estimation.options import FitOptions
from tinygc.explanation.data_repair import without_creeping
from tinygc.fitting.fit import fit_session
from tinygc.fitting.fit_file import segments_table
from tinygc.reporting.view.content import Recording

SESSION = Path(__file__).resolve().parent.parent / "data" / "session1"
LOG = "log0001.csv.gz"
OPTIONS = FitOptions(methods=("least_squares",))


@pytest.fixture
def folder(tmp_path):
    return writable_copy(SESSION, tmp_path / "s")


@pytest.fixture(scope="module")
def untouched():
    return fit_session(SESSION, OPTIONS)


def times(problem, number):
    """Of a still: its first and last stamp, s of the log's clock."""
    still, t_ns = problem.stills[number], problem.logs[0].samples.t_ns
    return float(t_ns[still.start] * NS), float(t_ns[still.stop - 1] * NS)


def test_a_turn_left_out_is_in_no_fit_and_taken_back_leaves_the_same_file(folder, untouched):
    toml = folder / "session.toml"
    before = toml.read_bytes()
    row = LeftOut(LOG.removesuffix(".gz"), (times(untouched.problem, 6)[1] + times(untouched.problem, 7)[0]) / 2)
    add_by_hand(toml, row)
    without, asked = fit_session(folder, OPTIONS), fit_session(SESSION, FitOptions(methods=("least_squares",), exclude=(6,)))
    assert [s.number for s in without.problem.segments if not s.accepted] == [6]
    assert without.problem.segments[6].problem == "it was left out by hand (session.toml)"
    np.testing.assert_array_equal(without.linear.linear.vector, asked.linear.linear.vector)
    assert not np.array_equal(without.linear.linear.vector, untouched.linear.linear.vector)
    assert [f.description for f in without.warnings] == ["1 segment left out by hand (session.toml)"]
    remove_by_hand(toml, row)
    assert toml.read_bytes() == before


def test_a_still_left_out_joins_its_turns(folder, untouched):
    first, last = times(untouched.problem, 9)
    add_by_hand(folder / "session.toml", StillByHand(LOG, (first + last) / 2))
    prepared = prepare(folder)
    assert len(prepared.problem.segments) == len(untouched.problem.segments) - 1
    joined = prepared.problem.segments[8]
    assert (joined.first.start, joined.last.start) == (untouched.problem.stills[8].start, untouched.problem.stills[10].start)
    assert joined.note == "passes over a still that was left out by hand (session.toml)"
    assert [f.description for f in prepared.warnings] == ["1 still left out by hand (session.toml)"]
    assert [f.what for f in check_folder(folder) if f.level in ("warning", "error")] == []


def test_every_command_states_in_one_line_what_was_changed(folder, untouched, capsys):
    assert main(["check", str(folder)]) == 0
    assert "by hand" not in "".join(capsys.readouterr())
    for number in (4, 6, 12):
        last, first = times(untouched.problem, number)[1], times(untouched.problem, number + 1)[0]
        add_by_hand(folder / "session.toml", LeftOut(LOG, (last + first) / 2))
    add_by_hand(folder / "session.toml", StillByHand(LOG, sum(times(untouched.problem, 9)) / 2))
    assert main(["check", str(folder)]) == 0
    assert capsys.readouterr().err.splitlines()[-1] == "s: 3 segments left out, 1 still left out by hand (session.toml)"
    found = {}
    assert without_creeping(prepare(folder).problem, found).stills[9].problem == "was left out by hand (session.toml)"
    assert found == {}  # it is not one that was not still


def test_moved_ends_are_those_of_the_still(folder, untouched):
    first, last = times(untouched.problem, 9)
    t_ns, still = untouched.problem.logs[0].samples.t_ns, untouched.problem.stills[9]
    add_by_hand(folder / "session.toml", StillByHand(LOG, (first + last) / 2, float(t_ns[still.start + 70] * NS), last))
    prepared = prepare(folder)
    moved = prepared.problem.stills[9]
    assert (moved.start, moved.stop) == (still.start + 70, still.stop)
    assert moved.bumps == 0
    (stated,) = plain(segments_table(prepared.problem))["stills_by_hand"]
    assert stated == {"log": LOG, "at_s": (first + last) / 2, "from_s": float(t_ns[still.start + 70] * NS), "to_s": last}
    samples = prepared.problem.logs[0].samples
    np.testing.assert_array_equal(moved.gyro_mean, measure(samples, [(still.start + 70, still.stop)], 1).gyro_mean)
    assert prepared.problem.segments[9].first is moved
    assert [f.description for f in prepared.warnings] == ["the ends of 1 still moved by hand (session.toml)"]
    assert not np.array_equal(prepared.problem.first.vector, untouched.problem.first.vector)


@pytest.mark.parametrize(("longer_s", "why"), [(0.05, None), (0.3, "moves: its readings scatter "), (1.0, "moves: its readings scatter ")])
def test_a_still_moved_into_a_movement_is_none(folder, untouched, longer_s, why):
    """Where the detector found none either: at once on the page, and in each command."""
    first, last = times(untouched.problem, 9)
    add_by_hand(folder / "session.toml", StillByHand(LOG, (first + last) / 2, first, last + longer_s))
    (shown,) = (each for each in Recording(read_session(folder)).content()["stills"] if each["by_hand"])
    assert (shown["problem"] or "").startswith(why or "none") == (why is not None)
    warned = [f.description for f in prepare(folder).warnings if f.what == "not still"]
    assert warned == ([f"1 of 41 are no reference: still 9 at {first:.1f} s {shown['problem']}"] if why else [])


def test_a_still_that_turns_steadily_or_creeps_is_none(untouched):
    """Readings as in the still that was found, at another rate about the vertical, or with gravity in motion."""
    problem, still = untouched.problem, untouched.problem.stills[9]
    turning = replace(still, gyro_mean=still.gyro_mean + np.array([0, 0, 4 * DEG]))
    creeping = replace(still, tilt_rate=np.array([0, 0.05 * DEG, 0]))
    found = [_problem(each, still, problem.stills, problem.noise) for each in (still, turning, creeping)]
    assert found == [None, "turns at a steady 4.0 dps", "creeps 0.050 dps about y (gravity moves in it)"]


BAD = {
    "no still was found there": lambda a, b, end: StillByHand(LOG, b + 1.0),
    "only one end is given; give from_s and to_s": lambda a, b, end: StillByHand(LOG, a + 0.1, a),
    "is shorter than 0.1 s; correct": lambda a, b, end: StillByHand(LOG, a + 0.1, b, a),
    "is outside of the log; correct": lambda a, b, end: StillByHand(LOG, a + 0.1, a, end + 1.0),
    "two stills overlap at": lambda a, b, end: StillByHand(LOG, a + 0.1, a, b + 4.0),
}


@pytest.mark.parametrize("says", BAD)
def test_a_change_that_cannot_be_is_an_error_that_names_it(folder, untouched, says):
    end = float(untouched.problem.logs[0].samples.t_ns[-1] * NS)
    add_by_hand(folder / "session.toml", BAD[says](*times(untouched.problem, 9), end))
    with pytest.raises(FormatError, match=says) as raised:
        prepare(folder)
    assert str(raised.value).startswith(f"{folder / 'session.toml'}: [[still]] of {LOG}")


def test_a_saved_session_and_one_on_another_clock_keep_the_changes(folder, untouched, tmp_path):
    first, last = times(untouched.problem, 9)
    add_by_hand(folder / "session.toml", StillByHand(LOG, (first + last) / 2, first + 0.4, last))
    session = read_session(folder)
    saved = read_session(session.save(tmp_path / "saved"))
    stills = [SessionStills(each).of(each.logs[0]).stills for each in (session, saved)]
    assert saved.config.still[0].log == "log0001.csv"
    assert [(s.start, s.stop) for s in stills[1]] == [(s.start, s.stop) for s in stills[0]]
    assert session.config.on_time(lambda at_s: at_s / 2).still[0].from_s == (first + 0.4) / 2


WRITTEN = {
    "no line end": lambda text: text.rstrip("\n"),
    "a comment at the end": lambda text: text + "# measured on a Monday",
    "CRLF": lambda text: text.replace("\n", "\r\n"),
    "a byte order mark": lambda text: "\ufeff" + text,
    "an array within a line": lambda text: 'exclude = [{log = "log0001.csv", at_s = 30.0}]\n' + text,
}


@pytest.mark.parametrize("how", WRITTEN)
def test_a_change_taken_back_leaves_no_trace_however_the_file_is_written(folder, how):
    toml, rows = folder / "session.toml", (LeftOut(LOG, 41.0), StillByHand(LOG, 48.9, 48.2, 50.1), LeftOut(LOG, 60.0))
    toml.write_bytes(before := WRITTEN[how](toml.read_text(encoding="utf-8")).encode())
    for row in rows:
        add_by_hand(toml, row)
    config = read_session(folder).config
    assert (config.exclude[-2:], config.still) == (rows[::2], rows[1:2])
    for row in rows:
        remove_by_hand(toml, row)
    assert toml.read_bytes() == before
