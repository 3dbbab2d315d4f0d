"""A fleet of sessions: each is computed once, by what is in it; failures are rows; what a row says is what the commands say."""

import json
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest
from fleets import FIT, QUICK, Here, asked, content, made, ran
from scipy import stats

from tinygc import check, fit, simulate
from tinygc.annexes.lots import fleet_row, fleet_session
from tinygc.annexes.lots.fleet_row import FleetOptions, empty, fitted, key_of
from tinygc.annexes.lots.fleet_run import listed_folders, run_fleet
from tinygc.annexes.lots.fleet_session import Outcome
from tinygc.annexes.lots.fleet_summary import summarise, unit_results
from tinygc.annexes.lots.fleet_table import EACH, open_table
from tinygc.estimation.model_tests import EFFECT, GRAVITY, NOISE, RUN, TURNS, ModelTest
from tinygc.estimation.results import FitResult
from tinygc.explanation.engine import explain_session


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """Four units; read only."""
    return made(tmp_path_factory.mktemp("fleet"))


@pytest.fixture(scope="module")
def whole(fleet, tmp_path_factory):
    """Its table, with all steps."""
    out = tmp_path_factory.mktemp("whole")
    assert ran(fleet, out, FleetOptions())[0].done == 4
    return out


@pytest.fixture
def copied(fleet, tmp_path):
    """The same, to be spoilt."""
    return shutil.copytree(fleet, tmp_path / "copied")


# What a row says


def test_a_row_says_what_check_fit_and_explain_say(fleet, whole):
    """To the last bit, though they share what they begin with."""
    folder = fleet / "unit1"
    key = key_of(folder, FleetOptions())
    names = "held_out_deg, floor_deg, use, segments, verdict, p_value, first_look, E_xx, sigma_B_z, accel_bias_x, sigma_accel_scale_z"
    (row,) = asked(whole, f"SELECT {names} FROM results WHERE key = '{key}'")
    alone = fit(folder, methods=("least_squares",))
    why = explain_session(folder)
    table = alone.to_json()
    assert row[:4] == (
        table["methods"]["least_squares"]["holdout"]["tilt_rms_deg"],
        table["noise"]["closure_floor_rms_deg"],
        table["use"]["method"],
        table["segments"]["used"],
    )
    assert row[4:7] == (why.verdict, why.p_value, max((f.level for f in check(folder)), key=("ok", "note", "warning", "error").index))
    assert row[7:9] == (alone.parameters["E_xx"].value, alone.parameters["B_z"].sigma)
    np.testing.assert_allclose(
        row[9:], [alone.accelerometer_parameters["bias_x"].value, alone.accelerometer_parameters["scale_z"].sigma], rtol=1e-12
    )


def test_what_was_injected_is_recovered_within_the_sigmas(fleet, whole):
    """Chi-square of each unit's twelve numbers against the truth that the simulator drew."""
    found = list(unit_results(whole))
    assert [each.session for each in found] == [f"unit{n}" for n in range(4)]
    total = 0.0
    for each in found:
        truth = json.loads((fleet / each.session / "truth.json").read_text())
        expected = np.concatenate([np.ravel(truth["E"]), np.radians(truth["B_dps"])])
        off = each.values[:12] - expected
        total += off @ np.linalg.solve(each.covariance[:12, :12], off)
        assert each.serial == f"SIM-{truth['options']['seed']}"
        np.testing.assert_array_equal(each.covariance, each.covariance.T)
        np.testing.assert_array_equal(np.isnan(each.values), np.isnan(np.diag(each.covariance)))
    assert 0.001 < stats.chi2.sf(total, 48) < 0.999


@pytest.fixture(scope="module")
def alone():
    """A fit with a closure run."""
    return fit(simulate(segments=8, closure_s=20.0, odr_hz=104.0, seed=1).session, methods=("least_squares",)).result


