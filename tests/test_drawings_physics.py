"""The drawings of docs/table.md and docs/wiring.md: made by their program, the forty turns possible by hand and enough for every number."""

import runpy

import numpy as np
import pytest
from conftest import ROOT

from session.base import rotation

DRAWINGS = runpy.run_path(str(ROOT / "docs" / "make_drawings.py"))


def test_the_drawings_are_those_of_their_program(tmp_path, monkeypatch):
    monkeypatch.setitem(DRAWINGS["forty"].__globals__, "DOCS", tmp_path)
    for draw in ("cube", "ball", "gimbal", "forty", "stepper", "wirings"):
        DRAWINGS[draw]()
    made = sorted(tmp_path.glob("*.svg"))
    assert len(made) == 9
    for drawing in made:
        assert drawing.read_text(encoding="utf-8") == (ROOT / "docs" / drawing.name).read_text(encoding="utf-8"), drawing.name


def test_each_of_the_forty_turns_begins_where_the_last_one_ended():
    turns, sigma = DRAWINGS["best_turns"](40)
    up = np.array([0.0, 0.0, 1.0])
    for begins, turn in turns:
        (part,) = turn.parts
        assert np.allclose(begins, up)
        up = rotation.matrix(rotation.exp(part.axis * part.angle_rad)).T @ begins  # the vertical in the board's axes
        assert np.allclose(up, part.up)
    axes = {tuple(np.round(turn.parts[0].axis).astype(int)) for _, turn in turns}
    assert len(axes) == 6  # each axis in both senses
    # An ASM330LHH's white noise alone: what docs/table.md states.
    assert sigma[[0, 4, 8]].max() == pytest.approx(11e-6, abs=0.5e-6)
    assert sigma[[1, 2, 3, 5, 6, 7]].max() == pytest.approx(0.035e-3, abs=0.0005e-3)
    assert sigma[9:].max() == pytest.approx(np.radians(0.38e-3), abs=np.radians(0.005e-3))
