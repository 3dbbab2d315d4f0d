"""An accelerometer with all axes negated: turns are blind to it, the Earth's rotation, dials and a truth file are not."""

import gzip
import json
from dataclasses import replace

import numpy as np
import pytest
import tomlkit
from conftest import DEG
from looks import of
from test_problem import with_dials
from truth_sessions import Wrong, made

import tinygc
from session.detect.axes import agreement
from session.detect.check_references import with_aligned_truth
from session.detect.first_look import check_session
from session.detect.stills import find_stills
from session.io.config import TruthGiven
from tinygc import read_session
from tinygc.attitude.earth import vertical_only, vertical_rate
from tinygc.closure.build import build_problem
from tinygc.closure.prepared import GRAVITY_SIGN, prepare


@pytest.fixture(scope="module")
def folder(simulated):
    return simulated(segments=30, closure_s=0.0, seed=7, odr_hz=208.0)


def upside_down(session):
    """All specific forces negated, and with them the zero of a calibration that was given."""
    logs = tuple(replace(log, samples=log.samples.with_accel(-log.samples.accel)) for log in session.logs)
    triad = session.config.accelerometer
    return replace(session, logs=logs, config=replace(session.config, accelerometer=replace(triad, bias_mps2=-triad.bias_mps2)))


def in_a_folder(folder, new, sign):
    """The session as files, its specific forces by the sign; no calibration of the accelerometer is given."""
    new.mkdir()
    settings = tomlkit.parse((folder / "session.toml").read_text())
    settings.remove("accelerometer")
    (new / "session.toml").write_text(tomlkit.dumps(settings))
    header, *rows = gzip.decompress((folder / "log0001.csv.gz").read_bytes()).decode().splitlines()
    comments = [row for row in (header, *rows) if row.startswith("#")]
    names, *rows = [row for row in (header, *rows) if not row.startswith("#")]
    of_force = [names.split(",").index(name) for name in ("ax", "ay", "az")]
    values = np.array([row.split(",") for row in rows], dtype=np.int64)
    values[:, of_force] *= sign
    table = [",".join(map(str, row)) for row in values.tolist()]
    (new / "log0001.csv").write_text("\n".join([*comments, names, *table, ""]))
    return new


def said(session):
    return [finding for finding in prepare(session).warnings if finding.what == GRAVITY_SIGN]


@pytest.mark.broad
def test_the_turns_do_not_tell_gravitys_sign(folder):
    session = read_session(folder)
    pair = [each.calibrated(each.logs[0]) for each in (session, upside_down(session))]
    right, wrong = (agreement(samples, find_stills(samples)[0]) for samples in pair)
    assert (wrong.misfit, wrong.residual, wrong.scale) == pytest.approx((right.misfit, right.residual, right.scale), rel=1e-6)
    assert all(finding.level != "error" for finding in check_session(upside_down(session)))


@pytest.mark.broad
def test_the_earth_tells_an_accelerometer_that_is_upside_down(folder):
    session = read_session(folder)
    assert said(session) == []
    (finding,) = said(upside_down(session))
    assert finding.level == "warning"
    assert "as if gravity were upside down" in finding.says
    assert "negate all axes of the accelerometer if the one that points up reads -1 g" in finding.do
    assert "\n" not in finding.line
    assert max(len(finding.says), len(finding.do)) < 140


@pytest.mark.broad
def test_check_says_it_too_before_anything_is_fitted(folder, tmp_path, run):
    session = read_session(folder)
    assert [finding for finding in tinygc.check(session) if finding.what == GRAVITY_SIGN] == []
    assert [finding for finding in tinygc.check(upside_down(session)) if finding.what == GRAVITY_SIGN] == said(upside_down(session))
    right, wrong = (in_a_folder(folder, tmp_path / name, sign) for name, sign in (("right", 1), ("wrong", -1)))
    code, out, _ = run("check", right, "--json", "-", "--strict")
    assert (code, [each for each in json.loads(out)["findings"] if each["what"] == GRAVITY_SIGN]) == (0, [])
    code, out, _ = run("check", wrong, "--json", "-", "--strict")
    (finding,) = (each for each in json.loads(out)["findings"] if each["what"] == GRAVITY_SIGN)
    assert (code, finding["level"], finding["where"]) == (1, "warning", "log0001.csv")
    assert "negate all axes of the accelerometer" in finding["advice"]
    shown = " ".join(run("check", wrong)[1].split())
    assert "gravity's sign" in shown


