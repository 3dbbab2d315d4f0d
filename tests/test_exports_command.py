"""``calibrate.py export`` of a fitted session: its files, and what it refuses."""

import json

import numpy as np
import pytest
import yaml

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


# The command


def test_command_refuses_what_is_not_there(fitted, tmp_path, capsys):
    import calibrate

    for arguments, words in (
        ([str(tmp_path), "--to", "json"], "session.toml"),
        ([str(fitted), "--to", "json", "--model", "pso"], "no model_pso.json"),
        ([str(fitted), "--to", "json", "--model", str(tmp_path / "none.json")], "none.json"),
        ([str(fitted), "--to", "kalibr", "--inflation", "walking"], "its factors stand in noise.json, and there is none"),
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


# Noise figures beside a fit


@pytest.fixture
def with_figures(fitted, tmp_path):
    """The fitted session with ``noise.json`` in its ``fit``."""
    import shutil

    from noise_records import WALKING, figures

    from tinygc.noise.figures import to_json

    folder = tmp_path / "with figures"
    shutil.copytree(fitted, folder, ignore=shutil.ignore_patterns("export"))
    (folder / "fit" / "noise.json").write_text(json.dumps(to_json(figures(inflations=(WALKING,)))), encoding="utf-8")
    return folder


def test_figures_beside_the_model_are_exported_with_it(with_figures, tmp_path):
    import calibrate

    for words, density in (((), 5e-4), (("--inflation", "walking"), 1.5e-3)):
        out = tmp_path / f"out {len(words)}"
        assert calibrate.main(["export", str(with_figures), "--quiet", "--out", str(out), "--to", "openvins", *words]) == 0
        text = (out / "kalibr_imu_chain.yaml").read_text(encoding="utf-8")
        table = yaml.safe_load(text.removeprefix("%YAML:1.0\n"))["imu0"]
        assert table["gyroscope_noise_density"] == pytest.approx(density)
        assert "NOT CALIBRATED" not in text
        E = models.load(with_figures / "fit" / "model_least_squares.json").E
        np.testing.assert_allclose(np.transpose(table["R_IMUtoGYRO"]) @ np.linalg.inv(table["Tw"]), E, atol=1e-12)
