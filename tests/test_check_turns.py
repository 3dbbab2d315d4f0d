"""``check`` looks at the turns that ``fit`` uses, and refuses where ``fit`` refuses, in the same words."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table, broad, session_of, write_session
from looks import of, serious

import tinygc
from benchmarks.public import mimu
from session.detect.first_look import check_session
from session.io.config import LeftOut
from session.io.errors import CalibrationError
from tinygc.closure.prepared import prepare

REACH_RPS = 32767 * 17.5e-3 * DEG


def shaken(turns: int, strokes: int = 20, seed: int = 5) -> Table:
    """Turns from still to still, and at the end shaking that the gyro clips in."""
    table, rng = Table().tumble(turns, seed=seed), np.random.default_rng(seed)
    for _ in range(strokes):
        table.turn(rng.uniform(300, 500) * rng.choice([-1, 1]), rng.normal(size=3), 0.7)
    return table.rest(2)


def clipped(samples):
    return replace(samples, gyro=np.clip(samples.gyro, -REACH_RPS, REACH_RPS))


def test_clipped_shaking_that_no_fit_uses_accuses_neither_scale_nor_axes():
    session = session_of(clipped(shaken(9, 40).samples()))
    findings = check_session(session)
    assert of(findings, "axes").level == "ok"
    assert of(findings, "gyro scale").level == "ok"
    assert "9 turns of" in of(findings, "axes").says
    turns = of(findings, "turns")
    assert turns.says.startswith("9 of 10 turns from still to still, 18 angles for 12 parameters")
    assert "not used: turn 9 at 4" in turns.says
    assert "the gyro clips at 573 dps" in turns.says
    assert len(prepare(session).problem.used) == 9


FEW = [
    ("too few", lambda: session_of(Table().tumble(5, seed=5).samples()), "5 usable segments, expected at least 7"),
    ("clipped", lambda: session_of(clipped(shaken(6).samples())), "6 usable segments, expected at least 7"),
    (
        "left out",
        lambda: leaving_out(session_of(Table().tumble(8, seed=5).samples()), 3.5, 8.5),
        "6 usable segments, expected at least 7",
    ),
    ("no turn", lambda: session_of(Table().rest(4).samples()), "1 still phase but no turn between two that are usable"),
]


def leaving_out(session, *at_s):
    rows = tuple(LeftOut("log0001.csv", s) for s in at_s)
    return replace(session, config=replace(session.config, exclude=rows))


@pytest.mark.parametrize(("made", "said"), [case[1:] for case in FEW], ids=[case[0] for case in FEW])
def test_check_refuses_what_fit_refuses_in_the_same_words(made, said):
    session = made()
    with pytest.raises(CalibrationError) as refused:
        tinygc.fit(session, methods=("least_squares",))
    finding = of(tinygc.check(session), "turns")
    assert finding.level == "error"
    assert finding.says.startswith(str(refused.value).removeprefix("made: "))
    assert said in finding.says


def test_a_fit_that_does_not_settle_says_what_does_not_fit_and_check_says_it_too():
    session = session_of(Table().tumble(16, seed=5).samples())
    log = session.logs[0]
    other = replace(log, samples=replace(log.samples, gyro=Table().tumble(16, seed=6).samples().gyro))
    session = replace(session, logs=(other,))
    with pytest.raises(CalibrationError, match="16 of 16 turns miss gravity by more than 10% of their angle") as refused:
        tinygc.fit(session, methods=("least_squares",))
    finding = of(tinygc.check(session), "fit")
    assert (finding.level, finding.says) == ("error", str(refused.value))


def test_a_closure_run_that_fit_refuses_is_an_error_of_check(tmp_path, run):
    folder = write_session(tmp_path / "s", Table().tumble(9, seed=5).samples())
    write_session(folder, Table().rest(3).turn(90, (1, 0, 0)).rest(3).samples(), "closure0001.csv")
    code, _, err = run("fit", folder, "--methods", "least_squares")
    assert code == 2
    (error,) = [finding for finding in tinygc.check(folder) if finding.level == "error"]
    assert "closure0001.csv: does not return" in error.says
    assert error.says in err
    assert run("check", folder)[0] == 2


@pytest.mark.parametrize("name", [broad("e5u2"), broad("e7u5"), broad("e7u6")])
def test_real_recordings_with_clipped_shaking_at_their_end_agree_with_gravity(shared, tmp_path, name):
    if not (shared / "wild" / "mimu").is_dir():
        pytest.skip("no recordings: shared/wild/mimu is not there")
    number, unit = int(name[1]), int(name[3])
    (_, (ticks, registers)) = next(each for each in mimu.experiments(shared / "wild" / "mimu") if each[0] == number)
    log = (mimu.HEADER, mimu._lines(ticks, registers[:, unit]))
    folder = mimu.write_folder(tmp_path / name, mimu.TOML.format(serial=name), {mimu.LOG: log})
    findings = tinygc.check(folder)
    assert of(findings, "gyro scale").level == "ok"
    assert not {("gyro against gravity", "warning"), ("axes", "error")} & serious(findings)
