"""`fit` with the further nets: what the command line gives a user."""

import json

import pytest
from conftest import ROOT

import calibrate
from tinygc.estimation import adamw, network


def fit(folder, out, *more):
    code = calibrate.main(["fit", str(folder), "--out", str(out), "--json", str(out / "table.json"), "--quiet", *more])
    return code, json.loads((out / "table.json").read_text())


@pytest.mark.broad
def test_as_in_the_paper(simulated, tmp_path, monkeypatch):
    """Both nets by AdamW; every other method as it is, with the first-order integrator; the file says what trained it."""
    monkeypatch.setattr(adamw, "EPOCHS", 3)
    folder, how = simulated(), ["--methods", "least_squares,tinygc,tinygc_denoised", "--folds", "2"]
    usual, paper = (fit(folder, tmp_path / name, *how, *more)[1] for name, more in (("usual", []), ("paper", ["--as-in-paper"])))
    assert (usual["options"]["as_in_paper"], paper["options"]["as_in_paper"]) == (False, True)
    tilt = {name: method["holdout"]["tilt_rms_deg"] for name, method in paper["methods"].items()}
    assert tilt["least_squares"] == pytest.approx(usual["methods"]["least_squares"]["holdout"]["tilt_rms_deg"], rel=0.2)
    assert tilt["tinygc"] > 10 * tilt["least_squares"]  # of three epochs
    assert paper["methods"]["tinygc_denoised"]["denoiser"]["loss"] == "endpoint"
    notes = {name: of["notes"] for name, of in json.loads((tmp_path / "paper" / "fitted.json").read_text())["methods"].items()}
    assert [len(notes[name]["loss"]) for name in ("tinygc", "tinygc_denoised")] == [3, 3]
    export = ["export", str(folder), "--to", "json", "--anyway"]
    for name, versions in (("usual", set()), ("paper", {"torch"})):
        model = tmp_path / name / "model_tinygc.json"
        assert calibrate.main([*export, "--model", str(model), "--out", str(tmp_path / name)]) == 0
        (made,) = (path for path in (tmp_path / name).glob("*.json") if "versions" in path.read_text())
        assert {"torch"} & set(json.loads(made.read_text())["versions"]) == versions


@pytest.mark.slow
def test_an_interrupted_fit_repeats_no_training_that_had_ended(tmp_path, monkeypatch):
    """Ctrl-C in the second of six trainings; resumed, the numbers are those of a fit that was left alone."""
    how = ["--methods", "tinygc", "--as-in-paper", "--folds", "2"]
    monkeypatch.setattr(adamw, "EPOCHS", 8)
    alone = fit(ROOT / "data" / "session1", tmp_path / "alone", *how)[1]
    told, train = [], adamw.minimise

    def watched(*args, progress, **more):
        def tell(done, of):
            told.append(done)
            if len(told) == 12:
                raise KeyboardInterrupt
            progress(done, of)

        return train(*args, progress=tell, **more)

    monkeypatch.setattr(network, "minimise", watched)
    out = tmp_path / "out"
    out.mkdir()
    assert calibrate.main(["fit", str(ROOT / "data" / "session1"), "--out", str(out), "--quiet", *how]) == 130
    assert sorted(path.name for path in out.glob("checkpoint*")) == ["checkpoint_tinygc_fold0.json", "checkpoint_tinygc_whole.json"]
    resumed = fit(ROOT / "data" / "session1", out, "--resume", *how)[1]
    assert told[12:] == [5, 6, 7, 8, *range(1, 9)]
    assert resumed["methods"]["tinygc"]["holdout"] == alone["methods"]["tinygc"]["holdout"]
    assert not list(out.glob("checkpoint*"))
