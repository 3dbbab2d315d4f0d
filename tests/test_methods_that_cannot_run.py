"""A method that cannot run on a session says so in its row; the others stand."""

import json

import pytest
from conftest import SESSION_TOML, Table, write_session
from recorded_files import write_sundevil

import tinygc

METHODS = ("raw", "least_squares", "pso", "tinygc", "tinygc_denoised")


@pytest.fixture
def slow(tmp_path):
    """A session at 20 Hz: its stills hold fewer samples than the denoiser's window."""
    toml = SESSION_TOML.replace("208.0", "20.0")
    return write_session(tmp_path / "session", Table().tumble(14, rest_s=1.5, seed=5).samples(odr_hz=20.0), toml=toml)


@pytest.mark.broad
def test_all_methods_on_a_session_that_is_slower_than_the_denoisers_window(slow, tmp_path, run):
    code, out, err = run("fit", slow, "--methods", ",".join(METHODS), "--out", tmp_path / "fit", "--no-defaults")
    assert code in (0, 1), err
    assert "TinyGC-Net, denoised: its window of 49 samples" in " ".join(out.split())
    table = json.loads((tmp_path / "fit" / "fit.json").read_text())
    (left_out,) = table["not_run"]
    assert left_out["method"] == "tinygc_denoised"
    assert "is longer than the stills" in left_out["why"]
    assert list(table["methods"]) == [name for name in METHODS if name != "tinygc_denoised"]


def test_a_method_alone_that_cannot_run_is_refused_in_one_line(slow, run, tmp_path):
    code, _, err = run("fit", slow, "--methods", "tinygc_denoised", "--out", tmp_path / "fit")
    assert code == 2
    assert "its window of 49 samples" in err
    assert "Traceback" not in err


@pytest.mark.broad
def test_the_report_names_the_method_that_cannot_run(slow, run):
    code, _, err = run("report", slow, "--no-explain", "--methods", ",".join(METHODS))
    assert code in (0, 1), err
    assert "TinyGC-Net, denoised: its window of 49 samples" in (slow / "report.html").read_text()


@pytest.mark.broad
@pytest.mark.parametrize("name", ["Long", "Short"])
def test_the_rockets_board_at_20_hz_is_fitted_with_all_methods(shared, tmp_path, name):
    source = shared / "wild" / "sundevil" / "rev2" / f"IMU_Rev2_Data_{name}.txt"
    if not source.exists():
        pytest.skip(f"no recording: {source} is not there")
    folder = write_sundevil(source, tmp_path / name, factor=2.0)
    assert "least_squares" in tinygc.fit(folder).closure
