"""Whoever reads a command's output, and stops: the verdict's exit code stands, of every command that has one."""

import os
import sys

import pytest
from fleets import written_fleet
from watched import csv, joined, model_file, samples

import calibrate


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
