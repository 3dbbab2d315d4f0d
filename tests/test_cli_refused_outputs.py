"""One clear line and exit code 2 where results cannot be written, before the work."""

import json
from pathlib import Path

import pytest
from commandline import refused

from tinygc import models


def test_a_session_that_may_only_be_read_is_fitted_with_out(run, folder, monkeypatch, tmp_path):
    """--out DIR takes models and figures, makes its parents, and leaves the session as it was."""
    make = Path.mkdir

    def refuse(self, *args, **settings):
        if folder in (self, *self.parents):
            raise PermissionError(13, "Permission denied", str(self))
        return make(self, *args, **settings)

    monkeypatch.setattr(Path, "mkdir", refuse)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    out = tmp_path / "results" / "first"
    code, said, _ = run("fit", folder, "--methods", "raw,least_squares", "--out", out)
    assert code == 0
    assert f"files: {out}" in said
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert sorted(path.name for path in out.iterdir()) == ["fit.json", "fitted.json", "model_least_squares.json", "model_raw.json"]
    assert set(json.loads((out / "fit.json").read_text())["methods"]) == {"raw", "least_squares"}
    assert models.load(out / "model_least_squares.json").vector.shape == (12,)


@pytest.mark.parametrize("command", ["fit", "explain"])
def test_what_cannot_be_written_is_found_before_the_work(run, folder, tmp_path, monkeypatch, command):
    def worked(*args, **settings):
        raise AssertionError("the work began")

    monkeypatch.setattr("tinygc.library.fits.fit_session", worked)
    monkeypatch.setattr("tinygc.library.explanations.explain_session", worked)
    (tmp_path / "file").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    refused(run(command, folder, "--out", tmp_path / "file" / "sub"), "file", "--out")
    refused(run(command, folder, "--json", tmp_path / "none" / "x.json"), "x.json", "--json")
    refused(run(command, folder, "--json", tmp_path), "--json")
    with pytest.raises(AssertionError, match="the work began"):
        run(command, folder, "--out", tmp_path / "new" / "er", "--json", tmp_path / "new" / "er" / "x.json")
    assert sorted(tmp_path.rglob("*")) == before  # no trial leaves a trace


def test_simulate_does_not_overwrite(run, folder):
    (folder / "truth.json").unlink()
    refused(run("simulate", "--out", folder), "not empty")
    refused(run("simulate", "--out", folder, "--force"), "truth.json is missing")
    assert (folder / "log0001.csv").exists()
