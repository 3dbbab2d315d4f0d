"""What a notebook calls of features: the numbers and files of their commands."""

import json

import pytest
from fleets import written_fleet
from formats_page import told as command

import tinygc
from tinygc import CalibrationError


def test_an_array_gives_the_commands_numbers(tmp_path):
    folder, model = tmp_path / "array", tmp_path / "fit" / "model_array.json"
    words = ("--units", 2, "--segments", 8, "--closure", 0, "--odr-hz", 62.5, "--seed", 3)
    command(tmp_path / "s.json", "simulate", *words, "--out", folder)
    theirs = command(tmp_path / "a.json", "fit", folder, "--bias", "ends", "--out", tmp_path / "fit")
    fitted = tinygc.array(folder).fit(bias="ends")
    assert json.loads(json.dumps(fitted.to_json())) == theirs
    assert (fitted.save(tmp_path / "mine") / "model_array.json").read_bytes() == model.read_bytes()
    applied = command(tmp_path / "b.json", "apply", model, folder, "-o", tmp_path / "theirs.csv")
    done = tinygc.array(folder).apply(model, tmp_path / "mine.csv")
    assert (tmp_path / "mine.csv").read_bytes() == (tmp_path / "theirs.csv").read_bytes()
    assert json.loads(json.dumps(done.to_json())) | {"out": applied["out"]} == applied
    for source in (model, folder):
        with pytest.raises(CalibrationError, match="an array, and an export holds one sensor"):
            tinygc.export(source, "c")
    with pytest.raises(CalibrationError, match="an array of 1 unit; expected two sessions or more"):
        tinygc.array([tinygc.simulate(segments=3, closure_s=0.0, odr_hz=62.5).session])


def test_a_lot_gives_the_commands_numbers(tmp_path):
    written_fleet(tmp_path / "fleet", "ASM330LHH")
    theirs = command(tmp_path / "l.json", "lot", tmp_path / "fleet", "--out", tmp_path / "theirs.json")
    found = tinygc.lot(tmp_path / "fleet")
    assert json.loads(json.dumps(found.to_json())) == theirs
    assert found.save(tmp_path / "mine.json").read_bytes() == (tmp_path / "theirs.json").read_bytes()
