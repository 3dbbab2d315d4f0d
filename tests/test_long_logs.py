"""A day of readings in bounded memory: what is kept of a row, what a command holds beside it, and that nothing comes out otherwise."""

import tracemalloc
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from long_logs import long_session

from session.detect import check_time, signatures, stamp_errors, stills
from session.detect.first_look import check_session
from session.detect.stills import SessionStills
from session.io import samples as readings
from session.io.samples import Samples
from tinygc import Session, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.problem import Problem
from tinygc.effects import catalogue
from tinygc.estimation.stated_noise import rounding_covariance
from tinygc.explanation.faulty_readings import find_glitches, without_glitches
from tinygc.noise import thinned
from tinygc.noise.channels import within_stills
from tinygc.noise.twin import Twin

pytestmark = pytest.mark.broad

ROWS = 200_000
#: bytes: 8 of the stamp, 2 of each register, and the record around them
KEPT = 24.0
#: a day at 208 Hz is 18 million rows, of which 2 GB are 110 bytes each
READING, LOOKING = 75.0, 32.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return long_session(tmp_path_factory.mktemp("long") / "session", ROWS)


@pytest.fixture(scope="module")
def session(folder) -> Session:
    return read_session(folder)


@pytest.fixture(scope="module")
def problem(session) -> Problem:
    return build_problem(session)


def peak_of(work: Callable[[], object]) -> tuple[float, float, object]:
    """Bytes a row at the most, and that are kept, of what the work gives."""
    tracemalloc.start()
    try:
        result = work()
        kept, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return peak / ROWS, kept / ROWS, result


@pytest.mark.broad
def test_a_log_is_read_and_kept_in_as_many_bytes_as_it_has_registers(folder):
    peak, kept, session = peak_of(lambda: read_session(folder))
    assert isinstance(session, Session)
    assert len(session.logs[0].samples) == ROWS
    assert kept < KEPT
    assert peak < READING


@pytest.mark.broad
def test_the_first_look_holds_no_float_copy_of_a_whole_log(session, monkeypatch):
    """24 bytes a row would be one copy of one triad; all that is held is columns and parts."""
    monkeypatch.setattr(readings, "TOGETHER", 4096)
    monkeypatch.setattr(readings, "AT_ONCE", 4096)
    monkeypatch.setattr(stills, "_CHUNK_BLOCKS", 200)
    monkeypatch.setattr(check_time, "AT_ONCE", 4096)
    monkeypatch.setattr(stamp_errors, "TOGETHER", 4096)
    monkeypatch.setattr(signatures, "MOST", 4096)
    peak, _, findings = peak_of(lambda: check_session(session))
    assert isinstance(findings, list)
    assert len(findings) > 15
    assert peak < LOOKING


@pytest.mark.broad
def test_what_rounding_leaves_is_found_one_still_at_a_time(problem):
    """All stills of this log together are 24 bytes a row, and its longest a fifteenth of that."""
    peak, _, covariance = peak_of(lambda: rounding_covariance(problem, problem.first))
    assert np.isfinite(covariance).all()
    assert peak < 12


def test_a_column_is_converted_in_parts_to_the_same_numbers(session, monkeypatch):
    gyro = session.logs[0].samples.gyro
    whole, column = np.asarray(gyro), gyro[:, 1]
    monkeypatch.setattr(readings, "AT_ONCE", 1000)
    np.testing.assert_array_equal(np.asarray(gyro), whole)
    np.testing.assert_array_equal(gyro[:, 1], column)


@pytest.mark.broad
def test_the_first_look_says_the_same_in_small_parts(session, monkeypatch):
    whole = [str(finding) for finding in check_session(session)]
    monkeypatch.setattr(readings, "TOGETHER", 1000)
    monkeypatch.setattr(check_time, "AT_ONCE", 4096)
    assert [str(finding) for finding in check_session(session)] == whole


