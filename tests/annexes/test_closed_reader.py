"""Whoever reads a command's output, and stops: the verdict's exit code stands, of every command that has one."""

import os
import sys

import processes
import pytest
from fleets import FIT, ran
from simulated_lots import written_fleet
from unit_sessions import moved_copies
from watched import csv, joined, model_file, samples

import calibrate
import tinygc

LEAST = "--methods least_squares --folds 2"


def closed_pipe() -> int:
    """The writing end of a pipe that nobody reads."""
    reader, writer = os.pipe()
    os.close(reader)
    return writer


def unread(monkeypatch, *words) -> int:
    """Exit code of a command whose standard output and standard error nobody reads."""
    with (
        open(closed_pipe(), "w", encoding="utf-8") as out,
        open(closed_pipe(), "w", encoding="utf-8", buffering=1) as err,
        monkeypatch.context() as patch,
    ):
        for name, stream in (("stdout", out), ("stderr", err)):
            patch.setattr(sys, name, stream)
            patch.setattr(sys, f"__{name}__", stream)
        try:
            return calibrate.main(list(words))
        except SystemExit as stopped:  # argparse
            return stopped.code
        finally:
            sys.stdout.flush()


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A log with a step, and the model for it; the table of a lot that drifts."""
    place = tmp_path_factory.mktemp("place")
    (place / "step.csv").write_text(csv(joined(samples(40, 1), samples(30, 2, zero_dps=(0.0, 0.05, 0.0)))))
    model_file(place / "model.json")
    written_fleet(place / "lot", "ASM330LHH", drift=5.0)
    return place


@pytest.fixture(scope="module")
def unit(place):
    """And three fitted sessions of one unit, with different zeros, with an effect that the fit lacks; a fleet's table of two of them."""
    hidden = {"gyro.bias_step": {"dps": [1.0, 0.0, 0.0], "at_s": 40.0}}
    tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1, effects=hidden).session.save(place / "day0")
    tinygc.fit(place / "day0", methods=("least_squares",)).save()
    for folder in ("days", "fitted_anew"):  # a fit of the second would write over the zeros that the others' verdicts rest on
        moved_copies(place / "day0", place / folder, (0.0, 2.0), ("2024-01-01", "2025-01-01"))
    ran(place / "days", place / "fleet", FIT)
    return place


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (1, "watch model.json step.csv"),
        (1, "watch model.json step.csv --json -"),
        (1, "lot lot --strict"),
        (2, "check nothing"),
        (2, "nonsense"),
    ],
)
def test_the_verdict_stands_though_nobody_reads(code, words, place, monkeypatch):
    monkeypatch.chdir(place)
    assert unread(monkeypatch, *words.split()) == code


@pytest.mark.broad
@pytest.mark.parametrize(
    ("code", "words"),
    [
        (1, f"fit day0 {LEAST} --limit 1e-6"),
        (1, f"fit fitted_anew/day1 fitted_anew/day2 {LEAST} --limit 1e-6"),
        (1, f"report day0 {LEAST} --no-explain --limit 1e-6"),
        (1, "check day0 --strict"),
        (1, "explain day0 --strict --no-pictures"),
        (1, "compare days/day1 days/day2 --bias --strict"),
        (1, "verify days/day2/fit/model_least_squares.json day0"),
        (1, "history days --require bias=1mdps --no-pictures"),
        (1, "fleet --out fleet --limit 1e-6"),
        (5, "budget day0 --monte-carlo 5 --of attitude_x --motion rest --json -"),
    ],
)
def test_the_verdict_of_a_session_stands_though_nobody_reads(code, words, unit, monkeypatch):
    monkeypatch.chdir(unit)
    assert unread(monkeypatch, *(word.replace("bias=1mdps", "bias 1 mdps") for word in words.split())) == code


def behind_head(place, words, **environment):
    """The command in a shell, with a reader that takes one line."""
    line = f"{sys.executable} {processes.ROOT}/calibrate.py {words} | head -n 1; exit ${{PIPESTATUS[0]}}"
    return processes.run(["bash", "-c", line], cwd=place, env=processes.environment(**environment), capture_output=True, text=True)


@pytest.mark.broad
@pytest.mark.parametrize("environment", [{}, {"PYTHONUNBUFFERED": "1"}])
def test_a_watch_goes_on_to_its_verdict_behind_head(place, environment):
    done = behind_head(place, "watch model.json step.csv 2>&1", **environment)
    assert (done.returncode, done.stdout.count("\n")) == (1, 1)


@pytest.mark.broad
def test_apply_to_standard_output_ends_with_its_reader(place):
    """Nothing else was asked of it."""
    done = behind_head(place, "apply model.json step.csv -o -")
    assert (done.returncode, done.stdout.count("\n")) == (0, 1)
    assert "samples, calibrated" not in done.stderr  # what it says at the log's end
    assert "pipe" not in done.stderr
