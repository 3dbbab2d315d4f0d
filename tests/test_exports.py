"""What other programs read, read back by an independent reader, gives the same rates."""

import json

import numpy as np
import pytest

import tinygc
from tinygc.exports import FORMATS, exporter


@pytest.mark.parametrize("name", FORMATS)
def test_every_exporter_has_its_name_and_one_line(name):
    module = exporter(name)
    assert module.NAME == name
    assert "\n" not in module.SUMMARY


def test_importing_the_package_loads_nothing_heavy():
    import subprocess
    import sys

    from conftest import ROOT

    code = "import sys, tinygc; print(sorted({'torch', 'scipy', 'numpy', 'rich'} & set(sys.modules)))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True, cwd=ROOT).strip() == "[]"
    assert callable(tinygc.load)


@pytest.fixture(scope="session")
def fitted(simulated, tmp_path_factory):
    """A small simulated session with the models of three methods."""
    import shutil

    import calibrate

    folder = tmp_path_factory.mktemp("fitted") / "Unit 7 (b)"
    shutil.copytree(simulated(), folder)
    assert calibrate.main(["fit", str(folder), "--methods", "raw,least_squares,tinygc", "--folds", "2", "--quiet"]) == 0
    return folder


@pytest.fixture
def exported(fitted, tmp_path):
    """``exported("json")``: the one file's text."""
    import calibrate

    def make(*arguments):
        assert calibrate.main(["export", str(fitted), "--quiet", "--out", str(tmp_path / "out"), "--to", *arguments]) == 0
        return {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "out").iterdir()}

    return make


def test_json_holds_its_own_proof(exported):
    """A stranger with nothing but the file's equation gets the self-test's rates."""
    ((name, text),) = exported("json").items()
    assert name == "Unit_7_b.json"
    table = json.loads(text)
    test, weights = table["self_test"], table["weights"]
    omega = np.array(test["measured_rps"]) @ np.array(weights["E"]).T + weights["B"]
    np.testing.assert_allclose(omega, test["omega_rps"], rtol=1e-12, atol=1e-15)
    assert np.shape(table["covariance"]) == (12, 12)
    assert len(table["covariance_of"]) == 12
    assert all(len(digest) == 64 for digest in table["sha256"].values())
    assert {"log0001.csv.gz", "session.toml", "model_least_squares.json"} <= set(table["sha256"])