@pytest.mark.broad
def test_check_says_nothing_of_it_where_there_is_too_little_to_tell(simulated, tmp_path):
    few = in_a_folder(simulated(segments=4, closure_s=0.0, odr_hz=208.0), tmp_path / "few", -1)
    assert [finding for finding in tinygc.check(few) if finding.what == GRAVITY_SIGN] == []


@pytest.mark.broad
def test_a_latitude_with_the_wrong_sign_looks_the_same_and_is_named_beside_it(folder):
    session = read_session(folder)
    site = session.config.site
    south = replace(session, config=replace(session.config, site=replace(site, latitude_deg=-site.latitude_deg)))
    (finding,) = said(south)
    assert "is site.latitude_deg wrong?" in finding.do
    assert said(upside_down(south)) == []


@pytest.mark.broad
def test_without_a_latitude_nothing_is_taken_off_and_nothing_is_said(folder):
    session = read_session(folder)
    nowhere = replace(session, config=replace(session.config, site=replace(session.config.site, latitude_deg=None)))
    assert said(upside_down(nowhere)) == []
    assert not prepare(upside_down(nowhere)).problem.batch.earth.any()


def test_the_vertical_rate_is_the_earths_within_its_sigma(folder):
    problem = build_problem(read_session(folder))
    rates = problem.still_rates
    down, sigma = vertical_rate(rates.q_tb, problem.first(rates.rate), rates.sigma)
    expected = vertical_only(problem.session.config.site.latitude_deg).rate_t[2]
    assert abs(down - expected) < 4 * sigma
    assert sigma < abs(expected) / 4
    one = np.tile(rates.q_tb[:1], (len(rates.q_tb), 1))
    assert vertical_rate(one, rates.rate, rates.sigma) is None  # in one attitude it is a bias


@pytest.mark.broad
def test_dials_tell_it_at_once(folder, tmp_path):
    session = read_session(with_dials(folder, build_problem(read_session(folder)), tmp_path))
    assert of(check_session(session), "dials against gravity").level == "ok"
    finding = of(check_session(upside_down(session)), "dials against gravity")
    assert finding.level == "error"
    assert "upside down" in finding.says
    turned = replace(session, attitudes=np.add(session.attitudes, [40 * DEG, 0, 0]))
    assert of(check_session(turned), "dials against gravity").level == "warning"


@pytest.mark.broad
@pytest.mark.parametrize("given", [None, "ned"])
def test_a_truth_whose_world_has_z_up_is_said_in_one_line(given):
    session, _ = made(Wrong(frame="enu", turns=12, given=TruthGiven(frame=given)))
    finding = of(with_aligned_truth(session)[1], "truth's frame")
    if given is None:
        assert finding.level == "note"
        assert "z up (found)" in finding.says
        assert "an accelerometer whose three axes are all negated looks the same" in finding.do
    else:
        assert finding.level == "warning"
        assert "gravity says 18" in finding.says or "gravity says 17" in finding.says
    right, _ = made(Wrong(turns=12))
    assert of(with_aligned_truth(right)[1], "truth's frame").level == "ok"


@pytest.mark.broad
def test_no_real_recording_is_said_to_be_upside_down(shared):
    tried = 0
    for name in ("xsens", "mikov/imu0", "concealed/case001", "concealed/case024"):
        if (shared / name / "session.toml").exists():
            assert said(read_session(shared / name)) == []
            tried += 1
    if not tried:
        pytest.skip("no recordings in ../shared")