@pytest.mark.parametrize(
    ("tests", "within"),
    [
        ([], "doubtful pass"),
        *[([ModelTest(name, 0.009, 0.01, "contradicts")], "not decided") for name in (TURNS, RUN, NOISE, EFFECT, GRAVITY)],
        ([ModelTest(EFFECT, 0.4, 0.05, "leaves open")], "not decided"),
        ([ModelTest(EFFECT, 0.5, 0.05, "does neither")], "doubtful pass"),
    ],
)
def test_a_limit_counts_the_verdict_of_fit_with_that_limit(alone, tmp_path, monkeypatch, tests, within):
    """Just below each closure and at it, whatever the recording says of the model."""
    monkeypatch.setattr(FitResult, "tests", tuple(tests))
    result = replace(alone)
    row = empty() | fitted(result) | {"status": "done"}
    least, most = sorted([row["held_out_deg"], row["run_rmse_deg"]])
    with open_table(tmp_path) as table:
        table.put(Outcome("a", None), row, [tmp_path])
        for limit, answer in ((least, "fail"), (most * (1 - 1e-9), "fail"), (most * (1 + 1e-9), within), (9.0, within)):
            assert result.verdict(limit).answer == answer
            found = summarise(table, limit)
            assert [found.passed, found.undecided, found.missed] == [answer == "doubtful pass", answer == "not decided", answer == "fail"]


@pytest.mark.broad
def test_a_given_accelerometer_is_not_told(fleet, tmp_path):
    ran(fleet, tmp_path, FleetOptions(steps=("fit",), accelerometer="given"))
    for each in unit_results(tmp_path):
        assert np.isfinite(each.values[:12]).all()
        assert np.isnan(each.values[12:]).all()
        assert np.isnan(each.covariance[12:]).all()


# Each is computed once


def test_nothing_is_computed_twice(copied, tmp_path):
    out = tmp_path / "out"
    assert ran(copied, out)[1] == ["unit0", "unit1", "unit2", "unit3"]
    before = content(out)
    tally, computed = ran(copied, out)
    assert (computed, tally.reused, tally.done) == ([], 4, 0)
    assert content(out) == before


def test_only_what_has_changed_is_computed_again(copied, tmp_path):
    out = tmp_path / "out"
    ran(copied, out)
    config = copied / "unit2" / "session.toml"
    config.write_text(config.read_text() + '[notes]\noperator = "A"\n')
    (copied / "unit1" / "truth.json").write_text("{}")  # which no command reads
    (copied / "unit3" / "fit").mkdir()  # and what one derived
    assert ran(copied, out)[1] == ["unit2"]
    assert asked(out, "SELECT folder, operator FROM results JOIN folders USING (key) WHERE operator IS NOT NULL") == [
        (str(copied / "unit2"), "A")
    ]


@pytest.mark.broad
def test_moved_and_copied_folders_are_known_by_what_is_in_them(copied, tmp_path):
    out = tmp_path / "out"
    ran(copied, out)
    (copied / "unit0").rename(copied / "elsewhere")
    shutil.copytree(copied / "unit1", copied / "unit1copy")
    tally, computed = ran(copied, out)
    assert (computed, tally.reused) == ([], 5)
    names = [os.path.basename(folder) for (folder,) in asked(out, "SELECT folder FROM folders ORDER BY 1")]
    assert names == ["elsewhere", "unit1", "unit1copy", "unit2", "unit3"]
    assert asked(out, f"SELECT count(*) FROM {EACH}") == [(4,)]  # a copy is no further measurement


@pytest.mark.parametrize(
    "other",
    [{"steps": ("fit",)}, {"seed": 1}, {"earth": False}, {"accelerometer": "fit"}],
    ids=lambda change: next(iter(change)),
)
def test_a_key_follows_from_every_option(fleet, other):
    assert key_of(fleet / "unit0", FleetOptions(**other)) != key_of(fleet / "unit0", FleetOptions())