def test_turns_miss_the_same_of_fast_motion_looked_at_together_or_not(session, monkeypatch):
    found = SessionStills(session).of(session.logs[0])
    turns = list(pairwise(found.stills))
    whole = check_time.missed_of_turns(found.samples, turns, found.noise, 5.0)
    monkeypatch.setattr(check_time, "AT_ONCE", 1000)
    parted = check_time.missed_of_turns(found.samples, turns, found.noise, 5.0)
    np.testing.assert_allclose(parted.error_rad, whole.error_rad, rtol=1e-6, atol=1e-9)
    assert parted.exponent == whole.exponent


@pytest.mark.broad
def test_the_twin_of_thinned_rests_predicts_what_the_whole_does(problem, monkeypatch):
    """Closure and mean rates of the stills to the last digits; what a generous effect adds in a rest to a fifth of its sigma."""
    whole = Twin(problem)
    monkeypatch.setattr(thinned, "LONG", 0)
    few = Twin(problem)
    assert len(few.movements[0].t_s) < len(whole.movements[0].t_s) / 10
    state = whole.start()
    there, here = whole.residuals(state), few.residuals(state)
    np.testing.assert_allclose(here.stacked(), there.stacked(), atol=1e-12)
    worst = {}
    for effect in catalogue().values():
        if effect.kind != "rate" or effect.scan is not None:
            continue
        columns = [
            twin.effect_columns(effect, state, twin.sensitivity(state, twin.rates(state)), twin.rates(state)) for twin in (whole, few)
        ]
        in_turns, in_stills = ([getattr(each, name) for each in columns] for name in ("closure", "still"))
        np.testing.assert_allclose(in_turns[1], in_turns[0], atol=1e-3 * np.abs(in_turns[0]).max(), err_msg=effect.id)
        # What noise alone adds to a magnitude is the same in every rest, and the bias takes it up.
        off = in_stills[1] - in_stills[0]
        off = effect.parameter.plausible * (off - off.mean(axis=0)) / problem.still_rates.sigma[..., None]
        worst[effect.id] = float(np.abs(off).max())
    assert len(worst) > 8
    # An asymmetry feels the rate, not the noise behind it: at rest single readings show the noise's magnitude, and their mean does not.
    assert worst.pop("gyro.scale_asymmetry") < 1
    assert max(worst.values()) < 0.2, worst
    np.testing.assert_array_equal(within_stills(few).scatter, within_stills(whole).scatter)


def test_a_thinned_log_begins_ends_and_lasts_as_it_did(problem, monkeypatch):
    monkeypatch.setattr(thinned, "LONG", 0)
    seen, _ = thinned.thinned(problem)
    before, after = problem.logs[0].samples, seen.logs[0].samples
    assert (after.t_ns[0], after.t_ns[-1]) == (before.t_ns[0], before.t_ns[-1])
    assert after.period_s == before.period_s
    for segment, there in zip(problem.used, seen.used, strict=True):
        np.testing.assert_array_equal(after.gyro[there.start : there.stop], before.gyro[segment.start : segment.stop])
    assert all(a.stills[1] is b.stills[0] for a, b in pairwise(seen.used))


def test_what_replaces_false_readings_keeps_a_log_as_its_registers(session):
    samples = session.logs[0].samples
    gyro = np.array(samples.gyro)
    gyro[[5000, 5001, 70_000]] += 3.0
    floats = Samples(samples.t_ns, gyro, np.array(samples.accel))
    glitches = find_glitches(floats)
    assert glitches is not None
    packed = Samples(
        samples.t_ns, readings.replaced(samples.gyro, np.array([5000, 5001, 70_000]), gyro[[5000, 5001, 70_000]]), samples.accel
    )
    mended = without_glitches(packed, glitches)
    assert isinstance(mended.gyro, readings.PackedReadings)
    np.testing.assert_array_equal(np.asarray(mended.gyro), without_glitches(floats, glitches).gyro)
