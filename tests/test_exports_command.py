"""``calibrate.py export`` of a fitted session: its files, and what it refuses."""

import json

import numpy as np
import pytest
import yaml
from exports_read_back import MEASURED, agree

from tinygc import models


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


# The command


def test_command_refuses_what_is_not_there(fitted, tmp_path, capsys):
    import calibrate

    for arguments, words in (
        ([str(tmp_path), "--to", "json"], "session.toml"),
        ([str(fitted), "--to", "json", "--model", "pso"], "no model_pso.json"),
        ([str(fitted), "--to", "json", "--model", str(tmp_path / "none.json")], "none.json"),
    ):
        assert calibrate.main(["export", *arguments]) == 2
        said = capsys.readouterr().err.strip()
        assert words in said
        assert len(said.splitlines()) == 1
    unfitted = tmp_path / "unfitted"
    unfitted.mkdir()
    (unfitted / "session.toml").write_text((fitted / "session.toml").read_text())
    assert calibrate.main(["export", str(unfitted), "--to", "json"]) == 2
    assert "calibrate.py fit" in capsys.readouterr().err
    assert not (unfitted / "export").exists()


def test_same_fit_same_bytes(exported):
    assert exported("kalibr") == exported("kalibr")


def test_a_fitted_net_that_found_nothing_to_bend_for_is_carried(fitted, exported):
    """Its slopes are 1 but for rounding; the rates are the net's."""
    net = models.load(fitted / "fit" / "model_tinygc.json")
    if np.abs(net.slope - 1).max() > 1e-9:
        pytest.skip("the net bends on this session")
    (text,) = exported("ros", "--model", "tinygc").values()
    gyro = yaml.safe_load(text)["/**"]["ros__parameters"]["gyroscope"]
    agree(MEASURED @ np.reshape(gyro["matrix"], (3, 3)).T + gyro["offset"], net)
