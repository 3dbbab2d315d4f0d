"""Explaining a mismatch that session.toml makes: a full scale, a latitude or a heading that is not the recording's."""

import re
import shutil

import pytest
from explained_sessions import make_session

from session.io.errors import DataError
from session.io.units import DEG
from tinygc import read_session
from tinygc.closure.build import build_problem
from tinygc.explanation.engine import explain_session
from tinygc.explanation.result import to_json

session = pytest.fixture(make_session, scope="module", name="session")


def test_a_wrong_full_scale_is_said_and_not_explained(session, run, tmp_path):
    folder = shutil.copytree(session("nothing"), tmp_path / "wrong")
    path = folder / "session.toml"
    path.write_text(path.read_text().replace("gyro_fs_dps = 500", "gyro_fs_dps = 250"))
    assert "gyro_fs_dps = 250" in path.read_text()
    with pytest.raises(DataError, match=r"250") as error:
        explain_session(folder)
    assert "500" in str(error.value)
    code, out, err = run("explain", folder, "--quiet")
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert not (folder / "explain").exists()


@pytest.mark.slow
def test_a_latitude_of_the_wrong_sign_is_said(session, tmp_path):
    folder = shutil.copytree(session("nothing"), tmp_path / "south")
    path = folder / "session.toml"
    latitude = read_session(folder).config.site.latitude_deg
    path.write_text(path.read_text().replace(f"latitude_deg = {latitude:g}", f"latitude_deg = {-latitude:g}"))
    result = to_json(explain_session(folder))
    (finding,) = result["findings"]
    assert finding["id"] == "unknown.world_direction"
    seen, given = map(float, re.search(r"about (-?\d+) deg, session.toml says (-?[\d.]+)", finding["description"]).groups())
    assert seen == pytest.approx(latitude, abs=15)
    assert given == -latitude
    assert "site.latitude_deg" in result["next"]


@pytest.mark.broad
def test_a_heading_that_the_stills_contradict_is_a_warning(session, tmp_path):
    folder = shutil.copytree(session("nothing"), tmp_path / "turned")
    path = folder / "session.toml"
    seen = build_problem(read_session(folder)).earth.heading_rad / DEG
    path.write_text(path.read_text().replace("[site]\n", f"[site]\nheading_deg = {seen + 90:.1f}\n", 1))
    result = to_json(explain_session(folder))
    (warning,) = [warning for warning in result["warnings"] if warning["what"] == "heading"]
    assert f"heading_deg = {float(f'{seen + 90:.1f}'):g}" in warning["description"]
    assert "which was used" in warning["description"]
    assert result["verdict"] == "no_mismatch"