def test_a_key_follows_from_the_version(fleet, monkeypatch):
    before = key_of(fleet / "unit0", QUICK)
    monkeypatch.setattr(fleet_row, "VERSION", "0.0.0")
    assert key_of(fleet / "unit0", QUICK) != before


def test_a_key_follows_from_the_effects_that_are_named(fleet, tmp_path):
    plain = key_of(fleet / "unit0", FleetOptions())
    found = []
    for text in ("", "# changed\n"):
        (tmp_path / "mine.py").write_text(text)
        found.append(key_of(fleet / "unit0", FleetOptions(effects=(str(tmp_path),))))
    assert len({plain, *found}) == 3


@pytest.mark.broad
def test_a_session_that_changes_while_it_is_read_is_not_kept(copied, tmp_path):
    class Slow(Here):
        def finished(self):
            config = copied / "unit0" / "session.toml"
            config.write_text(config.read_text() + "# later\n")
            return super().finished()

    shutil.rmtree(copied / "unit1")
    tally, _ = ran(copied, tmp_path / "out", executor=Slow())
    assert tally.failed >= 1
    assert asked(tmp_path / "out", "SELECT count(*) FROM folders WHERE key IS NULL AND error LIKE '%changed while%'") == [(1,)]
    assert ran(copied, tmp_path / "out")[1] == ["unit0"]


# Failures are rows


@pytest.fixture
def spoilt(copied):
    """unit0 has a broken log, unit1 no log, unit2 no session.toml and unit3 is well."""
    log = next((copied / "unit0").glob("log*"))
    log.write_bytes(log.read_bytes()[:1000])
    next((copied / "unit1").glob("log*")).unlink()
    (copied / "unit2" / "session.toml").unlink()
    return copied


def test_failures_are_rows_with_their_line(spoilt, tmp_path):
    out = tmp_path / "out"
    tally, _ = ran(spoilt, out)
    assert (tally.done, tally.failed) == (1, 3)
    rows = asked(out, "SELECT folder, status, step, results.error FROM folders JOIN results USING (key) ORDER BY 1")
    assert [row[1] for row in rows] == ["failed"] * 3 + ["done"]
    for folder, _, step, error in rows[:3]:
        assert step == "check"
        assert "\n" not in error
        assert os.path.dirname(folder) not in error, "another copy lies elsewhere"
    assert "log0001.csv.gz" in rows[0][3]
    assert rows[3][2:] == (None, None)
    assert ran(spoilt, out)[1] == []  # nor are failures computed twice
    assert sorted(ran(spoilt, out, retry=True)[1]) == ["unit0", "unit1", "unit2"]


@pytest.mark.broad
def test_what_nobody_has_foreseen_fails_one_row(copied, tmp_path, monkeypatch):
    def breaks(session, *more, **how):
        if session.config.sensor.serial == "SIM-1":
            raise ZeroDivisionError("not foreseen")
        return fit_as_it_is(session, *more, **how)

    fit_as_it_is = fleet_session.fit_session
    monkeypatch.setattr(fleet_session, "fit_session", breaks)
    assert ran(copied, tmp_path / "out", FIT)[0].done == 3
    assert asked(tmp_path / "out", "SELECT serial, step, error FROM results WHERE status = 'failed'") == [
        ("SIM-1", "fit", "internal error: ZeroDivisionError: not foreseen")
    ]


def test_a_folder_that_cannot_be_read_has_no_key_and_is_tried_again(fleet, tmp_path):
    gone = tmp_path / "gone"
    for there in (False, True):
        if there:
            shutil.copytree(fleet / "unit0", gone)
        with open_table(tmp_path / "out") as table:
            tally = run_fleet(listed_folders([f"{gone}\n", "\n"]), table, Here(), QUICK)
        assert (tally.failed, tally.done) == (not there, there)
    assert asked(tmp_path / "out", "SELECT key IS NULL, error FROM folders") == [(0, None)]
