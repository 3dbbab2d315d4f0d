"""Samples lost behind closed-up stamps: a log is mended and its floor says so, a closure run is not mended and that is said."""

import gzip
import json

import numpy as np
import pytest

import calibrate
from tinygc import SimulationOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.runs import read_closure_runs
from tinygc.estimation.physics import loss_words
from tinygc.explanation.physics import lost_in
from tinygc.simulation.write import write_session

LOST = 25


def lose(path, rows):
    """Take ``LOST`` lines out after each of the rows of data, and give those that remain the first stamps."""
    lines = gzip.decompress(path.read_bytes()).decode().splitlines()
    begin = next(i for i, line in enumerate(lines) if line.startswith("t_us")) + 1
    head, data = lines[:begin], lines[begin:]
    keep = np.ones(len(data), dtype=bool)
    for row in rows:
        keep[row + 1 : row + 1 + LOST] = False
    left = [line.split(",", 1)[1] for line, stays in zip(data, keep, strict=True) if stays]
    stamps = [line.split(",", 1)[0] for line in data]
    path.write_bytes(gzip.compress(("\n".join([*head, *map(",".join, zip(stamps, left, strict=False))]) + "\n").encode()))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_session(SimulationOptions(segments=24, closure_s=30.0, seed=5), tmp_path_factory.mktemp("losses") / "whole")


@pytest.fixture(scope="module")
def lossy(tmp_path_factory):
    folder = write_session(SimulationOptions(segments=24, closure_s=30.0, seed=5), tmp_path_factory.mktemp("losses") / "lossy")
    problem = build_problem(read_session(folder))
    (run,) = read_closure_runs(problem)
    speed = np.linalg.norm(run.samples.gyro, axis=1)
    third = len(speed) // 3
    in_run = [third + int(np.argmax(speed[third : 2 * third]))]
    lose(folder / "log0001.csv.gz", [(s.start + s.stop) // 2 for s in problem.used[2::4]])
    lose(folder / "closure0001.csv.gz", in_run)
    return folder, run.samples.t_s[in_run[0]] - run.samples.t_s[0]


def test_a_run_without_a_loss_has_none(whole):
    (run,) = read_closure_runs(build_problem(read_session(whole)))
    assert not len(lost_in(run))
    assert loss_words(lost_in(run)) == ""


@pytest.mark.slow
def test_fit_says_the_mended_floor_and_the_run_that_is_not_mended(lossy, tmp_path, capsys):
    folder, at_s = lossy
    words = ["fit", str(folder), "--physics", "auto", "--methods", "least_squares", "--verbose", "--out", str(tmp_path)]
    assert calibrate.main([*words, "--json", str(tmp_path / "f.json")]) == 1  # as the closure run says
    table, printed = json.loads((tmp_path / "f.json").read_text()), " ".join(capsys.readouterr().out.split())
    noise = table["noise"]
    assert noise["closure_floor_repaired_rms_deg"] > 1.5 * noise["closure_floor_rms_deg"]
    held = {name: method["holdout"]["tilt_rms_deg"] for name, method in table["methods"].items()}
    assert held["physics"] < 0.5 * held["least_squares"]
    assert f"noise floor of the mended log (physics) {noise['closure_floor_repaired_rms_deg']:.4f}" in printed
    assert table["closure_runs"][0]["lost_at_s"] == pytest.approx([at_s], abs=0.01)
    assert "closure0001.csv.gz: samples seem lost in it" in printed
    assert "nothing in a closure run is mended" in printed
